//! What a verdict must not do: mix up joints and links, call too little data healthy, take interpolated gaps for quiet sensors, let held-out
//! motions shape what is tried, or trust one motion that was recorded twice.

use core::f64::consts::TAU;

use pkm_diagnose::verdict::{Finding, Status, Verdict};
use pkm_diagnose::{Diagnosis, Settings, diagnose};
use pkm_dyn::math;
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::Recording;
use pkm_tests::Draw;

const STEP_S: f64 = 2e-3;
const DRY: f64 = 8.0;

/// Slides, each with a carriage of 10 kg and dry friction: name, and what it rides on.
fn slides(all: &[(&str, &str)]) -> Description {
    let mut toml = "name = \"slides\"\nurdf = \"slides.urdf\"\n".to_string();
    let mut urdf = "<robot name=\"slides\"><link name=\"base\"/>".to_string();
    for (name, _) in all {
        urdf += &format!(
            r#"<link name="c{name}"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="10"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1"
            iyz="0" izz="0.1"/></inertial></link>"#
        );
    }
    for (name, parent) in all {
        toml += &format!("\n[[actuator]]\njoint = \"{name}\"\nrotor_inertia = 0.0\n");
        let axis = if *name == "y" { "0 1 0" } else { "1 0 0" };
        urdf += &format!(
            r#"<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="c{name}"/><origin xyz="0 0 0" rpy="0 0 0"/>
            <axis xyz="{axis}"/><limit lower="-5" upper="5" effort="1000" velocity="10"/><dynamics damping="5" friction="{DRY}"/></joint>"#
        );
    }
    parse(&toml, &(urdf + "</robot>"), ["slides.toml", "slides.urdf"]).expect("a readable robot")
}

/// A slide's position, velocity and acceleration.
type Wave = Vec<(f64, f64, f64)>;

fn wave(waves: &[(f64, f64)], phase: f64, n: usize) -> Wave {
    let at = |t: f64| {
        waves.iter().fold((0.0, 0.0, 0.0), |s, (a, f)| {
            let (w, u) = (TAU * f, TAU * f * t + phase);
            (s.0 + a * math::sin(u), s.1 + a * w * math::cos(u), s.2 - a * w * w * math::sin(u))
        })
    };
    (0..n).map(|i| at(STEP_S * i as f64)).collect()
}

