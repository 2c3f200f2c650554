//! Identities of dynamics on robots drawn at random: trees with joints of every kind, and loop mechanisms. The same ones every time.
//!
//! Not in here: closure and reduction (`identities.rs`), numbers of other programs (`against_pinocchio.rs`).

use nalgebra::{DVector, Matrix3xX, Vector3};
use pkm_dyn::aba::aba;
use pkm_dyn::configuration::integrate;
use pkm_dyn::constrained::{Stabilisation, forward_dynamics, project, reduced_mass_matrix, stabilised_forward_dynamics};
use pkm_dyn::crba::crba;
use pkm_dyn::energy::{center_of_mass, kinetic_energy, potential_energy};
use pkm_dyn::inverse_dynamics::{
    closed_loop_motion, friction_regressor, inverse_dynamics, inverse_dynamics_at, loop_efforts, project_efforts,
};
use pkm_dyn::jacobian::{Reference, frame_jacobian, frame_jacobian_time_variation, jacobian_center_of_mass, joint_jacobians, motion_of};
use pkm_dyn::kinematics::{forward_kinematics, frame_acceleration, frame_pose, frame_velocity, world_accelerations, world_velocities};
use pkm_dyn::loops::{Choice, assemble, distribute, drive_jacobian, internal_efforts, joint_wrenches, loop_drift, loop_gap, loop_wrench};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::regressor::{joint_torque_regressor, kinetic_energy_regressor, potential_energy_regressor};
use pkm_dyn::rnea::{generalized_gravity, nle, rnea};
use pkm_dyn::spatial::Force;
use pkm_dyn::{Data, Model, math};
use pkm_tests::{
    Draw, Motion, SHAPES, derivative, derivative_of_vector, drawn_loops, drawn_mixed_tree, energy, parameters, relative_error,
};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

fn config() -> Config {
    Config { cases: 96, failure_persistence: None, rng_seed: RngSeed::Fixed(0x706B_6D22), ..Config::default() }
}

/// A tree with joints of every kind, and a state.
fn tree() -> impl Strategy<Value = (Model, [Vec<f64>; 3], Draw)> {
    (1_usize..7, any::<u64>()).prop_map(|(n, seed)| {
        let mut draw = Draw::new(seed);
        let model = drawn_mixed_tree(n, &mut draw);
        let n = model.nv();
        let state = [draw.vector(n, -1.2..1.2), draw.vector(n, -2.0..2.0), draw.vector(n, -5.0..5.0)];
        (model, state, draw)
    })
}

/// A loop mechanism on a motion that starts at its assembly, and its data at 0.4 s.
fn moving_loops() -> impl Strategy<Value = (Model, Motion, Data, Draw)> {
    (0_usize..8, any::<u64>()).prop_filter_map("near a singular pose", |(shape, seed)| {
        let mut draw = Draw::new(seed);
        let model = drawn_loops(SHAPES[shape.min(2)], &mut draw);
        let motion = Motion::about_assembly(&model, 0.1, &mut draw);
        let mut data = Data::new(&model);
        assert!(assemble(&model, &mut data).is_closed, "drawn closed");
        let [q, v, a] = motion.at(0.4);
        let walk = pkm_dyn::loops::walk_to(&model, &mut data, &q);
        let here = inverse_dynamics(&model, &mut data, &q, &v, &a);
        (walk.is_closed && here.is_closed && here.pivot_ratio > 0.01).then_some((model, motion, data, draw))
    })
}

/// Tree coordinates along the motion with acceleration `a` from (`q`, `v`), by the exponential of each joint.
fn along(model: &Model, [q, v, a]: &[Vec<f64>; 3], t: f64) -> (Vec<f64>, Vec<f64>) {
    // Exact to third order in t for joints that turn; the derivatives at t = 0 that the tests take need the second.
    let mut at = q.clone();
    let step: Vec<f64> = v.iter().zip(a).map(|(v, a)| v * t + 0.5 * a * t * t).collect();
    integrate(model, &mut at, &step);
    (at, v.iter().zip(a).map(|(v, a)| v + a * t).collect())
}

