//! Where on its way the robot is: standing, moving to a pose, playing, slowing down.

use pkm_hal::MAX_AXES;

use crate::motion::{Motion, Move, Wanted};

/// What moves the reference.
#[expect(clippy::large_enum_variant, reason = "the loop may not allocate: a way is kept in place, and there is one course")]
pub(super) enum Course {
    /// Nothing.
    Stand,
    /// To a pose; then it stands, or plays.
    Go { way: Move, time: Time },
    /// A motion.
    Play { motion: Box<dyn Motion>, time: Time },
    /// Where a law of contact or an exercise leads, for so long `[s]`; without a length until it is stopped.
    Led { time: Time, length: Option<f64> },
}

/// Time of a course, which passes at `rate`; that falls from 1 to 0 while it is stopped.
#[derive(Debug, Clone, Copy)]
pub(super) struct Time {
    /// So far `[s]`.
    t: f64,
    rate: f64,
    pub(super) is_stopping: bool,
}

impl Time {
    /// At the beginning.
    pub(super) const BEGIN: Self = Self { t: 0.0, rate: 1.0, is_stopping: false };

    /// Moves on by `dt` `[s]`, to `length` `[s]` at most; a stop takes `stop_s` `[s]`. Change of the rate `[1/s]`.
    fn pass(&mut self, dt: f64, stop_s: f64, length: Option<f64>) -> (f64, Progress) {
        let before = self.rate;
        if self.is_stopping {
            self.rate = if stop_s > 0.0 { (self.rate - dt / stop_s).max(0.0) } else { 0.0 };
        }
        self.t += 0.5 * (before + self.rate) * dt;
        let has_ended = length.is_some_and(|length| self.t >= length);
        self.t = length.map_or(self.t, |length| self.t.min(length));
        let bend = if dt > 0.0 { (self.rate - before) / dt } else { 0.0 };
        (bend, if has_ended || self.rate <= 0.0 { Progress::Done } else { Progress::Going })
    }
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
    /// Moves `wanted` on by `dt` `[s]`; what is stopped slows down within `stop_s` `[s]`.
    pub(super) fn advance(&mut self, wanted: &mut Wanted, dt: f64, stop_s: f64) -> Progress {
        match self {
            Self::Stand => Progress::Going,
            Self::Go { way, time } => {
                let (bend, progress) = time.pass(dt, stop_s, Some(way.duration()));
                *wanted = way.at(time.t);
                slow(wanted, time.rate, bend);
                progress
            }
            Self::Play { motion, time } => {
                let (bend, progress) = time.pass(dt, stop_s, motion.duration_s());
                motion.at(time.t, wanted);
                slow(wanted, time.rate, bend);
                progress
            }
            Self::Led { time, length } => time.pass(dt, stop_s, *length).1,
        }
    }

    /// Time into the motion, the law of contact or the exercise `[s]`.
    pub(super) const fn time(&self) -> f64 {
        match self {
            Self::Play { time, .. } | Self::Led { time, .. } => time.t,
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
