//! The search for a motion as a function of scaled coefficients: the criterion, the barrier that keeps limits, and the slope of both.
//!
//! A coefficient changes the motion at every sample, but a sample is three numbers per drive. So the slope is taken in two steps: the
//! criterion's slope with respect to position, velocity and acceleration of every sample, by differences of the regressor's product with
//! the slope of the Gram matrix (`3·drives + 1` evaluations of the robot at each sample, however many coefficients there are), and the
//! linear functions that make a motion of coefficients.

use faer::Mat;
use pkm_dyn::math;

use super::basis::{Basis, DriveState, Periodic, dot};
use super::criterion::{Criterion, judge};
use super::limits::{Bound, Bounded, Bounds};
use super::mechanism::{Direction, Mechanism};

/// Samples per cycle of the fastest oscillation at which the robot is evaluated, and the least and most in a period.
const PER_CYCLE: usize = 12;
const SAMPLES: [usize; 2] = [60, 400];

/// Drives' own limits are checked at so many times as many samples: they cost nothing.
const FINER: usize = 4;

/// Step of differences as a share of the usual size.
const STEP: f64 = 1e-6;

/// The functions at the samples of one period: position, velocity and acceleration, a row per sample.
#[derive(Debug, Clone)]
struct Table(Vec<[Vec<f64>; 3]>);

impl Table {
    fn new(basis: Basis, period_s: f64, n: usize) -> Self {
        Self((0..n).map(|i| basis.at(period_s * i as f64 / n as f64, period_s)).collect())
    }

    fn state(&self, i: usize, coefficients: &[Vec<f64>]) -> DriveState {
        let [q, v, a] = self.0[i].each_ref().map(|row| coefficients.iter().map(|c| dot(row, c)).collect());
        DriveState { q, v, a }
    }
}

/// What is asked for: everything but the motion.
#[derive(Debug, Clone)]
pub(super) struct Problem {
    pub(super) criterion: Criterion,
    pub(super) basis: Basis,
    pub(super) period_s: f64,
    /// Bounds to be kept at the samples: somewhat narrower than those that count.
    pub(super) bounds: Bounds,
    table: Table,
    fine: Table,
    /// Size of each coefficient of each drive.
    scale: Vec<Vec<f64>>,
    /// Orthonormal directions in scaled coefficients, per drive, in which the motion would not begin at rest.
    moving: Vec<Vec<Vec<f64>>>,
    /// Usual position, velocity and acceleration of each drive.
    usual: Vec<[f64; 3]>,
}

/// How hard the search presses towards the limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stage {
    /// Weight of the barrier.
    pub(super) barrier: f64,
    /// Sharpness of the smooth condition number.
    pub(super) sharpness: f64,
}

/// A point of the search.
#[derive(Debug, Clone)]
pub(super) struct Worth {
    /// What the search makes small.
    pub(super) objective: f64,
    /// The criterion itself.
    pub(super) value: f64,
}

/// Why a point of the search has no worth.
#[derive(Debug, Clone)]
pub(super) enum Refused {
    /// The loops do not close.
    Open,
    /// A bound is not kept.
    Outside(Bound, f64),
    /// A column that counts is zero, or an effect lies in the span of the base parameters.
    Blind,
}

/// Usual speed and acceleration of a drive: those of a sine over its travel, within its limits.
fn usual(bounds: &[Bound; 3], period_s: f64) -> [f64; 3] {
    let w = 2.0 * core::f64::consts::PI / period_s;
    let half = bounds[0].half();
    let finite = |x: f64, other: f64| if x.is_finite() { x.min(other) } else { other };
    let speed = finite(bounds[1].upper, 3.0 * w * half);
    [half, speed, finite(bounds[2].upper, 3.0 * w * speed)]
}

impl Problem {
    pub(super) fn new(criterion: Criterion, basis: Basis, period_s: f64, bounds: Bounds) -> Self {
        let n = (PER_CYCLE * basis.cycles()).clamp(SAMPLES[0], SAMPLES[1]);
        let usual: Vec<[f64; 3]> = bounds.drives.iter().map(|b| usual(b, period_s)).collect();
        let scale: Vec<Vec<f64>> = bounds.drives.iter().map(|b| scales(basis, period_s, b)).collect();
        let [_, v, a] = basis.at(0.0, period_s);
        let moving = scale.iter().map(|s| orthonormal([&v, &a].map(|row| row.iter().zip(s).map(|(x, s)| x * s).collect()))).collect();
        let (table, fine) = (Table::new(basis, period_s, n), Table::new(basis, period_s, FINER * n));
        Self { criterion, basis, period_s, bounds, table, fine, scale, moving, usual }
    }

    /// Samples of a period at which the robot is evaluated.
    pub(super) fn n_samples(&self) -> usize {
        self.table.0.len()
    }

    /// Usual speed of each drive.
    pub(super) fn speed(&self) -> Vec<f64> {
        self.usual.iter().map(|u| u[1]).collect()
    }

    fn coefficients(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let m = self.basis.len();
        self.scale.iter().enumerate().map(|(k, s)| s.iter().zip(&x[k * m..]).map(|(s, x)| s * x).collect()).collect()
    }

