//! Flood fill from the home pose through neighbouring cells.

use alloc::collections::VecDeque;
use alloc::vec;
use alloc::vec::Vec;

use super::{Axis, Cause, Cell, Cone, Margins, Slice};
use crate::data::Data;
use crate::loops::{Coordinate, Guide, Singularities};
use crate::model::Model;

/// Limits are kept up to rounding `[m | rad]`.
const SLACK: f64 = 1e-9;

/// Per axis, so many cells are tried directly from home when their neighbours do not lead to them: islands of a slice.
const LANDINGS: usize = 5;

/// What one scan needs, and room for one pose at a time. A clone scans another slice at the same time.
#[derive(Debug, Clone)]
pub struct Scanner<'m> {
    model: &'m Model,
    data: Data,
    guide: Guide,
    singularities: Singularities,
    cones: Vec<Cone>,
    margins: Margins,
    home: Vec<f64>,
    home_values: Vec<f64>,
    /// Orientation of `dx/dq_act` at home; zero where a change of it means nothing.
    orientation: f64,
}

impl<'m> Scanner<'m> {
    /// From the closed pose `home`. The cones' list and the margins' must be of one length.
    ///
    /// # Panics
    /// With a margin for another number of cones.
    #[must_use]
    pub fn new(model: &'m Model, home: &[f64], guide: Guide, singularities: Singularities, (cones, margins): (Vec<Cone>, Margins)) -> Self {
        assert_eq!(cones.len(), margins.cone.len(), "one limit per cone");
        let (mut data, n) = (Data::new(model), guide.prescribed().len());
        let mut out = Self {
            model,
            guide,
            singularities,
            cones,
            margins,
            home: home.to_vec(),
            home_values: vec![0.0; n],
            orientation: 0.0,
            data: data.clone(),
        };
        out.guide.values(model, &mut data, home, &mut out.home_values);
        // Where joints are prescribed, a stretched arm (type 1) may be passed, and turns the sign as well.
        let is_output = out.guide.prescribed().iter().all(|c| matches!(c, Coordinate::Output(_)));
        let at_home = out.singularities.at(model, &mut data, home);
        out.orientation = if is_output { at_home.orientation } else { 0.0 };
        out.data = data;
        out
    }

    /// Values of the prescribed coordinates at home `[m | rad]`.
    #[must_use]
    pub fn home_values(&self) -> &[f64] {
        &self.home_values
    }

    /// The cones that are limited.
    #[must_use]
    pub fn cones(&self) -> &[Cone] {
        &self.cones
    }

    /// The home pose as a cell.
    pub fn home_cell(&mut self) -> Cell {
        self.data.q.copy_from_slice(&self.home);
        self.judge()
    }

    /// The cell at `values` of the prescribed coordinates `[m | rad]`, reached from home in a straight line.
    pub fn probe(&mut self, values: &[f64]) -> Cell {
        self.data.q.copy_from_slice(&self.home);
        self.advance(values)
    }

    /// As [`Scanner::probe`], from the pose of the cell before.
    pub fn advance(&mut self, values: &[f64]) -> Cell {
        if self.guide.move_to(self.model, &mut self.data, values) { self.judge() } else { OPEN }
    }

    /// Tree coordinates of the last cell `[m | rad]`.
    #[must_use]
    pub fn q(&self) -> &[f64] {
        &self.data.q
    }

    /// Judges the closed pose in `data.q`.
    fn judge(&mut self) -> Cell {
        let q = core::mem::take(&mut self.data.q);
        let s = self.singularities.at(self.model, &mut self.data, &q);
        self.data.q = q;
        let is_crossed = s.orientation * self.orientation < 0.0;
        let mut cause = self.beyond_a_limit();
        if cause == Cause::Reachable && (s.parallel < self.margins.parallel || s.parallel.is_nan()) {
            cause = Cause::Singular;
        }
        if cause == Cause::Reachable && s.condition > self.margins.condition {
            cause = Cause::Condition;
        }
        if is_crossed {
            cause = Cause::Beyond;
        }
        Cell { cause, parallel: s.parallel, serial: s.serial, condition: s.condition }
    }

    fn beyond_a_limit(&self) -> Cause {
        let narrow = |i: usize| u16::try_from(i).unwrap_or(u16::MAX);
        let is_beyond = |&j: &usize| {
            let (l, q) = (&self.model.joints[j].limits, self.data.q[j]);
            q < l.lower - SLACK || q > l.upper + SLACK
        };
        if let Some(&j) = self.model.actuators.iter().find(|j| is_beyond(j)) {
            return Cause::Stroke(narrow(j));
        }
        if let Some(j) = (0..self.model.nv()).find(is_beyond) {
            return Cause::Passive(narrow(j));
        }
        let leans = self.cones.iter().zip(&self.margins.cone);
        leans
            .enumerate()
            .find(|(_, (cone, limit))| cone.lean(&self.data) > *limit + SLACK)
            .map_or(Cause::Reachable, |(i, _)| Cause::Cone(narrow(i)))
    }

