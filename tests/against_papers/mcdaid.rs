//! `McDaid` et al.: the 4-UPS ankle robot, mechanics only. Its figure is missing, so the reading of Table 8.2 is ours.

use nalgebra::{DMatrix, Matrix3, Matrix4, Matrix4x3, Vector3, Vector4};
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::inverse_dynamics::{closed_loop_motion, inverse_dynamics};
use pkm_dyn::loops::{drive_jacobian, internal_efforts, mobility, solve_positions};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};
use pkm_tests::derivative_of_vector;

use crate::{assert_near, closed_at, coordinate, driven_by, shipped};

const ANGLES: [&str; 3] = ["rx", "ry", "rz"];

/// Joints on the base, joints on the platform from the ankle, the ankle itself.
fn geometry() -> ([Vector3<f64>; 4], [Vector3<f64>; 4], Vector3<f64>) {
    let (r1, a1, a2, a3, drop) = (0.2, 0.9, 0.4, 0.45, 0.05);
    let at = |radius: f64, degrees: f64, z: f64| {
        let (s, c) = pkm_dyn::math::sin_cos(degrees.to_radians());
        Vector3::new(radius * c, radius * s, z)
    };
    let ring = |front: f64, rear: f64, angle: f64, z: f64| {
        [at(front, angle, z), at(front, 180.0 - angle, z), at(rear, 180.0 + angle, z), at(rear, -angle, z)]
    };
    (ring(a1 * r1, r1, 45.0, 0.0), ring(a2 * r1, a3 * r1, 30.0, -drop), Vector3::new(0.0, 0.0, 0.36))
}

/// Platform at XYZ Euler angles: R = Rx·Ry·Rz.
fn rotation(angles: [f64; 3]) -> Matrix3<f64> {
    let about = |k: usize| {
        let mut rpy = [0.0; 3];
        rpy[k] = angles[k];
        Pose::from_xyz_rpy([0.0; 3], rpy).rotation
    };
    about(0) * about(1) * about(2)
}

/// Leg lengths `|A + R·p − b|` and rows `(R·p × u)ᵀ·E` of the Jacobian, E = [x, Rx·y, Rx·Ry·z].
fn legs(angles: [f64; 3]) -> (Vector4<f64>, Matrix4x3<f64>) {
    let (base, platform, ankle) = geometry();
    let turn = rotation(angles);
    let e = Matrix3::from_columns(&[
        Vector3::x(),
        rotation([angles[0], 0.0, 0.0]) * Vector3::y(),
        rotation([angles[0], angles[1], 0.0]) * Vector3::z(),
    ]);
    let (mut lengths, mut j) = (Vector4::zeros(), Matrix4x3::zeros());
    for leg in 0..4 {
        let arm = turn * platform[leg];
        let l = ankle + arm - base[leg];
        lengths[leg] = l.norm();
        j.set_row(leg, &(arm.cross(&(l / l.norm())).transpose() * e));
    }
    (lengths, j)
}

/// Robot with the ankle's three angles as drives: closing its loops is inverse kinematics.
fn by_angles() -> Model {
    driven_by(&shipped("ups4"), &ANGLES)
}

/// Lengths that the model has at the angles, and their derivative by the angles.
fn legs_of_model(angles: [f64; 3]) -> (Vector4<f64>, Matrix4x3<f64>) {
    let model = by_angles();
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &angles);
    assert!(closed_loop_motion(&model, &mut data, &angles, &[0.0; 3], &[0.0; 3]).is_closed);
    let drives = ["l1", "l2", "l3", "l4"].map(|name| model.joint_index(name).expect("joint by name"));
    (Vector4::from(drives.map(|j| data.q[j])), Matrix4x3::from_fn(|i, k| data.reduction[(drives[i], k)]))
}

const TILTED: [f64; 3] = [10.0, 5.0, -4.0];

#[test]
fn table_8_2_has_the_computed_lengths_and_jacobian() {
    let (neutral, j0) = legs_of_model([0.0; 3]);
    assert_near(neutral.as_slice(), &[0.327_232_85, 0.327_232_85, 0.330_797_02, 0.330_797_02], 6e-9);
    let rows = [
        [0.024_557_56, -0.056_771_72, -0.011_389_43],
        [0.024_557_56, 0.056_771_72, 0.011_389_43],
        [-0.027_596_78, 0.063_447_23, -0.014_083_39],
        [-0.027_596_78, -0.063_447_23, 0.014_083_39],
    ];
    assert_near(j0.transpose().as_slice(), &rows.concat(), 6e-9);
    let mut values: Vec<f64> = j0.singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    assert_near(&values, &[0.120_477_22, 0.052_242_81, 0.025_268_94], 6e-9);
    let (tilted, _) = legs_of_model(TILTED.map(f64::to_radians));
    assert_near(tilted.as_slice(), &[0.327_303_83, 0.337_911_91, 0.334_714_2, 0.320_834_71], 6e-9);
}

