//! Motions other than the periodic one: derivatives are those of the positions, limits are kept or the motion is refused.

use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_sim::{Playback, Reference, ReferenceOptions, Sample, Scenario, Shape, Shaped, SimError, Trajectory, check_limits, run_along};

const SHAPES: [Shape; 3] =
    [Shape::MinimumJerk { period_s: 2.0 }, Shape::Step { period_s: 2.0 }, Shape::Chirp { low_hz: 0.1, high_hz: 2.0 }];

const DURATION_S: f64 = 7.0;

fn model(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").robot.model
}

fn at(motion: &dyn Trajectory, t: f64) -> Sample {
    let mut sample = Sample::default();
    motion.at(t, &mut sample);
    sample
}

/// Largest difference between velocity and acceleration and the central differences of position and velocity, over `steps` times.
fn derivative_errors(motion: &dyn Trajectory, duration_s: f64, steps: usize) -> (f64, f64) {
    let h = 1e-5;
    let (mut first, mut second) = (0.0_f64, 0.0_f64);
    for i in 1..steps {
        // Between the joints of the pieces: the third derivative jumps there.
        let t = duration_s * (i as f64 + 0.37) / (steps as f64 + 1.0);
        let (before, here, after) = (at(motion, t - h), at(motion, t), at(motion, t + h));
        for k in 0..here.q.len() {
            first = first.max((here.v[k] - (after.q[k] - before.q[k]) / (2.0 * h)).abs());
            second = second.max((here.a[k] - (after.v[k] - before.v[k]) / (2.0 * h)).abs());
        }
    }
    (first, second)
}

#[test]
fn velocities_and_accelerations_are_derivatives() {
    let arm = model("serial_arm");
    for shape in SHAPES {
        let motion = Shaped::draw(&arm, shape, DURATION_S, 0.3, 3).unwrap();
        let (first, second) = derivative_errors(&motion, DURATION_S, 500);
        // Differences over 1e-5 s of positions near 1 rad: rounding 1e-11, truncation h²/6 of the third derivative (below 1e4 rad/s³).
        assert!(first < 1e-6 && second < 1e-5, "{shape:?}: {first:e} {second:e}");
    }
}

#[test]
fn every_shape_keeps_the_limits_of_every_shipped_robot_and_moves_all_its_drives() {
    // The one with more drives than freedoms is not simulated.
    for shipped in pkm_robots::ALL.iter().filter(|robot| robot.name != "ups4") {
        let model = model(shipped.name);
        for shape in SHAPES {
            let motion = Shaped::draw(&model, shape, DURATION_S, 0.2, 1).unwrap();
            check_limits(&model, &motion, DURATION_S).unwrap();
            for (k, &j) in model.actuators.iter().enumerate() {
                let q: Vec<f64> = (0..700).map(|i| at(&motion, 0.01 * f64::from(i)).q[k]).collect();
                let (low, high) = q.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
                let limits = model.joints[j].limits;
                assert!(limits.lower < low && high < limits.upper && high > low, "{} {shape:?} drive {k}", shipped.name);
            }
            let start = at(&motion, 0.0);
            assert!(start.v.iter().chain(&start.a).all(|x| *x == 0.0), "{} {shape:?} starts at rest", shipped.name);
        }
    }
}

#[test]
fn a_minimum_jerk_move_has_the_textbook_peaks() {
    let arm = model("serial_arm");
    let motion = Shaped::draw(&arm, Shape::MinimumJerk { period_s: 2.0 }, 2.0, 0.1, 3).unwrap();
    // A move of 0.8·2 s: peak velocity 15/8 and peak acceleration 10/√3 of mean velocity and d/T² [Flash1985].
    let (from, middle, to) = (at(&motion, 0.0), at(&motion, 0.8), at(&motion, 1.6));
    let early = at(&motion, 1.6 * (0.5 - 0.5 / f64::sqrt(3.0)));
    for k in 0..arm.n_act() {
        let way = to.q[k] - from.q[k];
        assert!((middle.v[k] - 1.875 * way / 1.6).abs() < 1e-12 * way.abs().max(1.0), "drive {k}");
        assert!((early.a[k] - 10.0 / f64::sqrt(3.0) * way / 2.56).abs() < 1e-12, "drive {k}");
        assert!((middle.q[k] - 0.5 * (from.q[k] + to.q[k])).abs() < 1e-15);
    }
}

#[test]
fn a_chirp_crosses_zero_as_often_as_its_frequencies_say() {
    let arm = model("serial_arm");
    let motion = Shaped::draw(&arm, Shape::Chirp { low_hz: 1.0, high_hz: 3.0 }, 10.0, 0.01, 1).unwrap();
    let centre = at(&motion, 0.0).q[0];
    let signs: Vec<bool> = (1..10_000).map(|i| at(&motion, 1e-3 * f64::from(i)).q[0] > centre).collect();
    // (1 + 3)/2 Hz for 10 s are 20 cycles, 40 half cycles, 39 changes of sign between them.
    assert_eq!(signs.windows(2).filter(|s| s[0] != s[1]).count(), 39);
}

