//! A picture of one signal over time and over another, as an SVG file of a few kB.

use std::fs;
use std::path::Path;

/// Most points of a panel.
const POINTS_MAX: usize = 500;

/// Width and height of a panel's drawing area.
const AREA: [f64; 2] = [300.0, 190.0];

/// Room for numbers and titles: left of a panel, above it, below it.
const ROOM: [f64; 3] = [58.0, 24.0, 42.0];

/// A recording as columns.
pub(crate) struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a CSV file that pkm wrote.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let mut lines = text.lines().filter(|l| !l.starts_with('#'));
        let names = lines.next().unwrap_or_default().split(',').map(str::to_string).collect();
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect();
        Ok(Self { names, rows: lines.map(row).collect() })
    }

    /// A column by name.
    pub(crate) fn column(&self, name: &str) -> Result<Vec<f64>, String> {
        let k = self.names.iter().position(|n| n == name).ok_or_else(|| format!("no column {name:?}"))?;
        Ok(self.rows.iter().map(|row| row.get(k).copied().unwrap_or(f64::NAN)).collect())
    }
}

/// Central differences of `y` over `x`.
pub(crate) fn derivative(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let at = |i: usize| {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
        (y[b] - y[a]) / (x[b] - x[a])
    };
    (0..n).map(at).collect()
}

/// One panel: points, or a line.
pub(crate) struct Panel<'a> {
    pub(crate) x: &'a [f64],
    pub(crate) y: &'a [f64],
    pub(crate) label: &'a str,
    pub(crate) is_line: bool,
}

/// Panels side by side, with one title of their vertical axes.
pub(crate) fn svg(panels: &[Panel<'_>], title: &str) -> String {
    let [width, height] = AREA;
    let [left, top, below] = ROOM;
    let whole = [(left + width + 12.0) * panels.len() as f64, top + height + below];
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{0}\" font-family=\"sans-serif\" font-size=\"11\" \
         fill=\"#59626c\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><text x=\"6\" y=\"14\">{title}</text>\n",
        whole[0], whole[1]
    );
    for (k, panel) in panels.iter().enumerate() {
        out += &format!("<g transform=\"translate({} {top})\">{}</g>\n", left + k as f64 * (left + width + 12.0), draw(panel));
    }
    out + "</svg>\n"
}

/// A panel within its drawing area.
fn draw(panel: &Panel<'_>) -> String {
    let [width, height] = AREA;
    let (x, y) = (Axis::over(panel.x), Axis::over(panel.y));
    let (u, v) = (|value: f64| width * x.share(value), |value: f64| height * (1.0 - y.share(value)));
    let mut out = String::new();
    for tick in x.ticks() {
        let u = u(tick);
        out += &format!(
            "<path stroke=\"#e8ebee\" d=\"M{u:.0} 0V{height}\"/><text x=\"{u:.0}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            height + 14.0,
            x.text(tick)
        );
    }
    for tick in y.ticks() {
        let v = v(tick);
        let ink = if tick == 0.0 { "#aab2bb" } else { "#e8ebee" };
        out += &format!(
            "<path stroke=\"{ink}\" d=\"M0 {v:.0}H{width}\"/><text x=\"-6\" y=\"{:.0}\" text-anchor=\"end\">{}</text>",
            v + 4.0,
            y.text(tick)
        );
    }
    let every = panel.x.len().div_ceil(POINTS_MAX).max(1);
    let points = panel.x.iter().zip(panel.y).step_by(every).filter(|(a, b)| a.is_finite() && b.is_finite());
    let (mut d, mut is_first) = (String::new(), true);
    for (a, b) in points {
        let verb = if is_first || !panel.is_line { "M" } else { "L" };
        d += &format!("{verb}{:.0} {:.0}{}", u(*a), v(*b), if panel.is_line { "" } else { "h0" });
        is_first = false;
    }
    let pen = if panel.is_line { "stroke-width=\"1.4\"" } else { "stroke-width=\"3\" stroke-linecap=\"round\"" };
    out += &format!("<path fill=\"none\" stroke=\"#0072b2\" {pen} d=\"{d}\"/>");
    out + &format!("<text x=\"{width}\" y=\"{}\" text-anchor=\"end\">{}</text>", height + 32.0, panel.label)
}

/// A linear axis with round numbers.
struct Axis {
    lower: f64,
    upper: f64,
    step: f64,
}

impl Axis {
    fn over(values: &[f64]) -> Self {
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        let span = if high > low { high - low } else { 1.0 };
        let rough = span / 6.0;
        let decades = (-12..12).flat_map(|e: i32| ["1", "2", "5"].map(|m| format!("{m}e{e}").parse().unwrap_or(f64::NAN)));
        let step = decades.into_iter().find(|s: &f64| *s >= rough).unwrap_or(rough);
        let pad = 0.03 * span;
        Self { lower: low - pad, upper: low + span + pad, step }
    }

    fn share(&self, value: f64) -> f64 {
        (value - self.lower) / (self.upper - self.lower)
    }

    fn ticks(&self) -> Vec<f64> {
        let first = (self.lower / self.step).ceil();
        (0..8)
            .map(|i| (first + f64::from(i)) * self.step)
            .take_while(|t| *t <= self.upper)
            .map(|t| if t == 0.0 { 0.0 } else { t })
            .collect()
    }

    /// As many decimals as the step has.
    fn text(&self, tick: f64) -> String {
        let scaled = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5].map(|scale| self.step * scale);
        let decimals = scaled.iter().position(|s| (s - s.round()).abs() < 1e-6).unwrap_or(6);
        format!("{tick:.decimals$}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_round_numbers() {
        let axis = Axis::over(&[-0.031, 0.07, f64::NAN]);
        assert_eq!(axis.ticks().iter().map(|t| axis.text(*t)).collect::<Vec<_>>(), ["−0.02", "0.00", "0.02", "0.04", "0.06"]);
        assert!((2..=6).contains(&Axis::over(&[3.0, 3.0]).ticks().len()), "a constant has an axis too");
    }

    #[test]
    fn a_derivative_of_a_line_is_its_slope() {
        assert_eq!(derivative(&[0.0, 1.0, 3.0], &[1.0, 3.0, 7.0]), [2.0, 2.0, 2.0]);
    }

    #[test]
    fn a_picture_is_small_and_balanced() {
        let x: Vec<f64> = (0..5000).map(|i| f64::from(i) * 0.01).collect();
        let panel = |is_line| Panel { x: &x, y: &x, label: "time [s]", is_line };
        let text = svg(&[panel(true), panel(false)], "effort [N]");
        assert!(text.len() < 14_000, "{}", text.len());
        assert_eq!(text.matches("<g ").count(), text.matches("</g>").count());
        assert!(!text.contains("NaN"));
    }
}
