//! Every shipped robot loads and assembles, and two of them reproduce numbers computed by independent programs (robots and their
//! published papers; the programs share no code with this workspace).

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, mid_pose, mobility, walk_to};
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;

fn bare(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").bare
}

fn without_rotors(name: &str) -> Model {
    let mut model = bare(name);
    for joint in &mut model.joints {
        joint.armature = 0.0;
    }
    model
}

fn assert_near(got: &[f64], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len());
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        assert!((g - w).abs() <= tolerance, "entry {k}: {g} instead of {w} (limit {tolerance:e})");
    }
}

#[test]
fn every_robot_assembles_at_home_and_in_the_middle_of_its_travel() {
    for robot in pkm_robots::ALL {
        let model = bare(robot.name);
        assert_eq!(model.name, robot.name);
        assert!(robot.readme.contains("assumed"), "{}", robot.name);
        let mut data = Data::new(&model);
        let home = assemble(&model, &mut data);
        assert!(home.is_closed && home.gap < 1e-10, "{} at home: {home:?}", robot.name);
        let q = data.q.clone();
        for j in model.passive() {
            assert!(q[j].abs() < 1e-3, "{}: {} reads {} at home", robot.name, model.joints[j].name, q[j]);
        }
        assert_eq!(mobility(&model, &mut data, &q), model.n_act(), "{}", robot.name);
        data.q.copy_from_slice(&q);
        let middle = walk_to(&model, &mut data, &mid_pose(&model));
        assert!(middle.is_closed && middle.gap < 1e-10, "{} in the middle: {middle:?}", robot.name);
        let q = data.q.clone();
        assert_eq!(mobility(&model, &mut data, &q), model.n_act(), "{}", robot.name);
    }
}

#[test]
fn every_drive_has_friction_and_finite_limits_that_contain_home() {
    for robot in pkm_robots::ALL {
        let model = bare(robot.name);
        for &j in &model.actuators {
            let joint = &model.joints[j];
            let l = joint.limits;
            assert!(joint.viscous > 0.0 && joint.coulomb > 0.0, "{}", joint.name);
            // A paper's equations may have no rotor; then the README must say so.
            assert!(joint.armature > 0.0 || robot.readme.contains("| rotor inertia | 0 |"), "{}", joint.name);
            assert!(l.lower.is_finite() && l.upper.is_finite() && l.velocity > 0.0 && l.effort > 0.0, "{}", joint.name);
            assert!(l.lower <= model.assembly[j] && model.assembly[j] <= l.upper, "{}", joint.name);
        }
    }
}

/// Leg angle t of the paper at the home pose: `−acos((r_b − l_m/√3)/l_r)`.
const PRS3_HOME_ANGLE: f64 = -1.401_502_363;

/// Closed form of the inverse kinematics at (z, pitch, roll) = (−0.40, 0.10, −0.12): slider positions and leg angles.
#[test]
fn prs3_closes_where_its_inverse_kinematics_says() {
    let model = bare("prs3");
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    // Printed to 8 digits; the loop turns a rounding of 5e-9 m into at most 5e-8 rad.
    assert!(walk_to(&model, &mut data, &[0.076_704_41, 0.090_951_40, 0.151_332_68]).is_closed);
    let angles = ["q2", "q7", "q9"].map(|name| data.q[model.joint_index(name).unwrap()] + PRS3_HOME_ANGLE);
    assert_near(&angles, &[-1.399_178_09, -1.403_397_74, -1.391_203_65], 5e-8);
    // The platform's centre, its pose turned as Rz(yaw)·Ry(pitch)·Rx(roll), and the parasitic motions.
    let platform = data.pose_wb[model.links[model.link_index("platform").unwrap()].body.unwrap()];
    let centre = platform.transform_point(&[-0.516_003 / 3.0_f64.sqrt(), 0.0, 0.0].into());
    assert_near(centre.as_slice(), &[0.000_316_33, 0.001_782_16, -0.40], 5e-8);
    let r = platform.rotation;
    let pitch = pkm_dyn::math::asin(-r[(2, 0)]);
    let (roll, yaw) = (pkm_dyn::math::atan2(r[(2, 1)], r[(2, 2)]), pkm_dyn::math::atan2(r[(1, 0)], r[(0, 0)]));
    assert_near(&[pitch, roll, yaw], &[0.10, -0.12, -0.006_012_2], 1e-7);
}

