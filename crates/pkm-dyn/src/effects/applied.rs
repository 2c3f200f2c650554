//! Effects with numbers at a place, and a robot that carries them.

use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::{Entry, JointState, Law, Parameter, PlaceKind, Site};
use crate::model::Model;

/// An effect of the catalogue at a place, with its parameters.
#[derive(Debug, Clone)]
pub struct Applied {
    /// Which effect.
    pub entry: &'static Entry,
    /// Index of joint, link or loop, as `site` says.
    pub place: usize,
    /// What `place` counts.
    pub site: Site,
    /// The second joint of a pair.
    pub other: Option<usize>,
    /// Parameters in the entry's order.
    pub values: Vec<f64>,
}

/// Why an effect cannot be put where a file wants it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// No such effect.
    #[error("effect {name:?} is not in the library (`pkm effects` lists them)")]
    Unknown {
        /// The name.
        name: String,
    },
    /// No such place, or one of the wrong kind.
    #[error("effect {effect}: {place:?} is not {wanted} of this robot ({there})")]
    Place {
        /// The effect.
        effect: &'static str,
        /// The place.
        place: String,
        /// What it should be.
        wanted: &'static str,
        /// Names that the robot has.
        there: String,
    },
    /// A parameter that is missing, unknown or out of range.
    #[error("effect {effect}: parameter {parameter:?} {problem}")]
    Parameter {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: String,
        /// What is wrong.
        problem: String,
    },
}

impl Applied {
    /// An effect at a joint, or at a link where the entry's place is one; numbers are not checked.
    #[must_use]
    pub fn at(entry: &'static Entry, place: usize, values: Vec<f64>) -> Self {
        Self { entry, place, site: entry.place.site(), other: None, values }
    }

    /// Looks everything up by name and checks every number. A pair of joints is named `first,second`.
    ///
    /// # Errors
    /// Unknown effect, place or parameter; a required parameter missing; a number not finite or outside its physical limits; numbers that
    /// contradict each other.
    pub fn try_new(model: &Model, effect: &str, place: &str, parameters: &[(String, f64)]) -> Result<Self, EffectError> {
        let entry = super::find(effect).ok_or_else(|| EffectError::Unknown { name: effect.to_string() })?;
        let (site, place, other) = find_place(model, entry, place)?;
        // First: a name that is mistyped is missing as well.
        if let Some((name, _)) = parameters.iter().find(|(name, _)| !entry.parameters.iter().any(|p| p.name == name)) {
            let known: Vec<&str> = entry.parameters.iter().map(|p| p.name).collect();
            return Err(bad(entry, name, alloc::format!("is unknown (has: {})", known.join(", "))));
        }
        let mut values = Vec::new();
        for p in entry.parameters {
            let value = parameters.iter().find(|(name, _)| name == p.name).map(|(_, v)| *v);
            if let Some(v) = value {
                check_number(entry, p, v)?;
            }
            values.push(value.or_else(|| default(p, site, entry)).ok_or_else(|| bad(entry, p.name, "is missing".to_string()))?);
        }
        check_together(entry, site, &values)?;
        Ok(Self { entry, place, site, other, values })
    }

    /// Name of the place, as the robot's files have it; of a pair, the first joint's.
    #[must_use]
    pub fn place_name<'m>(&self, model: &'m Model) -> &'m str {
        match self.site {
            Site::Joint => &model.joints[self.place].name,
            Site::Link => &model.links[self.place].name,
            Site::Loop => &model.loops[self.place].name,
            Site::Sensor => &model.sensors[self.place].name,
        }
    }

    /// Names of all places, as the robot's files have them: two for a pair.
    #[must_use]
    pub fn place_names<'m>(&self, model: &'m Model) -> Vec<&'m str> {
        let mut out = alloc::vec![self.place_name(model)];
        out.extend(self.other.map(|j| model.joints[j].name.as_str()));
        out
    }

    /// It acts at joint `j`.
    #[must_use]
    pub fn is_at_joint(&self, j: usize) -> bool {
        self.site == Site::Joint && self.place == j
    }
}

fn bad(entry: &Entry, parameter: &str, problem: String) -> EffectError {
    EffectError::Parameter { effect: entry.name, parameter: parameter.to_string(), problem }
}

