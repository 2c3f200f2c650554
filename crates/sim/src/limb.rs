//! A limb in the robot: what a passive ankle or knee does to the link it is strapped to, and what the person adds.
//!
//! A [`Limb`] is a function of a link's pose and velocity, [`Worn`] puts [`Impedance`]s at the joints of drives, [`Strapped`] a limb at a link; the one state is the person's own
//! ([`Patient`]). Efforts and wrenches are those on
//! the robot.

mod end_stop;
mod patient;
mod strapped;
mod worn;

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::math;
use pkm_dyn::spatial::{Force, Inertia, Motion, Pose, skew};

pub use end_stop::EndStops;
pub use patient::{Patient, PatientConfig, Will};
pub use strapped::Strapped;
pub use worn::Worn;

use crate::error::SimError;

/// Passive impedance of one coordinate: a joint, or an axis of a [`Limb`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impedance {
    /// `[N/m | N·m/rad]`.
    pub stiffness: f64,
    /// `[N·s/m | N·m·s/rad]`.
    pub damping: f64,
    /// Where it rests `[m | rad]`.
    pub rest: f64,
    /// Ends of its range.
    pub stops: EndStops,
}

impl Impedance {
    /// None at all.
    pub const FREE: Self = Self { stiffness: 0.0, damping: 0.0, rest: 0.0, stops: EndStops::NONE };

    /// Whether it only stores and takes energy.
    ///
    /// # Errors
    /// The first number that is negative or none.
    pub fn check(&self) -> Result<(), SimError> {
        for (what, value) in [("stiffness of a limb", self.stiffness), ("damping of a limb", self.damping)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SimError::Scenario { what, value, limit: "must be finite and not negative" });
            }
        }
        if !self.rest.is_finite() {
            return Err(SimError::Scenario { what: "rest of a limb", value: self.rest, limit: "must be finite" });
        }
        self.stops.check()
    }

    /// Effort on the robot at position `q` and velocity `v` `[N | N·m]`.
    #[must_use]
    pub fn effort(&self, q: f64, v: f64) -> f64 {
        self.stiffness * (self.rest - q) - self.damping * v + self.stops.effort(q, v)
    }

    /// Energy stored at position `q` `[J]`.
    #[must_use]
    pub fn energy(&self, q: f64) -> f64 {
        let stretch = q - self.rest;
        0.5 * self.stiffness * stretch * stretch + self.stops.energy(q)
    }
}

/// A limb strapped to a link: six impedances about a rest pose, and its own inertia.
///
/// Its coordinates are the link's displacement from rest, first along the rest frame's axes, then as a rotation vector. The wrench is the exact
/// gradient of the energy in them, so however large the turn, going round a closed path at rest yields nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limb {
    /// Pose of the link at which the limb rests, in the root frame.
    pub rest: Pose,
    /// Along x, y, z of the rest frame `[m]`, then about them `[rad]`.
    pub axes: [Impedance; 6],
    /// Mass, first moment and inertia in the link's frame; on a model they belong to the link's own.
    pub inertia: Inertia,
}

impl Limb {
    /// A limb without any impedance or mass, resting at `rest`.
    #[must_use]
    pub fn free(rest: Pose) -> Self {
        Self { rest, axes: [Impedance::FREE; 6], inertia: Inertia::default() }
    }

    /// Whether it only stores and takes energy.
    ///
    /// # Errors
    /// The first number that is negative or none.
    pub fn check(&self) -> Result<(), SimError> {
        self.axes.iter().try_for_each(Impedance::check)
    }

    /// Its coordinates with the link at `pose` in the root frame `[m, rad]`.
    #[must_use]
    pub fn displacement(&self, pose: &Pose) -> [f64; 6] {
        let from_rest = self.rest.inverse().compose(pose);
        let turn = from_rest.rotation_vector();
        core::array::from_fn(|i| if i < 3 { from_rest.translation[i] } else { turn[i - 3] })
    }

    /// Their rates, with the link moving at `velocity` in its own frame `[m/s, rad/s]`.
    #[must_use]
    pub fn rate(&self, pose: &Pose, velocity: &Motion) -> [f64; 6] {
        let from_rest = self.rest.inverse().compose(pose);
        let linear = from_rest.rotation * velocity.linear;
        let turn = inverse_right_jacobian(&from_rest.rotation_vector()) * velocity.angular;
        core::array::from_fn(|i| if i < 3 { linear[i] } else { turn[i - 3] })
    }

    /// Wrench on the link, in its frame and at its origin, of the impedances and of the person's own `efforts` in the limb's coordinates
    /// `[N, N·m]`.
    #[must_use]
    pub fn wrench(&self, pose: &Pose, velocity: &Motion, efforts: &[f64; 6]) -> Force {
        let from_rest = self.rest.inverse().compose(pose);
        let to_rates = inverse_right_jacobian(&from_rest.rotation_vector());
        let (x, rate) = (self.displacement(pose), self.rate(pose, velocity));
        let effort = |i: usize| self.axes[i].effort(x[i], rate[i]) + efforts[i];
        let (linear, angular) = (Vector3::from_fn(|i, _| effort(i)), Vector3::from_fn(|i, _| effort(i + 3)));
        // The power is that in the coordinates: rates = (R·v, J⁻¹·ω), so the wrench is (Rᵀ·f, J⁻ᵀ·m).
        Force { linear: from_rest.rotation.tr_mul(&linear), angular: to_rates.tr_mul(&angular) }
    }

    /// Wrench on the link of the limb's inertia, gravity left out, at spatial velocity and acceleration of the link in its own frame.
    #[must_use]
    pub fn inertia_wrench(&self, velocity: &Motion, acceleration: &Motion) -> Force {
        let momentum = self.inertia.apply(velocity);
        let force = self.inertia.apply(acceleration) + velocity.cross_force(&momentum);
        Force { linear: -force.linear, angular: -force.angular }
    }

    /// Energy stored with the link at `pose` `[J]`.
    #[must_use]
    pub fn energy(&self, pose: &Pose) -> f64 {
        self.axes.iter().zip(self.displacement(pose)).map(|(axis, x)| axis.energy(x)).sum()
    }
}

/// Turn below which the series is the function to the last bit.
const SMALL_TURN: f64 = 1e-4;

/// `J⁻¹` of `φ' = J⁻¹·ω` with ω in the turned frame, for a rotation vector of at most half a turn.
fn inverse_right_jacobian(turn: &Vector3<f64>) -> Matrix3<f64> {
    let angle = math::sqrt(turn.dot(turn));
    let c = if angle < SMALL_TURN {
        1.0 / 12.0
    } else {
        let (s, c) = math::sin_cos(0.5 * angle);
        (1.0 - 0.5 * angle * c / s) / (angle * angle)
    };
    let cross = skew(turn);
    Matrix3::identity() + cross * 0.5 + cross * cross * c
}

#[cfg(test)]
mod tests;
