//! `pkm demo`: the whole story in one command. An effect is concealed in a simulated robot, sealed, recorded, and found again from the
//! recordings alone; then the refined robot is run in the simulator.

mod compare;
mod story;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::builder::PossibleValuesParser;
use pkm_diagnose::{Diagnosis, Settings, Verdict};
use pkm_dyn::effects::{Applied, CATALOGUE, Robot};
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_sim::Scenario;
use serde_json::json;

use crate::convert::with_robot;
use crate::diagnose::Targets;
use crate::diagnosis::{Stated, Subject, read_recordings, run as run_engine};
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::seal::Seal;
use crate::{out, robot_file};
use story::Story;

/// Folder that is made when none is given.
const FOLDER: &str = "pkm-demo";

/// Seeds of the two motions differ by this much, so that no seed's second motion is another seed's first.
const SECOND_MOTION: u64 = 0x9e37_79b9_7f4a_7c15;

/// Width of an encoder count and its noise `[m | rad]`: 20 bits per turn, or a good linear scale.
const ENCODER: f64 = 5e-6;

/// Arguments of `pkm demo`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit status: 0 what was concealed was found (or nothing was there and nothing was found), 1 it was not, 2 bad usage or bad input.

Examples:
  pkm demo
  pkm demo --robot five_bar --effect friction_stribeck --seed 7
  pkm demo --effect none")]
pub(crate) struct Args {
    /// The nominal robot: the name of a shipped one, or a robot.toml.
    #[arg(long, value_name = "ROBOT", default_value = "prs3")]
    robot: PathBuf,
    /// Seed of everything drawn: effect, place, size, motions, noise.
    #[arg(long, value_name = "N", default_value_t = 12)]
    seed: u64,
    /// Conceal this effect instead of drawing one; `none` conceals nothing (`pkm effects` lists them).
    #[arg(long, value_name = "NAME", value_parser = concealable(), hide_possible_values = true)]
    effect: Option<String>,
    /// Folder for recordings, report and refined robot [default: a new folder pkm-demo in the current one].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Length of each of the two recordings, 4 to 600 s.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = duration)]
    duration: f64,
    /// Print the outcome as JSON instead of the story.
    #[arg(long)]
    json: bool,
    /// Show no progress bars.
    #[arg(long, short)]
    quiet: bool,
}

fn concealable() -> PossibleValuesParser {
    PossibleValuesParser::new(CATALOGUE.iter().map(|e| e.name).chain(["none"]))
}

