//! From arguments to a scan: output, coordinates, axes, limits.

use anyhow::{Context, anyhow, bail, ensure};
use pkm_dyn::Data;
use pkm_dyn::loops::{Coordinate, Guide, Output, Singularities};
use pkm_dyn::model::Model;
use pkm_dyn::workspace::{
    Axis, Cause, Margins, Scan, Scanner, Slice, Undetermined, cones, coordinate_name, coordinate_named, coordinate_unit, home, prescribe,
};

use super::Args;
use super::arguments::spread;

/// Cells of one scan: a page of them is as much as a person can look at.
const MAX_CELLS: usize = 4_000_000;

/// Values of an axis whose range is found out.
const VALUES: usize = 41;

/// Step with which a reach from home is found out `[m | rad]`, and the most steps.
const STEP: [f64; 2] = [0.005, 0.02];
const MAX_STEPS: usize = 150;

/// A reach of fewer steps says nothing of the workspace.
const SHORT: usize = 20;

/// A scan ready to run; its slices are still empty.
pub(crate) struct Plan<'m> {
    pub(super) scanner: Scanner<'m>,
    pub(super) scan: Scan,
    /// Values of the coordinates that are not scanned.
    at: Vec<f64>,
}

impl<'m> Plan<'m> {
    pub(super) fn new(args: &Args, model: &'m Model) -> anyhow::Result<Self> {
        let positive = |x: f64| x > 0.0 && !x.is_nan();
        ensure!(args.length.is_finite() && positive(args.length), "--length {} m (must be finite and > 0)", args.length);
        ensure!(args.singularity_limit >= 0.0, "--singularity-limit {} (must be >= 0)", args.singularity_limit);
        ensure!(positive(args.condition_limit), "--condition-limit {} (must be > 0)", args.condition_limit);
        let mut data = Data::new(model);
        let home = home(model, &mut data).context("loops do not close near the stated assembly (pkm check says where)")?;
        let output = output(model, args.link.as_deref())?;
        let names = axis_names(args)?;
        let (coordinates, components) = prescribed(args, model, (&home, &output), &names)?;
        let names = if names.is_empty() { default_axes(args, model, &coordinates) } else { names };
        let guide = Guide::new(model, output.clone(), coordinates.clone());
        let singularities = Singularities::new(model, &mut data, &home, output.clone(), &components, args.length);
        let cones = cones(model, &mut data, &home);
        let cone = cone_limits(args, &cones)?;
        let margins = Margins { cone, parallel: args.singularity_limit, condition: args.condition_limit };
        let mut scanner = Scanner::new(model, &home, guide, singularities, (cones, margins.clone()));
        let home_cell = scanner.home_cell();
        let home_values = scanner.home_values().to_vec();
        let index = |name: &str| coordinates.iter().position(|&c| coordinate_name(model, c) == name);
        let mut at = home_values.clone();
        for fixed in &args.at {
            at[index(&fixed.name).context("a coordinate that is not prescribed")?] = fixed.value;
        }
        let mut axis = |name: &String| -> anyhow::Result<Axis> {
            let index = index(name).context("an axis that is not prescribed")?;
            let stated = args.range.iter().chain(&args.slices).find(|r| r.name == *name).map(|r| r.values.clone());
            Ok(Axis { index, values: stated.unwrap_or_else(|| found_out(model, &mut scanner, &coordinates, index)) })
        };
        let columns = axis(names.first().context("every coordinate is fixed: nothing is left to scan")?)?;
        let rows = names.get(1).map(&mut axis).transpose()?;
        let stack = args.slices.as_ref().map(|r| axis(&r.name)).transpose()?;
        let scan = Scan {
            output: output.name.clone(),
            names: coordinates.iter().map(|&c| coordinate_name(model, c)).collect(),
            units: coordinates.iter().map(|&c| coordinate_unit(model, c)).collect(),
            home_values,
            home: home_cell,
            length: args.length,
            margins,
            columns,
            rows,
            stack,
            slices: Vec::new(),
        };
        let plan = Self { scanner, scan, at };
        let cells = plan.n_cells() * plan.n_slices();
        ensure!(cells <= MAX_CELLS, "{cells} cells (limit {MAX_CELLS})");
        Ok(plan)
    }

    /// Number of slices.
    pub(super) fn n_slices(&self) -> usize {
        self.scan.stack.as_ref().map_or(1, |s| s.values.len())
    }

    /// Cells of a slice.
    pub(super) fn n_cells(&self) -> usize {
        self.scan.columns.values.len() * self.scan.rows.as_ref().map_or(1, |r| r.values.len())
    }

    /// The `i`-th slice.
    pub(super) fn slice(&self, scanner: &mut Scanner<'m>, i: usize, each: &mut dyn FnMut()) -> Slice {
        let mut at = self.at.clone();
        if let Some(stack) = &self.scan.stack {
            at[stack.index] = stack.values[i];
        }
        scanner.slice(&self.scan.columns, self.scan.rows.as_ref(), &at, each)
    }
}

