//! Poses and robots at the edge of what an algorithm can answer: it answers right, or says that it cannot.

use core::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::constrained::forward_dynamics;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{Choice, assemble, solve_positions};
use pkm_dyn::model::{Compound, JointKind, LoopClosure, ModelBuilder};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters, Model, math};

fn body(mass: f64, x: f64) -> InertialParameters {
    InertialParameters::from_centre_of_mass(mass, Vector3::new(x, 0.0, 0.0), Matrix3::identity() * (0.01 * mass))
}

/// Feet of four arms that hold one tip in a plane; each arm has two links of this length `[m]`.
const FEET: [[f64; 2]; 4] = [[-0.5, 0.0], [0.5, 0.0], [-0.45, 0.9], [0.5, 0.8]];
const LENGTH: f64 = 0.55;

/// Four arms on one tip: two freedoms, four drives at the shoulders.
fn four_arms() -> Model {
    let mut builder = ModelBuilder::new("four_arms", [0.0, -9.81, 0.0]);
    builder.link("base", InertialParameters::default());
    for (i, foot) in FEET.iter().enumerate() {
        let [upper, lower] = [format!("upper{i}"), format!("lower{i}")];
        builder.link(&upper, body(1.0, 0.5 * LENGTH)).link(&lower, body(0.5, 0.5 * LENGTH));
        let (at_foot, at_elbow) = (Pose::from_xyz_rpy([foot[0], foot[1], 0.0], [0.0; 3]), Pose::from_xyz_rpy([LENGTH, 0.0, 0.0], [0.0; 3]));
        builder.moving_joint(&format!("shoulder{i}"), JointKind::Revolute, ("base", &upper), at_foot, Vector3::z());
        builder.moving_joint(&format!("elbow{i}"), JointKind::Revolute, (&upper, &lower), at_elbow, Vector3::z());
    }
    let mut model = builder.build().expect("four arms are a tree");
    let tip = Pose::from_xyz_rpy([LENGTH, 0.0, 0.0], [0.0; 3]);
    let a = model.frame_on("tip", "lower0", tip).expect("a link");
    for i in 1..FEET.len() {
        let b = model.frame_on("tip", &format!("lower{i}"), tip).expect("a link");
        model
            .add_loop(LoopClosure { name: format!("tip{i}"), a, b, constrain: [true, true, false, false, false, false] })
            .expect("one name each");
    }
    for i in 0..FEET.len() {
        model.add_actuator(&format!("shoulder{i}"), 0.0).expect("a joint");
    }
    let home = tree_of_tip(&model, [0.05, 0.45]);
    model.assembly = home;
    model
}

/// Tree coordinates with the tip at `p` and every elbow to the left, in closed form.
fn tree_of_tip(model: &Model, p: [f64; 2]) -> Vec<f64> {
    let mut q = vec![0.0; model.nv()];
    for (i, foot) in FEET.iter().enumerate() {
        let d = [p[0] - foot[0], p[1] - foot[1]];
        let reach = math::hypot(d[0], d[1]);
        let bend = math::acos(0.5 * reach / LENGTH);
        let index = |name: &str| model.joint_index(&format!("{name}{i}")).expect("a joint");
        q[index("shoulder")] = math::atan2(d[1], d[0]) - bend;
        q[index("elbow")] = 2.0 * bend;
    }
    q
}

/// Difference of two angles, within half a turn.
fn apart(a: f64, b: f64) -> f64 {
    (a - b - 2.0 * PI * math::round((a - b) / (2.0 * PI))).abs()
}

#[test]
fn surplus_drives_carry_a_robot_past_poses_where_any_two_of_them_fail() {
    let model = four_arms();
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    assert_eq!((data.n_ind(), model.n_act()), (2, 4));
    let mut choices = vec![data.independent.clone()];
    for k in 0..=400 {
        let turn = 2.0 * PI * f64::from(k) / 400.0;
        let tip = [0.05 + 0.3 * math::sin(turn), 0.45 + 0.25 * math::sin(2.0 * turn)];
        let want = tree_of_tip(&model, tip);
        let q_act: Vec<f64> = model.actuators.iter().map(|&j| want[j]).collect();
        let closure = inverse_dynamics(&model, &mut data, &q_act, &[0.0; 4], &[0.0; 4]);
        assert!(closure.is_closed && closure.misfit < 1e-9, "{tip:?}: {closure:?}");
        assert!(data.q.iter().zip(&want).all(|(a, b)| apart(*a, *b) < 1e-8), "{tip:?}: {:?}, not {want:?}", data.q);
        assert!(data.reduction.row_iter().enumerate().all(|(j, row)| !model.actuators.contains(&j) || row.amax() <= 2.0));
        // Weight is carried: virtual work of the drives' efforts is that of the weights on any motion.
        let work: f64 = model.actuators.iter().zip(&data.tau_act).map(|(&j, tau)| data.reduction[(j, 0)] * tau).sum();
        assert!((work - data.tau_ind[0]).abs() < 1e-9, "{tip:?}");
        choices.push(data.independent.clone());
    }
    choices.dedup();
    assert!(choices.len() > 3, "the way leads past poses where a choice fails: {choices:?}");
}

