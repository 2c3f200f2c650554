//! A recording as a motion of the drives: one uniform grid, smoothed positions, their derivatives, efforts as they were recorded.
//!
//! Velocities come from positions. A recorded `dq` is often a filtered register that lags by many milliseconds, and a lag of the
//! velocity looks like damping.

use pkm_dyn::Model;
use pkm_dyn::effects::{Law, Robot};
use rayon::prelude::*;

use crate::error::InputError;
use crate::grid::Grid;
use crate::observation::RowOptions;
use crate::preprocess::differentiation::Derivative;
use crate::{KnownLoad, Recording, spectrum};

/// Smallest number of samples a recording must have: filters and blocks need that many to mean anything.
pub const MIN_SAMPLES: usize = 200;

/// Largest band, as a share of the sampling rate: derivatives need a few samples per period.
const BAND_SHARE: f64 = 0.4;

/// Harmonics of the fastest motion that the band keeps: dry friction answers a sine with its odd harmonics, the fifth has a fifth of
/// the first's size.
const HARMONICS: f64 = 5.0;

/// Positions are smoothed at this multiple of the band: wide enough to leave the band's derivatives alone, narrow enough to keep the
/// direction of motion out of encoder noise.
const SMOOTHING: f64 = 5.0;

/// A sample of effort further from the median of its neighbourhood than this many robust standard deviations of such differences, and than
/// twice the spread of the whole effort, is a spike: held values differ by nothing most of the time, and pulses of a drive are no spikes.
const SPIKE: f64 = 8.0;
const SPIKE_SPREAD: f64 = 2.0;

/// Samples to each side of a sample that its neighbourhood has.
const NEIGHBOURS: usize = 3;

/// What a recording is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// To fit on.
    Fit,
    /// To judge on.
    Holdout,
    /// Blocks of it to fit on, blocks of it to judge on.
    Both,
}

/// A recording on a uniform grid. Outer index: drive, inner: sample.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Name of the recording.
    pub name: String,
    /// What it is for.
    pub used: Use,
    /// First time `[s]`.
    pub start: f64,
    /// Period `[s]`.
    pub dt: f64,
    /// Positions `[m | rad]`, encoder offsets of the robot file added.
    pub q: Vec<Vec<f64>>,
    /// Velocities `[m/s | rad/s]`.
    pub v: Vec<Vec<f64>>,
    /// Accelerations `[m/s² | rad/s²]`.
    pub a: Vec<Vec<f64>>,
    /// Efforts `[N | N·m]`, unfiltered but for spikes.
    pub tau: Vec<Vec<f64>>,
    /// Share of each drive's effort samples that were spikes.
    pub spikes: Vec<f64>,
    /// Cut-off of the differentiation `[Hz]`, and its half window, coefficients or padded samples.
    pub derivative: [f64; 2],
    /// Samples that were measured and lie in no gap.
    pub valid: Vec<bool>,
    /// Gravity stated for this recording `[m/s²]`.
    pub gravity: Option<[f64; 3]>,
    /// Known load stated for this recording.
    pub load: Option<KnownLoad>,
}

impl Motion {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.valid.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.valid.is_empty()
    }
}

/// Speed that 99 % of the samples stay below.
#[must_use]
pub fn top_speed(v: &[f64]) -> f64 {
    ranked(&mut v.iter().map(|v| v.abs()).collect::<Vec<_>>(), v.len() * 99 / 100)
}

/// All recordings as motions, and the band `[Hz]` that effort and model are compared in: that of `options` where given, else five harmonics of the
/// motion, median over drives and fitted recordings.
///
/// # Errors
/// Recordings that do not fit the robot; a band that is out of range.
pub fn motions(robot: &Robot, recordings: &[(&Recording, Use)], options: &RowOptions) -> Result<(Vec<Motion>, f64), InputError> {
    if recordings.is_empty() {
        return Err(InputError::NoRecording);
    }
    let raws = recordings.iter().map(|(r, _)| raw(robot, r)).collect::<Result<Vec<_>, _>>()?;
    let limit = BAND_SHARE * raws.iter().map(|r| 1.0 / r.grid.dt).fold(f64::INFINITY, f64::min);
    let band = match options.band_hz {
        Some(b) if b > 0.0 && b <= limit => b,
        Some(band) => return Err(InputError::Band { band, limit }),
        None => choose_band(&raws, recordings).min(0.5 * limit),
    };
    let smooth = |(raw, (r, used)): (Raw, &(&Recording, Use))| smoothed(raw, r, *used, (band, options.derivative));
    let motions = raws.into_par_iter().zip(recordings).map(smooth).collect();
    Ok((motions, band))
}

/// Signals on the grid, before any filter.
struct Raw {
    grid: Grid,
    q: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
    valid: Vec<bool>,
}

fn choose_band(raws: &[Raw], recordings: &[(&Recording, Use)]) -> f64 {
    let fitted = raws.iter().zip(recordings).filter(|(_, (_, used))| *used != Use::Holdout);
    let mut f: Vec<f64> = fitted
        .flat_map(|(raw, _)| raw.q.iter().map(|q| spectrum::motion_bandwidth(q, raw.grid.dt)).collect::<Vec<_>>())
        .filter(|f| *f > 0.0)
        .collect();
    f.sort_by(f64::total_cmp);
    // The lower median: a joint that hunts on its encoder's last bit looks fast and is not.
    f.get(f.len().saturating_sub(1) / 2).map_or(1.0, |f| HARMONICS * f)
}

