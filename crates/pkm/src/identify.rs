//! `pkm identify`: the parameters of a robot from recordings, as a table, JSON, and a robot that runs.

mod preparation;
mod text;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{anyhow, ensure};
use clap::ValueEnum;
use pkm_dyn::effects::Robot;
use pkm_ident::beside::{Beside, Question};
use pkm_ident::estimate::Method;
use pkm_ident::note::Status;
use pkm_ident::observation::RowOptions;
use pkm_ident::refine::identified;
use pkm_ident::{Identification, IdentifyError, InputError, Recording, Settings, Shapes, Term, identify_in_closed_loop};

use crate::diagnosis::{each_once, positive, read_recordings};
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::{check, out, robot_file};

/// Exit code of recordings that identify nothing.
const NOT_IDENTIFIED: u8 = 1;

/// Arguments of `pkm identify`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit status: 0 a robot was identified (doubts are printed), 1 the recordings show too little for one, 2 bad usage or bad input.

Examples:
  pkm identify robot.toml --recording A.csv --holdout V.csv --out better.identified.toml
  pkm identify robot.toml --recording A.mcap --recording B.mcap --hold offset --json out.json
  pkm identify robot.toml --recording A.csv --method iv                    # positions are noisy
  pkm identify robot.toml --recording A.csv --period 10 --outliers 8       # ten seconds, averaged
  pkm identify robot.toml --recording A.csv --recording 2kg.csv --gains    # of each drive
  pkm identify robot.toml --recording A.csv --payload hand                 # what is in the hand
  pkm identify robot.toml --recording A.csv --shapes                       # Stribeck velocities too

