//! Identities that hold for every robot, on robots drawn at random: 128 trees or loop mechanisms per property, always the same ones.
//!
//! Not in here: numbers of other programs (`against_pinocchio.rs`), effects (`catalogue.rs`).

use nalgebra::{DMatrix, DVector, Vector3};
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, inverse_dynamics};
use pkm_dyn::kinematics::world_velocities;
use pkm_dyn::loops::{assemble, loop_drift, loop_gap, solve_positions, walk_to};
use pkm_dyn::model::{JointKind, LoopClosure, ModelBuilder};
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::rnea::rnea;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters, Model, math};
use pkm_tests::{
    Draw, Motion, SHAPES, Shape, derivative, derivative_of_vector, drawn_loops, drawn_tree, energy, parameters, relative_error,
};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

fn config() -> Config {
    Config { cases: 128, failure_persistence: None, rng_seed: RngSeed::Fixed(0x706B_6D21), ..Config::default() }
}

/// Step of the nine-point differences `[s]` or `[m | rad]`: truncation and rounding are both near 1e-12 for motions of a few hertz.
const STEP: f64 = 5e-3;

/// A tree with a state.
fn tree() -> impl Strategy<Value = (Model, [Vec<f64>; 3])> {
    (1_usize..9, any::<u64>()).prop_map(|(n, seed)| {
        let mut draw = Draw::new(seed);
        let model = drawn_tree(n, &mut draw);
        let state = [draw.vector(n, -2.0..2.0), draw.vector(n, -3.0..3.0), draw.vector(n, -8.0..8.0)];
        (model, state)
    })
}

/// A loop mechanism and the rest of its stream of numbers.
fn loops() -> impl Strategy<Value = (Model, Draw)> {
    (0_usize..8, any::<u64>()).prop_map(|(shape, seed)| {
        let mut draw = Draw::new(seed);
        // Six in eight are spatial: only they have every kind of row.
        (drawn_loops(SHAPES[shape.min(2)], &mut draw), draw)
    })
}

/// A loop mechanism on a motion that starts at its assembly.
fn moving_loops() -> impl Strategy<Value = (Model, Motion, Draw)> {
    loops().prop_map(|(model, mut draw)| {
        let motion = Motion::about_assembly(&model, 0.1, &mut draw);
        (model, motion, draw)
    })
}

/// Data on the motion at time `t`, reached in small parts; `None` where the motion comes near a singular pose.
fn arrive(model: &Model, motion: &Motion, t: f64) -> Option<Data> {
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed, "drawn closed");
    let [q, v, a] = motion.at(t);
    let walk = walk_to(model, &mut data, &q);
    let here = closed_loop_motion(model, &mut data, &q, &v, &a);
    (walk.is_closed && here.is_closed && here.pivot_ratio > 0.01).then_some(data)
}

fn mass_matrix(model: &Model, data: &mut Data, q: &[f64]) -> DMatrix<f64> {
    let n = model.nv();
    let zero = vec![0.0; n];
    let weight = rnea(model, data, q, &zero, &zero).to_vec();
    let mut m = DMatrix::zeros(n, n);
    for k in 0..n {
        let mut unit = zero.clone();
        unit[k] = 1.0;
        for (i, tau) in rnea(model, data, q, &zero, &unit).iter().enumerate() {
            m[(i, k)] = tau - weight[i];
        }
    }
    m
}

/// Orthogonal projector onto the motions that keep the loops closed: rows of the Jacobian made orthonormal, each twice.
fn null_projector(j: &DMatrix<f64>) -> DMatrix<f64> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for row in j.row_iter() {
        let mut left = row.transpose();
        for _ in 0..2 {
            for b in &basis {
                left -= b * b.dot(&left);
            }
        }
        if left.norm() > 1e-9 * row.norm() {
            basis.push(left.normalize());
        }
    }
    basis.iter().fold(DMatrix::identity(j.ncols(), j.ncols()), |null, b| null - b * b.transpose())
}