fn signal<'r>(model: &Model, r: &'r Recording, kind: &str, j: usize) -> Result<&'r [f64], InputError> {
    let column = format!("{kind}.{}", model.joints[j].name);
    let Some(signal) = r.signal(&column) else {
        return Err(InputError::MissingColumn { recording: r.name.clone(), column, robot: model.name.clone(), found: r.columns() });
    };
    let known = signal.iter().filter(|x| x.is_finite()).count();
    if 2 * known < signal.len() {
        return Err(InputError::EmptyColumn { recording: r.name.clone(), column, known, samples: r.len() });
    }
    Ok(signal)
}

fn raw(robot: &Robot, r: &Recording) -> Result<Raw, InputError> {
    let model = &robot.model;
    let too_short = InputError::TooShort { recording: r.name.clone(), samples: r.len(), limit: MIN_SAMPLES };
    if r.len() < MIN_SAMPLES {
        return Err(too_short);
    }
    let grid = Grid::over(&r.time).filter(|g| g.n >= MIN_SAMPLES).ok_or(too_short)?;
    let mut out = Raw { valid: vec![true; grid.n], grid, q: Vec::new(), tau: Vec::new() };
    for &j in &model.actuators {
        let offset: f64 = robot.chain(j, |law| matches!(law, Law::PositionOffset)).sum();
        let (q, tau) = (signal(model, r, "q", j)?, signal(model, r, "tau", j)?);
        for (ok, missing) in out.valid.iter_mut().zip(out.grid.missing(&r.time, q).into_iter().zip(out.grid.missing(&r.time, tau))) {
            *ok &= !(missing.0 || missing.1);
        }
        out.q.push(out.grid.resample(&r.time, q).into_iter().map(|q| q + offset).collect());
        out.tau.push(out.grid.resample(&r.time, tau));
    }
    Ok(out)
}

/// Half of the numbers are closer to zero than this, times what makes it the standard deviation of normal noise.
fn robust_size(x: impl Iterator<Item = f64>) -> f64 {
    let mut size: Vec<f64> = x.map(f64::abs).collect();
    let half = size.len() / 2;
    1.4826 * ranked(&mut size, half)
}

/// The number that would stand at `place` if they were sorted, zero where there is none.
fn ranked(x: &mut [f64], place: usize) -> f64 {
    if place < x.len() { *x.select_nth_unstable_by(place, f64::total_cmp).1 } else { 0.0 }
}

/// Replaces single samples that stand out by the median around them; returns their share. What it does to noise: nothing, but for what
/// is eight standard deviations off.
fn despike(x: &mut [f64]) -> f64 {
    let n = x.len();
    let median = |i: usize| {
        let around = &x[i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(n)];
        let mut window = [0.0; 2 * NEIGHBOURS + 1];
        window[..around.len()].copy_from_slice(around);
        ranked(&mut window[..around.len()], around.len() / 2)
    };
    let medians: Vec<f64> = (0..n).map(median).collect();
    let middle = ranked(&mut x.to_vec(), n / 2);
    let spread = robust_size(x.iter().map(|x| x - middle));
    if spread <= 0.0 {
        // A drive that is off most of the time: what it does meanwhile is no spike.
        return 0.0;
    }
    let limit = (SPIKE * robust_size(x.iter().zip(&medians).map(|(x, m)| x - m))).max(SPIKE_SPREAD * spread);
    let mut count = 0;
    for (x, m) in x.iter_mut().zip(&medians).filter(|(x, m)| (**x - **m).abs() > limit) {
        *x = *m;
        count += 1;
    }
    count as f64 / n as f64
}

fn smoothed(mut raw: Raw, r: &Recording, used: Use, (band, way): (f64, Derivative)) -> Motion {
    let dt = raw.grid.dt;
    let (mut q, mut v, mut a, mut reach) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
    for raw in &raw.q {
        let ([position, velocity, acceleration], number) = way.apply(raw, SMOOTHING * band, dt);
        q.push(position);
        v.push(velocity);
        a.push(acceleration);
        reach = number;
    }
    // What stood in the shadow of another spike is seen when that one is gone.
    let spikes = raw.tau.iter_mut().map(|tau| (0..3).map(|_| despike(tau)).sum()).collect();
    Motion {
        spikes,
        derivative: [SMOOTHING * band, reach],
        name: r.name.clone(),
        used,
        start: raw.grid.start,
        dt,
        q,
        v,
        a,
        tau: raw.tau,
        valid: raw.valid,
        gravity: r.meta.gravity,
        load: r.meta.load.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_spikes_are_replaced_and_steps_are_not() {
        let clean: Vec<f64> = (0..400).map(|i| if i < 200 { 1.0 } else { 3.0 } + 0.01 * f64::from(i * 37 % 11)).collect();
        let mut x = clean.clone();
        for i in (7..400).step_by(10) {
            x[i] += 50.0;
        }
        assert!((despike(&mut x) - 0.1).abs() < 1e-12);
        assert!(x.iter().zip(&clean).all(|(a, b)| (a - b).abs() < 0.2));
        let mut step = clean.clone();
        assert!(despike(&mut step).abs() < 1e-15 && step == clean);
    }
}
