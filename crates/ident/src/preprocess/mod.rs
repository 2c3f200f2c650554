//! What is done to recordings before they are fitted, and the account of it: every step says what it did, with numbers.
//!
//! In this order: single outliers are replaced ([`outliers`]), samples are thinned behind a zero-phase filter ([`decimation`]), periods of a
//! periodic motion are averaged ([`periods`]), the clock of the efforts is shifted ([`time_offset`]). Derivatives are taken last, as
//! [`differentiation::Derivative`] says.

pub mod b_spline;
pub mod decimation;
pub mod differentiation;
pub mod outliers;
pub mod periods;
pub mod savitzky_golay;
pub mod time_offset;

use alloc::collections::BTreeMap;

use crate::Recording;
use crate::error::InputError;
use crate::grid::Grid;

/// Steps to take; by default none but the count of what is missing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Preprocess {
    /// Replaces samples further than this many robust standard deviations from the median around them.
    pub outliers: Option<f64>,
    /// Thins to the rate that is nearest above this one `[Hz]`.
    pub rate_hz: Option<f64>,
    /// Averages over this period `[s]`.
    pub period_s: Option<f64>,
    /// Whose clock is believed.
    pub clock: Clock,
}

/// Whether positions and efforts are taken to be of one time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Clock {
    /// As they are stamped.
    #[default]
    Stamped,
    /// Efforts are shifted by this time: what is stamped `t` was measured at `t − late` `[s]`.
    Late(f64),
    /// The shift is estimated, to this much to either side `[s]`.
    Estimated(f64),
}

/// What one step did to one signal.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Done {
    /// The recording.
    pub recording: String,
    /// The step.
    pub step: &'static str,
    /// The signal, or `all`.
    pub signal: String,
    /// Its numbers; names carry the unit.
    pub numbers: BTreeMap<&'static str, f64>,
}

impl Done {
    pub(crate) fn new(recording: &Recording, step: &'static str, signal: &str, numbers: &[(&'static str, f64)]) -> Self {
        Self { recording: recording.name.clone(), step, signal: signal.to_string(), numbers: numbers.iter().copied().collect() }
    }
}

impl core::fmt::Display for Done {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let numbers: Vec<String> = self.numbers.iter().map(|(name, x)| format!("{name} {}", significant(*x))).collect();
        write!(f, "{}, {}: {}: {}", self.recording, self.signal, self.step, numbers.join(", "))
    }
}

fn significant(x: f64) -> String {
    let is_whole = x.abs() < 1e15 && (x - x.round()).abs() < 1e-12 * x.abs().max(1.0);
    if is_whole { format!("{x:.0}") } else { format!("{x:.4e}") }
}

/// Signals that identification reads: drive positions and efforts, and their references.
fn is_signal(name: &str) -> bool {
    ["q.", "dq.", "tau.", "q_ref.", "dq_ref."].iter().any(|start| name.starts_with(start))
}

/// The recording after all steps but the shift of clocks, and what they did. Where samples are thinned or averaged only the signals of the
/// drives are kept.
///
/// # Errors
/// A period that does not fit twice into the recording, or a rate that is none.
pub fn prepared(recording: &Recording, steps: &Preprocess) -> Result<(Recording, Vec<Done>), InputError> {
    let mut out = recording.clone();
    let mut done = missing(&out);
    if let Some(limit) = steps.outliers {
        done.extend(replace_outliers(&mut out, limit));
    }
    if steps.rate_hz.is_some() || steps.period_s.is_some() {
        let Some(grid) = Grid::over(&out.time) else { return Ok((out, done)) };
        for (name, signal) in out.signals.iter_mut().filter(|(name, _)| is_signal(name)) {
            // Stretches without a measurement must not become measurements: they stay unknown where they are longer than a gap.
            let unknown =
                if signal.iter().any(|x| x.is_nan()) || grid.jitter > 0.01 { grid.missing(&out.time, signal) } else { Vec::new() };
            let mut on_grid = if signal.iter().all(|x| x.is_nan()) { vec![f64::NAN; grid.n] } else { grid.resample(&out.time, signal) };
            if name.starts_with("q.") || name.starts_with("tau.") {
                on_grid.iter_mut().zip(&unknown).filter(|(_, u)| **u).for_each(|(x, _)| *x = f64::NAN);
            }
            *signal = on_grid;
        }
        out.signals.retain(|name, _| is_signal(name));
        out.time = (0..grid.n).map(|i| grid.time(i)).collect();
        if let Some(rate) = steps.rate_hz {
            done.push(decimation::decimate(&mut out, grid.dt, rate)?);
        }
        if let Some(period) = steps.period_s {
            done.extend(periods::average(&mut out, period)?);
        }
    }
    Ok((out, done))
}

