//! The identified robot: what the files had, with every estimated parameter in it.

use pkm_dyn::effects::{Applied, Law, find};
use pkm_dyn::urdf::{Description, refined_toml, refined_urdf};
use pkm_dyn::{Model, math};

use crate::answer::Identification;
use crate::columns::{Columns, ESTIMATED, Part, Quantity};

/// A robot with identified parameters: mass properties, friction and rotors in its model, the rest as effects.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The model.
    pub model: Model,
    /// Offsets, springs, and the effects that were kept.
    pub effects: Vec<Applied>,
}

/// Puts the identified parameters into the robot of `description`, which must be the one that was identified.
#[must_use]
pub fn identified(description: &Description, answer: &Identification) -> Identified {
    let mut model = description.bare.clone();
    let robot = &description.robot;
    model.gravity = robot.model.gravity;
    let is_kept = |e: &&Applied| !matches!(e.entry.law, Law::Gravity(_)) && !ESTIMATED.contains(&e.entry.name);
    let mut effects: Vec<Applied> = robot.effects.iter().filter(is_kept).cloned().collect();
    for (l, &link) in answer.columns.links.iter().enumerate() {
        model.set_link_parameters(link, Columns::inertial(&answer.theta, l));
    }
    let mut springs = robot.effects.iter().filter(|e| e.entry.name == "spring");
    let mut ripples = robot.effects.iter().filter(|e| e.entry.name == "torque_ripple");
    let mut sine = 0.0;
    for (p, &value) in answer.columns.list.iter().zip(&answer.theta) {
        match p.quantity {
            Quantity::Inertial { .. } => {}
            Quantity::Rotor { joint } => model.joints[joint].armature = value,
            Quantity::Viscous { joint } => model.joints[joint].viscous = value,
            Quantity::Coulomb { joint } => model.joints[joint].coulomb = value,
            Quantity::Offset { joint } => {
                if let Some(entry) = find("torque_offset").filter(|_| value.abs() > 0.0) {
                    effects.push(Applied::at(entry, joint, vec![value]));
                }
            }
            Quantity::Wave { part: Part::Sine, .. } => sine = value,
            Quantity::Wave { part: Part::Cosine, .. } => {
                if let Some(ripple) = ripples.next() {
                    // A·sin(order·q + phase) = A·cos(phase)·sin(order·q) + A·sin(phase)·cos(order·q)
                    let values = vec![math::hypot(sine, value), ripple.values[1], math::atan2(value, sine)];
                    effects.push(Applied { values, ..ripple.clone() });
                }
            }
            Quantity::Stiffness { .. } => {
                if let Some(spring) = springs.next() {
                    let values = vec![value, spring.values[1]];
                    effects.push(Applied { values, ..spring.clone() });
                }
            }
        }
    }
    Identified { model, effects }
}

impl Identified {
    /// Texts of a robot.toml that names `urdf`, and of that URDF.
    ///
    /// # Errors
    /// The writing library's reason, should a number not be writable.
    pub fn texts(&self, description: &Description, urdf: &str) -> Result<[String; 2], String> {
        Ok([refined_toml(description, &self.model, &self.effects, urdf)?, refined_urdf(description, &self.model)?])
    }
}
