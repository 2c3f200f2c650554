//! Closure error of every constraint row, its Jacobian and its drift.

use alloc::vec::Vec;

use nalgebra::{Matrix3, Vector3};

use crate::data::Data;
use crate::kinematics::{forward_kinematics, frame_point, frame_pose};
use crate::math;
use crate::model::{FrameOnBody, LoopClosure, Model};
use crate::spatial::{Motion, Pose, log3, skew};

/// The joints between the two ends of a loop, with the sign by which they move b against a. Joints that carry both ends move neither
/// against the other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Path {
    joints: Vec<(usize, f64)>,
    /// Whether the loop forbids the three translations and nothing else: the commonest loop of parallel robots, and the cheapest.
    is_ball: bool,
}

impl Path {
    pub(crate) fn of(model: &Model, closure: &LoopClosure) -> Self {
        let mut joints = Vec::new();
        for (end, other, sign) in [(closure.b.body, closure.a.body, 1.0), (closure.a.body, closure.b.body, -1.0)] {
            let mut at = end;
            while let Some(j) = at {
                if model.supports(j, other) {
                    break;
                }
                joints.push((j, sign));
                at = model.joints[j].parent;
            }
        }
        Self { joints, is_ball: closure.constrain == [true, true, true, false, false, false] }
    }
}

/// Closure error and its Jacobian at tree coordinates `q` `[m | rad]`: `data.loop_gap`, `data.loop_jacobian`.
///
/// Rows are the couplings, then each loop's forbidden motions of b relative to a, seen in a. Poses of `q` are left in `data`. The
/// Jacobian is with respect to velocities: for joints of one coordinate these are the rates of `q`.
pub fn loop_gap(model: &Model, data: &mut Data, q: &[f64]) {
    forward_kinematics(model, data, q);
    gap_rows(model, data, q);
    jacobian_rows(model, data);
}

/// `data.loop_gap` for the poses in `data`.
pub(crate) fn gap_rows(model: &Model, data: &mut Data, q: &[f64]) {
    let mut row = 0;
    for c in &model.couplings {
        data.loop_gap[row] = c.of.iter().fold(q[c.joint] - c.offset, |gap, &(j, ratio)| gap - ratio * q[j]);
        row += 1;
    }
    for (l, closure) in model.loops.iter().enumerate() {
        let a = frame_pose(data, &closure.a);
        if data.paths[l].is_ball {
            let b = frame_point(data, &closure.b);
            data.ends[l] = [a, Pose { rotation: a.rotation, translation: b }];
            let arm = a.rotation.tr_mul(&(b - a.translation));
            data.loop_gap[row..row + 3].copy_from_slice(arm.as_slice());
            row += 3;
            continue;
        }
        let b = frame_pose(data, &closure.b);
        data.ends[l] = [a, b];
        let arm = a.rotation.tr_mul(&(b.translation - a.translation));
        let turn = if closure.forbids_turns() { log3(&a.rotation.tr_mul(&b.rotation)) } else { Vector3::zeros() };
        for k in closure.rows() {
            data.loop_gap[row] = if k < 3 { arm[k] } else { turn[k - 3] };
            row += 1;
        }
    }
}

/// `data.loop_jacobian` for the poses in `data`, after [`gap_rows`]. Entries of joints that move no loop are zero from the start.
pub(crate) fn jacobian_rows(model: &Model, data: &mut Data) {
    for (row, c) in model.couplings.iter().enumerate() {
        data.loop_jacobian.row_mut(row).fill(0.0);
        data.loop_jacobian[(row, c.joint)] = 1.0;
        for &(j, ratio) in &c.of {
            data.loop_jacobian[(row, j)] -= ratio;
        }
    }
    let mut first = model.couplings.len();
    let rows = data.loop_jacobian.nrows();
    for ((closure, path), [a, b]) in model.loops.iter().zip(&data.paths).zip(&data.ends) {
        if path.is_ball {
            for &(j, sign) in &path.joints {
                let s = &data.axis_w[j];
                let p = a.rotation.tr_mul(&(s.linear + s.angular.cross(&b.translation))) * sign;
                let at = j * rows + first;
                data.loop_jacobian.as_mut_slice()[at..at + 3].copy_from_slice(p.as_slice());
            }
            first += 3;
            continue;
        }
        let to_a = a.rotation.transpose();
        let to_turn = closure.forbids_turns().then(|| left_jacobian_inverse(&log3(&(to_a * b.rotation))));
        for &(j, sign) in &path.joints {
            // Velocity, per unit of this joint, of the point at b's origin.
            let s = data.axis_w[j];
            let p = to_a * (s.linear + s.angular.cross(&b.translation)) * sign;
            let w = to_turn.map_or_else(Vector3::zeros, |t| t * (to_a * s.angular) * sign);
            for (row, k) in (first..).zip(closure.rows()) {
                data.loop_jacobian[(row, j)] = if k < 3 { p[k] } else { w[k - 3] };
            }
        }
        first += closure.n_rows();
    }
}

