//! Regressors of open chains, many samples at once.
//!
//! The recursion of [`pkm_dyn::regressor::joint_torque_regressor`] over eight samples side by side: every number is a row of eight, and
//! the processor's widest instructions work on whole rows. No sum is fused or reordered by that, so the bits are the same on every
//! processor. Through loops a sample needs the one before it; these robots go sample by sample.

#![allow(clippy::needless_range_loop, reason = "a lane is the same place in several rows; loops over it become one wide instruction")]

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::model::{JointKind, Part};
use pkm_dyn::parameters::N_INERTIAL;
use pkm_dyn::{Data, Model, math};

/// Samples side by side.
pub const LANES: usize = 8;

/// One number of each sample.
type Lanes = [f64; LANES];
/// A vector of each sample.
type Vector = [Lanes; 3];

const ZERO: Vector = [[0.0; LANES]; 3];

/// A joint and its body.
#[derive(Debug, Clone)]
struct Link {
    parent: Option<usize>,
    is_turning: bool,
    /// Rotation to the parent: `fixed + cos(q)·cosine + sin(q)·sine`.
    fixed: Matrix3<f64>,
    cosine: Matrix3<f64>,
    sine: Matrix3<f64>,
    /// Origin in the parent: `offset + q·slide` `[m]`.
    offset: Vector3<f64>,
    slide: Vector3<f64>,
    /// Unit axis in the body's own frame.
    axis: Vector3<f64>,
    /// Joints that move the body, its own last.
    path: Vec<usize>,
    /// Row of the regressor.
    row: usize,
}

/// Regressors of an open chain in blocks of [`LANES`] samples.
#[derive(Debug, Clone)]
pub struct Bulk {
    links: Vec<Link>,
    gravity: Vector3<f64>,
    motion: Vec<Body>,
    /// Unit motion of each joint at the origin of each body it moves, in its axes: linear, angular; `body·n + joint`.
    carried: Vec<[Vector; 2]>,
}

/// Motion of a body in its own axes.
#[derive(Debug, Clone, Copy)]
struct Body {
    omega: Vector,
    alpha: Vector,
    /// Acceleration of the origin less gravity.
    d: Vector,
}

/// Positions, velocities and accelerations of the drives, each row by row.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    /// Positions `[m | rad]`, `samples × drives`.
    pub q: &'a [f64],
    /// Velocities `[m/s | rad/s]`.
    pub v: &'a [f64],
    /// Accelerations `[m/s² | rad/s²]`.
    pub a: &'a [f64],
}

impl Bulk {
    /// For `model`, if it has no loops, no joint without a drive and none of several coordinates; none otherwise.
    #[must_use]
    pub fn of(model: &Model) -> Option<Self> {
        let n = model.nv();
        let is_simple = !model.is_constrained() && model.passive().is_empty() && model.joints.iter().all(|j| j.part == Part::Whole);
        let independent = Data::new(model).independent;
        if !is_simple || independent.len() != n || model.actuators != independent {
            return None;
        }
        let mut links: Vec<Link> = Vec::with_capacity(n);
        for (i, joint) in model.joints.iter().enumerate() {
            let (r, axis) = (&joint.placement.rotation, &joint.axis);
            let (is_turning, outer) = (joint.kind == JointKind::Revolute, axis * axis.transpose());
            let mut path = joint.parent.map_or(Vec::new(), |p| links[p].path.clone());
            path.push(i);
            links.push(Link {
                parent: joint.parent,
                is_turning,
                fixed: if is_turning { r * outer } else { *r },
                cosine: if is_turning { r * (Matrix3::identity() - outer) } else { Matrix3::zeros() },
                sine: if is_turning { r * axis.cross_matrix() } else { Matrix3::zeros() },
                offset: joint.placement.translation,
                slide: if is_turning { Vector3::zeros() } else { r * axis },
                axis: *axis,
                path,
                row: independent.iter().position(|&j| j == i)?,
            });
        }
        let rest = Body { omega: ZERO, alpha: ZERO, d: ZERO };
        Some(Self { links, gravity: model.gravity, motion: vec![rest; n], carried: vec![[ZERO; 2]; n * n] })
    }