    /// The motion of scaled coefficients.
    pub(super) fn motion(&self, x: &[f64]) -> Periodic {
        Periodic { basis: self.basis, period_s: self.period_s, coefficients: self.coefficients(x) }
    }

    /// Scaled coefficients of rest in the middle of the travel.
    pub(super) fn rest(&self) -> Vec<f64> {
        let m = self.basis.len();
        let n_act = self.scale.len();
        (0..n_act * m).map(|i| self.bounds.centre[i / m] * self.one(i / m, i % m)).collect()
    }

    /// Scaled coefficient `c` of the motion of drive `k` that is 1 all the time.
    fn one(&self, k: usize, c: usize) -> f64 {
        let is_constant = matches!(self.basis, Basis::Spline { .. }) || c == 0;
        if is_constant { 1.0 / self.scale[k][c] } else { 0.0 }
    }

    /// `x` with its distance from rest multiplied by `share`.
    pub(super) fn shrunk(&self, x: &[f64], share: f64) -> Vec<f64> {
        self.rest().iter().zip(x).map(|(r, x)| r + share * (x - r)).collect()
    }

    /// Takes out of `x` what would not let the motion begin at rest.
    pub(super) fn project(&self, x: &mut [f64]) {
        let m = self.basis.len();
        for (k, directions) in self.moving.iter().enumerate() {
            let x = &mut x[k * m..(k + 1) * m];
            for d in directions {
                let along = dot(d, x);
                x.iter_mut().zip(d).for_each(|(x, d)| *x -= along * d);
            }
        }
    }

    /// Scales and shifts each drive's part of `x` so that it uses the share `use_of` of the drive's own limits.
    pub(super) fn fit(&self, x: &mut [f64], use_of: &[f64]) {
        let m = self.basis.len();
        let coefficients = self.coefficients(x);
        let states: Vec<DriveState> = (0..self.fine.0.len()).map(|i| self.fine.state(i, &coefficients)).collect();
        for (k, b) in self.bounds.drives.iter().enumerate() {
            let (low, high) = states.iter().fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s.q[k]), h.max(s.q[k])));
            let top = |of: fn(&DriveState) -> &Vec<f64>| states.iter().fold(f64::MIN_POSITIVE, |top, s| top.max(of(s)[k].abs()));
            let half = (0.5 * (high - low)).max(f64::MIN_POSITIVE);
            let gain = use_of[k] * (b[0].half() / half).min(b[1].upper / top(|s| &s.v)).min(b[2].upper / top(|s| &s.a));
            let (middle, wanted) = (0.5 * (low + high), 0.5 * (b[0].lower + b[0].upper));
            for (c, x) in x[k * m..(k + 1) * m].iter_mut().enumerate() {
                let one = self.one(k, c);
                *x = gain * (*x - middle * one) + wanted * one;
            }
        }
    }

    /// The point's worth; with `slope` its derivative is put there.
    pub(super) fn look(
        &self,
        mechanism: &mut Mechanism<'_>,
        x: &[f64],
        stage: Stage,
        slope: Option<&mut Vec<f64>>,
    ) -> Result<Worth, Refused> {
        let coefficients = self.coefficients(x);
        let mut by_coefficient: Vec<Vec<f64>> = self.scale.iter().map(|s| vec![0.0; s.len()]).collect();
        let mut barrier = self.drives(&coefficients, stage, &mut by_coefficient)?;
        let n = self.n_samples();
        let per_sample = stage.barrier / n as f64;
        let (p, n_act, n_led) = (self.n_judged(mechanism), mechanism.n_drives(), coefficients.len());
        let stride = mechanism.n_columns();
        let mut w = Mat::<f64>::zeros(n * n_act, p);
        let (mut trees, mut pulls) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for i in 0..n {
            let state = self.table.state(i, &coefficients);
            if i == 0 && !mechanism.go(&state.q) {
                return Err(Refused::Open);
            }
            if !mechanism.look(&state, &self.bounds, Direction::Smooth) {
                return Err(Refused::Open);
            }
            let mut pull = vec![0.0; self.bounds.robot.len()];
            for ((b, value), pull) in self.bounds.robot.iter().zip(&mechanism.values).zip(&mut pull) {
                barrier += per_sample * push(b, *value, per_sample, pull)?;
            }
            (0..n_act).for_each(|k| (0..p).for_each(|c| w[(i * n_act + k, c)] = mechanism.rows[k * stride + c]));
            trees.push(mechanism.tree().to_vec());
            pulls.push(pull);
        }
        let rows = (n * n_act) as f64;
        let gram = w.transpose() * &w * (1.0 / rows);
        let judged = judge(self.criterion, &gram, stage.sharpness).ok_or(Refused::Blind)?;
        let objective = judged.smooth + barrier;
        if let Some(out) = slope {
            let weights = &w * &judged.slope * (2.0 / rows);
            for i in 0..n {
                mechanism.put(&trees[i]);
                let state = self.table.state(i, &coefficients);
                let weight = |k: usize, c: usize| weights[(i * n_act + k, c)];
                self.sample(mechanism, &state, &weight, &pulls[i]).into_iter().enumerate().for_each(|(input, slope)| {
                    let (order, k) = (input / n_led, input % n_led);
                    by_coefficient[k].iter_mut().zip(&self.table.0[i][order]).for_each(|(s, b)| *s += slope * b);
                });
            }
            *out = by_coefficient.iter().zip(&self.scale).flat_map(|(d, s)| d.iter().zip(s).map(|(d, s)| d * s)).collect();
            self.project(out);
        }
        if objective.is_finite() { Ok(Worth { objective, value: judged.value }) } else { Err(Refused::Blind) }
    }

    /// Columns that the criterion is about: effects only where they are to be told apart.
    fn n_judged(&self, mechanism: &Mechanism<'_>) -> usize {
        mechanism.n_columns() - if self.criterion.separates() { 0 } else { mechanism.n_effects() }
    }

    /// Slope of one sample's share with respect to positions, velocities and accelerations of the drives.
    fn sample(&self, mechanism: &mut Mechanism<'_>, state: &DriveState, weight: &dyn Fn(usize, usize) -> f64, pull: &[f64]) -> Vec<f64> {
        let (n_act, n_led) = (mechanism.n_drives(), state.q.len());
        let (p, stride) = (self.n_judged(mechanism), mechanism.n_columns());
        // A distance without a pull needs no decomposition.
        let distance = self.bounds.robot.iter().zip(pull).find(|(b, _)| b.what == Bounded::Singularity);
        mechanism.is_distance_wanted = distance.is_some_and(|(_, pull)| pull.abs() > 0.0);
        let mut share = |state: &DriveState| {
            if !mechanism.look(state, &self.bounds, Direction::Smooth) {
                return f64::NAN;
            }
            let rows = &mechanism.rows;
            let columns: f64 = (0..n_act).map(|k| (0..p).map(|c| weight(k, c) * rows[k * stride + c]).sum::<f64>()).sum();
            columns + dot(pull, &mechanism.values)
        };
        let here = share(state);
        let mut out = Vec::with_capacity(3 * n_led);
        for order in 0..3 {
            for k in 0..n_led {
                let step = STEP * self.usual[k][order];
                let mut moved = state.clone();
                [&mut moved.q, &mut moved.v, &mut moved.a][order][k] += step;
                let slope = (share(&moved) - here) / step;
                out.push(if slope.is_finite() { slope } else { 0.0 });
            }
        }
        mechanism.is_distance_wanted = true;
        out
    }

    /// Barrier of the drives' own limits, its slope added to `out`.
    fn drives(&self, coefficients: &[Vec<f64>], stage: Stage, out: &mut [Vec<f64>]) -> Result<f64, Refused> {
        let per_sample = stage.barrier / self.fine.0.len() as f64;
        let mut sum = 0.0;
        for rows in &self.fine.0 {
            for (k, bounds) in self.bounds.drives.iter().enumerate() {
                for (row, b) in rows.iter().zip(bounds) {
                    let mut pull = 0.0;
                    sum += per_sample * push(b, dot(row, &coefficients[k]), per_sample, &mut pull)?;
                    out[k].iter_mut().zip(row).for_each(|(s, r)| *s += pull * r);
                }
            }
        }
        Ok(sum)
    }
}

