//! Who was taken for whom: the confusion matrix as a picture in a page that needs no network, with the tables below it.

use alloc::collections::BTreeSet;
use core::fmt::Write as _;

use super::curves::{detection, reliability};
use super::judge::Marks;

const CELL: usize = 24;
const LEFT: usize = 190;
const TOP: usize = 180;

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Name of an effect of which name and place are given.
pub(super) fn effect(of: &str) -> &str {
    of.split('@').next().unwrap_or(of)
}

/// What was concealed and what was said first, per case with at most one effect.
fn pairs(marks: &[Marks]) -> Vec<(String, String)> {
    let one = |m: &Marks| {
        let truth = m.concealed.first().map_or("nothing", |c| effect(c));
        let said = if m.ran { m.said.first().map_or("nothing", |s| effect(s)) } else { "no verdict" };
        (truth.to_string(), said.to_string())
    };
    marks.iter().filter(|m| m.concealed.len() <= 1).map(one).collect()
}

fn matrix(marks: &[Marks]) -> String {
    let pairs = pairs(marks);
    let rows: Vec<&str> = pairs.iter().map(|p| p.0.as_str()).collect::<BTreeSet<_>>().into_iter().collect();
    let columns: Vec<&str> = pairs.iter().map(|p| p.1.as_str()).collect::<BTreeSet<_>>().into_iter().collect();
    let (width, height) = (LEFT + CELL * columns.len() + 120, TOP + CELL * rows.len() + 10);
    let mut out = format!(
        r#"<svg role="img" viewBox="0 0 {width} {height}" width="{width}"><title>What was concealed, in rows, and what was said first, in columns</title>"#
    );
    for (c, name) in columns.iter().enumerate() {
        let x = LEFT + CELL * c + CELL / 2 + 4;
        let _ = write!(out, r#"<text transform="translate({x} {}) rotate(-60)">{}</text>"#, TOP - 8, escape(name));
    }
    for (r, row) in rows.iter().enumerate() {
        let y = TOP + CELL * r;
        let _ = write!(out, r#"<text x="{}" y="{}" text-anchor="end">{}</text>"#, LEFT - 8, y + 16, escape(row));
        let all = pairs.iter().filter(|p| p.0 == *row).count();
        for (c, column) in columns.iter().enumerate() {
            let count = pairs.iter().filter(|p| p.0 == *row && p.1 == *column).count();
            let share = count as f64 / all.max(1) as f64;
            let colour = if row == column { "#1f7a4d" } else { "#a33a2c" };
            let x = LEFT + CELL * c;
            let _ = write!(out, r##"<rect x="{x}" y="{y}" width="{CELL}" height="{CELL}" fill="#fff" stroke="#ddd"/>"##);
            if count > 0 {
                let _ = write!(
                    out,
                    r#"<rect x="{x}" y="{y}" width="{CELL}" height="{CELL}" fill="{colour}" fill-opacity="{:.2}"/><text x="{}" y="{}" text-anchor="middle">{count}</text>"#,
                    0.15 + 0.6 * share,
                    x + CELL / 2,
                    y + 16
                );
            }
        }
    }
    out.push_str("</svg>");
    out
}

/// Tables in Markdown as HTML.
fn tables(text: &str) -> String {
    let mut out = String::new();
    let mut is_open = false;
    for line in text.lines() {
        let Some(cells) = line.strip_prefix("| ").and_then(|l| l.strip_suffix(" |")) else {
            if is_open && !line.starts_with('|') {
                out.push_str("</table>");
                is_open = false;
            }
            if !line.is_empty() && !line.starts_with('|') {
                let _ = write!(out, "<p>{}</p>", escape(line));
            }
            continue;
        };
        let tag = if is_open { "td" } else { "th" };
        if !is_open {
            out.push_str("<table>");
            is_open = true;
        }
        out.push_str("<tr>");
        cells.split(" | ").for_each(|c| {
            let _ = write!(out, "<{tag}>{}</{tag}>", escape(&c.replace("\\|", "|")));
        });
        out.push_str("</tr>");
    }
    if is_open {
        out.push_str("</table>");
    }
    out
}

/// The page of a run: pictures of its marks, then `text`, the tables in Markdown.
#[must_use]
pub fn page(title: &str, marks: &[Marks], text: &str) -> String {
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title><style>",
            "body{{font:15px/1.5 system-ui,sans-serif;margin:2rem;color:#222}}svg text{{font-size:12px}}.scroll{{overflow-x:auto}}",
            "table{{border-collapse:collapse;margin:1rem 0;font-size:13px}}td,th{{border:1px solid #ddd;padding:3px 8px;text-align:left}}",
            "</style></head>\n<body><h1>{title}</h1><h2>Who was taken for whom</h2>",
            "<p>Concealed in rows, said first in columns; cases with two effects left out.</p><div class=\"scroll\">{matrix}</div>",
            "<h2>Detection against size</h2><p>Bars are intervals of 95 %; the dashed line is what is said of healthy robots.</p>{detection}",
            "<h2>Stated confidence</h2><p>Grey: as stated.</p>{reliability}",
            "<h2>Counts</h2><div class=\"scroll\">{tables}</div></body></html>\n"
        ),
        title = escape(title),
        matrix = matrix(marks),
        detection = detection(marks),
        reliability = reliability(marks),
        tables = tables(text),
    )
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Ran, judge};
    use super::super::table::markdown;
    use super::*;
    use crate::case::{Answer, Level};

    #[test]
    fn a_page_has_a_cell_per_pair_and_no_markup_from_outside() {
        let answer = Answer {
            schema: String::new(),
            salt: String::new(),
            level: Level::L6,
            robot: "<b>".to_string(),
            concealed: Vec::new(),
            has_patient: false,
            noise_factor: None,
            recordings: None,
            floor: Vec::new(),
        };
        let verdict = serde_json::from_str(r#"{"status":"ok","findings":[{"effect":"<script>","where":["q1"]}]}"#).unwrap();
        let marks = [judge("1", &answer, Some(&verdict), &Ran::default()), judge("2", &answer, None, &Ran::default())];
        let html = page("run", &marks, &markdown(&marks));
        assert!(html.contains("&lt;script&gt;") && !html.contains("<script") && !html.contains("<b>"));
        // One row (nothing), two columns (the name, no verdict): two cells, both filled.
        assert_eq!(html.matches("fill-opacity").count(), 2);
        assert!(html.contains("<td>false alarms, nothing concealed (L6, L7)</td><td>50 % (1/2; 9–91)</td>"), "{html}");
    }

    #[test]
    fn a_share_stands_at_its_height_and_nothing_tried_has_no_point() {
        let answer = |size: Option<f64>| Answer {
            schema: String::new(),
            salt: String::new(),
            level: if size.is_some() { Level::L2 } else { Level::L6 },
            robot: String::new(),
            concealed: size
                .map(|s| serde_json::from_str(&format!(r#"{{"effect":"spring","where":["q1"],"size":{s}}}"#)).unwrap())
                .into_iter()
                .collect(),
            has_patient: false,
            noise_factor: None,
            recordings: None,
            floor: Vec::new(),
        };
        let right = serde_json::from_str(r#"{"status":"ok","findings":[{"effect":"spring","where":["q1"],"confidence":0.75}]}"#).unwrap();
        let marks = [
            judge("1", &answer(Some(1.0)), None, &Ran::default()),
            judge("2", &answer(Some(4.0)), Some(&right), &Ran::default()),
            judge("3", &answer(None), None, &Ran::default()),
        ];
        let svg = detection(&marks);
        // Three lines of two points: 0 of 1 at the bottom (240), 1 of 1 at the top (34). One dashed line of alarms, none of one.
        assert_eq!((svg.matches("<circle").count(), svg.matches(r#"cy="34.0""#).count(), svg.matches(r#"cy="240.0""#).count()), (6, 3, 3));
        assert_eq!(svg.matches("stroke-dasharray").count(), 1);
        let svg = reliability(&marks);
        // One bin at 0.75 of the width between 50 and 450, all of it right.
        assert!(svg.contains(r#"<circle cx="350.0" cy="34.0""#) && svg.matches("<circle").count() == 1, "{svg}");
    }
}
