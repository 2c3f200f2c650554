//! Numbers of a guarded controller's limits.

use crate::controller::ConfigError;

/// What the drives are told after a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Safe<const N: usize> {
    /// Nothing: for robots that stay where they are, or fall safely.
    Zero,
    /// The last finite effort of the model: the weight is carried, nothing pushes.
    Weight,
    /// The same, and resistance against motion per speed, as long as positions are numbers `[N·s/m | N·m·s/rad]`.
    Damped([f64; N]),
    /// From the last command to zero at this rate `[N/s | N·m/s]`.
    Ramp([f64; N]),
}

/// Numbers of a [`super::Limited`]; use infinity for what is not limited.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitsConfig<const N: usize> {
    /// Smallest positions `[m | rad]`.
    pub q_lower: [f64; N],
    /// Largest positions `[m | rad]`.
    pub q_upper: [f64; N],
    /// How far outside its range a drive may be found before that is a fault `[m | rad]`.
    pub q_tolerance: f64,
    /// Deceleration that each drive surely reaches `[m/s² | rad/s²]`; infinity keeps no way to stop: the ends are then those of references,
    /// and beyond them a fault.
    pub deceleration: [f64; N],
    /// Effort beyond the model's that surely gives it `[N | N·m]`; finite where its range or its speed is limited.
    pub brake: [f64; N],
    /// Speed from which on a drive is not pushed any faster `[m/s | rad/s]`; a fault at one and a half times that.
    pub v_limit: [f64; N],
    /// Largest effort `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Largest change of an effort per second `[N/s | N·m/s]`; braking is not held back by it.
    pub tau_rate: [f64; N],
    /// Components of the wrench from which on the robot yields `[N, N·m]`.
    pub wrench_yield: [f64; 6],
    /// Components of the wrench that are a fault `[N, N·m]`.
    pub wrench_limit: [f64; 6],
    /// Control period `[s]`.
    pub dt: f64,
    /// Longest time between two steps `[s]`.
    pub dt_limit: f64,
    /// Steps in a row with the same measurement to the last bit that are allowed; 0 is as many as there are.
    pub repeats: u32,
    /// What the drives are told after a fault.
    pub safe: Safe<N>,
}

/// Refuses what makes the way to stop no number: an infinite brake where there is an end to stop at, or a speed.
pub(super) fn check_stopping<const N: usize>(c: &LimitsConfig<N>) -> Result<(), ConfigError> {
    for drive in 0..N {
        let has_end = c.q_lower[drive].is_finite() || c.q_upper[drive].is_finite();
        let stops = (has_end && c.deceleration[drive].is_finite()) || c.v_limit[drive].is_finite();
        if stops && !c.brake[drive].is_finite() {
            let limit = "must be finite where there is something to stop at";
            return Err(ConfigError { drive, what: "brake", value: c.brake[drive], limit });
        }
    }
    Ok(())
}
