//! Physics between command, motor, load and sensor, concealed in a plant and found from recordings: shifts of positions, clipped and
//! swallowed efforts, wrong lengths, a soft mounting, commands that are not the controller's, people.
//!
//! As in `hidden_physics`: the diagnosing side gets the nominal robot and what a recorder wrote, nothing else.

extern crate alloc;

use alloc::collections::BTreeMap;

use pkm_diagnose::verdict::Status;
use pkm_diagnose::{ControllerTwin, Diagnosis, Settings, diagnose, diagnose_with_controller};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Data, math};
use pkm_ident::Recording;
use pkm_sim::Scenario;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

fn effect(nominal: &Description, name: &str, place: &str, numbers: &[(&str, f64)]) -> Applied {
    let stated: Vec<(String, f64)> = numbers.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
    Applied::try_new(&nominal.bare, name, place, &stated).expect("a valid effect")
}

/// Two motions of the truth: one to search on, one to judge on.
fn recordings(nominal: &Description, hidden: &[Applied], seed: u64) -> [Recording; 2] {
    let truth = Robot::new(nominal.bare.clone(), [nominal.robot.effects.clone(), hidden.to_vec()].concat());
    [10 * seed + 1, 10 * seed + 2].map(|seed| {
        let scenario = Scenario { seed, ..Scenario::default() };
        let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
        r.name = format!("motion{seed}");
        r
    })
}

fn judge(nominal: &Description, [train, holdout]: &[Recording; 2]) -> Diagnosis {
    let (train, holdout) = (core::slice::from_ref(train), core::slice::from_ref(holdout));
    diagnose(nominal, train, holdout, &Settings::default(), &mut |_| {}).expect("the recordings are usable")
}

/// One line of what was found, with everything it cannot be told from.
fn line(d: &Diagnosis) -> String {
    let finding = |f: &pkm_diagnose::verdict::Finding| {
        let numbers: Vec<String> = f.parameters.iter().map(|(n, e)| format!("{n}={:.4e}", e.value)).collect();
        let same: Vec<String> = f.cannot_tell_from.iter().map(|a| format!("{}@{}", a.effect, a.place.join(","))).collect();
        format!("{}@{} [{}] ~ {{{}}}", f.effect, f.place.join(","), numbers.join(" "), same.join(" "))
    };
    let found: Vec<String> = d.verdict.findings.iter().map(finding).collect();
    let out = |s: &pkm_diagnose::evidence::Screened| format!("{}@{}: {}", s.effect, s.place.join(","), s.why_not);
    let ruled_out: Vec<String> = d.evidence.ruled_out.iter().take(4).map(out).collect();
    let h = &d.verdict.heldout;
    format!("{} | as given {:.4}, refined {:.4} | not: {}", found.join("; "), h.rms_nominal, h.rms_final, ruled_out.join("; "))
}

/// Whether the effect is named at its place, or cannot be told from a finding.
fn is_found(d: &Diagnosis, effect: &str, place: &str) -> bool {
    let is = |name: &str, at: &[String]| name == effect && at.iter().any(|p| p == place);
    d.verdict.findings.iter().any(|f| is(&f.effect, &f.place) || f.cannot_tell_from.iter().any(|a| is(&a.effect, &a.place)))
}

/// Parameter of the finding that names the effect.
fn value(d: &Diagnosis, effect: &str, name: &str) -> f64 {
    let f = d.verdict.findings.iter().find(|f| f.effect == effect).unwrap_or_else(|| panic!("{effect} is not named: {}", line(d)));
    f.parameters[name].value
}

fn is_long() -> bool {
    std::env::var_os("PKM_LONG").is_some()
}

