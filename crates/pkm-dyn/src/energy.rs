//! Energy of the tree and its centre of mass.

use nalgebra::Vector3;

use crate::data::Data;
use crate::kinematics::{forward_kinematics, forward_velocities, joint_poses};
use crate::model::Model;

/// Kinetic energy of bodies and rotors at tree coordinates `q` `[m | rad]` and velocities `v` `[m/s | rad/s]` `[J]`.
#[doc(alias = "computeKineticEnergy")]
pub fn kinetic_energy(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) -> f64 {
    joint_poses(model, data, q);
    forward_velocities(model, data, v);
    let bodies = model.bodies.iter().zip(&data.velocity).map(|(body, velocity)| velocity.dot(&body.inertia().apply(velocity)));
    let rotors = model.joints.iter().zip(v).map(|(joint, v)| joint.armature * v * v);
    0.5 * (bodies.sum::<f64>() + rotors.sum::<f64>())
}

/// Potential energy of the bodies' weight at tree coordinates `q` `[m | rad]`, zero at the root's origin `[J]`.
#[doc(alias = "computePotentialEnergy")]
pub fn potential_energy(model: &Model, data: &mut Data, q: &[f64]) -> f64 {
    let (moment, _) = moment_and_mass(model, data, q);
    -model.gravity.dot(&moment)
}

/// Centre of mass of the moving bodies in the root frame `[m]`; the origin for a massless robot.
#[doc(alias = "centerOfMass")]
pub fn center_of_mass(model: &Model, data: &mut Data, q: &[f64]) -> Vector3<f64> {
    let (moment, mass) = moment_and_mass(model, data, q);
    if mass > 0.0 { moment / mass } else { moment }
}

fn moment_and_mass(model: &Model, data: &mut Data, q: &[f64]) -> (Vector3<f64>, f64) {
    forward_kinematics(model, data, q);
    let poses = model.bodies.iter().zip(&data.pose_wb);
    poses.fold((Vector3::zeros(), 0.0), |(moment, mass), (body, x)| {
        (moment + x.rotation * body.first_moment() + x.translation * body.mass, mass + body.mass)
    })
}