fn check_number(entry: &Entry, p: &Parameter, v: f64) -> Result<(), EffectError> {
    let upper = p.unit.upper();
    if v.is_finite() && v >= p.lower && v <= upper {
        return Ok(());
    }
    let limit = match (p.lower.is_finite(), upper.is_finite()) {
        (true, true) => alloc::format!(" and {} to {upper}", p.lower),
        (true, false) => alloc::format!(" and >= {}", p.lower),
        (false, true) => alloc::format!(" and <= {upper}"),
        (false, false) => String::new(),
    };
    Err(bad(entry, p.name, alloc::format!("= {v} (must be finite{limit})")))
}

/// Components that a joint has no meaning for, and what they are there: its one direction is its coordinate's.
const AT_A_JOINT: [(&str, f64); 8] =
    [("nx", 1.0), ("ny", 0.0), ("nz", 0.0), ("fy", 0.0), ("fz", 0.0), ("mx", 0.0), ("my", 0.0), ("mz", 0.0)];

fn component_at_a_joint(name: &str, site: Site, entry: &Entry) -> Option<f64> {
    let is_either = site == Site::Joint && entry.place == PlaceKind::LinkOrJoint;
    AT_A_JOINT.iter().find(|(n, _)| is_either && *n == name).map(|(_, x)| *x)
}

fn default(p: &Parameter, site: Site, entry: &Entry) -> Option<f64> {
    component_at_a_joint(p.name, site, entry).or(p.default)
}

/// What no single number shows: components at a joint, a direction that is none, an end before the start.
fn check_together(entry: &Entry, site: Site, values: &[f64]) -> Result<(), EffectError> {
    let value = |name: &str| entry.parameters.iter().position(|p| p.name == name).map(|i| values[i]);
    for (p, v) in entry.parameters.iter().zip(values) {
        if let Some(only) = component_at_a_joint(p.name, site, entry)
            && (v - only).abs() > 0.0
        {
            return Err(bad(entry, p.name, alloc::format!("= {v} (at a joint it can only be {only}: the direction is the coordinate's)")));
        }
    }
    if let [Some(x), Some(y), Some(z)] = ["nx", "ny", "nz"].map(value)
        && x.abs() + y.abs() + z.abs() <= 0.0
    {
        return Err(bad(entry, "nz", "= 0 with nx and ny 0: that is no direction".to_string()));
    }
    if let (Some(start), Some(end)) = (value("start"), value("end"))
        && end <= start
    {
        return Err(bad(entry, "end", alloc::format!("= {end} s (must be after the start, {start} s)")));
    }
    Ok(())
}

/// Names that an error lists at most.
const MANY: usize = 12;

fn find_place(model: &Model, entry: &'static Entry, place: &str) -> Result<(Site, usize, Option<usize>), EffectError> {
    let joint = || model.joint_index(place).map(|j| (Site::Joint, j, None));
    let link = || model.link_index(place).map(|l| (Site::Link, l, None));
    let pair = || {
        let (first, second) = place.split_once(',')?;
        let [first, second] = [first, second].map(|name| model.joint_index(name.trim()));
        let (first, second) = (first?, second?);
        // The sum of a length and an angle means nothing.
        let can_be_added = first != second && model.joints[first].kind == model.joints[second].kind;
        can_be_added.then_some((Site::Joint, first, Some(second)))
    };
    // A passive joint has neither command nor reading.
    let driven = || joint().filter(|(_, j, _)| model.actuators.contains(j));
    // What hangs on a link that is fixed to another has the other's frame in the model: shifting it alone would tear it off.
    let carried = || link().filter(|&(_, l, _)| is_carried(model, l));
    let a_loop = || model.loops.iter().position(|l| l.name == place).map(|l| (Site::Loop, l, None));
    let sensor = || model.sensors.iter().position(|s| s.name == place).map(|s| (Site::Sensor, s, None));
    let (found, wanted) = match entry.place {
        PlaceKind::Joint if entry.law.is_of_a_drive() => (driven(), "a driven joint"),
        PlaceKind::Joint => (joint(), "a joint"),
        PlaceKind::PassiveJoint => (joint().filter(|(_, j, _)| !model.actuators.contains(j)), "a passive joint"),
        PlaceKind::JointPair => (pair(), "a pair FIRST,SECOND of joints of one kind"),
        PlaceKind::JointOrSensor => (driven().or_else(sensor), "a driven joint or sensor"),
        PlaceKind::Link => (link(), "a link"),
        PlaceKind::LinkOrJoint => (link().or_else(joint), "a link or joint"),
        PlaceKind::LinkOrLoop => (carried().or_else(a_loop), "a link that a joint moves, or a loop,"),
        PlaceKind::RootLink => (link().filter(|&(_, l, _)| model.links[l].body.is_none()), "the root link"),
    };
    found.ok_or_else(|| EffectError::Place { effect: entry.name, place: place.to_string(), wanted, there: there(model, entry) })
}

