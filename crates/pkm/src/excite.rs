//! `pkm excite`: a periodic motion that shows a robot's parameters as well as its limits allow, or tells two effects apart.

mod page;
mod text;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::{anyhow, ensure};
use clap::ValueEnum;
use pkm_dyn::model::Model;
use pkm_dyn::urdf::Description;
use pkm_ident::excitation::{Basis, Criterion, ExciteError, Limits, Settings, excite, samples};
use pkm_record::{Attachments, WriteError};

use crate::convert::with_robot;
use crate::diagnosis::positive;
use crate::identify::TermName;
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::simulate::hidden;
use crate::{check, out, robot_file};

/// Arguments of `pkm excite`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The motion is periodic, begins at rest and keeps every limit of the robot file: positions, velocities and efforts of the drives, positions \
and velocities of passive joints, and a distance from singularities. It is found by descent from random motions and verified on a grid ten \
times as dense. `pkm simulate ROBOT --reference FILE` plays the file. The same arguments give the same bytes.

Exit status: 0 a motion was found, 2 bad usage, or limits that leave no room for one.

Examples:
  pkm excite prs3 --out motion.csv
  pkm excite ups3_rpu1 --out motion.mcap --harmonics 7 --period 20 --speed 0.05 --cone 50 \\
      --html motion.html
  pkm excite serial_arm --out motion.csv --basis spline --pieces 16 --hold offset --json
  pkm excite five_bar --out motion.csv --criterion angle \\
      --separate friction_viscous@shoulder_left:viscous=1 \\
      --separate friction_coulomb@shoulder_left:coulomb=1")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// The motion to write, .mcap or .csv: references of position, velocity and acceleration of every drive.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// What is made good: the condition number of the base parameters' columns, the determinant of their information (D-optimal), or the
    /// angle between two effects, or the effort by which two effects differ.
    #[arg(long, value_name = "CRITERION", default_value = "condition", help_heading = "What is shown")]
    criterion: CriterionName,
    /// An effect to be told apart from another, NAME@PLACE:PARAMETER=VALUE,... in SI units; give two.
    #[arg(long, value_name = "EFFECT", help_heading = "What is shown")]
    separate: Vec<String>,
    /// Functions that the motion is the sum of.
    #[arg(long, value_name = "BASIS", default_value = "fourier", help_heading = "Motion")]
    basis: BasisName,
    /// Harmonics of a fourier motion.
    #[arg(long, value_name = "N", default_value_t = 5, help_heading = "Motion")]
    harmonics: usize,
    /// Pieces of a spline motion.
    #[arg(long, value_name = "N", default_value_t = 12, help_heading = "Motion")]
    pieces: usize,
    /// Period.
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = positive, help_heading = "Motion")]
    period: f64,
    /// Periods in the file.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Motion")]
    periods: usize,
    /// Samples per second in the file.
    #[arg(long, value_name = "HZ", default_value_t = 100.0, value_parser = positive, help_heading = "Motion")]
    rate: f64,
    /// Share of the robot file's limits that may be used, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.95, help_heading = "Limits")]
    share: f64,
    /// Fastest motion of any drive, m/s or rad/s, beside the robot file's limits.
    #[arg(long, value_name = "V", value_parser = positive, help_heading = "Limits")]
    speed: Option<f64>,
    /// Largest acceleration of any drive, m/s² or rad/s².
    #[arg(long, value_name = "A", value_parser = positive, help_heading = "Limits")]
    acceleration: Option<f64>,
    /// How far ball and universal joints may lean from the assembly.
    #[arg(long, value_name = "DEG", value_parser = positive, help_heading = "Limits")]
    cone: Option<f64>,
    /// Least distance from singularities: how firmly locked drives hold the passive joints (smallest singular value), as a share of that in
    /// the middle of the travel; 0 asks for none.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, help_heading = "Limits")]
    singularity: f64,
    /// Do not count these as parameters to be shown; may be given several times.
    #[arg(long, value_name = "TERM", help_heading = "What is shown")]
    hold: Vec<TermName>,
    /// Motions improved, of which the best is taken.
    #[arg(long, value_name = "N", default_value_t = 4, help_heading = "Search")]
    restarts: usize,
    /// Random motions drawn for each of them.
    #[arg(long, value_name = "N", default_value_t = 25, help_heading = "Search")]
    draws: usize,
    /// Steps of the improvement of each.
    #[arg(long, value_name = "N", default_value_t = 150, help_heading = "Search")]
    iterations: usize,
    /// Seed.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Search")]
    seed: u64,
    /// Write a page with pictures of the motion and of the search.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Replace a motion that exists.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// A criterion as a word on the command line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CriterionName(Criterion);

