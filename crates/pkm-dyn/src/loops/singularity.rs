//! How near a pose is to the singularities of a closed-loop mechanism \[Gosselin1990\].
//!
//! Three different things can go wrong, and each has its own number:
//! parallel (type 2): with every drive locked the mechanism can still move; serial (type 1): the drives cannot move the output in some
//! direction; constraint: the constraints themselves lose a rank, and the mechanism gains a freedom whatever is driven \[Zlatanov2002\].

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::DMatrix;

use crate::data::Data;
use crate::elimination::RANK_TOLERANCE;
use crate::loops::gap::loop_gap;
use crate::loops::output::{Output, output_jacobian};
use crate::math;
use crate::model::{JointKind, Model};
use crate::svd::Svd;

/// Drives that move less than this share of their most are taken to stand still: below it lies rounding.
const STANDSTILL: f64 = 1e-14;

/// Distances from the singularities at one pose.
///
/// All numbers are made comparable by a length: metres are divided by it, so that singular values are pure numbers (rad per rad).
/// With a length of 1 m they are the values of the matrices in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Singularity {
    /// Type 2: the least motion of the drives for a unit motion of the output, the smallest singular value of `dq_act/dx`.
    pub parallel: f64,
    /// Type 1: the least motion of the output for a unit motion of the drives, the smallest singular value of `dx/dq_act`.
    pub serial: f64,
    /// Condition number of `dx/dq_act`; infinite at either singularity.
    pub condition: f64,
    /// Smallest singular value of the constraints with respect to the passive coordinates. Zero: locked drives do not hold the
    /// mechanism, even where the output stands still. Infinite without passive coordinates.
    pub passive: f64,
    /// Condition number of that matrix.
    pub passive_condition: f64,
    /// Smallest independent singular value of the constraints with respect to all coordinates. Infinite without constraints.
    pub constraint: f64,
    /// Sign of the determinant of `dx/dq_act`: it changes where a singularity is crossed. Zero where the matrix is not square.
    pub orientation: f64,
}

/// Room for computing a [`Singularity`], allocated once, and the directions found last.
#[derive(Debug, Clone)]
pub struct Singularities {
    output: Output,
    /// Components of the output that count, indices into x y z rx ry rz.
    components: Vec<usize>,
    length: f64,
    /// Unit of each tree coordinate: the length for travel, 1 for angles.
    unit: Vec<f64>,
    /// Unit of each constraint row.
    row_unit: Vec<f64>,
    passive: Vec<usize>,
    rank: usize,
    jacobian: DMatrix<f64>,
    of_constraints: Svd,
    of_passive: Svd,
    of_drives: Svd,
    of_output: Svd,
    /// Motion of the output by each of the drives' principal motions, per unit motion of the drives: freedoms × components.
    by_drives: Vec<f64>,
    square: Vec<f64>,
    direction: Vec<f64>,
}

impl Singularities {
    /// For an output of which only `components` (indices into x y z rx ry rz) count; metres are divided by `length` `[m]`.
    ///
    /// `q` is a closed pose away from constraint singularities: the number of independent constraints is counted there.
    ///
    /// # Panics
    /// With a component above 5 or a length that is not positive.
    #[must_use]
    pub fn new(model: &Model, data: &mut Data, q: &[f64], output: Output, components: &[usize], length: f64) -> Self {
        assert!(components.iter().all(|&c| c < 6), "a pose has six components");
        assert!(length > 0.0 && length.is_finite(), "a length is positive");
        let (nv, rows, n_act) = (model.nv(), model.n_constraints(), model.n_act());
        let passive = model.passive();
        let unit = model.joints.iter().map(|j| if j.kind == JointKind::Prismatic { length } else { 1.0 }).collect();
        let mut out = Self {
            output,
            components: components.to_vec(),
            length,
            unit,
            row_unit: row_units(model, length),
            rank: 0,
            jacobian: DMatrix::zeros(6, nv),
            of_constraints: Svd::new(rows, nv),
            of_passive: Svd::new(rows, passive.len()),
            of_drives: Svd::new(n_act, nv),
            of_output: Svd::new(nv, components.len()),
            by_drives: Vec::new(),
            square: Vec::new(),
            direction: vec![0.0; nv],
            passive,
        };
        loop_gap(model, data, q);
        out.factor_constraints(data);
        out.rank = out.of_constraints.rank(RANK_TOLERANCE);
        let freedoms = nv - out.rank;
        out.of_drives = Svd::new(n_act, freedoms);
        out.of_output = Svd::new(freedoms, components.len());
        out.by_drives = vec![0.0; freedoms * components.len()];
        out.square = vec![0.0; components.len() * components.len()];
        out
    }

