//! Spatial velocities and accelerations.

use core::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::Vector3;

use super::Force;

/// Velocity or acceleration of a body at its frame's origin, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Linear part `[m/s]` or `[m/s²]`.
    pub linear: Vector3<f64>,
    /// Angular part `[rad/s]` or `[rad/s²]`.
    pub angular: Vector3<f64>,
}

impl Default for Motion {
    fn default() -> Self {
        Self::zero()
    }
}

impl Motion {
    /// At rest.
    #[must_use]
    #[inline]
    pub fn zero() -> Self {
        Self { linear: Vector3::zeros(), angular: Vector3::zeros() }
    }

    /// The same motion of the body, seen at another point `p` `[m]` of it.
    #[must_use]
    #[inline]
    pub fn at(&self, p: &Vector3<f64>) -> Self {
        Self { linear: self.linear + self.angular.cross(p), angular: self.angular }
    }

    /// Motion cross product `self × other`.
    #[must_use]
    #[inline]
    pub fn cross(&self, other: &Self) -> Self {
        Self { linear: self.angular.cross(&other.linear) + self.linear.cross(&other.angular), angular: self.angular.cross(&other.angular) }
    }

    /// Dual cross product `self ×* f`.
    #[must_use]
    #[inline]
    pub fn cross_force(&self, f: &Force) -> Force {
        Force { linear: self.angular.cross(&f.linear), angular: self.angular.cross(&f.angular) + self.linear.cross(&f.linear) }
    }

    /// Power of a wrench on this motion `[W]`.
    #[must_use]
    #[inline]
    pub fn dot(&self, f: &Force) -> f64 {
        self.linear.dot(&f.linear) + self.angular.dot(&f.angular)
    }
}

impl Add for Motion {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { linear: self.linear + other.linear, angular: self.angular + other.angular }
    }
}

impl AddAssign for Motion {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Motion {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { linear: self.linear - other.linear, angular: self.angular - other.angular }
    }
}

impl Mul<f64> for Motion {
    type Output = Self;

    #[inline]
    fn mul(self, k: f64) -> Self {
        Self { linear: self.linear * k, angular: self.angular * k }
    }
}
