//! A reproduction as a page.

use pkm_papers::{Paper, Plot, Reproduction};
use pkm_report::{Curve, Figure, Ink, Scale, Sheet, Table, Tone, sheet};

use super::text::{cells, count, reasons};

/// The page as HTML.
pub(super) fn html(paper: &Paper, found: &Reproduction) -> String {
    let outcome = if found.is_sound() { ("every gate met", Tone::Good) } else { ("a gate missed", Tone::Bad) };
    let head = ["where", "what", "ours", "paper", "held against", "verdict"].map(String::from).to_vec();
    let notes = reasons(found).into_iter().filter_map(|r| r.split_once(": ").map(|(a, b)| vec![a.to_string(), b.to_string()])).collect();
    sheet(&Sheet {
        eyebrow: "Reproduction".to_string(),
        title: paper.title.to_string(),
        outcome: (outcome.0.to_string(), outcome.1),
        answer: format!("{}.", count(found)),
        figures: found.plots.iter().map(figure).collect(),
        tables: vec![
            Table { title: "Paper against ours".to_string(), head, rows: found.rows.iter().map(cells).collect() },
            Table { title: "Notes".to_string(), head: ["where", "note"].map(String::from).to_vec(), rows: notes },
        ],
        footer: "Experiments on simulated robots; what is assumed where a paper prints no number stands in the README of each robot."
            .to_string(),
    })
}

fn figure(plot: &Plot) -> Figure {
    let inks = [Ink::First, Ink::Second, Ink::Plain];
    let curves = plot.lines.iter().zip(inks.into_iter().cycle());
    Figure {
        title: plot.title.clone(),
        x_label: plot.x_label.clone(),
        y_label: plot.y_label.clone(),
        scales: [Scale::Linear; 2],
        curves: curves.map(|(line, ink)| Curve { label: line.label.clone(), ink, points: line.points.clone() }).collect(),
        shaded: (String::new(), Vec::new()),
    }
}
