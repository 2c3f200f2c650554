//! μ over a range of frequencies: bounds at points, a level proved on all of the range, the worst perturbation.
//!
//! The proof is a cover of the range by intervals, each with one pair of scalings (module `interval`). Where the cover has a hole the
//! result says so: what lies between points of a grid is not known, and real parameters and lightly damped modes make it matter.

use alloc::vec::Vec;

use super::ascent::Ground;
use super::certificate::Certificate;
use super::interval::{Prover, between};
use super::lower::{Effort, LowerBound, search};
use super::response::{Constant, Response};
use super::structure::Structure;
use super::system::StateSpace;
use super::upper::{UpperBound, scalings_for, upper_bound};
use super::{CMatrix, MuError};

/// How finely to look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Points of the first grid, in equal ratios; poles are added.
    pub points: usize,
    /// The proved level may exceed the largest bound at a point by this share.
    pub slack: f64,
    /// Peaks from which the worst perturbation is searched.
    pub peaks: usize,
    /// Intervals of the cover at most.
    pub segments: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { points: 60, slack: 1.0e-4, peaks: 6, segments: 2000 }
    }
}

/// Both bounds at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Frequency `[rad/s]`.
    pub w: f64,
    /// Upper bound of μ there, proved.
    pub upper: f64,
    /// Lower bound of μ there, verified.
    pub lower: f64,
}

/// One pair of scalings and the interval on which it proves its level.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Ends of the interval `[rad/s]`.
    pub range: [f64; 2],
    /// The scalings; their `beta` is the level.
    pub proof: Certificate,
}

/// What is known between the points.
#[derive(Debug, Clone, PartialEq)]
pub enum Guarantee {
    /// The upper bound holds at every frequency of this interval `[rad/s]`.
    Interval([f64; 2]),
    /// The upper bound is the largest at the points; these intervals `[rad/s]` are not covered.
    GridOnly(Vec<[f64; 2]>),
}

/// μ over a range of frequencies.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// Bounds at points, in order of frequency.
    pub points: Vec<Point>,
    /// Upper bound of the peak over the range.
    pub upper: f64,
    /// Frequency of the point with the largest upper bound `[rad/s]`.
    pub upper_w: f64,
    /// Whether `upper` holds on the whole range.
    pub guarantee: Guarantee,
    /// The cover: where each pair of scalings proves a level not above `upper`.
    pub segments: Vec<Segment>,
    /// The worst perturbation found, with its frequency; its `beta` is a lower bound of the peak.
    pub worst: LowerBound,
}

/// μ of a system's response over `range` `[rad/s]`; the upper end may be infinite, or half the sample rate.
///
/// # Errors
/// A structure that does not fit, a range that is none, a pole of the system on the stability boundary in the range.
pub fn sweep(system: &StateSpace, structure: &Structure, range: [f64; 2], settings: &Settings) -> Result<Sweep, MuError> {
    let limit = system.nyquist();
    let [lower, upper] = range;
    if !(lower >= 0.0 && lower < upper && upper <= limit * (1.0 + 1e-12)) {
        return Err(MuError::Range { lower, upper, limit });
    }
    let clock = Clock(system.dt());
    let continuous = system.continuous()?;
    let inner = [clock.inward(lower), clock.inward(upper)];
    let mut out = Run::new(&continuous, structure, inner, *settings, clock)?.finish()?;
    out.segments.sort_by(|a, b| a.range[0].total_cmp(&b.range[0]));
    for p in &mut out.points {
        p.w = clock.outward(p.w);
    }
    for s in &mut out.segments {
        s.range = s.range.map(|w| clock.outward(w));
    }
    out.guarantee = match out.guarantee {
        Guarantee::Interval(_) => Guarantee::Interval(range),
        Guarantee::GridOnly(gaps) => Guarantee::GridOnly(gaps.into_iter().map(|g| g.map(|w| clock.outward(w))).collect()),
    };
    out.upper_w = clock.outward(out.upper_w);
    out.worst.w = clock.outward(out.worst.w);
    Ok(out)
}

/// Frequencies of a discrete system as those of its continuous image, and back.
#[derive(Debug, Clone, Copy)]
struct Clock(Option<f64>);

impl Clock {
    fn inward(self, w: f64) -> f64 {
        match self.0 {
            None => w,
            Some(dt) if w * dt >= core::f64::consts::PI * (1.0 - 1e-12) => f64::INFINITY,
            Some(dt) => pkm_dyn::math::tan(0.5 * w * dt),
        }
    }

    fn outward(self, w: f64) -> f64 {
        self.0.map_or(w, |dt| 2.0 * pkm_dyn::math::atan2(w, 1.0) / dt)
    }
}

/// One frequency that was looked at.
struct Looked {
    w: f64,
    M: CMatrix,
    upper: UpperBound,
    lower: f64,
}