#[test]
fn contradicting_drives_are_met_in_the_mean_and_the_contradiction_is_told() {
    let model = four_arms();
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    let home = data.q.clone();
    let q_act: Vec<f64> = model.actuators.iter().enumerate().map(|(k, &j)| home[j] + [2e-3, 0.0, 0.0, 0.0][k]).collect();
    let closure = solve_positions(&model, &mut data, &q_act);
    assert!(closure.is_closed && closure.misfit > 2e-4 && closure.misfit < 2e-3, "{closure:?}");
    let cost = |q: &[f64]| model.actuators.iter().zip(&q_act).map(|(&j, given)| (q[j] - given) * (q[j] - given)).sum::<f64>();
    assert!(cost(&data.q) < 0.9 * cost(&home), "better than leaving the pose");
    // No neighbouring pose is better: the residual is normal to every motion.
    for k in 0..data.n_ind() {
        let along: f64 = model.actuators.iter().zip(&q_act).map(|(&j, given)| data.reduction[(j, k)] * (given - data.q[j])).sum();
        assert!(along.abs() < 1e-9, "{along}");
    }
    // A velocity of one drive that the others do not share is met in the mean as well.
    pkm_dyn::loops::solve_velocities(&model, &mut data, &[0.1, 0.0, 0.0, 0.0]);
    let v: Vec<f64> = model.actuators.iter().map(|&j| data.v[j]).collect();
    assert!(v[0] > 0.01 && v[0] < 0.1, "{v:?}");
}

/// A rod without mass between two balls: it may spin, and nothing resists.
#[test]
fn a_freedom_without_inertia_has_no_acceleration_and_that_is_told() {
    let mut builder = ModelBuilder::new("idle", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default()).link("slider", body(1.0, 0.0)).link("rod", InertialParameters::default());
    let askew = Pose::from_xyz_rpy([0.1, 0.2, 0.3], [0.3, -0.5, 0.7]);
    builder.moving_joint("slide", JointKind::Prismatic, ("base", "slider"), askew, Vector3::x());
    builder.compound_joint("ball", Compound::Spherical, ("slider", "rod"), Pose::from_xyz_rpy([0.0, 0.1, 0.0], [0.2, 0.1, 0.4]));
    let mut model = builder.build().expect("a chain");
    model.add_actuator("slide", 0.0).expect("a joint");
    let mut data = Data::new(&model);
    pkm_dyn::kinematics::forward_kinematics(&model, &mut data, &[0.0; 4]);
    let end = model.frame_on("end", "rod", Pose::from_xyz_rpy([0.3, 0.4, 0.2], [0.0; 3])).expect("a link");
    let fixed = pkm_dyn::kinematics::frame_pose(&data, &end);
    let a = model.frame_on("end", "base", fixed).expect("the root");
    model
        .add_loop(LoopClosure { name: "end".to_string(), a, b: end, constrain: [true, true, true, false, false, false] })
        .expect("one loop");
    let mut data = Data::with_choice(&model, Choice::Freedoms);
    let q = data.q.clone();
    let closure = forward_dynamics(&model, &mut data, &q, &[0.0; 4], &[1.0, 0.0, 0.0, 0.0]);
    assert!(!closure.is_closed, "{closure:?} {:?}", data.a);
}

#[test]
fn an_open_tree_with_a_joint_that_nothing_drives_has_no_inverse_dynamics() {
    let mut builder = ModelBuilder::new("cart_pole", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default()).link("cart", body(1.0, 0.0)).link("pole", body(1.0, 0.5));
    builder.moving_joint("slide", JointKind::Prismatic, ("base", "cart"), Pose::identity(), Vector3::x());
    builder.moving_joint("swing", JointKind::Revolute, ("cart", "pole"), Pose::identity(), Vector3::y());
    let mut model = builder.build().expect("a chain");
    model.add_actuator("slide", 0.0).expect("a joint");
    let mut data = Data::new(&model);
    assert!(!inverse_dynamics(&model, &mut data, &[0.1], &[0.2], &[1.0]).is_closed);
    // Forward dynamics needs no drive.
    let mut free = Data::with_choice(&model, Choice::Freedoms);
    assert!(forward_dynamics(&model, &mut free, &[0.1, 0.2], &[0.0; 2], &[1.0, 0.0]).is_closed);
    let tau = pkm_dyn::rnea::rnea(&model, &mut data, &[0.1, 0.2], &[0.0; 2], &free.a).to_vec();
    assert!((tau[0] - 1.0).abs() < 1e-12 && tau[1].abs() < 1e-12, "{tau:?}");
}

#[test]
fn numbers_that_are_not_finite_are_told_and_leave_the_pose_alone() {
    let model = four_arms();
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    let q: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
    let mut bad = q.clone();
    bad[1] = f64::NAN;
    assert!(!solve_positions(&model, &mut data, &bad).is_closed);
    assert!(!inverse_dynamics(&model, &mut data, &q, &[f64::INFINITY, 0.0, 0.0, 0.0], &[0.0; 4]).is_closed);
    let after = inverse_dynamics(&model, &mut data, &q, &[0.0; 4], &[0.0; 4]);
    assert!(after.is_closed && data.tau_act.iter().all(|t| t.is_finite()), "{after:?}");
}
