//! Real recordings whose missing physics others have published: what is expected of a diagnosis, and what it made of it.

use core::fmt::Write as _;

use serde::{Deserialize, Serialize};

use crate::robot::RobotError;
use crate::score::{Finding, Ran, Verdict};

/// The list that comes with this crate.
const KNOWN: &str = include_str!("../real.toml");

/// A robot of which recordings are at hand.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Real {
    /// Folder below the one with all recordings.
    pub folder: String,
    /// Who found out what is missing.
    pub source: String,
    /// Recordings to learn from.
    pub learn: Vec<String>,
    /// Recordings to judge on; none where part of the others has to do.
    #[serde(default)]
    pub judge: Vec<String>,
    /// Low-pass of the comparison `[Hz]`; none leaves it to the diagnosis.
    pub band: Option<f64>,
    /// Share of the held-out effort that the source itself leaves.
    pub error: Option<f64>,
    /// Names that are known to be wrong.
    #[serde(default)]
    pub never: Vec<String>,
    /// What is missing from the nominal robot.
    pub missing: Vec<Missing>,
}

/// An effect that is missing: any of the names at any of the places is right.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Missing {
    /// Names.
    pub names: Vec<String>,
    /// Joints or links.
    #[serde(rename = "where")]
    pub place: Vec<String>,
}

#[derive(Deserialize)]
struct List {
    robot: Vec<Real>,
}

/// The robots of the list.
///
/// # Errors
/// A list that cannot be read.
pub fn known() -> Result<Vec<Real>, RobotError> {
    let list: List =
        toml::from_str(KNOWN).map_err(|e| RobotError::Text { file: "real.toml".to_string(), reason: e.message().to_string() })?;
    Ok(list.robot)
}

/// The robot's files without the physics that a diagnosis has to find: no effects, no friction.
///
/// # Errors
/// Files that cannot be read or written.
pub fn stripped(toml_text: &str, urdf_text: &str) -> Result<[String; 2], RobotError> {
    let text = |file: &str, e: &dyn core::fmt::Display| RobotError::Text { file: file.to_string(), reason: e.to_string() };
    let mut spec: toml::Table = toml::from_str(toml_text).map_err(|e| text("robot.toml", &e.message()))?;
    let toml_out =
        if spec.remove("effect").is_some() { toml::to_string(&spec).map_err(|e| text("robot.toml", &e))? } else { toml_text.to_string() };
    let mut urdf = urdf_rs::read_from_string(urdf_text).map_err(|e| text("URDF", &e))?;
    let mut is_changed = false;
    for dynamics in urdf.joints.iter_mut().filter_map(|j| j.dynamics.as_mut()) {
        is_changed |= dynamics.damping.abs() > 0.0 || dynamics.friction.abs() > 0.0;
        (dynamics.damping, dynamics.friction) = (0.0, 0.0);
    }
    let urdf_out = if is_changed { urdf_rs::write_to_string(&urdf).map_err(|e| text("URDF", &e))? } else { urdf_text.to_string() };
    Ok([toml_out, urdf_out])
}

/// The two halves in time of a recording in CSV; both keep the lines before the header and the header.
#[must_use]
pub fn halves(csv: &str) -> [String; 2] {
    let mut head = String::new();
    let mut rows = Vec::new();
    let mut is_headed = false;
    for line in csv.lines() {
        if is_headed {
            rows.push(line);
        } else {
            is_headed = !line.trim_start_matches('\u{feff}').starts_with('#');
            let _ = writeln!(head, "{line}");
        }
    }
    let (a, b) = rows.split_at(rows.len() / 2);
    [a, b].map(|part| format!("{head}{}\n", part.join("\n")))
}

/// What came of one robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Folder.
    pub robot: String,
    /// Source of what is missing.
    pub source: String,
    /// Per missing effect, as `names@places`: named there, and named or among what a finding there cannot be told from.
    pub missing: Vec<(String, bool, bool)>,
    /// Everything said, as `effect@place`.
    pub said: Vec<String>,
    /// What was said and is not on the list.
    pub others: Vec<String>,
    /// What was said and is known to be wrong.
    pub wrong: Vec<String>,
    /// Share of the held-out effort that is left as given and with all findings.
    pub error: Option<[f64; 2]>,
    /// What the source leaves.
    pub published: Option<f64>,
    /// Names that one half of the recordings says and the other denies, of all that halves say; none where a half had no verdict.
    pub denied: Option<[usize; 2]>,
    /// Wall-clock time of the diagnosis of all recordings `[s]`.
    pub seconds: f64,
    /// Version of the program that diagnosed, and the SHA-256 of its file.
    pub engine: String,
}

