//! Coordinates of the tree from poses of bodies, and efforts at coordinates as wrenches on bodies.

use core::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pkm_dyn::configuration::{difference, integrate};
use pkm_dyn::model::Model;
use pkm_dyn::spatial::{Force, Motion, Pose};

/// A correction of the coordinates below this `[m | rad]` leaves an error below rounding: Newton's error is its square.
const SETTLED: f64 = 1e-8;

/// Newton steps from the foretold coordinates.
const MAX_STEPS: usize = 4;

/// Coordinates of the tree at the last pose, and how they got there.
#[derive(Debug, Clone)]
pub(super) struct Coordinates {
    /// Now `[m | rad]`.
    pub(super) q: Vec<f64>,
    /// Mean over the last substep: the velocity in its middle `[m/s | rad/s]`.
    pub(super) v_middle: Vec<f64>,
    /// Acceleration between the middles of the last two substeps `[m/s² | rad/s²]`.
    pub(super) a: Vec<f64>,
    before: Vec<f64>,
    way: Vec<f64>,
}

impl Coordinates {
    pub(super) fn new(q: Vec<f64>) -> Self {
        let zero = vec![0.0; q.len()];
        Self { before: q.clone(), q, v_middle: zero.clone(), a: zero.clone(), way: zero }
    }

    /// Velocity now, `since` `[s]` after the middle of the last substep `[m/s | rad/s]`.
    pub(super) fn velocity(&self, j: usize, since: f64) -> f64 {
        self.v_middle[j] + since * self.a[j]
    }

    /// Follows the bodies over a substep of `h` `[s]`, `kick` `[s]` after the middle of the one before. `relative` is the pose of a chain's
    /// body in the body it starts from.
    pub(super) fn follow(&mut self, model: &Model, chains: &[Range<usize>], relative: impl Fn(usize) -> Pose, [h, kick]: [f64; 2]) {
        self.before.copy_from_slice(&self.q);
        for (way, (v, a)) in self.way.iter_mut().zip(self.v_middle.iter().zip(&self.a)) {
            *way = h * (v + kick * a);
        }
        integrate(model, &mut self.q, &self.way);
        for _ in 0..MAX_STEPS {
            let mut largest = 0.0_f64;
            for (c, joints) in chains.iter().enumerate() {
                let (x, columns) = pose_and_motions(model, joints, &self.q);
                let correction = coordinates_of(&columns, &way_to(&x, &relative(c)));
                for (way, dq) in self.way[joints.clone()].iter_mut().zip(&correction) {
                    *way = *dq;
                    largest = largest.max(dq.abs());
                }
            }
            integrate(model, &mut self.q, &self.way);
            if largest < SETTLED || !largest.is_finite() {
                break;
            }
        }
        difference(model, &self.before, &self.q, &mut self.way);
        for (way, (v, a)) in self.way.iter().zip(self.v_middle.iter_mut().zip(&mut self.a)) {
            let now = way / h;
            *a = (now - *v) / kick;
            *v = now;
        }
    }
}

/// Small motion, in the frame of the first, from one pose to another.
fn way_to(from: &Pose, to: &Pose) -> Motion {
    let turn = from.rotation.tr_mul(&to.rotation);
    let linear = from.rotation.tr_mul(&(to.translation - from.translation));
    Motion { linear, angular: axial(&turn) }
}

/// Rotation vector of a small turn `[rad]`, exact to third order.
pub(super) fn axial(r: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]) * 0.5
}

/// Pose of a chain's body in the body it starts from, and the body's motion per unit of each coordinate, in the body's frame.
pub(super) fn pose_and_motions(model: &Model, joints: &Range<usize>, q: &[f64]) -> (Pose, Vec<Motion>) {
    let mut x = Pose::identity();
    let mut columns = Vec::with_capacity(joints.len());
    for j in joints.clone().rev() {
        columns.push(x.motion_to_local(&model.joints[j].motion()));
        x = model.joints[j].pose(&q[j..]).compose(&x);
    }
    columns.reverse();
    (x, columns)
}

/// Coordinates whose motions add up to `motion`, in the least-squares sense: what fastenings are open by is no coordinate.
fn coordinates_of(columns: &[Motion], motion: &Motion) -> Vec<f64> {
    let along = |column: &Motion| column.linear.dot(&motion.linear) + column.angular.dot(&motion.angular);
    match columns {
        [one] => vec![along(one)],
        _ => solved(columns, &columns.iter().map(along).collect::<Vec<f64>>()),
    }
}

/// The smallest wrench on a chain's body, in its frame, that has the given efforts at the chain's coordinates; the fastenings add the rest.
pub(super) fn wrench_of(columns: &[Motion], efforts: &[f64]) -> Force {
    let weights = if columns.len() == 1 { efforts.to_vec() } else { solved(columns, efforts) };
    columns.iter().zip(&weights).fold(Force::zero(), |sum, (column, k)| sum + Force { linear: column.linear, angular: column.angular } * *k)
}

/// `(SᵀS)⁻¹·x`; zero where two motions have become one (a gimbal in lock).
fn solved(columns: &[Motion], x: &[f64]) -> Vec<f64> {
    let n = columns.len();
    let gram = DMatrix::from_fn(n, n, |i, k| columns[i].linear.dot(&columns[k].linear) + columns[i].angular.dot(&columns[k].angular));
    let solution = gram.cholesky().map(|factor| factor.solve(&DVector::from_column_slice(x)));
    solution.map_or_else(|| vec![0.0; n], |s| s.as_slice().to_vec())
}
