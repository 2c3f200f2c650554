//! Computed torque on a column with a sliding arm: exact linearisation, saturation that the observer hears of, faults that latch.

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::aba::aba;
use pkm_dyn::effects::Robot;
use pkm_dyn::model::{JointKind, ModelBuilder};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters};

use crate::computed_torque::{ComputedTorque, ComputedTorqueConfig};
use crate::controller::{Command, Controller, Input};
use crate::fault::{Fault, FaultCode};
use crate::observer::{CommandedAcceleration, Discretisation, FirstDifference};

const DT: f64 = 1e-3;
const LIMIT: [f64; 2] = [60.0, 40.0];

fn robot() -> Robot {
    let body = |mass: f64, x: f64| {
        let central = Matrix3::from_diagonal(&Vector3::new(0.02, 0.05, 0.04)) * mass;
        InertialParameters::from_centre_of_mass(mass, Vector3::new(x, 0.03, -0.05), central)
    };
    let mut builder = ModelBuilder::new("column", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default());
    builder.link("column", body(3.0, 0.0)).link("arm", body(1.2, 0.25));
    let tilted = Pose::from_xyz_rpy([0.1, 0.0, 0.5], [0.3, -0.4, 0.2]);
    builder.moving_joint("turn", JointKind::Revolute, ("base", "column"), Pose::identity(), Vector3::z());
    builder.moving_joint("slide", JointKind::Prismatic, ("column", "arm"), tilted, Vector3::x());
    let mut model = builder.build().expect("two joints are a tree");
    model.add_actuator("turn", 0.0).expect("it is there");
    model.add_actuator("slide", 0.0).expect("it is there");
    Robot::new(model, alloc::vec::Vec::new())
}

type Law = ComputedTorque<2, CommandedAcceleration<2>>;

fn law() -> Law {
    let observer = CommandedAcceleration::try_new([60.0; 2], Discretisation::ZeroOrderHold).expect("positive");
    ComputedTorque::try_new(robot(), observer, ComputedTorqueConfig::with_bandwidth(20.0, LIMIT)).expect("good")
}

/// Moves the robot by one period in ten steps under `tau`.
fn advance(data: &mut Data, q: &mut [f64; 2], v: &mut [f64; 2], tau: [f64; 2]) {
    let robot = robot();
    for _ in 0..10 {
        let a = aba(&robot.model, data, q, v, &tau);
        let a = [a[0], a[1]];
        for k in 0..2 {
            q[k] += 0.1 * DT * v[k] + 0.005 * DT * DT * a[k];
            v[k] += 0.1 * DT * a[k];
        }
    }
}

/// Largest error of the velocity estimate over a step of the reference, and how many commands were clipped.
fn step_of_the_reference(law: &Law, size: f64) -> (f64, usize, [f64; 2]) {
    let mut data = Data::new(&robot().model);
    let (mut q, mut v) = ([0.2, 0.1], [0.0; 2]);
    let (mut state, mut worst, mut clipped) = (law.at_rest(), 0.0_f64, 0);
    for _ in 0..1500 {
        let command = law.step(&mut state, &Input { q_ref: [0.2 + size, 0.1 - 0.3 * size], ..Input::standing(q, DT) });
        assert!(!command.health.is_faulted);
        worst = (0..2).fold(worst, |top, k| top.max((state.v_hat[k] - v[k]).abs()));
        clipped += usize::from(command.health.is_saturated);
        advance(&mut data, &mut q, &mut v, command.tau);
    }
    (worst, clipped, q)
}

#[test]
fn a_step_is_followed_by_uncoupled_critically_damped_errors() {
    let law = law();
    let mut data = Data::new(&robot().model);
    let (mut q, mut v, mut state) = ([0.2, 0.1], [0.0; 2], law.at_rest());
    for _ in 0..100 {
        let command = law.step(&mut state, &Input { q_ref: [0.21, 0.1], ..Input::standing(q, DT) });
        advance(&mut data, &mut q, &mut v, command.tau);
    }
    // e = 0.01·(1 + w·t)·exp(−w·t) at w·t = 2; the slide does not hear of the turn.
    let want = 0.01 * 3.0 * pkm_dyn::math::exp(-2.0);
    assert!((0.21 - q[0] - want).abs() < 1e-4 && (q[1] - 0.1).abs() < 2e-5, "{q:?} {want}");
}

#[test]
fn the_observer_hears_of_saturation() {
    let (worst, clipped, q) = step_of_the_reference(&law(), 0.9);
    assert!(clipped > 50, "{clipped}");
    assert!(worst < 0.02, "{worst}");
    assert!((q[0] - 1.1).abs() < 1e-3 && (q[1] + 0.17).abs() < 1e-3, "{q:?}");
}

#[test]
fn at_rest_on_the_reference_it_sends_the_weight() {
    let law = law();
    let command = law.step(&mut law.at_rest(), &Input::standing([0.4, -0.1], DT));
    let weight = pkm_dyn::rnea::rnea(&robot().model, &mut Data::new(&robot().model), &[0.4, -0.1], &[0.0; 2], &[0.0; 2]).to_vec();
    assert!((0..2).all(|k| (command.tau[k] - weight[k]).abs() < 1e-12), "{command:?} {weight:?}");
}

#[test]
fn not_a_number_latches_a_fault_and_the_weight_at_the_last_good_pose_stays_carried() {
    let law = law();
    let mut state = law.at_rest();
    let good = Input::standing([0.4, -0.1], DT);
    let weight = law.step(&mut state, &good).tau;
    for bad in [Input { q_meas: [0.4, f64::NAN], ..good }, good, Input { a_ref: [f64::INFINITY, 0.0], ..good }] {
        let command = law.step(&mut state, &bad);
        assert!(command.health.is_faulted && (0..2).all(|k| (command.tau[k] - weight[k]).abs() < 1e-12), "{command:?}");
    }
    let first = law.step(&mut law.at_rest(), &Input { dt: -0.5, ..good });
    let period = Fault { code: FaultCode::Period, drive: 0, value: -0.5, limit: 0.0 };
    assert_eq!(first, Command::faulted([0.0; 2], Some(period)));
    let overflow = law.step(&mut law.at_rest(), &Input { q_ref: [1e308, -1e308], v_ref: [-1e308, 0.0], ..good });
    assert!(overflow.health.is_faulted && overflow.tau.iter().all(|x| x.is_finite()));
}

#[test]
fn robots_and_numbers_that_do_not_fit_are_refused() {
    let config = ComputedTorqueConfig::with_bandwidth(20.0, [1.0]);
    let error = ComputedTorque::<1, _>::try_new(robot(), FirstDifference, config).expect_err("two drives");
    assert_eq!(error.value.to_bits(), 2.0_f64.to_bits());
    let good = ComputedTorqueConfig::with_bandwidth(20.0, LIMIT);
    for bad in [
        ComputedTorqueConfig { kp: [-1.0, 1.0], ..good },
        ComputedTorqueConfig { tau_limit: [1.0, 0.0], ..good },
        ComputedTorqueConfig { creep: f64::NAN, ..good },
        ComputedTorqueConfig { misfit_limit: 0.0, ..good },
    ] {
        assert!(ComputedTorque::try_new(robot(), FirstDifference, bad).is_err(), "{bad:?}");
    }
}
