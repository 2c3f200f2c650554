//! McDaid's ankle robot at an orientation of the foot: its legs' Jacobian, and the linear model of drives and ankle there.
//!
//! Geometry from [McDaid] Table 8.2; surroundings that the chapter does not give are chosen so that the uniform gains become unstable where
//! the paper's do (10 for P, 16 for PD).

use nalgebra::{DMatrix, Matrix3, Vector3};
use pkm_ctrl::design::force_loop::{DriveTrain, ForceLoop, Sampling, Surroundings};
use pkm_dyn::math::sin_cos;

/// Sample time `[s]`.
pub(crate) const DT: f64 = 0.002;
/// Gains of the proposed controller in the directions of the effective mass, and of the internal force.
pub(crate) const PROPOSED: [f64; 4] = [5.0, 18.0, 60.0, 10.0];
/// Derivative time of the PD filter `[s]`.
pub(crate) const K_D: f64 = 7.98e-4;

fn rotations(t: [f64; 3]) -> [Matrix3<f64>; 3] {
    let [(sa, ca), (sb, cb), (sc, cc)] = t.map(sin_cos);
    [
        Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca),
        Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb),
        Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0),
    ]
}

/// Four points: front pair and rear pair at an angle from the axis of the foot.
fn points(front: f64, rear: f64, angle_deg: f64, z: f64) -> [Vector3<f64>; 4] {
    let (s, c) = sin_cos(angle_deg.to_radians());
    [
        Vector3::new(front * s, front * c, z),
        Vector3::new(-front * s, front * c, z),
        Vector3::new(-rear * s, -rear * c, z),
        Vector3::new(rear * s, -rear * c, z),
    ]
}

/// Rates of the four legs over rates of the Euler angles, 4 × 3 `[m/rad]`.
pub(crate) fn jacobian(t: [f64; 3]) -> DMatrix<f64> {
    let [x, y, z] = rotations(t);
    let R = x * y * z;
    let axes = Matrix3::from_columns(&[Vector3::x(), x * Vector3::y(), x * y * Vector3::z()]);
    let (base, platform) = (points(0.18, 0.20, 45.0, 0.0), points(0.08, 0.09, 60.0, -0.05));
    let mut J = DMatrix::zeros(4, 3);
    for i in 0..4 {
        let arm = R * platform[i];
        let leg = Vector3::new(0.0, 0.0, 0.36) + arm - base[i];
        J.row_mut(i).copy_from(&(arm.cross(&leg.normalize()).transpose() * axes));
    }
    J
}

/// Rotation of the foot.
pub(crate) fn rotation(t: [f64; 3]) -> DMatrix<f64> {
    let [x, y, z] = rotations(t);
    let R = x * y * z;
    DMatrix::from_fn(3, 3, |i, j| R[(i, j)])
}

fn diagonal(values: [f64; 3]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(&values))
}

/// Platform and foot about the ankle, \[McDaid, eq. 8.49\] for the damping.
pub(crate) fn surroundings() -> Surroundings {
    let stiffness = diagonal([30.0, 20.0, 20.0]);
    let damping = DMatrix::identity(3, 3) * 0.5 + &stiffness * 0.002;
    Surroundings { inertia: diagonal([0.055, 0.035, 0.06]), damping, stiffness }
}

/// Drives and ankle at one orientation of the foot `[rad]`; `derivative` time of the filter `[s]`.
pub(crate) fn force_loop(t: [f64; 3], derivative: f64) -> ForceLoop {
    let sampling = Sampling { dt: DT, derivative };
    ForceLoop::try_new(DriveTrain::ANKLE, surroundings(), jacobian(t), sampling).expect("a model")
}