struct Run<'a> {
    prover: Prover<'a>,
    structure: &'a Structure,
    range: [f64; 2],
    settings: Settings,
    clock: Clock,
    looked: Vec<Looked>,
    segments: Vec<Segment>,
}

impl<'a> Run<'a> {
    fn new(system: &'a StateSpace, structure: &'a Structure, range: [f64; 2], settings: Settings, clock: Clock) -> Result<Self, MuError> {
        structure.check(&super::system::complex(system.matrices()[3]))?;
        Ok(Self { prover: Prover::new(system), structure, range, settings, clock, looked: Vec::new(), segments: Vec::new() })
    }

    fn look(&mut self, w: f64) -> Result<&Looked, MuError> {
        let M = self.prover.system.at(w).ok_or(MuError::Pole { w: self.clock.outward(w) })?;
        let upper = upper_bound(&M, self.structure)?;
        self.looked.push(Looked { w, M, upper, lower: 0.0 });
        Ok(&self.looked[self.looked.len() - 1])
    }

    fn finish(mut self) -> Result<Sweep, MuError> {
        for w in self.grid() {
            self.look(w)?;
        }
        self.refine()?;
        let gaps = self.cover()?;
        self.looked.sort_by(|a, b| a.w.total_cmp(&b.w));
        let worst = self.worst();
        let best = self.looked.iter().max_by(|a, b| beta(a).total_cmp(&beta(b)));
        let (upper_w, at_points) = best.map_or((0.0, 0.0), |l| (l.w, beta(l)));
        let level = self.segments.iter().map(|s| s.proof.beta).fold(at_points, f64::max);
        let points = self.looked.iter().map(|l| Point { w: l.w, upper: beta(l), lower: l.lower }).collect();
        let (upper, guarantee) =
            if gaps.is_empty() { (level, Guarantee::Interval(self.range)) } else { (at_points, Guarantee::GridOnly(gaps)) };
        Ok(Sweep { points, upper, upper_w, guarantee, segments: self.segments, worst })
    }

    /// Finite ends for what is spaced in ratios.
    fn finite_range(&self) -> [f64; 2] {
        let poles = self.prover.system.poles();
        let sizes = || poles.iter().map(|p| pkm_dyn::math::hypot(p.re, p.im)).filter(|s| *s > 0.0 && s.is_finite());
        let slow = sizes().fold(f64::INFINITY, f64::min).min(1e3);
        let fast = sizes().fold(0.0, f64::max).max(1e-3);
        let high = if self.range[1].is_finite() { self.range[1] } else { (100.0 * fast).max(100.0 * self.range[0]) };
        let low = if self.range[0] > 0.0 { self.range[0] } else { (0.01 * slow).min(1e-3 * high) };
        [low, high]
    }

    /// Equal ratios, the poles, and the ends.
    fn grid(&self) -> Vec<f64> {
        let [low, high] = self.finite_range();
        let n = self.settings.points.max(2);
        let ratio = pkm_dyn::math::ln(high / low) / (n - 1) as f64;
        let mut out: Vec<f64> = (0..n).map(|i| low * pkm_dyn::math::exp(ratio * i as f64)).collect();
        out.extend(self.range);
        for p in self.prover.system.poles() {
            let size = pkm_dyn::math::hypot(p.re, p.im);
            // Its size, and the top and the flanks of a resonance.
            out.push(size);
            if p.im.abs() > 0.1 * p.re.abs() {
                out.extend([p.im.abs(), p.im.abs() - p.re.abs(), p.im.abs() + p.re.abs()]);
            }
        }
        let least = 1e-3 * low;
        out.retain(|w| *w >= self.range[0] && *w <= self.range[1] && (*w >= least || *w <= self.range[0]));
        out.sort_by(f64::total_cmp);
        out.dedup_by(|a, b| (*a - *b).abs() <= 1e-9 * a.abs());
        out
    }

    /// Indices of the highest local maxima among what was looked at, highest first.
    fn peaks(&self) -> Vec<usize> {
        let n = self.looked.len();
        let at = |i: usize| beta(&self.looked[i]);
        let mut out: Vec<usize> = (0..n).filter(|&i| (i == 0 || at(i) >= at(i - 1)) && (i + 1 == n || at(i) >= at(i + 1))).collect();
        out.sort_by(|&a, &b| at(b).total_cmp(&at(a)));
        out.truncate(self.settings.peaks.max(1));
        out
    }

