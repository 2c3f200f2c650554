//! Excitation on the shipped robots: limits by another path, gains over random motions, effects told apart, refusals.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]
#![expect(clippy::print_stdout, reason = "measured numbers are for those who look")]

use pkm_dyn::Data;
use pkm_dyn::effects::{Applied, JointState, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::math;
use pkm_ident::Term;
use pkm_ident::base::RANK_TOLERANCE;
use pkm_ident::columns::{Columns, Quantity};
use pkm_ident::excitation::{Basis, Bounded, Criterion, DriveState, Excitation, ExciteError, Limits, Settings, conditions, excite};
use pkm_ident::grouping::{BaseSet, Choice};

fn shipped(name: &str) -> Robot {
    let robot = pkm_robots::find(name).unwrap();
    pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).unwrap().robot
}

/// A search of the size that a test can wait for.
fn quick() -> Settings {
    Settings { period_s: 8.0, held: vec![Term::PassiveFriction], restarts: 2, draws: 12, iterations: 32, ..Settings::default() }
}

fn found(robot: &Robot, settings: &Settings) -> Excitation {
    excite(robot, settings, &|_| {}).unwrap()
}

/// Every limit of the robot's file at `n` times of a period, without a line of the search's code.
fn assert_admissible(robot: &Robot, e: &Excitation, n: u32) {
    let model = &robot.model;
    let mut data = Data::new(model);
    let (share, eps) = (e.settings.limits.share, 1e-5);
    let narrowed = |l: f64, u: f64| (0.5 * ((1.0 + share) * l + (1.0 - share) * u), 0.5 * ((1.0 + share) * u + (1.0 - share) * l));
    assert!(assemble(model, &mut data).is_closed);
    for i in 0..n {
        let t = e.motion.period_s * f64::from(i) / f64::from(n);
        let s = e.motion.at(t);
        if i == 0 {
            assert!(walk_to(model, &mut data, &s.q).is_closed);
        }
        assert!(inverse_dynamics(model, &mut data, &s.q, &s.v, &s.a).is_closed, "{t}");
        for (j, joint) in model.joints.iter().enumerate() {
            let l = joint.limits;
            let (lower, upper) = narrowed(l.lower, l.upper);
            let is_stated = lower.is_finite() && upper > lower;
            assert!(!is_stated || (lower - eps..=upper + eps).contains(&data.q[j]), "{}: {} of {l:?} at {t}", joint.name, data.q[j]);
            let most = if l.velocity > 0.0 { share * l.velocity } else { f64::INFINITY };
            assert!(data.v[j].abs() <= most + eps, "{}: {} of {l:?} at {t}", joint.name, data.v[j]);
        }
        for (k, &j) in model.actuators.iter().enumerate() {
            let mut tau = data.tau_act[k];
            for p in 0..model.nv() {
                let mut state = JointState { load: 0.0, ..JointState::default() };
                (state.q, state.v, state.a, state.sign) = (data.q[p], data.v[p], data.a[p], math::sign(data.v[p]));
                tau += data.reduction[(p, k)] * robot.joint_effort(p, &state);
            }
            let most = share * model.joints[j].limits.effort;
            // Between samples dry friction may change its sign.
            assert!(tau.abs() <= 1.001 * most, "{}: {tau} of {most} at {t}", model.joints[j].name);
            assert!(e.settings.limits.acceleration.is_none_or(|most| s.a[k].abs() <= most + eps), "{t}");
            assert!(e.settings.limits.velocity.is_none_or(|most| s.v[k].abs() <= most + eps), "{t}");
        }
    }
    let start = e.motion.at(0.0);
    let top = |of: fn(&DriveState) -> &Vec<f64>| {
        (0..200).flat_map(|i| of(&e.motion.at(0.04 * f64::from(i))).clone()).fold(0.0_f64, |top, x| top.max(x.abs()))
    };
    assert!(start.v.iter().all(|v| v.abs() < 1e-9 * top(|s| &s.v)), "{:?}", start.v);
    assert!(start.a.iter().all(|a| a.abs() < 1e-9 * top(|s| &s.a)), "{:?}", start.a);
    assert!(e.margins.iter().all(|m| m.room >= 0.0) && e.margins.iter().any(|m| m.room < 0.15), "{:?}", e.margins);
}

