//! One verdict against one answer.

use serde::{Deserialize, Serialize};

use super::reason::reasons;
use super::verdict::{Finding, Verdict};
use crate::bench::MEASURED;
use crate::case::{Answer, Concealed, Level};
use crate::math::{exp, ln};
use crate::residual::BAND;

/// How a diagnosis ran, whatever it said.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Ran {
    /// Wall-clock time `[s]`.
    pub seconds: f64,
    /// Exit status; none when it was stopped.
    pub exit: Option<i32>,
    /// First line of its errors.
    #[serde(default)]
    pub error: String,
    /// Version of the program that ran, and the SHA-256 of its file.
    #[serde(default)]
    pub engine: String,
    /// SHA-256 of the verdict; none where there is none.
    #[serde(default)]
    pub verdict: Option<String>,
}

/// What an effect asks of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Asked {
    /// Name of the effect.
    pub effect: String,
    /// Size over the smallest that can be detected.
    pub size: f64,
    /// Share of the effort that the effect makes.
    pub effort: f64,
    /// Share of the effect that no refit takes.
    pub beside: f64,
}

/// What came of one case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Marks {
    /// Name of the case.
    pub case: String,
    /// Level.
    pub level: Level,
    /// Robot.
    pub robot: String,
    /// What was concealed, as `effect@place`.
    pub concealed: Vec<String>,
    /// Smallest size among the effects, over the smallest that can be detected.
    pub size: Option<f64>,
    /// How much of the effort each effect makes, where that was measured.
    pub asked: Vec<Asked>,
    /// Share of the holdout's effort that the healthy robot's own model leaves below 10 Hz.
    pub floor: Option<f64>,
    /// Factor on the noise of the sensors.
    pub noise: f64,
    /// Recordings to learn from.
    pub recordings: usize,
    /// What was said, as `effect@place`, in order; `unexplained` and a status that is not ok at the end.
    pub said: Vec<String>,
    /// Why it failed, in the verdict's own words: per effect that is missing or not first, or per name that should not be there.
    pub reasons: Vec<String>,
    /// The diagnosis ended with a verdict.
    pub ran: bool,
    /// Anything was said.
    pub is_detected: bool,
    /// The first finding is an effect that is there, where it is.
    pub is_first_right: bool,
    /// The first finding or one it cannot be told from is.
    pub is_in_set: bool,
    /// Size of that set, of the first finding.
    pub set: Option<usize>,
    /// The first finding is at the right place.
    pub is_place_right: bool,
    /// The first finding, if it has the right name, names a regime in which the effect acts.
    pub is_regime_right: Option<bool>,
    /// How many of the effects are among the findings.
    pub found: usize,
    /// Something said of a robot with nothing missing.
    pub is_alarm: bool,
    /// Something outside the catalogue was said to be unexplained.
    pub is_flagged: bool,
    /// Something outside the catalogue was given a name.
    pub is_impostor: bool,
    /// Estimate over truth, minus one, in the change from the nominal robot, per parameter.
    pub size_errors: Vec<(String, f64)>,
    /// Whether stated intervals hold the truth.
    pub covered: Vec<bool>,
    /// Explained squared error on the holdout over what the true structure would explain.
    pub explained: Option<f64>,
    /// Stated confidence of every finding and whether it is right.
    pub stated: Vec<(f64, bool)>,
    /// Time `[s]`.
    pub seconds: f64,
    /// Version of the program that diagnosed, and the SHA-256 of its file.
    pub engine: String,
}

pub(super) fn meets(a: &[String], b: &[String]) -> bool {
    a.iter().any(|x| b.contains(x))
}

pub(super) fn is_it(effect: &str, place: &[String], truth: &Concealed) -> bool {
    effect == truth.effect && meets(place, &truth.place)
}

