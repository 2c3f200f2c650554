//! `pkm diagnose`: recordings against a robot file, and the answer as text, JSON, HTML and a refined robot.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{anyhow, ensure};
use pkm_diagnose::verdict::Status;
use pkm_diagnose::{Diagnosis, Verdict};
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_report::Style;

use crate::diagnosis::{SettingsArgs, Stated, Subject, each_once, json, read_recordings, run as run_engine};
use crate::outputs::{Outputs, folder, is_stdout};
use crate::progress::Progress;
use crate::simulate::controller::ControllerArgs;
use crate::twins::Simulated;
use crate::{check, out, robot_file};

/// What `--controller` is here; elsewhere it moves a simulated robot, and there is always one.
const CONTROLLER: &str = "The controller.toml that made the recordings: recorded commands that are not its own are told, and it moves the replay \
    [default: commands are not checked, and the replay is held to the measured motion]";

/// Arguments of `pkm diagnose`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit status: 0 the diagnosis ran, 1 with --fail-on-mismatch when something was found or the recordings could not be used, 2 bad usage or bad input.

Long recordings: beyond 600 000 samples together they are taken at 50 samples per period of the band (a note in the verdict says so); \
beyond half a gigabyte what is computed from them waits in a nameless file in the folder of temporary files.

On a terminal, or with -v, the joint and regime with the largest mismatch are told on standard error long before the verdict.

Examples:
  pkm diagnose robot.toml --recording A.csv --holdout B.csv --html out.html
  pkm diagnose robot.toml --recording A.csv --holdout B.csv --controller controller.toml
  pkm diagnose robot.toml --recording A.mcap --recording B.mcap --json out.json --fail-on-mismatch
  pkm diagnose robot.toml --recording A.csv --without friction_coulomb   (what if it were not?)
  pkm diagnose robot.toml --recording hour.mcap -v 2>&1 | grep 'largest mismatch'
  pkm diagnose robot.toml --recording A.csv --holdout B.csv --json - | jq '.findings[].effect'")]
#[command(mut_arg("controller", |a| a.help(CONTROLLER)))]
pub(crate) struct Args {
    /// The robot as it is believed to be: a robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// Recording (.csv or .mcap) to search and fit on; may be given several times.
    #[arg(long = "recording", value_name = "FILE", required = true)]
    recordings: Vec<PathBuf>,
    /// Recording of another motion to judge on only; may be given several times [default: blocks of each recording].
    #[arg(long = "holdout", value_name = "FILE")]
    holdouts: Vec<PathBuf>,
    /// Write the verdict here, and the refined robot beside it (OUT.robot.toml and OUT.robot.urdf); `-` prints the verdict alone.
    #[arg(long, value_name = "OUT.json")]
    json: Option<PathBuf>,
    /// Write a page with pictures here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Write the refined robot here instead of beside the JSON; its URDF gets the same name ending in .urdf.
    #[arg(long, value_name = "ROBOT.toml")]
    refined: Option<PathBuf>,
    #[command(flatten)]
    settings: SettingsArgs,
    #[command(flatten)]
    controller: ControllerArgs,
    /// Do not replay the judged recordings in simulation.
    #[arg(long)]
    no_replay: bool,
    /// Topic of the joint states, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Exit with status 1 when anything was found or stayed unexplained, or when the recordings could not be used.
    #[arg(long)]
    fail_on_mismatch: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    each_once(&args.recordings, &args.holdouts)?;
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    check::must_assemble(&description.robot.model, &file)?;
    let train = read_recordings(&args.recordings, args.topic.as_deref(), args.quiet)?;
    let holdout = read_recordings(&args.holdouts, args.topic.as_deref(), args.quiet)?;
    let targets = Targets::of(args)?;
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    let files = args.recordings.iter().chain(&args.holdouts).chain([&args.robot, &urdf]).map(PathBuf::as_path);
    let inputs: Vec<&Path> = files.chain(args.controller.path()).collect();
    // A controller file that cannot be read must not cost the time of a diagnosis.
    args.controller.read(&description.robot)?;
    let outputs = Outputs::reserve(&targets.all(), &inputs)?;
    let is_told = !args.quiet && !outputs.takes_stdout();
    let controller = args.controller.path().map_or(Stated::Nothing, Stated::File);
    let subject = Subject { description: &description, file: &file, controller };
    let mut diagnosis = run_engine(&subject, &train, &holdout, &args.settings.settings(), args.quiet)?;
    if !args.no_replay {
        let all: Vec<Recording> = train.into_iter().chain(holdout).collect();
        let mut progress = Progress::new("replaying in simulation", args.quiet);
        let twin = Simulated { controller: &args.controller };
        pkm_diagnose::replay(&mut diagnosis, &description, &all, &twin, &mut |share| progress.update(share));
    }
    targets.publish(&mut diagnosis, &description, outputs)?;
    if is_told {
        let style = if out::is_coloured() { Style::Colour } else { Style::Plain };
        out::say(pkm_report::terminal(&diagnosis, style).trim_end())?;
    }
    let is_failure = args.fail_on_mismatch && is_mismatch(&diagnosis.verdict);
    Ok(ExitCode::from(u8::from(is_failure)))
}

