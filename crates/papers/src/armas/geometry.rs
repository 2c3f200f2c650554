//! Positions of the legs for a pose of the platform, as the paper's equations give them \[Armas, eq. 4-10\].

use nalgebra::{Matrix4, Vector3, Vector4};
use pkm_dyn::math;
use pkm_dyn::spatial::Pose;

use crate::error::PaperError;
use crate::row::{Gate, Row};

/// Radii and angles of the joints on base and platform, and the hinge of leg 4 \[Armas, Table 1\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table1 {
    base: [[f64; 2]; 3],
    platform: [[f64; 2]; 3],
    ds: f64,
}

impl Table1 {
    /// Radius of the base, radius of the platform and place of leg 4's hinge `[m]`; angles FD, FI, MD, MI `[deg]`, which run from x to leg
    /// 2 and, downwards, to leg 3. Leg 1 is at 180 degrees.
    #[must_use]
    pub fn new([base, platform, ds]: [f64; 3], degrees: [f64; 4]) -> Self {
        let at = |radius: f64, degrees: f64| {
            let (s, c) = math::sin_cos(degrees.to_radians());
            [radius * c, radius * s]
        };
        let [fd, fi, md, mi] = degrees;
        Self { base: [[-base, 0.0], at(base, fd), at(base, -fi)], platform: [[-platform, 0.0], at(platform, md), at(platform, -mi)], ds }
    }

    /// The geometry that the paper ends with.
    #[must_use]
    pub fn last() -> Self {
        Self::new([0.4, 0.3, 0.15], [90.0, 45.0, 50.0, 90.0])
    }

    /// The geometry that the paper starts with.
    #[must_use]
    pub fn first() -> Self {
        Self::new([0.4, 0.2, 0.0], [50.0, 40.0, 40.0, 30.0])
    }

    /// Place of leg 4's hinge along x `[m]`.
    #[must_use]
    pub fn hinge(&self) -> f64 {
        self.ds
    }

    /// Two angles and the length of each outer leg, then q41 and q42, for a pose X, Z, theta, psi `[m | rad]`.
    #[must_use]
    pub fn inverse_kinematics(&self, [x, z, theta, psi]: [f64; 4]) -> [f64; 11] {
        let about = |rpy| Pose::from_xyz_rpy([0.0; 3], rpy).rotation;
        let turn = about([0.0, theta, 0.0]) * about([0.0, 0.0, psi]);
        let mut q = [0.0; 11];
        for leg in 0..3 {
            let ([px, py], [bx, by]) = (self.platform[leg], self.base[leg]);
            let l = Vector3::new(x, 0.0, z) + turn * Vector3::new(px, py, 0.0) - Vector3::new(bx, by, 0.0);
            let length = l.norm();
            q[3 * leg..3 * leg + 3].copy_from_slice(&[math::atan2(l.z, l.x), math::asin(l.y / length), length]);
        }
        // DIFFERENCE (10) has no ds; it holds for the starting geometry alone. The text writes q44 for q42.
        q[9] = math::atan2(z, x - self.ds);
        q[10] = math::hypot(x - self.ds, z);
        q
    }

    /// Lengths of the four drives `[m]` at a pose X, Z, theta, psi `[m | rad]`.
    #[must_use]
    pub fn lengths(&self, pose: [f64; 4]) -> [f64; 4] {
        let q = self.inverse_kinematics(pose);
        [q[2], q[5], q[8], q[10]]
    }

    /// Singular values of the drives' lengths differentiated by X, Z, theta, psi, largest first.
    #[must_use]
    pub fn singular_values(&self, pose: [f64; 4]) -> [f64; 4] {
        let column = |k: usize| {
            let along = |h: f64| {
                let mut at = pose;
                at[k] += h;
                Vector4::from(self.lengths(at))
            };
            // Five points: the error falls with the fourth power of the step.
            let h = 1e-3;
            ((along(h) - along(-h)) * 8.0 - (along(2.0 * h) - along(-2.0 * h))) / (12.0 * h)
        };
        let values = Matrix4::from_columns(&[column(0), column(1), column(2), column(3)]).singular_values();
        let mut sorted: [f64; 4] = values.into();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted
    }
}

/// Pose and its rates that the computed numbers belong to: X, Z, theta, psi.
pub const POSE: [f64; 4] = [0.05, 0.65, 0.10, -0.05];
/// Rates there `[m/s | rad/s]`.
pub const RATE: [f64; 4] = [0.05, -0.03, 0.2, 0.1];
/// Accelerations there `[m/s² | rad/s²]`.
pub const ACCELERATION: [f64; 4] = [0.4, -0.2, 0.5, -0.3];

