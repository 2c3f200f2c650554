//! Spatial vectors and transforms. Stacking is [linear; angular] throughout, as in Pinocchio.

mod force;
mod inertia;
mod motion;
mod pose;

pub use force::Force;
pub use inertia::Inertia;
pub use motion::Motion;
pub use pose::Pose;
pub(crate) use pose::{log3, rotation_about, rotation_exp};

use nalgebra::{Matrix3, Vector3};

/// The matrix `[v]×` with `[v]× w = v × w`.
#[must_use]
#[inline]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}