/// When an effect acts: a finding that names any of these is right about it.
fn regimes(effect: &str) -> &'static [&'static str] {
    match effect {
        "friction_coulomb" | "friction_asymmetric" | "friction_position" | "friction_passive" => {
            &["moving", "low_speed", "reversal", "all"]
        }
        "friction_stribeck" => &["low_speed", "reversal", "standstill"],
        "friction_presliding" | "backlash" => &["reversal", "standstill", "low_speed"],
        "friction_viscous" | "friction_quadratic" => &["moving", "high_speed", "all"],
        "friction_load" | "directional_efficiency" => &["moving", "high_load", "all"],
        "friction_thermal" => &["early", "late", "moving", "high_speed"],
        "saturation" => &["high_load"],
        "dead_zone" => &["all", "moving", "reversal", "low_speed"],
        "joint_elasticity" | "actuator_lag" | "time_delay" | "structure_flexibility" => &["high_band", "moving", "all", "high_speed"],
        "sensor_drift" | "external_force" => &["early", "late", "all", "moving"],
        _ => &["all", "moving", "high_speed", "high_load"],
    }
}

/// A finding that is true although nothing that lasts is missing: what a patient does on their own account.
fn is_patient(f: &Finding, answer: &Answer) -> bool {
    answer.has_patient && ["active_limb", "external_force"].contains(&f.effect.as_str())
}

/// Judges a verdict; none where the diagnosis ended without one.
#[must_use]
pub fn judge(case: &str, answer: &Answer, verdict: Option<&Verdict>, ran: &Ran) -> Marks {
    let empty = Verdict::default();
    let v = verdict.unwrap_or(&empty);
    let truths = &answer.concealed;
    let is_outside = answer.level == Level::L5;
    // A person who moves is named by the status of the verdict as well.
    let says_restless = v.status == "not_repeatable" && truths.iter().any(|t| t.effect == "active_limb");
    let is_right = |f: &Finding| truths.iter().any(|t| is_it(&f.effect, &f.place, t));
    let first = v.findings.first();
    let is_first_right = first.is_some_and(is_right) || (first.is_none() && says_restless);
    let others = |f: &Finding| f.cannot_tell_from.iter().any(|o| truths.iter().any(|t| is_it(&o.effect, &o.place, t)));
    let named: Vec<(&Concealed, &Finding)> =
        truths.iter().filter_map(|t| v.findings.iter().find(|f| is_it(&f.effect, &f.place, t)).map(|f| (t, f))).collect();
    let is_regime_right = first.filter(|f| is_right(f)).map(|f| f.regime.iter().any(|r| regimes(&f.effect).contains(&r.as_str())));
    let is_healthy = answer.level.is_healthy();
    let alarms = v.findings.iter().any(|f| !is_patient(f, answer));
    Marks {
        case: case.to_string(),
        level: answer.level,
        robot: answer.robot.clone(),
        concealed: truths.iter().map(|t| format!("{}@{}", t.effect, t.place.join("+"))).collect(),
        size: truths.iter().filter_map(|t| t.size).min_by(f64::total_cmp),
        asked: truths.iter().filter_map(asked).collect(),
        floor: floor_below(&answer.floor, BAND),
        noise: answer.noise_factor.unwrap_or(1.0),
        recordings: answer.recordings.unwrap_or(MEASURED),
        said: said(v),
        reasons: reasons(answer, verdict),
        ran: verdict.is_some(),
        is_detected: !v.findings.is_empty() || v.unexplained.present || says_restless,
        is_first_right,
        is_in_set: is_first_right || first.is_some_and(others),
        set: first.map(|f| 1 + f.cannot_tell_from.len()),
        is_place_right: first.is_some_and(|f| truths.iter().any(|t| meets(&f.place, &t.place))),
        is_regime_right,
        found: named.len() + usize::from(named.is_empty() && says_restless),
        is_alarm: is_healthy && (alarms || (v.unexplained.present && !answer.has_patient)),
        is_flagged: is_outside && v.unexplained.present,
        is_impostor: is_outside && !v.findings.is_empty(),
        size_errors: named.iter().flat_map(|(t, f)| size_errors(t, f)).collect(),
        covered: named.iter().flat_map(|(t, f)| covered(t, f)).collect(),
        explained: explained(answer, v),
        stated: v.findings.iter().map(|f| (f.confidence, is_right(f) || others(f) || is_patient(f, answer))).collect(),
        seconds: ran.seconds,
        engine: ran.engine.clone(),
    }
}

fn asked(truth: &Concealed) -> Option<Asked> {
    let (size, effort, beside) = (truth.size?, truth.effort_share?, truth.beside_refit?);
    Some(Asked { effect: truth.effect.clone(), size, effort, beside })
}

