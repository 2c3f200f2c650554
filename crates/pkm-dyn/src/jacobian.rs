//! Jacobians of joints, frames and the centre of mass, and their time derivatives.

use nalgebra::{Matrix3xX, Matrix6xX, Vector3};

use crate::data::Data;
use crate::kinematics::{forward_kinematics, frame_pose, frame_velocity, root_poses, world_velocities};
use crate::model::{FrameOnBody, Model, Part};
use crate::spatial::{Motion, Pose};

/// In which axes, and at which point, a frame's velocity is given; names and meaning are Pinocchio's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[doc(alias = "ReferenceFrame")]
pub enum Reference {
    /// At the root's origin in the root's axes.
    World,
    /// At the frame's origin in the frame's axes.
    Local,
    /// At the frame's origin in the root's axes.
    LocalWorldAligned,
}

/// Unit motions of all joints at the root's origin, 6 × nv, linear part first: `data.jacobian`. `q` `[m | rad]`, nv.
#[doc(alias = "computeJointJacobians")]
pub fn joint_jacobians<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d Matrix6xX<f64> {
    root_poses(model, data, q);
    for j in 0..model.nv() {
        put(&mut data.jacobian, j, &data.axis_w[j]);
    }
    &data.jacobian
}

/// Jacobian of a frame, `velocity = J·v`, 6 × nv, linear part first: `data.jacobian`. Call [`forward_kinematics`] first.
#[doc(alias = "getFrameJacobian")]
pub fn frame_jacobian<'d>(model: &Model, data: &'d mut Data, frame: &FrameOnBody, reference: Reference) -> &'d Matrix6xX<f64> {
    data.jacobian.fill(0.0);
    let x = frame_pose(data, frame);
    let mut at = frame.body;
    while let Some(j) = at {
        put(&mut data.jacobian, j, &seen(&data.axis_w[j], &x, reference));
        at = model.joints[j].parent;
    }
    &data.jacobian
}

/// Time derivative of [`frame_jacobian`], 6 × nv: `data.jacobian`. Call [`forward_kinematics`] and [`world_velocities`] first.
#[doc(alias = "getFrameJacobianTimeVariation")]
pub fn frame_jacobian_time_variation<'d>(
    model: &Model,
    data: &'d mut Data,
    frame: &FrameOnBody,
    reference: Reference,
) -> &'d Matrix6xX<f64> {
    data.jacobian.fill(0.0);
    let (x, velocity) = (frame_pose(data, frame), frame_velocity(data, frame));
    let mut at = frame.body;
    // A joint's axis turns with its body; of a joint with several coordinates, with the last of its bodies.
    let mut carrier = 0;
    while let Some(j) = at {
        let joint = &model.joints[j];
        if matches!(joint.part, Part::Whole | Part::Last) {
            carrier = j;
        }
        let axis = data.axis_w[j];
        let rate = data.velocity_w[carrier].cross(&axis);
        let column = match reference {
            Reference::World => rate,
            Reference::LocalWorldAligned => moved(&axis, &rate, &x, &velocity),
            Reference::Local => {
                let (here, rate) = (axis.at(&x.translation), moved(&axis, &rate, &x, &velocity));
                let w = velocity.angular;
                let turning = Motion { linear: rate.linear - w.cross(&here.linear), angular: rate.angular - w.cross(&here.angular) };
                turned(&turning, &x)
            }
        };
        put(&mut data.jacobian, j, &column);
        at = joint.parent;
    }
    &data.jacobian
}

/// Jacobian of the centre of mass, 3 × nv, written to `out`; the centre `[m]` and the mass `[kg]` are returned.
///
/// # Panics
/// When `out` has no nv columns.
#[doc(alias = "jacobianCenterOfMass")]
pub fn jacobian_center_of_mass(model: &Model, data: &mut Data, q: &[f64], out: &mut Matrix3xX<f64>) -> (Vector3<f64>, f64) {
    assert_eq!(out.ncols(), model.nv(), "one column per joint");
    forward_kinematics(model, data, q);
    crate::crba::inertias(model, data);
    let (mut mass, mut moment) = (0.0, Vector3::zeros());
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let carried = data.inertia_w[i];
        match joint.parent {
            Some(p) => data.inertia_w[p] += carried,
            None => {
                mass += carried.mass;
                moment += carried.first_moment;
            }
        }
        // Rate of the first moment of everything the joint carries.
        out.set_column(i, &carried.apply(&data.axis_w[i]).linear);
    }
    let per_mass = if mass > 0.0 { 1.0 / mass } else { 0.0 };
    *out *= per_mass;
    (moment * per_mass, mass)
}

/// Velocities of all bodies at the root's origin for tree positions and velocities: the start of [`frame_jacobian_time_variation`].
#[doc(alias = "computeJointJacobiansTimeVariation")]
pub fn motion_of(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) {
    forward_kinematics(model, data, q);
    world_velocities(model, data, v);
}

fn put(jacobian: &mut Matrix6xX<f64>, j: usize, m: &Motion) {
    for k in 0..3 {
        jacobian[(k, j)] = m.linear[k];
        jacobian[(3 + k, j)] = m.angular[k];
    }
}

fn turned(m: &Motion, x: &Pose) -> Motion {
    Motion { linear: x.rotation.tr_mul(&m.linear), angular: x.rotation.tr_mul(&m.angular) }
}

fn seen(axis: &Motion, x: &Pose, reference: Reference) -> Motion {
    match reference {
        Reference::World => *axis,
        Reference::LocalWorldAligned => axis.at(&x.translation),
        Reference::Local => turned(&axis.at(&x.translation), x),
    }
}

/// Rate of a unit motion at the moving origin of a frame.
fn moved(axis: &Motion, rate: &Motion, x: &Pose, velocity: &Motion) -> Motion {
    let here = rate.at(&x.translation);
    Motion { linear: here.linear + axis.angular.cross(&velocity.linear), angular: here.angular }
}
