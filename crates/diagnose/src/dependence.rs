//! On what a leftover depends: held-out share that a step function of one signal explains, against what chance alone explains.
//!
//! The signals are what a robot's physics can be a function of (positions, velocities, accelerations, the model's effort, time,
//! temperature) and every column of the recordings that the tool has no use for. A drive's own position, acceleration and effort are
//! signals in either direction of its motion as well: what a friction adds changes its sign with the direction, and has no mean over both.

use alloc::collections::BTreeMap;

use pkm_dyn::math;
use rayon::prelude::*;

use crate::contest::surrogates;
use crate::evidence::{Dependence, Lines};
use crate::motion::Motion;
use crate::settings::Settings;
use crate::wins::is_steady;
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
    /// Whether no null run reaches it.
    pub(crate) is_beyond_chance: bool,
    /// Whether it explains in blocks that its means have not seen what it should.
    pub(crate) is_steady: bool,
}

/// Name of a signal and its values: [segment][row].
type Signal = (String, Vec<Vec<f64>>);

/// A row of a segment and the fold it is fitted in; `None` is held out.
type Place = (usize, usize, Option<usize>);

/// Rows of one joint, and the stretch of each signal in which each row lies.
struct Table {
    rows: Vec<Place>,
    signals: Vec<Binned>,
}

struct Binned {
    name: String,
    bin: Vec<usize>,
    /// Mean of the signal in each stretch.
    centre: Vec<f64>,
    /// Stretches from this one on are of forward motion, those before it of backward motion; `None` where they are of both.
    forwards: Option<usize>,
}

/// A table for every drive.
pub(crate) struct Tables(Vec<Table>);

impl Tables {
    pub(crate) fn of(work: &Work) -> Self {
        let signals = signals(work);
        Self((0..work.design.n_drives).map(|j| Table::new(work, j, &signals)).collect())
    }
}

impl Table {
    /// `all` are the signals at the rows of all segments.
    fn new(work: &Work, joint: usize, all: &[Signal]) -> Self {
        let mut rows: Vec<Place> = Vec::new();
        for (s, r) in work.design.rows.iter().enumerate() {
            rows.extend((0..r.time.len()).filter(|&i| r.valid[i] && r.moving[joint][i]).map(|i| (s, i, r.fold[i])));
        }
        let own = &work.robot.model.joints[work.robot.model.actuators[joint]].name;
        let named = |kind: &str| all.iter().find(|(name, _)| *name == format!("{kind}.{own}"));
        let mut binned: Vec<Binned> = all.iter().filter_map(|(name, values)| Binned::new(name, values, &rows)).collect();
        if let Some((_, speed)) = named("dq") {
            let in_either = ["q", "ddq", "tau_model"].into_iter().filter_map(named);
            binned.extend(in_either.filter_map(|(name, values)| Binned::by_direction(name, values, speed, &rows)));
        }
        Self { rows, signals: binned }
    }

    /// What each signal explains of `left`: [signal].
    fn gains(&self, left: &[Vec<f64>]) -> Vec<f64> {
        let y = self.at_rows(left);
        let held = || self.rows.iter().enumerate().filter(|(_, r)| r.2.is_none()).map(|(k, _)| k);
        let before: f64 = held().map(|k| y[k] * y[k]).sum();
        self.signals
            .iter()
            .map(|signal| {
                let mean = self.means(signal, &y);
                let after: f64 = held().map(|k| (y[k] - mean[signal.bin[k]]) * (y[k] - mean[signal.bin[k]])).sum();
                if before > 0.0 { 1.0 - after / before } else { 0.0 }
            })
            .collect()
    }

    fn at_rows(&self, left: &[Vec<f64>]) -> Vec<f64> {
        self.rows.iter().map(|&(s, i, _)| left[s][i]).collect()
    }

