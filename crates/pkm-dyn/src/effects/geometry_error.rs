//! A length or an anchor that is not where the model has it.

use nalgebra::Vector3;

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Site, Unit};
use crate::model::{Model, Part};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "geometry_error",
    sentence: "a length or an anchor is not where the model has it",
    equation: "the link's joint in the body before it, or the loop's frame b in its body, is shifted by (dx, dy, dz) along that body's axes",
    parameters: &[
        Parameter { name: "dx", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "dy", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "dz", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::LinkOrLoop,
    look_alikes: &[
        LookAlike { effect: "encoder_offset", experiment: "compare with a platform pose sensor" },
        LookAlike { effect: "encoder_eccentricity", experiment: "compare with a platform pose sensor over a whole turn" },
        LookAlike { effect: "inertia_error", experiment: "move slowly with gravity alone in several postures, or measure the length" },
    ],
    compensation: "correct the length in the robot's files: the kinematics of references change with it",
    energy: Energy::Neither,
    law: Law::Geometry(apply),
};

fn apply(model: &mut Model, (site, place): (Site, usize), p: &[f64]) {
    let shift = Vector3::new(p[0], p[1], p[2]);
    if site == Site::Loop {
        model.loops[place].b.pose.translation += shift;
        return;
    }
    let Some(mut joint) = model.links[place].body else { return };
    // Coordinates of one joint coincide; the first has the placement of all.
    while let (Part::Inner | Part::Last, Some(before)) = (model.joints[joint].part, model.joints[joint].parent) {
        joint = before;
    }
    model.joints[joint].placement.translation += shift;
}
