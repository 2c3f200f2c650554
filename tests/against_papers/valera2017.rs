//! Valera et al. 2017: the 3-PRS. Geometry and masses are not printed; the robot's README says what they were taken from.

use nalgebra::{DMatrix, Matrix3};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::solve_positions;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model, math};
use pkm_tests::{Draw, derivative_of_vector};

use crate::stack::{Rank, Stack, States, acting, beside, rank, stack};
use crate::{assert_near, closed_at, coordinate, pose_of, shipped};

const R_B: f64 = 0.384_516;
const L_R: f64 = 0.513_997;
const L_M: f64 = 0.516_003;

// ---- position

/// Leg angle of the paper at the home pose, where our hinges read zero: `−acos((r_b − l_m/√3)/l_r)`.
fn home_angle() -> f64 {
    -math::acos((R_B - L_M / math::sqrt(3.0)) / L_R)
}

/// Slider positions, leg angles and the parasitic x, y, yaw for z, pitch and roll; the platform is turned as Rz(yaw)·Ry(pitch)·Rx(roll).
///
/// The three hinges keep each sphere in its leg's plane, `n_i·P_i = 0`. Summed and differenced over the legs at 0, 120 and 240 degrees this
/// says R10 = R01, x = r/2·(R00 − R11), y = −r·R10 with the platform's radius r.
fn inverse_kinematics([z, pitch, roll]: [f64; 3]) -> ([f64; 3], [f64; 3], [f64; 3]) {
    let (sp, cp) = math::sin_cos(pitch);
    let (sr, cr) = math::sin_cos(roll);
    let yaw = math::atan2(sp * sr, cp + cr);
    let turn = Pose::from_xyz_rpy([0.0; 3], [roll, pitch, yaw]).rotation;
    let r = L_M / math::sqrt(3.0);
    let (x, y) = (0.5 * r * (turn[(0, 0)] - turn[(1, 1)]), -r * turn[(1, 0)]);
    let (mut sliders, mut angles) = ([0.0; 3], [0.0; 3]);
    for leg in 0..3 {
        let (s, c) = math::sin_cos(leg as f64 * 2.0 * core::f64::consts::PI / 3.0);
        let p = turn * nalgebra::Vector3::new(r * c, r * s, 0.0) + nalgebra::Vector3::new(x, y, z);
        angles[leg] = -math::acos((R_B - c * p.x - s * p.y) / L_R);
        sliders[leg] = p.z - L_R * math::sin(angles[leg]);
    }
    (sliders, angles, [x, y, yaw])
}

/// z, pitch, roll and the parasitic x, y, yaw of the platform's centre in the pose that `data` holds.
fn platform(model: &Model, data: &Data) -> ([f64; 3], [f64; 3]) {
    let pose = pose_of(model, data, "platform");
    let centre = pose.transform_point(&[-L_M / math::sqrt(3.0), 0.0, 0.0].into());
    let r = pose.rotation;
    let yaw = math::atan2(r[(1, 0)], r[(0, 0)]);
    ([centre.z, math::asin(-r[(2, 0)]), math::atan2(r[(2, 1)], r[(2, 2)])], [centre.x, centre.y, yaw])
}

const POSE: [f64; 3] = [-0.40, 0.10, -0.12];

#[test]
fn position_problem_has_the_computed_slider_heights_and_leg_angles() {
    let (sliders, angles, parasitic) = inverse_kinematics(POSE);
    assert_near(&sliders, &[0.076_704_41, 0.090_951_40, 0.151_332_68], 6e-9);
    assert_near(&angles, &[-1.399_178_09, -1.403_397_74, -1.391_203_65], 6e-9);
    assert_near(&parasitic, &[0.000_316_33, 0.001_782_16, -0.006_012_2], 6e-9);
    let model = shipped("prs3");
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &sliders);
    let got = ["q2", "q7", "q9"].map(|name| coordinate(&model, &data, name) + home_angle());
    assert_near(&got, &angles, 1e-12);
    let (pose, other) = platform(&model, &data);
    assert_near(&pose, &POSE, 1e-12);
    assert_near(&other, &parasitic, 1e-12);
}

