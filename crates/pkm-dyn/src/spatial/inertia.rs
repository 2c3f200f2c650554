//! Spatial inertia in the form the algorithms use.

use nalgebra::{Matrix3, Vector3};

use super::{Force, Motion};

/// Mass, first moment and rotational inertia of a body, all about its frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass `[kg]`.
    pub mass: f64,
    /// Mass times centre of mass `[kg·m]`.
    pub first_moment: Vector3<f64>,
    /// Rotational inertia about the origin `[kg·m²]`.
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    /// `I·m`: momentum of velocity `m`, or the wrench of acceleration `m` without the velocity term.
    #[must_use]
    pub fn apply(&self, m: &Motion) -> Force {
        Force {
            linear: m.linear * self.mass + m.angular.cross(&self.first_moment),
            angular: self.rotational * m.angular + self.first_moment.cross(&m.linear),
        }
    }
}
