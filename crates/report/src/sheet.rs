//! Curves and tables as one self-contained HTML page, for results that are no diagnosis. Knows nothing of what they mean.

use crate::html::{STYLE, esc};
use crate::svg::{Axis, Frame, Plot, Scale, decimate, path, spans};

/// Most points of a drawn curve.
const POINTS_MAX: usize = 3000;

/// A page.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// What kind of result it is, above the title.
    pub eyebrow: String,
    /// Title.
    pub title: String,
    /// The outcome in a few words, and how it is to be taken.
    pub outcome: (String, Tone),
    /// The answer in a sentence or two.
    pub answer: String,
    /// Pictures, in order.
    pub figures: Vec<Figure>,
    /// Tables, in order, after the pictures.
    pub tables: Vec<Table>,
    /// Last line.
    pub footer: String,
}

/// How an outcome is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// As wanted.
    Good,
    /// To be looked at.
    Found,
    /// Not as wanted.
    Bad,
}

/// A picture of curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Heading, also read out by screen readers.
    pub title: String,
    /// Title of the horizontal axis with unit.
    pub x_label: String,
    /// Title of the vertical axis with unit.
    pub y_label: String,
    /// Horizontal and vertical scale.
    pub scales: [Scale; 2],
    /// Curves, back to front.
    pub curves: Vec<Curve>,
    /// Shaded stretches of the horizontal axis, with what they are; none for an empty list.
    pub shaded: (String, Vec<[f64; 2]>),
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name in the legend.
    pub label: String,
    /// Colour.
    pub ink: Ink,
    /// Points; what is no number interrupts the curve.
    pub points: Vec<(f64, f64)>,
}

/// Colour of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// The colour of text.
    Plain,
    /// The first colour.
    First,
    /// The second colour.
    Second,
}

impl Ink {
    fn class(self) -> &'static str {
        match self {
            Self::Plain => "measured",
            Self::First => "after",
            Self::Second => "before",
        }
    }
}

/// A table of text; the first column names the row.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Heads of the columns.
    pub head: Vec<String>,
    /// Rows of cells.
    pub rows: Vec<Vec<String>>,
}

/// The page: no network, no script, pictures inline; everything given is escaped.
#[must_use]
pub fn sheet(page: &Sheet) -> String {
    let tone = match page.outcome.1 {
        Tone::Good => "good",
        Tone::Found => "found",
        Tone::Bad => "bad",
    };
    let mut body = format!(
        r#"<header><p class="eyebrow">{}</p><h1>{}</h1><p class="outcome {tone}">{}</p><p class="answer">{}</p></header>"#,
        esc(&page.eyebrow),
        esc(&page.title),
        esc(&page.outcome.0),
        esc(&page.answer)
    );
    for f in &page.figures {
        if let Some(drawn) = figure(f) {
            put!(body, "<section><h2>{}</h2>{drawn}</section>", esc(&f.title));
        }
    }
    for t in page.tables.iter().filter(|t| !t.rows.is_empty()) {
        put!(body, "<section><h2>{}</h2>{}</section>", esc(&t.title), table(t));
    }
    put!(body, "<footer>{}</footer>", esc(&page.footer));
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">",
            "<title>{} – {}</title><style>{}</style></head>\n<body><main>{}</main></body></html>\n",
        ),
        esc(&page.title),
        esc(&page.outcome.0),
        STYLE,
        body
    )
}

/// A picture; none without a point that has a place.
fn figure(f: &Figure) -> Option<String> {
    let has_place = |&(x, y): &(f64, f64)| {
        let fits = |v: f64, scale| v.is_finite() && (scale == Scale::Linear || v > 0.0);
        fits(x, f.scales[0]) && fits(y, f.scales[1])
    };
    let points = || f.curves.iter().flat_map(|c| c.points.iter().copied()).filter(has_place);
    let axis = |scale, values: &mut dyn Iterator<Item = f64>, pad| match scale {
        Scale::Linear => Axis::over(values, pad, 6.0),
        Scale::Log => Axis::decades(values),
    };
    let frame = Frame { x: axis(f.scales[0], &mut points().map(|p| p.0), 0.0)?, y: axis(f.scales[1], &mut points().map(|p| p.1), 0.05)? };
    let mut layers = spans(&frame, &f.shaded.1);
    let mut legend = String::new();
    for (i, c) in f.curves.iter().enumerate() {
        let (x, y): (Vec<f64>, Vec<f64>) = c.points.iter().copied().filter(has_place).unzip();
        layers.push_str(&path(&frame, &decimate(&x, &y, POINTS_MAX), c.ink.class()));
        // Curves of one name, a lower and an upper limit say, are told of once.
        if f.curves[..i].iter().all(|before| before.label != c.label) {
            put!(legend, r#"<span class="key l-{}">{}</span>"#, c.ink.class(), esc(&c.label));
        }
    }
    if !f.shaded.1.is_empty() {
        put!(legend, r#"<span class="key k-span">{}</span>"#, esc(&f.shaded.0));
    }
    let plot = Plot { title: &f.title, frame: &frame, x_label: &f.x_label, y_label: &f.y_label, class: "tall", layers: &layers };
    Some(format!(r#"<div class="card">{}<p class="legend">{legend}</p></div>"#, plot.render()))
}

fn table(t: &Table) -> String {
    let mut out = r#"<div class="scroll"><table><thead><tr>"#.to_owned();
    t.head.iter().for_each(|h| put!(out, "<th>{}</th>", esc(h)));
    out.push_str("</tr></thead><tbody>");
    for row in &t.rows {
        out.push_str("<tr>");
        for (i, cell) in row.iter().enumerate() {
            if i == 0 {
                put!(out, "<th>{}</th>", esc(cell));
            } else {
                put!(out, "<td>{}</td>", esc(cell));
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(points: Vec<(f64, f64)>) -> String {
        let curve = Curve { label: "<b>".to_owned(), ink: Ink::First, points };
        let figure = Figure {
            title: "gain".to_owned(),
            x_label: "rad/s".to_owned(),
            y_label: "1".to_owned(),
            scales: [Scale::Log, Scale::Linear],
            curves: vec![curve],
            shaded: ("open".to_owned(), vec![[1.0, 2.0]]),
        };
        let table = Table { title: "t".to_owned(), head: vec!["a".to_owned()], rows: vec![vec!["<script>".to_owned(), "-1".to_owned()]] };
        sheet(&Sheet {
            eyebrow: "e".to_owned(),
            title: "<script>".to_owned(),
            outcome: ("fine".to_owned(), Tone::Good),
            answer: "so".to_owned(),
            figures: vec![figure],
            tables: vec![table],
            footer: "f".to_owned(),
        })
    }

    #[test]
    fn a_page_has_its_curves_and_tables_and_no_markup_from_outside() {
        let html = page(vec![(0.0, 1.0), (0.1, 1.0), (10.0, 2.0), (f64::INFINITY, 3.0)]);
        assert!(html.starts_with("<!DOCTYPE html>") && html.contains("<path class=\"line after\" d=\"M"));
        assert!(html.contains("class=\"span\"") && html.contains("&lt;script&gt;") && !html.contains("<script"));
        assert!(!html.contains("NaN") && !html.contains("inf") && !html.contains("http"));
    }

    #[test]
    fn curves_without_a_point_are_left_out() {
        assert!(!page(vec![(0.0, 1.0), (f64::NAN, 1.0)]).contains("<svg"));
    }
}
