//! `--hide NAME@PLACE:PARAMETER=VALUE,...` and other flags of this form: an effect of the catalogue, as robot files name it.

use anyhow::{Context, bail, ensure};
use pkm_dyn::effects::Applied;
use pkm_dyn::model::Model;

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