    /// Degrees of freedom of the mechanism.
    #[must_use]
    pub fn freedoms(&self) -> usize {
        self.unit.len() - self.rank
    }

    /// The output.
    #[must_use]
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// Rates of the output's six coordinates per tree coordinate at the last pose, in SI units, 6 × nv.
    #[must_use]
    pub fn output_jacobian(&self) -> &DMatrix<f64> {
        &self.jacobian
    }

    /// The `k`-th motion that the constraints allow, in tree coordinates `[m | rad]` (orthogonal when metres are divided by the length).
    pub fn free_motion(&self, k: usize) -> impl Iterator<Item = f64> + '_ {
        self.of_constraints.right(self.rank + k).iter().zip(&self.unit).map(|(x, unit)| x * unit)
    }

    fn factor_constraints(&mut self, data: &Data) {
        let (unit, row_unit) = (&self.unit, &self.row_unit);
        self.of_constraints.factor(|i, j| data.loop_jacobian[(i, j)] * unit[j] / row_unit[i]);
    }

    /// Distances from the singularities at the closed pose `q` `[m | rad]`. The poses of the bodies are left in `data`.
    pub fn at(&mut self, model: &Model, data: &mut Data, q: &[f64]) -> Singularity {
        loop_gap(model, data, q);
        self.here(model, data)
    }

    /// As [`Singularities::at`], at the pose of the last [`loop_gap`].
    pub fn here(&mut self, model: &Model, data: &Data) -> Singularity {
        output_jacobian(model, data, &self.output, &mut self.jacobian);
        self.factor_constraints(data);
        let (unit, row_unit, passive) = (&self.unit, &self.row_unit, &self.passive);
        self.of_passive.factor(|i, j| data.loop_jacobian[(i, passive[j])] * unit[passive[j]] / row_unit[i]);
        let (rank, of_constraints) = (self.rank, &self.of_constraints);
        self.of_drives.factor(|i, k| of_constraints.right(rank + k)[model.actuators[i]]);
        self.move_output();
        let (components, by_drives) = (self.components.len(), &self.by_drives);
        self.of_output.factor(|k, o| by_drives[k * components + o]);
        let all = self.of_output.values();
        let largest = all.first().copied().unwrap_or(0.0);
        let serial = all[..components.min(self.freedoms())].last().copied().unwrap_or(0.0);
        let passive = self.of_passive.values().last().map(|&s| if self.passive.len() > self.row_unit.len() { 0.0 } else { s });
        Singularity {
            parallel: 1.0 / largest,
            serial,
            condition: if serial > 0.0 { largest / serial } else { f64::INFINITY },
            passive: passive.unwrap_or(f64::INFINITY),
            passive_condition: passive.map_or(1.0, |s| self.of_passive.values()[0] / s),
            constraint: if self.rank > 0 { self.of_constraints.values()[self.rank - 1] } else { f64::INFINITY },
            orientation: self.orientation(),
        }
    }

    /// `dx/dq_act` in the principal motions of the drives: with `N` the motions the constraints allow, `X·N` what they do to the output
    /// and `D·N = W·V'` what they do to the drives, `dx/dq_act = X·N·(D·N)⁺`; columns `X·N·v_k/s_k`. With more drives than freedoms the
    /// pseudo-inverse takes the drives' motions that the loops allow, and no others.
    fn move_output(&mut self) {
        let freedoms = self.freedoms();
        let largest = self.of_drives.values().first().copied().unwrap_or(0.0);
        for k in 0..freedoms {
            let mix = self.of_drives.right(k);
            for (j, d) in self.direction.iter_mut().enumerate() {
                *d = (0..freedoms).map(|f| self.of_constraints.right(self.rank + f)[j] * mix[f]).sum::<f64>() * self.unit[j];
            }
            let speed = self.of_drives.values()[k].max(STANDSTILL * largest).max(f64::MIN_POSITIVE);
            for (o, &c) in self.components.iter().enumerate() {
                let unit = if c < 3 { self.length } else { 1.0 };
                let moved: f64 = self.direction.iter().enumerate().map(|(j, d)| self.jacobian[(c, j)] * d).sum();
                self.by_drives[k * self.components.len() + o] = moved / (unit * speed);
            }
        }
    }

    fn orientation(&mut self) -> f64 {
        let n = self.components.len();
        if n == 0 || n != self.freedoms() || n != self.of_drives.image(0).len() {
            return 0.0;
        }
        for o in 0..n {
            for i in 0..n {
                let drive = |k: usize| self.of_drives.image(k)[i] / self.of_drives.values()[k];
                self.square[o * n + i] = (0..n).map(|k| self.by_drives[k * n + o] * drive(k)).sum();
            }
        }
        determinant_sign(&mut self.square, n)
    }

    /// Type 2: motion of the tree `[m | rad]` that the locked drives hold least, from the last pose, in passive coordinates alone.
    pub fn loosest_motion(&self, motion: &mut [f64]) {
        motion.fill(0.0);
        if let Some(last) = self.passive.len().checked_sub(1) {
            for (&j, x) in self.passive.iter().zip(self.of_passive.right(last)) {
                motion[j] = x * self.unit[j];
            }
        }
    }

    /// Type 2: motion of the output that the locked drives hold least, per component, of length one when metres are divided by the length.
    #[must_use]
    pub fn loosest_output(&self) -> &[f64] {
        self.of_output.right(0)
    }

    /// Type 1: direction of the output that the drives move least, per component, of length one when metres are divided by the length.
    #[must_use]
    pub fn stiffest_output(&self) -> &[f64] {
        self.of_output.right(self.components.len().min(self.freedoms()).saturating_sub(1))
    }

    /// Constraint: motion of the tree `[m | rad]` that the constraints oppose least though they should.
    pub fn weakest_constraint(&self, motion: &mut [f64]) {
        motion.fill(0.0);
        if self.rank > 0 {
            for ((m, x), unit) in motion.iter_mut().zip(self.of_constraints.right(self.rank - 1)).zip(&self.unit) {
                *m = x * unit;
            }
        }
    }
}

