//! How often is moved, controlled and recorded.

use super::{Scenario, whole};
use crate::error::SimError;

/// The plant moves at this rate or the next one above that is a multiple of the recording's and the controller's `[Hz]`.
const BASE_HZ: f64 = 1000.0;

/// The fastest base rate `[Hz]`.
const MOST_HZ: f64 = 2e5;

/// Two rates count as commensurate within this share: clocks are no better.
const SLACK: f64 = 1e-6;

/// Periods of the recording that a common multiple may have at most.
const MOST_PARTS: u32 = 1000;

/// Longest run `[base periods]`: five hours at 1 kHz.
pub(super) const MAX_STEPS: f64 = 2e7;

/// Base period and what happens how often.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rates {
    /// Base period `[s]`.
    pub(super) period: f64,
    /// Base periods per sample of the recording.
    pub(super) per_sample: usize,
    /// Base periods per step of the controller.
    pub(super) per_control: usize,
    /// Base periods of the run.
    pub(super) steps: usize,
}

impl Rates {
    /// For a controller at `control_hz`; none runs in every base period.
    pub(super) fn try_new(scenario: &Scenario, control_hz: Option<f64>) -> Result<Self, SimError> {
        let rate = scenario.rate_hz;
        let (per_sample, per_control) = match control_hz {
            None => ((BASE_HZ / rate - 1e-6).ceil().max(1.0), 1.0),
            Some(control_hz) => common(rate, control_hz)?,
        };
        if scenario.duration_s * rate * per_sample > MAX_STEPS {
            return Err(SimError::Scenario { what: "duration_s", value: scenario.duration_s, limit: "too long: over 2e7 control periods" });
        }
        let period = 1.0 / (rate * per_sample);
        let (per_sample, per_control) = (whole(per_sample), whole(per_control));
        Ok(Self { period, per_sample, per_control, steps: whole((scenario.duration_s * rate).round()) * per_sample })
    }
}

/// Base periods per sample and per step of the controller.
fn common(rate: f64, control_hz: f64) -> Result<(f64, f64), SimError> {
    let bad = SimError::Scenario { what: "rate_hz", value: rate, limit: "no common multiple with the controller's rate below 200 kHz" };
    for parts in 1..=MOST_PARTS {
        let per_sample = f64::from(parts);
        let per_control = (rate * per_sample / control_hz).round();
        if per_control < 1.0 || (control_hz * per_control / (rate * per_sample) - 1.0).abs() > SLACK {
            continue;
        }
        let times = (BASE_HZ / (rate * per_sample) - 1e-6).ceil().max(1.0);
        if rate * per_sample * times > MOST_HZ {
            return Err(bad);
        }
        return Ok((per_sample * times, per_control * times));
    }
    Err(bad)
}

#[cfg(test)]
mod tests {
    use super::{Rates, common};
    use crate::scenario::Scenario;

    #[test]
    fn the_base_is_a_multiple_of_both_rates() {
        assert_eq!(common(1000.0, 200.0).unwrap(), (1.0, 5.0));
        assert_eq!(common(500.0, 2000.0).unwrap(), (4.0, 1.0));
        assert_eq!(common(1000.0, 300.0).unwrap(), (3.0, 10.0));
        assert_eq!(common(100.0, 100.0).unwrap(), (10.0, 10.0));
        assert!(common(1000.0, 317.123_456).is_err());
    }

    #[test]
    fn without_a_controller_of_its_own_the_base_is_the_controllers() {
        let rates = Rates::try_new(&Scenario { rate_hz: 300.0, duration_s: 1.0, ..Scenario::default() }, None).unwrap();
        assert_eq!((rates.per_sample, rates.per_control, rates.steps), (4, 1, 1200));
    }
}