#[test]
fn jacobian_is_the_derivative_of_the_lengths() {
    for degrees in [[0.0; 3], TILTED, [-25.0, 12.0, 20.0], [30.0, -8.0, -15.0]] {
        let angles = degrees.map(f64::to_radians);
        let (lengths, j) = legs_of_model(angles);
        let (closed_form, closed_j) = legs(angles);
        assert_near(lengths.as_slice(), closed_form.as_slice(), 1e-12);
        assert_near(j.as_slice(), closed_j.as_slice(), 1e-11);
        for k in 0..3 {
            let along = |h: f64| {
                let mut at = angles;
                at[k] += h;
                legs(at).0.as_slice().to_vec()
            };
            assert_near(j.column(k).into_owned().as_slice(), &derivative_of_vector(1e-3, 4, along), 1e-9);
        }
    }
}

#[test]
fn forward_kinematics_from_four_lengths_finds_the_angles() {
    let model = shipped("ups4");
    let mut data = Data::new(&model);
    for degrees in [TILTED, [-20.0, 10.0, 15.0], [15.0, -8.0, 5.0]] {
        let angles = degrees.map(f64::to_radians);
        closed_at(&model, &mut data, legs(angles).0.as_slice());
        assert_near(&ANGLES.map(|name| coordinate(&model, &data, name)), &angles, 1e-12);
        // One of the four drives is solved for: it must come out at its own length.
        assert_near(&["l1", "l2", "l3", "l4"].map(|name| coordinate(&model, &data, name)), legs(angles).0.as_slice(), 1e-12);
        let q = data.q.clone();
        assert_eq!((mobility(&model, &mut data, &q), model.n_act()), (3, 4));
    }
}

/// Closed at the angles with the lengths as drives.
fn at(model: &Model, degrees: [f64; 3]) -> (Data, Vec<f64>, Matrix4x3<f64>) {
    let (lengths, j) = legs(degrees.map(f64::to_radians));
    let mut data = Data::new(model);
    let q = lengths.as_slice().to_vec();
    closed_at(model, &mut data, &q);
    (data, q, j)
}

#[test]
fn null_vector_strains_the_platform_and_moves_nothing() {
    let model = shipped("ups4");
    let (mut data, q, _) = at(&model, [0.0; 3]);
    assert!(solve_positions(&model, &mut data, &q).is_closed);
    let v0 = internal_efforts(&model, &mut data).clone();
    assert_eq!(v0.shape(), (4, 1));
    assert_near(v0.as_slice(), &[0.528_240_67, 0.528_240_67, 0.470_065_73, 0.470_065_73], 6e-9);
    for degrees in [[0.0; 3], TILTED, [-20.0, 10.0, 15.0]] {
        let (mut data, _, j) = at(&model, degrees);
        let v0 = Vector4::from_column_slice(internal_efforts(&model, &mut data).as_slice());
        assert!((j.transpose() * v0).amax() < 1e-13 && (v0.norm() - 1.0).abs() < 1e-13, "{degrees:?}");
        // The drives' own Jacobian spans what the ankle's does.
        let b = drive_jacobian(&model, &mut data).clone();
        assert!((b.transpose() * v0).amax() < 1e-12);
    }
}

/// Moments about the ankle for lengths' rates and accelerations that belong to the angles', from the model driven by its angles.
fn moments(degrees: [f64; 3], rates: [f64; 3], accelerations: [f64; 3]) -> Vector3<f64> {
    let model = by_angles();
    let mut data = Data::new(&model);
    let angles = degrees.map(f64::to_radians);
    closed_at(&model, &mut data, &angles);
    assert!(inverse_dynamics(&model, &mut data, &angles, &rates, &accelerations).is_closed);
    Vector3::from_column_slice(&data.tau_act)
}

const RATES: [f64; 3] = [0.4, -0.3, 0.2];
const ACCELERATIONS: [f64; 3] = [2.0, 1.5, -3.0];

/// Rates and accelerations of the lengths, `l' = J·Θ'`, `l'' = J·Θ'' + J'·Θ'` (8.4).
// DIFFERENCE (8.4) prints J where the second term needs its time derivative.
fn of_lengths(degrees: [f64; 3]) -> (Vector4<f64>, Vector4<f64>) {
    let angles = degrees.map(f64::to_radians);
    let rate = |t: f64| {
        let at: [f64; 3] = core::array::from_fn(|k| angles[k] + RATES[k] * t + 0.5 * ACCELERATIONS[k] * t * t);
        let v = Vector3::from_fn(|k, _| RATES[k] + ACCELERATIONS[k] * t);
        (legs(at).1 * v).as_slice().to_vec()
    };
    (Vector4::from_vec(rate(0.0)), Vector4::from_vec(derivative_of_vector(2e-3, 4, rate)))
}