Methods: sdp (physical bodies, the default), wls, ols (base parameters, weighted by drive or not), huber and bisquare (robust), \
ridge (drawn to the nominal robot), tls (noisy columns), relevant (drops what is not determined), iv (instruments from the simulated loop; \
needs columns q_ref.*).")]
pub(crate) struct Args {
    /// The robot as it is believed to be: a robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// Recording (.csv or .mcap) to fit on; may be given several times.
    #[arg(long = "recording", value_name = "FILE", required = true)]
    recordings: Vec<PathBuf>,
    /// Recording of another motion to judge on only; may be given several times [default: blocks of each recording].
    #[arg(long = "holdout", value_name = "FILE")]
    holdouts: Vec<PathBuf>,
    /// Write the identified robot here; its URDF gets the same name ending in .urdf.
    #[arg(long, value_name = "NAME.identified.toml")]
    out: Option<PathBuf>,
    /// Write every number here; `-` prints them.
    #[arg(long, value_name = "OUT.json")]
    json: Option<PathBuf>,
    /// Write a page with every number here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    #[command(flatten)]
    preparation: preparation::Preparation,
    /// Estimate velocities and exponents of the friction laws that the robot file states, from there on.
    #[arg(long, help_heading = "Estimation")]
    shapes: bool,
    /// Also the gains of the drives, from recordings with a known load (`load` in their metadata) beside recordings without.
    #[arg(long, help_heading = "Estimation")]
    gains: bool,
    /// Also what rides on this link, the robot itself being as its file says.
    #[arg(long, value_name = "LINK", help_heading = "Estimation")]
    payload: Option<String>,
    /// Estimator.
    #[arg(long, value_name = "METHOD", default_value = "sdp", help_heading = "Estimation")]
    method: MethodName,
    /// Compare efforts below this frequency only [default: chosen from the motion].
    #[arg(long, value_name = "HZ", value_parser = positive, help_heading = "Estimation")]
    band: Option<f64>,
    /// Keep these at their values in the robot file; may be given several times.
    #[arg(long, value_name = "TERM", help_heading = "Estimation")]
    hold: Vec<TermName>,
    /// Topic of the joint states, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// A method as a word on the command line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MethodName(Method);

impl ValueEnum for MethodName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [MethodName; Method::EVERY.len()] = {
            let mut all = [MethodName(Method::Sdp); Method::EVERY.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = MethodName(Method::EVERY[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.0.name()))
    }
}

/// A term as a word on the command line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TermName(pub(crate) Term);

impl ValueEnum for TermName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [TermName; Term::ALL.len()] = {
            let mut all = [TermName(Term::Rotor); Term::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = TermName(Term::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.0.name()))
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    each_once(&args.recordings, &args.holdouts)?;
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    check::must_assemble(&description.robot.model, &file)?;
    let fit = read_recordings(&args.recordings, args.topic.as_deref(), args.quiet)?;
    let holdout = read_recordings(&args.holdouts, args.topic.as_deref(), args.quiet)?;
    let robot_out = robot_paths(args)?;
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    let inputs: Vec<&Path> = args.recordings.iter().chain(&args.holdouts).chain([&args.robot, &urdf]).map(PathBuf::as_path).collect();
    let targets: Vec<PathBuf> = args.json.iter().chain(&args.html).chain(robot_out.iter().flatten()).cloned().collect();
    let mut outputs = Outputs::reserve(&targets, &inputs)?;
    let settings = Settings {
        method: args.method.0,
        rows: RowOptions { band_hz: args.band, derivative: args.preparation.derivative(), ..RowOptions::default() },
        preprocess: args.preparation.steps(),
        shapes: if args.shapes { Shapes::Estimated } else { Shapes::Stated },
        held: args.hold.iter().map(|t| t.0).collect(),
        ..Settings::default()
    };
    let questions: Vec<Question<'_>> =
        args.gains.then_some(Question::Gains).into_iter().chain(args.payload.as_deref().map(Question::Payload)).collect();
    let beside = Beside::of(&description.robot, &fit, &settings, &questions).map_err(|e| told(e, &file))?;
    let mut progress = Progress::new("identifying", args.quiet);
    let nominal = &description.robot;
    let mut simulate = |robot: &Robot, like: &Recording| pkm_sim::rerun([robot, nominal], like).map_err(|e| e.to_string());
    let answer = identify_in_closed_loop(nominal, [&fit, &holdout], &settings, &mut simulate, &mut |share| progress.update(share));
    tracing::info!("identification took {:.1} s", progress.seconds());
    drop(progress);
    let answer = answer.map_err(|e| told(e, &file))?;
    if let Some([toml, urdf]) = robot_out.as_ref().filter(|_| answer.status != Status::NotIdentified) {
        let urdf_name = urdf.file_name().unwrap_or_default().to_string_lossy();
        let texts = identified(&description, &answer).texts(&description, &urdf_name).map_err(|e| anyhow!("{}: {e}", toml.display()))?;
        outputs.write(toml, &texts[0])?;
        outputs.write(urdf, &texts[1])?;
    }
    if let Some(path) = &args.json {
        outputs.write(path, &(serde_json::to_string_pretty(&text::json(&answer, &beside))? + "\n"))?;
    }
    if let Some(path) = &args.html {
        outputs.write(path, &pkm_report::identification_html(&answer, &beside))?;
    }
    let is_told = !args.quiet && !outputs.takes_stdout();
    outputs.publish()?;
    if is_told {
        out::say(&out::clean(&said(args, &answer, &beside)))?;
    }
    Ok(if answer.status == Status::NotIdentified { ExitCode::from(NOT_IDENTIFIED) } else { ExitCode::SUCCESS })
}

fn said(args: &Args, answer: &Identification, beside: &Beside) -> String {
    let mut said = text::text(answer, beside);
    if let Some(path) = args.out.as_ref().filter(|_| answer.status != Status::NotIdentified) {
        said += &format!("\n\nIdentified robot: {}", path.display());
    }
    said
}

fn robot_paths(args: &Args) -> anyhow::Result<Option<[PathBuf; 2]>> {
    let Some(toml) = &args.out else { return Ok(None) };
    ensure!(toml.extension().is_some_and(|e| e == "toml"), "--out {}: must end in .toml", toml.display());
    Ok(Some([toml.clone(), toml.with_extension("urdf")]))
}

/// An error of the library with the file or flag it is about.
fn told(error: IdentifyError, robot: &str) -> anyhow::Error {
    match error {
        IdentifyError::Input(e @ InputError::Band { .. }) => anyhow!("--band: {e}"),
        IdentifyError::Input(e) => e.into(),
        IdentifyError::Robot { source, .. } => anyhow!("{robot}: {source}"),
        e @ IdentifyError::NoSimulation => e.into(),
    }
}
