//! Where on its way the robot is: standing, moving to a pose, playing, slowing down.

use pkm_hal::MAX_AXES;

use crate::motion::{Motion, Move, Wanted};

/// What moves the reference.
pub(super) enum Course {
    /// Nothing.
    Stand,
    /// To a pose; then it stands, or plays.
    Go { way: Move, t: f64 },
    /// A motion, at its own time; `rate` falls from 1 to 0 while it is stopped.
    Play { motion: Box<dyn Motion>, t: f64, rate: f64, is_stopping: bool },
}

/// What became of the course in a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Progress {
    /// It goes on.
    Going,
    /// It is at its end.
    Done,
}

impl Course {
    /// Moves `wanted` on by `dt` `[s]`; a motion that is stopped slows down within `stop_s` `[s]`.
    pub(super) fn advance(&mut self, wanted: &mut Wanted, dt: f64, stop_s: f64) -> Progress {
        match self {
            Self::Stand => Progress::Going,
            Self::Go { way, t } => {
                *t += dt;
                *wanted = way.at(*t);
                if *t >= way.duration() { Progress::Done } else { Progress::Going }
            }
            Self::Play { motion, t, rate, is_stopping } => {
                let before = *rate;
                if *is_stopping {
                    *rate = if stop_s > 0.0 { (*rate - dt / stop_s).max(0.0) } else { 0.0 };
                }
                *t += 0.5 * (before + *rate) * dt;
                let has_ended = motion.duration_s().is_some_and(|length| *t >= length);
                *t = motion.duration_s().map_or(*t, |length| t.min(length));
                motion.at(*t, wanted);
                slow(wanted, *rate, if dt > 0.0 { (*rate - before) / dt } else { 0.0 });
                if has_ended || *rate <= 0.0 { Progress::Done } else { Progress::Going }
            }
        }
    }

    /// Time into the motion that is played `[s]`.
    pub(super) const fn time(&self) -> f64 {
        match self {
            Self::Play { t, .. } => *t,
            Self::Stand | Self::Go { .. } => 0.0,
        }
    }
}

/// A motion whose time passes at `rate`, which itself changes by `bend` per second: `q(s(t))` has `v·rate` and `a·rate² + v·bend`.
fn slow(wanted: &mut Wanted, rate: f64, bend: f64) {
    for k in 0..MAX_AXES {
        wanted.a[k] = wanted.a[k] * rate * rate + wanted.v[k] * bend;
        wanted.v[k] *= rate;
    }
}
