//! The page of a scanned workspace: a heat map per slice, what limits, how far it reaches.

use pkm_dyn::Model;
use pkm_dyn::math::{log10, powf};
use pkm_dyn::workspace::{Axis as Scanned, Cause, Cell, Cone, Scan, Slice};

use super::page::STYLE;
use super::{esc, num};
use crate::format::{percent, short, significant};
use crate::pose::shown;
use crate::svg::{Axis, Frame, Grid, LEVELS, Plot, cross};

/// Decades that the colours span at most: below, everything is as bad.
const DECADES: f64 = 3.0;

/// A scanned workspace as one self-contained HTML page: no network, no script, pictures inline.
///
/// The colour is the distance from type 2 where the robot has loops, else from type 1, which is the only one that a tree has.
#[must_use]
pub fn workspace_html(scan: &Scan, model: &Model, cones: &[Cone]) -> String {
    let colour = Colour::of(scan, model);
    let [reachable, all] = scan.reachable();
    let mut body = format!(
        concat!(
            r#"<header><p class="eyebrow">Workspace of {}</p><h1>{}</h1><p class="outcome found">{} of {} poses reachable</p>"#,
            r#"<p class="answer">{}</p></header>"#,
        ),
        esc(&scan.output),
        esc(&model.name),
        num(&percent(reachable as f64 / all.max(1) as f64)),
        all,
        esc(&answer(scan)),
    );
    put!(body, "<section><h2>Slices</h2>{}<div class=\"maps\">", legend(scan, &colour));
    for slice in &scan.slices {
        body.push_str(&map(scan, slice, &colour));
    }
    put!(body, "</div></section><section><h2>What limits</h2>{}</section>", causes(scan, model, cones));
    put!(body, "<section><h2>How far it reaches</h2>{}</section>", extents(scan));
    put!(
        body,
        concat!(
            "<footer>Poses are followed from home from cell to cell, so all belong to one assembly; metres are divided by {} m to compare ",
            "them with radians. Rotation is Rx(rx)·Ry(ry)·Rz(rz).</footer>"
        ),
        num(&short(scan.length))
    );
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">",
            "<title>{} – workspace</title><style>{}</style></head>\n<body><main>{}</main></body></html>\n",
        ),
        esc(&model.name),
        STYLE,
        body
    )
}

fn answer(scan: &Scan) -> String {
    let name = |a: &Scanned| scan.names[a.index].clone();
    let scanned: Vec<String> = scan.axes().map(|a| format!("{} ({} values)", name(a), a.values.len())).collect();
    let is_fixed = |i: &usize| scan.axes().all(|a| a.index != *i);
    let fixed: Vec<String> = (0..scan.names.len())
        .filter(is_fixed)
        .map(|i| {
            let [value, unit] = shown(scan.slices.first().map_or(scan.home_values[i], |s| s.at[i]), scan.units[i]);
            format!("{} = {value} {unit}", scan.names[i])
        })
        .collect();
    let fixed = if fixed.is_empty() { String::new() } else { format!(", with {}", fixed.join(", ")) };
    format!("Scanned over {}{fixed}.", scanned.join(", "))
}

/// What the colour of a cell means.
struct Colour {
    /// In words.
    title: &'static str,
    value: fn(&Cell) -> f64,
    lower: f64,
    upper: f64,
}

