//! Heat map and tables: what was ruled out, what was too small to see, what stays, what was recorded.

use pkm_diagnose::evidence::{Evidence, RegimeCell, Screened};
use pkm_diagnose::verdict::{Detectable, Invisible, RecordingUse};

use super::{esc, num};
use crate::format::{percent, significant};
use crate::words;

/// Rows of the table of rejected candidates at most; the rest is counted.
const RULED_OUT_MAX: usize = 60;

/// Rejected candidates that are seen without unfolding the rest.
const RULED_OUT_SHOWN: usize = 8;

/// Names in order of first appearance.
fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    names.fold(Vec::new(), |mut seen, name| {
        if !seen.contains(&name) {
            seen.push(name);
        }
        seen
    })
}

/// Error of every joint in every regime, before and after, on one colour scale.
pub(super) fn regimes(cells: &[RegimeCell]) -> String {
    if cells.is_empty() {
        return String::new();
    }
    let largest = cells.iter().flat_map(|c| [c.before, c.after]).filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let before = heat(cells, "model as given", largest, |c| c.before);
    let after = heat(cells, "with the findings", largest, |c| c.after);
    format!(
        concat!(
            r#"<div class="heats">{}{}</div><p class="soft">rms error over the joint's effort rms. The stronger the colour, the larger; "#,
            r#"both maps share one scale, 0 to {}. Beside a regime: its share of the samples.</p>"#
        ),
        before,
        after,
        num(&percent(largest))
    )
}