#[test]
fn forward_and_inverse_kinematics_are_inverse_to_each_other() {
    let model = shipped("prs3");
    let mut data = Data::new(&model);
    let mut draw = Draw::new(11);
    for _ in 0..40 {
        let wanted = [draw.uniform(-0.44..-0.30), draw.uniform(-0.12..0.12), draw.uniform(-0.12..0.12)];
        let (sliders, _, _) = inverse_kinematics(wanted);
        closed_at(&model, &mut data, &sliders);
        let (pose, _) = platform(&model, &data);
        assert_near(&pose, &wanted, 1e-12);
        assert_near(&inverse_kinematics(pose).0, &sliders, 1e-12);
    }
}

/// What equation (15) calls the inverse Jacobian: slider speeds per z, pitch and roll.
#[test]
fn equation_15_maps_task_rates_to_slider_rates() {
    let want = Matrix3::new(1.0, -0.304_214_11, -0.003_044_23, 1.0, 0.156_523_05, 0.256_490_63, 1.0, 0.139_630_78, -0.243_759_12);
    let closed_form = Matrix3::from_fn(|_, _| 0.0).map_with_location(|i, k, _: f64| {
        let along = |h: f64| {
            let mut x = POSE;
            x[k] += h;
            inverse_kinematics(x).0.to_vec()
        };
        derivative_of_vector(1e-3, 3, along)[i]
    });
    assert_near(closed_form.as_slice(), want.as_slice(), 6e-9);
    // The model the other way round: platform rates per slider rate, by differences along solutions of the loops.
    let model = shipped("prs3");
    let mut data = Data::new(&model);
    let (sliders, _, _) = inverse_kinematics(POSE);
    closed_at(&model, &mut data, &sliders);
    let mut forward = Matrix3::zeros();
    for k in 0..3 {
        let mut at = |h: f64| {
            let mut q = sliders;
            q[k] += h;
            assert!(solve_positions(&model, &mut data, &q).is_closed);
            platform(&model, &data).0.to_vec()
        };
        forward.set_column(k, &nalgebra::Vector3::from_vec(derivative_of_vector(1e-3, 3, &mut at)));
    }
    assert_near((want * forward).as_slice(), Matrix3::<f64>::identity().as_slice(), 1e-7);
}

// ---- dynamics

#[test]
fn equation_3_has_the_computed_mass_matrix_and_bias() {
    let mut model = shipped("prs3");
    // The numbers contain the rotors.
    for j in model.actuators.clone() {
        model.joints[j].armature = 20.0;
    }
    let mut data = Data::new(&model);
    let (q, v, zero) = ([0.12, 0.09, 0.105], [0.05, -0.03, 0.02], [0.0; 3]);
    closed_at(&model, &mut data, &q);
    let mut effort = |v: &[f64], a: &[f64]| {
        assert!(inverse_dynamics(&model, &mut data, &q, v, a).is_closed);
        data.tau_act.clone()
    };
    let g = effort(&zero, &zero);
    // Half a digit of the four that are given.
    assert_near(&g, &[73.7973, 73.3565, 73.5712], 6e-5);
    assert_near(&effort(&v, &zero), &[73.8011, 73.3592, 73.5697], 6e-5);
    let rows = [[26.5612, 0.4925, 0.4689], [0.4925, 26.4653, 0.5198], [0.4689, 0.5198, 26.5109]];
    for (k, row) in rows.iter().enumerate() {
        let mut a = [0.0; 3];
        a[k] = 1.0;
        let column: Vec<f64> = effort(&zero, &a).iter().zip(&g).map(|(t, g)| t - g).collect();
        assert_near(&column, row, 6e-5);
    }
}

// ---- base parameters

/// Links by the paper's numbers 1 to 7, in the paper's frames: x along the coupler and z its hinge; platform x from sphere 1 to sphere 2.
fn paper_stack(model: &Model, seed: u64) -> Stack {
    let quarter = core::f64::consts::FRAC_PI_2;
    let (slider, coupler) = (Pose::identity(), Pose::from_xyz_rpy([0.0; 3], [-quarter, 0.0, 0.0]));
    let platform = Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, 150.0_f64.to_radians()]);
    let links = [
        ("slider1", slider),
        ("coupler1", coupler),
        ("platform", platform),
        ("slider2", slider),
        ("coupler2", coupler),
        ("slider3", slider),
        ("coupler3", coupler),
    ];
    stack(model, &links, States { n: 200, travel: 0.6, motion: [0.4, 3.0] }, seed)
}

