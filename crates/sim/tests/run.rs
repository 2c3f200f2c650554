//! Whole runs: repeatable to the bit, faithful to the mechanics, and changed by every effect of the catalogue.

use pkm_dyn::Data;
use pkm_dyn::effects::{Applied, CATALOGUE, Entry, JointState, Law, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::math::sign;
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::Recording;
use pkm_sim::{PlantKind, Scenario, SimError, describe, draw, run};

fn description(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load")
}

/// Shipped robots with as many drives as freedoms; the one with more wants another plant
/// (`more_drives_than_freedoms_want_the_constrained_plant_and_get_it`).
fn runnable() -> impl Iterator<Item = &'static pkm_robots::Shipped> {
    pkm_robots::ALL.iter().filter(|robot| robot.name != "ups4")
}

fn short() -> Scenario {
    Scenario { duration_s: 4.0, period_s: 4.0, ..Scenario::default() }
}

fn clean() -> Scenario {
    Scenario { rate_hz: 1000.0, encoder_resolution: 0.0, encoder_noise: 0.0, effort_noise: 0.0, ..Scenario::default() }
}

fn simulate(truth: &Robot, nominal: &Robot, scenario: &Scenario) -> Recording {
    run(truth, nominal, scenario, &mut |_| {}).expect("the run succeeds")
}

fn column<'r>(recording: &'r Recording, prefix: &str, joint: &str) -> &'r [f64] {
    recording.signal(&format!("{prefix}.{joint}")).expect("the recording has the column")
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = x.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x * x));
    f64::sqrt(sum / n)
}

#[test]
fn two_runs_give_the_same_bits_and_another_seed_others() {
    let robot = description("prs3").robot;
    let bits = |r: &Recording| -> Vec<u64> { r.signals.values().flatten().map(|x| x.to_bits()).collect() };
    let first = simulate(&robot, &robot, &short());
    assert_eq!(bits(&first), bits(&simulate(&robot, &robot, &short())));
    assert_ne!(bits(&first), bits(&simulate(&robot, &robot, &Scenario { seed: 2, ..short() })));
    assert_eq!(first.len(), 2001);
    for column in ["q.q1", "tau.q6", "q_ref.q8", "dq_ref.q1"] {
        assert_eq!(first.signal(column).unwrap().len(), first.len(), "{column}");
    }
}

#[test]
fn progress_runs_from_nothing_to_all() {
    let robot = description("five_bar").robot;
    let mut told = Vec::new();
    let _ = run(&robot, &robot, &Scenario { duration_s: 0.5, ..short() }, &mut |share| told.push(share)).unwrap();
    assert!(told.first() == Some(&0.0) && told.last() == Some(&1.0) && told.is_sorted());
}

/// Largest error of any drive, as a share of its effort's rms: recorded effort against the robot's inverse dynamics on the recorded
/// positions, differentiated by central differences, away from standstill of any joint.
fn mismatch(robot: &Robot, recording: &Recording) -> f64 {
    let model = &robot.model;
    let names: Vec<&str> = model.actuators.iter().map(|&j| model.joints[j].name.as_str()).collect();
    let columns = |prefix: &str| names.iter().map(|n| column(recording, prefix, n)).collect::<Vec<_>>();
    let (q, tau) = (columns("q"), columns("tau"));
    let h = recording.time[1] - recording.time[0];
    let mut data = Data::new(model);
    let start: Vec<f64> = q.iter().map(|c| c[0]).collect();
    assert!(assemble(model, &mut data).is_closed && walk_to(model, &mut data, &start).is_closed);
    let mut errors = vec![Vec::new(); names.len()];
    for i in 1..recording.len() - 1 {
        let at = |f: &dyn Fn(&[f64]) -> f64| q.iter().map(|c| f(c)).collect::<Vec<f64>>();
        let v = at(&|c| (c[i + 1] - c[i - 1]) / (2.0 * h));
        let a = at(&|c| (c[i + 1] - 2.0 * c[i] + c[i - 1]) / (h * h));
        assert!(inverse_dynamics(model, &mut data, &at(&|c| c[i]), &v, &a).is_closed);
        // Within three samples of a reversal the differences straddle the jump of the friction.
        let rubs = |j: usize| model.joints[j].coulomb > 0.0;
        let is_near_rest = (0..model.nv()).any(|j| rubs(j) && data.v[j].abs() < 3.0 * h * data.a[j].abs() + 1e-6);
        if is_near_rest {
            continue;
        }
        for k in 0..names.len() {
            let beyond: f64 = (0..model.nv())
                .map(|j| {
                    let [q, v, a] = [data.q[j], data.v[j], data.a[j]];
                    let state = JointState { q, v, a, sign: sign(v), ..JointState::default() };
                    data.reduction[(j, k)] * robot.joint_effort(j, &state)
                })
                .sum();
            errors[k].push(tau[k][i] - data.tau_act[k] - beyond);
        }
    }
    let worst = errors.iter().zip(&tau).map(|(e, t)| rms(e.iter().copied()) / rms(t.iter().copied()));
    assert!(errors[0].len() > recording.len() / 4, "only {} samples are off standstill", errors[0].len());
    worst.fold(0.0, f64::max)
}

