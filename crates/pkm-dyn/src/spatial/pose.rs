//! Rigid transforms.

use nalgebra::{Matrix3, Vector3};

use super::{Force, Motion};
use crate::math;

/// Pose of a frame B in a frame A: `p_A = rotation · p_B + translation`, `[m]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Orientation of B in A.
    pub rotation: Matrix3<f64>,
    /// Origin of B in A `[m]`.
    pub translation: Vector3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

impl Pose {
    /// The pose that changes nothing.
    #[must_use]
    #[inline]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// From origin `[m]` and roll, pitch, yaw `[rad]` in URDF's convention `Rz(yaw)·Ry(pitch)·Rx(roll)`.
    #[must_use]
    #[inline]
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let (x, y, z) =
            (rotation_about(&Vector3::x(), rpy[0]), rotation_about(&Vector3::y(), rpy[1]), rotation_about(&Vector3::z(), rpy[2]));
        Self { rotation: z * y * x, translation: Vector3::from(xyz) }
    }

    /// Pose of C in A from B in A (`self`) and C in B.
    #[must_use]
    #[inline]
    pub fn compose(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.rotation * other.translation + self.translation }
    }

    /// Pose of A in B.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Self {
        let r = self.rotation.transpose();
        Self { rotation: r, translation: -(r * self.translation) }
    }

    /// The turn about a vector's direction by its length `[rad]`.
    #[must_use]
    pub fn from_rotation_vector(v: &Vector3<f64>) -> Self {
        Self { rotation: rotation_exp(v), translation: Vector3::zeros() }
    }

    /// Its rotation as a vector along the axis and as long as the angle, which is at most half a turn `[rad]`.
    #[must_use]
    pub fn rotation_vector(&self) -> Vector3<f64> {
        log3(&self.rotation)
    }

    /// A point of B seen in A `[m]`.
    #[must_use]
    #[inline]
    pub fn transform_point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.translation
    }

    /// A motion known in A, expressed in B (Pinocchio's `actInv`).
    #[must_use]
    #[inline]
    pub fn motion_to_local(&self, m: &Motion) -> Motion {
        let rt = self.rotation.transpose();
        Motion { linear: rt * (m.linear - self.translation.cross(&m.angular)), angular: rt * m.angular }
    }

    /// A motion known in B, expressed in A (Pinocchio's `act`).
    #[must_use]
    #[inline]
    pub fn motion_to_parent(&self, m: &Motion) -> Motion {
        let angular = self.rotation * m.angular;
        Motion { linear: self.rotation * m.linear + self.translation.cross(&angular), angular }
    }

    /// A wrench known in B, expressed in A.
    #[must_use]
    #[inline]
    pub fn force_to_parent(&self, f: &Force) -> Force {
        let linear = self.rotation * f.linear;
        Force { linear, angular: self.rotation * f.angular + self.translation.cross(&linear) }
    }
}

/// Rotation by `angle` `[rad]` about the unit vector `axis` (Rodrigues).
#[must_use]
pub(crate) fn rotation_about(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = math::sin_cos(angle);
    let k = 1.0 - c;
    let (x, y, z) = (axis.x, axis.y, axis.z);
    Matrix3::new(
        c + k * x * x,
        k * x * y - s * z,
        k * x * z + s * y,
        k * x * y + s * z,
        c + k * y * y,
        k * y * z - s * x,
        k * x * z - s * y,
        k * y * z + s * x,
        c + k * z * z,
    )
}

/// Rotation by a rotation vector `[rad]`.
#[must_use]
pub(crate) fn rotation_exp(turn: &Vector3<f64>) -> Matrix3<f64> {
    let angle = math::sqrt(turn.dot(turn));
    // Below 1e-150 the square of the angle underflows; to the last bit there is no turn then.
    if angle < 1e-150 { Matrix3::identity() } else { rotation_about(&(turn / angle), angle) }
}

/// Rotation vector `[rad]` of a rotation matrix, of length 0 to π.
///
/// By way of the quaternion, its largest entry first: the skew part of the matrix alone loses all digits at half a turn, and a pin that
/// closes a loop passes half a turn in every revolution.
#[must_use]
pub(crate) fn log3(r: &Matrix3<f64>) -> Vector3<f64> {
    let trace = r.trace();
    let k = (0..3).max_by(|&i, &j| r[(i, i)].total_cmp(&r[(j, j)])).unwrap_or(0);
    let (mut w, mut v);
    if trace > r[(k, k)] {
        w = 0.5 * math::sqrt(1.0 + trace);
        v = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]) * (0.25 / w);
    } else {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        v = Vector3::zeros();
        v[k] = 0.5 * math::sqrt(1.0 + r[(k, k)] - r[(i, i)] - r[(j, j)]);
        let f = 0.25 / v[k];
        v[i] = (r[(i, k)] + r[(k, i)]) * f;
        v[j] = (r[(j, k)] + r[(k, j)]) * f;
        w = (r[(j, i)] - r[(i, j)]) * f;
    }
    if w < 0.0 {
        (w, v) = (-w, -v);
    }
    let sine = math::sqrt(v.dot(&v));
    // Below 1e-12 the angle is twice its half's sine to the last bit.
    v * if sine > 1e-12 { 2.0 * math::atan2(sine, w) / sine } else { 2.0 }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;

    #[test]
    fn log_undoes_rotation_from_zero_to_half_a_turn() {
        let axis = Vector3::new(0.48, -0.6, 0.64);
        for angle in [0.0, 1e-12, 1e-6, 0.3, 2.0, 3.0, PI - 1e-6, PI - 1e-10, PI] {
            for axis in [axis, axis.yzx(), axis.zxy()] {
                let back = log3(&rotation_about(&axis, angle));
                let error = (back - axis * angle).norm();
                // At half a turn either direction of the axis is right.
                assert!(error < 2e-15 || (angle > PI - 1e-15 && (back + axis * angle).norm() < 2e-15), "{angle}: {error}");
            }
        }
    }

    #[test]
    fn motion_transforms_are_inverse() {
        let x = Pose::from_xyz_rpy([0.1, -0.2, 0.3], [0.4, 0.5, -0.6]);
        let m = Motion { linear: Vector3::new(1.0, 2.0, 3.0), angular: Vector3::new(-0.5, 0.1, 0.7) };
        let back = x.motion_to_parent(&x.motion_to_local(&m));
        assert!((back.linear - m.linear).norm() < 1e-14 && (back.angular - m.angular).norm() < 1e-14);
    }
}
