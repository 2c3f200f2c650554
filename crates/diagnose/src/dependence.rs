//! On what a leftover depends: held-out share that a step function of one signal explains, against what chance alone explains.
//!
//! The signals are what a robot's physics can be a function of (positions, velocities, accelerations, the model's effort, time,
//! temperature) and every column of the recordings that the tool has no use for.

use alloc::collections::BTreeMap;

use pkm_dyn::math;
use rayon::prelude::*;

use crate::contest::surrogates;
use crate::evidence::{Dependence, Lines};
use crate::motion::Motion;
use crate::settings::Settings;
use crate::work::Work;

/// Stretches of a signal's range with equally many rows each.
const BINS: usize = 12;

/// A joint's leftover against one signal.
#[derive(Debug, Clone)]
pub(crate) struct Depends {
    /// Name of the signal as the recordings have it.
    pub(crate) signal: String,
    /// Held-out share of the squared leftover that it explains.
    pub(crate) gain: f64,
    /// The size of what it explains: rms over the held-out rows of a moving joint `[N | N·m]`.
    pub(crate) size: f64,
    /// Share of null runs, and of the recordings themselves, in which any signal explains as surprisingly much at any joint.
    pub(crate) p_value: f64,
}

/// Rows of one joint, and the stretch of each signal in which each row lies.
struct Table {
    /// Segment, row, and whether it is fitted.
    rows: Vec<(usize, usize, bool)>,
    signals: Vec<Binned>,
}

struct Binned {
    name: String,
    bin: Vec<usize>,
    /// Mean of the signal in each stretch.
    centre: Vec<f64>,
}

impl Table {
    fn new(work: &Work, joint: usize) -> Self {
        let mut rows = Vec::new();
        for (s, r) in work.design.rows.iter().enumerate() {
            rows.extend((0..r.time.len()).filter(|&i| r.valid[i] && r.moving[joint][i]).map(|i| (s, i, r.fold[i].is_some())));
        }
        let signals = signals(work).into_iter().filter_map(|(name, values)| Binned::new(name, &values, &rows)).collect();
        Self { rows, signals }
    }

    /// What each signal explains of `left`: [signal].
    fn gains(&self, left: &[Vec<f64>]) -> Vec<f64> {
        let y: Vec<f64> = self.rows.iter().map(|&(s, i, _)| left[s][i]).collect();
        let before: f64 = self.rows.iter().zip(&y).filter(|(r, _)| !r.2).map(|(_, y)| y * y).sum();
        self.signals
            .iter()
            .map(|signal| {
                let mean = self.means(signal, &y);
                let rows = self.rows.iter().zip(&y).zip(&signal.bin).filter(|((r, _), _)| !r.2);
                let after: f64 = rows.map(|((_, y), b)| (y - mean[*b]) * (y - mean[*b])).sum();
                if before > 0.0 { 1.0 - after / before } else { 0.0 }
            })
            .collect()
    }

    /// Mean over the fitted rows of each stretch.
    fn means(&self, signal: &Binned, y: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0_usize); signal.centre.len()];
        for ((row, y), b) in self.rows.iter().zip(y).zip(&signal.bin) {
            if row.2 {
                sums[*b] = (sums[*b].0 + y, sums[*b].1 + 1);
            }
        }
        sums.into_iter().map(|(s, n)| s / n.max(1) as f64).collect()
    }

    fn heldout_rms(&self, left: &[Vec<f64>]) -> f64 {
        let held = || self.rows.iter().filter(|r| !r.2);
        let sum: f64 = held().map(|&(s, i, _)| left[s][i] * left[s][i]).sum();
        math::sqrt(sum / held().count().max(1) as f64)
    }
}

impl Binned {
    /// `None` for a signal that does not change, or is missing somewhere.
    fn new(name: String, values: &[Vec<f64>], rows: &[(usize, usize, bool)]) -> Option<Self> {
        let mut order: Vec<(f64, usize)> = rows.iter().enumerate().map(|(k, &(s, i, _))| (values[s][i], k)).collect();
        if order.is_empty() || order.iter().any(|(x, _)| !x.is_finite()) {
            return None;
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, last) = (order[0].0, order[order.len() - 1].0);
        if last - first <= 1e-9 * last.abs().max(first.abs()) {
            return None;
        }
        let mut bin = vec![0; rows.len()];
        let mut centre = Vec::with_capacity(BINS);
        for (b, stretch) in order.chunks(order.len().div_ceil(BINS)).enumerate() {
            centre.push(stretch.iter().map(|(x, _)| x).sum::<f64>() / stretch.len() as f64);
            stretch.iter().for_each(|(_, k)| bin[*k] = b);
        }
        Some(Self { name, bin, centre })
    }
}

