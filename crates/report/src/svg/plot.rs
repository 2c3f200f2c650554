//! A plot: grid, layers, tick labels and axis titles.

use super::Axis;
use crate::html::{esc, num};

/// Width of the drawing's own coordinates.
pub(super) const WIDTH: f64 = 2000.0;
/// Height of the drawing's own coordinates.
pub(super) const HEIGHT: f64 = 1000.0;

/// Rounds a coordinate; whole units are finer than a screen pixel and keep the file small.
#[expect(clippy::cast_possible_truncation, reason = "clamped to a few widths of the drawing")]
pub(super) fn whole(x: f64) -> i32 {
    x.clamp(-4000.0, 6000.0).round() as i32
}

/// The two axes of a plot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    /// Horizontal axis.
    pub(crate) x: Axis,
    /// Vertical axis.
    pub(crate) y: Axis,
}

impl Frame {
    /// Drawing coordinates of a point; none for what is no number.
    pub(super) fn place(&self, x: f64, y: f64) -> Option<(i32, i32)> {
        let (u, v) = (WIDTH * self.x.fraction(x), HEIGHT * (1.0 - self.y.fraction(y)));
        (u.is_finite() && v.is_finite()).then(|| (whole(u), whole(v)))
    }
}

/// A plot ready to be written.
#[derive(Debug, Clone)]
pub(crate) struct Plot<'a> {
    /// What the picture shows, read out by screen readers.
    pub(crate) title: &'a str,
    /// The axes.
    pub(crate) frame: &'a Frame,
    /// Horizontal axis title with unit; may be empty.
    pub(crate) x_label: &'a str,
    /// Vertical axis title with unit.
    pub(crate) y_label: &'a str,
    /// Style class that sets the height.
    pub(crate) class: &'a str,
    /// Drawn elements, back to front.
    pub(crate) layers: &'a str,
}

impl Plot<'_> {
    /// The plot as HTML with inline SVG.
    pub(crate) fn render(&self) -> String {
        let (mut grid, mut labels) = (String::new(), String::new());
        let ticks = self.frame.x.ticks();
        for (i, tick) in ticks.iter().copied().enumerate() {
            // Every other label goes where there is little room.
            let class = if ticks.len() > 4 && i % 2 == 1 { "xt odd" } else { "xt" };
            let f = self.frame.x.fraction(tick).clamp(0.0, 1.0);
            let u = whole(WIDTH * f);
            put!(grid, "M{u} 0V1000");
            put!(labels, r#"<span class="{class}" style="left:{:.2}%">{}</span>"#, 100.0 * f, num(&self.frame.x.label(tick)));
        }
        for tick in self.frame.y.ticks() {
            let f = 1.0 - self.frame.y.fraction(tick).clamp(0.0, 1.0);
            let v = whole(HEIGHT * f);
            put!(grid, "M0 {v}H2000");
            put!(labels, r#"<span class="yt" style="top:{:.2}%">{}</span>"#, 100.0 * f, num(&self.frame.y.label(tick)));
        }
        let zero = match self.frame.y.fraction(0.0) {
            f if (0.0..=1.0).contains(&f) => format!(r#"<path class="zero" d="M0 {}H2000"/>"#, whole(HEIGHT * (1.0 - f))),
            _ => String::new(),
        };
        let x_label = if self.x_label.is_empty() { String::new() } else { format!(r#"<div class="xl">{}</div>"#, esc(self.x_label)) };
        format!(
            concat!(
                r#"<div class="plot {}"><div class="yl">{}</div><div class="area">"#,
                r#"<svg role="img" viewBox="0 0 2000 1000" preserveAspectRatio="none"><title>{}</title>"#,
                r#"<path class="grid" d="{}"/>{}{}</svg><div class="ticks" aria-hidden="true">{}</div></div>{}</div>"#,
            ),
            self.class,
            esc(self.y_label),
            esc(self.title),
            grid,
            zero,
            self.layers,
            labels,
            x_label
        )
    }
}
