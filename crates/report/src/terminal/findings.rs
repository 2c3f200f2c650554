//! One finding as text.

use pkm_diagnose::verdict::Finding;

use super::ink::{Ink, Tone, clean, left, right, widest};
use crate::format::{confidence, percent, rounded, short};
use crate::words;

/// Sentence, equation, numbers, proof, and what it could be confused with.
pub(super) fn finding(ink: &mut Ink, finding: &Finding, null_runs: usize) {
    let runs = if null_runs > 0 { format!(" ({null_runs} null runs)") } else { String::new() };
    ink.heading(&format!("{}  {}", finding.rank, words::at(&finding.effect, &finding.place)));
    ink.wrapped_in(Tone::After, "   ", &finding.says);
    if !finding.equation.is_empty() {
        ink.wrapped("   ", &finding.equation);
    }
    parameters(ink, finding);
    ink.line(&[
        (Tone::Soft, "   held-out    "),
        (Tone::Before, &percent(finding.heldout_rms_before)),
        (Tone::Soft, " → "),
        (Tone::After, &percent(finding.heldout_rms_after)),
        (Tone::Soft, "    confidence "),
        (Tone::Bold, &confidence(finding.confidence)),
        (Tone::Soft, "    p "),
        (Tone::Plain, &short(finding.p_value)),
        (Tone::Soft, &runs),
    ]);
    let regimes: Vec<String> = finding.regime.iter().map(|r| words::plain(r)).collect();
    let shows = [regimes.join(", "), finding.when.clone()].into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join("; ");
    if !shows.is_empty() {
        ink.wrapped("   shows in    ", &shows);
    }
    if let Some(g) = finding.depends_on_prior.filter(|g| g.depends) {
        let [a, s, r, p] = [g.anchored, g.soft, g.refit, g.soft_prior].map(|x| percent(x.max(0.0)));
        ink.wrapped_in(Tone::Warn, "   inertias    ", &format!("takes away {a} with the model's exact, {s} within {p}, {r} refitted"));
    }
    confusions(ink, finding);
}

/// Parameters in columns.
fn parameters(ink: &mut Ink, finding: &Finding) {
    let rows: Vec<[String; 3]> = finding
        .parameters
        .iter()
        .map(|(name, e)| {
            let r = rounded(e);
            [clean(name), r.value, format!("[{}, {}] {}", r.lower, r.upper, clean(&e.unit))]
        })
        .collect();
    let (names, values) = (widest(rows.iter().map(|r| r[0].as_str())), widest(rows.iter().map(|r| r[1].as_str())));
    for [name, value, interval] in &rows {
        let (name, value) = (left(name, names.max(10) + 2), right(value, values));
        ink.line(&[(Tone::Plain, "   "), (Tone::Plain, &name), (Tone::Bold, &value), (Tone::Plain, "  "), (Tone::Plain, interval)]);
    }
}

/// What these recordings cannot tell from the finding, and what was rejected.
fn confusions(ink: &mut Ink, finding: &Finding) {
    for alias in &finding.cannot_tell_from {
        ink.wrapped_in(Tone::Warn, "   cannot be told from ", &words::at(&alias.effect, &alias.place));
        if !alias.separating_experiment.is_empty() {
            ink.wrapped("     experiment: ", &alias.separating_experiment);
        }
    }
    for l in &finding.look_alikes {
        let why = if l.why_not.is_empty() { String::new() } else { format!(": {}", l.why_not) };
        ink.wrapped("   rejected    ", &format!("{}{why}", words::at(&l.effect, &l.place)));
        if !l.separating_experiment.is_empty() {
            ink.wrapped_in(Tone::Soft, "     to be sure: ", &l.separating_experiment);
        }
    }
}
