//! Closure error of every constraint row, its Jacobian and its drift.

use nalgebra::{Matrix3, Vector3};

use crate::data::Data;
use crate::kinematics::forward_kinematics;
use crate::math;
use crate::model::{FrameOnBody, LoopClosure, Model};
use crate::spatial::{Pose, log3, skew};

/// Closure error and its Jacobian at tree coordinates `q` `[m | rad]`: `data.loop_gap`, `data.loop_jacobian`.
///
/// Rows are the couplings, then each loop's forbidden motions of b relative to a, seen in a. Poses of `q` are left in `data`.
pub fn loop_gap(model: &Model, data: &mut Data, q: &[f64]) {
    forward_kinematics(model, data, q);
    data.loop_jacobian.fill(0.0);
    let mut row = 0;
    for c in &model.couplings {
        let mut gap = q[c.joint] - c.offset;
        data.loop_jacobian[(row, c.joint)] = 1.0;
        for &(j, ratio) in &c.of {
            gap -= ratio * q[j];
            data.loop_jacobian[(row, j)] -= ratio;
        }
        data.loop_gap[row] = gap;
        row += 1;
    }
    for closure in &model.loops {
        row = loop_rows(model, data, closure, row);
    }
}

fn world(data: &Data, frame: &FrameOnBody) -> Pose {
    frame.body.map_or(frame.pose, |b| data.pose_wb[b].compose(&frame.pose))
}

fn loop_rows(model: &Model, data: &mut Data, closure: &LoopClosure, first: usize) -> usize {
    let (a, b) = (world(data, &closure.a), world(data, &closure.b));
    let to_a = a.rotation.transpose();
    let arm = to_a * (b.translation - a.translation);
    let turn = log3(&(to_a * b.rotation));
    let to_turn = left_jacobian_inverse(&turn);
    let mut row = first;
    for k in (0..6).filter(|&k| closure.constrain[k]) {
        data.loop_gap[row] = if k < 3 { arm[k] } else { turn[k - 3] };
        row += 1;
    }
    for (end, sign) in [(closure.b.body, 1.0), (closure.a.body, -1.0)] {
        let mut at = end;
        while let Some(j) = at {
            let x = &data.pose_wb[j];
            let s = model.joints[j].motion();
            let w = x.rotation * s.angular;
            // Velocity, per unit of this joint, of the point at b's origin.
            let p = x.rotation * s.linear + w.cross(&(b.translation - x.translation));
            let (p, w) = (to_a * p, to_turn * (to_a * w));
            for (i, k) in (0..6).filter(|&k| closure.constrain[k]).enumerate() {
                data.loop_jacobian[(first + i, j)] += sign * if k < 3 { p[k] } else { w[k - 3] };
            }
            at = model.joints[j].parent;
        }
    }
    row
}

/// Second time derivative of the closure error at zero joint acceleration, `J̇·v` `[m/s² | rad/s²]`: `data.loop_drift`.
///
/// Call [`loop_gap`] and [`crate::kinematics::forward_velocities`] first.
pub fn loop_drift(model: &Model, data: &mut Data) {
    let mut row = model.couplings.len();
    data.loop_drift[..row].fill(0.0);
    for closure in &model.loops {
        let (linear, angular) = relative_drift(data, closure);
        for k in (0..6).filter(|&k| closure.constrain[k]) {
            data.loop_drift[row] = if k < 3 { linear[k] } else { angular[k - 3] };
            row += 1;
        }
    }
}

/// Motion of a frame's origin in the root frame.
struct PointMotion {
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    w: Vector3<f64>,
    alpha: Vector3<f64>,
}

fn point_motion(data: &Data, frame: &FrameOnBody) -> PointMotion {
    let Some(b) = frame.body else {
        let zero = Vector3::zeros();
        return PointMotion { velocity: zero, acceleration: zero, w: zero, alpha: zero };
    };
    let (r, v, a, p) = (data.pose_wb[b].rotation, data.velocity[b], data.bias[b], frame.pose.translation);
    let arm = v.angular.cross(&p);
    PointMotion {
        velocity: r * (v.linear + arm),
        acceleration: r * (a.linear + v.angular.cross(&v.linear) + a.angular.cross(&p) + v.angular.cross(&arm)),
        w: r * v.angular,
        alpha: r * a.angular,
    }
}

fn relative_drift(data: &Data, closure: &LoopClosure) -> (Vector3<f64>, Vector3<f64>) {
    let (a, b) = (world(data, &closure.a), world(data, &closure.b));
    let (ma, mb) = (point_motion(data, &closure.a), point_motion(data, &closure.b));
    let to_a = a.rotation.transpose();
    let d = b.translation - a.translation;
    let relative = mb.velocity - ma.velocity - ma.w.cross(&d);
    let linear =
        to_a * (mb.acceleration - ma.acceleration - ma.alpha.cross(&d) - ma.w.cross(&ma.w.cross(&d)) - ma.w.cross(&relative) * 2.0);
    let turn = log3(&(to_a * b.rotation));
    let to_turn = left_jacobian_inverse(&turn);
    let w = to_a * (mb.w - ma.w);
    let w_dot = to_a * (mb.alpha - ma.alpha - ma.w.cross(&(mb.w - ma.w)));
    let turn_dot = to_turn * w;
    (linear, to_turn * w_dot + left_jacobian_inverse_rate(&turn, &turn_dot) * w)
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