fn said(v: &Verdict) -> Vec<String> {
    let mut out: Vec<String> = v.findings.iter().map(|f| format!("{}@{}", f.effect, f.place.join("+"))).collect();
    if v.unexplained.present {
        out.push("unexplained".to_string());
    }
    if !v.status.is_empty() && v.status != "ok" {
        out.push(v.status.clone());
    }
    out
}

/// Errors of the change from the nominal robot: an estimate of 26 N is no success when 26 N was in the file already.
fn size_errors(truth: &Concealed, f: &Finding) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    for p in &truth.parameters {
        let change = p.value - p.from;
        if let Some(e) = f.parameters.get(&p.name).filter(|_| change.abs() > 0.0) {
            // Signs of directions are a matter of convention where nothing is there to begin with.
            let guess = if p.from.abs() > 0.0 { e.value - p.from } else { e.value.abs() * change.signum() };
            out.push((p.name.clone(), guess / change - 1.0));
        }
    }
    out
}

fn covered(truth: &Concealed, f: &Finding) -> Vec<bool> {
    let mut out = Vec::new();
    for p in &truth.parameters {
        if let Some([low, high]) = f.parameters.get(&p.name).and_then(|e| e.ci95) {
            let holds = |x: f64| low <= x && x <= high;
            out.push(holds(p.value) || (p.from.abs() <= 0.0 && holds(-p.value)));
        }
    }
    out
}

/// (Nominal − final)/(nominal − floor) of squared held-out errors; none where the floor is most of it, or nobody pushes in the holdout.
fn explained(answer: &Answer, v: &Verdict) -> Option<f64> {
    if v.status != "ok"
        || answer.level.is_healthy()
        || answer.concealed.iter().any(|t| t.effect == "external_force" || t.effect == "active_limb")
    {
        return None;
    }
    let floor = floor_below(&answer.floor, v.heldout.band_hz)?;
    let square = |x: f64| x * x;
    let missing = square(v.heldout.rms_nominal) - square(floor);
    let gained = square(v.heldout.rms_nominal) - square(v.heldout.rms_final);
    (missing > 0.25 * square(floor)).then(|| gained / missing)
}