#[test]
fn inverse_dynamics_on_the_recorded_motion_gives_the_recorded_effort() {
    for shipped in runnable() {
        let robot = description(shipped.name).robot;
        let recording = simulate(&robot, &robot, &clean());
        let error = mismatch(&robot, &recording);
        assert!(error < 1e-5, "{}: {error:e}", shipped.name);
    }
}

#[test]
fn every_robot_follows_its_reference() {
    for shipped in runnable() {
        let robot = description(shipped.name).robot;
        let recording = simulate(&robot, &robot, &Scenario { rate_hz: 200.0, ..Scenario::default() });
        for &j in &robot.model.actuators {
            let name = &robot.model.joints[j].name;
            let (q, reference) = (column(&recording, "q", name), column(&recording, "q_ref", name));
            let error = rms(q.iter().zip(reference).map(|(q, r)| q - r));
            let mean = reference.iter().sum::<f64>() / reference.len() as f64;
            let travel = rms(reference.iter().map(|r| r - mean));
            assert!(error < 0.05 * travel, "{} {name}: {error:e} of {travel:e}", shipped.name);
            assert!(column(&recording, "tau", name).iter().all(|t| t.abs() < 1.1 * robot.model.joints[j].limits.effort));
        }
    }
}

/// The recorded effort with the effect hidden differs from the healthy one of the same seed, and the robot still follows.
fn assert_visible(description: &Description, effect: &str, seed: u64, least: f64) {
    let nominal = &description.robot;
    let hidden = draw(seed, description, Some(effect), &[]).expect("the robot has a place for it");
    let text = describe(&hidden, &nominal.model);
    assert!(text.starts_with(effect), "{text}");
    let truth = Robot::new(nominal.model.clone(), hidden);
    let scenario =
        Scenario { duration_s: 5.0, encoder_resolution: 0.0, encoder_noise: 0.0, effort_noise: 0.0, seed, ..Scenario::default() };
    let (with, without) = (simulate(&truth, nominal, &scenario), simulate(nominal, nominal, &scenario));
    let mut largest = 0.0_f64;
    for &j in &nominal.model.actuators {
        let name = &nominal.model.joints[j].name;
        let (a, b) = (column(&with, "tau", name), column(&without, "tau", name));
        largest = largest.max(rms(a.iter().zip(b).map(|(a, b)| a - b)) / rms(b.iter().copied()));
        let (q, reference) = (column(&with, "q", name), column(&with, "q_ref", name));
        let l = nominal.model.joints[j].limits;
        let error = rms(q.iter().zip(reference).map(|(q, r)| q - r));
        assert!(error < 0.02 * (l.upper - l.lower), "{text}: {name} does not follow, {error:e}");
    }
    assert!(largest > least, "{text}: changes efforts by {largest:e} only");
}

/// Effects that the reduced plant, the drive's chain and the sensors know.
fn simulated() -> impl Iterator<Item = &'static Entry> {
    CATALOGUE.iter().copied().filter(|e| {
        let is_known = matches!(e.law, Law::JointEffort(_) | Law::EffortScale | Law::EffortLag | Law::EffortDelay | Law::PositionOffset);
        is_known || e.law.is_in_the_model()
    })
}

#[test]
fn every_simulated_effect_of_the_catalogue_changes_the_recorded_effort() {
    let description = description("prs3");
    for entry in simulated() {
        // Delays shift the effort in time: at these motions below 1 Hz that is a small change, however clear its signature.
        let least = if matches!(entry.name, "time_delay" | "actuator_lag") { 1e-4 } else { 5e-4 };
        for seed in 1..=2 {
            assert_visible(&description, entry.name, seed, least);
        }
    }
}

#[test]
fn every_effect_has_a_place_and_a_size_on_some_robot() {
    let description = description("prs3");
    let model = &description.robot.model;
    for entry in CATALOGUE {
        for seed in 1..=2 {
            let hidden = match draw(seed, &description, Some(entry.name), &[]) {
                Ok(hidden) => hidden,
                Err(SimError::NoPlace { effect: "friction_thermal", .. }) => continue,
                Err(other) => panic!("{}: {other}", entry.name),
            };
            assert_eq!(hidden[0].entry.name, entry.name);
            assert!(hidden[0].values.iter().any(|v| v.abs() > 0.0), "{}", describe(&hidden, model));
            let again = draw(seed, &description, Some(entry.name), &[]).expect("as before");
            assert_eq!(describe(&hidden, model), describe(&again, model), "the same seed draws the same");
        }
    }
}

