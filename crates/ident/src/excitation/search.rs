//! The search: random admissible motions, the best of each lot improved, the results verified, the best of all taken.

use core::cell::Cell;
use core::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::draw::Draw;
use super::limits::{Bound, Bounds};
use super::mechanism::Mechanism;
use super::problem::{Problem, Refused, Stage};
use super::verify::{Verified, verify};
use super::{ExciteError, Settings, worth};
use crate::excitation::descent::descend;

/// The search keeps this share of the ranges: between its samples a motion goes a little further.
pub(super) const INSIDE: f64 = 0.99;

/// From weak to sharp: the first stages find the way, the last goes to the limits.
const STAGES: [Stage; 4] = [
    Stage { barrier: 0.1, sharpness: 2.0 },
    Stage { barrier: 0.03, sharpness: 4.0 },
    Stage { barrier: 0.01, sharpness: 8.0 },
    Stage { barrier: 0.003, sharpness: 16.0 },
];

/// A drawn motion is made smaller by this factor until it is admissible, at most so many times: 1 % is no motion.
const SHRINK: f64 = 0.9;
const ATTEMPTS: usize = 44;

/// Share of the drives' own limits that a drawn motion uses, at least.
const LEAST_USE: f64 = 0.6;

/// The improvement begins at this share of the best drawn motion: a barrier is steep at its foot.
const START: f64 = 0.95;

/// A result that leaves its limits between samples is made smaller by this factor, at most so many times.
const TRIM: f64 = 0.995;
const TRIMS: usize = 20;

/// Verification has so many times the samples of the search.
pub(super) const DENSER: usize = 10;

/// Scaled coefficients that keep every limit, and what they are worth; or why there are none.
type Found = Result<(Vec<f64>, Verified), Refused>;

/// One restart.
#[derive(Debug, Clone)]
pub(super) struct Run {
    /// Scaled coefficients.
    pub(super) x: Vec<f64>,
    /// Criterion of every drawn motion.
    pub(super) drawn: Vec<f64>,
    /// The best drawn motion, verified like any other; none where it leaves the limits between its samples.
    pub(super) random: Option<Verified>,
    /// Criterion after every step of the improvement.
    pub(super) trace: Vec<f64>,
    pub(super) verified: Verified,
}

/// What every restart needs.
pub(super) struct Search<'s, 'r> {
    pub(super) problem: &'s Problem,
    /// Limits that count.
    pub(super) bounds: &'s Bounds,
    pub(super) mechanism: &'s Mechanism<'r>,
    pub(super) settings: &'s Settings,
    pub(super) name: &'s (dyn Fn(&Bound) -> String + Sync),
}

impl Search<'_, '_> {
    /// All restarts, in their order whatever the threads do. A restart that finds no motion says why.
    pub(super) fn all(&self, progress: &(dyn Fn(f64) + Sync)) -> Vec<Result<Run, Refused>> {
        let s = self.settings;
        let (done, total) = (AtomicUsize::new(0), s.restarts * (s.draws + s.iterations));
        let tick = |n: usize| {
            let now = done.fetch_add(n, Ordering::Relaxed) + n;
            progress(now as f64 / total.max(1) as f64);
        };
        (0..s.restarts).into_par_iter().map(|i| self.one(i as u64, &tick)).collect()
    }

    fn one(&self, restart: u64, tick: &dyn Fn(usize)) -> Result<Run, Refused> {
        let mut mechanism = self.mechanism.clone();
        // Stream 0 is that of the structure.
        let mut draw = Draw::new(self.settings.seed, restart + 1);
        let mut drawn = Vec::new();
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut reason = Refused::Blind;
        for _ in 0..self.settings.draws {
            match self.admissible(&mut mechanism, &mut draw) {
                Ok((value, x)) => {
                    drawn.push(value);
                    if best.as_ref().is_none_or(|b| value < b.0) {
                        best = Some((value, x));
                    }
                }
                Err(why) => reason = why,
            }
            tick(1);
        }
        let Some((_, best_drawn)) = best else { return Err(reason) };
        let mut x = self.problem.shrunk(&best_drawn, START);
        let trace = self.improve(&mut mechanism, &mut x, tick);
        let improved = self.verified(&mut mechanism, &x);
        let random = self.verified(&mut mechanism, &best_drawn);
        let (x, verified) = self.better(improved, random.clone())?;
        Ok(Run { x, drawn, random: random.ok().map(|(_, verified)| verified), trace, verified })
    }