fn tell(e: &Excitation) {
    println!(
        "{}: condition {:.2}, best of {} random {:.2} (median {:.2}), gain {:.2}; structural {}, counted {}, well conditioned {}, {} steps",
        e.robot,
        e.quality.condition,
        e.random.motions,
        e.random.best.as_ref().unwrap().condition,
        math::exp(e.random.median),
        e.gain().unwrap(),
        e.structural,
        e.columns.len(),
        e.well_conditioned,
        e.traces.iter().map(|t| t.steps.len()).sum::<usize>()
    );
}

#[test]
fn motions_are_better_than_random_ones_and_keep_every_limit() {
    for (name, least) in [("five_bar", 1.4), ("prs3", 1.5), ("motobotte", 1.15)] {
        let robot = shipped(name);
        let e = found(&robot, &quick());
        tell(&e);
        let gain = e.gain().unwrap();
        assert!(gain > least, "{name}: {gain}");
        assert_eq!(e.structural, e.columns.len());
        assert_admissible(&robot, &e, 6000);
    }
}

#[test]
fn an_arm_of_six_axes_is_excited_as_well() {
    let robot = shipped("serial_arm");
    let e = found(&robot, &Settings { restarts: 1, draws: 6, iterations: 16, ..quick() });
    tell(&e);
    let gain = e.gain().unwrap();
    assert!(gain > 1.7, "{gain}");
    assert_eq!((e.structural, e.columns.len()), (58, 58));
    assert_admissible(&robot, &e, 3000);
}

#[test]
fn no_motion_is_worse_than_the_best_random_one_and_steps_are_counted_to_the_last() {
    let robot = shipped("five_bar");
    // Too few steps to get back from the share of the drawn motion that the descent begins at.
    for iterations in [0, 1, 2, 3, 5] {
        for seed in 1..=3 {
            let e = found(&robot, &Settings { restarts: 2, draws: 4, iterations, seed, ..quick() });
            let gain = e.gain().unwrap();
            assert!(gain >= 1.0, "{iterations} steps, seed {seed}: {gain}");
            assert!(e.traces.iter().all(|t| t.steps.len() <= iterations), "{iterations} steps: {:?}", e.traces);
        }
    }
    // The search alone, as it was drawn, is not always the better one: without the comparison some of these are below one.
    assert!((0..4).any(|seed| {
        (found(&robot, &Settings { restarts: 1, draws: 6, iterations: 0, seed, ..quick() }).gain().unwrap() - 1.0).abs() < 1e-12
    }));
}

#[test]
fn splines_serve_as_well_and_limits_of_this_motion_are_kept() {
    let robot = shipped("five_bar");
    let limits = Limits { velocity: Some(0.9), acceleration: Some(4.0), share: 0.9, ..Limits::default() };
    let settings = Settings { basis: Basis::Spline { pieces: 12 }, criterion: Criterion::Determinant, limits, ..quick() };
    let e = found(&robot, &settings);
    tell(&e);
    let gain = e.gain().unwrap();
    assert!(gain > 1.1 && e.quality.log_determinant > e.random.best.as_ref().unwrap().log_determinant, "{gain}");
    assert_admissible(&robot, &e, 6000);
    let near = e.margins.iter().find(|m| m.what == Bounded::Velocity && m.place == "shoulder_left").unwrap();
    assert!((near.upper - 0.9).abs() < 1e-12, "{near:?}");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let robot = shipped("five_bar");
    let settings = Settings { iterations: 8, draws: 3, restarts: 3, ..quick() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| found(&robot, &settings))
    };
    let (one, four) = (with(1), with(4));
    assert_eq!((&one.motion, &one.quality, &one.traces), (&four.motion, &four.quality, &four.traces));
    let other = found(&robot, &Settings { seed: 2, ..settings });
    assert_ne!(one.motion, other.motion);
}

