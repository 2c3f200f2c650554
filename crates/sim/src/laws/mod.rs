//! Other forms of common effects, on purpose not the catalogue's: a diagnosis that finds an effect must find it however nature writes it.
//!
//! A form is stated as an effect is, with the key `form`: `friction_stribeck@q1:form=lugre,stiffness=1e5,…`. All of them sit at a joint and
//! are efforts that its drive must supply in addition; numbers are SI. One form per file.

mod bouc_wen_cable;
mod eyring_damping;
mod gonthier;
mod hardening_elasticity;
mod impact_backlash;
mod jittered_delay;
mod lugre;
mod modulated_ripple;
mod roller_friction;
mod sloshing_payload;
mod stribeck_exponent;
mod stribeck_lorentzian;
mod tanh_asymmetric;
mod two_temperatures;

use core::fmt::Debug;

use pkm_dyn::effects::{JointState, Parameter, Unit};
use pkm_dyn::model::Model;

/// A law of a joint's effort that the catalogue does not have in this form.
pub trait ForeignLaw: Debug + Send {
    /// The joint it acts at.
    fn joint(&self) -> usize;

    /// Efforts in backward and in forward motion at `state.v` `[N | N·m]`; equal where the law is no set.
    fn levels(&self, state: &JointState) -> (f64, f64);

    /// Moves memories on by `h` `[s]`, during which the joint's state is `state`.
    fn advance(&mut self, state: &JointState, h: f64);
}

/// A form of an effect, before it has numbers.
#[derive(Debug, Clone, Copy)]
pub struct Form {
    /// Effects of the catalogue that it is a form of.
    pub effects: &'static [&'static str],
    /// Its name, as after `form=`.
    pub name: &'static str,
    /// Equation; `s` is the direction of motion.
    pub equation: &'static str,
    /// Parameters.
    pub parameters: &'static [Parameter],
    build: fn(usize, &[f64]) -> Box<dyn ForeignLaw>,
}

/// All forms.
pub const FORMS: &[&Form] = &[
    &lugre::FORM,
    &gonthier::FORM,
    &stribeck_exponent::FORM,
    &stribeck_lorentzian::FORM,
    &tanh_asymmetric::FORM,
    &eyring_damping::FORM,
    &roller_friction::FORM,
    &two_temperatures::FORM,
    &impact_backlash::FORM,
    &hardening_elasticity::FORM,
    &bouc_wen_cable::FORM,
    &sloshing_payload::FORM,
    &modulated_ripple::FORM,
    &jittered_delay::FORM,
];

/// Why a text states no form of an effect; one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LawError {
    /// Not `NAME@PLACE:…`.
    #[error("{text:?}: no @ (NAME@JOINT:form=FORM,PARAMETER=VALUE,...)")]
    Shape {
        /// The text.
        text: String,
    },
    /// No such form of the effect.
    #[error("effect {effect}: form {form:?} is unknown (has: {known})")]
    Form {
        /// The effect.
        effect: String,
        /// The form.
        form: String,
        /// Forms it has.
        known: String,
    },
    /// No such joint.
    #[error("effect {effect}: {place:?} is not a joint of this robot")]
    Place {
        /// The effect.
        effect: String,
        /// The place.
        place: String,
    },
    /// A number that is missing, none, unknown or out of range.
    #[error("effect {effect}, form {form}: parameter {parameter:?} {problem}")]
    Parameter {
        /// The effect.
        effect: String,
        /// The form.
        form: &'static str,
        /// The parameter.
        parameter: String,
        /// What is wrong.
        problem: String,
    },
}

/// The form that `text` states, `NAME@JOINT:form=FORM,PARAMETER=VALUE,...`; `None` when it states no form: then it is the catalogue's.
///
/// # Errors
/// A form that the effect does not have, no such joint, a parameter that is missing, unknown, twice or out of range.
pub fn parse(text: &str, model: &Model) -> Result<Option<Box<dyn ForeignLaw>>, LawError> {
    let (what, stated) = text.split_once(':').unwrap_or((text, ""));
    let pairs: Vec<(&str, &str)> = stated
        .split(',')
        .filter(|p| !p.trim().is_empty())
        .map(|p| p.split_once('=').map_or((p.trim(), ""), |(name, value)| (name.trim(), value.trim())))
        .collect();
    let Some((_, name)) = pairs.iter().find(|(key, _)| *key == "form") else { return Ok(None) };
    let (effect, place) = what.split_once('@').ok_or_else(|| LawError::Shape { text: text.to_string() })?;
    let of_effect = || FORMS.iter().filter(|f| f.effects.contains(&effect));
    let Some(form) = of_effect().find(|f| f.name == *name) else {
        let known = of_effect().map(|f| f.name).collect::<Vec<_>>().join(", ");
        let known = if known.is_empty() { "none".to_string() } else { known };
        return Err(LawError::Form { effect: effect.to_string(), form: (*name).to_string(), known });
    };
    let joint = model.joint_index(place).ok_or_else(|| LawError::Place { effect: effect.to_string(), place: place.to_string() })?;
    Ok(Some((form.build)(joint, &numbers(effect, form, &pairs)?)))
}

/// The form's parameters in its order.
fn numbers(effect: &str, form: &Form, pairs: &[(&str, &str)]) -> Result<Vec<f64>, LawError> {
    let bad = |parameter: &str, problem: String| LawError::Parameter {
        effect: effect.to_string(),
        form: form.name,
        parameter: parameter.to_string(),
        problem,
    };
    for (i, (name, _)) in pairs.iter().enumerate() {
        if pairs[..i].iter().any(|(before, _)| before == name) {
            return Err(bad(name, "is given twice".to_string()));
        }
        if *name != "form" && !form.parameters.iter().any(|p| p.name == *name) {
            let known: Vec<&str> = form.parameters.iter().map(|p| p.name).collect();
            return Err(bad(name, format!("is unknown (has: {})", known.join(", "))));
        }
    }
    let mut out = Vec::new();
    for p in form.parameters {
        let Some((_, text)) = pairs.iter().find(|(name, _)| *name == p.name) else {
            out.push(p.default.ok_or_else(|| bad(p.name, "is missing".to_string()))?);
            continue;
        };
        let value: f64 = text.parse().map_err(|_| bad(p.name, format!("= {text:?} is not a number")))?;
        let upper = p.unit.upper();
        if !(value.is_finite() && value >= p.lower && value <= upper) {
            return Err(bad(p.name, format!("= {value} (must be finite and {} to {upper})", p.lower)));
        }
        out.push(value);
    }
    Ok(out)
}

/// A parameter that must be stated.
const fn required(name: &'static str, unit: Unit, lower: f64) -> Parameter {
    Parameter { name, unit, lower, default: None }
}

/// A parameter that may be stated.
const fn optional(name: &'static str, unit: Unit, lower: f64, default: f64) -> Parameter {
    Parameter { name, unit, lower, default: Some(default) }
}

/// Levels of an effort that has a direction at rest: `effort(velocity, direction)`.
fn set(v: f64, effort: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    (effort(v.min(0.0), -1.0), effort(v.max(0.0), 1.0))
}

/// `x` after `h` `[s]` of dx/dt = a − b·x with constant a and b ≥ 0: exact, and steady however large b is.
fn relaxed(x: f64, (a, b): (f64, f64), h: f64) -> f64 {
    if b * h < 1e-9 {
        return x + (a - b * x) * h;
    }
    let end = a / b;
    end + (x - end) * pkm_dyn::math::exp(-b * h)
}

#[cfg(test)]
mod tests;