fn recording(name: &str, joints: &[(&str, &Wave, Vec<f64>)], noise: f64, seed: u64) -> Recording {
    let mut draw = Draw::new(seed);
    let n = joints[0].1.len();
    let mut out = Recording { name: name.to_string(), time: (0..n).map(|i| STEP_S * i as f64).collect(), ..Recording::default() };
    for (joint, wave, tau) in joints {
        let noisy = tau.iter().map(|t| t + noise * ((0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0)).collect();
        out.signals.insert(format!("q.{joint}"), wave.iter().map(|w| w.0).collect());
        out.signals.insert(format!("tau.{joint}"), noisy);
    }
    out
}

/// Effort of a slide that moves `mass`.
fn effort(wave: &Wave, mass: f64) -> Vec<f64> {
    wave.iter().map(|(_, v, a)| mass * a + 5.0 * v + DRY * v.signum()).collect()
}

const WAVES: [(f64, f64); 2] = [(0.2, 0.4), (0.06, 1.1)];

fn run(robot: &Description, train: &[Recording], holdout: &[Recording], band_hz: Option<f64>) -> Diagnosis {
    let settings = Settings { band_hz, ..Settings::default() };
    diagnose(robot, train, holdout, &settings, &mut |_| {}).expect("recordings that can be read")
}

#[test]
fn a_wrong_scale_at_a_joint_leaves_a_link_of_the_same_number_alone() {
    // Joint "w" and link "cy" both are number 2 of their kind.
    let robot = slides(&[("x", "base"), ("y", "cx"), ("w", "base")]);
    let record = |seed: u64, waves: [&[(f64, f64)]; 3]| {
        let [x, y, w] = [0, 1, 2].map(|k: usize| wave(waves[k], 0.7 * k as f64 + seed as f64, 6000));
        // The carriage on top weighs 15 kg instead of 10; the third drive records a quarter too much.
        let tau = [effort(&x, 25.0), effort(&y, 15.0), effort(&w, 10.0).iter().map(|t| 1.25 * t).collect()];
        let [a, b, c] = tau;
        recording(&format!("run{seed}"), &[("x", &x, a), ("y", &y, b), ("w", &w, c)], 1.0, seed)
    };
    let train = record(1, [&WAVES, &[(0.15, 0.5), (0.05, 1.3)], &[(0.18, 0.3), (0.05, 0.9)]]);
    let other = record(2, [&[(0.18, 0.5), (0.04, 1.2)], &[(0.2, 0.35), (0.05, 1.1)], &[(0.15, 0.45), (0.06, 1.0)]]);
    let d = run(&robot, &[train], &[other], None);
    let found = |place: &str| {
        d.verdict.findings.iter().find(|f| f.place == [place.to_string()]).unwrap_or_else(|| panic!("{place}: {}", d.verdict.says))
    };
    let scale = found("w");
    assert_eq!(scale.effect, "torque_constant");
    assert!((scale.parameters["scale"].value - 0.8).abs() < 0.01, "{:?}", scale.parameters);
    let link = found("cy");
    let mass = link.parameters["mass"].value + if link.effect == "payload" { 10.0 } else { 0.0 };
    assert!((mass - 15.0).abs() < 0.15, "{}: {mass} kg instead of 15", link.effect);
    let refined = d.refined.expect("a refined robot").model;
    let there = refined.links[refined.link_index("cy").expect("a link")].parameters.mass;
    assert!(link.effect == "payload" || (there - 15.0).abs() < 0.15, "{there} kg in the refined robot");
}

#[test]
fn a_band_that_leaves_no_row_is_unusable_and_not_healthy() {
    let robot = slides(&[("x", "base")]);
    let x = wave(&WAVES, 0.0, 2000);
    let r = recording("short", &[("x", &x, effort(&x, 30.0))], 1.0, 3);
    let v = run(&robot, &[r], &[], Some(0.2)).verdict;
    assert_eq!(v.status, Status::Unusable, "{}", v.says);
    assert!(!v.nothing_missing && v.says.contains("0.200 Hz leaves") && v.findings.is_empty(), "{}", v.says);
}

#[test]
fn the_noise_floor_is_the_same_with_a_gap() {
    let robot = slides(&[("x", "base")]);
    let x = wave(&WAVES, 0.0, 10_000);
    let train = recording("train", &[("x", &x, effort(&x, 10.0))], 3.0, 4);
    let y = wave(&[(0.15, 0.5), (0.07, 0.9)], 0.4, 10_000);
    let whole = recording("whole", &[("x", &y, effort(&y, 10.0))], 3.0, 5);
    let mut gappy = whole.clone();
    gappy.signals.get_mut("tau.x").expect("an effort")[3000..7000].fill(f64::NAN);
    let floor = |holdout: Recording| run(&robot, core::slice::from_ref(&train), &[holdout], None).verdict.heldout.noise_floor;
    let (a, b) = (floor(whole), floor(gappy));
    assert!((b / a - 1.0).abs() < 0.06, "{b} with a gap, {a} without");
}

#[test]
fn held_out_motions_do_not_shape_what_is_tried() {
    let robot = slides(&[("x", "base")]);
    let peaked = |w: &Wave| -> Vec<f64> {
        let bump = |v: f64| 12.0 * v.signum() * math::exp(-(v / 0.06) * (v / 0.06));
        effort(w, 10.0).iter().zip(w).map(|(t, (_, v, _))| t + bump(*v)).collect()
    };
    let x = wave(&[(0.2, 0.4)], 0.0, 15_000);
    let train = recording("train", &[("x", &x, peaked(&x))], 0.5, 6);
    let y = wave(&[(1.0, 0.4)], 0.4, 10_000);
    let wide = recording("wide", &[("x", &y, peaked(&y))], 0.5, 7);
    let v = run(&robot, &[train], &[wide], Some(8.0)).verdict;
    let f = v.findings.iter().find(|f| f.effect == "friction_stribeck").unwrap_or_else(|| panic!("{}", v.says));
    let top = 0.2 * TAU * 0.4;
    let share = f.parameters["stribeck_velocity"].value / top;
    assert!([0.02, 0.04, 0.08, 0.15, 0.25, 0.4].iter().any(|s| (share / s - 1.0).abs() < 0.02), "{share} of the fitted motion's top speed");
}

/// The chance that a finding, or one of those it cannot be told from, is there.
fn chance(f: &Finding) -> f64 {
    f.confidence * (1 + f.cannot_tell_from.len()) as f64
}

/// A mass that is wrong, seen in two recordings.
fn wrong_mass(second: &Wave) -> Verdict {
    let robot = slides(&[("x", "base")]);
    let x = wave(&WAVES, 0.0, 10_000);
    let files = [("one", &x, 8), ("two", second, 9)].map(|(name, w, seed)| recording(name, &[("x", w, effort(w, 14.0))], 1.0, seed));
    run(&robot, &files[..1], &files[1..], None).verdict
}

#[test]
fn one_motion_recorded_twice_does_not_confirm() {
    let again = wave(&WAVES, 0.0, 10_000);
    let v = wrong_mass(&again);
    assert!(
        !v.findings.is_empty() && v.findings.iter().all(|f| chance(f) < 0.8),
        "{:?}",
        v.findings.iter().map(chance).collect::<Vec<_>>()
    );
    assert!(v.notes.iter().any(|n| n.contains("repeat one motion")), "{:?}", v.notes);
    let v = wrong_mass(&wave(&[(0.1, 0.7), (0.1, 0.3)], 0.5, 10_000));
    assert!(v.findings.iter().any(|f| chance(f) > 0.8), "{:?}", v.findings.iter().map(chance).collect::<Vec<_>>());
    assert!(!v.notes.iter().any(|n| n.contains("repeat one motion")));
}

#[test]
fn an_alias_comes_with_an_experiment_whose_angle_holds_when_it_is_done() {
    // On one slide without friction to scale, a wrong mass is a wrong scale; a known mass added tells them apart.
    let robot = slides(&[("x", "base")]);
    let x = wave(&WAVES, 0.0, 10_000);
    let train = recording("one", &[("x", &x, effort(&x, 14.0))], 1.0, 8);
    let w = wave(&[(0.1, 0.7), (0.1, 0.3)], 0.5, 10_000);
    let other = recording("two", &[("x", &w, effort(&w, 14.0))], 1.0, 9);
    let v = run(&robot, &[train], &[other], None).verdict;
    let f = v.findings.first().unwrap_or_else(|| panic!("{}", v.says));
    assert!(!f.cannot_tell_from.is_empty(), "{}", f.says);
    for a in &f.cannot_tell_from {
        assert!(!a.separating_experiment.is_empty(), "{a:?}");
    }
    for e in &f.experiments {
        assert!((0.0..=1.0).contains(&e.cos_expected) && e.cos_expected <= e.cos_now + 1e-9, "{e:?}");
    }
    let gains = f.depends_on_prior.expect("gains under three beliefs");
    // Freely refitted inertias take the place of any change of the moving mass.
    assert!(gains.anchored > 0.3 && gains.refit < 0.01 && gains.depends, "{gains:?}");
    assert!(f.says.contains("It rests on the inertias of the model"), "{}", f.says);
}

/// A slide whose friction follows its speed, under efforts that act `late` seconds after they are recorded.
fn with_reversals(late: f64) -> Verdict {
    let record = |seed: u64, waves: &[(f64, f64)]| {
        let n = 8000;
        let motion = wave(waves, 0.4 * seed as f64, n);
        // Direction turns over at 4 mm/s, 0.7 % of the top speed.
        let acts: Vec<f64> = motion.iter().map(|(_, v, a)| 10.0 * a + 5.0 * v + DRY * math::tanh(v / 4e-3)).collect();
        let recorded = pkm_ident::filter::advanced(&acts, late, STEP_S);
        recording(&format!("r{seed}"), &[("x", &motion, recorded)], 0.2, seed)
    };
    let train = [record(1, &WAVES), record(2, &[(0.15, 0.5), (0.05, 1.3)])];
    let holdout = [record(3, &[(0.18, 0.45), (0.06, 1.2)])];
    run(&slides(&[("x", "base")]), &train, &holdout, None).verdict
}

#[test]
fn a_short_delay_is_found_at_the_reversals_of_a_drive_whose_friction_follows_its_speed() {
    const LATE: f64 = 1e-3;
    let verdict = with_reversals(LATE);
    let found = verdict.findings.iter().find(|f| f.effect == "time_delay").unwrap_or_else(|| panic!("{}", verdict.says));
    let delay = found.parameters["delay"].value;
    assert!((delay / LATE - 1.0).abs() < 0.2, "{delay}");
    let healthy = with_reversals(0.0);
    assert!(healthy.nothing_missing, "{}", healthy.says);
}

/// A slide whose way is worn in places: `worn` N of further friction there, which no law of the catalogue describes.
fn on_a_worn_way(worn: f64) -> Diagnosis {
    let places = [-0.15, -0.03, 0.12];
    let record = |seed: u64, waves: &[(f64, f64)]| {
        let motion = wave(waves, 0.4 * seed as f64, 15_000);
        let at = |q: f64| places.iter().map(|p| math::exp(-((q - p) / 0.02) * ((q - p) / 0.02))).sum::<f64>();
        let tau = effort(&motion, 10.0).iter().zip(&motion).map(|(t, (q, v, _))| t + worn * at(*q) * v.signum()).collect();
        recording(&format!("r{seed}"), &[("x", &motion, tau)], 0.2, seed)
    };
    let train = [record(1, &WAVES), record(2, &[(0.17, 0.5), (0.07, 0.9)])];
    let holdout = [record(3, &[(0.18, 0.45), (0.07, 1.0)])];
    run(&slides(&[("x", "base")]), &train, &holdout, Some(20.0))
}

#[test]
fn friction_of_single_places_stays_without_a_name_and_is_shown_in_either_direction() {
    let worn = on_a_worn_way(6.0);
    let u = &worn.verdict.unexplained;
    assert!(u.present && u.place == ["x"], "{}", worn.verdict.says);
    assert!(u.depends_on.iter().any(|s| s == "q.x by direction"), "{:?}", u.depends_on);
    let mean = |way: &str| {
        let name = format!("q.x by direction, {way}");
        let curve = worn.evidence.dependences.iter().find(|d| d.joint == "x" && d.signal == name).unwrap_or_else(|| panic!("no {name}"));
        curve.mean.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), m| (low.min(*m), high.max(*m)))
    };
    // Against the motion, one way and the other: peaks where the way is worn, and the mean of them is in the refitted friction.
    let (forwards, backwards) = (mean("forwards"), mean("backwards"));
    assert!(forwards.1 > 1.0 && forwards.1 > -forwards.0, "{forwards:?}");
    assert!(backwards.0 < -1.0 && -backwards.0 > backwards.1, "{backwards:?}");
    let smooth = on_a_worn_way(0.0).verdict;
    assert!(smooth.nothing_missing && !smooth.unexplained.present, "{}", smooth.says);
}