fn some_frame(model: &Model, draw: &mut Draw) -> FrameOnBody {
    let link = model.links[model.links.len() - 1].name.clone();
    model.frame_on("test", &link, draw.pose(0.4)).expect("the last link")
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn aba_undoes_rnea((model, [q, v, a], _) in tree()) {
        let mut data = Data::new(&model);
        let tau = rnea(&model, &mut data, &q, &v, &a).to_vec();
        let got = aba(&model, &mut data, &q, &v, &tau);
        prop_assert!(relative_error(got, &a, 1.0) < 1e-8, "{got:?}, not {a:?}");
    }

    #[test]
    fn mass_matrix_and_bias_are_what_rnea_says((model, [q, v, a], _) in tree()) {
        let mut data = Data::new(&model);
        let m = crba(&model, &mut data, &q).clone();
        prop_assert!((&m - m.transpose()).amax() <= 0.0);
        prop_assert!(m.clone().cholesky().is_some());
        let bias = DVector::from_column_slice(nle(&model, &mut data, &q, &v));
        let tau = &m * DVector::from_column_slice(&a) + bias;
        prop_assert!(relative_error(tau.as_slice(), rnea(&model, &mut data, &q, &v, &a), 1.0) < 1e-12);
        let zero = vec![0.0; model.nv()];
        let weight = generalized_gravity(&model, &mut data, &q).to_vec();
        prop_assert!(relative_error(&weight, rnea(&model, &mut data, &q, &zero, &zero), 1.0) <= 0.0);
    }

    #[test]
    fn power_into_a_tree_is_the_rate_of_its_energy((model, state, _) in tree()) {
        let mut data = Data::new(&model);
        let [q, v, a] = &state;
        let power: f64 = rnea(&model, &mut data, q, v, a).iter().zip(v).map(|(f, v)| f * v).sum();
        let rate = derivative(1e-3, |t| {
            let (q, v) = along(&model, &state, t);
            kinetic_energy(&model, &mut data, &q, &v) + potential_energy(&model, &mut data, &q)
        });
        prop_assert!((power - rate).abs() < 1e-8 * power.abs().max(100.0), "{power} W, not {rate} W");
    }

    #[test]
    fn regressor_times_parameters_equals_rnea((model, [q, v, a], _) in tree()) {
        let mut data = Data::new(&model);
        let y = joint_torque_regressor(&model, &mut data, &q, &v, &a).clone();
        let mut linear = y * parameters(&model);
        for (k, joint) in model.joints.iter().enumerate() {
            linear[k] += joint.armature * a[k];
        }
        prop_assert!(relative_error(linear.as_slice(), rnea(&model, &mut data, &q, &v, &a), 1.0) < 1e-12);
    }

    #[test]
    fn energies_are_linear_in_the_parameters((model, [q, v, _], _) in tree()) {
        let mut data = Data::new(&model);
        let theta = parameters(&model);
        let mut row = vec![0.0; theta.len()];
        let dot = |row: &[f64]| row.iter().zip(theta.iter()).map(|(y, p)| y * p).sum::<f64>();
        kinetic_energy_regressor(&model, &mut data, &q, &v, &mut row);
        let rotors: f64 = model.joints.iter().zip(&v).map(|(j, v)| 0.5 * j.armature * v * v).sum();
        let kinetic = kinetic_energy(&model, &mut data, &q, &v);
        prop_assert!((dot(&row) + rotors - kinetic).abs() < 1e-12 * kinetic.max(1.0));
        potential_energy_regressor(&model, &mut data, &q, &mut row);
        let potential = potential_energy(&model, &mut data, &q);
        prop_assert!((dot(&row) - potential).abs() < 1e-12 * potential.abs().max(1.0));
        prop_assert!((energy(&model, &mut data, &q, &v) - kinetic - potential).abs() < 1e-11 * (kinetic + potential.abs()).max(1.0));
    }

    #[test]
    fn frame_jacobians_give_velocities_and_their_rates_accelerations((model, state, mut draw) in tree()) {
        let mut data = Data::new(&model);
        let [q, v, a] = &state;
        let frame = some_frame(&model, &mut draw);
        motion_of(&model, &mut data, q, v);
        world_accelerations(&model, &mut data, a, &Vector3::zeros());
        let (x, velocity, acceleration) = (frame_pose(&data, &frame), frame_velocity(&data, &frame), frame_acceleration(&data, &frame));
        let (speed, rate) = (DVector::from_column_slice(v), DVector::from_column_slice(a));
        let stacked = |linear: Vector3<f64>, angular: Vector3<f64>| [linear.as_slice(), angular.as_slice()].concat();
        let j = frame_jacobian(&model, &mut data, &frame, Reference::LocalWorldAligned).clone();
        prop_assert!(relative_error((&j * &speed).as_slice(), &stacked(velocity.linear, velocity.angular), 1.0) < 1e-13);
        let j_dot = frame_jacobian_time_variation(&model, &mut data, &frame, Reference::LocalWorldAligned).clone();
        let got = &j * &rate + &j_dot * &speed;
        prop_assert!(relative_error(got.as_slice(), &stacked(acceleration.linear, acceleration.angular), 1.0) < 1e-12);
        let point = derivative_of_vector(1e-3, 3, |t| {
            forward_kinematics(&model, &mut data, &along(&model, &state, t).0);
            frame_pose(&data, &frame).translation.as_slice().to_vec()
        });
        prop_assert!(relative_error(&point, velocity.linear.as_slice(), 1.0) < 1e-9);
        motion_of(&model, &mut data, q, v);
        let local = frame_jacobian(&model, &mut data, &frame, Reference::Local) * &speed;
        let want = stacked(x.rotation.tr_mul(&velocity.linear), x.rotation.tr_mul(&velocity.angular));
        prop_assert!(relative_error(local.as_slice(), &want, 1.0) < 1e-13);
    }

    #[test]
    fn jacobian_rates_are_derivatives_in_every_reference((model, state, mut draw) in tree()) {
        let mut data = Data::new(&model);
        let frame = some_frame(&model, &mut draw);
        for reference in [Reference::World, Reference::Local, Reference::LocalWorldAligned] {
            motion_of(&model, &mut data, &state[0], &state[1]);
            let rate = frame_jacobian_time_variation(&model, &mut data, &frame, reference).as_slice().to_vec();
            let want = derivative_of_vector(1e-3, 6 * model.nv(), |t| {
                forward_kinematics(&model, &mut data, &along(&model, &state, t).0);
                frame_jacobian(&model, &mut data, &frame, reference).as_slice().to_vec()
            });
            prop_assert!(relative_error(&rate, &want, 1.0) < 1e-9, "{reference:?}");
        }
        let all = joint_jacobians(&model, &mut data, &state[0]).clone();
        let world = frame_jacobian(&model, &mut data, &frame, Reference::World);
        prop_assert!(world.column_iter().zip(all.column_iter()).all(|(w, a)| w == a || w.amax() == 0.0));
    }

    #[test]
    fn centre_of_mass_moves_as_its_jacobian_says((model, state, _) in tree()) {
        let mut data = Data::new(&model);
        let mut jacobian = Matrix3xX::zeros(model.nv());
        let (centre, mass) = jacobian_center_of_mass(&model, &mut data, &state[0], &mut jacobian);
        prop_assert!((centre - center_of_mass(&model, &mut data, &state[0])).norm() < 1e-13);
        prop_assert!((mass - model.bodies.iter().map(|b| b.mass).sum::<f64>()).abs() < 1e-12);
        let velocity = &jacobian * DVector::from_column_slice(&state[1]);
        let want = derivative_of_vector(1e-3, 3, |t| center_of_mass(&model, &mut data, &along(&model, &state, t).0).as_slice().to_vec());
        prop_assert!(relative_error(velocity.as_slice(), &want, 1.0) < 1e-9);
        // Weight does its work at the centre of mass.
        let weight = generalized_gravity(&model, &mut data, &state[0]).to_vec();
        let pull = jacobian.tr_mul(&(-model.gravity * mass));
        prop_assert!(relative_error(pull.as_slice(), &weight, 1.0) < 1e-12);
    }

    #[test]
    fn closed_loop_forward_dynamics_undoes_inverse_dynamics((model, _, mut data, _) in moving_loops()) {
        let (q, v, a) = (data.q.clone(), data.v.clone(), data.a.clone());
        let lambda = loop_efforts(&model, &mut data).to_vec();
        let mut tau = vec![0.0; model.nv()];
        for (k, &j) in model.actuators.iter().enumerate() {
            tau[j] = data.tau_act[k];
        }
        let closure = forward_dynamics(&model, &mut data, &q, &v, &tau);
        prop_assert!(closure.is_closed, "{closure:?}");
        prop_assert!(relative_error(&data.a, &a, 1.0) < 1e-8, "{:?}, not {a:?}", data.a);
        prop_assert!(relative_error(&data.lambda, &lambda, 1.0) < 1e-7, "{:?}, not {lambda:?}", data.lambda);
    }

    #[test]
    fn efforts_of_a_known_motion_are_those_of_the_drives_motion((mut model, _, mut data, _) in moving_loops()) {
        for _ in 0..2 {
            let (q, v, a) = (data.q.clone(), data.v.clone(), data.a.clone());
            let (tau, lambda) = (data.tau_ind.clone(), loop_efforts(&model, &mut data).to_vec());
            let mut known = Data::new(&model);
            prop_assert!(inverse_dynamics_at(&model, &mut known, &q, &v, &a).is_closed);
            prop_assert!(relative_error(&known.tau_ind, &tau, 1.0) < 1e-8, "{:?}, not {tau:?}", known.tau_ind);
            prop_assert!(relative_error(loop_efforts(&model, &mut known), &lambda, 1.0) < 1e-7);
            // Once more with a drive too many, where the efforts are shared.
            let Some(&first) = model.passive().first() else { return Ok(()) };
            let passive = model.joints[first].name.clone();
            model.add_actuator(&passive, 0.0).expect("it is passive");
            data = Data::new(&model);
            let at = |x: &[f64]| -> Vec<f64> { model.actuators.iter().map(|&j| x[j]).collect() };
            data.q.copy_from_slice(&q);
            prop_assume!(inverse_dynamics(&model, &mut data, &at(&q), &at(&v), &at(&a)).is_closed);
        }
    }

    #[test]
    fn forward_dynamics_solves_the_equations_with_multipliers((model, _, mut data, mut draw) in moving_loops()) {
        let (q, v) = (data.q.clone(), data.v.clone());
        let tau = draw.vector(model.nv(), -20.0..20.0);
        prop_assert!(forward_dynamics(&model, &mut data, &q, &v, &tau).is_closed);
        let (a, lambda) = (DVector::from_column_slice(&data.a), DVector::from_column_slice(&data.lambda));
        let left = data.tau.clone();
        loop_gap(&model, &mut data, &q);
        world_velocities(&model, &mut data, &v);
        loop_drift(&model, &mut data);
        let (j, drift) = (data.loop_jacobian.clone(), DVector::from_column_slice(&data.loop_drift));
        prop_assert!((&j * &a + &drift).amax() < 1e-8 * drift.amax().max(a.amax()).max(1.0));
        let bias = DVector::from_column_slice(nle(&model, &mut data, &q, &v));
        let m = crba(&model, &mut data, &q);
        let sum = m * &a + bias;
        let right = DVector::from_column_slice(&tau) + j.tr_mul(&lambda);
        prop_assert!(relative_error(sum.as_slice(), right.as_slice(), 1.0) < 1e-8);
        prop_assert!(relative_error(&left, sum.as_slice(), 1.0) < 1e-9, "data.tau is M·a + nle");
    }

    #[test]
    fn reduced_mass_matrix_is_the_trees_seen_through_the_reduction((model, _, mut data, _) in moving_loops()) {
        let reduced = reduced_mass_matrix(&model, &mut data).clone();
        let (q, g) = (data.q.clone(), data.reduction.clone());
        let m = crba(&model, &mut data, &q);
        let want = g.transpose() * m * &g;
        prop_assert!((&reduced - &want).amax() < 1e-11 * want.amax().max(1.0));
    }

    #[test]
    fn friction_columns_carry_passive_friction_to_the_drives((model, _, mut data, mut draw) in moving_loops()) {
        let nv = model.nv();
        let (rotor, viscous, coulomb) = (draw.vector(nv, 0.0..2.0), draw.vector(nv, 0.0..5.0), draw.vector(nv, 0.0..9.0));
        let theta = DVector::from_vec([rotor.clone(), viscous.clone(), coulomb.clone()].concat());
        let got = friction_regressor(&model, &mut data) * theta;
        let tree: Vec<f64> =
            (0..nv).map(|j| rotor[j] * data.a[j] + viscous[j] * data.v[j] + coulomb[j] * math::sign(data.v[j])).collect();
        prop_assert!(relative_error(project_efforts(&mut data, &tree), got.as_slice(), 1.0) < 1e-12);
        // Power at the drives is the power lost in all joints.
        let v_ind: Vec<f64> = data.independent.iter().map(|&j| data.v[j]).collect();
        let power: f64 = got.iter().zip(&v_ind).map(|(f, v)| f * v).sum();
        let lost: f64 = tree.iter().zip(&data.v).map(|(f, v)| f * v).sum();
        prop_assert!((power - lost).abs() < 1e-9 * lost.abs().max(1.0));
    }

    #[test]
    fn loop_wrenches_do_the_work_of_their_efforts((model, _, mut data, mut draw) in moving_loops()) {
        loop_efforts(&model, &mut data);
        // On a velocity that breaks the loops, wrenches on both ends do the work that Jᵀ·lambda does.
        let v = draw.vector(model.nv(), -1.0..1.0);
        world_velocities(&model, &mut data, &v);
        let efforts = DVector::from_column_slice(&data.lambda);
        let want = (&data.loop_jacobian * DVector::from_column_slice(&v)).dot(&efforts);
        let mut got: f64 = 0.0;
        for (l, closure) in model.loops.iter().enumerate() {
            let (a, b) = (frame_pose(&data, &closure.a), frame_pose(&data, &closure.b));
            let wrench = loop_wrench(&model, &data, l);
            let (force, moment) = (a.rotation * wrench.linear, a.rotation * wrench.angular);
            let end = |frame: &FrameOnBody| frame.body.map_or_else(Default::default, |k| data.velocity_w[k].at(&b.translation));
            got += (end(&closure.b) + end(&closure.a) * -1.0).dot(&Force { linear: force, angular: moment });
        }
        prop_assert!((got - want).abs() < 1e-9 * efforts.amax().max(1.0), "{got} W, not {want} W");
    }

    #[test]
    fn joints_transmit_along_their_axis_what_their_drive_gives((model, _, mut data, _) in moving_loops()) {
        loop_efforts(&model, &mut data);
        joint_wrenches(&model, &mut data);
        for (j, joint) in model.joints.iter().enumerate() {
            let drive = model.actuators.iter().position(|&a| a == j).map_or(0.0, |k| data.tau_act[k]);
            let felt = data.axis_w[j].dot(&data.force_w[j]) + joint.armature * data.a[j];
            prop_assert!((felt - drive).abs() < 1e-8 * data.tau.iter().fold(1.0, |t: f64, x| t.max(x.abs())), "{}: {felt}", joint.name);
        }
    }

    #[test]
    fn gaps_are_projected_away_and_stabilised((model, _, mut data, mut draw) in moving_loops()) {
        let q: Vec<f64> = data.q.iter().map(|q| q + draw.uniform(-1e-4..1e-4)).collect();
        let v: Vec<f64> = data.v.iter().map(|v| v + draw.uniform(-1e-3..1e-3)).collect();
        let tau = draw.vector(model.nv(), -5.0..5.0);
        let rate = 50.0;
        let _ = stabilised_forward_dynamics(&model, &mut data, &q, &v, &tau, Stabilisation { rate });
        let a = DVector::from_column_slice(&data.a);
        loop_gap(&model, &mut data, &q);
        world_velocities(&model, &mut data, &v);
        let (j, gap) = (data.loop_jacobian.clone(), DVector::from_column_slice(&data.loop_gap));
        loop_drift(&model, &mut data);
        let gap_acceleration = &j * a + DVector::from_column_slice(&data.loop_drift);
        let gap_rate = &j * DVector::from_column_slice(&v);
        let residual = gap_acceleration + gap_rate * (2.0 * rate) + &gap * (rate * rate);
        // Redundant rows of an open loop disagree by the gap's square.
        prop_assert!(residual.amax() < 1e-2 * (gap.amax() * rate * rate).max(1e-3), "{residual}");
        let (mut q, mut v) = (q, v);
        prop_assert!(project(&model, &mut data, &mut q, &mut v).is_closed);
        loop_gap(&model, &mut data, &q);
        prop_assert!(data.loop_gap.iter().all(|g| g.abs() < 1e-9));
        prop_assert!((&data.loop_jacobian * DVector::from_vec(v)).amax() < 1e-10);
    }

    #[test]
    fn more_drives_than_freedoms_share_an_effort((mut model, motion, data, _) in moving_loops()) {
        let Some(&extra) = data.dependent.iter().find(|&&j| data.reduction.row(j).amax() > 0.05) else {
            return Err(TestCaseError::reject("no passive joint moves"));
        };
        let (q_tree, v_tree, tau_one) = (data.q.clone(), data.v.clone(), data.tau_act.clone());
        let name = model.joints[extra].name.clone();
        model.add_actuator(&name, 0.0).expect("it is passive");
        let mut more = Data::new(&model);
        prop_assert_eq!(more.n_ind(), model.n_act() - 1);
        let [_, _, a] = motion.at(0.4);
        let at = |x: &[f64]| -> Vec<f64> { model.actuators.iter().map(|&j| x[j]).collect() };
        more.q.copy_from_slice(&q_tree);
        let mut a_all = a.clone();
        a_all.push(data.a[extra]);
        let closure = inverse_dynamics(&model, &mut more, &at(&q_tree), &at(&v_tree), &a_all);
        prop_assert!(closure.is_closed, "{closure:?}");
        prop_assert!(relative_error(&more.q, &q_tree, 1.0) < 1e-9);
        // Bᵀ·tau_act = tau_ind, the smallest such, and internal efforts do nothing.
        let b = drive_jacobian(&model, &mut more).clone();
        let tau = DVector::from_column_slice(&more.tau_act);
        let scale = more.tau_ind.iter().fold(1.0, |t: f64, x| t.max(x.abs()));
        prop_assert!((b.tr_mul(&tau) - DVector::from_column_slice(&more.tau_ind)).amax() < 1e-9 * scale);
        let internal = internal_efforts(&model, &mut more).clone();
        prop_assert_eq!(internal.shape(), (model.n_act(), 1));
        prop_assert!(b.tr_mul(&internal).amax() < 1e-10 * b.amax() && (internal.norm() - 1.0).abs() < 1e-12);
        prop_assert!(internal.tr_mul(&tau).amax() < 1e-9 * scale, "the smallest efforts have no internal part");
        // The first drives alone, as before the extra one came, are another solution of the same equation.
        let mut alone = tau_one.clone();
        alone.push(0.0);
        prop_assert!((b.tr_mul(&DVector::from_vec(alone)) - DVector::from_column_slice(&more.tau_ind)).amax() < 1e-7 * scale);
        // Multipliers with both kinds of drives complete the equation of the tree.
        let lambda = DVector::from_column_slice(loop_efforts(&model, &mut more));
        let mut left = DVector::from_column_slice(&more.tau) - more.loop_jacobian.tr_mul(&lambda);
        for (k, &j) in model.actuators.iter().enumerate() {
            left[j] -= more.tau_act[k];
        }
        prop_assert!(left.amax() < 1e-7 * scale, "{left}");
        distribute(&model, &mut more);
    }

    #[test]
    fn freedoms_without_drives_move_as_the_driven_mechanism_does((mut model, _, data, mut draw) in moving_loops()) {
        let (q, v) = (data.q.clone(), data.v.clone());
        let tau = draw.vector(model.nv(), -5.0..5.0);
        let mut driven = data;
        prop_assert!(forward_dynamics(&model, &mut driven, &q, &v, &tau).is_closed);
        // Take every drive away: the rotors stay, the efforts are the same.
        let n = model.actuators.len();
        model.actuators.clear();
        for choice in [Choice::Freedoms, Choice::Pivoting] {
            let mut free = Data::with_choice(&model, choice);
            prop_assert_eq!(free.n_ind(), n);
            let closure = forward_dynamics(&model, &mut free, &q, &v, &tau);
            prop_assert!(closure.is_closed, "{closure:?}");
            prop_assert!(relative_error(&free.a, &driven.a, 1.0) < 1e-7);
        }
    }
}

