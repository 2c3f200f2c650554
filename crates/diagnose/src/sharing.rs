//! More drives than freedoms: what of the drives' efforts moves the robot, and what they only do to each other.
//!
//! The motion says of such drives' efforts `tau` what moves the robot and no more, `P·tau` with `P = B·(Bᵀ·B)⁻¹·Bᵀ`: the rest obeys
//! whoever commands it. So the rows of a diagnosis are `P` times whatever acts at the drives, measured or modelled, friction and all: an
//! effect of one drive is then felt in the rows of all. The rest is taken as it was measured.
//!
//! The noise of such rows is of fewer freedoms than there are rows: `P·Σ·P` for noise `Σ` of the drives. Where the noise of all drives is
//! alike, `Σ = s²·1`, least squares over these rows are the best there are, `s²` is that of the rows times drives over freedoms, and every
//! interval that comes from leaving out blocks, or from null runs whose joints keep their phases, is right as it is.

use pkm_dyn::math;
use pkm_ident::filter::LowPass;

use crate::design::Series;
use crate::motion::Motion;
use crate::verdict::InternalEffort;
use crate::work::Work;

/// A square of series, [drive][drive][sample].
type Table = Vec<Vec<Vec<f64>>>;

/// What is left of a unit effort of a drive, squared, below which nothing is.
const NOTHING: f64 = 1e-9;

/// How efforts of one segment are seen.
#[derive(Debug, Clone)]
pub(crate) struct Sharing {
    whole: Table,
    /// The same for what of it the drives that stand have no part in: their friction may be anything.
    moving: Table,
}

impl Sharing {
    /// Of a segment in which each drive stands at times, [drive or channel][sample]; none where drives are as many as freedoms.
    pub(crate) fn of(motion: &Motion, still: &[Vec<bool>]) -> Option<Self> {
        let whole = motion.moves.clone();
        let n = whole.len();
        if n == 0 {
            return None;
        }
        let mut moving = whole.clone();
        for i in 0..motion.segment.valid.len() {
            for stands in (0..n).filter(|&k| still[k][i]) {
                // Projected once more, onto what has no part of this drive.
                let own: Vec<f64> = (0..n).map(|k| moving[k][stands][i]).collect();
                let square = own[stands];
                for (k, x) in own.iter().enumerate() {
                    for (j, y) in own.iter().enumerate() {
                        moving[k][j][i] -= if square > NOTHING { x * y / square } else { 0.0 };
                    }
                }
                (0..n).for_each(|k| (moving[k][stands][i], moving[stands][k][i]) = (0.0, 0.0));
            }
        }
        Some(Self { whole, moving })
    }

    /// Efforts at some drives as all drives' rows have them; other series are left as they are.
    pub(crate) fn whole(&self, series: &Series) -> Series {
        spread(&self.whole, series)
    }

    /// The same without the rows' part of drives that stand.
    pub(crate) fn moving(&self, series: &Series) -> Series {
        spread(&self.moving, series)
    }

    /// Degrees of freedom: what projects onto them leaves as many.
    pub(crate) fn freedoms(&self) -> f64 {
        self.whole.iter().enumerate().filter_map(|(k, row)| row[k].first()).sum::<f64>().round().max(1.0)
    }

    /// A series at one drive, given at every `step`-th sample, as all drives' rows have it.
    pub(crate) fn thinned(&self, drive: usize, x: &[f64], step: usize) -> Vec<Vec<f64>> {
        let at = |row: &Vec<Vec<f64>>| row[drive].iter().step_by(step).zip(x).map(|(p, x)| p * x).collect();
        self.whole.iter().map(at).collect()
    }
}

fn spread(table: &Table, series: &Series) -> Series {
    let n = table.len();
    let at_drives: Vec<&(usize, Vec<f64>)> = series.iter().filter(|(j, _)| *j < n).collect();
    let mut out = Series::new();
    if !at_drives.is_empty() {
        for (k, row) in table.iter().enumerate() {
            let mut sum = vec![0.0; row[k].len()];
            for (j, x) in &at_drives {
                sum.iter_mut().zip(&row[*j]).zip(x).for_each(|((s, p), x)| *s += p * x);
            }
            out.push((k, sum));
        }
    }
    out.extend(series.iter().filter(|(j, _)| *j >= n).cloned());
    out
}

