//! An identification as one HTML file: errors by drive, parameters with their intervals, objections.

use pkm_ident::answer::{Estimated, Identification, JointError};
use pkm_ident::beside::Beside;
use pkm_ident::note::{Note, Status};

use super::page::document;
use super::{esc, num};
use crate::format::{percent, significant};
use crate::svg;

/// The identification as one self-contained HTML page: no network, no script. Everything that comes from files is escaped.
#[must_use]
pub fn identification_html(answer: &Identification, beside: &Beside) -> String {
    let outcome = match answer.status {
        Status::Identified => "identified",
        Status::Doubtful => "identified, with doubts",
        Status::NotIdentified => "not identified",
    };
    let tone = match answer.status {
        Status::Identified => "good",
        Status::Doubtful => "found",
        Status::NotIdentified => "bad",
    };
    let mut body = format!(
        r#"<header><p class="eyebrow">Identification</p><h1>{}</h1><p class="outcome {tone}">{outcome}</p></header>{}"#,
        esc(&answer.robot),
        tiles(answer)
    );
    for (id, title, text) in [
        ("notes", "Notes", notes(&answer.notes)),
        ("numbers", "Held-out error", errors(answer)),
        ("parameters", "Base parameters", parameters(answer)),
        ("reduction", "Reduction to relevant parameters", reduction(answer)),
        ("shapes", "Shapes of friction laws", shapes(answer)),
        ("instruments", "Instruments", instruments(answer)),
        ("gains", "Gains of the drives", gains(beside)),
        ("payload", "Payload", payload(beside)),
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

/// The numbers that matter, large.
fn tiles(answer: &Identification) -> String {
    if answer.parameters.is_empty() {
        return String::new();
    }
    let tile = |class: &str, number: &str, label: &str, hint: &str| {
        format!(r#"<div class="tile {class}"><b>{number}</b><span>{label}</span><small>{hint}</small></div>"#)
    };
    let base = &answer.base;
    let determined = answer.parameters.iter().filter(|p| p.relative_sd < DETERMINED).count();
    [
        r#"<div class="tiles">"#,
        &tile("before", &num(&percent(answer.pooled(|j| j.nominal))), "robot as given", "held-out error, all drives"),
        &tile("after", &num(&percent(answer.pooled(|j| j.identified))), "as identified", "on the same rows"),
        &tile("mid", &format!("{} of {}", base.shown, base.structural), "base parameters", "shown, of those this robot can show"),
        &tile("floor", &determined.to_string(), "told from zero", "standard deviation below half of the value"),
        "</div>",
    ]
    .concat()
}

/// Relative standard deviation below which the 95 % interval does not hold zero.
const DETERMINED: f64 = 0.5;

/// Relative standard deviation from which on its size says nothing: reports in any form call all of them larger than this.
pub const HOPELESS: f64 = 10.0;

/// A table; heads that end in `#` are of columns of numbers, which stand to the right and are not broken. Where there is little room its
/// rows become blocks, every cell with its head.
fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let class = |k: usize| if head.get(k).is_some_and(|h| h.ends_with('#')) { r#" class="n""# } else { "" };
    let label = |k: usize| match head.get(k).map(|h| h.trim_end_matches('#')) {
        Some(h) if k > 0 && !h.is_empty() => format!(r#" data-label="{h}""#),
        _ => String::new(),
    };
    let mut out = r#"<div class="scroll"><table class="stack named"><thead><tr>"#.to_owned();
    head.iter().enumerate().for_each(|(k, h)| put!(out, "<th{}>{}</th>", class(k), h.trim_end_matches('#')));
    out.push_str("</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        row.iter().enumerate().for_each(|(k, cell)| put!(out, "<td{}{}>{cell}</td>", class(k), label(k)));
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

/// A relative standard deviation.
fn relative(x: f64) -> String {
    if x < HOPELESS { num(&percent(x)) } else { format!("&gt; {}", num(&percent(HOPELESS))) }
}

/// An interval in one stretch.
fn interval([low, high]: [f64; 2]) -> String {
    format!("{} … {}", value(low), value(high))
}

fn value(x: f64) -> String {
    num(&significant(x, 4))
}

fn notes(notes: &[Note]) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let mut out = "<ul>".to_owned();
    notes.iter().for_each(|n| put!(out, "<li>{}</li>", esc(&n.to_string())));
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
        table(&["drive", "effort rms#", "as given#", "identified#", "", "residual#"], answer.joints.iter().map(row)),
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
        let name = esc(&p.name).to_string();
        vec![name, value(p.nominal), value(p.value), interval(p.ci95), relative(p.relative_sd), p.unit.to_owned()]
    };
    format!(
        "{}<p class=\"soft\">Intervals: {}.</p>",
        table(&["parameter", "nominal#", "identified#", "95 % interval#", "relative sd#", "unit"], answer.parameters.iter().map(row)),
        answer.intervals.says()
    )
}

fn reduction(answer: &Identification) -> String {
    if answer.steps.is_empty() {
        return String::new();
    }
    let rows = answer.steps.iter().map(|s| {
        let is_feasible = if s.is_feasible { "yes" } else { "no" };
        let cells = [s.parameters.to_string(), esc(&s.dropped).to_string(), relative(s.worst_relative_sd)];
        [cells.to_vec(), vec![value(s.fitted), num(&percent(s.heldout)), is_feasible.to_owned()]].concat()
    });
    table(&["parameters#", "dropped", "worst relative sd#", "fitted residual / noise#", "held-out error#", "physical"], rows)
}

fn shapes(answer: &Identification) -> String {
    if answer.shapes.is_empty() {
        return String::new();
    }
    let rows =
        answer.shapes.iter().map(|s| vec![esc(&s.name).to_string(), value(s.stated), value(s.value), interval(s.ci95), s.unit.to_owned()]);
    table(&["shape", "stated#", "identified#", "95 % interval#", "unit"], rows)
}

fn gains(beside: &Beside) -> String {
    let Some(g) = &beside.gains else { return String::new() };
    let rows = g.gains.iter().map(|g| vec![esc(&g.joint).to_string(), value(g.gain), interval(g.ci95), num(&percent(g.load_share))]);
    let head = ["drive", "acting over recorded effort#", "95 % interval#", "known load over effort#"];
    let table = if g.gains.is_empty() { String::new() } else { table(&head, rows) };
    table + &notes(&g.notes)
}

fn payload(beside: &Beside) -> String {
    let Some(p) = &beside.payload else { return String::new() };
    let [x, y, z]: [f64; 3] = p.body.centre_of_mass().0.into();
    let rows = p.shown.iter().map(|e| vec![esc(&e.name).to_string(), value(e.value), interval(e.ci95), e.unit.to_owned()]);
    format!(
        "<p>On {}: {} kg at ({}, {}, {}) m of its frame.</p>{}{}",
        esc(&p.link),
        value(p.body.mass),
        value(x),
        value(y),
        value(z),
        table(&["shown by the motion", "value#", "95 % interval#", "unit"], rows),
        notes(&p.notes)
    )
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
        table(&["parameter", "nominal#", "identified#", "unit"], rows)
    )
}

fn recordings(answer: &Identification) -> String {
    let rows = answer.recordings.iter().map(|r| vec![esc(&r.path).to_string(), r.samples.to_string(), r.used.to_owned()]);
    table(&["recording", "samples#", "used for"], rows)
}
