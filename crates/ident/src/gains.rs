//! Gains of the drives from recordings with and without a known load: the only thing that makes newtons of what a drive calls newtons.
//!
//! A recorded effort is the acting one over an unknown gain, `r = h·(W·θ + load)` with `h = 1/gain`. Without a load of known mass `h` and
//! `θ` only come as products; with one (`meta.load` of a recording) both are determined \[Gautier2014\]. The equation is bilinear: for given
//! `h` the parameters are solved for, and the search runs over `h` alone.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::error::InputError;
use crate::factor::Factor;
use crate::minimise::levenberg_marquardt::{Options, Squares, covariance, levenberg_marquardt};
use crate::minimise::{Bounds, Ending};
use crate::motion::Use;
use crate::note::{Note, Status};
use crate::observation::{Block, Observation, RowOptions, Rows};
use crate::shapes::independent;
use crate::statistics::{Residual, critical_95};

/// A gain whose interval is wider than this share of it is not worth having.
const WIDE: f64 = 0.2;

/// Passes of weighting, and the least noise of a drive as a share of its effort.
const PASSES: usize = 2;
const LEAST_NOISE: f64 = 1e-6;

/// Range in which inverse gains are sought.
const RANGE: Bounds = Bounds { lower: 0.05, upper: 20.0 };

/// A gain closer to an end of its range than this share of it is that end.
const AT_END: f64 = 1e-3;

/// The gain of one drive.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DriveGain {
    /// The driven joint.
    pub joint: String,
    /// Acting effort over recorded effort.
    pub gain: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Root mean square of the known load's effort at this drive over that of the recorded effort: where it is small, so is the knowledge.
    pub load_share: f64,
}

/// The gains of all drives.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DriveGains {
    /// Whether they may be used.
    pub status: Status,
    /// What speaks against them.
    pub notes: Vec<Note>,
    /// By drive; empty when there is nothing to tell them from.
    pub gains: Vec<DriveGain>,
}

/// Gains of the drives of `robot` from recordings of which at least one states a load and at least one none, or another.
///
/// # Errors
/// Recordings that do not fit the robot; more drives than freedoms, whose rows are sums over drives.
pub fn drive_gains(robot: &Robot, recordings: &[Recording], rows: RowOptions) -> Result<DriveGains, InputError> {
    let (drives, freedoms) = (robot.model.n_act(), pkm_dyn::Data::new(&robot.model).n_ind());
    if drives > freedoms {
        return Err(InputError::Redundant { robot: robot.model.name.clone(), drives, freedoms });
    }
    let none = |note| DriveGains { status: Status::NotIdentified, notes: vec![note], gains: Vec::new() };
    let loaded = recordings.iter().filter(|r| r.meta.load.as_ref().is_some_and(|l| l.mass > 0.0)).count();
    if loaded == 0 {
        return Ok(none(Note::NoKnownLoad { recordings: recordings.len() }));
    }
    let pairs: Vec<(&Recording, Use)> = recordings.iter().map(|r| (r, Use::Fit)).collect();
    let observation = Observation::try_new(robot, &pairs, rows)?;
    let seen = Seen::of(&observation)?;
    let n = robot.model.n_act();
    let kept = seen.kept();
    let Searched { out, theta } = seen.search(&kept);
    let residuals = seen.residuals(&observation, &kept, &theta, &out.x)?;
    let colour = residuals.iter().map(Residual::colour).fold(1.0, f64::max);
    let critical = critical_95(residuals.iter().map(Residual::bandwidth).fold(0.0, f64::max));
    let covariance = covariance(&out.jacobian);
    let gain = |k: usize| {
        let h = out.x[k];
        let sd = covariance.as_ref().map_or(f64::MAX, |c| (colour * c[(k, k)].max(0.0)).sqrt());
        let width = (critical * sd / (h * h)).min(f64::MAX);
        DriveGain {
            joint: robot.model.joints[robot.model.actuators[k]].name.clone(),
            gain: 1.0 / h,
            ci95: [1.0 / h - width, 1.0 / h + width],
            load_share: seen.load_share(k),
        }
    };
    let gains: Vec<DriveGain> = (0..n).map(gain).collect();
    let mut notes: Vec<Note> = gains
        .iter()
        .filter(|g| g.ci95[1] - g.ci95[0] > 2.0 * WIDE * g.gain)
        .map(|g| Note::GainNotShown { joint: g.joint.clone(), half_width: 0.5 * (g.ci95[1] - g.ci95[0]) / g.gain, limit: WIDE })
        .collect();
    // The search is over inverse gains, and its ends are no answers.
    let range = [1.0 / RANGE.upper, 1.0 / RANGE.lower];
    let is_at_end = |g: &&DriveGain| range.iter().any(|end| (g.gain / end - 1.0).abs() < AT_END);
    notes.extend(gains.iter().filter(is_at_end).map(|g| Note::GainAtBound { joint: g.joint.clone(), gain: g.gain, range }));
    if out.ending != Ending::Settled {
        notes.push(Note::NotSettled { iterations: out.iterations });
    }
    Ok(DriveGains { status: Note::worst(&notes), notes, gains })
}

/// Where the search ended, at the last weights: residuals in units of the noise.
struct Searched {
    out: Squares,
    theta: Vec<f64>,
}

