//! More drives than freedoms: what the drives do to each other is kept apart from what moves the robot, and what is concealed at one of
//! them is found all the same.

use nalgebra::{DMatrix, Matrix4x3, Vector4};
use pkm_diagnose::{Diagnosis, Settings, diagnose, predict};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, drive_reduction, internal_efforts, solve_velocities, walk_to};
use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Data, Model, math};
use pkm_ident::columns::Columns;
use pkm_ident::estimate::Method;
use pkm_ident::observation::RowOptions;
use pkm_ident::{Recording, excitation, excite, identify};
use pkm_sim::{Consistent, Reference, ReferenceOptions, Sample, Scenario, Trajectory};
use pkm_tests::Draw;

fn ups4() -> Description {
    let robot = pkm_robots::find("ups4").expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

fn hidden(nominal: &Description, effect: &str, place: &str, numbers: &[(&str, f64)]) -> Applied {
    let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| (n.to_string(), *v)).collect();
    Applied::try_new(&nominal.bare, effect, place, &numbers).expect("a valid effect")
}

fn recorded(nominal: &Description, hidden: &[Applied], seed: u64) -> Recording {
    let truth = Robot::new(nominal.bare.clone(), hidden.to_vec());
    let scenario = Scenario { seed, ..Scenario::default() };
    let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
    r.name = format!("motion{seed}");
    r
}

fn judged(nominal: &Description, hidden: &[Applied], seed: u64) -> Diagnosis {
    let [train, holdout] = [1, 2].map(|i| recorded(nominal, hidden, 10 * seed + i));
    diagnose(nominal, &[train], &[holdout], &Settings::default(), &mut |_| {}).expect("the recordings are usable")
}

fn told(d: &Diagnosis) -> String {
    let all = d.verdict.findings.iter().map(|f| {
        let same: Vec<String> = f.cannot_tell_from.iter().map(|a| format!("{}@{}", a.effect, a.place.join(","))).collect();
        format!("{}@{} {:?} ~ {}", f.effect, f.place.join(","), f.parameters, same.join(" "))
    });
    format!("{}\n{}", d.verdict.says, all.collect::<Vec<_>>().join("\n"))
}

/// Pose of the robot with its ankle turned: where its legs close.
fn posed(model: &Model, by: f64) -> Data {
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed);
    let q: Vec<f64> = model.actuators.iter().enumerate().map(|(k, &j)| data.q[j] + by * [1.0, -0.4, 0.3, 0.8][k]).collect();
    assert!(walk_to(model, &mut data, &q).is_closed);
    data
}