#[test]
fn a_push_is_one_on_the_outermost_link_where_the_drive_beside_it_feels_the_same() {
    let robot = slides(&[("x", "base"), ("y", "cx")]);
    let record = |name: &str, phase: f64, seed: u64| {
        let [x, y] = [0, 1].map(|k: usize| wave(&WAVES, 0.9 * k as f64 + phase, 10_000));
        // Somebody leans on the upper carriage across the lower one from 6 to 10 s.
        let leans = |i: usize| if (3000..5000).contains(&i) { -6.0 } else { 0.0 };
        let pushed = effort(&y, 10.0).iter().enumerate().map(|(i, t)| t + leans(i)).collect();
        recording(name, &[("x", &x, effort(&x, 20.0)), ("y", &y, pushed)], 0.5, seed)
    };
    let v = run(&robot, &[record("train", 0.0, 41)], &[record("other", 0.5, 42)], None).verdict;
    let f = v.findings.first().unwrap_or_else(|| panic!("{}", v.says));
    assert_eq!((f.effect.as_str(), &f.place), ("external_force", &vec!["cy".to_string()]), "{}", v.says);
    assert!((f.parameters["fy"].value - 6.0).abs() < 0.5 && (f.parameters["start"].value - 6.0).abs() < 0.3, "{:?}", f.parameters);
    assert!(f.cannot_tell_from.iter().any(|a| a.effect == "external_force" && a.place == ["y"]), "{:?}", f.cannot_tell_from);
}