fn is_symmetric_positive_definite(m: &DMatrix<f64>) -> bool {
    (m - m.transpose()).amax() < 1e-11 * m.amax().max(1.0) && m.clone().cholesky().is_some()
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn regressor_times_parameters_equals_rnea((model, [q, v, a]) in tree()) {
        let mut data = Data::new(&model);
        let y = joint_torque_regressor(&model, &mut data, &q, &v, &a).clone();
        let mut linear = y * parameters(&model);
        for (k, joint) in model.joints.iter().enumerate() {
            linear[k] += joint.armature * a[k];
        }
        let tau = rnea(&model, &mut data, &q, &v, &a);
        prop_assert!(relative_error(linear.as_slice(), tau, 1.0) < 1e-13);
    }

    #[test]
    fn mass_matrix_is_symmetric_positive_definite_and_gives_the_kinetic_energy((model, [q, v, _]) in tree()) {
        let mut data = Data::new(&model);
        let m = mass_matrix(&model, &mut data, &q);
        prop_assert!(is_symmetric_positive_definite(&m));
        let speed = DVector::from_vec(v.clone());
        let kinetic = 0.5 * speed.dot(&(&m * &speed));
        let rest = vec![0.0; model.nv()];
        let wanted = energy(&model, &mut data, &q, &v) - energy(&model, &mut data, &q, &rest);
        prop_assert!((kinetic - wanted).abs() < 1e-11 * wanted.abs().max(1.0), "{kinetic} J, not {wanted} J");
    }

    #[test]
    fn a_fully_driven_tree_needs_what_rnea_says((model, [q, v, a]) in tree()) {
        let mut data = Data::new(&model);
        // The drives' order is the file's, the tree's is parents first.
        let pick = |x: &[f64]| -> Vec<f64> { model.actuators.iter().map(|&j| x[j]).collect() };
        prop_assert!(inverse_dynamics(&model, &mut data, &pick(&q), &pick(&v), &pick(&a)).is_closed);
        let got = data.tau_act.clone();
        prop_assert!(relative_error(&got, &pick(rnea(&model, &mut data, &q, &v, &a)), 1.0) < 1e-14);
    }

    #[test]
    fn power_into_a_tree_is_the_rate_of_its_energy((model, [q, v, a]) in tree()) {
        let mut data = Data::new(&model);
        let power: f64 = rnea(&model, &mut data, &q, &v, &a).iter().zip(&v).map(|(f, v)| f * v).sum();
        let rate = derivative(1e-3, |t| {
            let at: Vec<f64> = (0..q.len()).map(|k| q[k] + v[k] * t + 0.5 * a[k] * t * t).collect();
            let speed: Vec<f64> = (0..q.len()).map(|k| v[k] + a[k] * t).collect();
            energy(&model, &mut data, &at, &speed)
        });
        prop_assert!((power - rate).abs() < 1e-9 * power.abs().max(100.0), "{power} W, not {rate} W");
    }

    #[test]
    fn gap_jacobian_is_the_derivative_of_the_gap((model, mut draw) in loops()) {
        let mut data = Data::new(&model);
        // Off the assembly: the Jacobian must be exact for open loops too, or Newton crawls.
        let q: Vec<f64> = model.assembly.iter().map(|x| x + draw.uniform(-0.1..0.1)).collect();
        loop_gap(&model, &mut data, &q);
        let jacobian = data.loop_jacobian.clone();
        for k in 0..model.nv() {
            let column = derivative_of_vector(STEP, model.n_constraints(), |x| {
                let mut at = q.clone();
                at[k] += x;
                loop_gap(&model, &mut data, &at);
                data.loop_gap.clone()
            });
            prop_assert!(relative_error(&column, jacobian.column(k).as_slice(), 1.0) < 1e-9, "{} column {k}", model.name);
        }
    }

    #[test]
    fn gap_drift_is_the_derivative_of_jacobian_times_velocity((model, mut draw) in loops()) {
        let mut data = Data::new(&model);
        let q: Vec<f64> = model.assembly.iter().map(|x| x + draw.uniform(-0.1..0.1)).collect();
        let v = draw.vector(model.nv(), -1.0..1.0);
        loop_gap(&model, &mut data, &q);
        world_velocities(&model, &mut data, &v);
        loop_drift(&model, &mut data);
        let drift = data.loop_drift.clone();
        let speed = DVector::from_vec(v.clone());
        let want = derivative_of_vector(STEP, model.n_constraints(), |t| {
            let at: Vec<f64> = q.iter().zip(&v).map(|(q, v)| q + v * t).collect();
            loop_gap(&model, &mut data, &at);
            (&data.loop_jacobian * &speed).as_slice().to_vec()
        });
        prop_assert!(relative_error(&drift, &want, 1.0) < 1e-9, "{}: {drift:?}, not {want:?}", model.name);
    }

    #[test]
    fn reduction_velocities_and_accelerations_keep_the_loops_closed((model, motion, _) in moving_loops()) {
        let Some(data) = arrive(&model, &motion, 0.4) else { return Err(TestCaseError::reject("near a singular pose")) };
        let j = &data.loop_jacobian;
        prop_assert!((j * &data.reduction).amax() < 1e-11);
        prop_assert!((j * DVector::from_column_slice(&data.v)).amax() < 1e-11);
        let gap = j * DVector::from_column_slice(&data.a) + DVector::from_column_slice(&data.loop_drift);
        prop_assert!(gap.amax() < 1e-10, "{gap}");
        let through_g = &data.reduction * DVector::from_column_slice(&motion.at(0.4)[1]);
        prop_assert!(relative_error(through_g.as_slice(), &data.v, 1.0) < 1e-11);
    }

    #[test]
    fn loops_stay_closed_along_a_motion_that_is_solved((model, motion, _) in moving_loops()) {
        let mut data = Data::new(&model);
        prop_assert!(assemble(&model, &mut data).is_closed);
        for k in 0..200 {
            let closure = solve_positions(&model, &mut data, &motion.at(0.01 * f64::from(k))[0]);
            if closure.pivot_ratio < 0.01 {
                return Err(TestCaseError::reject("near a singular pose"));
            }
            prop_assert!(closure.is_closed && closure.gap < 1e-10, "{closure:?}");
            prop_assert!(closure.iterations <= 4, "Newton crawls: {closure:?}");
        }
    }

    #[test]
    fn loops_stay_closed_along_a_motion_that_is_integrated((model, motion, _) in moving_loops()) {
        let Some(mut data) = arrive(&model, &motion, 0.0) else { return Err(TestCaseError::reject("near a singular pose")) };
        let gap = integrate(&model, &mut data, &motion);
        prop_assert!(gap < 1e-10, "{}: {gap}", model.name);
    }

    #[test]
    fn solved_velocities_and_accelerations_are_derivatives_in_time((model, motion, _) in moving_loops()) {
        let t = 0.3;
        let Some(data) = arrive(&model, &motion, t) else { return Err(TestCaseError::reject("near a singular pose")) };
        let mut at = data.clone();
        let mut solved = |dt: f64| {
            let [q, v, a] = motion.at(t + dt);
            assert!(closed_loop_motion(&model, &mut at, &q, &v, &a).is_closed);
            (at.q.clone(), at.v.clone())
        };
        let v = derivative_of_vector(STEP, model.nv(), |dt| solved(dt).0);
        prop_assert!(relative_error(&data.v, &v, 1.0) < 1e-7);
        let a = derivative_of_vector(STEP, model.nv(), |dt| solved(dt).1);
        prop_assert!(relative_error(&data.a, &a, 1.0) < 1e-7);
    }

    #[test]
    fn closed_loop_regressor_times_parameters_equals_inverse_dynamics((model, motion, _) in moving_loops()) {
        let Some(mut data) = arrive(&model, &motion, 0.6) else { return Err(TestCaseError::reject("near a singular pose")) };
        let [q, v, a] = motion.at(0.6);
        let mut linear = actuated_regressor(&model, &mut data) * parameters(&model);
        for (k, &j) in model.actuators.iter().enumerate() {
            linear[k] += model.joints[j].armature * a[k];
        }
        prop_assert!(inverse_dynamics(&model, &mut data, &q, &v, &a).is_closed);
        prop_assert!(relative_error(linear.as_slice(), &data.tau_act, 1.0) < 1e-12);
    }

    #[test]
    fn drives_feel_the_tree_through_the_null_space_of_the_loops((model, motion, _) in moving_loops()) {
        let Some(mut data) = arrive(&model, &motion, 0.5) else { return Err(TestCaseError::reject("near a singular pose")) };
        let (q, v, a) = (data.q.clone(), data.v.clone(), data.a.clone());
        let [q_act, v_act, a_act] = motion.at(0.5);
        prop_assert!(inverse_dynamics(&model, &mut data, &q_act, &v_act, &a_act).is_closed);
        let got = data.tau_act.clone();
        // G once more, by an orthogonal null space instead of elimination.
        let null = null_projector(&data.loop_jacobian);
        let driven = null.select_rows(&model.actuators);
        let inverse = (&driven * driven.transpose()).try_inverse().expect("the drives determine the motion");
        let g = &null * driven.transpose() * inverse;
        let tau = DVector::from_column_slice(rnea(&model, &mut data, &q, &v, &a));
        prop_assert!(relative_error(&got, g.tr_mul(&tau).as_slice(), 1.0) < 1e-9);
    }

    #[test]
    fn closed_loop_inertia_is_symmetric_positive_definite((model, motion, _) in moving_loops()) {
        let Some(mut data) = arrive(&model, &motion, 0.2) else { return Err(TestCaseError::reject("near a singular pose")) };
        let (q, n) = (motion.at(0.2)[0].clone(), model.n_act());
        let zero = vec![0.0; n];
        prop_assert!(inverse_dynamics(&model, &mut data, &q, &zero, &zero).is_closed);
        let weight = data.tau_act.clone();
        let mut m = DMatrix::zeros(n, n);
        for k in 0..n {
            let mut unit = zero.clone();
            unit[k] = 1.0;
            prop_assert!(inverse_dynamics(&model, &mut data, &q, &zero, &unit).is_closed);
            for (i, w) in weight.iter().enumerate() {
                m[(i, k)] = data.tau_act[i] - w;
            }
        }
        prop_assert!(is_symmetric_positive_definite(&m), "{m}");
    }

    #[test]
    fn power_of_the_drives_is_the_rate_of_the_loop_mechanisms_energy((model, motion, _) in moving_loops()) {
        let t = 0.7;
        let Some(mut data) = arrive(&model, &motion, t) else { return Err(TestCaseError::reject("near a singular pose")) };
        let [q, v, a] = motion.at(t);
        prop_assert!(inverse_dynamics(&model, &mut data, &q, &v, &a).is_closed);
        let power: f64 = data.tau_act.iter().zip(&v).map(|(f, v)| f * v).sum();
        let mut scratch = Data::new(&model);
        let rate = derivative(STEP, |dt| {
            let [q, v, a] = motion.at(t + dt);
            assert!(closed_loop_motion(&model, &mut data, &q, &v, &a).is_closed);
            energy(&model, &mut scratch, &data.q, &data.v)
        });
        prop_assert!((power - rate).abs() < 1e-7 * power.abs().max(1.0), "{power} W, not {rate} W");
    }
}