const KINDS: [&str; 10] = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];

/// Column of a parameter by the paper's name, as `Izz2`.
fn column(name: &str) -> usize {
    let (kind, number) = name.split_at(name.len() - 1);
    let number: usize = number.parse().expect("a link's number");
    10 * (number - 1) + KINDS.iter().position(|k| *k == kind).expect("a parameter's name")
}

fn columns(w: &DMatrix<f64>, names: &[&str]) -> DMatrix<f64> {
    w.select_columns(names.iter().map(|n| column(n)).collect::<Vec<_>>().iter())
}

const ACTING: [&str; 25] = [
    "m1", "m2", "mx2", "my2", "Izz2", "m3", "mx3", "my3", "mz3", "Ixx3", "Ixy3", "Iyy3", "Ixz3", "Iyz3", "Izz3", "m4", "m5", "mx5", "my5",
    "Izz5", "m6", "m7", "mx7", "my7", "Izz7",
];

fn assert_rank(what: &str, got: Rank, want: usize) {
    assert!(got.rank == want && got.gap > 1e8, "{what}: {got:?} instead of {want} with a gap above 1e8");
}

#[test]
fn equation_4_has_25_acting_and_19_independent_of_70_parameters() {
    let model = shipped("prs3");
    let w = paper_stack(&model, 1);
    assert_eq!(acting(&w.w), ACTING.map(column));
    let acting = columns(&w.w, &ACTING);
    assert_rank("inertial", rank(&acting), 19);
    assert_rank("with rotors", rank(&beside(&[&acting, &w.rotors])), 22);
    let mut weightless = model;
    weightless.gravity.fill(0.0);
    assert_rank("without gravity", rank(&columns(&paper_stack(&weightless, 2).w, &ACTING)), 19);
}

/// Columns of slider and coupler summed over the legs: the legs are alike.
fn alike(w: &DMatrix<f64>) -> (Vec<&'static str>, DMatrix<f64>) {
    let of_leg = |slider: usize, coupler: usize| {
        let names = [format!("m{slider}"), format!("m{coupler}"), format!("mx{coupler}"), format!("my{coupler}"), format!("Izz{coupler}")];
        columns(w, &names.each_ref().map(String::as_str))
    };
    let legs = of_leg(1, 2) + of_leg(4, 5) + of_leg(6, 7);
    let platform = ["m3", "mx3", "my3", "mz3", "Ixx3", "Ixy3", "Iyy3", "Ixz3", "Iyz3", "Izz3"];
    let names = [&["m_slider", "m", "mx", "my", "Izz"][..], &platform].concat();
    (names, beside(&[&legs, &columns(w, &platform)]))
}

// DIFFERENCE Table 1 lists 14 parameters for legs that are alike with my = 0. Izz7, mx7 belong to the same coupler as Izz2, mx2 there, so
// only 12 are independent; 14 is the number of acting columns.
#[test]
fn table_1_has_13_independent_parameters_with_legs_alike_and_12_without_my() {
    let w = paper_stack(&shipped("prs3"), 3).w;
    let (names, shared) = alike(&w);
    assert_rank("legs alike", rank(&shared), 13);
    let without = shared.remove_column(names.iter().position(|n| *n == "my").expect("my"));
    assert_eq!(without.ncols(), 14);
    assert_rank("legs alike, my = 0", rank(&without), 12);
}

const SET_1: [&str; 6] = ["m1", "m2", "m3", "m4", "m5", "m6"];
const SET_2: [&str; 6] = ["m1", "Iyy3", "m3", "mx3", "m5", "m7"];

fn left_by(eliminated: &[&str]) -> Vec<&'static str> {
    ACTING.into_iter().filter(|name| !eliminated.contains(name)).collect()
}

#[test]
fn both_printed_sets_can_be_eliminated_and_set_1_is_no_worse() {
    let w = paper_stack(&shipped("prs3"), 4).w;
    let of = |set: &[&str]| rank(&columns(&w, &left_by(set)));
    for set in [SET_1, SET_2] {
        let left = of(&set);
        assert!(left.rank == 19 && left.condition < 200.0, "{set:?}: {left:?}");
    }
    // Most sets of six are not valid: without mz3 a base parameter is lost.
    assert_eq!(of(&["m1", "m2", "m3", "m4", "m5", "mz3"]).rank, 18);
    // The paper's 50 and 110 belong to an optimal motion it does not print; on states drawn at random the order is the same.
    assert!(of(&SET_1).condition < of(&SET_2).condition);
}