impl Colour {
    fn of(scan: &Scan, model: &Model) -> Self {
        let (title, value): (_, fn(&Cell) -> f64) = if model.is_constrained() {
            ("distance from type 2 singularities: smallest singular value of dq/dx", |c| c.parallel)
        } else {
            ("distance from type 1 singularities: smallest singular value of dx/dq", |c| c.serial)
        };
        let is_shown = |x: &f64| x.is_finite() && *x > 0.0;
        let reachable = || scan.cells().filter(|(.., c)| c.cause == Cause::Reachable).map(|(.., c)| value(c)).filter(is_shown);
        let upper = reachable().fold(f64::MIN_POSITIVE, f64::max);
        let lower = reachable().fold(upper, f64::min).max(upper * powf(10.0, -DECADES));
        Self { title, value, lower, upper: upper.max(lower * 1.01) }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the number of levels")]
    fn level(&self, cell: &Cell) -> usize {
        let share = log10((self.value)(cell) / self.lower) / log10(self.upper / self.lower);
        if share.is_finite() { (share * LEVELS.len() as f64).clamp(0.0, LEVELS.len() as f64 - 1.0) as usize } else { 0 }
    }
}

fn legend(scan: &Scan, colour: &Colour) -> String {
    let mut out = format!(r#"<p class="soft">Colour: {} (logarithmic scale).</p><div class="ramp">"#, colour.title);
    for level in LEVELS {
        put!(out, r#"<i style="background:{level}"></i>"#);
    }
    let middle = pkm_dyn::math::sqrt(colour.lower * colour.upper);
    out.push_str(r#"</div><div class="ramp-ends">"#);
    for end in [colour.lower, middle, colour.upper] {
        put!(out, "<span>{}</span>", num(&significant(end, 2)));
    }
    out.push_str(r#"</div><p class="legend">"#);
    let is_there = |kind: usize| scan.cells().any(|(.., c)| c.cause.kind() == kind);
    for (kind, name) in Cause::NAMES.iter().enumerate().skip(1).filter(|(kind, _)| is_there(*kind)) {
        put!(out, r#"<span class="key cause k{kind}">{name}</span>"#);
    }
    out.push_str("</p>");
    out
}

/// Lower and upper edge of the cells of an axis, as shown, and its label.
fn frame_axis(scan: &Scan, axis: &Scanned) -> Option<(Axis, String)> {
    let unit = scan.units[axis.index];
    let (first, last) = (*axis.values.first()?, *axis.values.last()?);
    let half = if axis.values.len() > 1 { 0.5 * (last - first) / (axis.values.len() - 1) as f64 } else { 0.5 };
    let factor = if unit == "rad" { 1.0_f64.to_degrees() } else { 1.0 };
    let [_, shown_unit] = shown(0.0, unit);
    let label = format!("{} [{shown_unit}]", scan.names[axis.index]);
    Some((Axis::between((first - half) * factor, (last + half) * factor, 6.0)?, label))
}

fn map(scan: &Scan, slice: &Slice, colour: &Colour) -> String {
    let grid = Grid { columns: scan.columns.values.len(), rows: scan.rows.as_ref().map_or(1, |r| r.values.len()) };
    let strip = || Axis::between(0.0, 1.0, 1.0).map(|a| (a, String::new()));
    let vertical = scan.rows.as_ref().map_or_else(strip, |r| frame_axis(scan, r));
    let (Some((x, x_label)), Some((y, y_label))) = (frame_axis(scan, &scan.columns), vertical) else { return String::new() };
    let cell = |i: usize| &slice.cells[i];
    let is_free = |i: usize| cell(i).cause == Cause::Reachable;
    let mut layers = String::new();
    for (level, fill) in LEVELS.iter().enumerate() {
        layers.push_str(&grid.cells(&format!("fill=\"{fill}\""), |i| is_free(i) && colour.level(cell(i)) == level));
    }
    for kind in 1..Cause::NAMES.len() {
        layers.push_str(&grid.cells(&format!("class=\"out k{kind}\""), |i| cell(i).cause.kind() == kind));
    }
    for kind in 1..Cause::NAMES.len() {
        let is_outside = |i: usize| cell(i).cause.kind() == kind;
        layers.push_str(&grid.edges(&format!("k{kind}"), |a, b| is_free(a) && is_outside(b) || is_free(b) && is_outside(a)));
    }
    let frame = Frame { x, y };
    let degrees = |i: usize| scan.home_values[i] * if scan.units[i] == "rad" { 1.0_f64.to_degrees() } else { 1.0 };
    let is_home = scan.stack.as_ref().is_none_or(|s| (slice.at[s.index] - scan.home_values[s.index]).abs() < 1e-9);
    if is_home {
        layers.push_str(&cross(&frame, degrees(scan.columns.index), scan.rows.as_ref().map_or(0.5, |r| degrees(r.index))));
    }
    let free = (0..slice.cells.len()).filter(|&i| is_free(i)).count();
    let title = scan.stack.as_ref().map_or("The scanned slice".to_string(), |s| {
        let [value, unit] = shown(slice.at[s.index], scan.units[s.index]);
        format!("{} = {value} {unit}", scan.names[s.index])
    });
    let class = if scan.rows.is_some() { "map" } else { "strip" };
    let plot = Plot { title: &title, frame: &frame, x_label: &x_label, y_label: &y_label, class, layers: &layers };
    let share = percent(free as f64 / slice.cells.len().max(1) as f64);
    format!("<figure><h3>{} <small>{} reachable</small></h3>{}</figure>", num(&esc(&title).to_string()), num(&share), plot.render())
}

fn causes(scan: &Scan, model: &Model, cones: &[Cone]) -> String {
    let all = scan.reachable()[1].max(1);
    let mut out = String::from(
        r#"<div class="scroll"><table><thead><tr><th>cause</th><th>where</th><th class="n">poses</th><th class="n">share</th></tr></thead><tbody>"#,
    );
    for (cause, n) in scan.causes() {
        put!(
            out,
            r#"<tr><th><span class="key cause k{}">{}</span></th><td>{}</td><td class="n">{n}</td><td class="n">{}</td></tr>"#,
            cause.kind(),
            Cause::NAMES[cause.kind()],
            esc(cause.place(model, cones)),
            num(&percent(n as f64 / all as f64))
        );
    }
    out.push_str("</tbody></table></div>");
    out
}

fn extents(scan: &Scan) -> String {
    let Some(extents) = scan.extents() else { return "<p>Nothing is reachable.</p>".to_string() };
    let mut out = String::from(
        r#"<div class="scroll"><table><thead><tr><th>coordinate</th><th class="n">home</th><th class="n">least</th><th class="n">most</th><th>unit</th></tr></thead><tbody>"#,
    );
    for ([least, most], axis) in extents.iter().zip(scan.axes()) {
        let unit = scan.units[axis.index];
        let [home, least, most] = [scan.home_values[axis.index], *least, *most].map(|x| num(&shown(x, unit)[0]));
        let [_, shown_unit] = shown(0.0, unit);
        put!(
            out,
            r#"<tr><th>{}</th><td class="n">{home}</td><td class="n">{least}</td><td class="n">{most}</td><td>{shown_unit}</td></tr>"#,
            esc(&scan.names[axis.index])
        );
    }
    out.push_str("</tbody></table></div>");
    if let Some((slice, cell, worst)) = scan.worst() {
        put!(
            out,
            "<p>Worst conditioned reachable pose: {}; condition number {}, distance from type 2 {}, from type 1 {}.</p>",
            esc(&crate::pose::pose(scan, slice, cell)),
            num(&significant(worst.condition, 3)),
            num(&significant(worst.parallel, 3)),
            num(&significant(worst.serial, 3))
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::model::ModelBuilder;
    use pkm_dyn::workspace::Margins;

    fn scan(values: [f64; 2], name: &str) -> (Scan, Model) {
        let axis = |index| Scanned { index, values: vec![0.0, 1.0] };
        let cell = |cause, x: f64| Cell { cause, parallel: x, serial: x, condition: x };
        let free = cell(Cause::Reachable, 0.1);
        let mut builder = ModelBuilder::new(name, [0.0; 3]);
        builder.link("base", pkm_dyn::InertialParameters::default());
        let scan = Scan {
            output: name.to_string(),
            names: vec![name.to_string(), "ry".to_string()],
            units: vec!["m", "rad"],
            home_values: values.to_vec(),
            home: free,
            length: 1.0,
            margins: Margins { cone: Vec::new(), parallel: 0.0, condition: f64::INFINITY },
            columns: axis(0),
            rows: Some(axis(1)),
            stack: None,
            slices: vec![Slice {
                at: values.to_vec(),
                cells: vec![free, cell(Cause::Open, f64::NAN), cell(Cause::Singular, 0.0), cell(Cause::Reachable, f64::INFINITY)],
            }],
        };
        (scan, builder.build().unwrap())
    }

    #[test]
    fn the_page_is_self_contained_and_hostile_names_and_numbers_do_no_harm() {
        let (scan, model) = scan([f64::NAN, f64::INFINITY], "<script>\"x");
        let page = workspace_html(&scan, &model, &[]);
        assert!(page.contains("&lt;script&gt;") && !page.contains("<script"), "{page}");
        assert!(!page.contains("NaN") && !page.contains(">inf") && !page.contains("http"));
        for tag in ["div", "section", "table", "tr", "td", "th", "figure", "span", "p", "svg"] {
            let open = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(open, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn every_cell_is_drawn_and_the_boundary_has_its_cause() {
        let (scan, model) = scan([0.0, 0.0], "r");
        let page = workspace_html(&scan, &model, &[]);
        assert!(page.contains("50.0\u{a0}%") && page.contains("class=\"out k1\"") && page.contains("class=\"out k5\""));
        assert!(page.contains("class=\"edge k1\"") && page.contains("class=\"edge k5\"") && page.contains("class=\"cross\""));
        assert!(page.contains("ry [deg]"));
    }
}