fn row_units(model: &Model, length: f64) -> Vec<f64> {
    let of_coupling = |kind| if kind == JointKind::Prismatic { length } else { 1.0 };
    let couplings = model.couplings.iter().map(|c| of_coupling(model.joints[c.joint].kind));
    let loops = model.loops.iter().flat_map(|l| (0..6).filter(|&k| l.constrain[k]).map(|k| if k < 3 { length } else { 1.0 }));
    couplings.chain(loops).collect()
}

/// Sign of the determinant by elimination with pivots from each column.
fn determinant_sign(a: &mut [f64], n: usize) -> f64 {
    let mut sign = 1.0;
    for k in 0..n {
        let best = (k..n).fold(k, |best, i| if a[i * n + k].abs() > a[best * n + k].abs() { i } else { best });
        if best != k {
            (0..n).for_each(|j| a.swap(k * n + j, best * n + j));
            sign = -sign;
        }
        let pivot = a[k * n + k];
        if pivot == 0.0 || pivot.is_nan() {
            return 0.0;
        }
        sign *= math::sign(pivot);
        for i in k + 1..n {
            let factor = a[i * n + k] / pivot;
            for j in k..n {
                a[i * n + j] -= factor * a[k * n + j];
            }
        }
    }
    sign
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_of_determinants() {
        assert_eq!(determinant_sign(&mut [0.0, 1.0, 1.0, 0.0], 2).to_bits(), (-1.0_f64).to_bits());
        assert_eq!(determinant_sign(&mut [2.0, 1.0, 0.0, 1.0, 3.0, 1.0, 0.0, 1.0, -4.0], 3).to_bits(), (-1.0_f64).to_bits());
        assert_eq!(determinant_sign(&mut [1.0, 2.0, 2.0, 4.0], 2).to_bits(), 0.0_f64.to_bits());
    }
}