#[test]
fn a_drawn_clip_takes_the_top_fifth_and_a_contact_the_last_fifth_of_the_travel() {
    let description = description("serial_arm");
    let nominal = &description.robot;
    let quiet = Scenario { encoder_resolution: 0.0, encoder_noise: 0.0, effort_noise: 0.0, duration_s: 5.0, ..Scenario::default() };
    for seed in 1..=2 {
        let recording = simulate(nominal, nominal, &Scenario { seed, ..quiet });
        let of = |effect: &str| draw(seed, &description, Some(effect), &[]).expect("it has a place")[0].clone();
        let range = |kind: &str, j: usize| {
            let signal = column(&recording, kind, &nominal.model.joints[j].name);
            signal.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)))
        };
        let clip = of("saturation");
        let (low, high) = range("tau", clip.place);
        assert!((clip.values[0] / low.abs().max(high) - 0.8).abs() < 0.05, "{clip:?} of {low} to {high}");
        let contact = of("contact");
        let (low, high) = range("q_ref", contact.place);
        let depth = if contact.values[3] > 0.0 { high - contact.values[1] } else { contact.values[1] - low };
        assert!(depth > 0.08 * (high - low) && depth < 0.22 * (high - low), "{contact:?} in {low} to {high}");
    }
}

#[test]
fn a_drawn_effect_suits_its_robot() {
    for shipped in runnable() {
        let description = description(shipped.name);
        for seed in 10..14 {
            let among: Vec<&str> = simulated().map(|e| e.name).filter(|name| *name != "friction_thermal").collect();
            let hidden = draw(seed, &description, None, &among).unwrap();
            assert_visible(&description, hidden[0].entry.name, seed, 1e-4);
        }
    }
    let arm = description("serial_arm");
    assert!(matches!(draw(1, &arm, Some("friction_passive"), &[]), Err(SimError::NoPlace { .. })));
    assert!(matches!(draw(1, &arm, Some("no_such_effect"), &[]), Err(SimError::Effect(_))));
    assert!(matches!(draw(1, &arm, None, &["no_such_effect"]), Err(SimError::Effect(_))));
    assert!(matches!(draw(1, &arm, None, &[]), Err(SimError::Scenario { .. })));
}

#[test]
fn an_effort_recorded_late_is_a_delay_with_a_negative_number() {
    let nominal = description("five_bar").robot;
    let late = |delay: f64| {
        let effect = Applied::try_new(&nominal.model, "time_delay", "shoulder_left", &[("delay".to_string(), delay)]).unwrap();
        let truth = Robot::new(nominal.model.clone(), vec![effect]);
        simulate(&truth, &nominal, &Scenario { duration_s: 2.0, ..clean() })
    };
    let (now, then) = (late(0.0), late(-4e-3));
    let (a, b) = (now.signal("tau.shoulder_left").unwrap(), then.signal("tau.shoulder_left").unwrap());
    for i in 10..a.len() {
        assert!((a[i - 4] - b[i]).abs() < 1e-6 * (1.0 + a[i - 4].abs()), "sample {i}");
    }
}

#[test]
fn more_drives_than_freedoms_want_the_constrained_plant_and_get_it() {
    let robot = description("ups4").robot;
    let reduced = Scenario { plant: PlantKind::Reduced, ..short() };
    let refused = run(&robot, &robot, &reduced, &mut |_| {}).expect_err("four drives for three freedoms");
    assert!(matches!(refused, SimError::Mobility { mobility: 3, drives: 4, .. }), "{refused}");
    let recording = run(&robot, &robot, &short(), &mut |_| {}).expect("the constrained plant has them");
    for joint in ["l1", "l2", "l3", "l4"] {
        let (q, q_ref) = (column(&recording, "q", joint), column(&recording, "q_ref", joint));
        let error = rms(q.iter().zip(q_ref).map(|(a, b)| a - b));
        assert!(error < 0.05 * rms(q_ref.iter().map(|x| x - q_ref[0])), "{joint}: {error}");
    }
}

#[test]
fn unusable_scenarios_are_refused() {
    let robot = description("five_bar").robot;
    let good = Scenario::default();
    for bad in [
        Scenario { duration_s: f64::NAN, ..good },
        Scenario { duration_s: 1e9, ..good },
        Scenario { rate_hz: 0.0, ..good },
        Scenario { period_s: -1.0, ..good },
        Scenario { amplitude: 1.5, ..good },
        Scenario { effort_noise: -0.1, ..good },
    ] {
        assert!(matches!(run(&robot, &robot, &bad, &mut |_| {}), Err(SimError::Scenario { .. })), "{bad:?}");
    }
    let other = description("prs3").robot;
    assert!(matches!(run(&other, &robot, &good, &mut |_| {}), Err(SimError::NotTheSameRobot { .. })));
}