    /// Scans one slice: `columns` run along a row, `rows` from row to row; `at` are the values of the other prescribed coordinates
    /// `[m | rad]`. `each` is called when a cell is settled.
    pub fn slice(&mut self, columns: &Axis, rows: Option<&Axis>, at: &[f64], each: &mut dyn FnMut()) -> Slice {
        let size = [columns.values.len(), rows.map_or(1, |r| r.values.len())];
        let mut flood =
            Flood { cells: vec![OPEN; size[0] * size[1]], is_known: vec![false; size[0] * size[1]], size, queue: VecDeque::new() };
        let mut values = at.to_vec();
        let place = |values: &mut [f64], [i, k]: [usize; 2]| {
            values[columns.index] = columns.values[i];
            if let Some(rows) = rows {
                values[rows.index] = rows.values[k];
            }
        };
        let nearest = |axis: Option<&Axis>| axis.map_or(0, |a| nearest(&a.values, self.home_values[a.index]));
        for landing in landings(size, [nearest(Some(columns)), nearest(rows)]) {
            if flood.is_known[flood.index(landing)] {
                continue;
            }
            place(&mut values, landing);
            let cell = self.probe(&values);
            flood.settle(landing, cell, &self.data.q, each);
            while let Some((from, q)) = flood.queue.pop_front() {
                for to in flood.neighbours(from) {
                    self.data.q.copy_from_slice(&q);
                    place(&mut values, to);
                    let cell = self.advance(&values);
                    flood.settle(to, cell, &self.data.q, each);
                }
            }
        }
        let mut at = at.to_vec();
        for axis in [Some(columns), rows].into_iter().flatten() {
            at[axis.index] = self.home_values[axis.index];
        }
        Slice { at, cells: flood.cells }
    }
}

/// A cell whose loops do not close.
const OPEN: Cell = Cell { cause: Cause::Open, parallel: f64::NAN, serial: f64::NAN, condition: f64::NAN };

/// The state of a fill. Poses are kept only along its front.
struct Flood {
    cells: Vec<Cell>,
    is_known: Vec<bool>,
    size: [usize; 2],
    queue: VecDeque<([usize; 2], Vec<f64>)>,
}

impl Flood {
    fn index(&self, [i, k]: [usize; 2]) -> usize {
        k * self.size[0] + i
    }

    /// Takes note of a cell that closes; one that does not may still be reached from elsewhere.
    fn settle(&mut self, at: [usize; 2], cell: Cell, q: &[f64], each: &mut dyn FnMut()) {
        let index = self.index(at);
        if cell.cause == Cause::Open {
            return;
        }
        self.cells[index] = cell;
        self.is_known[index] = true;
        each();
        if cell.cause != Cause::Beyond {
            self.queue.push_back((at, q.to_vec()));
        }
    }

    /// Neighbours that are not known yet.
    fn neighbours(&self, [i, k]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> + use<> {
        let all = [
            (i > 0).then(|| [i - 1, k]),
            (i + 1 < self.size[0]).then_some([i + 1, k]),
            (k > 0).then(|| [i, k - 1]),
            (k + 1 < self.size[1]).then_some([i, k + 1]),
        ];
        let unknown: Vec<[usize; 2]> = all.into_iter().flatten().filter(|&at| !self.is_known[self.index(at)]).collect();
        unknown.into_iter()
    }
}

fn nearest(values: &[f64], to: f64) -> usize {
    (0..values.len()).fold(0, |best, i| if (values[i] - to).abs() < (values[best] - to).abs() { i } else { best })
}

/// Cells to begin from, the nearest to home first, then a coarse lattice over the slice.
fn landings(size: [usize; 2], home: [usize; 2]) -> Vec<[usize; 2]> {
    let lattice = |n: usize| (0..LANDINGS).map(move |i| (2 * i + 1) * n / (2 * LANDINGS));
    let mut all: Vec<[usize; 2]> = lattice(size[1]).flat_map(|k| lattice(size[0]).map(move |i| [i, k])).collect();
    let distance = |c: &[usize; 2]| c[0].abs_diff(home[0]).pow(2) + c[1].abs_diff(home[1]).pow(2);
    all.sort_by_key(distance);
    all.insert(0, home);
    all.dedup();
    all
}