/// Counts what is missing of every signal that has gaps.
fn missing(recording: &Recording) -> Vec<Done> {
    let mut done = Vec::new();
    for (name, signal) in recording.signals.iter().filter(|(name, _)| is_signal(name)) {
        let (mut gaps, mut longest, mut since) = (0.0_f64, 0.0_f64, None);
        for (i, x) in signal.iter().enumerate() {
            match (x.is_nan(), since) {
                (true, None) => since = Some(i),
                (false, Some(from)) => {
                    gaps += 1.0;
                    longest = longest.max(recording.time[i] - recording.time[from]);
                    since = None;
                }
                _ => {}
            }
        }
        if let (Some(from), Some(last)) = (since, recording.time.last()) {
            gaps += 1.0;
            longest = longest.max(last - recording.time[from]);
        }
        let samples = signal.iter().filter(|x| x.is_nan()).count() as f64;
        if samples > 0.0 {
            done.push(Done::new(recording, "missing", name, &[("samples", samples), ("gaps", gaps), ("longest_s", longest)]));
        }
    }
    done
}

fn replace_outliers(recording: &mut Recording, limit: f64) -> Vec<Done> {
    let mut done = Vec::new();
    let names: Vec<String> = recording.signals.keys().filter(|name| is_signal(name)).cloned().collect();
    for name in names {
        let Some(signal) = recording.signals.get_mut(&name) else { continue };
        let found = outliers::replace(signal, limit);
        let share = found.replaced.len() as f64 / signal.len().max(1) as f64;
        let numbers = [("replaced", found.replaced.len() as f64), ("share", share), ("limit_sd", limit), ("largest", found.largest)];
        done.push(Done::new(recording, "outliers", &name, &numbers));
    }
    done
}

/// Shifts all efforts so that they belong to the stamps of the positions. What was unknown is unknown where it has gone to, and so is what
/// would come from beyond an end of the recording.
#[must_use]
pub fn shifted(recording: &Recording, late_s: f64) -> Recording {
    let mut out = recording.clone();
    let Some(grid) = Grid::over(&out.time) else { return out };
    for (_, signal) in out.signals.iter_mut().filter(|(name, _)| name.starts_with("tau.")) {
        let unknown: Vec<bool> = recording.time.iter().map(|t| is_unknown(&recording.time, signal, t + late_s, grid.dt)).collect();
        let on_grid = grid.resample(&recording.time, signal);
        let moved = crate::filter::advanced(&on_grid, late_s, grid.dt);
        *signal = recording
            .time
            .iter()
            .zip(&unknown)
            .map(|(t, unknown)| if *unknown { f64::NAN } else { sampled(&moved, (t - grid.start) / grid.dt) })
            .collect();
    }
    out
}

/// Whether a signal is not known at time `t` `[s]`: before or after all samples, or beside one that is missing.
fn is_unknown(time: &[f64], signal: &[f64], t: f64, dt: f64) -> bool {
    // Stamps are no better than this.
    let close = 1e-6 * dt;
    let next = time.partition_point(|s| *s < t - close);
    match time.get(next) {
        None => true,
        Some(s) if (s - t).abs() <= close => signal[next].is_nan(),
        Some(_) => next == 0 || signal[next].is_nan() || signal[next - 1].is_nan(),
    }
}

