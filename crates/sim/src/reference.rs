//! Periodic motions drawn by seed: sums of five harmonics that begin and end every period at rest.

use pkm_dyn::loops::{Closure, assemble, mid_pose, solve_positions, walk_to};
use pkm_dyn::model::{JointKind, Limits, Model};
use pkm_dyn::{Data, math};

use crate::consistent::leading;
use crate::error::SimError;
use crate::random::{Random, Stream};

/// Number of harmonics: enough reversals to excite friction, few enough to keep the motion below 1 Hz at usual periods.
const HARMONICS: usize = 5;

/// Poses per period at which loops and limits are checked: sixteen per cycle of the highest harmonic and more.
const CHECKS: usize = 200;

/// Share of the stated speed limit that a motion may use.
pub(crate) const SPEED_SHARE: f64 = 0.8;

/// A pose is too near a singularity when the loop closure's pivots fall below this share of those in the middle of travel.
const PIVOT_SHARE: f64 = 0.1;

/// Each attempt is smaller than the last by this factor.
pub(crate) const SHRINK: f64 = 0.9;

/// After so many attempts the motion is 1 % of what was asked: no motion.
pub(crate) const ATTEMPTS: usize = 44;

/// What motion to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceOptions {
    /// Seed of the coefficients.
    pub seed: u64,
    /// Period `[s]`.
    pub period_s: f64,
    /// Share of the stated travel to be used, 0 to 1; less where loops or limits demand it.
    pub amplitude: f64,
}

/// A motion's state at one time; one entry per drive.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sample {
    /// Position `[m | rad]`.
    pub q: Vec<f64>,
    /// Velocity `[m/s | rad/s]`.
    pub v: Vec<f64>,
    /// Acceleration `[m/s² | rad/s²]`.
    pub a: Vec<f64>,
}

/// A periodic motion of all drives.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    centre: Vec<f64>,
    sine: Vec<[f64; HARMONICS]>,
    cosine: Vec<[f64; HARMONICS]>,
    omega: f64,
}

impl Reference {
    /// Draws a motion about the middle of travel of `model` and shrinks it until loops close and limits are kept all along. Of more drives
    /// than freedoms it is one of the first ones, as many as there are freedoms; [`crate::Consistent`] takes the others along.
    ///
    /// # Errors
    /// Options out of range, or a robot on which even the smallest motion fails.
    pub fn draw(model: &Model, options: &ReferenceOptions) -> Result<Self, SimError> {
        for (what, value, limit, is_good) in [
            ("period_s", options.period_s, "must be finite and > 0", options.period_s.is_finite() && options.period_s > 0.0),
            ("amplitude", options.amplitude, "must be > 0 and <= 1", options.amplitude > 0.0 && options.amplitude <= 1.0),
        ] {
            if !is_good {
                return Err(SimError::Scenario { what, value, limit });
            }
        }
        let mut random = Random::new(options.seed, Stream::Reference);
        let model = &leading(model);
        let centre = mid_pose(model);
        let omega = 2.0 * core::f64::consts::PI / options.period_s;
        let mut motion = Self { sine: Vec::new(), cosine: Vec::new(), omega, centre: centre.clone() };
        for _ in &model.actuators {
            let (sine, cosine) = coefficients(&mut random);
            motion.sine.push(sine);
            motion.cosine.push(cosine);
        }
        motion.fit(model, options.amplitude);
        let mut reason = String::new();
        for _ in 0..ATTEMPTS {
            match motion.check(model, &centre) {
                Ok(()) => return Ok(motion),
                Err(why) => reason = why,
            }
            motion.shrink(&centre);
        }
        Err(SimError::NoMotion { robot: model.name.clone(), reason })
    }

