//! Forces in the joints: what closes a loop, and what the joints of the tree carry.
//!
//! Sign: `M·a + nle = tau + Jᵀ·lambda`. A loop's wrench is that of link a on link b; the joint of a body transmits the wrench of its
//! parent on it.

use nalgebra::Vector3;

use crate::data::Data;
use crate::kinematics::frame_pose;
use crate::loops::gap::moment_of_turn_efforts;
use crate::model::Model;
use crate::spatial::Force;

/// Wrench that the joint closing loop `l` exerts on the link of its frame b, about b's origin in a's axes `[N]`, `[N·m]`. Link a feels
/// the opposite at the same point.
///
/// From `data.lambda` ([`crate::inverse_dynamics::loop_efforts`], [`crate::constrained::forward_dynamics`]). Components along motions
/// the joint allows are zero; of redundant constraints the components that elimination left out are zero as well.
///
/// # Panics
/// When the model has no loop `l`.
#[must_use]
pub fn loop_wrench(model: &Model, data: &Data, l: usize) -> Force {
    let closure = &model.loops[l];
    let first = model.couplings.len() + model.loops[..l].iter().map(crate::model::LoopClosure::n_rows).sum::<usize>();
    let (mut linear, mut turn) = (Vector3::zeros(), Vector3::zeros());
    for (effort, k) in data.lambda[first..].iter().zip(closure.rows()) {
        if k < 3 {
            linear[k] = *effort;
        } else {
            turn[k - 3] = *effort;
        }
    }
    if !closure.forbids_turns() {
        return Force { linear, angular: Vector3::zeros() };
    }
    let (a, b) = (frame_pose(data, &closure.a), frame_pose(data, &closure.b));
    Force { linear, angular: moment_of_turn_efforts(&a, &b, &turn) }
}

/// Wrench each joint of the tree transmits to its body, loops closed, at the root's origin in the root's axes: `data.force_w` `[N]`,
/// `[N·m]`. What presses on bearings and guides, and so what load-dependent friction depends on.
///
/// Call once after [`crate::inverse_dynamics::loop_efforts`]: inverse dynamics leaves there the wrenches of the open tree.
#[doc(alias = "joint reaction")]
pub fn joint_wrenches<'d>(model: &Model, data: &'d mut Data) -> &'d [Force] {
    for (l, closure) in model.loops.iter().enumerate() {
        let (a, b) = (frame_pose(data, &closure.a), frame_pose(data, &closure.b));
        let local = loop_wrench(model, data, l);
        // About b's origin in a's axes, to the root's.
        let (linear, moment) = (a.rotation * local.linear, a.rotation * local.angular);
        let on_b = Force { linear, angular: moment + b.translation.cross(&linear) };
        for (end, sign) in [(closure.b.body, -1.0), (closure.a.body, 1.0)] {
            let mut at = end;
            while let Some(j) = at {
                data.force_w[j] += on_b * sign;
                at = model.joints[j].parent;
            }
        }
    }
    &data.force_w
}
