//! Implicit rules of two stages between events, for effects too stiff for the explicit one: Radau IIA and Gauss.
//!
//! Unknowns are the independent coordinates, their velocities and the memories; loops are closed at every evaluation. Newton's matrix is
//! by differences, once a step [Hairer1996, IV.8].

use pkm_dyn::configuration::integrate;
use pkm_dyn::constrained::project;

use crate::dae::moreau::expand;
use crate::dae::system::{State, System};
use crate::dense::{lu, lu_solve};

/// Newton stops when the step's unknowns change by less than this share of their size.
const SETTLED: f64 = 1e-12;

/// Changes of this share of the unknowns' size that no longer shrink are rounding.
const ROUNDING: f64 = 1e-8;

/// Newton steps before the step is given up; a converging one takes three to six.
const MAX_ITERATIONS: usize = 20;

/// A rule of two stages: nodes, matrix, and the step's end as a combination of the stages' increments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rule {
    nodes: [f64; 2],
    matrix: [[f64; 2]; 2],
    end: [f64; 2],
}

/// Order three, damps what is too fast for the step [Hairer1996, IV.5, table 5.5].
pub(crate) const RADAU: Rule = Rule { nodes: [1.0 / 3.0, 1.0], matrix: [[5.0 / 12.0, -1.0 / 12.0], [0.75, 0.25]], end: [0.0, 1.0] };

/// √3 / 6.
const ROOT: f64 = 0.288_675_134_594_812_9;

/// Order four, keeps energy [Hairer1996, IV.5, table 5.1].
pub(crate) const GAUSS: Rule =
    Rule { nodes: [0.5 - ROOT, 0.5 + ROOT], matrix: [[0.25, 0.25 - ROOT], [0.25 + ROOT, 0.25]], end: [-6.0 * ROOT, 6.0 * ROOT] };

/// Scratch of [`Implicit::step`].
#[derive(Debug)]
pub(crate) struct Implicit {
    stage: State,
    way: Vec<f64>,
    independent: Vec<usize>,
    /// Rates of the unknowns at the start, and of each stage.
    start: Vec<f64>,
    rates: [Vec<f64>; 2],
    moved: Vec<f64>,
    /// Derivatives of the rates by the unknowns, row by row.
    slopes: Vec<f64>,
    newton: Vec<f64>,
    order: Vec<usize>,
    /// Increments of both stages, and Newton's changes of them.
    increments: Vec<f64>,
    changes: Vec<f64>,
    scale: Vec<f64>,
}

/// How an implicit step ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ended {
    /// The state has moved on.
    Done,
    /// Newton did not converge: try a shorter step.
    TooLong,
}

impl Implicit {
    pub(crate) fn new(system: &System, state: &State) -> Self {
        let n = 2 * system.data.n_ind() + state.z.len();
        let (zero, both) = (vec![0.0; n], vec![0.0; 2 * n]);
        Self {
            stage: state.clone(),
            way: vec![0.0; state.q.len()],
            independent: system.data.independent.clone(),
            start: zero.clone(),
            rates: [zero.clone(), zero.clone()],
            moved: zero.clone(),
            slopes: vec![0.0; n * n],
            newton: vec![0.0; 4 * n * n],
            order: vec![0; 2 * n],
            increments: both.clone(),
            changes: both,
            scale: zero,
        }
    }

    /// Moves `state` on by `h` `[s]`. `None` where loops open at the start.
    #[must_use]
    pub(crate) fn step(&mut self, system: &mut System, state: &mut State, push: &[f64], (h, rule): (f64, &Rule)) -> Option<Ended> {
        let n = self.start.len();
        // Which coordinates are independent may change with the pose; within a step it must not.
        self.stage.copy_from(state);
        system.bias(&self.stage)?;
        self.independent.copy_from_slice(&system.data.independent);
        self.moved.fill(0.0);
        if self.rate(system, state, push, 0.0, 2).is_none() || !self.linearise(system, state, push, h) {
            return Some(Ended::TooLong);
        }
        for (x, increment) in self.increments.iter_mut().enumerate() {
            *increment = rule.nodes[x / n] * h * self.start[x % n];
        }
        self.set_newton(h, rule);
        if !lu(&mut self.newton, &mut self.order) || !self.iterate(system, state, push, h, rule) {
            return Some(Ended::TooLong);
        }
        for k in 0..n {
            self.moved[k] = rule.end[0] * self.increments[k] + rule.end[1] * self.increments[n + k];
        }
        Some(if self.place(system, state, h).is_some() { self.accept(state) } else { Ended::TooLong })
    }