/// One case of the table: robot, effect, place, numbers, seed.
type Case = (&'static str, &'static str, &'static str, &'static [(&'static str, f64)], u64);

/// Sizes of about twice what the recordings can show, where a drawn size would be too small for this motion.
const SHORT: [Case; 3] = [
    ("prs3", "saturation", "q8", &[("limit", 132.75)], 2),
    ("serial_arm", "dead_zone", "j1", &[("width", 6.3)], 1),
    ("serial_arm", "encoder_eccentricity", "j1", &[("amplitude", 0.0135), ("order", 11.08), ("phase", 0.443)], 1),
];

/// The rest of the table, for the long tier.
const LONG: [Case; 2] = [
    ("prs3", "dead_zone", "q1", &[("width", 28.0)], 1),
    ("serial_arm", "geometry_error", "flange", &[("dx", -0.0092), ("dy", 0.0055), ("dz", -0.0169)], 1),
];

#[test]
fn what_lies_between_command_and_load_is_named_or_in_the_alias_set() {
    let mut lines = Vec::new();
    let mut missed = Vec::new();
    for (robot, name, place, numbers, seed) in SHORT.iter().chain(LONG.iter().filter(|_| is_long())) {
        let nominal = shipped(robot);
        let hidden = [effect(&nominal, name, place, numbers)];
        let d = judge(&nominal, &recordings(&nominal, &hidden, *seed));
        let text = format!("{robot} {name}@{place}: {}", line(&d));
        if !is_found(&d, name, place) {
            missed.push(text.clone());
        }
        lines.push(text);
    }
    pkm_tests::results_table("hidden_chain", &lines.join("\n"));
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

#[test]
fn a_limit_comes_out_at_its_size_and_the_refined_robot_has_it() {
    let nominal = shipped("prs3");
    let hidden = [effect(&nominal, "saturation", "q8", &[("limit", 132.75)])];
    let r = recordings(&nominal, &hidden, 2);
    let d = judge(&nominal, &r);
    // Limits are tried 5 % of the largest command apart.
    assert!((value(&d, "saturation", "limit") / 132.75 - 1.0).abs() < 0.06, "{}", line(&d));
    assert!(d.verdict.heldout.rms_final < 0.2 * d.verdict.heldout.rms_nominal, "{}", line(&d));
    let again = judge(&refined(&nominal, &d), &r);
    assert!(again.verdict.findings.iter().all(|f| f.effect != "saturation"), "{}", line(&again));
    runs(&refined(&nominal, &d));
}

/// The refined robot of a diagnosis, read back from its own files' text.
fn refined(nominal: &Description, d: &Diagnosis) -> Description {
    let [toml, urdf] = d.refined.as_ref().expect("a refined robot").texts(nominal, "refined.urdf").expect("it can be written");
    parse(&toml, &urdf, ["refined.toml", "refined.urdf"]).expect("it can be read")
}

/// The simulator moves it.
fn runs(robot: &Description) {
    let scenario = Scenario { duration_s: 0.5, ..Scenario::default() };
    let r = pkm_sim::run(&robot.robot, &robot.robot, &scenario, &mut |_| {}).expect("the refined robot runs");
    assert!(r.signals.values().flatten().all(|x| x.is_finite()));
}

/// The controller of the simulated recordings, replayed.
struct Pd<'r> {
    nominal: &'r Robot,
}

impl ControllerTwin for Pd<'_> {
    fn commands(&mut self, recording: &Recording) -> Result<Option<BTreeMap<String, Vec<f64>>>, String> {
        pkm_sim::replay_commands(None, self.nominal, recording).map(Some).map_err(|e| e.to_string())
    }
}

fn judge_with_controller(nominal: &Description, r: &[Recording; 2]) -> Diagnosis {
    let mut twin = Pd { nominal: &nominal.robot };
    diagnose_with_controller(nominal, (&r[..1], &r[1..]), &Settings::default(), Some(&mut twin), &mut |_| {}).expect("usable")
}

#[test]
fn a_command_that_is_not_the_controllers_is_named_before_any_physics() {
    let robots: &[(&str, &str)] = if is_long() { &[("serial_arm", "j2"), ("prs3", "q6")] } else { &[("prs3", "q6")] };
    for (robot, place) in robots {
        let nominal = shipped(robot);
        let hidden = [effect(&nominal, "controller_mismatch", place, &[("share", 0.15)])];
        let d = judge_with_controller(&nominal, &recordings(&nominal, &hidden, 1));
        let first = &d.verdict.findings[0];
        assert!(first.effect == "controller_mismatch" && first.place == [(*place).to_string()], "{}", line(&d));
        assert_eq!(d.verdict.findings.len(), 1, "{}", line(&d));
        assert!((first.parameters["share"].value - 0.15).abs() < 0.01, "{}", line(&d));
        assert!(first.heldout_rms_after < 0.7 * first.heldout_rms_before, "{}", line(&d));
        let better = refined(&nominal, &d);
        assert!(better.robot.effects.iter().any(|e| e.entry.name == "controller_mismatch"));
        runs(&better);
        // Physics of the plant leaves the controller's command alone.
        let friction = [effect(&nominal, "friction_viscous", place, &[("viscous", 60.0)])];
        let d = judge_with_controller(&nominal, &recordings(&nominal, &friction, 1));
        assert!(!is_found(&d, "controller_mismatch", place), "{}", line(&d));
    }
}

#[test]
fn a_person_who_pushes_is_what_does_not_repeat() {
    let robots: &[(&str, &str, f64)] =
        if is_long() { &[("prs3", "platform", 25.0), ("serial_arm", "flange", 8.0)] } else { &[("prs3", "platform", 25.0)] };
    for (robot, place, rms) in robots {
        let nominal = shipped(robot);
        let hidden = [effect(&nominal, "active_limb", place, &[("rms", *rms)])];
        let d = judge(&nominal, &recordings(&nominal, &hidden, 1));
        assert_eq!(d.verdict.status, Status::NotRepeatable, "{}", d.verdict.says);
        assert!(is_found(&d, "active_limb", place), "{}", line(&d));
        // Of one component after a filter that cuts at the band: the order of magnitude.
        let found = value(&d, "active_limb", "rms");
        assert!((0.5..1.5).contains(&(found / rms)), "{found} N instead of {rms} N");
        runs(&refined(&nominal, &d));
    }
}

/// Adds to every drive's effort a slow noise of its own, `share` of its rms: amplifiers and friction that are never twice the same.
fn with_drives_that_scatter(mut r: Recording, share: f64, seed: u64) -> Recording {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // First order, a memory of a tenth of a second; uniform steps of variance one.
    let kept = math::exp(-(r.time[1] - r.time[0]) / 0.1);
    for tau in r.signals.iter_mut().filter(|(name, _)| name.starts_with("tau.")).map(|(_, tau)| tau) {
        let rms = math::sqrt(tau.iter().map(|x| x * x).sum::<f64>() / tau.len() as f64);
        let mut x = 0.0;
        for tau in tau.iter_mut() {
            x = kept * x + math::sqrt(1.0 - kept * kept) * math::sqrt(12.0) * (rng.random::<f64>() - 0.5);
            *tau += share * rms * x;
        }
    }
    r
}

#[test]
fn a_hand_too_light_to_stand_out_is_found_by_what_the_drives_have_in_common() {
    let nominal = shipped("prs3");
    let d = judge(&nominal, &recordings(&nominal, &[effect(&nominal, "active_limb", "platform", &[("rms", 8.0)])], 1));
    assert!(is_found(&d, "active_limb", "platform"), "{}", line(&d));
    assert!(d.verdict.findings[0].says.contains("The drives differ together"), "{}", d.verdict.says);
    // As much from each drive on its own is no hand, nor anything else.
    let alone = recordings(&nominal, &[], 1).map(|r| with_drives_that_scatter(r, 0.012, 5));
    let d = judge(&nominal, &alone);
    assert!(d.verdict.findings.is_empty() && d.verdict.status != Status::NotRepeatable, "{}", line(&d));
}

/// Adds what encoders on the passive joints would read with the true model at the recorded positions of the drives.
fn with_passive_encoders(truth: &Robot, mut r: Recording) -> Recording {
    let model = &truth.model;
    let mut data = Data::new(model);
    let name = |j: usize| format!("q.{}", model.joints[j].name);
    let at = |r: &Recording, i: usize| model.actuators.iter().map(|&j| r.signals[&name(j)][i]).collect::<Vec<f64>>();
    assert!(assemble(model, &mut data).is_closed && walk_to(model, &mut data, &at(&r, 0)).is_closed);
    let zero = vec![0.0; model.n_act()];
    let mut columns = vec![Vec::new(); model.nv()];
    for i in 0..r.len() {
        assert!(closed_loop_motion(model, &mut data, &at(&r, i), &zero, &zero).is_closed);
        columns.iter_mut().zip(&data.q).for_each(|(c, q)| c.push(*q));
    }
    for j in model.passive() {
        r.signals.insert(name(j), core::mem::take(&mut columns[j]));
    }
    r
}

#[test]
fn a_wrong_length_shows_in_passive_encoders_without_any_effort() {
    let nominal = shipped("prs3");
    // A tenth of what efforts alone could show.
    let hidden = [effect(&nominal, "geometry_error", "coupler3", &[("dx", -0.002), ("dy", 0.001), ("dz", -0.003)])];
    let truth = Robot::new(nominal.bare.clone(), hidden.to_vec());
    let r = recordings(&nominal, &hidden, 1).map(|r| with_passive_encoders(&truth, r));
    let d = judge(&nominal, &r);
    assert!(is_found(&d, "geometry_error", "coupler3"), "{}", line(&d));
    let better = refined(&nominal, &d);
    assert!(better.robot.effects.iter().any(|e| e.entry.name == "geometry_error"), "{}", line(&d));
    runs(&better);
}

#[test]
fn a_second_encoder_on_the_load_shows_what_gives_way() {
    let nominal = shipped("serial_arm");
    let r = recordings(&nominal, &[], 4).map(|mut r| {
        // A transmission of 100 kN·m/rad: the load stays behind by the effort over it, too little for efforts to show.
        let behind: Vec<f64> = pkm_diagnose::predict(&nominal, &r).expect("it fits")["j2"].iter().map(|t| t / 1e5).collect();
        let link = r.signals["q.j2"].iter().zip(behind).map(|(q, e)| q - e).collect();
        r.signals.insert("q_link.j2".to_string(), link);
        r
    });
    let d = judge(&nominal, &r);
    assert!(is_found(&d, "joint_elasticity", "j2"), "{}", line(&d));
    // Its size is a compromise here: the plant that made the efforts is rigid, and efforts are rows of the same fit.
    assert!(value(&d, "joint_elasticity", "stiffness") > 0.0);
}

/// A recording in which one column is changed.
fn changed(r: &[Recording; 2], column: &str, change: impl Fn(usize, f64) -> f64) -> [Recording; 2] {
    let mut out = r.clone();
    let signal = out[0].signals.get_mut(column).expect("the column");
    signal.iter_mut().enumerate().for_each(|(i, x)| *x = change(i, *x));
    out
}

#[test]
fn recordings_that_cannot_be_used_say_why_with_numbers() {
    let nominal = shipped("prs3");
    let r = recordings(&nominal, &[], 1);
    let jump = changed(&r, "q.q6", |i, x| if i > 5000 { x + 0.02 } else { x });
    let millimetres = ["q.q1", "q.q6", "q.q8"].into_iter().fold(r.clone(), |r, c| {
        let mut both = changed(&r, c, |_, x| 1e3 * x);
        both[1] = r[1].clone();
        both
    });
    let late: Vec<f64> = r[0].signals["tau.q8"].clone();
    let shifted = changed(&r, "tau.q8", |i, _| late[i.saturating_sub(450)]);
    let mut back = r.clone();
    back[0].time[300] = back[0].time[299];
    let frozen = changed(&r, "q.q1", |_, _| 0.2);
    for (what, r, say) in [
        ("lost counts", &jump, "q.q6 jumps by 0.02"),
        ("millimetres", &millimetres, "millimetres"),
        ("another clock", &shifted, "tau.q8 fits its motion 0.9"),
        ("time", &back, "time does not increase at sample 300"),
        ("a dead sensor", &frozen, "q.q1 never changes"),
    ] {
        let v = judge(&nominal, r).verdict;
        assert_eq!(v.status, Status::Unusable, "{what}: {}", v.says);
        assert!(v.says.starts_with("recording unusable: ") && v.says.contains(say), "{what}: {}", v.says);
        assert!(v.findings.is_empty());
    }
}