#[test]
fn rows_of_the_drives_project_onto_what_moves_the_robot() {
    let model = ups4().bare;
    let mut data = posed(&model, 0.01);
    let v0 = Vector4::from_column_slice(internal_efforts(&model, &mut data).as_slice());
    let r = drive_reduction(&model, &mut data).clone();
    let p = DMatrix::from_fn(4, 4, |k, j| r[(model.actuators[k], j)]);
    // A projector of rank three that takes the one internal effort away and nothing else: 1 − v0·v0ᵀ [McDaid, after eq. 8.7].
    let want = DMatrix::identity(4, 4) - v0 * v0.transpose();
    assert!((&p - want).amax() < 1e-12, "{p}");
    // Against finite differences: joints move by R times a motion of the drives that the loops allow.
    let away = |h: f64| posed(&model, 0.01 + h).q;
    let (ahead, back, h) = (away(1e-6), away(-1e-6), 1e-6);
    let slope: Vec<f64> = ahead.iter().zip(&back).map(|(a, b)| (a - b) / (2.0 * h)).collect();
    let of_drives = nalgebra::DVector::from_iterator(4, model.actuators.iter().map(|&j| slope[j]));
    let moved = &r * of_drives;
    for (j, (moved, slope)) in moved.iter().zip(&slope).enumerate() {
        assert!((moved - slope).abs() < 1e-7 * (1.0 + slope.abs()), "joint {j}: {moved} instead of {slope}");
    }
    // And what does not: velocities that contradict each other are met in the mean.
    let odd = [0.02, -0.01, 0.005, 0.03];
    solve_velocities(&model, &mut data, &odd);
    let by_rows = &r * nalgebra::DVector::from_column_slice(&odd);
    assert!(data.v.iter().zip(by_rows.iter()).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn the_reduction_of_the_drives_is_the_printed_jacobians_pseudo_inverse() {
    // J of robots.md, neutral foot: lengths' rates by the ankle's, [McDaid, eq. 8.4].
    let j = Matrix4x3::new(
        0.024_557_56,
        -0.056_771_72,
        -0.011_389_43,
        0.024_557_56,
        0.056_771_72,
        0.011_389_43,
        -0.027_596_78,
        0.063_447_23,
        -0.014_083_39,
        -0.027_596_78,
        -0.063_447_23,
        0.014_083_39,
    );
    let plus = (j.transpose() * j).try_inverse().expect("full rank") * j.transpose();
    let model = ups4().bare;
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    let r = drive_reduction(&model, &mut data);
    for (row, name) in ["rx", "ry", "rz"].iter().enumerate() {
        let joint = model.joint_index(name).expect("a joint of the ankle");
        for k in 0..4 {
            assert!((r[(joint, k)] - plus[(row, k)]).abs() < 2e-5 * plus.amax(), "{name}, drive {k}: {} {}", r[(joint, k)], plus[(row, k)]);
        }
    }
}

#[test]
fn a_healthy_robot_has_nothing_missing_and_its_strain_is_told() {
    let nominal = ups4();
    let d = judged(&nominal, &[], 1);
    assert!(d.verdict.findings.is_empty(), "{}", told(&d));
    let strain = d.verdict.internal_effort.as_ref().expect("four drives, three freedoms");
    assert_eq!(strain.place, ["l1", "l2", "l3", "l4"]);
    assert!(strain.share < 0.2 && strain.contradiction_rms < 1e-5, "{strain:?}");
}

#[test]
fn dry_friction_of_one_drive_is_named_at_that_drive() {
    let nominal = ups4();
    let d = judged(&nominal, &[hidden(&nominal, "friction_coulomb", "l2", &[("coulomb", 15.0)])], 2);
    let f = d.verdict.findings.first().unwrap_or_else(|| panic!("{}", told(&d)));
    assert_eq!((f.effect.as_str(), f.place.as_slice()), ("friction_coulomb", &["l2".to_string()][..]), "{}", told(&d));
    let e = &f.parameters["coulomb"];
    assert!((e.value - 35.0).abs() < 2.0, "{e:?}");
    assert!(d.verdict.heldout.rms_final < 0.7 * d.verdict.heldout.rms_nominal, "{:?}", d.verdict.heldout);
}

#[test]
fn a_load_on_the_platform_is_found_and_the_refined_robot_explains_a_fresh_motion() {
    let nominal = ups4();
    let load = [hidden(&nominal, "payload", "platform", &[("mass", 3.0), ("y", 0.05), ("z", -0.05)])];
    let d = judged(&nominal, &load, 3);
    let is_load = |effect: &str| ["payload", "inertia_error"].contains(&effect);
    let is_there = |f: &pkm_diagnose::verdict::Finding| {
        let at = |effect: &str, place: &[String]| is_load(effect) && place == ["platform"];
        at(&f.effect, &f.place) || f.cannot_tell_from.iter().any(|a| at(&a.effect, &a.place))
    };
    assert!(d.verdict.findings.first().is_some_and(is_there), "{}", told(&d));
    // Offsets of the drives and masses of the legs, each of which looks like a part of the load, must not be what is left of it.
    let h = &d.verdict.heldout;
    assert!(h.rms_final < 0.2 * h.rms_nominal, "{} of {}\n{}", h.rms_final, h.rms_nominal, told(&d));
    // The foot turns about the ankle: only mass times distance can be told, and that is said.
    let f = &d.verdict.findings[0];
    assert_eq!(f.effect, "payload", "{}", told(&d));
    let of = |name: &str| f.parameters[name].value;
    let moment = ["x", "y", "z"].map(|name| of("mass") * of(name));
    assert!(moment[0].abs() < 5e-3 && (moment[1] - 0.15).abs() < 5e-3 && (moment[2] + 0.15).abs() < 5e-3, "{moment:?}");
    assert!(f.says.contains("only mass times distance shows"), "{}", f.says);
    let [toml, urdf] = d.refined.as_ref().expect("a refined robot").texts(&nominal, "refined.urdf").expect("it can be written");
    let better = parse(&toml, &urdf, ["refined.toml", "refined.urdf"]).expect("it can be read");
    // Against the robot that carries it, along a motion of its own: sensors are as noisy as the load is heavy.
    let fresh = recorded(&nominal, &load, 99);
    let mut carrying = nominal.clone();
    carrying.robot = Robot::new(nominal.bare.clone(), [nominal.robot.effects.clone(), load.to_vec()].concat());
    let wanted = predict(&carrying, &fresh).expect("it fits");
    let error = |robot: &Description| {
        let effort = predict(robot, &fresh).expect("it fits");
        let of = |name: &str| wanted[name].iter().zip(&effort[name]).map(|(m, e)| (m - e) * (m - e)).sum::<f64>();
        ["l1", "l2", "l3", "l4"].map(of).iter().sum::<f64>()
    };
    assert!(error(&better) < 0.3 * error(&nominal), "{} of {}", error(&better), error(&nominal));
}

#[test]
fn a_wrong_torque_constant_is_named_at_its_drive() {
    let nominal = ups4();
    let d = judged(&nominal, &[hidden(&nominal, "torque_constant", "l3", &[("scale", 0.8)])], 4);
    let f = d.verdict.findings.first().unwrap_or_else(|| panic!("{}", told(&d)));
    assert!(f.effect == "torque_constant" && f.place == ["l3"], "{}", told(&d));
    assert!((f.parameters["scale"].value - 0.8).abs() < 0.02, "{}", told(&d));
}

/// Of mean zero and variance one, by the sum of twelve uniform numbers.
fn normal(draw: &mut Draw) -> f64 {
    (0..12).map(|_| draw.uniform(-0.5..0.5)).sum()
}

/// Half a minute of `truth` as its equations have them, its drives straining each other besides, with white noise of `noise` newtons.
fn made(truth: &Model, noise: f64, draw: &mut Draw) -> Recording {
    let drawn = Reference::draw(truth, &ReferenceOptions { seed: 5, period_s: 5.0, amplitude: 0.6 }).expect("a motion");
    let motion = Consistent::try_new(truth, Box::new(drawn)).expect("loops close");
    let (mut data, mut out, mut s) = (Data::new(truth), Recording { name: "made".to_string(), ..Recording::default() }, Sample::default());
    motion.at(0.0, &mut s);
    assert!(assemble(truth, &mut data).is_closed && walk_to(truth, &mut data, &s.q).is_closed);
    let (mut q, mut tau) = (vec![Vec::new(); 4], vec![Vec::new(); 4]);
    for i in 0..6000 {
        let t = 5e-3 * f64::from(i);
        out.time.push(t);
        motion.at(t, &mut s);
        assert!(inverse_dynamics(truth, &mut data, &s.q, &s.v, &s.a).is_closed);
        let smallest = data.tau_act.clone();
        let strain = internal_efforts(truth, &mut data).clone();
        for (k, &j) in truth.actuators.iter().enumerate() {
            let friction = truth.joints[j].viscous * s.v[k] + truth.joints[j].coulomb * math::sign(s.v[k]);
            let internal = strain[(k, 0)] * (30.0 + 40.0 * math::sin(3.0 * t));
            q[k].push(s.q[k]);
            tau[k].push(smallest[k] + friction + internal + noise * normal(draw));
        }
    }
    for (k, &j) in truth.actuators.iter().enumerate() {
        let name = &truth.joints[j].name;
        out.signals.insert(format!("q.{name}"), core::mem::take(&mut q[k]));
        out.signals.insert(format!("tau.{name}"), core::mem::take(&mut tau[k]));
    }
    out
}

#[test]
fn ninety_five_percent_intervals_hold_the_truth_whatever_the_drives_do_to_each_other() {
    let nominal = ups4();
    let mut truth = nominal.bare.clone();
    for (k, &j) in nominal.bare.actuators.iter().enumerate() {
        truth.joints[j].coulomb *= [1.4, 0.7, 1.1, 1.6][k];
        truth.joints[j].viscous *= [0.8, 1.3, 1.1, 0.9][k];
    }
    let true_theta = Columns::new(&Robot::new(truth.clone(), Vec::new())).nominal();
    let rows = RowOptions { softness: 1e-6, ..RowOptions::default() };
    let settings = pkm_ident::Settings { method: Method::Wls, rows, ..pkm_ident::Settings::default() };
    let (mut inside, mut all) = (0, 0);
    let runs = if std::env::var_os("PKM_LONG").is_some() { 100 } else { 12 };
    for seed in 0..runs {
        let recording = made(&truth, 4.0, &mut Draw::new(40 + seed));
        let answer = identify(&nominal.robot, &[recording], &[], &settings, &mut |_| {}).expect("recordings of this robot");
        let set = answer.set.as_ref().expect("an answer");
        for (p, want) in answer.parameters.iter().zip(set.project(&true_theta)) {
            all += 1;
            inside += u32::from(p.ci95[0] <= want && want <= p.ci95[1]);
        }
    }
    let share = f64::from(inside) / f64::from(all);
    // Twelve runs are some three hundred numbers, not independent; rows taken for as many as there are drives would hold it in 91 %.
    assert!((0.92..=0.985).contains(&share), "{inside} of {all}: {share}");
}

#[test]
fn an_excitation_moves_all_drives_as_the_loops_have_them() {
    let nominal = ups4();
    let few = excitation::Settings { restarts: 1, draws: 4, iterations: 4, ..excitation::Settings::default() };
    let found = excite(&nominal.robot, &few, &|_| {}).expect("a motion");
    let recording = found.recording(&nominal.bare, 200, 20.0);
    let mut data = Data::new(&nominal.bare);
    assert!(assemble(&nominal.bare, &mut data).is_closed);
    for i in 0..recording.time.len() {
        let of = |k: usize| recording.signals[&format!("q_ref.l{}", k + 1)][i];
        let q: [f64; 4] = core::array::from_fn(of);
        let closure =
            if i == 0 { walk_to(&nominal.bare, &mut data, &q) } else { pkm_dyn::loops::solve_positions(&nominal.bare, &mut data, &q) };
        assert!(closure.is_closed && closure.misfit < 1e-9, "{closure:?}");
        for &j in &nominal.bare.actuators {
            let limits = nominal.bare.joints[j].limits;
            assert!((limits.lower..limits.upper).contains(&data.q[j]), "sample {i}: {}", data.q[j]);
        }
    }
}

/// The largest difference between efforts at one phase of any two periods, in means over a tenth of a second `[N]`; the first period, which begins at
/// rest, is left out.
fn differs_from_period_to_period(recording: &Recording, scenario: &Scenario) -> f64 {
    let samples = |s: f64| recording.time.iter().take_while(|t| **t < s - 0.5 / scenario.rate_hz).count();
    let (period, bin) = (samples(scenario.period_s), samples(0.1));
    let mut largest = 0.0_f64;
    for tau in recording.signals.iter().filter(|(name, _)| name.starts_with("tau.")).map(|(_, tau)| tau) {
        let means: Vec<f64> = tau.chunks_exact(bin).map(|x| x.iter().sum::<f64>() / bin as f64).collect();
        let per_period = period / bin;
        for (i, mean) in means.iter().enumerate().skip(2 * per_period) {
            largest = largest.max((mean - means[i - per_period]).abs());
        }
    }
    largest
}

#[test]
fn dry_friction_resists_in_every_period_alike_near_a_singularity_of_some_drives() {
    // Three of the four drives come near a singularity, and the fourth turns over there. Dry friction of 20 N that took the wrong side for the rest of a
    // stroke would differ by 40 N; sensors and controller alone make one or two.
    let nominal = ups4();
    let scenario = Scenario { seed: 22, ..Scenario::default() };
    let recording = pkm_sim::run(&nominal.robot, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
    let differs = differs_from_period_to_period(&recording, &scenario);
    assert!(differs < 8.0, "{differs} N");
}