/// Linear interpolation at a place counted in samples, held at the ends.
fn sampled(x: &[f64], at: f64) -> f64 {
    let last = x.len().saturating_sub(1);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the signal's length")]
    let i = at.clamp(0.0, last as f64) as usize;
    let share = (at - i as f64).clamp(0.0, 1.0);
    x.get(i).map_or(0.0, |a| a + share * (x[(i + 1).min(last)] - a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    fn recording(n: usize, f: &dyn Fn(f64) -> f64) -> Recording {
        let mut out = Recording { name: "r".to_string(), time: (0..n).map(|i| 0.01 * i as f64).collect(), ..Recording::default() };
        out.signals.insert("q.j".to_string(), out.time.iter().map(|t| f(*t)).collect());
        out.signals.insert("tau.j".to_string(), out.time.iter().map(|t| 3.0 * f(*t)).collect());
        out
    }

    #[test]
    fn every_step_says_what_it_did() {
        let mut r = recording(2000, &|t| math::sin(2.0 * core::f64::consts::PI * t / 4.0));
        let q = r.signals.get_mut("q.j").unwrap();
        q[100..130].fill(f64::NAN);
        q[500] = 40.0;
        let steps = Preprocess { outliers: Some(8.0), rate_hz: Some(50.0), period_s: Some(4.0), clock: Clock::Stamped };
        let (out, done) = prepared(&r, &steps).unwrap();
        let number = |step: &str, signal: &str, name: &str| {
            done.iter().find(|d| d.step == step && d.signal == signal).unwrap_or_else(|| panic!("{step} {done:?}")).numbers[name]
        };
        assert!((number("missing", "q.j", "samples") - 30.0).abs() < 1e-9 && (number("missing", "q.j", "longest_s") - 0.3).abs() < 1e-9);
        assert!((number("outliers", "q.j", "replaced") - 1.0).abs() < 1e-9 && number("outliers", "q.j", "largest") > 35.0);
        assert!((number("decimation", "all", "factor") - 2.0).abs() < 1e-9);
        assert!((number("period average", "q.j", "periods") - 5.0).abs() < 1e-9);
        assert_eq!(out.time.len(), 200);
        let worst =
            out.time.iter().zip(out.signal("q.j").unwrap()).map(|(t, q)| (q - math::sin(2.0 * core::f64::consts::PI * t / 4.0)).abs());
        assert!(worst.fold(0.0, f64::max) < 5e-3);
        assert!(done.iter().all(|d| !d.to_string().is_empty()));
    }

    #[test]
    fn nothing_asked_is_nothing_done() {
        let r = recording(300, &|t| t);
        let (out, done) = prepared(&r, &Preprocess::default()).unwrap();
        assert!(out == r && done.is_empty());
    }

    #[test]
    fn late_efforts_are_moved_back() {
        let r = recording(1000, &|t| math::sin(3.0 * t));
        let mut late = r.clone();
        late.signals.insert("tau.j".to_string(), r.time.iter().map(|t| 3.0 * math::sin(3.0 * (t - 0.023))).collect());
        let back = shifted(&late, 0.023);
        let pairs = back.signal("tau.j").unwrap().iter().zip(r.signal("tau.j").unwrap());
        assert!(pairs.skip(5).take(985).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn what_is_missing_moves_with_the_clock() {
        // Samples 400 to 419 are missing as stamped, 2.3 samples late: those of 397.7 to 416.7 are, and what lies between two samples of
        // which one is missing is not known either.
        let mut r = recording(1000, &|t| math::sin(3.0 * t));
        r.signals.get_mut("tau.j").unwrap()[400..420].fill(f64::NAN);
        let back = shifted(&r, 0.023);
        let unknown: Vec<usize> = (0..1000).filter(|&i| back.signal("tau.j").unwrap()[i].is_nan()).collect();
        // Sample i is what was stamped i + 2.3; the last such stamp is 999.
        let want: Vec<usize> = (397..=417).chain(997..1000).collect();
        assert_eq!(unknown, want);
        // A whole number of samples moves whole samples, forwards as well.
        let later = shifted(&r, -0.03);
        let unknown: Vec<usize> = (0..1000).filter(|&i| later.signal("tau.j").unwrap()[i].is_nan()).collect();
        assert_eq!(unknown, (0..3).chain(403..423).collect::<Vec<_>>());
        let same = shifted(&r, 0.0);
        assert!((0..1000).all(|i| same.signal("tau.j").unwrap()[i].is_nan() == (400..420).contains(&i)));
    }
}