fn duration(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (4.0..=600.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 4 to 600".to_string()),
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let nominal = robot_file::read(&args.robot)?;
    let concealed = conceal(args, &nominal)?;
    let folder = make_folder(args.out.as_deref())?;
    let story = Story { is_silent: args.json };
    story.begin(&nominal, args, &folder)?;
    let seal = Seal::write(&folder.join("sealed.json"), &nominal.bare, &concealed, args.seed)?;
    story.sealed(&seal)?;
    let paths = ["motion1.mcap", "motion2.mcap"].map(|name| folder.join(name));
    record(args, &nominal, &concealed, &paths)?;
    story.recorded(&paths, args.duration)?;
    // From here on the nominal robot and the two files are all there is.
    let mut recordings = read_recordings(&paths, None, args.quiet)?;
    let holdout = recordings.split_off(1);
    let targets = targets(&folder);
    let diagnosis = examine(args, &nominal, &targets, [&recordings, &holdout])?;
    story.answer(&diagnosis)?;
    seal.verify()?;
    let is_right = story.compare(&concealed, &nominal, &diagnosis.verdict)?;
    if let Some([toml, _]) = targets.refined.as_ref().filter(|_| diagnosis.refined.is_some()) {
        let errors = compare::on_second_motion(toml, &nominal, &scenario(args, 1), (&holdout[0], diagnosis.verdict.heldout.band_hz))?;
        story.replayed(&errors)?;
    }
    story.files(&folder)?;
    if args.json {
        out::say(&out::clean(&outcome(args, &nominal, &concealed, &diagnosis.verdict, is_right)?))?;
    }
    Ok(ExitCode::from(u8::from(!is_right)))
}

/// The outcome as JSON: what was concealed, what was found, and whether that is right.
fn outcome(args: &Args, nominal: &Description, concealed: &[Applied], verdict: &Verdict, is_right: bool) -> anyhow::Result<String> {
    let model = &nominal.bare;
    let hidden = concealed.iter().map(|e| json!({"effect": e.entry.name, "where": [e.place_name(model)]}));
    let told = json!({
        "schema": "pkm.demo/1",
        "robot": model.name,
        "seed": args.seed,
        "concealed": hidden.collect::<Vec<_>>(),
        "findings": verdict.findings,
        "unexplained": verdict.unexplained,
        "heldout": verdict.heldout,
        "is_right": is_right,
    });
    Ok(serde_json::to_string_pretty(&told)?)
}

fn conceal(args: &Args, nominal: &Description) -> anyhow::Result<Vec<Applied>> {
    let effect = args.effect.as_deref();
    if effect == Some("none") {
        return Ok(Vec::new());
    }
    let file = args.robot.display();
    pkm_sim::draw(args.seed, nominal, effect, &pkm_diagnose::looked_for()).with_context(|| file.to_string())
}

/// The folder asked for, or the first of pkm-demo, pkm-demo-2, … that is not there yet.
fn make_folder(wanted: Option<&Path>) -> anyhow::Result<PathBuf> {
    if let Some(folder) = wanted {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        return Ok(folder.to_path_buf());
    }
    let mut number = 1_u32;
    loop {
        let folder = PathBuf::from(if number == 1 { FOLDER.to_string() } else { format!("{FOLDER}-{number}") });
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => number += 1,
            Err(e) => return Err(e).with_context(|| folder.display().to_string()),
        }
    }
}

fn scenario(args: &Args, motion: u64) -> Scenario {
    let seed = args.seed.wrapping_add(SECOND_MOTION.wrapping_mul(motion));
    Scenario { seed, duration_s: args.duration, encoder_resolution: ENCODER, encoder_noise: ENCODER, ..Scenario::default() }
}

/// Simulates the true robot on both motions and writes what a recorder would have written.
fn record(args: &Args, nominal: &Description, concealed: &[Applied], paths: &[PathBuf; 2]) -> anyhow::Result<()> {
    let effects = nominal.robot.effects.iter().chain(concealed).cloned().collect();
    let truth = Robot::new(nominal.bare.clone(), effects);
    let attachments = with_robot(nominal);
    let mut progress = Progress::new("simulating", args.quiet);
    for (i, path) in paths.iter().enumerate() {
        let mut share = |s: f64| progress.update(0.5 * (i as f64 + s));
        let made = pkm_sim::run(&truth, &nominal.robot, &scenario(args, i as u64), &mut share);
        let mut recording = made.with_context(|| args.robot.display().to_string())?;
        // The seed would give the answer away.
        recording.meta.other.clear();
        pkm_record::write(path, &recording, &attachments)?;
    }
    tracing::info!("simulation took {:.1} s", progress.seconds());
    Ok(())
}

fn targets(folder: &Path) -> Targets {
    Targets {
        json: Some(folder.join("verdict.json")),
        html: Some(folder.join("report.html")),
        refined: Some(["refined.robot.toml", "refined.robot.urdf"].map(|name| folder.join(name))),
    }
}

fn examine(args: &Args, nominal: &Description, targets: &Targets, recordings: [&[Recording]; 2]) -> anyhow::Result<Diagnosis> {
    let file = args.robot.display().to_string();
    let outputs = Outputs::reserve(&targets.all(), &[])?;
    let subject = Subject { description: nominal, file: &file, controller: Stated::Simulators };
    let mut diagnosis = run_engine(&subject, recordings[0], recordings[1], &Settings::default(), args.quiet)?;
    targets.publish(&mut diagnosis, nominal, outputs)?;
    Ok(diagnosis)
}
