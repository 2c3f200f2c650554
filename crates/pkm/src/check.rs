//! `pkm check`: what a robot file describes, whether its loops close, and how much of it recordings could ever show.

mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{bail, ensure};
use pkm_dyn::effects::Robot;
use pkm_dyn::elimination::Elimination;
use pkm_dyn::loops::{Closure, assemble, close_at, internal_efforts, mid_pose, mobility, walk_to};
use pkm_dyn::model::AXES;
use pkm_dyn::{Data, Model};
use pkm_ident::base::{BaseParameters, States, base_parameters};

use crate::random::Random;
use crate::{out, robot_file};

/// Largest table parameters are counted from: half a gigabyte.
const ENTRIES_MAX: usize = 64_000_000;

/// States over which the regressor is stacked.
const STATES: usize = 300;

/// A loop counts as closed below this gap `[m | rad]`.
const GAP_LIMIT: f64 = 1e-9;

/// Rounding allowed in the physical bounds of inertias, relative to their largest entry.
const INERTIA_TOLERANCE: f64 = 1e-9;

/// Arguments of `pkm check`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit status: 0 the robot moves and its drives hold every freedom, 2 it cannot be read, its loops do not close, or they do not.

Examples:
  pkm check prs3
  pkm check my/robot.toml --json")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Seed of the random states behind the number of base parameters.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// What a check finds out.
pub(crate) struct Checked {
    /// Closure in the stated assembly.
    home: Closure,
    /// Tree coordinates there `[m | rad]`.
    home_q: Vec<f64>,
    /// Constraint rows that follow from the others there.
    redundant: Vec<String>,
    /// Joints whose motion determines the others.
    independent: Vec<usize>,
    /// Efforts of the drives that move nothing, one list per surplus drive.
    internal: Vec<Vec<f64>>,
    /// Closure with every drive in the middle of its travel.
    middle: Closure,
    /// Degrees of freedom in the assembly.
    mobility: usize,
    /// Parameter counts, or why there are none.
    base: Result<Counts, String>,
    /// What should be looked at.
    warnings: Vec<String>,
}

/// Parameter counts moving and at rest.
pub(crate) struct Counts {
    moving: BaseParameters,
    at_rest: BaseParameters,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let description = robot_file::read(&args.robot)?;
    let robot = &description.robot;
    let checked = check(robot, &args.robot.display().to_string(), args.seed)?;
    let text = if args.json { serde_json::to_string_pretty(&text::json(robot, &checked))? } else { text::text(robot, &checked) };
    out::say(&out::clean(&text))?;
    Ok(ExitCode::SUCCESS)
}

fn check(robot: &Robot, file: &str, seed: u64) -> anyhow::Result<Checked> {
    let model = &robot.model;
    let mut data = Data::new(model);
    let (home, mobility) = assembled(model, &mut data, file)?;
    let home_q = data.q.clone();
    let redundant = redundant_rows(model, &data).into_iter().map(|row| row_name(model, row).trim_end_matches(',').to_string()).collect();
    let independent = data.independent.clone();
    let _ = close_at(model, &mut data);
    let internal = internal_efforts(model, &mut data).column_iter().map(|c| c.as_slice().to_vec()).collect();
    let middle = walk_to(model, &mut data, &mid_pose(model));
    let base = counts(model, seed);
    let warnings = warnings(robot, &middle);
    Ok(Checked { home, home_q, redundant, independent, internal, middle, mobility, base, warnings })
}

/// Closes the loops near the stated assembly, into `data.q`, and counts degrees of freedom there.
///
/// # Errors
/// Loops that do not close, and drives that do not determine every joint; the line begins with `file`.
fn assembled(model: &Model, data: &mut Data, file: &str) -> anyhow::Result<(Closure, usize)> {
    let home = assemble(model, data);
    let q = data.q.clone();
    if home.gap > GAP_LIMIT || home.gap.is_nan() {
        let at = row_name(model, home.row);
        bail!("{file}: loops do not close near the stated assembly: {at} stays {:.3e} m or rad open (limit {GAP_LIMIT:e})", home.gap);
    }
    let mobility = mobility(model, data, &q);
    let drives = model.n_act();
    ensure!(mobility > 0, "{file}: nothing moves in the stated assembly (at least one degree of freedom is needed)");
    ensure!(mobility <= drives, "{file}: {mobility} degrees of freedom and {drives} drives (every freedom needs one)");
    if !home.is_closed {
        let (rank, dependent) = (home.rank, data.dependent.len());
        bail!("{file}: the drives determine {rank} of {dependent} passive joints in the stated assembly (all must be)");
    }
    Ok((home, mobility))
}

