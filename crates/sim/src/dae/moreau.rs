//! Steps in which something sticks, reverses or strikes: contact efforts and the end-of-step velocity are solved for together.

use nalgebra::{DMatrix, DVector};
use pkm_dyn::configuration::integrate;
use pkm_dyn::constrained::{project, reduced_mass_matrix};
use pkm_dyn::effects::JointState;
use pkm_dyn::loops::distribute;

use crate::dae::extension::Stop;
use crate::dae::system::{State, System};
use crate::dense::{cholesky, cholesky_solve};
use crate::plant::levels;
use crate::stick_slip::{Contact, is_solvable, solve};

/// Scratch of [`Moreau::step`].
#[derive(Debug)]
pub(crate) struct Moreau {
    /// One per resisting joint, then one per stop.
    contacts: Vec<Contact>,
    middle: State,
    mass: DMatrix<f64>,
    /// Factor of the mass with the implicit parts.
    factor: Vec<f64>,
    inverse: DMatrix<f64>,
    row: DVector<f64>,
    bias: Vec<f64>,
    before: Vec<f64>,
    after: DVector<f64>,
    /// Velocities of the whole tree at the middle of the step.
    tree: Vec<f64>,
}

/// What of the plant's modes a step reads and changes.
pub(crate) struct Modes<'m> {
    /// Resisting joints whose friction is a set at rest.
    pub(crate) rubs: &'m [bool],
    /// Those of them that stand still.
    pub(crate) sticks: &'m mut [bool],
    pub(crate) stops: &'m [Stop],
    /// Stops that are touched.
    pub(crate) touches: &'m mut [bool],
}

impl Moreau {
    pub(crate) fn new(system: &System, state: &State, n_stops: usize) -> Self {
        let (n, nv) = (system.data.n_ind(), state.q.len());
        Self {
            contacts: vec![Contact::new(n); system.resisting.len() + n_stops],
            middle: state.clone(),
            mass: DMatrix::zeros(n, n),
            factor: vec![0.0; n * n],
            inverse: DMatrix::zeros(n, n),
            row: DVector::zeros(n),
            bias: vec![0.0; n],
            before: vec![0.0; n],
            after: DVector::zeros(n),
            tree: vec![0.0; nv],
        }
    }

    /// Whether what the last step had to solve for were numbers.
    pub(crate) fn is_solvable(&self) -> bool {
        is_solvable(&self.contacts, &self.after)
    }

    /// Moves `state` on by `h` `[s]`. `None` where loops open, nothing has inertia, or numbers are none.
    ///
    /// Rigid dynamics once, in mid-step [Moreau1988]; springs, dampers and memories as the implicit midpoint rule has them, so that no
    /// stiffness limits the step.
    #[must_use]
    pub(crate) fn step(&mut self, system: &mut System, state: &mut State, push: &[f64], h: f64, modes: &mut Modes) -> Option<()> {
        self.find_middle(system, state, h)?;
        let n = self.before.len();
        for (k, &j) in system.data.independent.iter().enumerate() {
            self.before[k] = state.v[j];
        }
        expand(system, &self.before, &mut self.middle.v);
        for i in 0..state.z.len() {
            let j = system.memory_joint(i);
            // The memory in mid-step makes the effort there.
            self.middle.z[i] = system.memory_after(i, state.z[i], self.middle.v[j], 0.5 * h);
        }
        system.undirected_efforts(&self.middle, push);
        self.mass.copy_from(reduced_mass_matrix(&system.model, &mut system.data));
        for k in 0..n {
            self.bias[k] = system.data.reduction.column(k).iter().zip(&system.data.tau).map(|(g, t)| g * t).sum();
            for l in 0..n {
                self.factor[k * n + l] = self.mass[(k, l)];
            }
        }
        self.soften(system, state, h);
        self.resist(system, state, h, modes.rubs);
        self.stop(system, modes);
        let free = system.data.reduction.column_iter();
        for (k, column) in free.enumerate() {
            let pushed: f64 = column.iter().zip(&system.tau).map(|(g, t)| g * t).sum();
            self.after[k] = h * (pushed - self.bias[k]);
        }
        self.invert(n)?;
        cholesky_solve(&self.factor, self.after.as_mut_slice());
        self.after.iter_mut().zip(&self.before).for_each(|(v, before)| *v += before);
        if !self.is_solvable() {
            return None;
        }
        solve(&mut self.contacts, &self.inverse, h, &mut self.after);
        self.settle_modes(system, modes);
        self.finish(system, state, h)
    }