    /// Golden section for the upper bound around the highest points of the grid.
    fn refine(&mut self) -> Result<(), MuError> {
        let brackets: Vec<[f64; 2]> = self.peaks().into_iter().take(3).filter_map(|i| self.bracket(i)).collect();
        for [mut low, mut high] in brackets {
            let place = |low: f64, high: f64, share: f64| low + share * (high - low);
            let (mut w_1, mut w_2) = (place(low, high, 0.382), place(low, high, 0.618));
            let (mut b_1, mut b_2) = (beta(self.look(w_1)?), beta(self.look(w_2)?));
            for _ in 0..16 {
                if b_1 > b_2 {
                    (high, w_2, b_2) = (w_2, w_1, b_1);
                    w_1 = place(low, high, 0.382);
                    b_1 = beta(self.look(w_1)?);
                } else {
                    (low, w_1, b_1) = (w_1, w_2, b_2);
                    w_2 = place(low, high, 0.618);
                    b_2 = beta(self.look(w_2)?);
                }
            }
        }
        self.looked.sort_by(|a, b| a.w.total_cmp(&b.w));
        Ok(())
    }

    fn bracket(&self, i: usize) -> Option<[f64; 2]> {
        let low = self.looked[i.saturating_sub(1)].w;
        let high = self.looked[(i + 1).min(self.looked.len() - 1)].w;
        (low < high && high.is_finite()).then_some([low, high])
    }

    /// Covers the range by intervals on which one pair of scalings proves the level; returns what stays uncovered.
    fn cover(&mut self) -> Result<Vec<[f64; 2]>, MuError> {
        let slack = 1.0 + self.settings.slack.max(1e-9);
        let mut level = self.looked.iter().map(beta).fold(0.0, f64::max) * slack;
        let mut open = alloc::vec![self.range];
        let mut gaps = Vec::new();
        let mut is_first = true;
        while let Some([low, high]) = open.pop() {
            if self.segments.len() >= self.settings.segments || is_thin(low, high) {
                gaps.push([low, high]);
                continue;
            }
            // The peak first: it decides the level.
            let w = if is_first { self.highest().unwrap_or(low) } else { self.inside(low, high) };
            is_first = false;
            let M = self.prover.system.at(w).ok_or(MuError::Pole { w: self.clock.outward(w) })?;
            let mut proof = scalings_for(&M, self.structure, level)?;
            if proof.is_none() {
                level = level.max(beta(self.look(w)?) * slack);
                proof = scalings_for(&M, self.structure, level)?;
            }
            let Some(range) = proof.as_ref().and_then(|p| self.prover.interval(p, w)) else {
                gaps.push([low, high]);
                continue;
            };
            if let Some(proof) = proof {
                self.segments.push(Segment { range, proof });
            }
            if range[1] < high {
                open.push([range[1].max(low), high]);
            }
            if range[0] > low {
                open.push([low, range[0].min(high)]);
            }
            if range[0] >= range[1] {
                // Nothing beside the point itself: halving could go on for ever.
                gaps.extend(open.pop());
                gaps.extend((low < w && w < high).then(|| open.pop()).flatten());
            }
        }
        gaps.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Ok(gaps)
    }

    fn highest(&self) -> Option<f64> {
        self.looked.iter().max_by(|a, b| beta(a).total_cmp(&beta(b))).map(|l| l.w)
    }

    /// Where to test an uncovered interval: a middle; of one that begins at 0 or has no end, near the poles.
    fn inside(&self, low: f64, high: f64) -> f64 {
        let [least, most] = self.finite_range();
        if low <= 0.0 && high > 2.0 * least {
            return between(least.min(0.5 * high), high.min(most));
        }
        between(low, if high.is_finite() { high } else { most.max(2.0 * low) })
    }

    /// Pointwise lower bounds, and the worst perturbation over the range from the highest points.
    fn worst(&mut self) -> LowerBound {
        let [low, high] = self.finite_range();
        let system = self.prover.system;
        let placed = self.structure.placed();
        let mut best = LowerBound { beta: 0.0, perturbation: None, w: 0.0 };
        let mut keep = |found: LowerBound| {
            if found.beta > best.beta {
                best = found;
            }
        };
        for l in &mut self.looked {
            let response = Constant(l.M.clone());
            let fixed = Ground { placed: &placed, response: &response, range: [l.w, l.w] };
            let found = search(&fixed, self.structure, (&l.M, l.w), &l.upper, Effort::Quick);
            l.lower = found.beta;
            keep(found);
        }
        let by_lower = (0..self.looked.len()).max_by(|&a, &b| self.looked[a].lower.total_cmp(&self.looked[b].lower));
        for i in self.peaks().into_iter().chain(by_lower) {
            let l = &self.looked[i];
            let range = [self.range[0].max(1e-3 * low).min(l.w), self.range[1].min(high.max(l.w))];
            let free = Ground { placed: &placed, response: system, range };
            if l.w.is_finite() {
                keep(search(&free, self.structure, (&l.M, l.w), &l.upper, Effort::Full));
            }
        }
        best
    }
}

fn beta(l: &Looked) -> f64 {
    l.upper.certificate.beta
}

/// Whether two ends are one frequency up to rounding: neighbours that both end there meet.
fn is_thin(low: f64, high: f64) -> bool {
    high - low <= 1e-12 * high && high.is_finite()
}