    /// Length of one sample's regressor, drives times `10·bodies`.
    #[must_use]
    pub fn size(&self) -> usize {
        N_INERTIAL * self.links.len() * self.links.len()
    }

    /// The regressors of some samples, each `drives × 10·bodies` and row by row, handed to `each` in blocks of up to [`LANES`] samples: the
    /// first sample's number and the block.
    ///
    /// # Panics
    /// With motions that are not of equally many whole samples.
    pub fn blocks(&mut self, rows: Rows<'_>, mut each: impl FnMut(usize, &[f64])) {
        let (samples, size) = (self.samples(rows), self.size());
        let mut block = vec![0.0; LANES * size];
        for at in (0..samples).step_by(LANES) {
            let room = &mut block[..LANES.min(samples - at) * size];
            self.block(rows, at, room);
            each(at, room);
        }
    }

    /// The regressors of all samples into `out`, one after the other.
    ///
    /// # Panics
    /// As [`Bulk::blocks`], and with `out` of another length.
    pub fn write_all(&mut self, rows: Rows<'_>, out: &mut [f64]) {
        let size = self.size();
        assert_eq!(out.len(), self.samples(rows) * size, "one regressor per sample");
        out.chunks_mut(LANES * size).enumerate().for_each(|(k, room)| self.block(rows, k * LANES, room));
    }

    fn samples(&self, rows: Rows<'_>) -> usize {
        let n = self.links.len();
        assert!(rows.q.len().is_multiple_of(n) && rows.v.len() == rows.q.len() && rows.a.len() == rows.q.len(), "whole samples");
        rows.q.len() / n
    }

    /// The regressors of the samples from `at` on that there is room for.
    fn block(&mut self, rows: Rows<'_>, at: usize, room: &mut [f64]) {
        let filled = room.len() / self.size();
        pulp::Arch::new().dispatch(|| {
            self.place(rows, at, filled);
            self.write(room);
        });
    }

    /// Motion of all bodies, and of all joints as their bodies see them; lanes beyond `filled` repeat the last sample.
    #[inline(always)]
    fn place(&mut self, rows: Rows<'_>, at: usize, filled: usize) {
        let n = self.links.len();
        for (i, link) in self.links.iter().enumerate() {
            let lane = |of: &[f64]| -> Lanes { core::array::from_fn(|l| of[(at + l.min(filled - 1)) * n + link.row]) };
            let (q, v, a) = (lane(rows.q), lane(rows.v), lane(rows.a));
            let (rotation, origin) = link.pose(&q);
            let (omega, alpha, d) = match link.parent {
                Some(p) => {
                    let Body { omega, alpha, d, .. } = &self.motion[p];
                    let swirl = plus(&cross(alpha, &origin), &cross(omega, &cross(omega, &origin)));
                    (turn(&rotation, omega), turn(&rotation, alpha), turn(&rotation, &plus(d, &swirl)))
                }
                None => (ZERO, ZERO, turn(&rotation, &all(&-self.gravity))),
            };
            let (rate, gain) = (times(&link.axis, &v), times(&link.axis, &a));
            self.motion[i] = if link.is_turning {
                let omega = plus(&omega, &rate);
                Body { omega, alpha: plus(&alpha, &plus(&cross(&omega, &rate), &gain)), d }
            } else {
                let coriolis = cross(&omega, &rate);
                Body { omega, alpha, d: plus(&d, &plus(&plus(&coriolis, &coriolis), &gain)) }
            };
            for &j in &link.path[..link.path.len() - 1] {
                let Some(p) = link.parent else { continue };
                let [linear, angular] = &self.carried[p * n + j];
                let there = plus(linear, &cross(angular, &origin));
                self.carried[i * n + j] = [turn(&rotation, &there), turn(&rotation, angular)];
            }
            self.carried[i * n + i] = if link.is_turning { [ZERO, all(&link.axis)] } else { [all(&link.axis), ZERO] };
        }
    }

