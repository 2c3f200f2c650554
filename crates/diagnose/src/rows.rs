//! Grids, rows, folds, and where a joint stands still.
//!
//! While a joint stands its friction may be anything between its limits, so the equation of that joint does not hold there. Effort
//! and columns of a joint are set to zero at such raw samples alike, before the filter: nothing of a stick then leaks into its
//! neighbours. Rows whose whole filter window is free of standstill ("clean") need no such care, and only there is a lag or delay of
//! the drive run as it is; elsewhere it is taken to first order, for the cut must come after it.

use pkm_ident::filter::LowPass;

use crate::motion::{Motion, top_speed};
use crate::segment::every;
use crate::settings::{BLOCKS, SLOWEST, STANDSTILL};
use crate::verdict::Use;

/// Samples of one segment after filtering and decimation.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    /// Time of each row `[s]`.
    pub(crate) time: Vec<f64>,
    /// Fold of each row: `Some(fold)` is fitted on, `None` is held out.
    pub(crate) fold: Vec<Option<usize>>,
    /// Rows that count: measured, not in a gap, and not so near the border of a fold that their filter reaches across it.
    pub(crate) valid: Vec<bool>,
    /// Rows in which each joint moves.
    pub(crate) moving: Vec<Vec<bool>>,
    /// Rows whose filter window holds no standstill of the joint that is left out.
    pub(crate) clean: Vec<Vec<bool>>,
    /// Weight of each row in fits: less than one where a drive turns over and a law says what its friction does meanwhile.
    pub(crate) weight: Vec<Vec<f64>>,
    /// Velocity of each joint at each row.
    pub(crate) v: Vec<Vec<f64>>,
}

/// Grid between the raw one and the rows: fine enough for derivatives of filtered signals.
#[derive(Debug, Clone)]
pub(crate) struct FineGrid {
    pub(crate) dt: f64,
    /// Raw samples per fine sample.
    pub(crate) step: usize,
    /// Fine samples per row.
    pub(crate) thin: usize,
    /// Raw samples at each end that are not used.
    edge: usize,
    filter: LowPass,
}

impl FineGrid {
    pub(crate) fn new(dt: f64, band: f64) -> Self {
        let step = every(dt, 20.0 * band);
        let thin = (every(dt, 2.5 * band) / step).max(1);
        Self { dt: dt * step as f64, step, thin, edge: every(dt, band), filter: LowPass::new(band, dt) }
    }

    /// A raw series, filtered, on the fine grid.
    pub(crate) fn fine(&self, raw: &[f64]) -> Vec<f64> {
        self.filter.apply(raw).into_iter().step_by(self.step).collect()
    }

    /// The same of several series of one length, each to the bit: a filter waits for its own last output, and several side by side take hardly
    /// longer than one.
    pub(crate) fn fine_each(&self, raw: &[&[f64]]) -> Vec<Vec<f64>> {
        let (eights, rest) = raw.as_chunks();
        let (twos, rest) = rest.as_chunks();
        let ones = rest.iter().map(|raw| self.fine(raw));
        eights
            .iter()
            .flat_map(|x| self.side_by_side::<8>(x))
            .chain(twos.iter().flat_map(|x| self.side_by_side::<2>(x)))
            .chain(ones)
            .collect()
    }

    fn side_by_side<const N: usize>(&self, raw: &[&[f64]; N]) -> [Vec<f64>; N] {
        let filtered = self.filter.apply_each(*raw);
        core::array::from_fn(|lane| filtered.iter().step_by(self.step).map(|y| y[lane]).collect())
    }

    /// A series on the fine grid at the first `n` rows.
    pub(crate) fn at_rows(&self, fine: &[f64], n: usize) -> Vec<f64> {
        fine.iter().step_by(self.thin).take(n).copied().collect()
    }

    /// A series on the fine grid at a raw sample, on a straight line between its neighbours.
    pub(crate) fn between(&self, fine: &[f64], raw: usize) -> f64 {
        let (i, share) = (raw / self.step, (raw % self.step) as f64 / self.step as f64);
        let at = |i: usize| fine.get(i).or(fine.last()).copied().unwrap_or(0.0);
        at(i) + share * (at(i + 1) - at(i))
    }

    /// Share of the variance of independent raw noise that a row has: of the noise itself, and of what rows would have if they were
    /// independent and told as much of it. The first is the filter's, the second is that of averages over the raw samples of a row.
    pub(crate) fn noise_gain(&self) -> [f64; 2] {
        let mut impulse = vec![0.0; 8 * self.filter.reach() + 1];
        impulse[4 * self.filter.reach()] = 1.0;
        let gain: f64 = self.filter.apply(&impulse).iter().map(|h| h * h).sum();
        [gain, 1.0 / (self.step * self.thin) as f64]
    }