impl CriterionName {
    /// What it stands for.
    pub(crate) fn criterion(self) -> Criterion {
        self.0
    }
}

impl ValueEnum for CriterionName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [CriterionName; Criterion::ALL.len()] = {
            let mut all = [CriterionName(Criterion::Condition); Criterion::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = CriterionName(Criterion::ALL[i]);
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

/// A kind of functions as a word on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum BasisName {
    /// A finite Fourier series.
    Fourier,
    /// Periodic B-splines of degree five.
    Spline,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    let model = &description.robot.model;
    check::must_assemble(model, &file)?;
    let settings = settings(args, model)?;
    let samples = samples(settings.basis, args.period, args.periods, args.rate).map_err(told)?;
    let mut outputs = reserve(args, &description)?;
    let progress = Mutex::new(Progress::new("exciting", args.quiet || args.json));
    let found = excite(&description.robot, &settings, &|share| {
        // A bar that a thread left behind in a panic is nobody's any more.
        if let Ok(mut progress) = progress.lock() {
            progress.update(share);
        }
    });
    drop(progress);
    let found = found.map_err(|e| anyhow!("{file}: {e}"))?;
    if let Some(path) = &args.html {
        outputs.write(path, &page::html(&found, model))?;
    }
    let is_mcap = args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let attachments = if is_mcap { with_robot(&description) } else { Attachments::default() };
    pkm_record::write(&args.out, &found.recording(model, samples, args.rate), &attachments)?;
    outputs.publish()?;
    if args.json {
        out::say(&out::clean(&serde_json::to_string_pretty(&text::json(&found, model, &args.out.display().to_string()))?))?;
    } else if !args.quiet {
        out::say(&out::clean(&format!("{}\n\nMotion: {}, {samples} samples", text::text(&found), args.out.display())))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn settings(args: &Args, model: &Model) -> anyhow::Result<Settings> {
    let effects = args.separate.iter().map(|e| hidden::parse("--separate", e, model)).collect::<anyhow::Result<Vec<_>>>()?;
    let n = effects.len();
    if args.criterion.0.separates() {
        ensure!(n == 2, "--criterion {}: {n} effects (give --separate twice)", args.criterion.0.name());
    } else {
        ensure!(n == 0 || n == 2, "--separate: {n} effects (must be two)");
    }
    let basis = match args.basis {
        BasisName::Fourier => Basis::Fourier { harmonics: args.harmonics },
        BasisName::Spline => Basis::Spline { pieces: args.pieces },
    };
    let limits = Limits {
        share: args.share,
        velocity: args.speed,
        acceleration: args.acceleration,
        cone: args.cone.map(f64::to_radians),
        singularity: args.singularity,
    };
    Ok(Settings {
        criterion: args.criterion.0,
        basis,
        period_s: args.period,
        limits,
        held: args.hold.iter().map(|t| t.0).collect(),
        columns: None,
        effects,
        restarts: args.restarts,
        draws: args.draws,
        iterations: args.iterations,
        seed: args.seed,
    })
}

/// An error of the library with the flag it is about.
fn told(error: ExciteError) -> anyhow::Error {
    match error {
        ExciteError::Rate { rate_hz, least } => {
            anyhow!("--rate {rate_hz} Hz (must be at least {least:.3} Hz, ten samples per cycle of the fastest oscillation)")
        }
        ExciteError::Setting { what: "periods", value, limit } => anyhow!("--periods {value} ({limit})"),
        e => e.into(),
    }
}

/// Tells at once, before a long search, that a file cannot be written.
fn reserve(args: &Args, description: &Description) -> anyhow::Result<Outputs> {
    let name = args.out.display();
    let is_known = args.out.extension().is_some_and(|e| ["csv", "mcap"].iter().any(|k| e.eq_ignore_ascii_case(k)));
    if !is_known {
        return Err(WriteError::UnknownFormat { file: name.to_string() }.into());
    }
    ensure!(args.force || !args.out.exists() || args.out.is_dir(), "{name}: exists already (--force replaces it)");
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    let targets: Vec<PathBuf> = core::iter::once(&args.out).chain(&args.html).cloned().collect();
    // The motion's own reservation stays unfilled: its writer makes it appear at once by itself.
    Outputs::reserve(&targets, &[args.robot.as_path(), Path::new(&urdf)])
}