#[test]
fn a_motion_solved_from_the_sample_before_is_the_motion_solved_from_afar() {
    // Foretelling from the last sample and its elimination must change nothing but the time it takes.
    for seed in 0..12 {
        let mut draw = Draw::new(900 + seed);
        let model = drawn_loops(SHAPES[usize::try_from(seed % 3).expect("small")], &mut draw);
        let motion = Motion::about_assembly(&model, 0.05, &mut draw);
        let (mut following, mut fresh) = (Data::new(&model), Data::new(&model));
        assert!(assemble(&model, &mut following).is_closed);
        for k in 0..50 {
            let [q, v, a] = motion.at(1e-3 * f64::from(k));
            let near = closed_loop_motion(&model, &mut following, &q, &v, &a);
            if near.pivot_ratio < 0.01 {
                break;
            }
            assert!(near.is_closed && near.iterations <= 2, "{near:?}");
            assert!(assemble(&model, &mut fresh).is_closed);
            assert!(closed_loop_motion(&model, &mut fresh, &q, &v, &a).is_closed);
            assert!(relative_error(&following.q, &fresh.q, 1.0) < 1e-10);
            assert!(relative_error(&following.a, &fresh.a, 1.0) < 1e-8);
        }
    }
}

#[test]
fn drawn_trees_have_joints_of_every_kind() {
    let mut found = [0; 5];
    for seed in 0..40 {
        let model = drawn_mixed_tree(6, &mut Draw::new(seed));
        for joint in &model.joints {
            use pkm_dyn::model::{Compound, Part};
            match joint.part {
                Part::Whole => found[0] += 1,
                Part::First(Compound::Spherical) => found[1] += 1,
                Part::First(Compound::Planar) => found[2] += 1,
                Part::First(Compound::Free) => found[3] += 1,
                Part::Inner | Part::Last => {}
            }
            found[4] += usize::from(joint.name.contains(".2"));
        }
    }
    assert!(found.iter().all(|&n| n >= 20), "{found:?}");
}