/// Signals at the rows: name and [segment][row].
fn signals(work: &Work) -> Vec<(String, Vec<Vec<f64>>)> {
    type Of = fn(&Motion, usize) -> &Vec<f64>;
    const OF: [(&str, Of); 4] =
        [("q", |m, k| &m.segment.q[k]), ("dq", |m, k| &m.segment.v[k]), ("ddq", |m, k| &m.segment.a[k]), ("tau_model", |m, k| &m.rigid[k])];
    let model = &work.robot.model;
    let at_rows = |of: &dyn Fn(&Motion) -> Vec<f64>| -> Vec<Vec<f64>> {
        let one = |(s, m): (usize, &Motion)| {
            let raw = of(m);
            let at = |i: usize| raw.get(work.design.fine[s].raw_index(i).min(raw.len().saturating_sub(1))).copied().unwrap_or(f64::NAN);
            (0..work.design.rows[s].time.len()).map(at).collect()
        };
        work.motions.iter().enumerate().map(one).collect()
    };
    let mut out = Vec::new();
    for (k, &j) in model.actuators.iter().enumerate() {
        for (kind, of) in OF {
            out.push((format!("{kind}.{}", model.joints[j].name), at_rows(&|m| of(m, k).clone())));
        }
        out.push((format!("temp.{}", model.joints[j].name), at_rows(&|m| m.segment.warmth[k].clone())));
    }
    out.push(("t".to_string(), at_rows(&|m| (0..m.segment.valid.len()).map(|i| m.segment.dt * i as f64).collect())));
    let mut extra: BTreeMap<&String, usize> = BTreeMap::new();
    for name in work.motions.iter().flat_map(|m| m.segment.extra.keys()) {
        *extra.entry(name).or_default() += 1;
    }
    // A column that some recordings lack explains nothing of those.
    for (name, _) in extra.into_iter().filter(|(_, n)| *n == work.motions.len()) {
        out.push((name.clone(), at_rows(&|m| m.segment.extra.get(name).cloned().unwrap_or_default())));
    }
    out
}

/// Per joint what its leftover depends on, strongest first. `left` is [joint][segment][row], as fits see it.
pub(crate) fn dependences(work: &Work, left: &[Vec<Vec<f64>>], settings: &Settings) -> Vec<Vec<Depends>> {
    let tables: Vec<Table> = (0..work.design.n_drives).map(|j| Table::new(work, j)).collect();
    let gains = |left: &[Vec<Vec<f64>>]| -> Vec<Vec<f64>> { tables.iter().zip(left).map(|(t, l)| t.gains(l)).collect() };
    let real = gains(left);
    let null: Vec<Vec<Vec<f64>>> = surrogates(work, left, settings).par_iter().map(|run| gains(run)).collect();
    // In units of its own null runs, as candidates are: signals and joints differ in how much chance can do.
    let surprise = |j: usize, k: usize, gain: f64| {
        let n = null.len().max(1) as f64;
        let mean = null.iter().map(|run| run[j][k]).sum::<f64>() / n;
        let variance = null.iter().map(|run| (run[j][k] - mean) * (run[j][k] - mean)).sum::<f64>() / n;
        (gain - mean) / math::sqrt(variance).max(1e-9)
    };
    let all = || (0..tables.len()).flat_map(|j| (0..tables[j].signals.len()).map(move |k| (j, k)));
    let tops: Vec<f64> = null.iter().map(|run| all().map(|(j, k)| surprise(j, k, run[j][k])).fold(f64::NEG_INFINITY, f64::max)).collect();
    let mut out = Vec::new();
    for (j, table) in tables.iter().enumerate() {
        let rms = table.heldout_rms(&left[j]);
        let one = |(k, signal): (usize, &Binned)| {
            let gain = real[j][k];
            let own = surprise(j, k, gain);
            let reached = tops.iter().filter(|top| **top >= own).count();
            let p_value = (1 + reached) as f64 / (1 + tops.len()) as f64;
            Depends { signal: signal.name.clone(), gain, size: rms * math::sqrt(gain.max(0.0)), p_value }
        };
        let mut each: Vec<Depends> = table.signals.iter().enumerate().map(one).collect();
        each.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        out.push(each);
    }
    out
}