/// Share left below `band` with nothing concealed, along straight lines between logarithms, level outside the table.
fn floor_below(table: &[[f64; 2]], band: f64) -> Option<f64> {
    let (first, last) = (table.first()?, table.last()?);
    if band <= first[0] {
        return Some(first[1]);
    }
    if band >= last[0] {
        return Some(last[1]);
    }
    let pair = table.windows(2).find(|w| w[0][0] <= band && band <= w[1][0])?;
    let share = ln(band / pair[0][0]) / ln(pair[1][0] / pair[0][0]);
    Some(exp(ln(pair[0][1].max(1e-12)) * (1.0 - share) + ln(pair[1][1].max(1e-12)) * share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::menu::Parameter;

    fn answer(level: Level, effect: &str, place: &str) -> Answer {
        let parameters = vec![Parameter { name: "coulomb".to_string(), value: 30.0, from: 26.0 }];
        let concealed = Concealed {
            effect: effect.to_string(),
            place: vec![place.to_string()],
            form: String::new(),
            is_textbook: false,
            size: Some(2.0),
            beside_refit: Some(0.5),
            effort_share: None,
            parameters,
        };
        let concealed = if effect.is_empty() { Vec::new() } else { vec![concealed] };
        let floor = vec![[3.0, 0.01], [12.0, 0.02]];
        Answer {
            schema: String::new(),
            salt: String::new(),
            level,
            robot: "prs3".to_string(),
            concealed,
            has_patient: false,
            noise_factor: None,
            recordings: None,
            floor,
        }
    }

    fn verdict(json: &str) -> Verdict {
        serde_json::from_str(json).unwrap()
    }

    const RIGHT: &str = r#"{"status":"ok","findings":[{"effect":"friction_coulomb","where":["q1"],"regime":["low_speed"],"confidence":0.9,
        "parameters":{"coulomb":{"value":31.0,"ci95":[29.5,32.5],"unit":"N"}},"cannot_tell_from":[]}],
        "unexplained":{"present":false},"heldout":{"rms_nominal":0.1,"rms_final":0.02,"band_hz":6.0}}"#;

    #[test]
    fn a_right_verdict_gets_full_marks() {
        let m = judge("1", &answer(Level::L1, "friction_coulomb", "q1"), Some(&verdict(RIGHT)), &Ran::default());
        assert!(m.is_first_right && m.is_in_set && m.is_place_right && m.is_detected && m.is_regime_right == Some(true));
        assert_eq!((m.found, m.set, m.covered.as_slice(), m.stated.as_slice()), (1, Some(1), &[true][..], &[(0.9, true)][..]));
        // 31 instead of 30 where 26 was known: a change of 5 instead of 4.
        assert!((m.size_errors[0].1 - 0.25).abs() < 1e-12);
        // The floor at 6 Hz, half-way between 3 and 12 Hz in logarithms: √(0.01·0.02).
        let floor = 0.01 * 0.02;
        assert!((m.explained.unwrap() - (0.01 - 0.0004) / (0.01 - floor)).abs() < 1e-12);
    }

    #[test]
    fn a_right_name_at_the_wrong_joint_is_wrong() {
        let m = judge("1", &answer(Level::L1, "friction_coulomb", "q6"), Some(&verdict(RIGHT)), &Ran::default());
        assert!(!m.is_first_right && !m.is_in_set && !m.is_place_right && m.is_detected && m.found == 0 && m.stated == [(0.9, false)]);
    }

    #[test]
    fn an_alias_counts_as_in_the_set_only() {
        let json = r#"{"status":"ok","findings":[{"effect":"spring","where":["q1"],"confidence":0.5,
            "cannot_tell_from":[{"effect":"friction_coulomb","where":["q1"]},{"effect":"cable_force","where":["q1"]}]}]}"#;
        let m = judge("1", &answer(Level::L1, "friction_coulomb", "q1"), Some(&verdict(json)), &Ran::default());
        assert!(!m.is_first_right && m.is_in_set && m.set == Some(3) && m.stated == [(0.5, true)]);
    }

    #[test]
    fn healthy_robots_alarm_by_findings_and_by_what_is_unexplained() {
        let quiet = verdict(r#"{"status":"ok","findings":[],"unexplained":{"present":false}}"#);
        let flagged = verdict(r#"{"status":"ok","findings":[],"unexplained":{"present":true}}"#);
        let healthy = answer(Level::L6, "", "");
        let alarm = |v: &Verdict| judge("1", &healthy, Some(v), &Ran::default()).is_alarm;
        assert!(!alarm(&quiet) && alarm(&flagged) && alarm(&verdict(RIGHT)));
        let patient = Answer { has_patient: true, ..healthy.clone() };
        let named = verdict(r#"{"status":"ok","findings":[{"effect":"active_limb","where":["platform"]}]}"#);
        assert!(!judge("1", &patient, Some(&named), &Ran::default()).is_alarm && alarm(&named));
    }

    #[test]
    fn what_is_outside_is_flagged_or_given_a_false_name() {
        let outside = answer(Level::L5, "outside_creep", "q1");
        let flagged = verdict(r#"{"status":"ok","findings":[],"unexplained":{"present":true}}"#);
        let m = judge("1", &outside, Some(&flagged), &Ran::default());
        assert!(m.is_flagged && !m.is_impostor);
        let m = judge("1", &outside, Some(&verdict(RIGHT)), &Ran::default());
        assert!(!m.is_flagged && m.is_impostor && !m.is_first_right && m.is_place_right);
    }

    #[test]
    fn a_diagnosis_that_failed_is_a_miss_and_no_alarm() {
        let m = judge("1", &answer(Level::L1, "friction_coulomb", "q1"), None, &Ran { exit: Some(70), ..Ran::default() });
        assert!(!m.ran && !m.is_detected && !m.is_first_right && m.explained.is_none());
    }

    #[test]
    fn a_restless_patient_may_be_named_by_the_status() {
        let restless = verdict(r#"{"status":"not_repeatable","findings":[]}"#);
        let m = judge("1", &answer(Level::L1, "active_limb", "platform"), Some(&restless), &Ran::default());
        assert!(m.is_first_right && m.is_detected && m.found == 1);
        assert!(!judge("1", &answer(Level::L1, "payload", "platform"), Some(&restless), &Ran::default()).is_first_right);
    }
}