    /// Velocities after the impact of every touched stop that is approached; positions stay.
    #[must_use]
    pub(crate) fn strike(&mut self, system: &mut System, state: &mut State, modes: &mut Modes) -> Option<()> {
        system.bias(state)?;
        let n = self.before.len();
        self.mass.copy_from(reduced_mass_matrix(&system.model, &mut system.data));
        for k in 0..n {
            self.after[k] = state.v[system.data.independent[k]];
            for l in 0..n {
                self.factor[k * n + l] = self.mass[(k, l)];
            }
        }
        self.invert(n)?;
        for contact in &mut self.contacts {
            (contact.low, contact.high, contact.effort) = (0.0, 0.0, 0.0);
        }
        self.stop(system, modes);
        let first = system.resisting.len();
        for (contact, stop) in self.contacts[first..].iter_mut().zip(modes.stops) {
            let approach = contact.row.dot(&self.after);
            contact.effort = 0.0;
            contact.rest = if stop.side * approach > 0.0 { -stop.restitution * approach } else { 0.0 };
        }
        if !self.is_solvable() {
            return None;
        }
        solve(&mut self.contacts, &self.inverse, 1.0, &mut self.after);
        self.contacts.iter_mut().for_each(|c| (c.rest, c.effort) = (0.0, 0.0));
        expand(system, self.after.as_slice(), &mut state.v);
        Some(())
    }

    fn find_middle(&mut self, system: &mut System, state: &State, h: f64) -> Option<()> {
        let middle = &mut self.middle;
        middle.copy_from(state);
        middle.time += 0.5 * h;
        for (dq, v) in self.tree.iter_mut().zip(&state.v) {
            *dq = 0.5 * h * v;
        }
        integrate(&system.model, &mut middle.q, &self.tree);
        // The velocity in mid-step is needed for the velocity terms only; the last acceleration foretells it to second order.
        for (v, a) in middle.v.iter_mut().zip(&state.a) {
            *v += 0.5 * h * a;
        }
        if !project(&system.model, &mut system.data, &mut middle.q, &mut middle.v).is_closed {
            return None;
        }
        system.bias(middle)
    }

    /// Adds to the mass what springs, dampers and memories answer to the change of velocity.
    fn soften(&mut self, system: &System, state: &State, h: f64) {
        for s in &system.springs {
            let weight = 0.5 * h * (s.damping + 0.5 * h * s.stiffness);
            difference_row(system, s.plus, s.minus, &mut self.row);
            add_square(&mut self.factor, &self.row, weight);
        }
        for i in 0..state.z.len() {
            let j = system.memory_joint(i);
            let (_, slope) = system.memory_step(i, state.z[i], self.middle.v[j], h);
            difference_row(system, j, None, &mut self.row);
            add_square(&mut self.factor, &self.row, 0.5 * h * slope.max(0.0));
        }
    }

    /// Levels of the joints that rub; efforts of those that only resist.
    fn resist(&mut self, system: &mut System, state: &State, h: f64, rubs: &[bool]) {
        for (r, &rubs) in rubs.iter().enumerate() {
            let joint = system.resisting[r].joint;
            difference_row(system, joint, None, &mut self.row);
            let start = self.middle.v[joint];
            let contact = &mut self.contacts[r];
            contact.row.copy_from(&self.row);
            let at = system.joint_state(r, &self.middle, start, 0.0);
            if rubs {
                let ahead = start + 0.5 * h * state.a[joint];
                // Half a step ahead the velocity may have changed sign where it will in fact stop: stay on this side.
                let speed = if start * ahead > 0.0 { ahead } else { start };
                (contact.low, contact.high) = levels(speed, |v, sign| system.effort(r, &JointState { v, sign, ..at }));
                continue;
            }
            (contact.low, contact.high) = (0.0, 0.0);
            let of = |q: f64, v: f64| system.effort(r, &JointState { q, v, sign: pkm_dyn::math::sign(v), ..at });
            let effort = of(at.q, start);
            let (dq, dv) = (1e-7 * (1.0 + at.q.abs()), 1e-6 * (1.0 + start.abs()));
            let (stiffness, damping) = ((of(at.q + dq, start) - effort) / dq, (of(at.q, start + dv) - effort) / dv);
            system.tau[joint] -= effort;
            add_square(&mut self.factor, &self.row, 0.5 * h * (damping.max(0.0) + 0.5 * h * stiffness.max(0.0)));
        }
    }

