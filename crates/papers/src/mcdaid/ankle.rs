//! The ankle robot at an orientation of the foot: its legs and their Jacobian, and the linear model of drives and ankle there.
//!
//! Geometry from \[McDaid, Table 8.2\]; surroundings that the chapter does not give are chosen so that uniform gains become unstable about
//! where the paper's do (10 for P, 16 for PD).

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pkm_ctrl::design::force_loop::{DriveTrain, ForceLoop, Sampling, Surroundings, Weights};
use pkm_ctrl::design::mu::{Block, StateSpace, Structure};
use pkm_dyn::math::sin_cos;

use crate::error::PaperError;
use crate::refused::refused;

/// Sample time `[s]`.
pub const DT: f64 = 0.002;

/// Derivative time of the PD filter `[s]`.
pub const K_D: f64 = 7.98e-4;

/// Gains of the proposed controller in the directions of the effective mass, largest first, and of the internal force.
pub const PROPOSED: [f64; 4] = [5.0, 18.0, 60.0, 10.0];

/// The same with a smallest gain of 14.
pub const PROPOSED_14: [f64; 4] = [14.0, 18.0, 60.0, 14.0];

/// Uncertainty of the ankle \[McDaid, Table 8.4\].
pub const WEIGHTS: Weights = Weights { inertia: 0.002, damping: 0.1, stiffness: 0.1 };

fn rotations(angles: [f64; 3]) -> [Matrix3<f64>; 3] {
    let [(sa, ca), (sb, cb), (sc, cc)] = angles.map(sin_cos);
    [
        Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca),
        Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb),
        Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0),
    ]
}

/// Four points: front pair and rear pair at an angle from the axis of the foot.
fn points(front: f64, rear: f64, degrees: f64, z: f64) -> [Vector3<f64>; 4] {
    let (s, c) = sin_cos(degrees.to_radians());
    [
        Vector3::new(front * s, front * c, z),
        Vector3::new(-front * s, front * c, z),
        Vector3::new(-rear * s, -rear * c, z),
        Vector3::new(rear * s, -rear * c, z),
    ]
}

/// Legs from base to platform `[m]` with the foot at XYZ Euler `angles` `[rad]` about a centre that lies off the nominal one by `offset`
/// `[m]`, and the platform's points from the ankle.
fn legs(angles: [f64; 3], offset: Vector3<f64>) -> [[Vector3<f64>; 2]; 4] {
    let [x, y, z] = rotations(angles);
    let R = x * y * z;
    let (base, platform) = (points(0.18, 0.20, 45.0, 0.0), points(0.08, 0.09, 60.0, -0.05));
    core::array::from_fn(|i| {
        // The platform stays where it is bolted to: points move against the centre of the ankle.
        let arm = R * (platform[i] - offset);
        [Vector3::new(0.0, 0.0, 0.36) + offset + arm - base[i], arm]
    })
}

/// Lengths of the four legs `[m]`; arguments as for the rotation, and how far the ankle's centre lies off the nominal one `[m]`.
#[must_use]
pub fn lengths(angles: [f64; 3], offset: [f64; 3]) -> [f64; 4] {
    legs(angles, offset.into()).map(|[leg, _]| leg.norm())
}

/// Rates of the four legs over rates of the Euler angles, 4 × 3 `[m/rad]`.
#[must_use]
pub fn jacobian(angles: [f64; 3]) -> DMatrix<f64> {
    let [x, y, _] = rotations(angles);
    let axes = Matrix3::from_columns(&[Vector3::x(), x * Vector3::y(), x * y * Vector3::z()]);
    let mut J = DMatrix::zeros(4, 3);
    for (i, [leg, arm]) in legs(angles, Vector3::zeros()).into_iter().enumerate() {
        J.row_mut(i).copy_from(&(arm.cross(&leg.normalize()).transpose() * axes));
    }
    J
}

/// Rotation of the foot at XYZ Euler `angles` `[rad]`, `Rx·Ry·Rz`.
#[must_use]
pub fn rotation(angles: [f64; 3]) -> DMatrix<f64> {
    let [x, y, z] = rotations(angles);
    let R = x * y * z;
    DMatrix::from_fn(3, 3, |i, j| R[(i, j)])
}

fn diagonal(values: [f64; 3]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_row_slice(&values))
}

/// Platform and foot about the ankle, \[McDaid, eq. 8.49\] for the damping.
#[must_use]
pub fn surroundings() -> Surroundings {
    let stiffness = diagonal([30.0, 20.0, 20.0]);
    let damping = DMatrix::identity(3, 3) * 0.5 + &stiffness * 0.002;
    Surroundings { inertia: diagonal([0.055, 0.035, 0.06]), damping, stiffness }
}

/// Drives and ankle at one orientation of the foot `[rad]`; `derivative` time of the filter `[s]`.
///
/// # Errors
/// An orientation at which the legs hold the foot no more.
pub fn force_loop(angles: [f64; 3], derivative: f64) -> Result<ForceLoop, PaperError> {
    let sampling = Sampling { dt: DT, derivative };
    ForceLoop::try_new(DriveTrain::ANKLE, surroundings(), jacobian(angles), sampling).map_err(refused("force loop"))
}

/// Pseudo-inverse of [`jacobian`], 3 × 4 `[rad/m]`.
///
/// # Errors
/// An orientation at which the legs hold the foot no more.
pub fn pseudo_inverse(angles: [f64; 3]) -> Result<DMatrix<f64>, PaperError> {
    jacobian(angles).pseudo_inverse(1e-12).map_err(refused("legs"))
}

/// Direction of the forces that strain the robot and move nothing, of length one.
///
/// # Errors
/// An orientation at which the legs hold the foot no more.
pub fn null_direction(angles: [f64; 3]) -> Result<DVector<f64>, PaperError> {
    let null = DMatrix::<f64>::identity(4, 4) - jacobian(angles) * pseudo_inverse(angles)?;
    Ok(null.column(0).into_owned().normalize())
}

/// The closed loop at one orientation `[rad]` with its uncertainty pulled out; gains as in [`PROPOSED`].
///
/// # Errors
/// As [`force_loop`].
pub fn uncertain_loop(angles: [f64; 3], gains: [f64; 4]) -> Result<StateSpace, PaperError> {
    let model = force_loop(angles, K_D)?;
    model.uncertain(&model.gain(|i| gains[i]), &rotation(angles), WEIGHTS).map_err(refused("uncertain loop"))
}

/// Its blocks: three distinct inertias, then damping and stiffness of the ankle as full matrices.
///
/// # Errors
/// Never.
pub fn structure() -> Result<Structure, PaperError> {
    let (real, full) = (Block::Real { repeats: 1 }, Block::Full { rows: 3, cols: 3 });
    Structure::try_new(vec![real, real, real, full, full]).map_err(refused("structure"))
}