/// A verdict on a slide that is pulled back with that stiffness in the middle `[N/m]` and a curve with these second and third powers `[1/m, 1/m²]`.
fn on_a_spring(stiffness: f64, [second, third]: [f64; 2]) -> Verdict {
    let robot = slides(&[("x", "base")]);
    let pulled = |w: &Wave| -> Vec<f64> {
        let curve = |q: f64| stiffness * (q + second * q * q + third * q * q * q);
        effort(w, 10.0).iter().zip(w).map(|(t, (q, _, _))| t + curve(*q)).collect()
    };
    let record = |name: &str, waves: &[(f64, f64)], phase: f64, seed: u64| {
        let x = wave(waves, phase, 15_000);
        recording(name, &[("x", &x, pulled(&x))], 0.1, seed)
    };
    let (train, other) = (record("train", &WAVES, 0.0, 31), record("other", &[(0.18, 0.5), (0.07, 0.9)], 0.6, 32));
    run(&robot, &[train], &[other], None).verdict
}

#[test]
fn a_spring_has_its_name_beside_a_fuller_law_that_is_too_small_for_one() {
    // 0.8 % of the effort: more than a spring of two numbers must be, less than a cable's curve of five, which explains a hair more.
    let v = on_a_spring(1.3, [0.8, 0.0]);
    let names: Vec<&str> = v.findings.iter().map(|f| f.effect.as_str()).collect();
    assert_eq!(names.first(), Some(&"spring"), "{}", v.says);
    // Too small for either, no other law's to have, and not unexplained.
    let v = on_a_spring(0.9, [0.4, 4.0]);
    assert!(v.nothing_missing, "{}", v.says);
    let small = v.ruled_out.iter().find(|r| r.effect == "spring").expect("a spring that was weighed");
    assert!(small.why_not.contains("worth naming") && small.gain > 0.5, "{}", small.why_not);
}
