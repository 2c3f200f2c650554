//! When and where something may have pushed: the window of time in which a constant force takes away most of what friction, weight and
//! inertia of each drive leave of the fitted rows.
//!
//! This only proposes: what is proposed competes with every other explanation, and is confirmed on held-out rows, which are not looked at
//! here.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pkm_dyn::math;
use pkm_ident::spectrum::phase_randomised;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::contest::{log_ratio, mean_and_sd, random_phases};
use crate::motion::{Motion, top_speed};
use crate::pushed::Pushed;
use crate::rows::standstill;
use crate::settings::{BLOCKS, Settings};
use crate::verdict::Use;

/// Bins that the longest recording is cut into.
const BINS: usize = 60;

/// Shortest and longest push, as shares of the longest recording: what acts nearly all the time is no push.
const LENGTHS: [f64; 2] = [0.03, 0.8];

/// Places that take away this share of what the best of their kind does are looked at as well, so many at most.
const NEARLY: f64 = 0.5;
const PLACES: usize = 3;

/// Looks with what was found taken out of what the drives' own motion explains.
const LOOKS: usize = 2;

/// Where it pushed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// Along a drive's coordinate.
    Drive(usize),
    /// At the origin of a link.
    Link(usize),
}

/// When it pushed `[s]` since the recording began, and how well that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    pub(crate) start: f64,
    pub(crate) end: f64,
    pub(crate) step: f64,
}

/// A fitted recording at its knots.
#[derive(Debug, Clone)]
struct Seen {
    pushed: Vec<Pushed>,
    band: f64,
    /// Time of each knot since the recording began `[s]`.
    time: Vec<f64>,
    /// Whether a knot is fitted and the drive moves there, [drive][knot]: one that sticks is held by whatever pushes it.
    counts: Vec<Vec<bool>>,
    /// Measured less given effort, [drive][knot].
    apart: Vec<Vec<f64>>,
    /// What the drives' own motion may explain of it, [drive][part][knot].
    own: Vec<[Vec<f64>; 6]>,
    /// What the drives' own motion leaves, in units of each drive's, [drive][knot].
    left: Vec<Vec<f64>>,
    /// One over the rms of what it leaves.
    weight: Vec<f64>,
}

/// Normal equations of a constant force over a stretch of time.
#[derive(Clone, Copy)]
struct Sums {
    square: Matrix3<f64>,
    along: Vector3<f64>,
}

impl Sums {
    fn none() -> Self {
        Self { square: Matrix3::zeros(), along: Vector3::zeros() }
    }

    fn plus(&mut self, felt: &Vector3<f64>, left: f64) {
        self.square += felt * felt.transpose();
        self.along += felt * left;
    }

    /// Squared error that the best constant force takes away.
    fn gain(&self, less: &Self) -> f64 {
        let (mut square, along) = (self.square - less.square, self.along - less.along);
        // Directions that no drive feels stay free of force.
        let ridge = 1e-9 * square.trace().max(f64::MIN_POSITIVE);
        (0..3).for_each(|i| square[(i, i)] += ridge);
        square.cholesky().map_or(0.0, |c| along.dot(&c.solve(&along)))
    }
}

/// The best window of a place.
#[derive(Debug, Clone, Copy)]
struct Best {
    place: Place,
    window: Window,
    /// Squared error that a constant force takes away in it, as a share of what is left there.
    share: f64,
    /// The same, in units of each drive's.
    gain: f64,
}

/// The fitted recordings, to be looked through for pushes.
#[derive(Debug, Clone)]
pub(crate) struct Scan {
    seen: Vec<Seen>,
    longest: f64,
    /// Drives, and links from the root on.
    places: [Vec<Place>; 2],
}

/// Places with their best window, drives before links, and links from the root on.
pub(crate) fn windows(motions: &[Motion]) -> Vec<(Place, Window)> {
    let Some(mut scan) = Scan::of(motions) else { return Vec::new() };
    scan.look().into_iter().flat_map(nearly_best).collect()
}

