//! Extra mass on a link.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use nalgebra::{Matrix3, Vector3};

use crate::model::Model;
use crate::parameters::InertialParameters;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "payload",
    sentence: "an extra mass rides on the link",
    equation: "a rigid body of the given mass (and centre, inertia) added to the link",
    parameters: &[
        Parameter { name: "mass", unit: Unit::Mass, lower: 0.0, default: None },
        Parameter { name: "x", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "y", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "z", unit: Unit::Length, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "inertia", unit: Unit::InertiaRot, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::Link,
    look_alikes: &[
        LookAlike { effect: "inertia_error", experiment: "weigh the link, or record with and without the load" },
        LookAlike { effect: "torque_constant", experiment: "add a known mass: its effect must come out at its true size" },
        LookAlike { effect: "gravity_tilt", experiment: "record with the base level and tilted" },
    ],
    compensation: "load the refined robot file: gravity and inertia of the payload are then in the model",
    energy: Energy::Stores,
    law: Law::Inertia(apply),
};

/// The added body: a mass at (x, y, z) with a rotational inertia equal in all directions.
fn apply(model: &mut Model, link: usize, p: &[f64]) {
    let com = Vector3::new(p[1], p[2], p[3]);
    let body = InertialParameters::from_centre_of_mass(p[0], com, Matrix3::identity() * p[4]);
    let sum = model.links[link].parameters.joined(&body);
    model.set_link_parameters(link, sum);
}