/// Names of the robot that a place of this kind may be among.
fn there(model: &Model, entry: &Entry) -> String {
    let joints = || model.joints.iter().map(|j| j.name.as_str());
    let links = || model.links.iter().map(|l| l.name.as_str());
    let driven = || model.actuators.iter().map(|&j| model.joints[j].name.as_str());
    let names: Vec<&str> = match entry.place {
        PlaceKind::Joint if entry.law.is_of_a_drive() => driven().collect(),
        PlaceKind::Joint | PlaceKind::JointPair => joints().collect(),
        PlaceKind::PassiveJoint => joints().filter(|name| !driven().any(|d| d == *name)).collect(),
        PlaceKind::JointOrSensor => driven().chain(model.sensors.iter().map(|s| s.name.as_str())).collect(),
        PlaceKind::Link | PlaceKind::RootLink => links().collect(),
        PlaceKind::LinkOrJoint => links().chain(joints()).collect(),
        PlaceKind::LinkOrLoop => links().chain(model.loops.iter().map(|l| l.name.as_str())).collect(),
    };
    match names.as_slice() {
        [] => "there is none".to_string(),
        // One line is enough, whatever the robot.
        [first @ .., _] if first.len() >= MANY => alloc::format!("there are: {}, ...", names[..MANY].join(", ")),
        _ => alloc::format!("there are: {}", names.join(", ")),
    }
}

/// Whether a joint carries the link: it is then the first of its body's.
fn is_carried(model: &Model, link: usize) -> bool {
    let body = model.links[link].body;
    body.is_some() && model.links.iter().position(|l| l.body == body) == Some(link)
}

/// A model with physics beyond rigid bodies. Effects on mass properties, geometry and gravity are already in the model.
#[derive(Debug, Clone)]
pub struct Robot {
    /// The rigid robot, changed inertias and gravity included.
    pub model: Model,
    /// Every effect, those already in the model included.
    pub effects: Vec<Applied>,
}

impl Robot {
    /// Puts `effects` on `model`.
    #[must_use]
    pub fn new(mut model: Model, effects: Vec<Applied>) -> Self {
        for e in &effects {
            match e.entry.law {
                Law::Inertia(apply) | Law::Gravity(apply) => apply(&mut model, e.place, &e.values),
                Law::Geometry(apply) => apply(&mut model, (e.site, e.place), &e.values),
                _ => {}
            }
        }
        Self { model, effects }
    }

    /// Effort at joint `j` beyond rigid bodies and rotor inertia: nominal friction and every joint effect `[N | N·m]`.
    ///
    /// Laws see the joint's nominal friction, whatever `state` says of it. Kinds of law other than [`Law::JointEffort`] are not in it.
    #[must_use]
    pub fn joint_effort(&self, j: usize, state: &JointState) -> f64 {
        let joint = &self.model.joints[j];
        let state = &JointState { viscous: joint.viscous, coulomb: joint.coulomb, ..*state };
        let mut sum = joint.viscous * state.v + joint.coulomb * state.sign;
        for e in &self.effects {
            if let Law::JointEffort(law) = e.entry.law
                && e.is_at_joint(j)
            {
                sum += law(&e.values, state);
            }
        }
        sum
    }

    /// One line for the first effect whose kind of law is not `known`: what a program says that cannot take it into account.
    #[must_use]
    pub fn left_aside(&self, known: impl Fn(&Law) -> bool) -> Option<String> {
        let effect = self.effects.iter().find(|e| !known(&e.entry.law))?;
        Some(alloc::format!("effect {} at {:?}", effect.entry.name, effect.place_names(&self.model).join(",")))
    }

    /// Parameter 0 of every effect at joint `j` whose law is chosen by `is`, in file order.
    pub fn chain<'r>(&'r self, j: usize, is: impl Fn(&Law) -> bool + 'r) -> impl Iterator<Item = f64> + 'r {
        self.effects.iter().filter(move |e| e.is_at_joint(j) && is(&e.entry.law)).map(|e| e.values[0])
    }
}