impl Scan {
    pub(crate) fn of(motions: &[Motion]) -> Option<Self> {
        let seen: Vec<Seen> = motions.iter().filter(|m| m.segment.used != Use::Holdout).filter_map(Seen::of).collect();
        let longest = seen.iter().filter_map(|s| s.time.last().copied()).reduce(f64::max).filter(|t| *t > 0.0)?;
        let first = seen.first()?;
        let drives = (0..first.apart.len()).map(Place::Drive).collect();
        let links = first.pushed.iter().map(|p| Place::Link(p.link)).collect();
        Some(Self { places: [drives, links], seen, longest })
    }

    fn look(&mut self) -> [Vec<Best>; 2] {
        let mut without: Option<Window> = None;
        let mut out = [Vec::new(), Vec::new()];
        for _ in 0..LOOKS {
            self.seen.iter_mut().for_each(|s| s.look(without));
            out = [0, 1].map(|kind: usize| self.places[kind].iter().map(|&p| best(&self.seen, p, self.longest)).collect::<Vec<Best>>());
            without = out.iter().flatten().max_by(|a, b| a.gain.total_cmp(&b.gain)).map(|b| b.window);
        }
        out
    }

    /// Chance that some window at some place would take away as much as the best one at `place` does, where nothing pushes: the same look at what the
    /// drives' own motion leaves with its spectrum kept and its phases drawn anew. A window is sought among thousands, and what wanders slowly has
    /// one in which it looks pushed.
    pub(crate) fn chance(&self, place: Place, settings: &Settings) -> f64 {
        let shares = |found: &[Vec<Best>; 2]| found.iter().flatten().map(|b| log_ratio(b.share)).collect::<Vec<f64>>();
        let mut seen = self.clone();
        let found = shares(&seen.look());
        let Some(at) = self.places.iter().flatten().position(|p| *p == place) else { return 1.0 };
        let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
        let drawn: Vec<Vec<Vec<f64>>> =
            (0..settings.null_runs).map(|_| self.seen.iter().map(|s| random_phases(s.time.len(), &mut rng)).collect()).collect();
        let null: Vec<Vec<f64>> = drawn.par_iter().map(|phases| shares(&seen.by_chance(phases).look())).collect();
        let scale: Vec<(f64, f64)> = (0..found.len()).map(|i| mean_and_sd(&null.iter().map(|n| n[i]).collect::<Vec<_>>())).collect();
        let surprise = |of: &[f64], i: usize| (of[i] - scale[i].0) / scale[i].1;
        let most = |of: &Vec<f64>| (0..of.len()).map(|i| surprise(of, i)).fold(f64::NEG_INFINITY, f64::max);
        let reached = null.iter().filter(|n| most(n) >= surprise(&found, at)).count();
        (1 + reached) as f64 / (1 + null.len()) as f64
    }

    /// What the last look left, with these phases: [recording][frequency].
    fn by_chance(&self, phases: &[Vec<f64>]) -> Self {
        let seen = self.seen.iter().zip(phases).map(|(s, phases)| s.by_chance(phases)).collect();
        Self { seen, longest: self.longest, places: self.places.clone() }
    }
}

fn nearly_best(mut all: Vec<Best>) -> Vec<(Place, Window)> {
    let order: Vec<Place> = all.iter().map(|b| b.place).collect();
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let most = all.first().map_or(0.0, |b| b.gain);
    all.retain(|b| b.gain > 0.0 && b.gain >= NEARLY * most);
    all.truncate(PLACES);
    all.sort_by_key(|b| order.iter().position(|p| *p == b.place));
    all.into_iter().map(|b| (b.place, b.window)).collect()
}

