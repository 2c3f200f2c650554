//! Phases, one after the other.

use crate::controller::ConfigError;
use crate::exercise::channel::Channel;

/// Phases that a [`Script`] has room for.
pub const MOST_PHASES: usize = 16;

/// One phase: what every coordinate of the task does, and for how long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase<const M: usize> {
    /// How long it lasts `[s]`.
    pub duration_s: f64,
    /// How long it takes to come in: paths are reached and forces fade in within this time `[s]`.
    pub ramp_s: f64,
    /// What each coordinate does.
    pub channels: [Channel; M],
}

/// Phases, one after the other; the last goes on until the controller is stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Script<const M: usize> {
    phases: [Option<Phase<M>>; MOST_PHASES],
    len: usize,
}

impl<const M: usize> Script<M> {
    /// Checks the phases. In an error `drive` is the phase, from zero.
    ///
    /// # Errors
    /// No phase or more than [`MOST_PHASES`]; durations that are not positive, ramps that are negative or longer than their phase, numbers
    /// of a channel that are none or out of range.
    pub fn try_new(phases: &[Phase<M>]) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        if phases.is_empty() || phases.len() > MOST_PHASES {
            return bad(0, "number of phases", phases.len() as f64, "must be 1 to 16");
        }
        let mut out = Self { phases: [None; MOST_PHASES], len: phases.len() };
        for (k, phase) in phases.iter().enumerate() {
            if !(phase.duration_s.is_finite() && phase.duration_s > 0.0) {
                return bad(k, "duration_s", phase.duration_s, "must be finite and > 0");
            }
            if !(phase.ramp_s >= 0.0 && phase.ramp_s <= phase.duration_s) {
                return bad(k, "ramp_s", phase.ramp_s, "must be 0 to the phase's duration");
            }
            if let Some((what, value)) = phase.channels.iter().find_map(Channel::offence) {
                return bad(k, what, value, "must be finite and in its range");
            }
            out.phases[k] = Some(*phase);
        }
        Ok(out)
    }

    /// The phases.
    pub fn phases(&self) -> impl Iterator<Item = &Phase<M>> {
        self.phases.iter().flatten()
    }

    /// How long the script takes `[s]`.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.phases().map(|p| p.duration_s).sum()
    }

    /// Index of the phase at `t` `[s]`, the time since it began, and the phase; the last one from its start on for ever.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<(usize, f64, &Phase<M>)> {
        let mut begin = 0.0;
        let mut found = None;
        for (k, phase) in self.phases().enumerate() {
            if k == 0 || t >= begin {
                found = Some((k, (t - begin).max(0.0), phase));
            }
            begin += phase.duration_s;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exercise::channel::Wave;

    #[test]
    fn phases_follow_each_other_and_the_last_one_stays() {
        let phase = |duration_s, x| Phase { duration_s, ramp_s: 1.0, channels: [Channel::Position(Wave::constant(x))] };
        let script = Script::try_new(&[phase(9.0, 0.144), phase(81.0, 0.1)]).unwrap();
        assert!((script.duration() - 90.0).abs() < 1e-12);
        for (t, index, since) in [(-1.0, 0, 0.0), (0.0, 0, 0.0), (8.9, 0, 8.9), (9.0, 1, 0.0), (200.0, 1, 191.0)] {
            let (k, s, _) = script.at(t).unwrap();
            assert!(k == index && (s - since).abs() < 1e-12, "{t}: {k} {s}");
        }
        for bad in [
            &[][..],
            &[phase(0.0, 1.0)],
            &[phase(0.5, 1.0)],
            &[phase(5.0, f64::NAN)],
            &[Phase { ramp_s: -1.0, ..phase(2.0, 0.0) }],
            &[phase(2.0, 0.0); 17],
        ] {
            assert!(Script::try_new(bad).is_err(), "{bad:?}");
        }
    }
}