    /// Mean over the fitted rows of each stretch.
    fn means(&self, signal: &Binned, y: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0_usize); signal.centre.len()];
        for ((row, y), b) in self.rows.iter().zip(y).zip(&signal.bin) {
            if row.2.is_some() {
                sums[*b] = (sums[*b].0 + y, sums[*b].1 + 1);
            }
        }
        sums.into_iter().map(|(s, n)| s / n.max(1) as f64).collect()
    }

    /// By block that has rows, the squared leftover that means over all other blocks should take away, and that they do.
    fn by_block(&self, signal: &Binned, y: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n_blocks = self.rows.iter().filter_map(|r| r.2).max().map_or(0, |last| last + 1);
        let mut own = vec![vec![(0.0, 0_usize); signal.centre.len()]; n_blocks];
        for ((row, y), b) in self.rows.iter().zip(y).zip(&signal.bin) {
            if let Some(block) = row.2 {
                own[block][*b] = (own[block][*b].0 + y, own[block][*b].1 + 1);
            }
        }
        let all = |b: usize| own.iter().fold((0.0, 0_usize), |sum, block| (sum.0 + block[b].0, sum.1 + block[b].1));
        let all: Vec<(f64, usize)> = (0..signal.centre.len()).map(all).collect();
        let filled = own.iter().filter(|block| block.iter().any(|b| b.1 > 0));
        filled
            .map(|block| {
                let each = block.iter().zip(&all).map(|((sum, n), (all_sum, all_n))| {
                    let mean = (all_sum - sum) / (all_n - n).max(1) as f64;
                    let due = mean * mean * *n as f64;
                    (due, 2.0 * mean * sum - due)
                });
                each.fold((0.0, 0.0), |total, part| (total.0 + part.0, total.1 + part.1))
            })
            .unzip()
    }

    fn heldout_rms(&self, left: &[Vec<f64>]) -> f64 {
        let held = || self.rows.iter().filter(|r| r.2.is_none());
        let sum: f64 = held().map(|&(s, i, _)| left[s][i] * left[s][i]).sum();
        math::sqrt(sum / held().count().max(1) as f64)
    }
}

impl Binned {
    /// `None` for a signal that does not change, or is missing somewhere.
    fn new(name: &str, values: &[Vec<f64>], rows: &[Place]) -> Option<Self> {
        let mut out = Self { name: name.to_string(), bin: vec![0; rows.len()], centre: Vec::with_capacity(BINS), forwards: None };
        out.cut(values, rows, (0..rows.len()).collect()).then_some(out)
    }

    /// The same in either direction of motion; `None` as well where a joint moves in one alone.
    fn by_direction(name: &str, values: &[Vec<f64>], speed: &[Vec<f64>], rows: &[Place]) -> Option<Self> {
        let (forwards, backwards): (Vec<usize>, Vec<usize>) = (0..rows.len()).partition(|&k| speed[rows[k].0][rows[k].1] > 0.0);
        let (name, bin, centre) = (format!("{name} by direction"), vec![0; rows.len()], Vec::with_capacity(2 * BINS));
        let mut out = Self { name, bin, centre, forwards: None };
        if !out.cut(values, rows, backwards) {
            return None;
        }
        out.forwards = Some(out.centre.len());
        out.cut(values, rows, forwards).then_some(out)
    }

    /// Cuts some of the rows into further stretches, as many in each; whether the signal is there and changes.
    fn cut(&mut self, values: &[Vec<f64>], rows: &[Place], which: Vec<usize>) -> bool {
        let mut order: Vec<(f64, usize)> = which.into_iter().map(|k| (values[rows[k].0][rows[k].1], k)).collect();
        if order.is_empty() || order.iter().any(|(x, _)| !x.is_finite()) {
            return false;
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, last) = (order[0].0, order[order.len() - 1].0);
        if last - first <= 1e-9 * last.abs().max(first.abs()) {
            return false;
        }
        for stretch in order.chunks(order.len().div_ceil(BINS)) {
            stretch.iter().for_each(|(_, k)| self.bin[*k] = self.centre.len());
            self.centre.push(stretch.iter().map(|(x, _)| x).sum::<f64>() / stretch.len() as f64);
        }
        true
    }

    /// The stretches of each of its curves, and what the signal is called there.
    fn curves(&self) -> Vec<(String, core::ops::Range<usize>)> {
        let n = self.centre.len();
        match self.forwards {
            Some(turn) => vec![(format!("{}, forwards", self.name), turn..n), (format!("{}, backwards", self.name), 0..turn)],
            None => vec![(self.name.clone(), 0..n)],
        }
    }
}

/// Signals at the rows of all segments.
fn signals(work: &Work) -> Vec<Signal> {
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
pub(crate) fn dependences(work: &Work, Tables(tables): &Tables, left: &[Vec<Vec<f64>>], settings: &Settings) -> Vec<Vec<Depends>> {
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
        let (rms, y) = (table.heldout_rms(&left[j]), table.at_rows(&left[j]));
        let one = |(k, signal): (usize, &Binned)| {
            let gain = real[j][k];
            let own = surprise(j, k, gain);
            let reached = tops.iter().filter(|top| **top >= own).count();
            let p_value = (1 + reached) as f64 / (1 + tops.len()) as f64;
            let (due, taken) = table.by_block(signal, &y);
            Depends {
                signal: signal.name.clone(),
                gain,
                size: rms * math::sqrt(gain.max(0.0)),
                p_value,
                is_beyond_chance: reached == 0 && !tops.is_empty(),
                is_steady: is_steady(&due, &taken),
            }
        };
        let mut each: Vec<Depends> = table.signals.iter().enumerate().map(one).collect();
        each.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        out.push(each);
    }
    out
}