/// Refuses a robot that cannot be assembled, or whose drives do not hold every freedom: no recording is to blame for that.
///
/// # Errors
/// As `pkm check`; the line begins with `file`.
pub(crate) fn must_assemble(model: &Model, file: &str) -> anyhow::Result<()> {
    must_be_driven(model, file).map(|_| ())
}

/// As [`must_assemble`], and says how many drives there are more than freedoms.
///
/// # Errors
/// As [`must_assemble`].
pub(crate) fn must_be_driven(model: &Model, file: &str) -> anyhow::Result<usize> {
    let (_, mobility) = assembled(model, &mut Data::new(model), file)?;
    Ok(model.n_act().saturating_sub(mobility))
}

/// Constraint rows that say what other rows say already, at the pose in `data`.
fn redundant_rows(model: &Model, data: &Data) -> Vec<usize> {
    let mut all = Elimination::new(model.n_constraints(), model.nv());
    all.factor(|i, j| data.loop_jacobian[(i, j)]);
    let mut rows = all.redundant_rows().to_vec();
    rows.sort_unstable();
    rows
}

fn counts(model: &Model, seed: u64) -> Result<Counts, String> {
    // A table of states by columns is what the counts are read from.
    let columns = pkm_dyn::parameters::N_INERTIAL * model.massive_links().len() + 3 * model.nv();
    let entries = STATES.saturating_mul(model.nv()).saturating_mul(columns);
    if entries > ENTRIES_MAX {
        return Err(format!("{} joints and {} links with mass are too many for it", model.nv(), model.massive_links().len()));
    }
    let count = |kind| {
        let mut random = Random::new(seed);
        base_parameters(model, kind, STATES, &mut || random.unit()).map_err(|e| e.to_string())
    };
    Ok(Counts { moving: count(States::Moving)?, at_rest: count(States::AtRest)? })
}

/// Constraint rows: couplings first, then the constrained axes of each loop.
fn row_name(model: &Model, row: usize) -> String {
    if let Some(c) = model.couplings.get(row) {
        return format!("coupling of {:?}", model.joints[c.joint].name);
    }
    let axes = |l: &pkm_dyn::model::LoopClosure| (0..6).filter(|&k| l.constrain[k]).collect::<Vec<_>>();
    let mut rows = model.loops.iter().flat_map(|l| axes(l).into_iter().map(move |k| (&l.name, AXES[k])));
    let named = rows.nth(row - model.couplings.len());
    named.map_or_else(|| format!("constraint row {row}"), |(name, axis)| format!("loop {name:?}, {axis},"))
}

fn warnings(robot: &Robot, middle: &Closure) -> Vec<String> {
    let model = &robot.model;
    let mut out = Vec::new();
    if model.massive_links().is_empty() {
        out.push(
            "no link that moves has mass: the URDF has no <inertial> there, so nothing has weight and nothing can be identified"
                .to_string(),
        );
    }
    for link in &model.links {
        let p = &link.parameters;
        if link.body.is_some() && !p.is_feasible(INERTIA_TOLERANCE) {
            let lowest = p.pseudo_inertia().symmetric_eigenvalues().min();
            out.push(format!(
                "link {:?}: no distribution of mass has this inertia (smallest eigenvalue of its pseudo-inertia {lowest:.3e}, limit 0)",
                link.name
            ));
        }
    }
    for &j in &model.actuators {
        let joint = &model.joints[j];
        if !(joint.limits.lower.is_finite() && joint.limits.upper.is_finite()) {
            out.push(format!("joint {:?}: no travel limits: its middle of travel is taken to be the assembly", joint.name));
        }
        if let Some(value) = outside(model.assembly[j], joint.limits.lower, joint.limits.upper) {
            out.push(format!("joint {:?}: the assembly {value} lies outside the travel limits", joint.name));
        }
    }
    if !middle.is_closed {
        out.push(format!("the middle of travel cannot be reached from the assembly: gap {:.3e} m or rad (limit 1e-9)", middle.gap));
    }
    out
}

fn outside(value: f64, lower: f64, upper: f64) -> Option<f64> {
    (value < lower || value > upper).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_named_by_loop_and_axis() {
        let robot = pkm_robots::find("prs3").unwrap();
        let model = pkm_dyn::urdf::parse(robot.toml, robot.urdf, ["a", "b"]).unwrap().bare;
        assert_eq!(row_name(&model, 0), "loop \"leg2\", x,");
        assert_eq!(row_name(&model, 5), "loop \"leg3\", z,");
        assert_eq!(row_name(&model, 6), "constraint row 6");
    }
}