/// The window at a place that takes away most, to within a bin, and then its ends to a fraction of one.
fn best(seen: &[Seen], place: Place, longest: f64) -> Best {
    let bin = longest / BINS as f64;
    let mut bins = vec![Sums::none(); BINS + 1];
    for (time, felt, left) in seen.iter().flat_map(|s| s.rows(place)) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a time within the recording over a bin")]
        let at = ((time / bin) as usize).min(BINS - 1);
        bins[at + 1].plus(&felt, left);
    }
    for i in 0..BINS {
        let before = bins[i];
        bins[i + 1].square += before.square;
        bins[i + 1].along += before.along;
    }
    let mut top = (0.0, 0, 1);
    for from in 0..BINS {
        for to in from + 1..=BINS {
            let length = (to - from) as f64 / BINS as f64;
            let gain = if (LENGTHS[0]..=LENGTHS[1]).contains(&length) { bins[to].gain(&bins[from]) } else { 0.0 };
            if gain > top.0 {
                top = (gain, from, to);
            }
        }
    }
    let (mut gain, mut ends) = (top.0, [bin * top.1 as f64, bin * top.2 as f64]);
    let rows: Vec<(f64, Vector3<f64>, f64)> = seen.iter().flat_map(|s| s.rows(place)).collect();
    let within = |[start, end]: [f64; 2]| {
        let mut sums = Sums::none();
        rows.iter().filter(|r| r.0 >= start && r.0 < end).for_each(|r| sums.plus(&r.1, r.2));
        sums.gain(&Sums::none())
    };
    let mut step = 0.5 * bin;
    while step > 0.05 * bin {
        for end in 0..2 {
            for by in [-step, step] {
                let mut moved = ends;
                moved[end] += by;
                let worth = if moved[0] >= 0.0 && moved[1] - moved[0] >= LENGTHS[0] * longest { within(moved) } else { 0.0 };
                if worth > gain {
                    (gain, ends) = (worth, moved);
                }
            }
        }
        step *= 0.5;
    }
    let there: f64 = rows.iter().map(|r| r.2 * r.2).sum();
    let window = Window { start: ends[0], end: ends[1], step: 0.1 / seen.first().map_or(1.0, |s| s.band) };
    Best { place, window, share: gain / there.max(f64::MIN_POSITIVE), gain }
}

impl Seen {
    fn of(motion: &Motion) -> Option<Self> {
        let every = motion.pushed.first()?.every();
        let (s, n) = (&motion.segment, motion.segment.valid.len());
        let at: Vec<usize> = (0..n).step_by(every).collect();
        let is_fitted = |i: usize| s.used != Use::Both || (i * BLOCKS / n).is_multiple_of(2);
        let around = |i: usize| i.saturating_sub(every)..(i + every + 1).min(n);
        let still = standstill(motion, &s.v.iter().map(|v| top_speed(v)).collect::<Vec<_>>(), s.band);
        let counts = still
            .iter()
            .take(s.tau.len())
            .map(|still| at.iter().map(|&i| around(i).all(|i| is_fitted(i) && s.valid[i] && !still[i])).collect())
            .collect();
        let drives = s.tau.len();
        Some(Self {
            pushed: motion.pushed.clone(),
            band: s.band,
            time: at.iter().map(|&i| s.dt * i as f64).collect(),
            counts,
            apart: (0..drives).map(|k| apart(motion, k, every)).collect(),
            own: (0..drives).map(|k| own(motion, k, every)).collect(),
            left: vec![Vec::new(); drives],
            weight: vec![0.0; drives],
        })
    }

    /// What the last look left where it counts, with these phases, in place of what was measured.
    fn by_chance(&self, phases: &[f64]) -> Self {
        let drawn = |k: usize| {
            let counted = |(x, counts): (&f64, &bool)| if *counts && self.weight[k] > 0.0 { x / self.weight[k] } else { 0.0 };
            let left: Vec<f64> = self.left[k].iter().zip(&self.counts[k]).map(counted).collect();
            phase_randomised(&left, phases)
        };
        Self { apart: (0..self.left.len()).map(drawn).collect(), ..self.clone() }
    }

