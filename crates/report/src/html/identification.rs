//! An identification as one HTML file: errors by drive, parameters with their intervals, objections.

use pkm_ident::answer::{Estimated, Identification, JointError};
use pkm_ident::note::Status;

use super::page::document;
use super::{esc, num};
use crate::format::{percent, significant};
use crate::svg;

/// The identification as one self-contained HTML page: no network, no script. Everything that comes from files is escaped.
#[must_use]
pub fn identification_html(answer: &Identification) -> String {
    let outcome = match answer.status {
        Status::Identified => "identified",
        Status::Doubtful => "identified, with doubts",
        Status::NotIdentified => "not identified",
    };
    let mut body = format!("<header><h1>{}: {outcome}</h1></header>", esc(&answer.robot));
    for (id, title, text) in [
        ("notes", "Notes", notes(answer)),
        ("numbers", "Held-out error", errors(answer)),
        ("parameters", "Base parameters", parameters(answer)),
        ("reduction", "Reduction to relevant parameters", reduction(answer)),
        ("shapes", "Shapes of friction laws", shapes(answer)),
        ("instruments", "Instruments", instruments(answer)),
        ("preprocessing", "Preprocessing", preprocessing(answer)),
        ("all", "All parameters of the identified robot", all(answer)),
        ("recordings", "Recordings", recordings(answer)),
    ] {
        if !text.is_empty() {
            put!(body, r#"<section id="{id}"><h2>{title}</h2>{text}</section>"#);
        }
    }
    document(&format!("{} – {outcome}", esc(&answer.robot)), &body)
}

fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut out = "<table><thead><tr>".to_owned();
    head.iter().for_each(|h| put!(out, "<th>{h}</th>"));
    out.push_str("</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        row.iter().for_each(|cell| put!(out, "<td>{cell}</td>"));
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table>");
    out
}

fn value(x: f64) -> String {
    num(&significant(x, 4))
}

fn notes(answer: &Identification) -> String {
    if answer.notes.is_empty() {
        return String::new();
    }
    let mut out = "<ul>".to_owned();
    answer.notes.iter().for_each(|n| put!(out, "<li>{}</li>", esc(&n.to_string())));
    out + "</ul>"
}

fn errors(answer: &Identification) -> String {
    let top = answer.joints.iter().map(|j| j.nominal.max(j.identified)).fold(f64::MIN_POSITIVE, f64::max);
    let row = |j: &JointError| {
        let title = format!("{} before, {} after", percent(j.nominal), percent(j.identified));
        let residual = if j.is_white { "white".to_owned() } else { format!("coloured, neighbours {}", value(j.lag_one)) };
        vec![
            esc(&j.joint).to_string(),
            format!("{} {}", value(j.effort_rms), j.unit),
            num(&percent(j.nominal)),
            num(&percent(j.identified)),
            svg::bar(j.identified / top, Some(j.nominal / top), "fill-after", &title),
            residual,
        ]
    };
    let base = &answer.base;
    format!(
        "{}<p class=\"soft\">rms error over rms of the measured effort on rows that were not fitted, after the same zero-phase {} Hz low-pass \
         on measurement and model; the mark is the robot as given. Method {}, {} rows; {} of {} base parameters (tolerance {:.0e}), condition \
         number {} at columns of length one, {} in SI units.</p>",
        table(&["drive", "effort rms", "as given", "identified", "", "residual"], answer.joints.iter().map(row)),
        value(answer.band_hz),
        answer.method.name(),
        answer.n_rows,
        base.shown,
        base.structural,
        base.tolerance,
        value(base.condition),
        value(base.condition_raw)
    )
}

fn parameters(answer: &Identification) -> String {
    if answer.parameters.is_empty() {
        return String::new();
    }
    let row = |p: &Estimated| {
        let interval = format!("{} … {}", value(p.ci95[0]), value(p.ci95[1]));
        vec![
            value(p.nominal),
            value(p.value),
            interval,
            num(&percent(p.relative_sd.min(99.0))),
            p.unit.to_owned(),
            esc(&p.name).to_string(),
        ]
    };
    table(&["nominal", "identified", "95 % interval", "relative sd", "unit", "parameter"], answer.parameters.iter().map(row))
}

fn reduction(answer: &Identification) -> String {
    if answer.steps.is_empty() {
        return String::new();
    }
    let rows = answer.steps.iter().map(|s| {
        let is_feasible = if s.is_feasible { "yes" } else { "no" };
        let cells = [s.parameters.to_string(), esc(&s.dropped).to_string(), num(&percent(s.worst_relative_sd.min(99.0)))];
        [cells.to_vec(), vec![value(s.fitted), num(&percent(s.heldout)), is_feasible.to_owned()]].concat()
    });
    table(&["parameters", "dropped", "worst relative sd", "fitted residual / noise", "held-out error", "physical"], rows)
}

fn shapes(answer: &Identification) -> String {
    if answer.shapes.is_empty() {
        return String::new();
    }
    let rows = answer.shapes.iter().map(|s| {
        let interval = format!("{} … {}", value(s.ci95[0]), value(s.ci95[1]));
        vec![value(s.stated), value(s.value), interval, s.unit.to_owned(), esc(&s.name).to_string()]
    });
    table(&["stated", "identified", "95 % interval", "unit", "shape"], rows)
}

fn instruments(answer: &Identification) -> String {
    let Some(i) = &answer.instruments else { return String::new() };
    let says = if i.test.is_exogenous { "least squares would have done" } else { "least squares would be biased" };
    format!(
        "<p>{} simulations of the closed loop; they explain {} of every column at least ({}). Durbin-Wu-Hausman: F = {}, p = {}: {says}.</p>",
        i.iterations,
        num(&percent(i.test.relevance)),
        esc(&i.weakest),
        value(i.test.f),
        value(i.test.p)
    )
}

fn preprocessing(answer: &Identification) -> String {
    if answer.preprocessing.is_empty() {
        return String::new();
    }
    let rows = answer.preprocessing.iter().map(|d| {
        let numbers: Vec<String> = d.numbers.iter().map(|(name, x)| format!("{name} {}", value(*x))).collect();
        vec![esc(&d.recording).to_string(), esc(&d.signal).to_string(), d.step.to_owned(), numbers.join(", ")]
    });
    table(&["recording", "signal", "step", "numbers"], rows)
}

fn all(answer: &Identification) -> String {
    let rows = answer
        .columns
        .list
        .iter()
        .zip(&answer.theta)
        .map(|(p, x)| vec![esc(&p.name).to_string(), value(p.nominal), value(*x), p.unit.to_owned()]);
    format!(
        "<details><summary>{} parameters</summary>{}</details>",
        answer.theta.len(),
        table(&["parameter", "nominal", "identified", "unit"], rows)
    )
}

fn recordings(answer: &Identification) -> String {
    let rows = answer.recordings.iter().map(|r| vec![esc(&r.path).to_string(), r.samples.to_string(), r.used.to_owned()]);
    table(&["recording", "samples", "used for"], rows)
}
