//! `[limits]`: what the file states, else what the robot's joints do.

use super::section::{ANY, Allowed, NOT_NEGATIVE, POSITIVE, Section, UP_TO_INFINITY};
use super::{FileError, Site};
use crate::limits::{LimitsConfig, Safe};

/// How far outside its range a drive may be found unless the file says otherwise `[m | rad]`.
const TOLERANCE: f64 = 0.01;

/// Periods between two steps that are allowed unless the file says otherwise.
const LATE_PERIODS: f64 = 5.0;

/// Whole numbers from zero.
const COUNT: Allowed = (|x| (0.0..=1e9).contains(&x) && x.fract() <= 0.0, "must be a whole number from 0 to 1e9");

/// Limits of a controller.
pub(super) struct Bounds<const N: usize> {
    pub(super) config: LimitsConfig<N>,
    /// Largest voltages, for drives that take them `[V]`.
    pub(super) u_limit: Option<[f64; N]>,
}

impl<const N: usize> Bounds<N> {
    pub(super) fn read(root: &Section<'_>, site: &Site<'_>) -> Result<Self, FileError> {
        let model = &site.robot.model;
        let of = |pick: fn(&pkm_dyn::model::Limits) -> f64| core::array::from_fn(|k| pick(&model.joints[model.actuators[k]].limits));
        let positive = |x: f64, none: f64| if x > 0.0 && x < none { x } else { none };
        let free = [f64::INFINITY; N];
        let mut config = LimitsConfig {
            q_lower: of(|l| l.lower),
            q_upper: of(|l| l.upper),
            q_tolerance: TOLERANCE,
            deceleration: free,
            brake: of(|l| l.effort).map(|x| positive(x, f64::MAX)),
            v_limit: of(|l| l.velocity).map(|x| positive(x, f64::INFINITY)),
            tau_limit: of(|l| l.effort).map(|x| positive(x, f64::MAX)),
            tau_rate: free,
            wrench_yield: [f64::INFINITY; 6],
            wrench_limit: [f64::INFINITY; 6],
            dt: site.dt(),
            dt_limit: LATE_PERIODS * site.dt(),
            repeats: 0,
            safe: Safe::Weight,
        };
        let Some(s) = root.section("limits")? else { return Ok(Self { config, u_limit: None }) };
        for (key, slot, allowed) in [
            ("q_lower", &mut config.q_lower, ANY),
            ("q_upper", &mut config.q_upper, ANY),
            ("deceleration", &mut config.deceleration, UP_TO_INFINITY),
            ("brake", &mut config.brake, UP_TO_INFINITY),
            ("v_limit", &mut config.v_limit, UP_TO_INFINITY),
            ("tau_limit", &mut config.tau_limit, POSITIVE),
            ("tau_rate", &mut config.tau_rate, UP_TO_INFINITY),
        ] {
            *slot = s.maybe_each(key, allowed)?.unwrap_or(*slot);
        }
        for (key, slot) in [("wrench_yield", &mut config.wrench_yield), ("wrench_limit", &mut config.wrench_limit)] {
            *slot = s.maybe_each(key, UP_TO_INFINITY)?.unwrap_or(*slot);
        }
        for (key, slot) in [("q_tolerance", &mut config.q_tolerance), ("dt_limit", &mut config.dt_limit)] {
            *slot = s.maybe(key, UP_TO_INFINITY)?.unwrap_or(*slot);
        }
        config.repeats = count(s.maybe("repeats", COUNT)?.unwrap_or(0.0));
        config.safe = match s.choice("safe", &["zero", "weight", "damped", "ramp"])?.as_deref() {
            Some("zero") => Safe::Zero,
            Some("damped") => Safe::Damped(s.each("safe_damping", NOT_NEGATIVE)?),
            Some("ramp") => Safe::Ramp(s.each("safe_rate", POSITIVE)?),
            _ => Safe::Weight,
        };
        Ok(Self { config, u_limit: s.maybe_each("u_limit", POSITIVE)? })
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: whole and 0 to 1e9")]
fn count(x: f64) -> u32 {
    x as u32
}