    /// The regressors of the samples that are placed; as many as there is room for.
    #[inline(always)]
    fn write(&self, out: &mut [f64]) {
        let (n, size) = (self.links.len(), self.size());
        out.fill(0.0);
        for (i, link) in self.links.iter().enumerate() {
            let force = force_columns(&self.motion[i]);
            for &j in &link.path {
                let values = power(&self.motion[i], &force, &self.carried[i * n + j]);
                let first = N_INERTIAL * (self.links[j].row * n + i);
                for (l, one) in out.chunks_exact_mut(size).enumerate() {
                    let entry = &mut one[first..first + N_INERTIAL];
                    entry.iter_mut().zip(&values).for_each(|(x, lanes)| *x = lanes[l]);
                }
            }
        }
    }
}

impl Link {
    #[inline(always)]
    fn pose(&self, q: &Lanes) -> ([Lanes; 9], Vector) {
        let mut origin = all(&self.offset);
        let mut rotation = [[0.0; LANES]; 9];
        let (mut s, mut c) = ([0.0; LANES], [1.0; LANES]);
        if self.is_turning {
            for l in 0..LANES {
                (s[l], c[l]) = math::sin_cos(q[l]);
            }
        } else {
            origin = plus(&origin, &times(&self.slide, q));
        }
        for (k, out) in rotation.iter_mut().enumerate() {
            let at = (k / 3, k % 3);
            let (f, g, h) = (self.fixed[at], self.cosine[at], self.sine[at]);
            for l in 0..LANES {
                out[l] = f + (c[l] * g + s[l] * h);
            }
        }
        (rotation, origin)
    }
}

/// Force of a body per unit of each first moment: `skew(alpha) + skew(omega)²`, row by row.
#[inline(always)]
fn force_columns(body: &Body) -> [Lanes; 9] {
    let ([x, y, z], [ax, ay, az]) = (&body.omega, &body.alpha);
    let mut out = [[0.0; LANES]; 9];
    for l in 0..LANES {
        let (x, y, z) = (x[l], y[l], z[l]);
        out[0][l] = -(y * y + z * z);
        out[1][l] = x * y - az[l];
        out[2][l] = x * z + ay[l];
        out[3][l] = x * y + az[l];
        out[4][l] = -(x * x + z * z);
        out[5][l] = y * z - ax[l];
        out[6][l] = x * z - ay[l];
        out[7][l] = y * z + ax[l];
        out[8][l] = -(x * x + y * y);
    }
    out
}

/// Power of the wrench per unit of each of a body's ten parameters on a motion of its origin.
#[inline(always)]
fn power(body: &Body, force: &[Lanes; 9], [linear, angular]: &[Vector; 2]) -> [Lanes; N_INERTIAL] {
    let first = plus(&turn(force, linear), &cross(&body.d, angular));
    let spun = cross(angular, &body.omega);
    let mut out = [[0.0; LANES]; N_INERTIAL];
    for l in 0..LANES {
        out[0][l] = body.d[0][l] * linear[0][l] + body.d[1][l] * linear[1][l] + body.d[2][l] * linear[2][l];
        for k in 0..3 {
            out[1 + k][l] = first[k][l];
        }
        let (a, w) = (body.alpha, body.omega);
        // The six columns of I·x, once for the angular acceleration, once for the gyroscopic moment.
        let sums = |i: usize, j: usize| a[i][l] * angular[j][l] + w[i][l] * spun[j][l];
        out[4][l] = sums(0, 0);
        out[5][l] = sums(1, 0) + sums(0, 1);
        out[6][l] = sums(1, 1);
        out[7][l] = sums(2, 0) + sums(0, 2);
        out[8][l] = sums(2, 1) + sums(1, 2);
        out[9][l] = sums(2, 2);
    }
    out
}

/// The transpose of a matrix, row by row, times a vector.
#[inline(always)]
fn turn(m: &[Lanes; 9], x: &Vector) -> Vector {
    let mut out = ZERO;
    for (k, out) in out.iter_mut().enumerate() {
        for l in 0..LANES {
            out[l] = m[k][l] * x[0][l] + m[3 + k][l] * x[1][l] + m[6 + k][l] * x[2][l];
        }
    }
    out
}

