//! One pass over one recording: columns and effort sample by sample, filtered and thinned window by window.
//!
//! A window is long against the filter's memory and overlaps the next by twice that, so the seams do not show.

use nalgebra::DMatrix;
use pkm_dyn::inverse_dynamics::{closed_loop_motion, rigid_effort};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::{Data, Model, loops, math};

use crate::columns::Columns;
use crate::degrees::unit_that_closes;
use crate::electronics::{Electronics, acting, without};
use crate::error::InputError;
use crate::filter::LowPass;
use crate::motion::{Motion, Use, top_speed};
use crate::observation::{BLOCKS, Block, Observation, Rows, Standstill};

/// Rows per period of the band: with the filter's power halved twice at the band, hardly anything is left above half of that.
const ROWS_PER_PERIOD: f64 = 2.5;

/// The filter's memory in periods of the band: its slowest pole has then decayed to 5e-7.
const MEMORY_PERIODS: f64 = 6.0;

/// Samples handed to the filter at once, at least.
const WINDOW: usize = 4096;

/// Series that are filtered side by side.
const LANES: usize = 8;

/// A joint slower than this share of its top speed stands still.
const STANDSTILL: f64 = 0.01;

/// The model during one recording: gravity as stated for it, a known load fixed.
pub(crate) fn model_for(model: &Model, motion: &Motion) -> Result<Model, InputError> {
    let mut model = model.clone();
    if let Some(g) = motion.gravity {
        model.gravity = g.into();
    }
    if let Some(load) = &motion.load {
        let bad = |detail: String| InputError::Meta { recording: motion.name.clone(), key: "load", detail };
        let link = model.link_index(&load.link).ok_or_else(|| bad(format!("no link {:?} in this robot", load.link)))?;
        if !(load.mass.is_finite() && load.mass >= 0.0) {
            return Err(bad(format!("mass = {} kg (must be finite and >= 0)", load.mass)));
        }
        let body = InertialParameters::from_centre_of_mass(load.mass, load.xyz.into(), nalgebra::Matrix3::zeros());
        let sum = model.links[link].parameters.joined(&body);
        model.set_link_parameters(link, sum);
    }
    Ok(model)
}

pub(crate) fn thin(dt: f64, band: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive rates")]
    let n = (1.0 / (dt * ROWS_PER_PERIOD * band)).floor() as usize;
    n.max(1)
}

/// `v/√(v² + w²)`: the sign of `v`, passing through zero over a width `w`.
fn soft_sign(v: f64, width: f64) -> f64 {
    let length = math::sqrt(v * v + width * width);
    if length > 0.0 { v / length } else { 0.0 }
}

/// Samples at which a joint stands. A margin on both sides covers the smoothing of the velocity: inside it neither speed nor
/// acceleration is known.
fn standing(v: &[f64], dt: f64, band: f64) -> Vec<bool> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive time over a positive period")]
    let margin = (0.1 / (band * dt)).ceil() as usize;
    let slow = STANDSTILL * top_speed(v);
    let mut out = vec![false; v.len()];
    for i in 0..v.len() {
        let reverses = i > 0 && v[i] * v[i - 1] < 0.0;
        if v[i].abs() <= slow || reverses {
            out[i.saturating_sub(margin)..(i + margin + 1).min(v.len())].fill(true);
        }
    }
    out
}

/// One pass over one recording.
pub(crate) struct Walk<'o> {
    columns: &'o Columns,
    motion: &'o Motion,
    index: usize,
    rows: Rows,
    model: Model,
    data: Data,
    electronics: Vec<Electronics>,
    /// Of more drives than freedoms the efforts that act, [drive][sample].
    tau: Option<Vec<Vec<f64>>>,
    still: Vec<Vec<bool>>,
    width: Vec<f64>,
    /// Parameters of known loads of this recording times their columns are taken off the effort.
    load: Vec<f64>,
    filter: LowPass,
    thin: usize,
    edge: usize,
    margin: usize,
    window: usize,
    /// By drive, sample after sample of the window: columns, then known effort, effort, moving. A sample is written whole, so it lies together.
    series: Vec<Vec<f64>>,
    /// [drive][column and the rest], those that have been other than zero: most columns of most drives are zero by structure.
    acts: Vec<Vec<bool>>,
    /// Numbers of a sample of a drive.
    stride: usize,
    /// First raw sample of the window.
    from: usize,
}

