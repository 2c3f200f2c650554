//! `--hide NAME@PLACE:PARAMETER=VALUE,...` and other flags of this form: an effect of the catalogue, as robot files name it, or another
//! form of one (`form=`).

use anyhow::{Context, bail, ensure};
use pkm_dyn::effects::Applied;
use pkm_dyn::model::Model;
use pkm_sim::ForeignLaw;
use serde_json::{Value, json};

/// What is concealed in a robot.
#[derive(Debug, Default)]
pub(crate) struct Concealed {
    /// Effects of the catalogue.
    pub(crate) effects: Vec<Applied>,
    /// Other forms.
    pub(crate) laws: Vec<Box<dyn ForeignLaw>>,
    forms: Vec<Form>,
}

/// Another form as it was stated.
#[derive(Debug)]
struct Form {
    effect: String,
    place: String,
    name: String,
    parameters: Vec<(String, f64)>,
}

impl Concealed {
    /// The effects that `texts`, given to `flag`, state.
    ///
    /// # Errors
    /// Says what is wrong where in which text.
    pub(crate) fn parse(flag: &str, texts: &[String], model: &Model) -> anyhow::Result<Self> {
        let mut out = Self::default();
        for text in texts {
            let place = || format!("{flag} {text:?}");
            match pkm_sim::laws::parse(text, model).with_context(place)? {
                Some(law) => {
                    out.laws.push(law);
                    out.forms.push(form(text).with_context(place)?);
                }
                None => out.effects.push(parse(flag, text, model)?),
            }
        }
        Ok(out)
    }

    /// All of it as a sentence.
    pub(crate) fn describe(&self, model: &Model) -> String {
        let forms = self.forms.iter().map(|f| {
            let numbers: Vec<String> = f.parameters.iter().map(|(name, x)| format!("{name} = {x}")).collect();
            format!("{} at {} in the form {}: {}", f.effect, f.place, f.name, numbers.join(", "))
        });
        let known = (!self.effects.is_empty() || self.forms.is_empty()).then(|| pkm_sim::describe(&self.effects, model));
        known.into_iter().chain(forms).collect::<Vec<_>>().join("; ")
    }

    /// All of it for programs.
    pub(crate) fn as_json(&self, model: &Model) -> Vec<Value> {
        let effect = |e: &Applied| {
            let parameters: serde_json::Map<String, Value> =
                e.entry.parameters.iter().zip(&e.values).map(|(p, v)| (p.name.to_string(), json!(v))).collect();
            json!({"effect": e.entry.name, "where": e.place_names(model), "parameters": parameters})
        };
        let form = |f: &Form| {
            let parameters: serde_json::Map<String, Value> = f.parameters.iter().map(|(name, x)| (name.clone(), json!(x))).collect();
            json!({"effect": f.effect, "where": [f.place], "form": f.name, "parameters": parameters})
        };
        self.effects.iter().map(effect).chain(self.forms.iter().map(form)).collect()
    }
}

/// The parts of a text that states a form.
fn form(text: &str) -> anyhow::Result<Form> {
    let (what, stated) = text.split_once(':').unwrap_or((text, ""));
    let (effect, place) = what.split_once('@').context("no @")?;
    let is_form = |pair: &&str| pair.split_once('=').is_some_and(|(key, _)| key.trim() == "form");
    let name = stated.split(',').find(is_form).and_then(|pair| pair.split_once('=')).map_or("", |(_, name)| name.trim());
    let rest: Vec<&str> = stated.split(',').filter(|pair| !is_form(pair)).collect();
    Ok(Form { effect: effect.to_string(), place: place.to_string(), name: name.to_string(), parameters: numbers(&rest.join(","))? })
}

/// The effect that `text`, given to `flag`, states.
///
/// # Errors
/// Says what is wrong where in `text`.
pub(crate) fn parse(flag: &str, text: &str, model: &Model) -> anyhow::Result<Applied> {
    let place = || format!("{flag} {text:?}");
    let (what, stated) = text.split_once(':').unwrap_or((text, ""));
    let (name, at) = what.split_once('@').with_context(|| format!("{}: no @ (NAME@PLACE:PARAMETER=VALUE,...)", place()))?;
    Applied::try_new(model, name, at, &numbers(stated).with_context(place)?).with_context(place)
}

/// `name=number` pairs between commas.
///
/// # Errors
/// A pair without `=`, a number that is none, a name given twice.
pub(super) fn numbers(text: &str) -> anyhow::Result<Vec<(String, f64)>> {
    let mut out: Vec<(String, f64)> = Vec::new();
    for pair in text.split(',').map(str::trim).filter(|p| !p.is_empty()) {
        let Some((name, number)) = pair.split_once('=') else { bail!("{pair:?} is not NAME=VALUE") };
        let (name, number) = (name.trim(), number.trim());
        let value: f64 = number.parse().ok().with_context(|| format!("{name} = {number:?} is not a number"))?;
        ensure!(!out.iter().any(|(n, _)| n == name), "{name} is given twice");
        out.push((name.to_string(), value));
    }
    Ok(out)
}