/// One heat map.
fn heat(cells: &[RegimeCell], caption: &str, largest: f64, value: impl Fn(&RegimeCell) -> f64) -> String {
    let (joints, regimes) = (distinct(cells.iter().map(|c| c.joint.as_str())), distinct(cells.iter().map(|c| c.regime.as_str())));
    let mut out = format!(r#"<div class="scroll"><table class="heat"><caption>{caption}</caption><thead><tr><th></th>"#);
    for joint in &joints {
        put!(out, r#"<th class="n">{}</th>"#, esc(joint));
    }
    out.push_str("</tr></thead><tbody>");
    for regime in &regimes {
        let of_regime = || cells.iter().filter(|c| c.regime == *regime);
        let (sum, n) = of_regime().fold((0.0, 0.0), |(s, n), c| (s + c.share, n + 1.0));
        put!(out, "<tr><th>{} <small>{}</small></th>", esc(&words::plain(regime)), num(&percent(sum / n)));
        for joint in &joints {
            match of_regime().find(|c| c.joint == *joint).map(&value).filter(|v| v.is_finite()) {
                Some(v) => put!(out, r#"<td style="--v:{:.3}">{}</td>"#, (v / largest).clamp(0.0, 1.0), num(&percent(v))),
                None => out.push_str(r#"<td class="none">–</td>"#),
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

/// Candidates that are no findings, and why.
pub(super) fn ruled_out(evidence: &Evidence) -> String {
    if evidence.ruled_out.is_empty() {
        return String::new();
    }
    let [p95, p99] = evidence.null_surprise;
    let mut out = String::new();
    if evidence.null_runs > 0 {
        put!(
            out,
            concat!(
                "<p class=\"soft\">The gain is the share of the held-out squared error a candidate would take away; how far that is above what chance ",
                "gains for the same candidate is told in standard deviations (σ). Chance alone, the best of all candidates in each of {} null runs, ",
                "reaches {}&nbsp;σ (95&nbsp;%) or {}&nbsp;σ (99&nbsp;%).</p>"
            ),
            evidence.null_runs,
            num(&significant(p95, 2)),
            num(&significant(p99, 2))
        );
    }
    let listed = &evidence.ruled_out[..evidence.ruled_out.len().min(RULED_OUT_MAX)];
    let (shown, folded) = listed.split_at(listed.len().min(RULED_OUT_SHOWN));
    out.push_str(&candidates(shown));
    if !folded.is_empty() {
        put!(out, "<details><summary>{} more candidates</summary>{}</details>", folded.len(), candidates(folded));
    }
    if evidence.ruled_out.len() > RULED_OUT_MAX {
        put!(out, r#"<p class="soft">{} weaker candidates are not listed.</p>"#, evidence.ruled_out.len() - RULED_OUT_MAX);
    }
    out
}

/// A table of rejected candidates.
fn candidates(rows: &[Screened]) -> String {
    let head = concat!(
        r#"<div class="scroll"><table class="stack"><thead><tr><th>candidate</th><th>where</th><th class="n">gain</th>"#,
        r#"<th class="n">above chance</th><th class="n">folds won</th><th>why it is no finding</th></tr></thead><tbody>"#
    );
    let rows: String = rows.iter().map(screened).collect();
    format!("{head}{rows}</tbody></table></div>")
}

/// One rejected candidate.
fn screened(s: &Screened) -> String {
    format!(
        r#"<tr><th><code>{}</code></th><td>{}</td><td class="n" data-label="gain">{}</td><td class="n">{} σ</td><td class="n" data-label="folds">{} of {}</td><td class="wide">{}</td></tr>"#,
        esc(&s.effect),
        esc(&words::places(&s.place)),
        num(&percent(s.gain)),
        num(&significant(s.surprise, 2)),
        s.wins[0],
        s.wins[1],
        esc(&s.why_not)
    )
}

/// What was too small to be seen, and what no size would have shown.
pub(super) fn unseen(sizes: &[Detectable], invisible: &[Invisible]) -> String {
    detectable(sizes) + &self::invisible(invisible)
}

/// The smallest sizes that would have been seen.
pub(super) fn detectable(sizes: &[Detectable]) -> String {
    if sizes.is_empty() {
        return String::new();
    }
    let mut out = concat!(
        r#"<p class="soft">Smaller effects than these may be there: they would not show.</p><div class="scroll"><table class="stack">"#,
        r#"<thead><tr><th>effect</th><th>where</th><th>parameter</th><th class="n">smallest visible</th><th>unit</th><th>in words</th></tr></thead><tbody>"#
    )
    .to_owned();
    for d in sizes {
        put!(
            out,
            r#"<tr><th><code>{}</code></th><td>{}</td><td>{}</td><td class="n">{}</td><td>{}</td><td class="wide soft">{}</td></tr>"#,
            esc(&d.effect),
            esc(&words::places(&d.place)),
            esc(&d.parameter),
            num(&significant(d.value, 2)),
            esc(&d.unit),
            esc(&d.says)
        );
    }
    out.push_str("</tbody></table></div>");
    out
}

/// What no size would show, effect by effect.
pub(super) fn invisible(effects: &[Invisible]) -> String {
    let mut out = String::new();
    for e in effects {
        put!(out, "<li><code>{}</code> at {}: {}</li>", esc(&e.effect), esc(&words::places(&e.place)), esc(&e.why));
    }
    if out.is_empty() { out } else { format!("<ul>{out}</ul>") }
}

/// The recordings and what they were used for.
pub(super) fn recordings(recordings: &[RecordingUse]) -> String {
    if recordings.is_empty() {
        return String::new();
    }
    let mut out = concat!(
        r#"<div class="scroll"><table><thead><tr><th>recording</th><th class="n">samples</th><th class="n">length</th><th>used</th>"#,
        r#"<th>held-out spans [s]</th></tr></thead><tbody>"#
    )
    .to_owned();
    for r in recordings {
        let spans: Vec<String> =
            r.heldout_spans.iter().map(|[a, b]| num(&format!("{} … {}", significant(*a, 3), significant(*b, 3)))).collect();
        put!(
            out,
            r#"<tr><th><code>{}</code></th><td class="n">{}</td><td class="n">{}</td><td>{}</td><td class="wide">{}</td></tr>"#,
            esc(&r.path),
            r.samples,
            num(&format!("{} s", significant(r.duration_s, 3))),
            words::used(r.used),
            if spans.is_empty() { "–".to_owned() } else { spans.join(", ") }
        );
    }
    out.push_str("</tbody></table></div>");
    out
}

/// What the gate noticed.
pub(super) fn notes(notes: &[String]) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let mut out = "<ul>".to_owned();
    for note in notes {
        put!(out, "<li>{}</li>", esc(note));
    }
    out.push_str("</ul>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_chance_reaches_is_told_in_sigmas_as_it_is_measured() {
        let rejected =
            Screened { effect: "spring".to_owned(), place: Vec::new(), gain: 0.04, surprise: 2.1, wins: [3, 5], why_not: String::new() };
        let evidence = Evidence { ruled_out: vec![rejected], null_surprise: [3.6, 4.9], null_runs: 199, ..Evidence::default() };
        let page = ruled_out(&evidence);
        assert!(page.contains("3.6&nbsp;σ") && page.contains("4.9&nbsp;σ") && page.contains("2.1 σ"), "{page}");
        assert!(!page.contains("360") && !page.contains("490"), "a surprise is no share");
    }
}
