//! Motions of a given shape about the middle of travel: minimum-jerk moves between drawn points, steps, and sine sweeps.

use pkm_dyn::loops::mid_pose;
use pkm_dyn::math;
use pkm_dyn::model::Model;

use crate::consistent::leading;
use crate::error::SimError;
use crate::random::{Random, Stream};
use crate::reference::{ATTEMPTS, SHRINK, SPEED_SHARE, Sample, half_travel};
use crate::trajectory::{Trajectory, check_limits};

/// Share of a period during which a minimum-jerk move lasts; the rest of it the robot stands.
const MOVE_SHARE: f64 = 0.8;

/// Peak velocity of a minimum-jerk move over its mean, 15/8 \[Flash1985\].
const PEAK_SPEED: f64 = 1.875;

/// A sweep fades in over this time `[s]`, or a quarter of its length: it starts from rest.
const FADE_S: f64 = 1.0;

/// The last drive sweeps at this share of the first one's frequencies: no two drives move alike.
const SLOWEST: f64 = 0.5;

/// Highest frequency of a sweep `[Hz]`: five samples of the controller per cycle.
const MAX_HZ: f64 = 200.0;

/// Most moves or steps.
const MAX_MOVES: f64 = 1e6;

/// What shape to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Moves of least jerk from point to point, one per period, with a rest after each \[Flash1985\].
    MinimumJerk {
        /// Time from one begin to the next `[s]`.
        period_s: f64,
    },
    /// Jumps from point to point, one per period; the first period is spent at rest.
    Step {
        /// Time from one jump to the next `[s]`.
        period_s: f64,
    },
    /// Sines whose frequency grows linearly over the whole length; later drives have lower frequencies.
    Chirp {
        /// Frequency at the begin `[Hz]`.
        low_hz: f64,
        /// Frequency at the end `[Hz]`.
        high_hz: f64,
    },
}

/// A motion of a given shape, each drive with its own amplitude.
#[derive(Debug, Clone, PartialEq)]
pub struct Shaped {
    shape: Shape,
    duration_s: f64,
    centre: Vec<f64>,
    amplitude: Vec<f64>,
    /// Points to go to, −1 to 1: `levels[drive][period]`; the first is the centre.
    levels: Vec<Vec<f64>>,
}

impl Shaped {
    /// Draws the points by `seed` and shrinks the motion until limits are kept and loops close for `duration_s` `[s]`; `amplitude` is
    /// the share of the travel that may be used, 0 to 1. Surplus drives are left to [`crate::Consistent`].
    ///
    /// # Errors
    /// Numbers out of range, or a robot on which even the smallest motion fails.
    pub fn draw(model: &Model, shape: Shape, duration_s: f64, amplitude: f64, seed: u64) -> Result<Self, SimError> {
        check_numbers(shape, duration_s, amplitude)?;
        let model = &leading(model);
        let mut random = Random::new(seed, Stream::Reference);
        let n_levels = match shape {
            Shape::MinimumJerk { period_s } | Shape::Step { period_s } => number(duration_s / period_s) + 2,
            Shape::Chirp { .. } => 1,
        };
        let mut level = |i: usize| if i == 0 { 0.0 } else { random.uniform(-1.0, 1.0) };
        let levels = model.actuators.iter().map(|_| (0..n_levels).map(&mut level).collect()).collect();
        let mut motion = Self { shape, duration_s, centre: mid_pose(model), amplitude: Vec::new(), levels };
        for (k, &j) in model.actuators.iter().enumerate() {
            let limits = model.joints[j].limits;
            let half = amplitude * half_travel(&limits, model.joints[j].kind);
            let fastest = half * motion.fastest(k);
            let is_too_fast = limits.velocity > 0.0 && fastest > SPEED_SHARE * limits.velocity;
            motion.amplitude.push(if is_too_fast { half * SPEED_SHARE * limits.velocity / fastest } else { half });
        }
        let mut reason = String::new();
        for _ in 0..ATTEMPTS {
            match check_limits(model, &motion, duration_s) {
                Ok(()) => return Ok(motion),
                Err(why) => reason = why.to_string(),
            }
            motion.amplitude.iter_mut().for_each(|a| *a *= SHRINK);
        }
        Err(SimError::NoMotion { robot: model.name.clone(), reason })
    }

