//! A finished scan, and what it says in a few numbers.

use alloc::string::String;
use alloc::vec::Vec;

use super::{Axis, Cause, Cell, Margins, Slice};

/// A scanned workspace.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// Name of the output.
    pub output: String,
    /// Names of the prescribed coordinates.
    pub names: Vec<String>,
    /// Their units.
    pub units: Vec<&'static str>,
    /// Their values at home `[m | rad]`.
    pub home_values: Vec<f64>,
    /// The home pose.
    pub home: Cell,
    /// Length that metres are divided by `[m]`.
    pub length: f64,
    /// What a cell had to satisfy.
    pub margins: Margins,
    /// The axis along a row.
    pub columns: Axis,
    /// The axis from row to row.
    pub rows: Option<Axis>,
    /// The axis from slice to slice.
    pub stack: Option<Axis>,
    /// The slices, in the order of the stack.
    pub slices: Vec<Slice>,
}

impl Scan {
    /// The scanned axes: columns, rows, stack.
    pub fn axes(&self) -> impl Iterator<Item = &Axis> {
        core::iter::once(&self.columns).chain(self.rows.as_ref()).chain(self.stack.as_ref())
    }

    /// Values of all prescribed coordinates at a cell `[m | rad]`.
    #[must_use]
    pub fn values(&self, slice: usize, cell: usize) -> Vec<f64> {
        let mut out = self.slices[slice].at.clone();
        let n = self.columns.values.len();
        out[self.columns.index] = self.columns.values[cell % n];
        if let Some(rows) = &self.rows {
            out[rows.index] = rows.values[cell / n];
        }
        out
    }

    /// Every cell, with its slice and its place there.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize, &Cell)> {
        self.slices.iter().enumerate().flat_map(|(s, slice)| slice.cells.iter().enumerate().map(move |(i, c)| (s, i, c)))
    }

    /// Number of reachable cells and of all.
    #[must_use]
    pub fn reachable(&self) -> [usize; 2] {
        let all = self.cells().count();
        [self.cells().filter(|(.., c)| c.cause == Cause::Reachable).count(), all]
    }

    /// What limits the others, with the number of cells, the most frequent first.
    #[must_use]
    pub fn causes(&self) -> Vec<(Cause, usize)> {
        let mut all: Vec<Cause> = self.cells().map(|(.., c)| c.cause).filter(|c| *c != Cause::Reachable).collect();
        all.sort_unstable();
        let mut out: Vec<(Cause, usize)> = Vec::new();
        for cause in all {
            match out.last_mut() {
                Some((last, n)) if *last == cause => *n += 1,
                _ => out.push((cause, 1)),
            }
        }
        out.sort_by_key(|(cause, n)| (core::cmp::Reverse(*n), *cause));
        out
    }

    /// Least and largest reachable value of every axis `[m | rad]`; none where nothing is reachable.
    #[must_use]
    pub fn extents(&self) -> Option<Vec<[f64; 2]>> {
        let mut out: Vec<[f64; 2]> = self.axes().map(|_| [f64::INFINITY, f64::NEG_INFINITY]).collect();
        for (slice, cell, _) in self.cells().filter(|(.., c)| c.cause == Cause::Reachable) {
            let values = self.values(slice, cell);
            for (extent, axis) in out.iter_mut().zip(self.axes()) {
                *extent = [extent[0].min(values[axis.index]), extent[1].max(values[axis.index])];
            }
        }
        out.first().is_some_and(|e| e[0] <= e[1]).then_some(out)
    }

    /// The reachable cell with the largest condition number: slice and place.
    #[must_use]
    pub fn worst(&self) -> Option<(usize, usize, &Cell)> {
        self.cells().filter(|(.., c)| c.cause == Cause::Reachable).max_by(|a, b| a.2.condition.total_cmp(&b.2.condition))
    }
}