/// Largest gap after integrating the tree velocities `G·v_act` for 0.2 s by Runge-Kutta, without ever solving the loops for positions.
fn integrate(model: &Model, data: &mut Data, motion: &Motion) -> f64 {
    let h = 2e-3;
    let mut q = data.q.clone();
    for step in 0..100 {
        let t = h * f64::from(step);
        let k1 = slope(model, data, motion, t, &q);
        let k2 = slope(model, data, motion, t + 0.5 * h, &along(&q, &k1, 0.5 * h));
        let k3 = slope(model, data, motion, t + 0.5 * h, &along(&q, &k2, 0.5 * h));
        let k4 = slope(model, data, motion, t + h, &along(&q, &k3, h));
        for i in 0..q.len() {
            q[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    loop_gap(model, data, &q);
    data.loop_gap.iter().fold(0.0, |top, g| top.max(g.abs()))
}

fn along(q: &[f64], k: &[f64], h: f64) -> Vec<f64> {
    q.iter().zip(k).map(|(q, k)| q + h * k).collect()
}

fn slope(model: &Model, data: &mut Data, motion: &Motion, t: f64, q: &[f64]) -> Vec<f64> {
    data.q.copy_from_slice(q);
    // Factors the Jacobian at the true positions; the correction it makes to q is far below the integrator's error.
    let drives: Vec<f64> = model.actuators.iter().map(|&j| q[j]).collect();
    assert!(solve_positions(model, data, &drives).is_closed);
    (&data.reduction * DVector::from_column_slice(&motion.at(t)[1])).as_slice().to_vec()
}

#[test]
fn drawn_mechanisms_cover_redundant_rows_turned_pins_and_single_rotations() {
    let (mut redundant, mut turned, mut single, mut drives) = (0, 0, 0, 0);
    for seed in 0..60 {
        let mut draw = Draw::new(seed);
        let model = drawn_loops(SHAPES[usize::try_from(seed % 3).expect("small")], &mut draw);
        let mut data = Data::new(&model);
        let closure = assemble(&model, &mut data);
        redundant += usize::from(closure.rank < model.n_constraints());
        turned += usize::from(seed % 3 == 1 && model.loops[0].constrain == [true, true, true, true, true, false]);
        single += model.loops.iter().filter(|l| l.n_rows() == 1).count();
        drives = drives.max(model.n_act());
    }
    assert!(redundant >= 15 && turned >= 15 && single >= 3 && drives >= 4, "{redundant} {turned} {single} {drives}");
    assert_eq!(SHAPES[0], Shape::Planar);
}

/// A crank that drives a slider through a rod; the pin that closes the loop turns all the way round with the crank.
fn crank_and_slider() -> Model {
    let mut builder = ModelBuilder::new("crank", [0.0, -9.81, 0.0]);
    let mut draw = Draw::new(1);
    builder.link("base", InertialParameters::default());
    // In no plane of the root: rotations then carry rounding errors in every entry.
    let tilt = Pose::from_xyz_rpy([0.1, 0.2, 0.3], [0.4, -0.7, 1.1]);
    for name in ["crank", "slider", "rod"] {
        builder.link(name, draw.body());
    }
    builder.moving_joint("turn", JointKind::Revolute, ("base", "crank"), tilt, Vector3::z());
    builder.moving_joint("slide", JointKind::Prismatic, ("base", "slider"), tilt, Vector3::x());
    builder.moving_joint("swing", JointKind::Revolute, ("slider", "rod"), Pose::identity(), Vector3::z());
    let mut model = builder.build().expect("a tree");
    let a = model.frame_on("pin", "crank", Pose::from_xyz_rpy([0.2, 0.0, 0.0], [0.0; 3])).expect("crank");
    let b = model.frame_on("pin", "rod", Pose::from_xyz_rpy([-0.5, 0.0, 0.0], [0.0; 3])).expect("rod");
    model.add_loop(LoopClosure { name: "pin".to_string(), a, b, constrain: [true, true, true, true, true, false] }).expect("one loop");
    model.set_assembly("slide", 0.7).expect("slide");
    model.add_actuator("turn", 0.1).expect("turn");
    model
}

#[test]
fn a_pin_passes_half_a_turn_in_every_revolution() {
    let model = crank_and_slider();
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    // Steps that meet half a turn exactly and from close by.
    let near = [-1e-3, -1e-5, -1e-7, -1e-9, 0.0, 1e-9, 1e-7, 1e-5, 1e-3].map(|d| core::f64::consts::PI + d);
    let there = (1..60).map(|k| 0.05 * f64::from(k));
    let back = (64..260).map(|k| 0.05 * f64::from(k));
    for turn in there.chain(near).chain(back) {
        let closure = inverse_dynamics(&model, &mut data, &[turn], &[2.0], &[1.0]);
        assert!(closure.is_closed && closure.iterations <= 4, "{turn} rad: {closure:?}");
        let slide = 0.2 * math::cos(turn) + math::sqrt(0.25 - 0.04 * math::sin(turn) * math::sin(turn));
        assert!((data.q[1] - slide).abs() < 1e-10, "{turn} rad: slider at {} m, not {slide} m", data.q[1]);
        assert!(data.tau_act[0].is_finite() && data.a.iter().all(|a| a.abs() < 50.0));
    }
}
