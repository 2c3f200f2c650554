//! The momentum observer: closed form for a constant effort, and on closed loops in motion.

use pkm_ctrl::observer::{MomentumObserver, MomentumObserverConfig};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_dyn::model::{JointKind, ModelBuilder};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters};
use pkm_sim::{Plant, ReducedPlant};
use pkm_tests::closed_loop::{Sines, shipped_robot};

/// A slider of 3 kg on a rising rail with 5 kg of rotor.
fn slider() -> Robot {
    let mut builder = ModelBuilder::new("slider", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default());
    builder.link("slide", InertialParameters { mass: 3.0, ..InertialParameters::default() });
    let rail = Pose::from_xyz_rpy([0.0; 3], [0.0, -0.4, 0.0]);
    builder.moving_joint("x", JointKind::Prismatic, ("base", "slide"), rail, nalgebra::Vector3::x());
    let mut model = builder.build().expect("one joint is a tree");
    model.add_actuator("x", 5.0).expect("it is there");
    Robot::new(model, Vec::new())
}

#[test]
fn a_constant_effort_appears_as_its_closed_form() {
    let (rate, dt, tau_ext) = (12.0, 2e-3, -7.0);
    let config = MomentumObserverConfig { rate: [rate], threshold: [5.0] };
    let observer = MomentumObserver::try_new(slider(), config).expect("good");
    let (mut state, mut q, mut v) = (observer.at_rest(), 0.1, 0.3);
    let weight = 3.0 * 9.81 * math::sin(0.4);
    let mut touched_at = None;
    let _ = observer.step(&mut state, [&[q], &[v], &[0.0]], dt);
    for k in 1..=1000 {
        let tau = 20.0 * math::sin(0.05 * f64::from(k));
        let a = (tau + tau_ext - weight) / 8.0;
        q += dt * v + 0.5 * dt * dt * a;
        v += dt * a;
        let outside = observer.step(&mut state, [&[q], &[v], &[tau]], dt);
        let want = tau_ext * (1.0 - math::exp(-rate * dt * f64::from(k)));
        assert!((outside.tau_ext[0] - want).abs() < 1e-9, "{k}: {outside:?} {want}");
        if outside.is_touched[0] && touched_at.is_none() {
            touched_at = Some(k);
        }
    }
    // 7·(1 − exp(−12·t)) passes 5 at t = ln(3.5)/12.
    let want = math::ln(3.5) / 12.0 / dt;
    assert!(touched_at.is_some_and(|k| (f64::from(k) - want).abs() <= 1.0), "{touched_at:?} {want}");
    observer.reset(&mut state);
    assert!(observer.step(&mut state, [&[q], &[v], &[0.0]], dt).tau_ext[0].abs() < 1e-15);
}

#[test]
fn numbers_that_are_none_hold_the_residual() {
    let config = MomentumObserverConfig { rate: [10.0], threshold: [f64::INFINITY] };
    let observer = MomentumObserver::try_new(slider(), config).expect("good");
    let mut state = observer.at_rest();
    for k in 0..100 {
        let _ = observer.step(&mut state, [&[0.01 * f64::from(k)], &[1.0], &[0.0]], 0.01);
    }
    let before = state.clone();
    let held = observer.step(&mut state, [&[f64::NAN], &[1.0], &[0.0]], 0.01);
    assert!(held.is_held && held.tau_ext[0].is_finite());
    let again = observer.step(&mut before.clone(), [&[1.0], &[1.0], &[0.0]], f64::NAN);
    assert_eq!((held.tau_ext, again.is_held), (again.tau_ext, true));
}

/// Largest error of the residual against its closed form, over the effort, from 1 s of motion under a constant effort of each drive on.
fn on_a_robot<const N: usize>(robot: &Robot, size: f64) -> f64 {
    let motion = Sines::<N>::about_the_middle(robot, 0.03);
    let (dt, rate) = (1e-3, 15.0);
    let config = MomentumObserverConfig { rate: [rate; N], threshold: [f64::INFINITY; N] };
    let observer = MomentumObserver::try_new(robot.clone(), config).expect("good");
    let mut plant = ReducedPlant::try_new(robot.clone(), &motion.at(0.0)[0]).expect("closes");
    let mut data = Data::new(&robot.model);
    let mut state = observer.at_rest();
    let tau_ext: [f64; N] = core::array::from_fn(|k| size * (1.0 - 0.4 * k as f64));
    let mut worst = 0.0_f64;
    for k in 0..2000 {
        let [q_ref, v_ref, a_ref] = motion.at(dt * f64::from(k));
        let (q, v): ([f64; N], [f64; N]) = (core::array::from_fn(|i| plant.position()[i]), core::array::from_fn(|i| plant.velocity()[i]));
        let a: [f64; N] = core::array::from_fn(|i| a_ref[i] + 60.0 * (v_ref[i] - v[i]) + 900.0 * (q_ref[i] - q[i]));
        assert!(pkm_dyn::inverse_dynamics::inverse_dynamics(&robot.model, &mut data, &q, &v, &a).is_closed);
        let tau: [f64; N] = core::array::from_fn(|i| data.tau_act[i]);
        let outside = if k >= 1000 { tau_ext } else { [0.0; N] };
        let all: [f64; N] = core::array::from_fn(|i| tau[i] + outside[i]);
        plant.step(&all, dt).expect("moves");
        let (q, v) = (core::array::from_fn(|i| plant.position()[i]), core::array::from_fn(|i| plant.velocity()[i]));
        let residual = observer.step(&mut state, [&q, &v, &tau], dt);
        if k >= 1000 {
            let grown = 1.0 - math::exp(-rate * dt * f64::from(k - 999));
            worst = (0..N).fold(worst, |top, i| top.max((residual.tau_ext[i] - grown * tau_ext[i]).abs() / size));
        }
    }
    worst
}

/// The shipped robot of that name with friction times `share`.
fn rubbing(name: &str, share: f64) -> Robot {
    let mut model = shipped_robot(name).model;
    for joint in &mut model.joints {
        joint.viscous *= share;
        joint.coulomb *= share;
    }
    Robot::new(model, Vec::new())
}

#[test]
fn on_closed_loops_in_motion_the_residual_follows_efforts_at_the_drives() {
    let pair = |share: f64| [on_a_robot::<2>(&rubbing("five_bar", share), 3.0), on_a_robot::<3>(&rubbing("prs3", share), 80.0)];
    // Without friction the rest is the mean of the Coriolis efforts at both ends of a period.
    let smooth = pair(0.0);
    assert!(smooth.iter().all(|worst| *worst < 5e-3), "{smooth:?}");
    // A drive that sticks is held by any friction up to its Coulomb level: 0.7 of 3 N·m, 32 of 80 N.
    let rough = pair(1.0);
    assert!(rough[0] < 0.7 / 3.0 && rough[1] < 32.0 / 80.0, "{rough:?}");
}
