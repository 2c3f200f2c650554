//! A heat map: cells of one level merged into runs, one path per level, and the edges between kinds of cells.

use super::Frame;
use super::plot::{HEIGHT, WIDTH, whole};

/// Colours of the levels, dark to bright (viridis, sixteen steps): even steps of lightness, also in print and for the colour-blind.
pub(crate) const LEVELS: [&str; 16] = [
    "#440154", "#481a6c", "#472f7d", "#414487", "#39568c", "#31688e", "#2a788e", "#23888e", "#1f988b", "#22a884", "#35b779", "#54c568",
    "#7ad151", "#a5db36", "#d2e21b", "#fde725",
];

/// The grid of a heat map, row by row from the bottom.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    /// Cells in a row.
    pub(crate) columns: usize,
    /// Rows.
    pub(crate) rows: usize,
}

impl Grid {
    /// Left and right edge of the cells `from` up to but without `to`.
    fn edge_u(self, i: usize) -> i32 {
        whole(WIDTH * i as f64 / self.columns as f64)
    }

    fn edge_v(self, k: usize) -> i32 {
        whole(HEIGHT * (1.0 - k as f64 / self.rows as f64))
    }

    /// One path over every cell for which `is_of` holds; neighbours in a row become one rectangle.
    pub(crate) fn cells(self, attribute: &str, is_of: impl Fn(usize) -> bool) -> String {
        let mut d = String::new();
        for k in 0..self.rows {
            let (top, bottom) = (self.edge_v(k + 1), self.edge_v(k));
            let mut i = 0;
            while i < self.columns {
                let from = i;
                while i < self.columns && is_of(k * self.columns + i) {
                    i += 1;
                }
                if i > from {
                    put!(d, "M{} {}H{}V{}H{}z", self.edge_u(from), top, self.edge_u(i), bottom, self.edge_u(from));
                } else {
                    i += 1;
                }
            }
        }
        if d.is_empty() { d } else { format!(r#"<path {attribute} d="{d}"/>"#) }
    }

    /// One path along every edge between two neighbouring cells for which `is_edge` holds.
    pub(crate) fn edges(self, class: &str, is_edge: impl Fn(usize, usize) -> bool) -> String {
        let mut d = String::new();
        for k in 0..self.rows {
            for i in 0..self.columns {
                let at = k * self.columns + i;
                let (right, top) = (self.edge_u(i + 1), self.edge_v(k + 1));
                if i + 1 < self.columns && is_edge(at, at + 1) {
                    put!(d, "M{right} {top}V{}", self.edge_v(k));
                }
                if k + 1 < self.rows && is_edge(at, at + self.columns) {
                    put!(d, "M{} {top}H{right}", self.edge_u(i));
                }
            }
        }
        if d.is_empty() { d } else { format!(r#"<path class="edge {class}" d="{d}"/>"#) }
    }
}

/// A cross at a point inside the frame.
pub(crate) fn cross(frame: &Frame, x: f64, y: f64) -> String {
    let inside = |f: f64| (0.0..=1.0).contains(&f);
    match frame.place(x, y) {
        Some((u, v)) if inside(frame.x.fraction(x)) && inside(frame.y.fraction(y)) => {
            let d = format!("M{} {v}h40M{u} {}v40", u - 20, v - 20);
            format!(r#"<path class="cross under" d="{d}"/><path class="cross" d="{d}"/>"#)
        }
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_a_level_are_one_rectangle_and_cover_the_picture() {
        let grid = Grid { columns: 4, rows: 2 };
        assert_eq!(grid.cells("fill=\"a\"", |_| true).matches('M').count(), 2);
        assert_eq!(grid.cells("fill=\"a\"", |c| c != 1).matches('M').count(), 3);
        assert_eq!(grid.cells("fill=\"a\"", |c| c == 4), r#"<path fill="a" d="M0 0H500V500H0z"/>"#);
        assert!(grid.cells("fill=\"a\"", |_| false).is_empty());
    }

    #[test]
    fn edges_lie_between_the_cells_that_differ() {
        let grid = Grid { columns: 2, rows: 2 };
        let left = |c: usize| c.is_multiple_of(2);
        assert_eq!(grid.edges("k", |a, b| left(a) != left(b)), r#"<path class="edge k" d="M1000 500V1000M1000 0V500"/>"#);
    }
}