fn output(model: &Model, name: Option<&str>) -> anyhow::Result<Output> {
    let known = || {
        let links = model.links.iter().filter(|l| l.body.is_some()).map(|l| &l.name);
        let all = links.chain(model.sensors.iter().map(|s| &s.name)).chain(model.loops.iter().map(|l| &l.name));
        all.map(String::as_str).collect::<Vec<_>>().join(", ")
    };
    let output = match name {
        Some(name) => {
            Output::named(model, name).ok_or_else(|| anyhow!("--link {name:?}: no such link, sensor or loop (there are: {})", known()))?
        }
        None => Output::evident(model).ok_or_else(|| anyhow!("no link stands out as the output: name one with --link ({})", known()))?,
    };
    ensure!(output.frame.body.is_some(), "--link {:?}: does not move", output.name);
    Ok(output)
}

/// The first two coordinates that nothing else is said of.
fn default_axes(args: &Args, model: &Model, coordinates: &[Coordinate]) -> Vec<String> {
    let is_said = |name: &String| args.slices.iter().any(|s| s.name == *name) || args.at.iter().any(|v| v.name == *name);
    coordinates.iter().map(|&c| coordinate_name(model, c)).filter(|name| !is_said(name)).take(2).collect()
}

/// The one or two axes of a slice; empty where none is named.
fn axis_names(args: &Args) -> anyhow::Result<Vec<String>> {
    let mut names = args.axes.clone();
    for range in &args.range {
        if args.axes.is_empty() {
            names.push(range.name.clone());
        }
        ensure!(names.contains(&range.name), "--range {:?}: is not one of the --axes", range.name);
    }
    let mut all: Vec<&String> = names.iter().chain(args.slices.iter().map(|s| &s.name)).chain(args.at.iter().map(|v| &v.name)).collect();
    all.sort();
    if let Some(twice) = all.windows(2).find(|w| w[0] == w[1]) {
        bail!("{:?} is named twice (an axis, --slices or --at)", twice[0]);
    }
    ensure!(names.len() <= 2, "{} axes (a slice has one or two; a third goes to --slices)", names.len());
    Ok(names)
}

/// All prescribed coordinates, those named first, and the components of the output that count.
fn prescribed(
    args: &Args,
    model: &Model,
    (home, output): (&[f64], &Output),
    names: &[String],
) -> anyhow::Result<(Vec<Coordinate>, Vec<usize>)> {
    let drives = || model.actuators.iter().map(|&j| model.joints[j].name.as_str()).collect::<Vec<_>>().join(", ");
    let known = |name: &String| {
        coordinate_named(model, name).ok_or_else(|| anyhow!("{name:?} is no coordinate (there are: x, y, z, rx, ry, rz, {})", drives()))
    };
    let named = names.iter().chain(args.slices.iter().map(|s| &s.name)).chain(args.at.iter().map(|v| &v.name));
    let wanted: Vec<Coordinate> = named.map(known).collect::<anyhow::Result<_>>()?;
    prescribe(model, home, output, &wanted, args.length).map_err(|e| match e {
        Undetermined::Dependent(c) => anyhow!("{}: {e}", coordinate_name(model, c)),
        Undetermined::TooFew { .. } => anyhow!("{:?}: {e}: scan drives instead (--axes with names of driven joints)", output.name),
        Undetermined::TooMany { .. } | Undetermined::Still => anyhow!("{e}"),
    })
}

fn cone_limits(args: &Args, cones: &[pkm_dyn::workspace::Cone]) -> anyhow::Result<Vec<f64>> {
    let mut limits = vec![f64::INFINITY; cones.len()];
    ensure!(args.cone.is_empty() || !cones.is_empty(), "--cone: this robot has no ball or universal joint with a leg");
    for cone in &args.cone {
        match &cone.name {
            None => limits.fill(cone.angle),
            Some(name) => {
                let known = || cones.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
                let at = cones.iter().position(|c| c.name == *name);
                limits[at.ok_or_else(|| anyhow!("--cone {name:?}: no such ball or universal joint (there are: {})", known()))?] =
                    cone.angle;
            }
        }
    }
    Ok(limits)
}

/// Values over a quarter more than the reach from home along this coordinate alone; a drive's stroke where it is stated.
fn found_out(model: &Model, scanner: &mut Scanner<'_>, coordinates: &[Coordinate], index: usize) -> Vec<f64> {
    if let Coordinate::Joint(j) = coordinates[index] {
        let l = model.joints[j].limits;
        if l.lower.is_finite() && l.upper.is_finite() && l.lower < l.upper {
            return spread(l.lower, l.upper, VALUES);
        }
    }
    let step = if coordinate_unit(model, coordinates[index]) == "m" { STEP[0] } else { STEP[1] };
    let home = scanner.home_values().to_vec();
    let mut reach = |side: f64, most: usize, goes_on: fn(Cause) -> bool| {
        let mut values = home.clone();
        let mut cell = scanner.home_cell();
        let mut steps = 0;
        while steps < most && goes_on(cell.cause) {
            steps += 1;
            values[index] += side * step;
            cell = scanner.advance(&values);
        }
        steps as f64 * step
    };
    let is_free = |c: Cause| c == Cause::Reachable;
    let (mut down, mut up) = (reach(-1.0, MAX_STEPS, is_free), reach(1.0, MAX_STEPS, is_free));
    if down + up < SHORT as f64 * step {
        // Home is at a limit and this way leads out: other ways may lead in.
        let is_closed = |c: Cause| c != Cause::Open && c != Cause::Beyond;
        (down, up) = (reach(-1.0, SHORT, is_closed), reach(1.0, SHORT, is_closed));
    }
    let margin = 0.125 * (down + up) + 2.0 * step;
    spread(home[index] - down - margin, home[index] + up + margin, VALUES)
}