    /// What the drives' own motion leaves where a push in the window `without` does not tell it.
    fn look(&mut self, without: Option<Window>) {
        for k in 0..self.left.len() {
            let tells = |i: usize| self.counts[k][i] && !without.is_some_and(|w| (w.start..w.end).contains(&self.time[i]));
            let told: Vec<usize> = (0..self.time.len()).filter(|&i| tells(i)).collect();
            let (y, x) = (&self.apart[k], &self.own[k]);
            let a = DMatrix::from_fn(told.len(), x.len(), |r, c| x[c][told[r]]);
            let b = DVector::from_fn(told.len(), |r, _| y[told[r]]);
            let mut normal = a.transpose() * &a;
            (0..x.len()).for_each(|c| normal[(c, c)] += 1e-9 * normal[(c, c)] + f64::MIN_POSITIVE);
            let theta = normal.cholesky().map_or_else(|| DVector::zeros(x.len()), |n| n.solve(&(a.transpose() * &b)));
            let left: Vec<f64> = (0..y.len()).map(|i| y[i] - (0..x.len()).map(|c| theta[c] * x[c][i]).sum::<f64>()).collect();
            let square: f64 = told.iter().map(|&i| left[i] * left[i]).sum();
            let rms = math::sqrt(square / told.len().max(1) as f64);
            self.weight[k] = if rms > 0.0 { 1.0 / rms } else { 0.0 };
            self.left[k] = left.iter().map(|l| self.weight[k] * l).collect();
        }
    }

    /// Time, effort per unit of each component of a force, and what is left, in units of each drive's: of every fitted knot and drive.
    fn rows(&self, place: Place) -> impl Iterator<Item = (f64, Vector3<f64>, f64)> + '_ {
        let pushed = self.pushed.iter().find(|p| place == Place::Link(p.link));
        let felt = move |k: usize, i: usize| match (place, pushed) {
            (Place::Drive(own), _) => Vector3::new(if own == k { -1.0 } else { 0.0 }, 0.0, 0.0),
            (_, Some(p)) => Vector3::from_fn(|c, _| -p.at_knots(c, k).get(i).copied().unwrap_or(0.0)),
            _ => Vector3::zeros(),
        };
        (0..self.time.len()).flat_map(move |i| {
            let drives = (0..self.left.len()).filter(move |&k| self.counts[k][i] && (place == Place::Drive(k) || pushed.is_some()));
            drives.map(move |k| (self.time[i], self.weight[k] * felt(k, i), self.left[k][i]))
        })
    }
}

/// Measured less given effort of a drive, in the mean about each knot.
fn apart(motion: &Motion, k: usize, every: usize) -> Vec<f64> {
    let (tau, m) = (&motion.segment.tau[k], &motion.nominal[0][k]);
    let half = every / 2;
    let mean = |i: usize| {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(tau.len()));
        (from..to).map(|i| tau[i] - m[i]).sum::<f64>() / (to - from) as f64
    };
    (0..tau.len()).step_by(every).map(mean).collect()
}

