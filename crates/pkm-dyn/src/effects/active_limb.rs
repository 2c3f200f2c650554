//! A person who pushes as they please.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "active_limb",
    sentence: "a person pushes in a way that no repetition brings back",
    equation: "a random force of the stated rms at the link's origin",
    parameters: &[Parameter { name: "rms", unit: Unit::Effort, lower: 0.0, default: None }],
    place: PlaceKind::Link,
    look_alikes: &[
        LookAlike { effect: "limb_impedance", experiment: "repeat the same motion: a passive limb does the same every time" },
        LookAlike { effect: "external_force", experiment: "record several periods: a person pushes in all of them, each time otherwise" },
    ],
    compensation: "nothing can be fed forward: estimate the force and yield to it",
    energy: Energy::Feeds,
    law: Law::Person,
};