fn meets(m: &Missing, effect: &str, place: &[String]) -> bool {
    m.names.iter().any(|n| n == effect) && place.iter().any(|p| m.place.contains(p))
}

fn in_set(m: &Missing, f: &Finding) -> bool {
    meets(m, &f.effect, &f.place) || f.cannot_tell_from.iter().any(|o| meets(m, &o.effect, &o.place))
}

fn label(f: &Finding) -> String {
    format!("{}@{}", f.effect, f.place.join("+"))
}

/// Judges the verdict on all recordings; `parts` are those on the halves.
#[must_use]
pub fn judge(real: &Real, verdict: Option<&Verdict>, ran: &Ran, parts: &[Option<Verdict>; 2]) -> Outcome {
    let findings: &[Finding] = verdict.map_or(&[], |v| &v.findings);
    let row = |m: &Missing| {
        let named = findings.iter().any(|f| meets(m, &f.effect, &f.place));
        (format!("{}@{}", m.names.join("/"), m.place.join("/")), named, findings.iter().any(|f| in_set(m, f)))
    };
    let others = findings.iter().filter(|f| !real.missing.iter().any(|m| in_set(m, f)));
    Outcome {
        robot: real.folder.clone(),
        source: real.source.clone(),
        missing: real.missing.iter().map(row).collect(),
        said: findings.iter().map(label).chain(verdict.filter(|v| v.unexplained.present).map(|_| "unexplained".to_string())).collect(),
        others: others.map(label).collect(),
        wrong: findings.iter().filter(|f| real.never.contains(&f.effect)).map(label).collect(),
        error: verdict.filter(|v| v.status == "ok").map(|v| [v.heldout.rms_nominal, v.heldout.rms_final]),
        published: real.error,
        denied: denied(parts),
        seconds: ran.seconds,
        engine: ran.engine.clone(),
    }
}

/// A name is denied where the other half neither says it at that place nor lists it among what a finding cannot be told from.
fn denied(parts: &[Option<Verdict>; 2]) -> Option<[usize; 2]> {
    let [Some(a), Some(b)] = parts else { return None };
    let says = |v: &Verdict, f: &Finding| {
        let wanted = Missing { names: vec![f.effect.clone()], place: f.place.clone() };
        v.findings.iter().any(|g| in_set(&wanted, g) || in_set(&Missing { names: vec![g.effect.clone()], place: g.place.clone() }, f))
    };
    let lost = a.findings.iter().filter(|f| !says(b, f)).count() + b.findings.iter().filter(|f| !says(a, f)).count();
    Some([lost, a.findings.len() + b.findings.len()])
}