#[test]
fn two_effects_are_further_apart_than_along_any_random_motion() {
    let robot = shipped("five_bar");
    let effect = |name: &str, values: &[(&str, f64)]| {
        let values: Vec<(String, f64)> = values.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
        Applied::try_new(&robot.model, name, "shoulder_left", &values).unwrap()
    };
    // Friction that grows with load looks like more dry friction where the load changes little.
    let effects = vec![effect("friction_load", &[("mu", 0.1)]), effect("friction_coulomb", &[("coulomb", 1.0)])];
    for criterion in [Criterion::Angle, Criterion::Power] {
        let e = found(&robot, &Settings { criterion, effects: effects.clone(), ..quick() });
        let (s, random) = (e.quality.separation.unwrap(), e.random.best.as_ref().unwrap().separation.unwrap());
        println!(
            "{criterion:?}: {:.1} degrees (random {:.1}), alone {:?} (random {:?}), gain {:.3}",
            s.angle_deg(),
            random.angle_deg(),
            s.alone,
            random.alone,
            e.gain().unwrap()
        );
        match criterion {
            Criterion::Angle => assert!(s.angle_deg() > random.angle_deg() + 5.0, "{s:?} {random:?}"),
            _ => assert!(e.gain().unwrap() > 1.2, "{s:?} {random:?}"),
        }
        assert_admissible(&robot, &e, 4000);
    }
    // A ripple that the file states, a payload and a tilted base have columns as well, and theirs are no base parameters then.
    let mut rippled = robot.clone();
    rippled.effects = vec![effect("torque_ripple", &[("amplitude", 0.2), ("order", 4.0)])];
    let root = Applied::try_new(&robot.model, "gravity_tilt", &robot.model.root, &[("pitch".to_string(), 0.1)]).unwrap();
    let pair = vec![rippled.effects[0].clone(), root];
    let e = found(&rippled, &Settings { criterion: Criterion::Angle, effects: pair, iterations: 4, draws: 4, ..quick() });
    let s = e.quality.separation.unwrap();
    assert!(
        e.columns.iter().all(|c| !c.contains("sine_4")) && s.angle_deg() > 1.0 && s.left.iter().all(|l| *l > 1e-3),
        "{s:?} {:?}",
        e.columns
    );
    // Dry friction and twice as much of it are one column.
    let twice = vec![effect("friction_coulomb", &[("coulomb", 1.0)]), effect("friction_coulomb", &[("coulomb", 2.0)])];
    let refused = excite(&robot, &Settings { criterion: Criterion::Angle, effects: twice, ..quick() }, &|_| {});
    assert!(matches!(refused, Err(ExciteError::Blind { .. })), "{refused:?}");
}

#[test]
fn what_leaves_no_room_is_said_with_numbers() {
    let mut robot = shipped("prs3");
    let told = |robot: &Robot, settings: &Settings| excite(robot, settings, &|_| {}).unwrap_err().to_string();
    let settings = Settings { draws: 1, restarts: 1, iterations: 1, ..quick() };
    for j in robot.model.actuators.clone() {
        robot.model.joints[j].limits.effort = 1.0;
    }
    let text = told(&robot, &settings);
    assert!(text.contains("effort of q") && text.contains("limits -0.95") && !text.contains('\n'), "{text}");
    let robot = shipped("five_bar");
    for (settings, part) in [
        (Settings { period_s: f64::NAN, ..settings.clone() }, "period = NaN"),
        (Settings { basis: Basis::Fourier { harmonics: 2 }, ..settings.clone() }, "harmonics = 2"),
        (Settings { basis: Basis::Spline { pieces: 1000 }, ..settings.clone() }, "pieces = 1000"),
        (Settings { restarts: 0, ..settings.clone() }, "restarts = 0"),
        (Settings { limits: Limits { share: 1.5, ..Limits::default() }, ..settings.clone() }, "share of the limits = 1.5"),
        (Settings { criterion: Criterion::Power, ..settings.clone() }, "effects to tell apart = 0"),
    ] {
        assert!(told(&robot, &settings).contains(part), "{}", told(&robot, &settings));
    }
}

mod observation;