    /// Raw samples to leave between two sides of a fold border: one period of the band, over which the filter forgets, and of short
    /// blocks no more than a quarter, or nothing would be left to fit on.
    fn guard(&self, n_raw: usize) -> usize {
        self.edge.min(n_raw / (4 * BLOCKS))
    }

    /// Whether a raw sample is far enough from both ends of `n` for its row to be used.
    pub(crate) fn is_inside(&self, raw: usize, n: usize) -> bool {
        raw >= self.edge && raw + self.edge < n
    }

    /// Raw index of a row.
    pub(crate) fn raw_index(&self, row: usize) -> usize {
        row * self.step * self.thin
    }
}

/// Raw samples at which each joint stands still, [joint][sample], with the top speed of each drive over all recordings: the speed below which
/// friction is not known is the joint's and not the recording's. A margin on both sides covers the smoothing of the velocity: inside it
/// neither speed nor acceleration is known.
pub(crate) fn standstill(motion: &Motion, top: &[f64], band: f64) -> Vec<Vec<bool>> {
    let s = &motion.segment;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive time over a positive period")]
    let margin = (0.1 / (band * s.dt)).ceil() as usize;
    let never = |is_measured: bool| vec![!is_measured; s.valid.len()];
    // A position does not stick; one that is not measured is left out like a standstill.
    let channels = motion.channels.iter().map(|c| never(c.measured.is_some()));
    s.v.iter()
        .zip(top)
        .map(|(v, top)| {
            let own = top_speed(v);
            let slow = STANDSTILL * top.clamp(own, SLOWEST * own);
            let mut out = vec![false; v.len()];
            for i in 0..v.len() {
                let reverses = i > 0 && v[i] * v[i - 1] < 0.0;
                if v[i].abs() <= slow || reverses {
                    out[i.saturating_sub(margin)..(i + margin + 1).min(v.len())].fill(true);
                }
            }
            out
        })
        .chain(channels)
        .collect()
}

/// Of the samples in which each joint stands those that no fit may use: all of them, or where a law says how a drive's friction turns over, none.
pub(crate) fn left_out(motion: &Motion, still: &[Vec<bool>]) -> Vec<Vec<bool>> {
    let mut out = still.to_vec();
    let known = out.iter_mut().zip(&motion.turning_weight).filter(|(_, weight)| **weight > 0.0);
    known.for_each(|(still, _)| still.fill(false));
    out
}

/// Fold of each block of each segment.
pub(crate) fn folds(motions: &[Motion]) -> (Vec<Vec<Option<usize>>>, usize) {
    let fitted = motions.iter().filter(|m| m.segment.used != Use::Holdout).count();
    let mut next = 0;
    let mut seen = 0;
    let per_recording = fitted >= 4;
    let blocks = motions
        .iter()
        .map(|m| {
            let out = (0..BLOCKS)
                .map(|b| match m.segment.used {
                    Use::Holdout => None,
                    Use::Both if b % 2 == 1 => None,
                    _ if per_recording => Some(seen),
                    _ => {
                        next += 1;
                        Some(next - 1)
                    }
                })
                .collect();
            seen += usize::from(m.segment.used != Use::Holdout);
            out
        })
        .collect();
    (blocks, if per_recording { seen } else { next })
}

/// Rows of one segment.
pub(crate) fn rows(motion: &Motion, grid: &FineGrid, folds: &[Option<usize>], (still, out): (&[Vec<bool>], &[Vec<bool>])) -> Rows {
    let s = &motion.segment;
    let n_raw = s.valid.len();
    let n = n_raw.div_ceil(grid.step).div_ceil(grid.thin);
    let raw: Vec<usize> = (0..n).map(|i| grid.raw_index(i).min(n_raw - 1)).collect();
    let reach = grid.step * grid.thin;
    // Filters have no past at the ends: one period of the band there is left out of every fit and every error.
    let edge = grid.edge;
    let clear =
        |i: usize| i >= edge && i + edge < n_raw && s.valid[i.saturating_sub(reach)..(i + reach + 1).min(n_raw)].iter().all(|ok| *ok);
    let fold = |i: usize| folds[(i * BLOCKS / n_raw).min(BLOCKS - 1)];
    let guard = grid.guard(n_raw);
    let is_apart = |i: usize| is_apart(&fold, i, guard, n_raw);
    // Share of each row's filter window in which a joint stands.
    let share = |still: &Vec<bool>| -> Vec<f64> {
        let share = grid.filter.apply(&still.iter().map(|s| f64::from(u8::from(*s))).collect::<Vec<_>>());
        raw.iter().map(|&i| share[i]).collect()
    };
    let standing: Vec<Vec<f64>> = out.iter().map(share).collect();
    let weight = |(j, still): (usize, &Vec<bool>)| {
        let known = motion.turning_weight.get(j).copied().filter(|w| *w > 0.0);
        known.map_or_else(|| vec![1.0; n], |w| share(still).iter().map(|x| if x.abs() < 0.01 { 1.0 } else { w }).collect())
    };
    let such = |f: fn(f64) -> bool| standing.iter().map(|s| s.iter().map(|x| f(*x)).collect()).collect();
    let at = |x: &Vec<Vec<f64>>| x.iter().map(|x| raw.iter().map(|&i| x[i]).collect()).collect();
    Rows {
        time: raw.iter().map(|&i| s.start + s.dt * i as f64).collect(),
        fold: raw.iter().map(|&i| fold(i)).collect(),
        valid: raw.iter().map(|&i| clear(i) && is_apart(i)).collect(),
        moving: such(|x| x < 0.5),
        clean: such(|x| x.abs() < 0.01),
        weight: still.iter().enumerate().map(weight).collect(),
        v: at(&s.v),
    }
}

