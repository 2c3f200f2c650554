//! Wrenches.

use core::ops::{Add, AddAssign, Sub};

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
    pub fn zero() -> Self {
        Self { linear: Vector3::zeros(), angular: Vector3::zeros() }
    }
}

impl Add for Force {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { linear: self.linear + other.linear, angular: self.angular + other.angular }
    }
}

impl AddAssign for Force {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Force {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { linear: self.linear - other.linear, angular: self.angular - other.angular }
    }
}
