//! Wrenches.

use core::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::Vector3;

/// Force and moment about the frame's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force {
    /// Force `[N]`.
    pub linear: Vector3<f64>,
    /// Moment `[N·m]`.
    pub angular: Vector3<f64>,
}

impl Default for Force {
    fn default() -> Self {
        Self::zero()
    }
}

impl Force {
    /// No wrench.
    #[must_use]
    #[inline]
    pub fn zero() -> Self {
        Self { linear: Vector3::zeros(), angular: Vector3::zeros() }
    }

    /// The same wrench, known about the present origin, about a point `p` `[m]`.
    #[must_use]
    #[inline]
    pub fn about(&self, p: &Vector3<f64>) -> Self {
        Self { linear: self.linear, angular: self.angular - p.cross(&self.linear) }
    }
}

impl Add for Force {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { linear: self.linear + other.linear, angular: self.angular + other.angular }
    }
}

impl AddAssign for Force {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Force {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { linear: self.linear - other.linear, angular: self.angular - other.angular }
    }
}

impl Mul<f64> for Force {
    type Output = Self;

    #[inline]
    fn mul(self, k: f64) -> Self {
        Self { linear: self.linear * k, angular: self.angular * k }
    }
}
