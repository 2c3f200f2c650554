//! Effects with numbers at a place, and a robot that carries them.

use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::{Entry, JointState, Law, PlaceKind, Site};
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
    #[error("effect {name:?} is not in the library")]
    Unknown {
        /// The name.
        name: String,
    },
    /// No such place, or one of the wrong kind.
    #[error("effect {effect}: {place:?} is not {wanted} of this robot")]
    Place {
        /// The effect.
        effect: &'static str,
        /// The place.
        place: String,
        /// What it should be.
        wanted: &'static str,
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
    /// Unknown effect, place or parameter; a required parameter missing; a number not finite or below its physical limit.
    pub fn try_new(model: &Model, effect: &str, place: &str, parameters: &[(String, f64)]) -> Result<Self, EffectError> {
        let entry = super::find(effect).ok_or_else(|| EffectError::Unknown { name: effect.to_string() })?;
        let (site, place, other) = find_place(model, entry, place)?;
        let bad =
            |parameter: &str, problem: String| EffectError::Parameter { effect: entry.name, parameter: parameter.to_string(), problem };
        let mut values = Vec::new();
        for p in entry.parameters {
            let value = parameters.iter().find(|(name, _)| name == p.name).map(|(_, v)| *v);
            if let Some(v) = value
                && !(v.is_finite() && v >= p.lower)
            {
                return Err(bad(p.name, alloc::format!("= {v} (must be finite and >= {})", p.lower)));
            }
            values.push(value.or(p.default).ok_or_else(|| bad(p.name, "is missing".to_string()))?);
        }
        if let Some((name, _)) = parameters.iter().find(|(name, _)| !entry.parameters.iter().any(|p| p.name == name)) {
            let known: Vec<&str> = entry.parameters.iter().map(|p| p.name).collect();
            return Err(bad(name, alloc::format!("is unknown (has: {})", known.join(", "))));
        }
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

fn find_place(model: &Model, entry: &'static Entry, place: &str) -> Result<(Site, usize, Option<usize>), EffectError> {
    let joint = || model.joint_index(place).map(|j| (Site::Joint, j, None));
    let link = || model.link_index(place).map(|l| (Site::Link, l, None));
    let pair = || {
        let (first, second) = place.split_once(',')?;
        let [first, second] = [first, second].map(|name| model.joint_index(name.trim()));
        let (first, second) = (first?, second?);
        (first != second).then_some((Site::Joint, first, Some(second)))
    };
    let a_loop = || model.loops.iter().position(|l| l.name == place).map(|l| (Site::Loop, l, None));
    let sensor = || model.sensors.iter().position(|s| s.name == place).map(|s| (Site::Sensor, s, None));
    let (found, wanted) = match entry.place {
        PlaceKind::Joint => (joint(), "a joint"),
        PlaceKind::PassiveJoint => (joint().filter(|(_, j, _)| !model.actuators.contains(j)), "a passive joint"),
        PlaceKind::JointPair => (pair(), "a pair FIRST,SECOND of joints"),
        PlaceKind::JointOrSensor => (joint().or_else(sensor), "a joint or sensor"),
        PlaceKind::Link => (link(), "a link"),
        PlaceKind::LinkOrJoint => (link().or_else(joint), "a link or joint"),
        PlaceKind::LinkOrLoop => (link().or_else(a_loop), "a link or loop"),
        PlaceKind::RootLink => (link().filter(|&(_, l, _)| model.links[l].body.is_none()), "the root link"),
    };
    found.ok_or_else(|| EffectError::Place { effect: entry.name, place: place.to_string(), wanted })
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
    #[must_use]
    pub fn joint_effort(&self, j: usize, state: &JointState) -> f64 {
        let joint = &self.model.joints[j];
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

    /// Parameter 0 of every effect at joint `j` whose law is chosen by `is`, in file order.
    pub fn chain<'r>(&'r self, j: usize, is: impl Fn(&Law) -> bool + 'r) -> impl Iterator<Item = f64> + 'r {
        self.effects.iter().filter(move |e| e.is_at_joint(j) && is(&e.entry.law)).map(|e| e.values[0])
    }
}
