//! `pkm plan`: before any recording, what a motion could show of a robot, in what size, and what would be mistaken for what.

extern crate alloc;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

use alloc::collections::BTreeMap;
use anyhow::{anyhow, bail, ensure};
use clap::ValueEnum;
use pkm_diagnose::{Belief, Plan, PlanSettings, Required, Settings};
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_ident::excitation::{Basis, Criterion, Settings as Search, excite};
use pkm_record::ReadOptions;
use pkm_report::Style;

use crate::diagnosis::{input_error, positive};
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::simulate::hidden;
use crate::{check, excite as excitation, out, robot_file};

/// Samples per second of a motion that is found here: far above any band a robot's motion asks for.
const RATE_HZ: f64 = 200.0;

/// Arguments of `pkm plan`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Nothing is measured: the columns of every effect are computed along the motion from the robot file. What friction, offsets and inertias of \
the model can imitate is taken out of them; the angle between what is left of two effects says whether a recording could tell them apart, \
its length and the noise how large an effect must be. A reference is a file that `pkm excite` or `pkm simulate` wrote: q_ref.<joint>, or \
q.<joint> where there is no reference.

Exit status: 0 the plan was made, 1 with --require when a pair is not told apart, 2 bad usage or bad input.

Examples:
  pkm plan prs3 --reference motion.csv --noise 2
  pkm plan prs3 --reference motion.csv --noise-from A.csv \\
      --require friction_viscous@q6,time_delay@q6 --json plan.json
  pkm plan five_bar --excite angle --separate friction_viscous@shoulder_left:viscous=1 \\
      --separate friction_coulomb@shoulder_left:coulomb=1 --noise 0.05 --html plan.html")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// Motion (.csv or .mcap) to be recorded; may be given several times.
    #[arg(long = "reference", value_name = "FILE", required_unless_present = "excite", help_heading = "Motion")]
    references: Vec<PathBuf>,
    /// Find a motion first, good in this sense, with the defaults of `pkm excite`.
    #[arg(long, value_name = "CRITERION", conflicts_with = "references", help_heading = "Motion")]
    excite: Option<excitation::CriterionName>,
    /// With --excite angle or power: an effect to be told apart from another, NAME@PLACE:PARAMETER=VALUE,...; give two.
    #[arg(long, value_name = "EFFECT", requires = "excite", help_heading = "Motion")]
    separate: Vec<String>,
    /// With --excite: period.
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = positive, help_heading = "Motion")]
    period: f64,
    /// With --excite: harmonics.
    #[arg(long, value_name = "N", default_value_t = 5, help_heading = "Motion")]
    harmonics: usize,
    /// With --excite: seed.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Motion")]
    seed: u64,
    /// Noise of recorded efforts, standard deviation per sample, N or N·m: for all drives, or JOINT=VALUE; may be given several times.
    #[arg(long, value_name = "NOISE", required_unless_present = "noise_from", help_heading = "Decision")]
    noise: Vec<String>,
    /// Take the noise of recorded efforts from this recording.
    #[arg(long, value_name = "FILE", conflicts_with = "noise", help_heading = "Decision")]
    noise_from: Option<PathBuf>,
    /// How far the inertias of the model are believed: exact, within a tenth, or refitted.
    #[arg(long, value_name = "BELIEF", default_value = "soft", help_heading = "Decision")]
    prior: BeliefName,
    /// Compare efforts below this frequency only, Hz [default: chosen from the motion].
    #[arg(long, value_name = "HZ", value_parser = positive, help_heading = "Decision")]
    band: Option<f64>,
    /// Two effects that must be told apart, NAME,NAME or NAME@PLACE,NAME@PLACE; may be given several times.
    #[arg(long, value_name = "PAIR", help_heading = "Decision")]
    require: Vec<String>,
    /// Write the plan here; `-` prints it.
    #[arg(long, value_name = "OUT.json")]
    json: Option<PathBuf>,
    /// Write a page with pictures here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// A belief as a word on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum BeliefName {
    /// Inertias are exact: what changed on the same robot?
    Anchored,
    /// Inertias may be off by a tenth of their size.
    Soft,
    /// Inertias are refitted: is the structure wrong?
    Refit,
}

