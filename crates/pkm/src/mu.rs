//! `pkm mu`: how much uncertainty of known structure a loop survives, proved from above and shown from below.

mod file;
mod page;
mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use pkm_ctrl::design::mu::{
    CMatrix, Certificate, Gain, Guarantee, LowerBound, Settings, StateSpace, Structure, Sweep, UpperStatus, lower_bound, sweep,
    upper_bound, worst_case_gain,
};

use crate::out;
use crate::outputs::Outputs;
use file::{Problem, Subject};

/// Arguments of `pkm mu`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
FILE (.toml or .json) holds a system A, B, C, D or a matrix M, and [[block]] for every block of the uncertainty; docs/FORMATS.md has \
the layout.

Exit status: 0 the bounds were computed, whatever they are; 2 bad usage or bad input.

Examples:
  pkm mu two_masses.toml
  pkm mu two_masses.toml --json --proof
  pkm mu two_masses.toml --html mu.html")]
pub(crate) struct Args {
    /// The system and its uncertainty.
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Add the scalings that prove the upper bound to the JSON.
    #[arg(long, requires = "json")]
    proof: bool,
    /// Write a page with both bounds over frequency here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Points of the first grid of frequencies.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    points: u32,
    /// Share by which the proved level may exceed the largest bound at a point.
    #[arg(long, value_name = "SHARE", default_value_t = 1e-4, value_parser = share)]
    slack: f64,
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (1e-9..=1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 1e-9 to 1".to_string()),
    }
}

/// What was found.
pub(crate) struct Found {
    upper: f64,
    worst: LowerBound,
    /// Frequency of the largest upper bound; none for a matrix.
    peak_w: Option<f64>,
    guarantee: Option<Guarantee>,
    sweep: Option<Sweep>,
    /// Of a matrix: the proof, and how the iterations ended.
    matrix: Option<(Certificate, UpperStatus)>,
    gain: Option<Gain>,
    /// Pole closest to instability, or beyond, and its distance.
    stability: Option<Stability>,
}

/// Real and imaginary part of the least stable pole, and its distance from instability.
pub(crate) struct Stability {
    pole: [f64; 2],
    distance: f64,
}

impl Found {
    /// Whether the nominal system is stable; a matrix has no dynamics.
    fn is_stable(&self) -> bool {
        self.stability.as_ref().is_none_or(|s| s.distance > 0.0)
    }

    /// Whether the upper bound holds everywhere asked.
    fn is_guaranteed(&self) -> bool {
        matches!(self.guarantee, None | Some(Guarantee::Interval(_)))
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let problem = file::read(&args.file)?;
    let targets: Vec<PathBuf> = args.html.iter().cloned().collect();
    let mut outputs = Outputs::reserve(&targets, &[&args.file])?;
    let name = args.file.display();
    let settings = Settings { points: args.points as usize, slack: args.slack, ..Settings::default() };
    let found = analyse(&problem, &settings).map_err(|e| anyhow::anyhow!("{name}: {e}"))?;
    if let Some(target) = &args.html {
        outputs.write(target, &page::html(&problem, &found))?;
    }
    outputs.publish()?;
    let text = if args.json { text::json(&problem, &found, args.proof)? } else { text::text(&problem, &found) };
    out::say(&out::clean(&text))?;
    Ok(ExitCode::SUCCESS)
}

fn analyse(problem: &Problem, settings: &Settings) -> Result<Found, pkm_ctrl::design::mu::MuError> {
    match &problem.subject {
        Subject::Matrix(matrix) => of_matrix(matrix, &problem.structure),
        Subject::System(system, range) => of_system(problem, system, *range, settings),
    }
}

fn of_matrix(matrix: &CMatrix, structure: &Structure) -> Result<Found, pkm_ctrl::design::mu::MuError> {
    let upper = upper_bound(matrix, structure)?;
    let worst = lower_bound(matrix, structure, &upper)?;
    Ok(Found {
        upper: upper.certificate.beta,
        worst,
        peak_w: None,
        guarantee: None,
        sweep: None,
        matrix: Some((upper.certificate, upper.status)),
        gain: None,
        stability: None,
    })
}

fn of_system(problem: &Problem, system: &StateSpace, range: [f64; 2], settings: &Settings) -> Result<Found, pkm_ctrl::design::mu::MuError> {
    let gain = problem.performance.map(|p| worst_case_gain(system, &problem.structure, p, range, settings)).transpose()?;
    let found = match &gain {
        Some(gain) => gain.stability.clone(),
        None => sweep(system, &problem.structure, range, settings)?,
    };
    let stability = system.stability().map(|(pole, distance)| Stability { pole: [pole.re, pole.im], distance });
    Ok(Found {
        upper: found.upper,
        worst: found.worst.clone(),
        peak_w: Some(found.upper_w),
        guarantee: Some(found.guarantee.clone()),
        sweep: Some(found),
        matrix: None,
        gain,
        stability,
    })
}
