//! `pkm effects`: the catalogue of physics that a diagnosis can name.

use std::process::ExitCode;

use anyhow::bail;
use clap::builder::PossibleValuesParser;
use pkm_dyn::effects::{CATALOGUE, Energy, Entry, Parameter, find};
use pkm_dyn::model::JointKind;
use serde_json::{Value, json};

use crate::out;

/// Arguments of `pkm effects`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pkm effects
  pkm effects friction_stribeck")]
pub(crate) struct Args {
    /// Show this entry in full, with what it is confused with.
    #[arg(value_parser = names(), hide_possible_values = true)]
    name: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The catalogue's names, for completion and for those who misspell one.
pub(crate) fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(CATALOGUE.iter().map(|e| e.name))
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let chosen: Vec<&Entry> = match &args.name {
        None => CATALOGUE.to_vec(),
        Some(name) => match find(name) {
            Some(entry) => vec![entry],
            None => bail!("{name}: no such effect (there are: {})", CATALOGUE.iter().map(|e| e.name).collect::<Vec<_>>().join(", ")),
        },
    };
    let text = match (args.json, &args.name) {
        (true, None) => serde_json::to_string_pretty(&chosen.iter().map(|e| as_json(e)).collect::<Vec<_>>())?,
        (true, Some(_)) => serde_json::to_string_pretty(&as_json(chosen[0]))?,
        (false, None) => listing(&chosen),
        (false, Some(_)) => in_full(chosen[0]),
    };
    out::say(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Unit of a parameter on sliders and on hinges.
fn unit(p: &Parameter) -> String {
    let [slider, hinge] = [JointKind::Prismatic, JointKind::Revolute].map(|kind| p.unit.text(kind));
    if slider == hinge { slider.to_string() } else { format!("{slider} or {hinge}") }
}

fn energy(energy: Energy) -> &'static str {
    match energy {
        Energy::Stores => "stores it and gives it back",
        Energy::Dissipates => "turns it into heat",
        Energy::Passive => "stores some and turns the rest into heat",
        Energy::Feeds => "brings it in from outside",
        Energy::Neither => "neither stores nor uses any",
    }
}

fn listing(entries: &[&Entry]) -> String {
    let mut out = Vec::new();
    for e in entries {
        let parameters: Vec<String> = e.parameters.iter().map(|p| format!("{} [{}]", p.name, unit(p))).collect();
        let mark = if is_looked_for(e) { "* " } else { "" };
        out.push(format!("{mark}{}: {}", e.name, e.sentence));
        out.push(format!("    {}", e.equation));
        out.push(format!("    {}", parameters.join(", ")));
    }
    let sought = entries.iter().filter(|e| is_looked_for(e)).count();
    out.push(format!("\n{} effects; `pkm effects NAME` shows one in full. s is the direction of motion, −1 to 1.", entries.len()));
    out.push(format!("* {sought} of them are looked for by `pkm diagnose`; the others can be simulated and stated in a robot's file."));
    out.join("\n")
}

fn in_full(e: &Entry) -> String {
    let mut out = vec![format!("{}: {}", e.name, e.sentence), String::new(), format!("  {}", e.equation), String::new()];
    out.push(format!("Sits at:      {}", e.place.words()));
    out.push(format!("Energy:       {}", energy(e.energy)));
    out.push(format!("Looked for:   {}", if is_looked_for(e) { "by `pkm diagnose`" } else { "no: simulated only" }));
    out.push(format!("Compensation: {}", e.compensation));
    out.push("Parameters:".to_string());
    let rows: Vec<Vec<String>> = e.parameters.iter().map(|p| vec![p.name.to_string(), unit(p), range(p)]).collect();
    out.push(out::table(&rows));
    if !e.look_alikes.is_empty() {
        out.push("Easily confused with:".to_string());
        for l in e.look_alikes {
            out.push(format!("  {}\n      told apart by: {}", l.effect, l.experiment));
        }
    }
    out.join("\n")
}

/// Whether a diagnosis can find it.
fn is_looked_for(e: &Entry) -> bool {
    pkm_diagnose::looked_for().contains(&e.name)
}

fn range(p: &Parameter) -> String {
    let upper = p.unit.upper();
    let lower = match (p.lower.is_finite(), upper.is_finite()) {
        (true, true) => format!("{} to {}", out::number(p.lower), out::number(upper)),
        (true, false) => format!(">= {}", out::number(p.lower)),
        (false, true) => format!("<= {}", out::number(upper)),
        (false, false) => "any sign".to_string(),
    };
    match p.default {
        Some(value) => format!("{lower}, {} unless stated", out::number(value)),
        None => format!("{lower}, required"),
    }
}

fn as_json(e: &Entry) -> Value {
    let parameter = |p: &Parameter| {
        json!({
            "name": p.name,
            "unit": p.unit.text(JointKind::Prismatic),
            "unit_revolute": p.unit.text(JointKind::Revolute),
            "lower": p.lower.is_finite().then_some(p.lower),
            "upper": p.unit.upper().is_finite().then_some(p.unit.upper()),
            "default": p.default,
        })
    };
    let look_alike = |l: &pkm_dyn::effects::LookAlike| json!({"effect": l.effect, "separating_experiment": l.experiment});
    json!({
        "effect": e.name,
        "says": e.sentence,
        "equation": e.equation,
        "parameters": e.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "where": e.place.words(),
        "energy": energy(e.energy),
        "looked_for": is_looked_for(e),
        "compensation": e.compensation,
        "look_alikes": e.look_alikes.iter().map(look_alike).collect::<Vec<_>>(),
    })
}