/// Whether a pipeline that asks for a robot like its model must stop. A check that could not be made has not passed.
fn is_mismatch(verdict: &Verdict) -> bool {
    verdict.status != Status::Ok || !verdict.findings.is_empty() || verdict.unexplained.present
}

/// Where the answer goes.
#[derive(Debug, Default)]
pub(crate) struct Targets {
    /// The verdict.
    pub(crate) json: Option<PathBuf>,
    /// The page.
    pub(crate) html: Option<PathBuf>,
    /// The refined robot.toml and its URDF.
    pub(crate) refined: Option<[PathBuf; 2]>,
}

impl Targets {
    fn of(args: &Args) -> anyhow::Result<Self> {
        let beside_json = |json: &PathBuf| {
            let stem = json.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            ["toml", "urdf"].map(|kind| json.with_file_name(format!("{stem}.robot.{kind}")))
        };
        let refined = match &args.refined {
            Some(toml) => {
                ensure!(toml.extension().is_some_and(|e| e == "toml"), "--refined {}: must end in .toml", toml.display());
                Some([toml.clone(), toml.with_extension("urdf")])
            }
            None => args.json.as_ref().filter(|json| !is_stdout(json)).map(beside_json),
        };
        Ok(Self { json: args.json.clone(), html: args.html.clone(), refined })
    }

    /// Every file that may be written.
    pub(crate) fn all(&self) -> Vec<PathBuf> {
        self.json.iter().chain(&self.html).chain(self.refined.iter().flatten()).cloned().collect()
    }

    /// Writes everything; `diagnosis.verdict.refined_model` becomes the path of the refined robot, as seen from the JSON.
    ///
    /// # Errors
    /// When the file system refuses.
    pub(crate) fn publish(&self, diagnosis: &mut Diagnosis, description: &Description, mut outputs: Outputs) -> anyhow::Result<()> {
        diagnosis.verdict.refined_model = String::new();
        if let (Some([toml, urdf]), Some(refined)) = (&self.refined, &diagnosis.refined) {
            let urdf_name = urdf.file_name().unwrap_or_default().to_string_lossy();
            let texts = refined.texts(description, &urdf_name).map_err(|e| anyhow!("{}: {e}", toml.display()))?;
            outputs.write(toml, &texts[0])?;
            outputs.write(urdf, &texts[1])?;
            diagnosis.verdict.refined_model = self.refined_as_seen_from_json(toml)?;
        }
        if let Some(path) = &self.json {
            outputs.write(path, &json(&diagnosis.verdict)?)?;
        }
        if let Some(path) = &self.html {
            outputs.write(path, &pkm_report::html(diagnosis))?;
        }
        outputs.publish()
    }

    /// A file name when both lie in one folder, the path as given without a JSON, an absolute path otherwise.
    fn refined_as_seen_from_json(&self, toml: &Path) -> anyhow::Result<String> {
        let Some(json) = self.json.as_ref().filter(|json| !is_stdout(json)) else { return Ok(toml.display().to_string()) };
        if folder(json) == folder(toml) {
            return Ok(toml.file_name().unwrap_or_default().to_string_lossy().into_owned());
        }
        Ok(std::path::absolute(toml)?.display().to_string())
    }
}