/// Second time derivative of the closure error at zero joint acceleration, `J̇·v` `[m/s² | rad/s²]`: `data.loop_drift`.
///
/// Call [`loop_gap`] and [`crate::kinematics::world_velocities`] first.
pub fn loop_drift(model: &Model, data: &mut Data) {
    let mut row = model.couplings.len();
    data.loop_drift[..row].fill(0.0);
    if model.loops.is_empty() {
        return;
    }
    for (i, joint) in model.joints.iter().enumerate() {
        let parent = joint.parent.map_or_else(Motion::zero, |p| data.acceleration_w[p]);
        data.acceleration_w[i] = parent + data.coriolis_w[i];
    }
    for (l, closure) in model.loops.iter().enumerate() {
        let (linear, angular) = relative_drift(data, closure, l);
        for k in closure.rows() {
            data.loop_drift[row] = if k < 3 { linear[k] } else { angular[k - 3] };
            row += 1;
        }
    }
}

fn relative_drift(data: &Data, closure: &LoopClosure, l: usize) -> (Vector3<f64>, Vector3<f64>) {
    let [a, b] = &data.ends[l];
    let (va, aa) = point_motion(data, &closure.a, &a.translation);
    let (vb, ab) = point_motion(data, &closure.b, &b.translation);
    let to_a = a.rotation.transpose();
    let d = b.translation - a.translation;
    let (wa, wb) = (va.angular, vb.angular);
    let relative = vb.linear - va.linear - wa.cross(&d);
    let linear = to_a * (ab.linear - aa.linear - aa.angular.cross(&d) - wa.cross(&wa.cross(&d)) - wa.cross(&relative) * 2.0);
    if !closure.forbids_turns() {
        return (linear, Vector3::zeros());
    }
    let turn = log3(&(to_a * b.rotation));
    let to_turn = left_jacobian_inverse(&turn);
    let w = to_a * (wb - wa);
    let w_dot = to_a * (ab.angular - aa.angular - wa.cross(&(wb - wa)));
    let turn_dot = to_turn * w;
    (linear, to_turn * w_dot + left_jacobian_inverse_rate(&turn, &turn_dot) * w)
}

/// Velocity of a frame's origin, which is at `p`, and its acceleration as a point, in the root's axes.
fn point_motion(data: &Data, frame: &FrameOnBody, p: &Vector3<f64>) -> (Motion, Motion) {
    let Some(body) = frame.body else { return (Motion::zero(), Motion::zero()) };
    let (v, a) = (data.velocity_w[body].at(p), data.acceleration_w[body].at(p));
    (v, Motion { linear: a.linear + v.angular.cross(&v.linear), angular: a.angular })
}

/// Wrench of a loop on its frame b, about b's origin in a's axes, per its rows' efforts: the moment that turns rotation-vector efforts
/// into a physical one.
pub(crate) fn moment_of_turn_efforts(a: &Pose, b: &Pose, efforts: &Vector3<f64>) -> Vector3<f64> {
    left_jacobian_inverse(&log3(&a.rotation.tr_mul(&b.rotation))).tr_mul(efforts)
}

/// `c(θ)` in `J⁻¹ = 1 − ½[φ]× + c·[φ]×²`, and `c'(θ)/θ`.
fn second_order_factor(angle: f64) -> (f64, f64) {
    let squared = angle * angle;
    if angle < 0.05 {
        // Series: the closed form loses all digits here. Truncation below 1e-13.
        let c = 1.0 / 12.0 + squared / 720.0 + squared * squared / 30_240.0;
        return (c, 1.0 / 360.0 + squared / 7560.0 + squared * squared / 201_600.0);
    }
    let (s, c) = math::sin_cos(angle);
    // cot(θ/2) = sin/(1 − cos): stays finite up to half a turn, where 1/sin does not.
    let cot = s / (1.0 - c);
    let factor = (1.0 - 0.5 * angle * cot) / squared;
    let cot_rate = -1.0 / (1.0 - c);
    let rate = (-0.5 * cot - 0.5 * angle * cot_rate) / squared - 2.0 * factor / angle;
    (factor, rate / angle)
}

/// Maps angular velocity (in the first frame) to the rate of the rotation vector `turn`.
fn left_jacobian_inverse(turn: &Vector3<f64>) -> Matrix3<f64> {
    let s = skew(turn);
    let (c, _) = second_order_factor(math::sqrt(turn.dot(turn)));
    Matrix3::identity() - s * 0.5 + s * s * c
}

fn left_jacobian_inverse_rate(turn: &Vector3<f64>, turn_dot: &Vector3<f64>) -> Matrix3<f64> {
    let (s, sd) = (skew(turn), skew(turn_dot));
    let (c, c_rate_over_angle) = second_order_factor(math::sqrt(turn.dot(turn)));
    let c_dot = c_rate_over_angle * turn.dot(turn_dot);
    sd * -0.5 + s * s * c_dot + (sd * s + s * sd) * c
}
