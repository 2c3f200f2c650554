//! `pkm trial-null`: the same runs with nothing missing, to see how often a diagnosis finds something all the same.

use std::path::PathBuf;
use std::process::ExitCode;

use pkm_diagnose::Verdict;
use pkm_diagnose::verdict::Status;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_ident::spectrum::phase_randomised;
use serde_json::{Value, json};

use crate::diagnosis::{SettingsArgs, Stated, Subject, each_once, input_error, read_recordings, run as run_engine};
use crate::outputs::Outputs;
use crate::random::Random;
use crate::{check, out, robot_file};

/// Arguments of `pkm trial-null`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each run keeps the recorded motion and replaces the effort by the robot's own prediction plus noise: what this robot leaves \
unexplained, with random phases, so that its spectrum stays and everything that depends on the motion is gone. Nothing is \
missing from such a run; whatever is found is a false alarm.

Examples:
  pkm trial-null out.robot.toml --recording A.csv --recording B.csv --runs 20 --json null.json")]
pub(crate) struct Args {
    /// The robot that the runs are made with and diagnosed against, such as a refined one.
    robot: PathBuf,
    /// Recording whose motion and noise are used; may be given several times.
    #[arg(long = "recording", value_name = "FILE", required = true)]
    recordings: Vec<PathBuf>,
    /// Recording that is made likewise and only judged on; may be given several times.
    #[arg(long = "holdout", value_name = "FILE")]
    holdouts: Vec<PathBuf>,
    /// Number of runs.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    runs: u64,
    /// Write the table here as well; `-` prints it instead of words.
    #[arg(long, value_name = "OUT.json")]
    json: Option<PathBuf>,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Topic of the joint states, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// A recording taken apart: what the robot explains of each drive's effort, and what it does not.
struct Parts {
    recording: Recording,
    drives: Vec<Drive>,
}

struct Drive {
    column: String,
    predicted: Vec<f64>,
    residual: Vec<f64>,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    each_once(&args.recordings, &args.holdouts)?;
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    check::must_assemble(&description.robot.model, &file)?;
    let train = parts(&description, read_recordings(&args.recordings, args.topic.as_deref(), args.quiet)?, &file)?;
    let holdout = parts(&description, read_recordings(&args.holdouts, args.topic.as_deref(), args.quiet)?, &file)?;
    let targets: Vec<PathBuf> = args.json.iter().cloned().collect();
    let mut outputs = Outputs::reserve(
        &targets,
        &args.recordings.iter().chain(&args.holdouts).chain([&args.robot]).map(PathBuf::as_path).collect::<Vec<_>>(),
    )?;
    let subject = Subject { description: &description, file: &file, controller: Stated::Nothing };
    let settings = args.settings.settings();
    let mut rows = vec![["seed", "status", "findings", "unexplained"].map(str::to_string).to_vec()];
    let mut runs = Vec::new();
    for seed in settings.seed..settings.seed.saturating_add(args.runs) {
        let mut random = Random::new(seed);
        let mut made = |parts: &[Parts]| parts.iter().map(|p| with_nothing_missing(p, &mut random)).collect::<Vec<_>>();
        let (train, holdout) = (made(&train), made(&holdout));
        let verdict = run_engine(&subject, &train, &holdout, &settings, args.quiet)?.verdict;
        tracing::info!("seed {seed}: {}", verdict.says);
        rows.push(vec![seed.to_string(), status(&verdict).to_string(), findings(&verdict), verdict.unexplained.present.to_string()]);
        runs.push((seed, verdict));
    }
    if let Some(path) = &args.json {
        outputs.write(path, &(serde_json::to_string_pretty(&as_json(&description, &runs))? + "\n"))?;
    }
    let is_told = !args.quiet && !outputs.takes_stdout();
    outputs.publish()?;
    if is_told {
        out::say(&out::clean(&out::table(&rows)))?;
        let alarms = runs.iter().filter(|(_, v)| is_alarm(v)).count();
        out::say(&format!("{alarms} of {} runs with nothing missing gave a false alarm", runs.len()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn parts(description: &Description, recordings: Vec<Recording>, file: &str) -> anyhow::Result<Vec<Parts>> {
    let mut out = Vec::new();
    for recording in recordings {
        let predicted = pkm_diagnose::predict(description, &recording).map_err(|e| input_error(e, file))?;
        let mut drives = Vec::new();
        for (joint, predicted) in predicted {
            let column = format!("tau.{joint}");
            let Some(measured) = recording.signal(&column) else { continue };
            let residual = without_mean(measured.iter().zip(&predicted).map(|(m, p)| m - p).collect());
            drives.push(Drive { column, predicted, residual });
        }
        out.push(Parts { recording, drives });
    }
    Ok(out)
}

/// Zero where a sample is missing, and no mean: a constant effort that the robot does not explain would be physics, not noise.
fn without_mean(x: Vec<f64>) -> Vec<f64> {
    let known: Vec<f64> = x.iter().copied().filter(|v| v.is_finite()).collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    x.into_iter().map(|v| if v.is_finite() { v - mean } else { 0.0 }).collect()
}

/// The recording with its efforts replaced; missing samples stay missing.
fn with_nothing_missing(parts: &Parts, random: &mut Random) -> Recording {
    let mut out = parts.recording.clone();
    for drive in &parts.drives {
        let phases: Vec<f64> = (0..=drive.residual.len() / 2).map(|_| 2.0 * core::f64::consts::PI * random.unit()).collect();
        let noise = phase_randomised(&drive.residual, &phases);
        if let Some(tau) = out.signals.get_mut(&drive.column) {
            for (i, value) in tau.iter_mut().enumerate().filter(|(_, v)| v.is_finite()) {
                *value = drive.predicted[i] + noise[i];
            }
        }
    }
    out
}

fn is_alarm(verdict: &Verdict) -> bool {
    !verdict.findings.is_empty() || verdict.unexplained.present
}

fn status(verdict: &Verdict) -> &'static str {
    match verdict.status {
        Status::Ok => "ok",
        Status::Unusable => "unusable",
        Status::NotRepeatable => "not_repeatable",
    }
}

fn findings(verdict: &Verdict) -> String {
    let one = |f: &pkm_diagnose::verdict::Finding| format!("{} at {} ({:.2})", f.effect, f.place.join(", "), f.confidence);
    if verdict.findings.is_empty() { "none".to_string() } else { verdict.findings.iter().map(one).collect::<Vec<_>>().join("; ") }
}

fn as_json(description: &Description, runs: &[(u64, Verdict)]) -> Value {
    let finding = |f: &pkm_diagnose::verdict::Finding| json!({"effect": f.effect, "where": f.place, "confidence": f.confidence});
    let run = |(seed, v): &(u64, Verdict)| {
        json!({
            "seed": seed,
            "status": status(v),
            "findings": v.findings.iter().map(finding).collect::<Vec<_>>(),
            "unexplained": v.unexplained.present,
            "rms_nominal": v.heldout.rms_nominal,
        })
    };
    json!({
        "schema": "pkm.null/1",
        "robot": description.robot.model.name,
        "false_alarms": runs.iter().filter(|(_, v)| is_alarm(v)).count(),
        "runs": runs.iter().map(run).collect::<Vec<_>>(),
    })
}