/// The mean leftover over stretches of a signal with two standard errors, for the report: one curve, or one for each direction of motion.
pub(crate) fn curves(work: &Work, Tables(tables): &Tables, joint: usize, left: &[Vec<Vec<f64>>], signals: &[String]) -> Vec<Dependence> {
    let table = &tables[joint];
    let y = table.at_rows(&left[joint]);
    let drive = &work.robot.model.joints[work.robot.model.actuators[joint]];
    let mut out = Vec::new();
    for binned in signals.iter().filter_map(|name| table.signals.iter().find(|s| s.name == *name)) {
        let mut parts: Vec<(f64, f64, f64)> = vec![(0.0, 0.0, 0.0); binned.centre.len()];
        for (y, b) in y.iter().zip(&binned.bin) {
            parts[*b] = (parts[*b].0 + 1.0, parts[*b].1 + y, parts[*b].2 + y * y);
        }
        let mean: Vec<f64> = parts.iter().map(|(n, s, _)| s / n.max(1.0)).collect();
        let error = |((n, _, q), m): (&(f64, f64, f64), &f64)| 2.0 * math::sqrt((q / n.max(1.0) - m * m).max(0.0) / n.max(1.0));
        let error: Vec<f64> = parts.iter().zip(&mean).map(error).collect();
        out.extend(binned.curves().into_iter().map(|(signal, part)| Dependence {
            joint: drive.name.clone(),
            unit: drive.kind.unit_effort().to_string(),
            signal,
            x: binned.centre[part.clone()].to_vec(),
            mean: mean[part.clone()].to_vec(),
            error: error[part].to_vec(),
        }));
    }
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A table of one signal at `n` rows, ten of a block, the last ten held out.
    fn table(n: usize, value: impl Fn(usize) -> f64, speed: impl Fn(usize) -> f64) -> Table {
        let rows: Vec<Place> = (0..n).map(|i| (0, i, (i + 10 < n).then_some(i / 10))).collect();
        let (values, speeds) = (vec![(0..n).map(value).collect()], vec![(0..n).map(speed).collect()]);
        let plain = Binned::new("q.x", &values, &rows).expect("a signal that changes");
        let either = Binned::by_direction("q.x", &values, &speeds, &rows).expect("motion to and fro");
        Table { rows, signals: vec![plain, either] }
    }

    /// To and fro over the same places, row by row.
    fn direction(i: usize) -> f64 {
        if i.is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    #[test]
    fn what_changes_its_sign_with_the_direction_is_seen_in_either_and_not_in_both() {
        let place = |i: usize| ((i / 2) % 17) as f64;
        let table = table(680, place, direction);
        let left = vec![(0..680).map(|i| direction(i) * (1.0 + 0.2 * place(i))).collect()];
        let gains = table.gains(&left);
        assert!(gains[0].abs() < 0.01 && gains[1] > 0.95, "{gains:?}");
        // Equal at equal place whatever the direction: the signal itself says as much.
        let left = vec![(0..680).map(|i| place(i) - 8.0).collect()];
        let gains = table.gains(&left);
        assert!(gains[0] > 0.95 && (gains[0] - gains[1]).abs() < 0.02, "{gains:?}");
        let names: Vec<String> = table.signals[1].curves().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["q.x by direction, forwards", "q.x by direction, backwards"]);
    }

    #[test]
    fn a_block_has_no_part_in_the_means_that_judge_it() {
        // Twelve places with as many rows each, so that every stretch is one of them.
        let (n, place) = (360, |i: usize| (i % BINS) as f64 - 5.5);
        let table = table(n, place, direction);
        // One block alone is off: its own means would explain it, those of the others cannot.
        let once: Vec<f64> = (0..n).map(|i| if (30..40).contains(&i) { 1.0 } else { 0.0 }).collect();
        let (due, taken) = table.by_block(&table.signals[0], &once);
        assert_eq!((due[3], taken[3]), (0.0, 0.0));
        assert!(taken.iter().sum::<f64>() < 0.0 && !is_steady(&due, &taken), "{taken:?}");
        let always: Vec<f64> = (0..n).map(place).collect();
        let (due, taken) = table.by_block(&table.signals[0], &always);
        let whole: f64 = always[30..40].iter().map(|y| y * y).sum();
        assert_eq!(due.len(), 35);
        assert!((due[3] - whole).abs() < 1e-9 && (taken[3] - whole).abs() < 1e-9 && is_steady(&due, &taken), "{due:?} {taken:?}");
    }

    #[test]
    fn a_joint_that_moves_one_way_has_no_directions() {
        let rows: Vec<Place> = (0..40).map(|i| (0, i, Some(i / 10))).collect();
        let values: Vec<Vec<f64>> = vec![(0..40_u8).map(f64::from).collect()];
        assert!(Binned::by_direction("q.x", &values, &[vec![1.0; 40]], &rows).is_none());
        assert!(Binned::new("q.x", &[vec![2.0; 40]], &rows).is_none());
    }
}