    /// The better of an improved motion and the drawn one it comes from: a descent that pays for the barrier, or is cut short, may end
    /// above its start.
    fn better(&self, improved: Found, drawn: Found) -> Found {
        let worth = |v: &Verified| worth(self.settings.criterion, &v.quality);
        match (improved, drawn) {
            (Ok(improved), Ok(drawn)) if worth(&drawn.1) < worth(&improved.1) => Ok(drawn),
            (Err(_), Ok(drawn)) => Ok(drawn),
            (improved, _) => improved,
        }
    }

    /// Goes down from `x` stage by stage; the criterion after every step.
    fn improve(&self, mechanism: &mut Mechanism<'_>, x: &mut Vec<f64>, tick: &dyn Fn(usize)) -> Vec<f64> {
        let (last, mut trace) = (Cell::new(f64::NAN), Vec::new());
        // As many steps as were asked for, to the last one; where there are fewer than stages the sharp ones have them.
        let until = |stage: usize| stage * self.settings.iterations / STAGES.len();
        for (k, stage) in STAGES.into_iter().enumerate() {
            let per_stage = until(k + 1) - until(k);
            let mut look = |x: &[f64], slope: Option<&mut Vec<f64>>| {
                let worth = self.problem.look(mechanism, x, stage, slope).ok()?;
                last.set(worth.value);
                Some(worth.objective)
            };
            let taken = descend(x, per_stage, &mut look, &mut || {
                trace.push(last.get());
                tick(1);
            });
            tick(per_stage.saturating_sub(taken));
        }
        trace
    }

    /// A random motion, as large as the limits allow, and its criterion.
    fn admissible(&self, mechanism: &mut Mechanism<'_>, draw: &mut Draw) -> Result<(f64, Vec<f64>), Refused> {
        let n_act = self.bounds.drives.len();
        let n = n_act * self.problem.basis.len();
        let mut x: Vec<f64> = (0..n).map(|_| draw.normal()).collect();
        self.problem.project(&mut x);
        let use_of: Vec<f64> = (0..n_act).map(|_| LEAST_USE + (1.0 - LEAST_USE) * draw.unit()).collect();
        self.problem.fit(&mut x, &use_of);
        let flat = Stage { barrier: 0.0, sharpness: 1.0 };
        let mut reason = Refused::Blind;
        for _ in 0..ATTEMPTS {
            match self.problem.look(mechanism, &x, flat, None) {
                Ok(worth) => return Ok((worth.value, x)),
                Err(why @ Refused::Blind) => return Err(why),
                Err(why) => reason = why,
            }
            x = self.problem.shrunk(&x, SHRINK);
        }
        Err(reason)
    }

    /// The motion, or one somewhat smaller, as it is on a dense grid.
    pub(super) fn verified(&self, mechanism: &mut Mechanism<'_>, x: &[f64]) -> Found {
        let mut x = x.to_vec();
        let n = DENSER * self.problem.n_samples();
        let mut reason = Refused::Open;
        for _ in 0..TRIMS {
            match verify(mechanism, &self.problem.motion(&x), self.bounds, n, &self.name) {
                Ok(verified) => return Ok((x, verified)),
                Err(why) => reason = why,
            }
            x = self.problem.shrunk(&x, TRIM);
        }
        Err(reason)
    }

    /// The error that a refusal means.
    pub(super) fn told(&self, refused: &Refused, robot: &str) -> ExciteError {
        let robot = robot.to_string();
        match refused {
            Refused::Open => ExciteError::NoMotion { robot, reason: "the loops do not close".to_string() },
            Refused::Blind => ExciteError::Blind { robot },
            Refused::Outside(b, value) => {
                // As the user knows it: the search keeps a little less.
                let is_same = |c: &&Bound| c.what == b.what && c.place == b.place;
                let b = self.bounds.drives.iter().flatten().chain(&self.bounds.robot).find(is_same).unwrap_or(b);
                let (place, what, lower, upper) = ((self.name)(b), b.what, b.lower, b.upper);
                ExciteError::NoMotion { robot, reason: format!("{} of {place}: {value:.4} (limits {lower:.4} to {upper:.4})", what.name()) }
            }
        }
    }
}