    fn stop(&mut self, system: &System, modes: &Modes) {
        let first = system.resisting.len();
        for ((contact, stop), touches) in self.contacts[first..].iter_mut().zip(modes.stops).zip(modes.touches.iter()) {
            difference_row(system, stop.plus, stop.minus, &mut contact.row);
            (contact.low, contact.high) = match (touches, stop.side > 0.0) {
                (false, _) => (0.0, 0.0),
                (true, true) => (0.0, f64::INFINITY),
                (true, false) => (f64::NEG_INFINITY, 0.0),
            };
        }
    }

    fn invert(&mut self, n: usize) -> Option<()> {
        if !cholesky(&mut self.factor, n) {
            return None;
        }
        for (k, mut column) in self.inverse.column_iter_mut().enumerate() {
            column.fill(0.0);
            column[k] = 1.0;
            cholesky_solve(&self.factor, column.as_mut_slice());
        }
        Some(())
    }

    /// What sticks and what slides whither after the contacts are solved; an independent joint that sticks stands exactly still.
    fn settle_modes(&mut self, system: &mut System, modes: &mut Modes) {
        for (r, contact) in self.contacts[..system.resisting.len()].iter().enumerate() {
            if !modes.rubs[r] {
                continue;
            }
            let holds = contact.low < contact.effort && contact.effort < contact.high;
            modes.sticks[r] = holds;
            system.directions[r] = if holds {
                0.0
            } else if contact.low < contact.high {
                if contact.effort >= contact.high { 1.0 } else { -1.0 }
            } else {
                pkm_dyn::math::sign(contact.row.dot(&self.after))
            };
            let joint = system.resisting[r].joint;
            if holds && let Some(k) = system.data.independent.iter().position(|&j| j == joint) {
                self.after[k] = 0.0;
            }
        }
        let first = system.resisting.len();
        for ((contact, stop), touches) in self.contacts[first..].iter().zip(modes.stops).zip(modes.touches.iter_mut()) {
            // Without effort and on its way: it has come off.
            *touches &= contact.effort != 0.0 || stop.side * contact.row.dot(&self.after) >= 0.0;
        }
    }

    fn finish(&mut self, system: &mut System, state: &mut State, h: f64) -> Option<()> {
        expand(system, self.after.as_slice(), &mut self.tree);
        for i in 0..state.z.len() {
            let j = system.memory_joint(i);
            state.z[i] = system.memory_after(i, state.z[i], 0.5 * (self.middle.v[j] + self.tree[j]), h);
        }
        self.keep_loads(system, state, h);
        for ((a, v), before) in state.a.iter_mut().zip(&self.tree).zip(&self.middle.v) {
            *a = (v - before) / h;
        }
        state.q.copy_from_slice(&self.middle.q);
        state.v.copy_from_slice(&self.tree);
        self.tree.iter_mut().for_each(|v| *v *= 0.5 * h);
        integrate(&system.model, &mut state.q, &self.tree);
        state.time += h;
        project(&system.model, &mut system.data, &mut state.q, &mut state.v).is_closed.then_some(())
    }

    fn keep_loads(&mut self, system: &mut System, state: &mut State, h: f64) {
        let n = self.before.len();
        let data = &mut system.data;
        for k in 0..n {
            let moved: f64 = (0..n).map(|l| self.mass[(k, l)] * (self.after[l] - self.before[l]) / h).sum();
            data.tau_ind[k] = self.bias[k] + moved;
        }
        if system.model.n_act() > n {
            distribute(&system.model, data);
            system.model.actuators.iter().zip(&data.tau_act).for_each(|(&j, load)| state.load[j] = *load);
        } else {
            data.independent.iter().zip(&data.tau_ind).for_each(|(&j, load)| state.load[j] = *load);
        }
    }
}

/// Velocities of the tree for those of the independent coordinates, by the reduction in `data`.
pub(crate) fn expand(system: &System, v_ind: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (column, v) in system.data.reduction.column_iter().zip(v_ind) {
        out.iter_mut().zip(column.iter()).for_each(|(out, g)| *out += g * v);
    }
}

/// Rate of the difference of two joints per rate of each independent coordinate.
fn difference_row(system: &System, plus: usize, minus: Option<usize>, row: &mut DVector<f64>) {
    for (k, row) in row.iter_mut().enumerate() {
        *row = system.data.reduction[(plus, k)] - minus.map_or(0.0, |m| system.data.reduction[(m, k)]);
    }
}

fn add_square(matrix: &mut [f64], row: &DVector<f64>, weight: f64) {
    let n = row.len();
    for k in 0..n {
        for l in 0..n {
            matrix[k * n + l] += weight * row[k] * row[l];
        }
    }
}
