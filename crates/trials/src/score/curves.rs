//! Two pictures of a run: how often an effect is seen and named against its size, and how often a stated confidence is right.

use core::fmt::Write as _;

use super::judge::Marks;
use super::table::SIZES;
use super::tally::{Count, tally};
use crate::case::Level;
use crate::math::ln;

const WIDTH: f64 = 470.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 50.0;
/// Room for half of the last mark along x.
const RIGHT: f64 = 20.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 40.0;

/// A point: place along x between 0 and 1, and a count whose share is its height.
type Point = (f64, Count);

fn at(x: f64, y: f64) -> [f64; 2] {
    [LEFT + x * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - y * (HEIGHT - TOP - BOTTOM)]
}

/// Frame, grid of shares, marks along x and a caption.
fn frame(title: &str, caption: &str, marks: &[(f64, String)]) -> String {
    let mut out = format!(r#"<svg role="img" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}"><title>{title}</title>"#);
    for k in 0..=4 {
        let share = f64::from(k) / 4.0;
        let ([x, y], [end, _]) = (at(0.0, share), at(1.0, share));
        let _ = write!(out, r##"<line x1="{x:.1}" y1="{y:.1}" x2="{end:.1}" y2="{y:.1}" stroke="#ddd"/>"##);
        let _ = write!(out, r#"<text x="{:.1}" y="{:.1}" text-anchor="end">{:.0} %</text>"#, x - 6.0, y + 4.0, 100.0 * share);
    }
    for (place, label) in marks {
        let [x, y] = at(*place, 0.0);
        let _ = write!(out, r#"<text x="{x:.1}" y="{:.1}" text-anchor="middle">{label}</text>"#, y + 16.0);
    }
    let _ = write!(out, r#"<text x="{:.1}" y="{:.1}" text-anchor="middle">{caption}</text>"#, 0.5 * (LEFT + WIDTH), HEIGHT - 6.0);
    out
}

/// A line through shares, with their intervals; what was never tried is left out.
fn line(out: &mut String, points: &[Point], colour: &str, (order, label): (usize, &str)) {
    let mut path = Vec::new();
    for (x, count) in points {
        let Some([share, low, high]) = count.share() else { continue };
        let ([px, py], [_, top], [_, bottom]) = (at(*x, share), at(*x, high), at(*x, low));
        // Beside each other, so that intervals of two lines can both be read.
        let px = px + 3.0 * order as f64;
        path.push(format!("{px:.1},{py:.1}"));
        let _ = write!(out, r#"<line x1="{px:.1}" y1="{top:.1}" x2="{px:.1}" y2="{bottom:.1}" stroke="{colour}" stroke-opacity="0.5"/>"#);
        let _ =
            write!(out, r#"<circle cx="{px:.1}" cy="{py:.1}" r="3.5" fill="{colour}"><title>{}/{}</title></circle>"#, count.yes, count.all);
    }
    let _ = write!(out, r#"<polyline points="{}" fill="none" stroke="{colour}" stroke-width="1.5"/>"#, path.join(" "));
    let _ = write!(out, r#"<text x="{:.1}" y="16" fill="{colour}">{label}</text>"#, LEFT + 130.0 * order as f64);
}

/// Share of concealed effects that are seen, named, and named up to what cannot be told apart, against their size; dashed, how often
/// something is said of a healthy robot.
pub(crate) fn detection(marks: &[Marks]) -> String {
    let mut bins = Vec::new();
    for (low, high) in SIZES {
        let t = tally("", marks, |m| m.level <= Level::L4 && m.size.is_some_and(|s| s >= low && s < high));
        let sizes: Vec<f64> =
            marks.iter().filter(|m| m.level <= Level::L4).filter_map(|m| m.size).filter(|s| *s >= low && *s < high).collect();
        if t.cases > 0 {
            // At the mean of the logarithms of the sizes that there are.
            bins.push((sizes.iter().map(|s| ln(*s)).sum::<f64>() / sizes.len() as f64, t));
        }
    }
    let ends = bins.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |e, (x, _)| [e[0].min(*x), e[1].max(*x)]);
    let place = |x: f64| if ends[1] > ends[0] { 0.05 + 0.9 * (x - ends[0]) / (ends[1] - ends[0]) } else { 0.5 };
    let labels: Vec<(f64, String)> = bins.iter().map(|(x, _)| (place(*x), format!("{:.1}", crate::math::exp(*x)))).collect();
    let mut out = frame("Detection against size", "size over the smallest that can be detected", &labels);
    let points = |of: &dyn Fn(&super::tally::Tally) -> Count| bins.iter().map(|(x, t)| (place(*x), of(t))).collect::<Vec<Point>>();
    line(&mut out, &points(&|t| t.detected), "#555", (0, "anything said"));
    line(&mut out, &points(&|t| t.in_set), "#2c5fa3", (1, "named, in the set"));
    line(&mut out, &points(&|t| t.first), "#1f7a4d", (2, "named first"));
    if let Some([share, ..]) = tally("", marks, |m| m.level.is_healthy()).alarms.share() {
        let ([x, y], [end, _]) = (at(0.0, share), at(1.0, share));
        let _ = write!(
            out,
            r##"<line x1="{x:.1}" y1="{y:.1}" x2="{end:.1}" y2="{y:.1}" stroke="#a33a2c" stroke-dasharray="5 4"><title>false alarms of healthy robots</title></line>"##
        );
    }
    out.push_str("</svg>");
    out
}

/// Share of findings that are right against the confidence they were stated with; on the grey line what is stated is true.
pub(crate) fn reliability(marks: &[Marks]) -> String {
    let bins = tally("", marks, |_| true).calibration;
    let labels = [0.0, 0.25, 0.5, 0.75, 1.0].map(|x| (x, format!("{x:.2}")));
    let mut out = frame("Stated confidence and how often it is right", "stated confidence", &labels);
    let ([x0, y0], [x1, y1]) = (at(0.0, 0.0), at(1.0, 1.0));
    let _ = write!(out, r##"<line x1="{x0:.1}" y1="{y0:.1}" x2="{x1:.1}" y2="{y1:.1}" stroke="#999"/>"##);
    let points: Vec<Point> = bins.iter().map(|(_, _, mean, count)| (*mean, *count)).collect();
    line(&mut out, &points, "#2c5fa3", (0, "findings that are right"));
    out.push_str("</svg>");
    out
}