#[test]
fn prs3_has_the_published_mass_matrix_and_bias() {
    let model = bare("prs3");
    let mut data = Data::new(&model);
    let (q, v, zero) = ([0.12, 0.09, 0.105], [0.05, -0.03, 0.02], [0.0; 3]);
    assert!(assemble(&model, &mut data).is_closed && walk_to(&model, &mut data, &q).is_closed);
    let mut effort = |v: &[f64], a: &[f64]| {
        assert!(inverse_dynamics(&model, &mut data, &q, v, a).is_closed);
        data.tau_act.clone()
    };
    let g = effort(&zero, &zero);
    // Half a digit of the four printed.
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

/// Lengths, rates and accelerations of the driven legs for a platform motion, from the closed form of the inverse kinematics.
struct LegMotion {
    q: [f64; 4],
    v: [f64; 4],
    a: [f64; 4],
}

/// Driven lengths at the platform pose x = (x, z, pitch, yaw) [Armas, eq. 5-7].
fn leg_lengths(x: [f64; 4]) -> [f64; 4] {
    let (st, ct) = pkm_dyn::math::sin_cos(x[2]);
    let (sp, cp) = pkm_dyn::math::sin_cos(x[3]);
    let r45 = 0.4 * 0.5_f64.sqrt();
    let (s50, c50) = pkm_dyn::math::sin_cos(50.0_f64.to_radians());
    let base = [[-0.4, 0.0], [0.0, 0.4], [r45, -r45]];
    let platform = [[-0.3, 0.0], [0.3 * c50, 0.3 * s50], [0.0, -0.3]];
    let mut out = [0.0; 4];
    for i in 0..3 {
        let (px, py) = (platform[i][0] * cp - platform[i][1] * sp, platform[i][0] * sp + platform[i][1] * cp);
        let d = [x[0] + ct * px - base[i][0], py - base[i][1], x[1] - st * px];
        out[i] = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    }
    out[3] = pkm_dyn::math::hypot(x[0] - 0.15, x[1]);
    out
}

/// Along x(t) = x + xd·t + xdd·t²/2, differentiated by fourth-order differences: good to about 1e-9.
fn leg_motion(x: [f64; 4], xd: [f64; 4], xdd: [f64; 4]) -> LegMotion {
    let at = |t: f64| leg_lengths(core::array::from_fn(|k| x[k] + xd[k] * t + 0.5 * xdd[k] * t * t));
    let h = 2e-3;
    let s = [at(-2.0 * h), at(-h), at(0.0), at(h), at(2.0 * h)];
    LegMotion {
        q: s[2],
        v: core::array::from_fn(|k| (s[0][k] - 8.0 * s[1][k] + 8.0 * s[3][k] - s[4][k]) / (12.0 * h)),
        a: core::array::from_fn(|k| (-s[0][k] + 16.0 * s[1][k] - 30.0 * s[2][k] + 16.0 * s[3][k] - s[4][k]) / (12.0 * h * h)),
    }
}

#[test]
fn ups3_rpu1_needs_the_published_efforts() {
    let model = without_rotors("ups3_rpu1");
    let mut data = Data::new(&model);
    let m = leg_motion([0.05, 0.65, 0.10, -0.05], [0.05, -0.03, 0.2, 0.1], [0.4, -0.2, 0.5, -0.3]);
    assert_near(&m.q, &[0.696_829_242, 0.702_074_883, 0.697_219_921, 0.657_647_322], 6e-10);
    assert!(assemble(&model, &mut data).is_closed && walk_to(&model, &mut data, &m.q).is_closed);
    assert!(inverse_dynamics(&model, &mut data, &m.q, &[0.0; 4], &[0.0; 4]).is_closed);
    assert_near(&data.tau_act, &[11.310_339_761, 15.961_319_328, -35.008_474_711, 154.815_183_247], 1e-8);
    assert!(inverse_dynamics(&model, &mut data, &m.q, &m.v, &m.a).is_closed);
    // The rates come from finite differences (1e-9), times tens of kilograms.
    assert_near(&data.tau_act, &[16.677_890_746, 22.387_307_067, -38.872_607_514, 144.333_035_558], 2e-7);
}
