//! A scanned workspace in about twenty lines.

use pkm_dyn::Model;
use pkm_dyn::workspace::{Cause, Cone, Scan};

use super::Style;
use super::ink::{Ink, Tone, clean, left, right};
use crate::format::{percent, short, significant};
use crate::pose::{pose, shown};

/// Causes listed.
const CAUSES_MAX: usize = 10;

/// A scanned workspace as text: share that is reachable, what limits, extents, worst conditioning.
///
/// Control characters in names are replaced, so that a file cannot write escape sequences to the terminal.
#[must_use]
pub fn workspace_terminal(scan: &Scan, model: &Model, cones: &[Cone], style: Style) -> String {
    let mut ink = Ink::new(style);
    let [reachable, all] = scan.reachable();
    let share = |n: usize| percent(n as f64 / all.max(1) as f64);
    let tone = if reachable > 0 { Tone::Good } else { Tone::Before };
    ink.line(&[
        (Tone::Bold, &model.name),
        (Tone::Soft, &format!(" · {} · ", scan.output)),
        (tone, &format!("{} of {all} poses reachable", share(reachable))),
    ]);
    let is_scanned = |i: usize| scan.axes().any(|a| a.index == i);
    let fixed =
        (0..scan.names.len()).filter(|&i| !is_scanned(i)).map(|i| (i, scan.slices.first().map_or(scan.home_values[i], |s| s.at[i])));
    let fixed: Vec<String> = fixed.map(|(i, x)| named(scan, i, x)).collect();
    if !fixed.is_empty() {
        ink.wrapped("  fixed  ", &fixed.join(", "));
    }
    ink.heading("Reachable, of the poses that were scanned");
    let row = |cells: [&str; 5]| {
        format!("  {}{}{}{}  {}", left(cells[0], 14), right(cells[1], 12), right(cells[2], 12), right(cells[3], 12), cells[4])
    };
    ink.line(&[(Tone::Soft, &row(["coordinate", "home", "least", "most", "unit"]))]);
    for (i, axis) in scan.axes().enumerate() {
        let extent = scan.extents().map_or([f64::NAN; 2], |e| e[i]);
        let unit = scan.units[axis.index];
        let [home, least, most] = [scan.home_values[axis.index], extent[0], extent[1]].map(|x| shown(x, unit)[0].clone());
        ink.line(&[(Tone::Plain, &row([&scan.names[axis.index], &home, &least, &most, &shown(0.0, unit)[1]]))]);
    }
    let causes = scan.causes();
    if !causes.is_empty() {
        ink.heading("What limits");
    }
    for (cause, n) in causes.iter().take(CAUSES_MAX) {
        let what = format!("{} {}", Cause::NAMES[cause.kind()], clean(cause.place(model, cones)));
        ink.line(&[(Tone::Plain, "  "), (Tone::Plain, &left(&what, 44)), (Tone::Warn, &right(&share(*n), 8))]);
    }
    if causes.len() > CAUSES_MAX {
        ink.line(&[(Tone::Soft, &format!("  … and {} more", causes.len() - CAUSES_MAX))]);
    }
    ink.heading(&format!("Singularities (metres divided by {} m)", short(scan.length)));
    let line = |c: &pkm_dyn::workspace::Cell| {
        let [p, s, k] = [c.parallel, c.serial, c.condition].map(|x| significant(x, 3));
        format!("smallest singular value of dq/dx {p} (type 2), of dx/dq {s} (type 1), condition {k}")
    };
    ink.wrapped("  home   ", &line(&scan.home));
    if let Some((slice, cell, worst)) = scan.worst() {
        ink.wrapped("  worst  ", &format!("{} at {}", line(worst), pose(scan, slice, cell)));
    }
    ink.finish()
}

fn named(scan: &Scan, i: usize, x: f64) -> String {
    let [value, unit] = shown(x, scan.units[i]);
    format!("{} = {value} {unit}", scan.names[i])
}