/// The mean leftover over stretches of a signal with two standard errors, for the report.
pub(crate) fn curve(work: &Work, joint: usize, left: &[Vec<Vec<f64>>], signal: &str) -> Option<Dependence> {
    let table = Table::new(work, joint);
    let binned = table.signals.iter().find(|s| s.name == signal)?;
    let y: Vec<f64> = table.rows.iter().map(|&(s, i, _)| left[joint][s][i]).collect();
    let mut parts: Vec<(f64, f64, f64)> = vec![(0.0, 0.0, 0.0); binned.centre.len()];
    for (y, b) in y.iter().zip(&binned.bin) {
        parts[*b] = (parts[*b].0 + 1.0, parts[*b].1 + y, parts[*b].2 + y * y);
    }
    let mean: Vec<f64> = parts.iter().map(|(n, s, _)| s / n.max(1.0)).collect();
    let error = parts.iter().zip(&mean).map(|((n, _, q), m)| 2.0 * math::sqrt((q / n.max(1.0) - m * m).max(0.0) / n.max(1.0))).collect();
    let drive = &work.robot.model.joints[work.robot.model.actuators[joint]];
    Some(Dependence {
        joint: drive.name.clone(),
        unit: drive.kind.unit_effort().to_string(),
        signal: signal.to_string(),
        x: binned.centre.clone(),
        mean,
        error,
    })
}

/// Amplitude of a joint's leftover by frequency `[Hz]` and by order over its position, for the report.
pub(crate) fn lines(work: &Work, joint: usize, left: &[Vec<Vec<f64>>]) -> Vec<Lines> {
    let drive = &work.robot.model.joints[work.robot.model.actuators[joint]];
    let mut points: Vec<(f64, f64, f64)> = Vec::new();
    for (s, r) in work.design.rows.iter().enumerate() {
        let raw = |i: usize| work.design.fine[s].raw_index(i).min(work.motions[s].segment.valid.len() - 1);
        let inside = (0..r.time.len()).filter(|&i| r.valid[i] && r.moving[joint][i]);
        points.extend(inside.map(|i| (r.time[i], work.motions[s].segment.q[joint][raw(i)], left[joint][s][i])));
    }
    let extent = |of: fn(&(f64, f64, f64)) -> f64| {
        let (low, high) = points.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        (high - low).max(f64::MIN_POSITIVE)
    };
    let spacing = work.design.fine.iter().map(|f| f.dt * f.thin as f64).fold(0.0, f64::max);
    let (travel, top) = (extent(|p| p.1), 0.5 / spacing.max(f64::MIN_POSITIVE));
    let spectrum = |at: &[f64], phase: &dyn Fn(&(f64, f64, f64)) -> f64| -> Vec<f64> {
        let one = |w: &f64| {
            let (c, s) = points.iter().fold((0.0, 0.0), |(c, s), p| {
                let angle = w * phase(p);
                (c + p.2 * math::cos(angle), s + p.2 * math::sin(angle))
            });
            2.0 * math::hypot(c, s) / points.len().max(1) as f64
        };
        at.iter().map(one).collect()
    };
    let steps = |most: f64| -> Vec<f64> { (1..=160).map(|i| most * f64::from(i) / 160.0).collect() };
    let (frequencies, orders) = (steps(top), steps(40.0 * core::f64::consts::TAU / travel));
    let radians: Vec<f64> = frequencies.iter().map(|f| core::f64::consts::TAU * f).collect();
    let unit = drive.kind.unit_effort().to_string();
    let of = |over: &str, x: Vec<f64>, amplitude: Vec<f64>| Lines {
        joint: drive.name.clone(),
        unit: unit.clone(),
        over: over.to_string(),
        x,
        amplitude,
    };
    let (by_time, by_position) = (spectrum(&radians, &|p| p.0), spectrum(&orders, &|p| p.1));
    let order = format!("order over q.{} [1/{}]", drive.name, drive.kind.unit_position());
    vec![of("frequency [Hz]", frequencies, by_time), of(&order, orders, by_position)]
}