    /// A bound of the shape's rate of change for drive `k` `[1/s]`.
    fn fastest(&self, k: usize) -> f64 {
        match self.shape {
            Shape::MinimumJerk { period_s } => {
                let longest = self.levels[k].windows(2).map(|l| (l[1] - l[0]).abs()).fold(0.0, f64::max);
                PEAK_SPEED * longest / (MOVE_SHARE * period_s)
            }
            Shape::Step { .. } => 0.0,
            Shape::Chirp { low_hz, high_hz } => 2.0 * core::f64::consts::PI * low_hz.max(high_hz) + PEAK_SPEED / self.fade_s(),
        }
    }

    fn fade_s(&self) -> f64 {
        FADE_S.min(0.25 * self.duration_s)
    }

    /// Value, first and second derivative of the shape of drive `k` at `t` `[1, 1/s, 1/s²]`.
    fn shape_at(&self, k: usize, t: f64) -> [f64; 3] {
        match self.shape {
            Shape::Step { period_s } => [self.levels[k][number(t / period_s).min(self.levels[k].len() - 1)], 0.0, 0.0],
            Shape::MinimumJerk { period_s } => {
                let i = number(t / period_s).min(self.levels[k].len() - 2);
                let (from, to) = (self.levels[k][i], self.levels[k][i + 1]);
                let [s, v, a] = minimum_jerk(t - period_s * i as f64, MOVE_SHARE * period_s);
                [from + (to - from) * s, (to - from) * v, (to - from) * a]
            }
            Shape::Chirp { low_hz, high_hz } => {
                let share = k as f64 / (self.centre.len() - 1).max(1) as f64;
                let turns = 2.0 * core::f64::consts::PI * (1.0 - (1.0 - SLOWEST) * share);
                let growth = (high_hz - low_hz) / self.duration_s;
                let (rate, bend) = (turns * (low_hz + growth * t), turns * growth);
                let (s, c) = math::sin_cos(turns * (low_hz + 0.5 * growth * t) * t);
                let [w, dw, ddw] = minimum_jerk(t, self.fade_s());
                [w * s, dw * s + w * rate * c, ddw * s + 2.0 * dw * rate * c + w * (bend * c - rate * rate * s)]
            }
        }
    }
}

impl Trajectory for Shaped {
    fn at(&self, t: f64, out: &mut Sample) {
        let n = self.centre.len();
        for x in [&mut out.q, &mut out.v, &mut out.a] {
            x.resize(n, 0.0);
        }
        for k in 0..n {
            let [s, v, a] = self.shape_at(k, t.max(0.0));
            out.q[k] = self.centre[k] + self.amplitude[k] * s;
            out.v[k] = self.amplitude[k] * v;
            out.a[k] = self.amplitude[k] * a;
        }
    }
}

/// Path, velocity and acceleration of the move of least jerk from 0 to 1 in `duration` `[s]` \[Flash1985\].
fn minimum_jerk(t: f64, duration: f64) -> [f64; 3] {
    let x = t / duration;
    if x >= 1.0 {
        return [1.0, 0.0, 0.0];
    }
    let path = x * x * x * (10.0 + x * (-15.0 + 6.0 * x));
    let rest = 1.0 - x;
    [path, 30.0 * x * x * rest * rest / duration, 60.0 * x * rest * (rest - x) / (duration * duration)]
}

fn check_numbers(shape: Shape, duration_s: f64, amplitude: f64) -> Result<(), SimError> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    let frequency = |x: f64| x > 0.0 && x <= MAX_HZ;
    let mut checks = vec![
        ("duration_s", duration_s, "must be finite and > 0", positive(duration_s)),
        ("amplitude", amplitude, "must be > 0 and <= 1", amplitude > 0.0 && amplitude <= 1.0),
    ];
    match shape {
        Shape::MinimumJerk { period_s } | Shape::Step { period_s } => {
            let is_good = positive(period_s) && duration_s / period_s <= MAX_MOVES;
            checks.push(("period_s", period_s, "must be finite, > 0 and >= 1e-6 of the duration", is_good));
        }
        Shape::Chirp { low_hz, high_hz } => {
            for (what, value) in [("low_hz", low_hz), ("high_hz", high_hz)] {
                checks.push((what, value, "must be > 0 and <= 200", frequency(value)));
            }
        }
    }
    match checks.into_iter().find(|check| !check.3) {
        Some((what, value, limit, _)) => Err(SimError::Scenario { what, value, limit }),
        None => Ok(()),
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_MOVES, never negative")]
fn number(x: f64) -> usize {
    x as usize
}