#[inline(always)]
fn cross(a: &Vector, b: &Vector) -> Vector {
    let mut out = ZERO;
    for l in 0..LANES {
        out[0][l] = a[1][l] * b[2][l] - a[2][l] * b[1][l];
        out[1][l] = a[2][l] * b[0][l] - a[0][l] * b[2][l];
        out[2][l] = a[0][l] * b[1][l] - a[1][l] * b[0][l];
    }
    out
}

#[inline(always)]
fn plus(a: &Vector, b: &Vector) -> Vector {
    let mut out = ZERO;
    for k in 0..3 {
        for l in 0..LANES {
            out[k][l] = a[k][l] + b[k][l];
        }
    }
    out
}

/// One vector, each sample's size of it.
#[inline(always)]
fn times(x: &Vector3<f64>, by: &Lanes) -> Vector {
    core::array::from_fn(|k| by.map(|b| x[k] * b))
}

/// One vector, the same in every sample.
#[inline(always)]
fn all(x: &Vector3<f64>) -> Vector {
    core::array::from_fn(|k| [x[k]; LANES])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use pkm_dyn::regressor::joint_torque_regressor;

    fn wave(i: usize, k: usize, size: f64) -> f64 {
        size * math::sin(0.37 * (i * (k + 2)) as f64 + k as f64)
    }

    fn model(name: &str) -> Model {
        let found = pkm_robots::find(name).unwrap();
        pkm_dyn::urdf::parse(found.toml, found.urdf, [found.toml_name, found.urdf_name]).unwrap().robot.model
    }

    /// The arm with a slide in it, crooked axes and frames, and a second branch.
    fn crooked() -> Model {
        let mut out = model("serial_arm");
        out.gravity = Vector3::new(1.0, -2.0, -9.0);
        for (i, joint) in out.joints.iter_mut().enumerate() {
            let turn = UnitQuaternion::from_euler_angles(0.3 * i as f64, 0.5, -0.2 * i as f64);
            joint.placement.rotation *= turn.to_rotation_matrix().matrix();
            joint.placement.translation += Vector3::new(0.1, -0.05 * i as f64, 0.2);
        }
        out.joints[2].kind = JointKind::Prismatic;
        out.joints[5].parent = Some(2);
        out
    }

    #[test]
    fn blocks_of_samples_are_the_samples_one_by_one() {
        for model in [model("serial_arm"), model("serial_arm7"), crooked()] {
            let n = model.nv();
            for samples in [1, LANES - 1, LANES, 3 * LANES + 5] {
                let all = |size: f64| (0..samples * n).map(|at| wave(at / n, at % n, size)).collect::<Vec<_>>();
                let (q, v, a) = (all(2.5), all(3.0), all(20.0));
                let rows = Rows { q: &q, v: &v, a: &a };
                let mut bulk = Bulk::of(&model).unwrap();
                let mut whole = vec![f64::NAN; samples * bulk.size()];
                bulk.write_all(rows, &mut whole);
                let mut pieces = Vec::new();
                bulk.blocks(rows, |at, block| {
                    assert_eq!(at * 10 * n * n, pieces.len());
                    pieces.extend_from_slice(block);
                });
                assert_eq!(whole, pieces, "samples = {samples}");
                let mut data = Data::new(&model);
                for i in 0..samples {
                    let of = |x: &[f64]| x[i * n..(i + 1) * n].to_vec();
                    let expected = joint_torque_regressor(&model, &mut data, &of(&q), &of(&v), &of(&a));
                    let size = expected.amax();
                    for j in 0..n {
                        for c in 0..10 * n {
                            let ours = whole[i * 10 * n * n + j * 10 * n + c];
                            assert!((ours - expected[(j, c)]).abs() < 1e-13 * size, "{} {samples} {i} {j} {c}: {ours}", model.name);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn robots_whose_samples_need_each_other_are_left_alone() {
        assert!(Bulk::of(&model("five_bar")).is_none() && Bulk::of(&model("prs3")).is_none());
    }
}