/// Efforts of the model with what surplus drives do to each other as it was measured: `P·m + (1 − P)·tau`.
pub(crate) fn as_measured(motion: &Motion, efforts: &mut [Vec<f64>]) {
    if motion.moves.is_empty() {
        return;
    }
    let apart: Series = motion.segment.tau.iter().zip(&*efforts).map(|(tau, m)| difference(tau, m)).enumerate().collect();
    for ((_, moved), (effort, tau)) in spread(&motion.moves, &apart).iter().zip(efforts.iter_mut().zip(&motion.segment.tau)) {
        *effort = difference(tau, moved);
    }
}

/// Measured efforts and those of the model as given, drive by drive: of surplus drives the part that moves the robot.
pub(crate) fn efforts_that_move(motion: &Motion) -> Vec<[Vec<f64>; 2]> {
    let pairs = motion.segment.tau.iter().zip(&motion.nominal[0]);
    if motion.moves.is_empty() {
        return pairs.map(|(tau, given)| [tau.clone(), given.clone()]).collect();
    }
    let series: Series = motion.segment.tau.iter().cloned().enumerate().collect();
    let moved = spread(&motion.moves, &series).into_iter().map(|(_, x)| x);
    let with_moved = pairs.zip(moved);
    let mut out = Vec::with_capacity(motion.moves.len());
    for ((tau, given), moved) in with_moved {
        let given = difference(given, &difference(tau, &moved));
        out.push([moved, given]);
    }
    out
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// What surplus drives were measured to do to each other, and how far their positions contradict each other; none without such drives.
///
/// It moves nothing, so no model of the robot says what it should be: it is a place to look at and no finding.
pub(crate) fn evidence(work: &Work) -> Option<InternalEffort> {
    let model = &work.robot.model;
    if !work.design.is_shared() {
        return None;
    }
    let (mut square, mut all, mut n, mut q_square, mut top) = (0.0, 0.0, 0_usize, 0.0, vec![0.0; work.design.n_drives]);
    let mut sum = vec![0.0; work.design.n_drives];
    for m in work.motions {
        let s = &m.segment;
        // Below the band only: noise of the sensors strains nothing.
        let filter = LowPass::new(s.band, s.dt);
        let tau: Vec<Vec<f64>> = s.tau.iter().map(|x| filter.apply(x)).collect();
        let series: Series = tau.iter().cloned().enumerate().collect();
        let moved = spread(&m.moves, &series);
        for i in (0..s.valid.len()).filter(|&i| s.valid[i]) {
            n += 1;
            for (k, tau) in tau.iter().enumerate() {
                let strain = tau[i] - moved[k].1[i];
                (square, all) = (square + strain * strain, all + tau[i] * tau[i]);
                (sum[k], top[k]) = (sum[k] + strain, f64::max(top[k], strain.abs()));
                q_square += m.contradiction[k][i] * m.contradiction[k][i];
            }
        }
    }
    let count = n.max(1) as f64;
    let steady: f64 = sum.iter().map(|s| s * s / count).sum();
    let per_drive = count * work.design.n_drives as f64;
    let rms = math::sqrt(square / per_drive);
    let mut out = InternalEffort {
        place: model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect(),
        rms,
        peak: top.iter().copied().fold(0.0, f64::max),
        unit: model.actuators.first().map_or_else(String::new, |&j| model.joints[j].kind.unit_effort().to_string()),
        share: if all > 0.0 { math::sqrt(square / all) } else { 0.0 },
        steady_share: if square > 0.0 { (steady / square).clamp(0.0, 1.0) } else { 0.0 },
        contradiction_rms: math::sqrt(q_square / per_drive),
        says: String::new(),
    };
    out.says = format!(
        "the drives strain each other by {:.3} {} rms ({:.1} % of their efforts, {:.0} % of it steady) and their positions contradict each \
         other by {:.2e} rms: it moves nothing, so the motion does not say what it should be; where the controller does not command it, \
         look for preload, a length or an encoder that is off",
        out.rms,
        out.unit,
        100.0 * out.share,
        100.0 * out.steady_share,
        out.contradiction_rms
    );
    Some(out)
}
