//! The identified robot: what the files had, with every estimated parameter in it.

use pkm_dyn::effects::{Applied, Law, Robot, find};
use pkm_dyn::urdf::{Description, refined_toml, refined_urdf};
use pkm_dyn::{Model, math};

use crate::answer::Identification;
use crate::columns::{Columns, ESTIMATED, Part, Quantity, is_friction_law};

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
    let is_kept = |e: &&Applied| !matches!(e.entry.law, Law::Gravity(_)) && !is_estimated(e);
    let mut effects: Vec<Applied> = robot.effects.iter().filter(is_kept).cloned().collect();
    put(&answer.columns, &answer.theta, &robot.effects, (&mut model, &mut effects));
    Identified { model, effects }
}

/// The robot with the parameters `theta` of its `columns`.
#[must_use]
pub fn with_parameters(robot: &Robot, columns: &Columns, theta: &[f64]) -> Robot {
    let mut model = robot.model.clone();
    let mut effects: Vec<Applied> = robot.effects.iter().filter(|e| !is_estimated(e)).cloned().collect();
    put(columns, theta, &robot.effects, (&mut model, &mut effects));
    Robot { model, effects }
}

fn is_estimated(e: &Applied) -> bool {
    ESTIMATED.contains(&e.entry.name) || is_friction_law(e)
}

/// Writes `theta` into a model and the list of its effects.
fn put(columns: &Columns, theta: &[f64], stated: &[Applied], (model, effects): (&mut Model, &mut Vec<Applied>)) {
    for (l, &link) in columns.links.iter().enumerate() {
        model.set_link_parameters(link, Columns::inertial(theta, l));
    }
    let mut springs = stated.iter().filter(|e| e.entry.name == "spring");
    let mut ripples = stated.iter().filter(|e| e.entry.name == "torque_ripple");
    let mut laws = columns.laws.clone();
    let mut sine = 0.0;
    for (p, &value) in columns.list.iter().zip(theta) {
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
                    let values = vec![value, spring.values[1], spring.values[2]];
                    effects.push(Applied { values, ..spring.clone() });
                }
            }
            Quantity::Law { law, value: k, .. } => laws[law].values[k] = value,
        }
    }
    effects.extend(laws);
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
