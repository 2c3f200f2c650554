//! Inverse kinematics of closed-loop robots: all tree coordinates from prescribed ones, be they joints or coordinates of the output.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::DMatrix;

use crate::configuration::{difference as gone, integrate};
use crate::data::Data;
use crate::elimination::Elimination;
use crate::loops::gap::loop_gap;
use crate::loops::output::{Output, coordinates, output_jacobian};
use crate::math;
use crate::model::Model;

/// Loops and prescribed coordinates count as met below this error `[m | rad]`.
const MET: f64 = 1e-11;

/// Newton stops here: the next pose is near or it is not there.
const MAX_ITERATIONS: usize = 12;

/// A step is halved this often before it is given up.
const MAX_HALVINGS: u32 = 5;

/// The end of a step may differ from its tangent by this share of the step: more is another branch, or a fold.
const BEND: f64 = 0.5;

/// A tree coordinate moves no farther than this in one Newton jump `[m | rad]`.
const JUMP: f64 = 0.4;

/// A coordinate that is prescribed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinate {
    /// A joint of the tree, by index.
    Joint(usize),
    /// A coordinate of the output: x y z rx ry rz, by index.
    Output(usize),
}

/// Prescribed coordinates of one output, and room to solve for the others.
#[derive(Debug, Clone)]
pub struct Guide {
    output: Output,
    prescribed: Vec<Coordinate>,
    jacobian: DMatrix<f64>,
    elimination: Elimination,
    step: Vec<f64>,
    tangent: Vec<f64>,
    /// Pose and prescribed values at the start of the whole way, pose at the start of its present part, values at that part's end.
    start: Vec<f64>,
    from: Vec<f64>,
    before: Vec<f64>,
    target: Vec<f64>,
}

impl Guide {
    /// Room for prescribing `prescribed`, as many as the mechanism has freedoms.
    #[must_use]
    pub fn new(model: &Model, output: Output, prescribed: Vec<Coordinate>) -> Self {
        let (nv, rows, n) = (model.nv(), model.n_constraints(), prescribed.len());
        Self {
            output,
            prescribed,
            jacobian: DMatrix::zeros(6, nv),
            elimination: Elimination::new(rows + n, nv),
            step: vec![0.0; nv],
            tangent: vec![0.0; nv],
            start: vec![0.0; nv],
            from: vec![0.0; n],
            before: vec![0.0; nv],
            target: vec![0.0; n],
        }
    }

    /// The prescribed coordinates.
    #[must_use]
    pub fn prescribed(&self) -> &[Coordinate] {
        &self.prescribed
    }

    /// Values of the prescribed coordinates at the tree coordinates `q`, into `values` `[m | rad]`. Poses are left in `data`.
    pub fn values(&self, model: &Model, data: &mut Data, q: &[f64], values: &mut [f64]) {
        loop_gap(model, data, q);
        let pose = coordinates(&self.output.pose(data));
        for (value, &c) in values.iter_mut().zip(&self.prescribed) {
            *value = match c {
                Coordinate::Joint(j) => q[j],
                Coordinate::Output(k) => pose[k],
            };
        }
    }

    /// Moves from the closed pose `data.q` to the pose with the prescribed `values` on the same branch; whether it is there.
    ///
    /// On failure `data.q` is the pose it started from. A way that bends is gone in smaller parts: a Newton jump over a long way can
    /// land on another assembly of the same loops, and near a fold there is no pose to land on.
    #[must_use]
    pub fn move_to(&mut self, model: &Model, data: &mut Data, values: &[f64]) -> bool {
        self.start.copy_from_slice(&data.q);
        let mut from = core::mem::take(&mut self.from);
        let q = core::mem::take(&mut data.q);
        self.values(model, data, &q, &mut from);
        data.q = q;
        let (mut done, mut part) = (0.0, 1.0);
        let shortest = 1.0 / f64::from(1_u32 << MAX_HALVINGS);
        while done < 1.0 && part >= shortest {
            let share = f64::min(done + part, 1.0);
            for (i, &c) in self.prescribed.iter().enumerate() {
                self.target[i] = from[i] + share * difference(c, values[i], from[i]);
            }
            if self.newton(model, data) {
                done = share;
            } else {
                data.q.copy_from_slice(&self.before);
                part *= 0.5;
            }
        }
        self.from = from;
        let is_there = done >= 1.0;
        if !is_there {
            data.q.copy_from_slice(&self.start);
        }
        is_there
    }

    fn newton(&mut self, model: &Model, data: &mut Data) -> bool {
        self.before.copy_from_slice(&data.q);
        for iteration in 0..=MAX_ITERATIONS {
            let error = self.linearise(model, data);
            if error <= MET {
                return iteration == 0 || self.is_on_the_branch(model, &data.q);
            }
            if !error.is_finite() || self.elimination.rank() < data.q.len() {
                return false;
            }
            let (rows, target) = (data.loop_gap.len(), &self.target);
            let (prescribed, q, pose) = (&self.prescribed, &data.q, coordinates(&self.output.pose(data)));
            let residual = |i: usize| match i.checked_sub(rows) {
                None => -data.loop_gap[i],
                Some(k) => difference(prescribed[k], target[k], present(prescribed[k], q, &pose)),
            };
            self.elimination.solve(residual, &mut self.step);
            if iteration == 0 {
                self.tangent.copy_from_slice(&self.step);
                if largest(self.tangent.iter().copied()) > JUMP {
                    return false;
                }
            }
            integrate(model, &mut data.q, &self.step);
        }
        false
    }

    /// Factors loops and prescribed rows at `data.q`; the largest error of both `[m | rad]`.
    fn linearise(&mut self, model: &Model, data: &mut Data) -> f64 {
        let q = core::mem::take(&mut data.q);
        loop_gap(model, data, &q);
        data.q = q;
        output_jacobian(model, data, &self.output, &mut self.jacobian);
        let pose = coordinates(&self.output.pose(data));
        let rows = data.loop_gap.len();
        let (prescribed, jacobian, target) = (&self.prescribed, &self.jacobian, &self.target);
        self.elimination.factor(|i, j| match i.checked_sub(rows) {
            None => data.loop_jacobian[(i, j)],
            Some(k) => match prescribed[k] {
                Coordinate::Joint(of) => f64::from(u8::from(of == j)),
                Coordinate::Output(of) => jacobian[(of, j)],
            },
        });
        let errors = prescribed.iter().zip(target).map(|(&c, &t)| difference(c, t, present(c, &data.q, &pose)));
        largest(data.loop_gap.iter().copied().chain(errors))
    }

    /// Whether the way from `before` to `q` is the tangent's, more or less.
    fn is_on_the_branch(&mut self, model: &Model, q: &[f64]) -> bool {
        gone(model, &self.before, q, &mut self.step);
        let bend = largest(self.step.iter().zip(&self.tangent).map(|(way, t)| way - t));
        bend <= BEND * largest(self.tangent.iter().copied()) + 1e3 * MET
    }
}

fn present(c: Coordinate, q: &[f64], pose: &[f64; 6]) -> f64 {
    match c {
        Coordinate::Joint(j) => q[j],
        Coordinate::Output(k) => pose[k],
    }
}

/// `to - from`, angles of the output the short way round.
fn difference(c: Coordinate, to: f64, from: f64) -> f64 {
    let d = to - from;
    match c {
        Coordinate::Output(k) if k >= 3 => math::atan2(math::sin(d), math::cos(d)),
        _ => d,
    }
}

/// The largest size; NaN stays NaN.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |top, x| if x.abs() > top || x.is_nan() { x.abs() } else { top })
}