/// The barrier `−ln(room)` to both ends; its slope times `weight` is added to `pull`.
fn push(b: &Bound, value: f64, weight: f64, pull: &mut f64) -> Result<f64, Refused> {
    let [down, up] = b.room(value);
    if !(down > 0.0 && up > 0.0) {
        return Err(Refused::Outside(b.clone(), value));
    }
    let half = b.half();
    if b.lower.is_finite() && (b.upper.is_finite() || down < 1.0) {
        *pull -= weight / (down * half);
    }
    if b.upper.is_finite() {
        *pull += weight / (up * half);
    }
    Ok(-math::ln(down) - math::ln(up))
}

/// Sizes of coefficients that bring a drive to its limits.
fn scales(basis: Basis, period_s: f64, bounds: &[Bound; 3]) -> Vec<f64> {
    let half = bounds[0].half();
    match basis {
        Basis::Spline { pieces } => vec![half; pieces],
        Basis::Fourier { harmonics } => {
            let mut out = vec![half];
            for k in 1..=harmonics {
                let w = 2.0 * core::f64::consts::PI * k as f64 / period_s;
                let size = (half * w).min(bounds[1].upper).min(bounds[2].upper / w);
                out.extend([size, size]);
            }
            out
        }
    }
}

/// The directions of two vectors, orthonormal; a zero vector has none.
fn orthonormal(vectors: [Vec<f64>; 2]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for mut v in vectors {
        for d in &out {
            let along = dot(d, &v);
            v.iter_mut().zip(d).for_each(|(x, d)| *x -= along * d);
        }
        let length = math::sqrt(dot(&v, &v));
        if length > 0.0 {
            v.iter_mut().for_each(|x| *x /= length);
            out.push(v);
        }
    }
    out
}