/// Equation (7): `phi_B = phi_a + B·phi_b` with `W_b = W_a·B`.
fn combinations(w: &DMatrix<f64>, eliminated: &[&str]) -> DMatrix<f64> {
    let (w_a, w_b) = (columns(w, &left_by(eliminated)), columns(w, eliminated));
    let qr = w_a.clone().qr();
    let b = qr.r().solve_upper_triangular(&(qr.q().transpose() * &w_b)).expect("full column rank");
    assert!((w_a * &b - w_b).amax() < 1e-10, "the eliminated columns depend on the others");
    b
}

// DIFFERENCE (6) prints [..]·phi_B = tau and (7) phi_B = phi_a + B·phi_b = tau: the first is phi_B = [..]·tau, the second has no "= tau".
// DIFFERENCE Table 1, against the exact B below (M = m1 + m2, legs alike): row 1 prints Ixx3 − b²(..) for a²; row 4 adds a²(m1+m2) for c²;
// row 9 repeats Izz3 for Iyz3; row 10 has l_r²(2m1+2m2) for l_r²(m1+m2); row 11 has l_r²(..) for l_r(..), which is not even a first moment;
// rows 12 and 14 subtract where B adds. The text's b = l_m·cos 120° must be +l_m/2, or the platform is no equilateral triangle.
#[test]
fn table_1_has_these_exact_combinations() {
    let b_matrix = combinations(&paper_stack(&shipped("prs3"), 5).w, &SET_1);
    let (a, b, c) = (0.5 * math::sqrt(3.0) * L_M, 0.5 * L_M, L_M);
    let leg1 = |x: f64| [x, x, 0.0, 0.0, 0.0, 0.0];
    let leg2 = |x: f64| [0.0, 0.0, 0.0, x, x, 0.0];
    let first_three = |x: f64| [x, x, x, 0.0, 0.0, 0.0];
    let first_five = |x: f64| [x, x, x, x, x, 0.0];
    let sum = |x: [f64; 6], y: [f64; 6]| core::array::from_fn(|k| x[k] + y[k]);
    let rows: [(&str, [f64; 6]); 13] = [
        ("mx2", leg1(-L_R)),
        ("Izz2", leg1(-L_R * L_R)),
        ("mx5", leg2(-L_R)),
        ("Izz5", leg2(-L_R * L_R)),
        ("m7", [1.0; 6]),
        ("mx7", first_five(L_R)),
        ("Izz7", first_five(L_R * L_R)),
        ("mx3", sum(first_three(-b), leg2(b))),
        ("my3", first_five(-a)),
        ("Ixx3", first_five(-a * a)),
        ("Ixy3", first_five(a * b)),
        ("Iyy3", sum(first_three(-b * b), leg2(a * a))),
        ("Izz3", first_three(-c * c)),
    ];
    for (k, name) in left_by(&SET_1).into_iter().enumerate() {
        let want = rows.iter().find(|(n, _)| *n == name).map_or([0.0; 6], |(_, row)| *row);
        let got: Vec<f64> = b_matrix.row(k).iter().copied().collect();
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() < 1e-9, "{name}: {got:?} instead of {want:?}");
        }
    }
    // Legs alike, as the table has it: m1 stands for m1, m4, m6 and m2 for m2, m5.
    let alike = |name: &str| {
        let row = b_matrix.row(left_by(&SET_1).iter().position(|n| *n == name).expect("a kept parameter"));
        [row[0] + row[3] + row[5], row[1] + row[4], row[2]]
    };
    assert_near(&alike("Ixx3"), &[-2.0 * a * a, -2.0 * a * a, -a * a], 1e-9);
    assert_near(&alike("Iyy3"), &[c * c - 2.0 * b * b, c * c - 2.0 * b * b, -b * b], 1e-9);
    assert_near(&alike("Izz7"), &[2.0 * L_R * L_R, 2.0 * L_R * L_R, L_R * L_R], 1e-9);
}
