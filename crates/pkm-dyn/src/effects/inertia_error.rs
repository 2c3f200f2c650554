//! Wrong inertial parameters of a link.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::model::Model;
use crate::parameters::InertialParameters;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "inertia_error",
    sentence: "the mass properties of the link differ from the model",
    equation: "the ten inertial parameters of the link take the stated values",
    parameters: &[
        Parameter { name: "mass", unit: Unit::Mass, lower: 0.0, default: Some(f64::NAN) },
        Parameter { name: "mx", unit: Unit::FirstMoment, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "my", unit: Unit::FirstMoment, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "mz", unit: Unit::FirstMoment, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "ixx", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "ixy", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "iyy", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "ixz", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "iyz", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
        Parameter { name: "izz", unit: Unit::InertiaRot, lower: f64::NEG_INFINITY, default: Some(f64::NAN) },
    ],
    place: PlaceKind::Link,
    look_alikes: &[
        LookAlike { effect: "payload", experiment: "weigh the link, or record with and without the load" },
        LookAlike { effect: "torque_constant", experiment: "add a known mass: its effect must come out at its true size" },
        LookAlike { effect: "rotor_inertia", experiment: "change posture: the link share of the inertia varies, the rotor share does not" },
    ],
    compensation: "load the refined robot file: its URDF has the new mass properties",
    energy: Energy::Stores,
    law: Law::Inertia(apply),
};

/// Stated parameters replace the link's; those not stated (NaN) stay.
fn apply(model: &mut Model, link: usize, p: &[f64]) {
    let mut theta = model.links[link].parameters.to_vector();
    for (old, new) in theta.iter_mut().zip(p) {
        if !new.is_nan() {
            *old = *new;
        }
    }
    model.set_link_parameters(link, InertialParameters::from_vector(&theta));
}