#[test]
fn equation_8_2_leaves_one_force_free_and_the_smallest_forces_are_the_pseudo_inverse() {
    let model = shipped("ups4");
    for degrees in [[0.0; 3], TILTED, [-20.0, 10.0, 15.0]] {
        let (mut data, q, j) = at(&model, degrees);
        let (v, a) = of_lengths(degrees);
        assert!(inverse_dynamics(&model, &mut data, &q, v.as_slice(), a.as_slice()).is_closed);
        let forces = Vector4::from_column_slice(&data.tau_act);
        let wanted = moments(degrees, RATES, ACCELERATIONS);
        // M·Θ'' + N = Jᵀ·F, with no part of F along v0.
        assert!((j.transpose() * forces - wanted).amax() < 1e-8 * wanted.amax().max(1.0), "{degrees:?}");
        let pseudo = j * (j.transpose() * j).try_inverse().expect("full rank") * wanted;
        assert!((forces - pseudo).amax() < 1e-6 * forces.amax(), "{forces} and {pseudo}");
        let v0 = Vector4::from_column_slice(internal_efforts(&model, &mut data).as_slice());
        assert!(v0.dot(&forces).abs() < 1e-9 * forces.norm());
    }
}

/// Mass matrix of platform and foot, the legs included, in the ankle's angles.
fn mass_in_angles(degrees: [f64; 3]) -> Matrix3<f64> {
    let model = by_angles();
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &degrees.map(f64::to_radians));
    let zero = [0.0; 3];
    assert!(closed_loop_motion(&model, &mut data, &degrees.map(f64::to_radians), &zero, &zero).is_closed);
    Matrix3::from_iterator(reduced_mass_matrix(&model, &mut data).iter().copied())
}

#[test]
fn inertia_of_the_platform_about_the_ankle_is_the_reference_set() {
    let mut model = by_angles();
    for link in model.massive_links() {
        if model.links[link].name != "platform" {
            model.set_link_parameters(link, pkm_dyn::InertialParameters::default());
        }
    }
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &[0.0; 3]);
    assert!(closed_loop_motion(&model, &mut data, &[0.0; 3], &[0.0; 3], &[0.0; 3]).is_closed);
    let mass = reduced_mass_matrix(&model, &mut data);
    let want = DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(&[0.055, 0.035, 0.06]));
    assert!((mass - want).amax() < 1e-14, "{mass}");
}

/// `D = (1 + m_a·J·M⁻¹·Jᵀ)⁻¹` shares out what the motors' inertia takes of a force (8.5); it leaves the null force alone.
#[test]
fn equations_8_5_to_8_7_hold_for_the_models_mass_matrix() {
    let m_a = 1_958.133_429_442_987_6;
    for degrees in [[0.0; 3], TILTED] {
        let model = shipped("ups4");
        let (mut data, _, j) = at(&model, degrees);
        let v0 = Vector4::from_column_slice(internal_efforts(&model, &mut data).as_slice());
        let mass = mass_in_angles(degrees);
        let inverse = mass.try_inverse().expect("positive definite");
        let d = (Matrix4::identity() + j * inverse * j.transpose() * m_a).try_inverse().expect("positive definite");
        assert!((d * v0 - v0).amax() < 1e-12, "D·v0 = v0");
        let plus = (j.transpose() * j).try_inverse().expect("full rank") * j.transpose();
        assert!((j.transpose() * plus.transpose() - Matrix3::identity()).amax() < 1e-12);
        let projector = Matrix4::identity() - v0 * v0.transpose();
        assert!((plus.transpose() * j.transpose() - projector).amax() < 1e-12);
        // With its rotors the model has M + m_a·JᵀJ, which is what D must invert: M⁻¹Jᵀ·D = (M + m_a·JᵀJ)⁻¹·Jᵀ.
        let mut geared = by_angles();
        for name in ["l1", "l2", "l3", "l4"] {
            let joint = geared.joint_index(name).expect("joint by name");
            geared.joints[joint].armature = m_a;
        }
        let mut data = Data::new(&geared);
        closed_at(&geared, &mut data, &degrees.map(f64::to_radians));
        assert!(closed_loop_motion(&geared, &mut data, &degrees.map(f64::to_radians), &[0.0; 3], &[0.0; 3]).is_closed);
        let whole = Matrix3::from_iterator(reduced_mass_matrix(&geared, &mut data).iter().copied());
        let (left, right) = (inverse * j.transpose() * d, whole.try_inverse().expect("positive definite") * j.transpose());
        assert!((left - right).amax() < 1e-9 * right.amax(), "{left} and {right}");
    }
}