    /// Period `[s]`.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        2.0 * core::f64::consts::PI / self.omega
    }

    /// The motion at time `t` `[s]`, written into `out`.
    pub fn at(&self, t: f64, out: &mut Sample) {
        let n = self.centre.len();
        out.q.clone_from(&self.centre);
        for x in [&mut out.v, &mut out.a] {
            x.clear();
            x.resize(n, 0.0);
        }
        for h in 0..HARMONICS {
            let w = self.omega * (h + 1) as f64;
            let (s, c) = math::sin_cos(w * t);
            for k in 0..n {
                let (a, b) = (self.sine[k][h], self.cosine[k][h]);
                out.q[k] += a * s + b * c;
                out.v[k] += w * (a * c - b * s);
                out.a[k] -= w * w * (a * s + b * c);
            }
        }
    }

    /// One period in `n` equal steps.
    pub(crate) fn one_period(&self, n: usize) -> Vec<Sample> {
        let step = self.period_s() / n as f64;
        (0..n)
            .map(|i| {
                let mut sample = Sample::default();
                self.at(step * i as f64, &mut sample);
                sample
            })
            .collect()
    }

    /// Scales every drive's motion into its own limits and centres it.
    fn fit(&mut self, model: &Model, amplitude: f64) {
        let samples = self.one_period(CHECKS);
        for (k, &j) in model.actuators.iter().enumerate() {
            let limits = model.joints[j].limits;
            let bounds = |low: f64, x: f64, high: f64| (low.min(x), high.max(x));
            let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(l, h), s| bounds(l, s.q[k], h));
            let fastest = samples.iter().fold(0.0_f64, |top, s| top.max(s.v[k].abs()));
            let mut scale = amplitude * half_travel(&limits, model.joints[j].kind) / (0.5 * (high - low)).max(f64::MIN_POSITIVE);
            if limits.velocity > 0.0 && fastest * scale > SPEED_SHARE * limits.velocity {
                scale = SPEED_SHARE * limits.velocity / fastest;
            }
            for x in self.sine[k].iter_mut().chain(&mut self.cosine[k]) {
                *x *= scale;
            }
            // The waveform is not symmetric: shift it so that its middle is the middle of travel.
            self.centre[k] -= scale * (0.5 * (low + high) - self.centre[k]);
        }
    }

    fn shrink(&mut self, middle: &[f64]) {
        for (centre, middle) in self.centre.iter_mut().zip(middle) {
            *centre = middle + SHRINK * (*centre - middle);
        }
        for x in self.sine.iter_mut().chain(&mut self.cosine).flatten() {
            *x *= SHRINK;
        }
    }

    fn check(&self, model: &Model, middle: &[f64]) -> Result<(), String> {
        let mut data = Data::new(model);
        let mut closures = vec![assemble(model, &mut data), walk_to(model, &mut data, middle)];
        let least = PIVOT_SHARE * closures[1].pivot_ratio;
        let samples = self.one_period(CHECKS);
        closures.extend(samples.first().map(|s| walk_to(model, &mut data, &s.q)));
        if let Some(open) = closures.iter().find(|c| !c.is_closed) {
            return Err(format!("loops do not close, gap {:e}", open.gap));
        }
        for sample in &samples {
            check_pose(model, &mut data, sample, least)?;
        }
        Ok(())
    }
}

fn check_pose(model: &Model, data: &mut Data, sample: &Sample, least_pivot: f64) -> Result<(), String> {
    let Closure { is_closed, gap, pivot_ratio, .. } = solve_positions(model, data, &sample.q);
    if !is_closed {
        return Err(format!("loops do not close, gap {gap:e}"));
    }
    if pivot_ratio < least_pivot {
        return Err(format!("near a singularity, pivot ratio {pivot_ratio:.2e} (limit {least_pivot:.2e})"));
    }
    for (joint, &q) in model.joints.iter().zip(&data.q) {
        if q < joint.limits.lower || q > joint.limits.upper {
            return Err(format!("joint {:?} at {q:.4} (limits {} to {})", joint.name, joint.limits.lower, joint.limits.upper));
        }
    }
    Ok(())
}

/// Half the stated travel `[m | rad]`; a modest one where none is stated.
pub(crate) fn half_travel(limits: &Limits, kind: JointKind) -> f64 {
    let half = 0.5 * (limits.upper - limits.lower);
    if half.is_finite() && half > 0.0 {
        return half;
    }
    match kind {
        JointKind::Revolute => 0.5,
        JointKind::Prismatic => 0.05,
    }
}

/// Sine and cosine coefficients of one drive, such that velocity and acceleration vanish at the period's begin: the robot starts from
/// rest without a ramp, and every period is alike from the first on.
fn coefficients(random: &mut Random) -> ([f64; HARMONICS], [f64; HARMONICS]) {
    let mut draw = || core::array::from_fn(|h| random.normal() / (h + 1) as f64);
    let (mut sine, mut cosine) = (draw(), draw());
    remove(&mut sine, |h| (h + 1) as f64);
    remove(&mut cosine, |h| ((h + 1) * (h + 1)) as f64);
    (sine, cosine)
}

/// Takes the part along `weight` out of `x`.
fn remove(x: &mut [f64; HARMONICS], weight: impl Fn(usize) -> f64) {
    let along: f64 = (0..HARMONICS).map(|h| x[h] * weight(h)).sum();
    let square: f64 = (0..HARMONICS).map(|h| weight(h) * weight(h)).sum();
    for (h, x) in x.iter_mut().enumerate() {
        *x -= weight(h) * along / square;
    }
}