/// Coordinates at [`POSE`], computed by another program; q11 q12 q13, q21 …, q41 q42.
const POSE_Q: [f64; 11] = [
    1.351_034_271,
    0.021_518_77,
    0.696_829_242,
    1.188_632_623,
    -0.259_442_724,
    0.702_074_883,
    1.934_201_829,
    -0.024_072_73,
    0.697_219_921,
    1.723_445_655,
    0.657_647_322,
];

/// Names of the eleven.
const NAMES: [&str; 11] = ["q11", "q12", "q13", "q21", "q22", "q23", "q31", "q32", "q33", "q41", "q42"];

/// The same coordinates in the shipped robot's closed loops: one row each, held against other software's numbers.
fn coordinate_rows() -> Vec<Row> {
    let found = Table1::last().inverse_kinematics(POSE);
    let row = |((name, ours), checked): ((&&str, f64), f64)| {
        let row = Row::held_against(
            "eq. 4-10",
            format!("{name} at X .05, Z .65, theta .10, psi -.05, m or rad"),
            ours,
            None,
            (Gate::Within(6e-10), checked),
        );
        row.because("(10) lacks ds, the hinge of leg 4: X = ds + q42 cos q41; the text writes q44 for q42")
    };
    NAMES.iter().zip(found).zip(POSE_Q).map(row).collect()
}

/// Section 2.2: lengths at one pose, and what they need.
fn section_2_2() -> Vec<Row> {
    let pose = [0.0, 0.2, 0.0, 0.0];
    let smaller = Table1::new([0.3, 0.2, 0.0], [50.0, 40.0, 40.0, 30.0]).lengths(pose);
    let own = Table1::first().lengths(pose);
    let mut rows = Vec::new();
    for (name, k, paper, checked) in [("q13", 0, 0.223_606_797_7, 0.282_843), ("q23", 1, 0.227_646_809_0, 0.287_108)] {
        let what = format!("{name} at X = theta = psi = 0, Z = .2, radius of the base .3 m");
        rows.push(
            Row::new("section 2.2", what, smaller[k], Some(paper), Gate::Within(2e-10))
                .because("the printed lengths need a radius of .3 m"),
        );
        let what = format!("{name} there with the radius of Table 1, .4 m");
        let row = Row::held_against("section 2.2", what, own[k], Some(paper), (Gate::Within(6e-7), checked));
        rows.push(row.not_reproducible("the printed lengths belong to a base of .3 m, Table 1 has .4 m"));
    }
    rows
}

/// Limits (31), which are lengths of the starting geometry.
fn limit_rows() -> Vec<Row> {
    let mut rows = Vec::new();
    let ends = [("shortest", 0.3758, [0.4257, 0.4285, 0.4285, 0.3758]), ("longest", 0.5753, [0.6090, 0.6110, 0.6110, 0.5753])];
    for (end, z, printed) in ends {
        let found = Table1::first().lengths([0.0, z, 0.0, 0.0]);
        for (leg, (ours, paper)) in found.into_iter().zip(printed).enumerate() {
            let row = Row::new(
                "eq. 31",
                format!("{end} length of leg {} in the starting geometry, m", leg + 1),
                ours,
                Some(paper),
                Gate::Within(1e-4),
            );
            rows.push(row.because(format!(
                "the limits are lengths of the starting geometry at X = theta = psi = 0, Z = {z}; they do not hold for the final one"
            )));
        }
    }
    let there = Table1::last().lengths([0.0, 0.3758, 0.0, 0.0])[0];
    let row = Row::new(
        "eq. 31",
        "length of leg 1 at that pose in the final geometry, off the printed limit, m",
        (there - 0.4257).abs(),
        None,
        Gate::AtLeast(0.03),
    );
    rows.push(row.not_reproducible("the printed limits cannot be those of the robot that was built"));
    rows
}

/// How near to singular both geometries are.
fn singularity_rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for z in [0.4, 0.5, 0.6] {
        let start = Table1::first().singular_values([0.0, z, 0.0, 0.0]);
        let row = Row::held_against(
            "section 2.2",
            format!("smallest singular value of the starting Jacobian at Z = {z}"),
            start[3],
            None,
            (Gate::Within(5e-3), 0.02),
        );
        rows.push(row.not_reproducible(format!(
            "\"the Jacobian is now full range\": of full rank it is, with condition numbers up to {:.0}",
            start[0] / start[3]
        )));
        let last = Table1::last().singular_values([0.0, z, 0.0, 0.0]);
        let row = Row::held_against(
            "Table 1",
            format!("smallest singular value of the final Jacobian at Z = {z}"),
            last[3],
            None,
            (Gate::Within(0.04), 0.12),
        );
        rows.push(row.because("the final geometry is four to eight times as far from a singularity"));
    }
    rows
}

/// All of them.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = coordinate_rows();
    rows.extend(section_2_2());
    rows.extend(limit_rows());
    rows.extend(singularity_rows());
    Ok(rows)
}
