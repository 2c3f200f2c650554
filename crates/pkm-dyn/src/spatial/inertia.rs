//! Spatial inertia in the form the algorithms use.

use core::ops::AddAssign;

use nalgebra::{Matrix3, Vector3};

use super::{Force, Motion, Pose};

/// Mass, first moment and rotational inertia of a body, all about its frame's origin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inertia {
    /// Mass `[kg]`.
    pub mass: f64,
    /// Mass times centre of mass `[kg·m]`.
    pub first_moment: Vector3<f64>,
    /// Rotational inertia about the origin `[kg·m²]`.
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    /// The same body seen in a frame A, where `pose` is the pose of the present frame in A.
    #[must_use]
    #[inline]
    pub fn transformed(&self, pose: &Pose) -> Self {
        let (r, t) = (&pose.rotation, &pose.translation);
        let h = r * self.first_moment;
        // About the new origin: the new first moment is h + m·t; 2 t·s − (t sᵀ + s tᵀ) with s = h + m·t/2 shifts the inertia.
        let s = h + t * (0.5 * self.mass);
        let (x, y, z) = (t.x * s.x, t.y * s.y, t.z * s.z);
        let (xy, xz, yz) = (-(t.x * s.y + s.x * t.y), -(t.x * s.z + s.x * t.z), -(t.y * s.z + s.y * t.z));
        // R·I·Rᵀ is symmetric: six of its nine entries are computed.
        let ri = r * self.rotational;
        let entry = |i: usize, j: usize| ri[(i, 0)] * r[(j, 0)] + ri[(i, 1)] * r[(j, 1)] + ri[(i, 2)] * r[(j, 2)];
        let (ixx, ixy, ixz) = (entry(0, 0) + 2.0 * (y + z), entry(0, 1) + xy, entry(0, 2) + xz);
        let (iyy, iyz, izz) = (entry(1, 1) + 2.0 * (x + z), entry(1, 2) + yz, entry(2, 2) + 2.0 * (x + y));
        let rotational = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
        Self { mass: self.mass, first_moment: h + t * self.mass, rotational }
    }

    /// `I·m`: momentum of velocity `m`, or the wrench of acceleration `m` without the velocity term.
    #[must_use]
    #[inline]
    pub fn apply(&self, m: &Motion) -> Force {
        Force {
            linear: m.linear * self.mass + m.angular.cross(&self.first_moment),
            angular: self.rotational * m.angular + self.first_moment.cross(&m.linear),
        }
    }
}

impl AddAssign for Inertia {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.mass += other.mass;
        self.first_moment += other.first_moment;
        self.rotational += other.rotational;
    }
}
