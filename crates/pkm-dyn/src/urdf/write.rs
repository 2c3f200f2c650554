//! Writing a changed robot: the texts of a robot.toml and a URDF that read back as that robot.

use super::read::Description;
use super::spec::{EffectSpec, Places};
use crate::effects::{Applied, Law};
use crate::model::Model;

/// The URDF with the mass properties of `model` and the nominal friction of its joints.
///
/// # Errors
/// The URDF library's reason, should it not be able to write what it has read.
pub fn refined_urdf(description: &Description, model: &Model) -> Result<String, String> {
    urdf_rs::write_to_string(&changed_urdf(description, model)).map_err(|e| e.to_string())
}

/// As [`refined_urdf`], before it is text.
pub(super) fn changed_urdf(description: &Description, model: &Model) -> urdf_rs::Robot {
    let mut urdf = description.urdf.clone();
    for link in &mut urdf.links {
        let Some(new) = model.link_index(&link.name).map(|l| model.links[l].parameters) else { continue };
        let old = description.bare.link_index(&link.name).map(|l| description.bare.links[l].parameters);
        if old == Some(new) {
            continue;
        }
        let (com, central) = new.centre_of_mass();
        link.inertial.origin.xyz.0 = com.into();
        link.inertial.origin.rpy.0 = [0.0; 3];
        link.inertial.mass.value = new.mass;
        let t = &mut link.inertial.inertia;
        (t.ixx, t.ixy, t.ixz) = (central[(0, 0)], central[(0, 1)], central[(0, 2)]);
        (t.iyy, t.iyz, t.izz) = (central[(1, 1)], central[(1, 2)], central[(2, 2)]);
    }
    for joint in &mut urdf.joints {
        let Some(j) = model.joint_index(&joint.name).map(|j| &model.joints[j]) else { continue };
        let has_friction = j.viscous > 0.0 || j.coulomb > 0.0 || joint.dynamics.is_some();
        if has_friction {
            let dynamics = joint.dynamics.get_or_insert_with(Default::default);
            (dynamics.damping, dynamics.friction) = (j.viscous, j.coulomb);
        }
    }
    urdf
}

/// robot.toml naming `urdf` and listing `effects`, with rotor inertias and gravity of `model`.
///
/// Effects on mass properties are expected to be in `model` (and so in the URDF) already and are left out of the list, payloads
/// excepted: a payload stays a payload.
///
/// # Errors
/// The TOML library's reason, should a number not be writable.
pub fn refined_toml(description: &Description, model: &Model, effects: &[Applied], urdf: &str) -> Result<String, String> {
    let mut spec = description.spec.clone();
    spec.urdf = urdf.to_string();
    spec.gravity = model.gravity.into();
    for a in &mut spec.actuators {
        if let Some(j) = model.joint_index(&a.joint) {
            a.rotor_inertia = model.joints[j].armature;
        }
    }
    spec.effects = effects
        .iter()
        .filter(|e| !matches!(e.entry.law, Law::Gravity(_)) && e.entry.name != "inertia_error")
        .map(|e| EffectSpec {
            name: e.entry.name.to_string(),
            places: Places::Many(e.place_names(model).into_iter().map(String::from).collect()),
            parameters: e.entry.parameters.iter().zip(&e.values).map(|(p, v)| (p.name.to_string(), *v)).collect(),
        })
        .collect();
    let text = toml::to_string_pretty(&spec).map_err(|e| e.to_string())?;
    Ok(format!("# {}: refined by pkm from recordings.\n{text}", spec.name))
}