#[test]
fn playback_of_a_smooth_motion_is_that_motion() {
    let arm = model("serial_arm");
    let drawn = Reference::draw(&arm, &ReferenceOptions { seed: 5, period_s: 5.0, amplitude: 0.5 }).unwrap();
    let time: Vec<f64> = (0..=5000).map(|i| 3.0 + 1e-3 * f64::from(i)).collect();
    let q = (0..arm.n_act()).map(|k| (0..=5000).map(|i| at(&drawn, 1e-3 * f64::from(i)).q[k]).collect()).collect();
    let played = Playback::try_new(&time, q).unwrap();
    assert!((played.duration_s() - 5.0).abs() < 1e-12);
    let (first, second) = derivative_errors(&played, 5.0, 500);
    assert!(first < 1e-6 && second < 1e-3, "{first:e} {second:e}");
    for i in 0..999 {
        let t = 0.005_003_7 * f64::from(i);
        let (want, have) = (at(&drawn, t), at(&played, t));
        for k in 0..arm.n_act() {
            let errors = [(want.q[k], have.q[k]), (want.v[k], have.v[k]), (want.a[k], have.a[k])].map(|(a, b)| (a - b).abs());
            // Spline errors fall with h⁴, h³ and h²: 1e-12, 1e-9, 1e-6 times the fourth derivative (some 100 rad/s⁴).
            assert!(errors[0] < 1e-9 && errors[1] < 1e-6 && errors[2] < 1e-3, "t = {t}: {errors:?}");
        }
    }
    let after = at(&played, 9.0);
    assert!(after.v.iter().chain(&after.a).all(|x| *x == 0.0) && after.q == at(&played, 5.0).q);
}

#[test]
fn a_motion_beyond_a_limit_is_refused_with_joint_value_and_limit() {
    let model = model("five_bar");
    let j = model.actuators[1];
    let limits = model.joints[j].limits;
    let middle: Vec<f64> = model.actuators.iter().map(|&j| 0.5 * (model.joints[j].limits.lower + model.joints[j].limits.upper)).collect();
    let line = |to: f64, seconds: f64| {
        let time: Vec<f64> = (0..=100).map(|i| seconds * 0.01 * f64::from(i)).collect();
        let moved = (0..=100).map(|i| middle[1] + (to - middle[1]) * 0.01 * f64::from(i)).collect();
        Playback::try_new(&time, vec![vec![middle[0]; 101], moved]).unwrap()
    };
    let too_far = check_limits(&model, &line(limits.upper + 0.01, 10.0), 10.0).unwrap_err();
    assert!(
        matches!(&too_far, SimError::OutOfLimits { what: "position", upper, .. } if upper.to_bits() == limits.upper.to_bits()),
        "{too_far}"
    );
    let joint = &model.joints[j].name;
    assert!(too_far.to_string().contains(&format!("position of joint {joint:?} = ")), "{too_far}");
    let seconds = 0.5 * (limits.upper - middle[1]) / limits.velocity;
    let too_fast = check_limits(&model, &line(limits.upper, seconds), seconds).unwrap_err();
    assert!(matches!(&too_fast, SimError::OutOfLimits { what: "velocity", .. }), "{too_fast}");
}

#[test]
fn unusable_motions_are_refused() {
    let arm = model("serial_arm");
    for (shape, duration_s, amplitude) in [
        (Shape::MinimumJerk { period_s: 0.0 }, 5.0, 0.1),
        (Shape::Step { period_s: f64::NAN }, 5.0, 0.1),
        (Shape::Step { period_s: 1e-9 }, 5.0, 0.1),
        (Shape::Chirp { low_hz: -1.0, high_hz: 1.0 }, 5.0, 0.1),
        (Shape::Chirp { low_hz: 0.1, high_hz: 1e9 }, 5.0, 0.1),
        (Shape::Step { period_s: 1.0 }, f64::INFINITY, 0.1),
        (Shape::Step { period_s: 1.0 }, 5.0, 1.1),
    ] {
        let refused = Shaped::draw(&arm, shape, duration_s, amplitude, 1);
        assert!(matches!(refused, Err(SimError::Scenario { .. })), "{shape:?}");
    }
    for (time, q) in
        [(vec![0.0], vec![1.0]), (vec![0.0, 0.0], vec![1.0, 1.0]), (vec![0.0, 1.0], vec![1.0]), (vec![0.0, 1.0], vec![1.0, f64::NAN])]
    {
        assert!(matches!(Playback::try_new(&time, vec![q]), Err(SimError::Scenario { .. })));
    }
    let robot = pkm_robots::find("serial_arm").unwrap();
    let robot = parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).unwrap().robot;
    let one = Playback::try_new(&[0.0, 1.0], vec![vec![0.0, 0.1]]).unwrap();
    let scenario = Scenario { duration_s: 1.0, ..Scenario::default() };
    assert!(matches!(run_along([&robot, &robot], &scenario, &one, &mut |_| {}), Err(SimError::NotTheSameRobot { .. })));
}