/// What a drive's own motion may explain at the knots: a constant, position, velocity, direction, acceleration and load.
fn own(motion: &Motion, k: usize, every: usize) -> [Vec<f64>; 6] {
    let s = &motion.segment;
    let thin = |x: &[f64]| -> Vec<f64> { x.iter().step_by(every).copied().collect() };
    let v = thin(&s.v[k]);
    let direction = v.iter().map(|v| math::sign(*v)).collect();
    [vec![1.0; v.len()], thin(&s.q[k]), v, direction, thin(&s.a[k]), thin(&motion.rigid[k])]
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::testing::Bench;

    #[test]
    fn a_push_is_found_when_and_where_it_was() {
        let mut bench = Bench::pair();
        let (n, dt) = (bench.motion.segment.valid.len(), bench.motion.segment.dt);
        for (k, size) in [(0, -3.0), (1, 2.0)] {
            // Friction that the model does not have, and a push against both sliders between 3.1 and 5.2 s.
            let v = bench.motion.segment.v[k].clone();
            let pushed = |i: usize| if (3.1..5.2).contains(&(dt * i as f64)) { -size } else { 0.0 };
            bench.motion.segment.tau[k] =
                (0..n).map(|i| bench.motion.nominal[0][k][i] + 0.7 * v[i] + 0.5 * math::sign(v[i]) + pushed(i)).collect();
        }
        bench.motion.segment.used = Use::Train;
        let found = windows(core::slice::from_ref(&bench.motion));
        let link = bench.model.link_index("link1").expect("a link");
        let (_, window) = found.iter().find(|(p, _)| *p == Place::Link(link)).expect("the last link feels both");
        assert!((window.start - 3.1).abs() < 0.05 && (window.end - 5.2).abs() < 0.05, "{window:?}");
        assert!(found.iter().any(|(p, _)| *p == Place::Drive(0)) && found.len() <= 4, "{found:?}");
    }

    #[test]
    fn held_out_rows_are_not_looked_at() {
        let mut bench = Bench::pair();
        let n = bench.motion.segment.valid.len();
        bench.motion.segment.tau.clone_from(&bench.motion.nominal[0]);
        bench.motion.segment.used = Use::Both;
        // Pushed from the third block to the fifth.
        bench.motion.segment.tau[0][n / 4..n / 2].iter_mut().for_each(|t| *t += 1.0);
        let quiet = windows(core::slice::from_ref(&bench.motion));
        assert!(!quiet.is_empty());
        // The second of ten blocks is held out: whatever happens there changes nothing.
        bench.motion.segment.tau[0][n / 10..n / 5].iter_mut().for_each(|t| *t += 100.0);
        assert_eq!(windows(core::slice::from_ref(&bench.motion)), quiet);
        bench.motion.segment.used = Use::Holdout;
        assert!(windows(core::slice::from_ref(&bench.motion)).is_empty());
    }

    /// Two sliders whose efforts wander slowly, as amplifiers do: white noise through a first-order filter of 1 Hz, of size one.
    fn wandering(seed: u64) -> Bench {
        let mut bench = Bench::pair();
        let (n, dt) = (bench.motion.segment.valid.len(), bench.motion.segment.dt);
        let keep = math::exp(-core::f64::consts::TAU * dt);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for k in 0..2 {
            let mut at = 0.0;
            let mut step = || {
                // Twelve uniform numbers less six are normal enough.
                let white = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                at = keep * at + math::sqrt(1.0 - keep * keep) * white;
                at
            };
            bench.motion.segment.tau[k] = (0..n).map(|i| bench.motion.nominal[0][k][i] + step()).collect();
        }
        bench.motion.segment.used = Use::Train;
        bench
    }

    fn chance_at_first_drive(bench: &Bench) -> f64 {
        let scan = Scan::of(core::slice::from_ref(&bench.motion)).expect("a moving robot");
        scan.chance(Place::Drive(0), &Settings::default())
    }

    #[test]
    fn what_wanders_slowly_is_not_taken_for_a_push_and_a_push_stands_out_of_it() {
        let quiet: Vec<f64> = (0..20).map(|seed| chance_at_first_drive(&wandering(seed))).collect();
        // At one in twenty per run, more than three of twenty would come in one of sixty such tests.
        assert!(quiet.iter().filter(|p| **p <= 0.05).count() <= 3, "{quiet:?}");
        for seed in 0..5 {
            let mut bench = wandering(seed);
            let dt = bench.motion.segment.dt;
            let tau = bench.motion.segment.tau[0].iter_mut().enumerate();
            tau.filter(|(i, _)| (3.1..5.2).contains(&(dt * *i as f64))).for_each(|(_, t)| *t -= 8.0);
            let p = chance_at_first_drive(&bench);
            assert!(p <= 0.02, "seed {seed}: {p}");
        }
    }
}
