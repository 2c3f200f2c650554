//! The nonlinear model-based observer on a closed loop that is pushed by efforts nobody computed accelerations for.

use pkm_ctrl::observer::{AlphaBeta, Discretisation, ModelBased, Sample, VelocityObserver};
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::math;
use pkm_dyn::{Data, Model};
use pkm_sim::{Plant, ReducedPlant};
use pkm_tests::closed_loop::{Sines, shipped_robot};

const DT: f64 = 1e-3;

/// Largest errors of the velocities of the five-bar from 0.5 s on, over the largest velocity, of two observers that start unaware of its
/// motion, positions exact.
fn errors<A: VelocityObserver<2>, B: VelocityObserver<2>>(robot: &Robot, a: &A, b: &B) -> [f64; 2] {
    let start = Sines::<2>::about_the_middle(robot, 0.1).at(0.0)[0];
    let mut plant = ReducedPlant::try_new(robot.clone(), &start).expect("closes");
    plant.set_velocity(&[0.6, -0.4]);
    let (mut in_a, mut in_b) = (a.at_rest(), b.at_rest());
    a.reset_to(&mut in_a, &start, &[0.0; 2]);
    b.reset_to(&mut in_b, &start, &[0.0; 2]);
    let (mut data, mut tau, mut worst, mut top) = (Data::new(&robot.model), [0.0; 2], [0.0_f64; 2], 0.0_f64);
    for k in 0..1500 {
        let (q, v) = ([plant.position()[0], plant.position()[1]], [plant.velocity()[0], plant.velocity()[1]]);
        let sample = Sample { q_meas: q, a_cmd: [0.0; 2], tau, dt: DT };
        let got = [a.step(&mut in_a, &sample), b.step(&mut in_b, &sample)];
        for i in 0..2 {
            top = top.max(v[i].abs());
            for (worst, got) in worst.iter_mut().zip(got) {
                *worst = if k >= 500 { worst.max((got[i] - v[i]).abs()) } else { *worst };
            }
        }
        // A spring to the start and the weight, shaken: efforts, not accelerations, are what is known.
        assert!(inverse_dynamics(&robot.model, &mut data, &q, &[0.0; 2], &[0.0; 2]).is_closed);
        let shake = 0.8 * math::sin(0.02 * f64::from(k));
        tau = [data.tau_act[0] + 20.0 * (start[0] - q[0]) + shake, data.tau_act[1] + 20.0 * (start[1] - q[1]) - shake];
        for _ in 0..4 {
            plant.step(&tau, 0.25 * DT).expect("moves");
        }
    }
    worst.map(|worst| worst / top)
}

fn without_dry_friction() -> Robot {
    let mut model: Model = shipped_robot("five_bar").model;
    for joint in &mut model.joints {
        joint.coulomb = 0.0;
    }
    Robot::new(model, Vec::new())
}

#[test]
fn knowing_the_robot_and_its_efforts_it_is_many_times_nearer_than_one_of_its_bandwidth_that_does_not() {
    let robot = without_dry_friction();
    let known = ModelBased::try_new(robot.clone(), [30.0; 2], Discretisation::ZeroOrderHold).expect("two drives");
    let [with_model, without] = errors(&robot, &known, &AlphaBeta::try_new([30.0; 2]).expect("positive"));
    assert!(with_model < 2e-3 && without > 20.0 * with_model, "{with_model} {without}");
}

#[test]
fn a_robot_with_other_drives_is_refused() {
    assert!(ModelBased::<3>::try_new(without_dry_friction(), [30.0; 3], Discretisation::Euler).is_err());
}