    fn accept(&self, state: &mut State) -> Ended {
        state.copy_from(&self.stage);
        Ended::Done
    }

    fn iterate(&mut self, system: &mut System, state: &State, push: &[f64], h: f64, rule: &Rule) -> bool {
        let n = self.start.len();
        let mut before = f64::INFINITY;
        for _ in 0..MAX_ITERATIONS {
            for s in 0..2 {
                self.moved.copy_from_slice(&self.increments[s * n..(s + 1) * n]);
                if self.rate(system, state, push, rule.nodes[s] * h, s).is_none() {
                    return false;
                }
            }
            for k in 0..n {
                for s in 0..2 {
                    let wanted = h * (rule.matrix[s][0] * self.rates[0][k] + rule.matrix[s][1] * self.rates[1][k]);
                    self.changes[s * n + k] = wanted - self.increments[s * n + k];
                }
            }
            lu_solve(&self.newton, &self.order, &mut self.changes);
            let mut change = 0.0_f64;
            for (x, (increment, add)) in self.increments.iter_mut().zip(&self.changes).enumerate() {
                *increment += add;
                change = change.max(add.abs() / self.scale[x % n]);
            }
            if !change.is_finite() {
                return false;
            }
            if change <= SETTLED || (change < ROUNDING && change >= 0.5 * before) {
                return true;
            }
            before = change;
        }
        false
    }

    /// Rates of the unknowns where they have `moved` to, `after` `[s]` the start; into stage `s`, or the start's.
    fn rate(&mut self, system: &mut System, state: &State, push: &[f64], after: f64, s: usize) -> Option<()> {
        self.place(system, state, after)?;
        system.accelerate(&mut self.stage, push)?;
        let m = self.independent.len();
        let out = if s < 2 { &mut self.rates[s] } else { &mut self.start };
        for (k, &j) in self.independent.iter().enumerate() {
            out[k] = self.stage.v[j];
            out[m + k] = system.data.a[j];
        }
        out[2 * m..].copy_from_slice(&system.dz);
        // The choice was made for the start's pose; another one would mean other unknowns.
        (self.independent == system.data.independent).then_some(())
    }

    /// The whole tree where the unknowns have `moved` to.
    fn place(&mut self, system: &mut System, state: &State, after: f64) -> Option<()> {
        let (m, stage) = (self.independent.len(), &mut self.stage);
        // Dependent coordinates are foretold by the reduction; the loops then need a Newton step or two.
        expand(system, &self.moved[..m], &mut self.way);
        stage.q.copy_from_slice(&state.q);
        integrate(&system.model, &mut stage.q, &self.way);
        stage.v.copy_from_slice(&state.v);
        for (k, &j) in self.independent.iter().enumerate() {
            stage.v[j] += self.moved[m + k];
        }
        for (z, (start, moved)) in stage.z.iter_mut().zip(state.z.iter().zip(&self.moved[2 * m..])) {
            *z = start + moved;
        }
        stage.time = state.time + after;
        project(&system.model, &mut system.data, &mut stage.q, &mut stage.v).is_closed.then_some(())
    }

    fn linearise(&mut self, system: &mut System, state: &State, push: &[f64], h: f64) -> bool {
        let (n, m) = (self.start.len(), self.independent.len());
        for k in 0..n {
            let size = match k {
                _ if k < m => state.v[self.independent[k]].abs() * h + 1e-3,
                _ if k < 2 * m => state.v[self.independent[k - m]].abs() + 1e-2,
                _ => state.z[k - 2 * m].abs() + (h * self.start[k]).abs() + 1e-6,
            };
            self.scale[k] = size;
        }
        for k in 0..n {
            self.moved.fill(0.0);
            self.moved[k] = 1e-4 * self.scale[k];
            if self.rate(system, state, push, 0.0, 0).is_none() {
                return false;
            }
            for i in 0..n {
                self.slopes[i * n + k] = (self.rates[0][i] - self.start[i]) / self.moved[k];
            }
        }
        true
    }

    fn set_newton(&mut self, h: f64, rule: &Rule) {
        let n = self.start.len();
        for i in 0..2 * n {
            for j in 0..2 * n {
                let unit = f64::from(u8::from(i == j));
                self.newton[i * 2 * n + j] = unit - h * rule.matrix[i / n][j / n] * self.slopes[(i % n) * n + j % n];
            }
        }
    }
}