/// Rows `[W, load | r]` of every drive.
struct Seen {
    factors: Vec<Factor>,
    load_square: Vec<f64>,
    p: usize,
}

impl Seen {
    fn of(observation: &Observation<'_>) -> Result<Self, InputError> {
        let p = observation.columns().len();
        let n = observation.robot().model.n_act();
        let mut out = Self { factors: vec![Factor::new(p + 1); n], load_square: vec![0.0; n], p };
        observation.each(
            Rows::Fitted,
            &mut |block| {
                for k in 0..n {
                    for i in (0..block.len()).filter(|&i| block.is_active(k, i)) {
                        let load = known(block, k, i);
                        let row = [block.row(k, i), &[load]].concat();
                        out.factors[k].push(&row, block.effort(k, i), block.effort(k, i));
                        out.load_square[k] += load * load;
                    }
                }
            },
            &mut |_| {},
        )?;
        Ok(out)
    }

    /// Independent columns of the regressor.
    fn kept(&self) -> Vec<usize> {
        let mut all = Factor::new(self.p);
        for f in &self.factors {
            let t = f.triangle();
            let scale = 1.0 / f.effort_square().sqrt().max(f64::MIN_POSITIVE);
            for i in 0..t.nrows() {
                let row: Vec<f64> = (0..self.p).map(|j| scale * t[(i, j)]).collect();
                all.push(&row, 0.0, 0.0);
            }
        }
        independent(&all.triangle())
    }

    /// Inverse gains by least squares, drives weighted by what was left of them.
    fn search(&self, kept: &[usize]) -> Searched {
        let n = self.factors.len();
        let size = |f: &Factor| (f.effort_square() / f.count().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        let mut weight: Vec<f64> = self.factors.iter().map(|f| 1.0 / size(f)).collect();
        let triangles: Vec<Mat<f64>> = self.factors.iter().map(Factor::triangle).collect();
        let go = |start: &[f64], weight: &[f64]| {
            let mut residual = |h: &[f64]| Some(projected(&triangles, kept, weight, h).0);
            levenberg_marquardt(&mut residual, start, &vec![0.1; n], &vec![RANGE; n], &Options::default())
        };
        let mut out = go(&vec![1.0; n], &weight);
        for _ in 0..PASSES {
            let (e, _, rows) = projected(&triangles, kept, &weight, &out.x);
            for (k, w) in weight.iter_mut().enumerate() {
                let square: f64 = e[k * rows..(k + 1) * rows].iter().map(|e| e * e).sum::<f64>() / (*w * *w);
                let f = &self.factors[k];
                *w = 1.0 / (square / f.count().max(1) as f64).sqrt().max(LEAST_NOISE * size(f));
            }
            out = go(&out.x, &weight);
        }
        let theta = projected(&triangles, kept, &weight, &out.x).1;
        Searched { out, theta }
    }

    fn load_share(&self, k: usize) -> f64 {
        (self.load_square[k] / self.factors[k].effort_square().max(f64::MIN_POSITIVE)).sqrt()
    }

    fn residuals(&self, observation: &Observation<'_>, kept: &[usize], theta: &[f64], h: &[f64]) -> Result<Vec<Residual>, InputError> {
        let mut series = vec![vec![Vec::new(); observation.motions().len()]; h.len()];
        observation.each(
            Rows::Fitted,
            &mut |block| {
                for (k, series) in series.iter_mut().enumerate() {
                    let e = |i: usize| {
                        if !block.is_active(k, i) {
                            return 0.0;
                        }
                        let rigid: f64 = kept.iter().zip(theta).map(|(&j, x)| block.row(k, i)[j] * x).sum();
                        block.effort(k, i) - h[k] * (rigid + known(block, k, i))
                    };
                    series[block.recording].extend((0..block.len()).map(e));
                }
            },
            &mut |_| {},
        )?;
        Ok(series.iter().map(|s| Residual::of(s, 1.0)).collect())
    }
}

/// Effort that is known: loads, and effects that stay as the file has them.
fn known(block: &Block<'_>, k: usize, i: usize) -> f64 {
    block.effort(k, i) - block.target(k, i)
}

/// Weighted residuals of all drives at inverse gains `h` with the best parameters of the columns `kept`; these; rows per drive.
fn projected(triangles: &[Mat<f64>], kept: &[usize], weight: &[f64], h: &[f64]) -> (Vec<f64>, Vec<f64>, usize) {
    let rows = triangles[0].nrows();
    let load = triangles[0].ncols() - 2;
    let at = |i: usize| (i / rows, i % rows);
    let a = Mat::from_fn(rows * h.len(), kept.len(), |i, j| {
        let (k, r) = at(i);
        weight[k] * h[k] * triangles[k][(r, kept[j])]
    });
    let b = Mat::from_fn(rows * h.len(), 1, |i, _| {
        let (k, r) = at(i);
        weight[k] * (triangles[k][(r, load + 1)] - h[k] * triangles[k][(r, load)])
    });
    let theta = a.qr().solve_lstsq(&b).subrows(0, kept.len()).to_owned();
    let e = &b - &a * &theta;
    ((0..e.nrows()).map(|i| e[(i, 0)]).collect(), (0..kept.len()).map(|j| theta[(j, 0)]).collect(), rows)
}
