//! Closed-form kinematics of the 3-PRS and what equation (15) calls the inverse Jacobian.

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::loops::solve_positions;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, math};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};
use crate::series::largest_gap;
use crate::valera2017::position::{L_M, L_R, R_B, pose_of_platform};

/// A pose of the platform: height `[m]`, pitch and roll `[rad]`.
const POSE: [f64; 3] = [-0.40, 0.10, -0.12];

/// Leg angles `[rad]` there, by an independent program.
const ANGLES: [f64; 3] = [-1.399_178_09, -1.403_397_74, -1.391_203_65];

/// Rates of the sliders per rate of height, pitch and roll there, likewise.
const RATES: [[f64; 3]; 3] = [[1.0, -0.304_214_11, -0.003_044_23], [1.0, 0.156_523_05, 0.256_490_63], [1.0, 0.139_630_78, -0.243_759_12]];

/// Step of the differences `[m | rad]`.
const STEP: f64 = 1e-4;

/// Poses of the round trip.
const POSES: usize = 40;

/// Heights of the sliders `[m]` and angles of the legs `[rad]` for height, pitch and roll; the platform is turned as
/// `Rz(yaw)·Ry(pitch)·Rx(roll)`.
///
/// The three hinges keep each sphere in its leg's plane. Summed and differenced over the legs at 0, 120 and 240 degrees this says
/// `R10 = R01`, `x = r/2·(R00 − R11)`, `y = −r·R10` with the platform's radius r.
fn inverse_kinematics([z, pitch, roll]: [f64; 3]) -> [[f64; 3]; 2] {
    let (sp, cp) = math::sin_cos(pitch);
    let (sr, cr) = math::sin_cos(roll);
    let turn = Pose::from_xyz_rpy([0.0; 3], [roll, pitch, math::atan2(sp * sr, cp + cr)]).rotation;
    let r = L_M / math::sqrt(3.0);
    let centre = Vector3::new(0.5 * r * (turn[(0, 0)] - turn[(1, 1)]), -r * turn[(1, 0)], z);
    let (mut sliders, mut angles) = ([0.0; 3], [0.0; 3]);
    for leg in 0..3 {
        let (s, c) = math::sin_cos(leg as f64 * 2.0 * core::f64::consts::PI / 3.0);
        let p = turn * Vector3::new(r * c, r * s, 0.0) + centre;
        angles[leg] = -math::acos((R_B - c * p.x - s * p.y) / L_R);
        sliders[leg] = p.z - L_R * math::sin(angles[leg]);
    }
    [sliders, angles]
}

/// Fourth-order central differences of `f` along entry `k` of `x`.
fn slope(f: &mut dyn FnMut([f64; 3]) -> Result<[f64; 3], PaperError>, x: [f64; 3], k: usize) -> Result<[f64; 3], PaperError> {
    let mut at = |h: f64| {
        let mut x = x;
        x[k] += h;
        f(x)
    };
    let [near, far] = [[at(STEP)?, at(-STEP)?], [at(2.0 * STEP)?, at(-2.0 * STEP)?]];
    Ok(core::array::from_fn(|i| (8.0 * (near[0][i] - near[1][i]) - (far[0][i] - far[1][i])) / (12.0 * STEP)))
}

/// Leg angles, the inverse Jacobian both ways, and there and back.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "kinematics";
    let description = shipped("prs3")?;
    let model = &description.robot.model;
    let mut data = Data::new(model);
    let [sliders, angles] = inverse_kinematics(POSE);
    let mut columns = Matrix3::zeros();
    for k in 0..3 {
        columns.set_column(k, &Vector3::from(slope(&mut |x| Ok(inverse_kinematics(x)[0]), POSE, k)?));
    }
    let checked = Matrix3::from_fn(|i, k| RATES[i][k]);
    closed_at(model, &mut data, &sliders, WHAT)?;
    let mut forward = Matrix3::zeros();
    for k in 0..3 {
        let mut pose = |q: [f64; 3]| {
            closed(&solve_positions(model, &mut data, &q), WHAT)?;
            let [z, pitch, roll, ..] = pose_of_platform(model, &data)?;
            Ok([z, pitch, roll])
        };
        forward.set_column(k, &Vector3::from(slope(&mut pose, sliders, k)?));
    }
    let (mut chance, mut gap) = (Chance::new(11), 0.0_f64);
    for _ in 0..POSES {
        let wanted = [chance.between(-0.44, -0.30), chance.between(-0.12, 0.12), chance.between(-0.12, 0.12)];
        let [there, _] = inverse_kinematics(wanted);
        closed_at(model, &mut data, &there, WHAT)?;
        // Newton stops at gaps of 1e-12; one more step from nearby leaves rounding.
        for j in model.passive() {
            data.q[j] += 1e-8;
        }
        closed(&solve_positions(model, &mut data, &there), WHAT)?;
        let [z, pitch, roll, ..] = pose_of_platform(model, &data)?;
        gap = gap.max(largest_gap(&[z, pitch, roll], &wanted));
    }
    let no_lengths = "the paper prints no lengths: those of the laboratory's recordings";
    // Numbers with eight decimals.
    let leg = |k: usize| {
        let what = format!("angle of leg {} in that pose, rad", k + 1);
        Row::held_against("section 2", what, angles[k], None, (Gate::Within(6e-9), ANGLES[k])).because(no_lengths)
    };
    let mut rows: Vec<Row> = (0..3).map(leg).collect();
    let jacobian = Row::new(
        "eq. 15",
        "slider rates per rates of height, pitch, roll: largest gap of nine entries",
        largest_gap(columns.as_slice(), checked.as_slice()),
        None,
        Gate::AtMost(6e-9),
    );
    rows.push(jacobian.because("against an independent program; the paper prints the symbol alone"));
    let inverse = (checked * forward - Matrix3::identity()).amax();
    rows.push(Row::new("eq. 15", "the same against the library's solution of the loops, largest gap", inverse, None, Gate::AtMost(1e-7)));
    rows.push(Row::new(
        "section 2",
        "inverse then forward kinematics over 40 poses, largest gap, m or rad",
        gap,
        None,
        Gate::AtMost(1e-12),
    ));
    Ok(rows)
}