#[test]
fn condition_numbers_are_those_of_numpy() {
    // tests/golden/excitation/make_golden.py made the numbers from the matrix beside it.
    let csv = include_str!("../../../tests/golden/excitation/observation.csv");
    let golden: serde_json::Value = serde_json::from_str(include_str!("../../../tests/golden/excitation/golden.json")).unwrap();
    let w = observation::observation();
    let exported: Vec<Vec<f64>> = csv.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    assert_eq!((exported.len(), exported[0].len()), (w.nrows(), w.ncols()));
    for (i, row) in exported.iter().enumerate() {
        for (j, x) in row.iter().enumerate() {
            assert!((w[(i, j)] - x).abs() <= 1e-9 * (1.0 + x.abs()), "{i} {j}");
        }
    }
    let [condition, raw] = conditions(&w);
    let of = |key: &str| golden[key].as_f64().unwrap();
    assert!((condition / of("condition") - 1.0).abs() < 1e-9, "{condition} {golden}");
    assert!((raw / of("condition_raw") - 1.0).abs() < 1e-9, "{raw} {golden}");
    let values = w.singular_values().unwrap();
    let log_determinant: f64 = values.iter().map(|s| math::ln(s * s / w.nrows() as f64)).sum();
    assert!((log_determinant - of("log_determinant")).abs() < 1e-8, "{log_determinant} {golden}");
}

/// The `n` columns among `list` that pivoted QR takes first, columns at length one.
fn first_pivots(triangle: &faer::Mat<f64>, list: &[usize], n: usize) -> Vec<usize> {
    let length = |j: usize| triangle.col(j).norm_l2();
    let acting: Vec<usize> = list.iter().copied().filter(|&j| length(j) > 1e-9).collect();
    let unit = faer::Mat::from_fn(triangle.nrows(), acting.len(), |i, j| triangle[(i, acting[j])] / length(acting[j]));
    unit.col_piv_qr().P().arrays().0.iter().take(n).map(|&j| acting[j]).collect()
}

#[test]
fn the_3_ups_rpu_shows_34_inertial_and_22_friction_columns_below_300() {
    // [Armas, sec. 2.1.5]: seven harmonics in 20 s, spheres within 50 degrees, condition number below 300. The printed speed limit of
    // 0.01 m/s is a misprint (3 cm of travel in 20 s); 0.05 m/s is assumed. The 51 + 22 structural columns are not all seen so well: 34
    // is a numerical rank.
    let robot = shipped("ups3_rpu1");
    let columns = Columns::new(&robot);
    let inertial: Vec<usize> = (0..10 * columns.links.len()).collect();
    let is_of_a_leg = |joint: usize| !["q43", "q44"].contains(&robot.model.joints[joint].name.as_str());
    let friction: Vec<usize> = (0..columns.len())
        .filter(|&i| match columns.list[i].quantity {
            Quantity::Viscous { joint } | Quantity::Coulomb { joint } => is_of_a_leg(joint),
            _ => false,
        })
        .collect();
    assert_eq!(friction.len(), 22);
    let limits = Limits { velocity: Some(0.05), cone: Some(50.0_f64.to_radians()), ..Limits::default() };
    let basis = Basis::Fourier { harmonics: 7 };
    let held = vec![Term::Rotor, Term::Offset];
    let drawn = Settings { basis, period_s: 20.0, limits, held, restarts: 1, draws: 3, iterations: 0, ..Settings::default() };
    // Which columns a motion of this kind shows, then a motion for them.
    let first = found(&robot, &drawn).triangle();
    let chosen = [first_pivots(&first, &inertial, 34), friction.clone()].concat();
    let e = found(&robot, &Settings { columns: Some(chosen), iterations: 24, ..drawn });
    tell(&e);
    let last = e.triangle();
    let again = [first_pivots(&last, &inertial, 34), friction.clone()].concat();
    let [condition, _] = conditions(&faer::Mat::from_fn(last.nrows(), again.len(), |i, j| last[(i, again[j])]));
    let all: Vec<usize> = inertial.iter().chain(&friction).copied().collect();
    let base = BaseSet::new(&last, &all, RANK_TOLERANCE, Choice::BestConditioned).unwrap();
    println!(
        "34 + 22 columns: {:.0}, chosen anew along the motion {condition:.0}; all {}: {:.0}",
        e.quality.condition,
        base.rank(),
        base.condition
    );
    assert!(e.quality.condition < 300.0 && condition < 300.0, "{} {condition}", e.quality.condition);
    assert_eq!((e.columns.len(), base.rank()), (56, 73));
    assert!(
        base.condition > 1000.0 && e.well_conditioned >= 56 && e.well_conditioned < e.structural,
        "{} {}",
        base.condition,
        e.well_conditioned
    );
    assert!(e.margins.iter().any(|m| m.what == Bounded::Cone) && e.margins.iter().any(|m| m.what == Bounded::Singularity));
    assert_admissible(&robot, &e, 4000);
}