/// Tables of all robots in Markdown.
#[must_use]
pub fn table(outcomes: &[Outcome]) -> String {
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    let mut out = String::from(
        "| robot | named | in the set | not on the list | known to be wrong | held out, given | held out, final | source leaves | denied by a half | s |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for o in outcomes {
        let count =
            |of: &dyn Fn(&(String, bool, bool)) -> bool| format!("{}/{}", o.missing.iter().filter(|m| of(m)).count(), o.missing.len());
        let [given, last] = o.error.map_or_else(|| ["–".to_string(), "–".to_string()], |e| e.map(percent));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {given} | {last} | {} | {} | {:.0} |",
            o.robot,
            count(&|m| m.1),
            count(&|m| m.2),
            o.others.len(),
            o.wrong.len(),
            o.published.map_or_else(|| "–".to_string(), percent),
            o.denied.map_or_else(|| "–".to_string(), |[lost, all]| format!("{lost}/{all}")),
            o.seconds
        );
    }
    let _ = writeln!(out, "\n| robot | missing | named | in the set |\n|---|---|---|---|");
    let word = |x: bool| if x { "yes" } else { "no" };
    for o in outcomes {
        for (what, named, set) in &o.missing {
            let _ = writeln!(out, "| {} | {what} | {} | {} |", o.robot, word(*named), word(*set));
        }
    }
    let _ = writeln!(out, "\n| robot | said | source |\n|---|---|---|");
    for o in outcomes {
        let said = if o.said.is_empty() { "nothing missing".to_string() } else { o.said.join(", ") };
        let _ = writeln!(out, "| {} | {said} | {} |", o.robot, o.source);
    }
    let engines: alloc::collections::BTreeSet<&str> = outcomes.iter().map(|o| o.engine.as_str()).collect();
    let _ = writeln!(out, "\nEngine: {}", engines.into_iter().collect::<Vec<_>>().join("; "));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(json: &str) -> Verdict {
        serde_json::from_str(json).unwrap()
    }

    fn emps() -> Real {
        known().unwrap().into_iter().find(|r| r.folder == "emps").unwrap()
    }

    #[test]
    fn names_aliases_strangers_and_forbidden_names_are_told_apart() {
        let v = verdict(
            r#"{"status":"ok","findings":[{"effect":"friction_coulomb","where":["slide"]},{"effect":"spring","where":["slide"],
            "cannot_tell_from":[{"effect":"torque_offset","where":["slide"]}]},{"effect":"joint_elasticity","where":["slide"]}],
            "heldout":{"rms_nominal":0.6,"rms_final":0.05,"band_hz":50}}"#,
        );
        let o = judge(&emps(), Some(&v), &Ran::default(), &[None, None]);
        let row = |name: &str| o.missing.iter().find(|m| m.0.starts_with(name)).map(|m| (m.1, m.2));
        assert_eq!(row("friction_coulomb"), Some((true, true)));
        assert_eq!(row("torque_offset"), Some((false, true)));
        assert_eq!(row("friction_viscous"), Some((false, false)));
        assert_eq!(
            (o.others.as_slice(), o.wrong.as_slice()),
            (&["joint_elasticity@slide".to_string()][..], &["joint_elasticity@slide".to_string()][..])
        );
        assert!(o.denied.is_none() && o.error == Some([0.6, 0.05]));
    }

    #[test]
    fn a_half_denies_what_it_does_not_say() {
        let a = verdict(r#"{"findings":[{"effect":"spring","where":["q1"]},{"effect":"friction_coulomb","where":["q1"]}]}"#);
        let b =
            verdict(r#"{"findings":[{"effect":"cable_force","where":["q1"],"cannot_tell_from":[{"effect":"spring","where":["q1"]}]}]}"#);
        // The spring is in the set of the cable, and the cable's set holds the spring: only the friction is denied.
        assert_eq!(denied(&[Some(a), Some(b)]), Some([1, 3]));
    }

    #[test]
    fn what_is_stripped_has_no_friction_and_no_effects() {
        let files = pkm_robots::find("serial_arm").unwrap();
        let with = format!("{}\n[[effect]]\nname = \"spring\"\nwhere = [\"j1\"]\nparameters = {{ stiffness = 1.0 }}\n", files.toml);
        let [toml, urdf] = stripped(&with, files.urdf).unwrap();
        // The trials' reader refuses a robot with effects.
        let robot = crate::robot::Robot::read(&toml, &urdf).unwrap();
        let before = crate::robot::Robot::read(files.toml, files.urdf).unwrap();
        assert!(before.joints.iter().any(|j| j.coulomb > 0.0) && robot.joints.iter().all(|j| j.coulomb.abs() + j.viscous.abs() <= 0.0));
        let masses = |r: &crate::robot::Robot| r.joints.iter().map(|j| j.inertia.mass).collect::<Vec<_>>();
        assert_eq!(masses(&robot), masses(&before));
    }

    #[test]
    fn halves_have_all_rows_between_them_and_one_header_each() {
        let [a, b] = halves("# load = 1\nt,q.d\n0,1\n1,2\n2,3\n");
        assert_eq!((a.as_str(), b.as_str()), ("# load = 1\nt,q.d\n0,1\n", "# load = 1\nt,q.d\n1,2\n2,3\n"));
    }

    #[test]
    fn the_list_is_of_effects_that_there_are() {
        for real in known().unwrap() {
            let names = real.missing.iter().flat_map(|m| &m.names).chain(&real.never);
            assert!(names.clone().count() > 1 && names.clone().all(|n| crate::menu::INSIDE.contains(&n.as_str())), "{}", real.folder);
        }
    }
}