impl<'o> Walk<'o> {
    pub(crate) fn try_new(o: &'o Observation<'_>, index: usize, motion: &'o Motion, rows: Rows) -> Result<Self, InputError> {
        let robot = o.robot();
        let model = model_for(&robot.model, motion)?;
        let data = Data::new(&model);
        let is_shared = model.n_act() > data.n_ind();
        let samples = |periods: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive rates")]
            let n = (periods / (o.band() * motion.dt)).ceil() as usize;
            n.max(1)
        };
        let margin = samples(MEMORY_PERIODS);
        let window = WINDOW.max(4 * margin);
        let cut = rows == Rows::Fitted && o.options().standstill == Standstill::Cut;
        let still = |v: &Vec<f64>| if cut { standing(v, motion.dt, o.band()) } else { vec![false; v.len()] };
        let stride = o.columns().len() + 3;
        // A known load is a column of the standard parameters with a known value.
        let load = o.columns().links.iter().flat_map(|&l| {
            let change = model.links[l].parameters.to_vector() - robot.model.links[l].parameters.to_vector();
            change.iter().copied().collect::<Vec<_>>()
        });
        Ok(Self {
            columns: o.columns(),
            motion,
            index,
            rows,
            data,
            tau: is_shared.then(|| acting(robot, motion)),
            electronics: model.actuators.iter().map(|&j| if is_shared { Electronics::none() } else { Electronics::of(robot, j) }).collect(),
            still: motion.v.iter().map(still).collect(),
            width: vec![0.0; model.nv()],
            load: load.collect(),
            filter: LowPass::new(o.band(), motion.dt),
            thin: thin(motion.dt, o.band()),
            edge: samples(1.0),
            margin,
            window,
            series: vec![vec![0.0; window.min(motion.len()) * stride]; model.n_act()],
            acts: vec![vec![false; stride]; model.n_act()],
            stride,
            from: 0,
            model,
        }
        .with_widths(o.options().softness))
    }

    /// Widths of the direction's passage through zero: drives from their own speed, passive joints as they come along.
    fn with_widths(mut self, softness: f64) -> Self {
        let tops: Vec<f64> = self.motion.v.iter().map(|v| top_speed(v)).collect();
        for (&j, top) in self.model.actuators.iter().zip(&tops) {
            self.width[j] = softness * top;
        }
        // A passive joint's top speed needs the whole motion; the drives' speeds through the reduction at the start are its size.
        let q: Vec<f64> = self.motion.q.iter().map(|q| q[0]).collect();
        let _checked_by_run = loops::assemble(&self.model, &mut self.data);
        let _checked_by_run = loops::walk_to(&self.model, &mut self.data, &q);
        loops::drive_reduction(&self.model, &mut self.data);
        for j in self.model.passive() {
            let square: f64 = tops.iter().enumerate().map(|(k, top)| (self.data.drive_reduction[(j, k)] * top).abs()).map(|x| x * x).sum();
            self.width[j] = softness * math::sqrt(square);
        }
        self
    }

    pub(crate) fn run(&mut self, visit: &mut dyn FnMut(&Block<'_>), progress: &mut dyn FnMut(usize)) -> Result<(), InputError> {
        let (n, n_act) = (self.motion.len(), self.model.n_act());
        let (mut q, mut v, mut a) = (vec![0.0; n_act], vec![0.0; n_act], vec![0.0; n_act]);
        let mut out_from = 0;
        for i in 0..n {
            for k in 0..n_act {
                (q[k], v[k], a[k]) = (self.motion.q[k][i], self.motion.v[k][i], self.motion.a[k][i]);
            }
            if i == 0 {
                let home = loops::assemble(&self.model, &mut self.data);
                self.check(&home, 0)?;
                let start = loops::walk_to(&self.model, &mut self.data, &q);
                self.check(&start, 0)?;
            }
            let closure = closed_loop_motion(&self.model, &mut self.data, &q, &v, &a);
            self.check(&closure, i)?;
            self.store(i);
            let is_last = i + 1 == n;
            if is_last || i + 1 - self.from == self.window {
                let out_to = if is_last { n } else { i + 1 - self.margin };
                self.hand_out(out_from, out_to, i + 1 - self.from, visit);
                progress(i);
                self.shift(out_to);
                out_from = out_to;
            }
        }
        Ok(())
    }

    fn check(&self, closure: &loops::Closure, i: usize) -> Result<(), InputError> {
        if closure.is_closed {
            return Ok(());
        }
        let (recording, robot) = (self.motion.name.clone(), self.model.name.clone());
        let time = self.motion.start + self.motion.dt * i as f64;
        if closure.gap < 1e-9 {
            let passive = self.data.dependent.len();
            return Err(InputError::Singular { recording, time, rank: closure.rank, passive, robot });
        }
        let q: Vec<f64> = self.motion.q.iter().map(|q| q[i]).collect();
        let unit = unit_that_closes(&self.model, &q);
        Err(InputError::Open { recording, time, row: closure.row, gap: closure.gap, robot, unit })
    }

    /// Raw sample `i` into the window: of surplus drives what moves the robot, and of that what no standing drive has a part in.
    fn store_shared(&mut self, i: usize) {
        let (n_act, p) = (self.model.n_act(), self.columns.len());
        let direction: Vec<f64> = self.data.v.iter().zip(&self.width).map(|(v, w)| soft_sign(*v, *w)).collect();
        let known = self.known(&direction);
        // Columns come as what moves the robot already; the rows of the drives in the reduction do that to the efforts.
        let mut all = DMatrix::zeros(n_act, p + 2);
        self.columns.fill(&self.model, &mut self.data, &direction, &mut |k, c, x| all[(k, c)] = x);
        for k in 0..n_act {
            let load: f64 = self.load.iter().enumerate().map(|(c, l)| l * all[(k, c)]).sum();
            all[(k, p)] = known[k] + load;
            all[(k, p + 1)] = self.tau.as_ref().map_or(&self.motion.tau, |tau| tau)[k][i];
        }
        let mut moves = DMatrix::from_fn(n_act, n_act, |k, j| self.data.drive_reduction[(self.model.actuators[k], j)]);
        without(&mut moves, &mut (0..n_act).filter(|&k| self.still[k][i]));
        let rows = moves * all;
        let at = (i - self.from) * self.stride;
        for (k, (series, acts)) in self.series.iter_mut().zip(&mut self.acts).enumerate() {
            let sample = &mut series[at..][..self.stride];
            (0..p + 2).for_each(|c| sample[c] = rows[(k, c)]);
            sample[p + 2] = f64::from(u8::from(!self.still[k][i]));
            acts.iter_mut().zip(sample).for_each(|(acts, x)| *acts |= x.abs() > 0.0);
        }
    }

    /// Raw sample `i` into the window.
    fn store(&mut self, i: usize) {
        if self.tau.is_some() {
            self.store_shared(i);
            return;
        }
        let direction: Vec<f64> = self.data.v.iter().zip(&self.width).map(|(v, w)| soft_sign(*v, *w)).collect();
        let known = self.known(&direction);
        let (p, at) = (self.columns.len(), (i - self.from) * self.stride);
        let (still, load, electronics, acts) = (&self.still, &self.load, &self.electronics, &mut self.acts);
        let mut samples: Vec<&mut [f64]> = self.series.iter_mut().map(|series| &mut series[at..][..self.stride]).collect();
        samples.iter_mut().for_each(|sample| sample.fill(0.0));
        let mut known_load = vec![0.0; known.len()];
        // Behind electronics columns are cut at standstill in the end: a lag of what is cut already is none of the cut effort's.
        let is_kept = |k: usize| !still[k][i] || !electronics[k].is_plain();
        self.columns.fill(&self.model, &mut self.data, &direction, &mut |k, c, x| {
            if is_kept(k) {
                samples[k][c] = x;
                acts[k][c] |= x.abs() > 0.0;
                known_load[k] += load.get(c).map_or(0.0, |l| l * x);
            }
        });
        for (k, sample) in samples.into_iter().enumerate() {
            if is_kept(k) {
                sample[p] = known[k] + known_load[k];
            }
            if !still[k][i] {
                sample[p + 1] = self.motion.tau[k][i];
                sample[p + 2] = 1.0;
            }
            (p..p + 3).for_each(|c| acts[k][c] |= sample[c].abs() > 0.0);
        }
    }

    /// Effort of the effects that stay as the robot file has them.
    fn known(&mut self, direction: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.model.n_act()];
        if self.columns.has_kept_effort() {
            rigid_effort(&self.model, &mut self.data);
            loops::drive_reduction(&self.model, &mut self.data);
            let load = self.data.tau_act.clone();
            self.columns.kept_effort(&self.model, &self.data, direction, &load, &mut out);
        }
        out
    }

    /// Filters the first `len` samples of the window and hands out rows `from..to` (raw samples).
    fn hand_out(&self, from: usize, to: usize, len: usize, visit: &mut dyn FnMut(&Block<'_>)) {
        let taken: Vec<usize> = (from.next_multiple_of(self.thin)..to).step_by(self.thin).filter(|&i| self.is_wanted(i)).collect();
        if taken.is_empty() {
            return;
        }
        let p = self.columns.len();
        let n_act = self.model.n_act();
        let mut w = vec![vec![0.0; taken.len() * p]; n_act];
        let (mut z, mut tau, mut active) = (Vec::new(), Vec::new(), Vec::new());
        for (k, w) in w.iter_mut().enumerate() {
            let mut rest = vec![[0.0; 3]; taken.len()];
            self.filtered(
                k,
                len,
                &mut |i, c, x| {
                    if c < p { w[i * p + c] = x } else { rest[i][c - p] = x }
                },
                &taken,
            );
            z.push(rest.iter().map(|[known, effort, _]| effort - known).collect::<Vec<_>>());
            active.push(rest.iter().map(|[.., moving]| *moving > 0.5).collect::<Vec<_>>());
            tau.push(rest.iter().map(|[_, effort, _]| *effort).collect::<Vec<_>>());
        }
        let time: Vec<f64> = taken.iter().map(|&i| self.motion.start + self.motion.dt * i as f64).collect();
        let fold: Vec<usize> = taken.iter().map(|&i| self.index * BLOCKS + self.block(i)).collect();
        visit(&Block { recording: self.index, time: &time, fold: &fold, n_columns: p, w: &w, z: &z, tau: &tau, active: &active });
    }

    /// Filters the series of a drive over the first `len` samples of the window: `put(row, series, value)` at the samples `taken`.
    fn filtered(&self, k: usize, len: usize, put: &mut dyn FnMut(usize, usize, f64), taken: &[usize]) {
        let samples = || self.series[k][..len * self.stride].chunks_exact(self.stride);
        let acting: Vec<usize> = (0..self.stride).filter(|&c| self.acts[k][c]).collect();
        let is_measured = |c: usize| c > self.columns.len();
        for group in acting.chunks(LANES) {
            let recorded = |&c: &usize| -> Vec<f64> {
                let series: Vec<f64> = samples().map(|sample| sample[c]).collect();
                let Some(mut seen) = self.electronics[k].recorded(&series, self.motion.dt).filter(|_| !is_measured(c)) else {
                    return series;
                };
                seen.iter_mut().zip(samples()).for_each(|(x, sample)| *x *= sample[self.columns.len() + 2]);
                seen
            };
            let series: Vec<Vec<f64>> = group.iter().map(recorded).collect();
            // A group that is not full filters its last series several times, and puts it once.
            let lane = |g: usize| series[g.min(group.len() - 1)].as_slice();
            let out = self.filter.apply_each::<LANES>(core::array::from_fn(lane));
            for (row, &i) in taken.iter().enumerate() {
                for (&c, x) in group.iter().zip(out[i - self.from]) {
                    put(row, c, x);
                }
            }
        }
    }

    fn block(&self, i: usize) -> usize {
        (i * BLOCKS / self.motion.len()).min(BLOCKS - 1)
    }

    /// Whether raw sample `i` is a row: measured all around it, away from the ends (filters have no past there), and of this kind.
    fn is_wanted(&self, i: usize) -> bool {
        let n = self.motion.len();
        let is_held_out = self.motion.used == Use::Holdout || (self.motion.used == Use::Both && self.block(i) % 2 == 1);
        let around = &self.motion.valid[i.saturating_sub(self.thin)..(i + self.thin + 1).min(n)];
        is_held_out == (self.rows == Rows::HeldOut) && i >= self.edge && i + self.edge < n && around.iter().all(|ok| *ok)
    }

    /// Moves the window on so that it begins one margin before raw sample `to`.
    fn shift(&mut self, to: usize) {
        let new_from = to.saturating_sub(self.margin).max(self.from);
        let by = new_from - self.from;
        for series in &mut self.series {
            let moved = (by * self.stride).min(series.len());
            series.copy_within(moved.., 0);
        }
        self.from = new_from;
    }
}