impl From<BeliefName> for Belief {
    fn from(name: BeliefName) -> Self {
        match name {
            BeliefName::Anchored => Self::Anchored,
            BeliefName::Soft => Self::Soft,
            BeliefName::Refit => Self::Refit,
        }
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    let model = &description.robot.model;
    check::must_assemble(model, &file)?;
    let pairs = args.require.iter().map(|p| pair(p)).collect::<anyhow::Result<Vec<_>>>()?;
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    let inputs: Vec<&Path> = args.references.iter().chain(&args.noise_from).chain([&args.robot, &urdf]).map(PathBuf::as_path).collect();
    let targets: Vec<PathBuf> = args.json.iter().chain(&args.html).cloned().collect();
    let mut outputs = Outputs::reserve(&targets, &inputs)?;
    let settings = PlanSettings {
        noise: noise(args, &description)?,
        belief: args.prior.into(),
        decision: Settings { band_hz: args.band, ..Settings::default() },
    };
    let references = references(args, &description)?;
    let mut progress = Progress::new("planning", args.quiet);
    let plan = pkm_diagnose::plan(&description, &references, &settings, &mut |share| progress.update(share));
    drop(progress);
    let plan = plan.map_err(|e| input_error(e, &file))?;
    let mut required = Vec::new();
    for ([a, b], text) in pairs.iter().zip(&args.require) {
        required.extend(plan.require(a, b).map_err(|e| anyhow!("--require {text}: {e}"))?);
    }
    if let Some(path) = &args.json {
        outputs.write(path, &json(&plan, &required)?)?;
    }
    if let Some(path) = &args.html {
        outputs.write(path, &pkm_report::plan_html(&plan, &required))?;
    }
    let is_told = !args.quiet && !outputs.takes_stdout();
    outputs.publish()?;
    if is_told {
        let style = if out::is_coloured() { Style::Colour } else { Style::Plain };
        out::say(pkm_report::plan_terminal(&plan, &required, style).trim_end())?;
    }
    Ok(ExitCode::from(u8::from(required.iter().any(|r| !r.ok))))
}

/// The two effects of a `--require`.
fn pair(text: &str) -> anyhow::Result<[String; 2]> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    match parts.as_slice() {
        [a, b] if !a.is_empty() && !b.is_empty() && a != b => Ok([a, b].map(|x| (*x).to_string())),
        _ => bail!("--require {text:?}: must be two different effects, NAME,NAME or NAME@PLACE,NAME@PLACE"),
    }
}

/// Noise of every drive.
fn noise(args: &Args, description: &Description) -> anyhow::Result<BTreeMap<String, f64>> {
    if let Some(path) = &args.noise_from {
        let recording = pkm_record::read(path, &ReadOptions::default())?;
        let found = pkm_diagnose::recorded_noise(&description.robot, &recording)?;
        if let Some((joint, _)) = found.iter().find(|(_, s)| **s <= 0.0) {
            bail!("{}: tau.{joint} has no noise at all: state it with --noise", path.display());
        }
        return Ok(found);
    }
    let model = &description.robot.model;
    let names = || model.actuators.iter().map(|&j| model.joints[j].name.clone());
    let mut out = BTreeMap::new();
    for text in &args.noise {
        let (joint, value) = text.split_once('=').map_or((None, text.as_str()), |(j, v)| (Some(j.trim()), v));
        let value = positive(value.trim()).map_err(|e| anyhow!("--noise {text}: {e}"))?;
        match joint {
            None => names().for_each(|n| {
                out.entry(n).or_insert(value);
            }),
            Some(j) => {
                ensure!(
                    names().any(|n| n == j),
                    "--noise {text}: no driven joint {j:?} (there are: {})",
                    names().collect::<Vec<_>>().join(", ")
                );
                out.insert(j.to_string(), value);
            }
        }
    }
    if let Some(joint) = names().find(|n| !out.contains_key(n)) {
        bail!("--noise: none stated for joint {joint} (give one number for all, or {joint}=VALUE)");
    }
    Ok(out)
}

/// Motions from files, or one that is found.
fn references(args: &Args, description: &Description) -> anyhow::Result<Vec<Recording>> {
    let Some(criterion) = args.excite else {
        return args.references.iter().map(|path| Ok(pkm_record::read(path, &ReadOptions::default())?)).collect();
    };
    let model = &description.robot.model;
    let effects = args.separate.iter().map(|e| hidden::parse("--separate", e, model)).collect::<anyhow::Result<Vec<_>>>()?;
    let wanted: usize = if criterion.criterion().separates() { 2 } else { 0 };
    ensure!(effects.len() == wanted, "--separate: {} effects (--excite {} takes {wanted})", effects.len(), criterion.criterion().name());
    let search = Search {
        criterion: criterion.criterion(),
        basis: Basis::Fourier { harmonics: args.harmonics },
        period_s: args.period,
        effects,
        seed: args.seed,
        ..Search::default()
    };
    let progress = Mutex::new(Progress::new("exciting", args.quiet));
    let found = excite(&description.robot, &search, &|share| {
        // A bar that a thread left behind in a panic is nobody's any more.
        if let Ok(mut progress) = progress.lock() {
            progress.update(share);
        }
    });
    let found = found.map_err(|e| anyhow!("{}: {e}", args.robot.display()))?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive length times a rate")]
    let samples = (args.period * RATE_HZ).round() as usize + 1;
    Ok(vec![named(found.recording(model, samples, RATE_HZ), criterion.criterion())])
}

fn named(mut recording: Recording, criterion: Criterion) -> Recording {
    recording.name = format!("motion found by --excite {}", criterion.name());
    recording
}

/// The plan as JSON text, with what was asked for.
///
/// # Panics
/// With a number that is not finite: whoever reads the file relies on there being none.
fn json(plan: &Plan, required: &[Required]) -> anyhow::Result<String> {
    let mut value = serde_json::to_value(plan)?;
    value["required"] = serde_json::to_value(required)?;
    value["ok"] = required.iter().all(|r| r.ok).into();
    if let Some(place) = crate::diagnosis::null_in(&value, "plan") {
        panic!("{place} is not a finite number");
    }
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_two_different_effects() {
        assert_eq!(pair("a@x, b").unwrap(), ["a@x", "b"]);
        for text in ["a", "a,", ",b", "a,b,c", "a,a", ""] {
            assert!(pair(text).is_err(), "{text}");
        }
    }
}