/// Whether a raw sample that is fitted lies far enough from other folds. Held-out samples are all judged, so their neighbours give way by
/// the whole guard; two fitted folds give way by half of it each.
fn is_apart(fold: &dyn Fn(usize) -> Option<usize>, i: usize, guard: usize, n_raw: usize) -> bool {
    let Some(own) = fold(i) else { return true };
    // Blocks are at least four guards long, so a border within the guard shows at its far end.
    let ends = |reach: usize| [i.saturating_sub(reach), (i + reach).min(n_raw - 1)];
    let is_own = |other: Option<usize>| other.is_none_or(|f| f == own);
    ends(guard).iter().all(|&e| fold(e).is_some()) && ends(guard.div_ceil(2)).iter().all(|&e| is_own(fold(e)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Bench;

    #[test]
    fn a_joint_stands_below_the_same_speed_in_every_recording() {
        // A sine at 1 Hz is slower than a share s of its top speed for asin(s)/π of a second about each of two turns a period; the margin is a
        // tenth of the band's period, 0.02 s on either side.
        let motion = Bench::sine(0.2, 1.0).motion;
        let own = top_speed(&motion.segment.v[0]);
        let standing = |top: f64| {
            let still = standstill(&motion, &[top], motion.segment.band).swap_remove(0);
            still.iter().filter(|s| **s).count() as f64 / still.len() as f64
        };
        for (times, share) in [(1.0, 0.01), (4.0, 0.04), (0.2, 0.01), (50.0, 0.1)] {
            let want = 2.0 * (pkm_dyn::math::asin(share) / core::f64::consts::PI + 2.0 * 0.02);
            let got = standing(times * own);
            // A sample or two of 2 ms at each of 20 turns.
            assert!((got - want).abs() < 0.009, "{times} times as fast: {got} instead of {want}");
        }
        assert!(standing(4.0 * own) > standing(own) + 0.01);
    }

    #[test]
    fn series_side_by_side_are_each_what_they_are_alone() {
        let grid = FineGrid::new(0.002, 5.0);
        let series = |k: usize| (0..400).map(|i| pkm_dyn::math::sin((0.01 + 0.02 * k as f64) * i as f64) + k as f64).collect::<Vec<f64>>();
        // Eight, two and one at a time.
        let raw: Vec<Vec<f64>> = (0..11).map(series).collect();
        let together = grid.fine_each(&raw.iter().map(Vec::as_slice).collect::<Vec<_>>());
        assert_eq!(together, raw.iter().map(|x| grid.fine(x)).collect::<Vec<_>>());
    }

    #[test]
    fn fitted_rows_stay_a_filter_length_away_from_every_other_fold() {
        // Five hundred samples, blocks of fifty: fold 0, held out, folds 1 and 2, and held out again.
        let blocks = [Some(0), None, Some(1), Some(2), None, None, None, None, None, None];
        let fold = |i: usize| blocks[i / 50];
        let kept: Vec<usize> = (0..500).filter(|&i| is_apart(&fold, i, 12, 500)).collect();
        let fitted: Vec<usize> = kept.iter().copied().filter(|&i| fold(i).is_some()).collect();
        for &a in &fitted {
            for &b in kept.iter().filter(|&&b| fold(b) != fold(a)) {
                assert!(a.abs_diff(b) >= 12, "{a} and {b} share a filter's reach");
            }
        }
        assert_eq!(kept.len() - fitted.len(), 350, "held-out samples are all judged");
        assert_eq!(fitted.len(), 150 - 12 - 12 - 6 - 6 - 12);
    }
}
