//! A force that depends on time and nothing else.

use super::{Energy, Entry, Law, LinkState, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

const fn component(name: &'static str, unit: Unit) -> Parameter {
    Parameter { name, unit, lower: f64::NEG_INFINITY, default: Some(0.0) }
}

/// How long the force takes to come and to go `[s]`: a jump would be none that a body of any mass can make, and no integrator likes one.
const FLANK: f64 = 0.01;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "external_force",
    sentence: "something pushes the robot for a while, whatever the robot does",
    equation: "−(fx … mz) from start to end, with half-cosine flanks of 10 ms inside; fx … mz: on the robot, at the link's origin, root frame; \
               at a joint fx alone, along its coordinate",
    parameters: &[
        Parameter { name: "start", unit: Unit::Second, lower: 0.0, default: None },
        Parameter { name: "end", unit: Unit::Second, lower: 0.0, default: None },
        component("fx", Unit::Effort),
        component("fy", Unit::Effort),
        component("fz", Unit::Effort),
        component("mx", Unit::Moment),
        component("my", Unit::Moment),
        component("mz", Unit::Moment),
    ],
    place: PlaceKind::LinkOrJoint,
    look_alikes: &[
        LookAlike { effect: "contact", experiment: "repeat the motion at another time of day: a contact comes back at its place" },
        LookAlike { effect: "active_limb", experiment: "record several periods: a single push is in one of them" },
        LookAlike { effect: "payload", experiment: "record once more: a load that stays is there from the start" },
    ],
    compensation: "detect it with a disturbance observer; nothing can be fed forward",
    energy: Energy::Feeds,
    law: Law::Wrench(wrench),
};

fn wrench(p: &[f64], s: &LinkState) -> [f64; 6] {
    let flank = FLANK.min(0.5 * (p[1] - p[0]));
    let inside = (s.time - p[0]).min(p[1] - s.time);
    if inside <= 0.0 {
        return [0.0; 6];
    }
    let share = (inside / flank).min(1.0);
    let height = 0.5 - 0.5 * math::cos(core::f64::consts::PI * share);
    core::array::from_fn(|i| -height * p[2 + i])
}
