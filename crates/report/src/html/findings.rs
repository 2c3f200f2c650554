//! One card per finding: the sentence, the equation, the numbers, the proof, and what it could be confused with.

use pkm_diagnose::evidence::FindingPlot;
use pkm_diagnose::verdict::{EffectAt, Experiment, Finding, LookAlike};
use pkm_diagnose::{Diagnosis, Verdict};

use super::{esc, num, prose};
use crate::format::{confidence, fixed, percent, rounded, short};
use crate::svg::{Axis, Frame, Plot, curve, dots, path};
use crate::{svg, words};

/// Dots drawn at most per finding; more only blacken the picture.
const DOTS_MAX: usize = 1600;

/// Rejected look-alikes that are seen without unfolding the rest.
const ALIKE_SHOWN: usize = 4;

/// Points of the model's curve at most.
const CURVE_MAX: usize = 600;

/// The cards, or one sentence when there is no finding; empty when the verdict is about something else.
pub(super) fn section(diagnosis: &Diagnosis) -> String {
    let (verdict, evidence) = (&diagnosis.verdict, &diagnosis.evidence);
    if verdict.findings.is_empty() {
        return none_found(verdict);
    }
    let mut out = String::new();
    for finding in &verdict.findings {
        let plot = evidence.findings.iter().find(|p| p.rank == finding.rank).and_then(picture);
        out.push_str(&card(finding, plot.as_deref(), verdict.heldout.rms_nominal, evidence.null_runs));
    }
    out
}

/// What to say without findings.
fn none_found(verdict: &Verdict) -> String {
    if !verdict.nothing_missing {
        return String::new();
    }
    let sizes = if verdict.minimum_detectable.is_empty() {
        ""
    } else {
        " How large an effect must be to show is listed under <a href=\"#detectable\">what could not have been seen</a>."
    };
    format!("<p class=\"card calm\">No effect improves the held-out error beyond what chance alone does.{sizes}</p>")
}

/// One finding.
fn card(finding: &Finding, picture: Option<&str>, largest: f64, null_runs: usize) -> String {
    let mut out = format!(
        r#"<article class="card"><div class="head"><span class="rank">{}</span><h3>{}</h3></div><p class="tag"><code>{}</code> at <b>{}</b></p>"#,
        finding.rank,
        prose(&finding.says),
        esc(&finding.effect),
        esc(&words::places(&finding.place)),
    );
    let cols = if picture.is_some() { "cols" } else { "cols single" };
    put!(out, r#"<div class="{cols}"><div>"#);
    if !finding.equation.is_empty() {
        put!(out, r#"<p class="eq">{}</p>"#, prose(&finding.equation));
    }
    out.push_str(&parameters(finding));
    out.push_str(&facts(finding, null_runs));
    out.push_str(&before_after(finding, largest));
    out.push_str("</div>");
    if let Some(picture) = picture {
        put!(out, "<figure>{picture}</figure>");
    }
    out.push_str("</div>");
    if !finding.compensation.says.is_empty() {
        put!(out, r#"<p class="soft">For the controller: {}.</p>"#, prose(&finding.compensation.says));
    }
    out.push_str(&aliases(&finding.cannot_tell_from));
    out.push_str(&experiments(&finding.experiments));
    out.push_str(&look_alikes(&finding.look_alikes));
    out.push_str("</article>");
    out
}

/// Parameters with their intervals.
fn parameters(finding: &Finding) -> String {
    if finding.parameters.is_empty() {
        return String::new();
    }
    let mut out = r#"<div class="scroll"><table class="params"><thead><tr><th>parameter</th><th class="n">value</th><th class="n">95 % interval</th><th>unit</th></tr></thead><tbody>"#.to_owned();
    for (name, estimate) in &finding.parameters {
        let r = rounded(estimate);
        put!(
            out,
            r#"<tr><th><code>{}</code></th><td class="n"><b>{}</b></td><td class="n">{} … {}</td><td>{}</td></tr>"#,
            esc(name),
            num(&r.value),
            num(&r.lower),
            num(&r.upper),
            esc(&estimate.unit),
        );
    }
    out.push_str("</tbody></table></div>");
    out
}

/// Regime, time, confidence and chance.
fn facts(finding: &Finding, null_runs: usize) -> String {
    let mut out = "<dl>".to_owned();
    if !finding.regime.is_empty() {
        let regimes: Vec<String> = finding.regime.iter().map(|r| words::plain(r)).collect();
        put!(out, "<dt>shows in</dt><dd>{}</dd>", esc(&regimes.join(", ")));
    }
    if !finding.when.is_empty() {
        put!(out, "<dt>when</dt><dd>{}</dd>", esc(&finding.when));
    }
    if let Some(g) = &finding.depends_on_prior {
        let warn = if g.depends { "<b>depends on them</b>: " } else { "" };
        put!(
            out,
            "<dt>model's inertias</dt><dd>{warn}takes away {} with them exact, {} within {}, {} refitted</dd>",
            num(&percent(g.anchored.max(0.0))),
            num(&percent(g.soft.max(0.0))),
            num(&percent(g.soft_prior)),
            num(&percent(g.refit.max(0.0)))
        );
    }
    let runs = if null_runs > 0 { format!(" from {null_runs} null runs") } else { String::new() };
    put!(out, "<dt>confidence</dt><dd><b>{}</b></dd>", num(&confidence(finding.confidence)).replace('>', "&gt;").replace('<', "&lt;"));
    put!(out, "<dt>p-value</dt><dd>{}<span class=\"soft\">{runs}</span></dd></dl>", num(&short(finding.p_value)));
    out
}

/// The verdict's number without and with the finding.
fn before_after(finding: &Finding, largest: f64) -> String {
    let (before, after) = (finding.heldout_rms_before, finding.heldout_rms_after);
    let scale = [largest, before, after].into_iter().filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let mut out = r#"<div class="chain small">"#.to_owned();
    for (label, value, class) in [("held-out error before", before, "fill-before"), ("with this finding", after, "fill-after")] {
        let shown = num(&percent(value));
        let bar = svg::bar(value / scale, None, class, &format!("{label}: {shown}"));
        put!(out, r#"<div class="step"><span class="what">{label}</span>{bar}<span class="val">{shown}</span></div>"#);
    }
    out.push_str("</div>");
    out
}

/// What these recordings cannot tell from the finding, with the experiment that could.
fn aliases(aliases: &[EffectAt]) -> String {
    if aliases.is_empty() {
        return String::new();
    }
    let mut out = r#"<div class="callout"><h4>These recordings cannot tell it from</h4><ul>"#.to_owned();
    for alias in aliases {
        put!(out, "<li><code>{}</code> at {}", esc(&alias.effect), esc(&words::places(&alias.place)));
        if !alias.separating_experiment.is_empty() {
            put!(out, r#"<br><span class="experiment">Experiment that would: {}</span>"#, esc(&alias.separating_experiment));
        }
        out.push_str("</li>");
    }
    out.push_str("</ul></div>");
    out
}

/// What to do next, with the angle to expect.
fn experiments(experiments: &[Experiment]) -> String {
    if experiments.is_empty() {
        return String::new();
    }
    let mut out = concat!(
        r#"<div class="alike"><h4>What to record next</h4><div class="scroll"><table><thead><tr><th>experiment</th><th>tells it from</th>"#,
        r#"<th class="n">cosine now</th><th class="n">expected</th><th>enough?</th></tr></thead><tbody>"#
    )
    .to_owned();
    for e in experiments {
        put!(
            out,
            r#"<tr><td class="wide">{}</td><td><code>{}</code> {}</td><td class="n">{}</td><td class="n"><b>{}</b></td><td>{}</td></tr>"#,
            esc(&e.intervention),
            esc(&e.against),
            esc(&words::places(&e.place)),
            num(&fixed(e.cos_now, 2)),
            num(&fixed(e.cos_expected, 2)),
            if e.separates { "yes" } else { "no" }
        );
    }
    out.push_str("</tbody></table></div></div>");
    out
}

/// Explanations that were considered and rejected.
fn look_alikes(look_alikes: &[LookAlike]) -> String {
    if look_alikes.is_empty() {
        return String::new();
    }
    let (shown, folded) = look_alikes.split_at(look_alikes.len().min(ALIKE_SHOWN));
    let list = |all: &[LookAlike]| format!("<ul>{}</ul>", all.iter().map(look_alike).collect::<String>());
    let mut out = format!(r#"<div class="alike"><h4>Considered and rejected</h4>{}"#, list(shown));
    if !folded.is_empty() {
        put!(out, "<details><summary>{} more</summary>{}</details>", folded.len(), list(folded));
    }
    out.push_str("</div>");
    out
}

/// One of them, why it is not the one, and what would make sure.
fn look_alike(l: &LookAlike) -> String {
    let mut out = format!("<li><code>{}</code>", esc(&l.effect));
    if !l.place.is_empty() {
        put!(out, " at {}", esc(&words::places(&l.place)));
    }
    if !l.why_not.is_empty() {
        put!(out, ": {}", esc(&l.why_not));
    }
    if !l.separating_experiment.is_empty() {
        put!(out, r#"<br><span class="experiment">To be sure: {}</span>"#, esc(&l.separating_experiment));
    }
    out.push_str("</li>");
    out
}

/// What is left against the variable that explains it; none without a finite point.
fn picture(plot: &FindingPlot) -> Option<String> {
    let x = Axis::over(plot.x.iter().copied(), 0.04, 6.0)?;
    let y = Axis::over(plot.y.iter().chain(&plot.model).copied(), 0.06, 5.0)?;
    let frame = Frame { x, y };
    let every = plot.x.len().div_ceil(DOTS_MAX).max(1);
    let samples = |is_heldout: bool| {
        let held = plot.is_heldout.iter().copied().chain(core::iter::repeat(false));
        let points = plot.x.iter().copied().zip(plot.y.iter().copied()).zip(held);
        points.step_by(every).filter(move |(_, h)| *h == is_heldout).map(|(p, _)| p)
    };
    let mut layers = dots(&frame, samples(false), "train") + &dots(&frame, samples(true), "held");
    // A finding that is no function of what is drawn along is dots as well.
    let (model, key) = match curve(&plot.x, &plot.model, CURVE_MAX) {
        Some(points) => (path(&frame, &points, "halo") + &path(&frame, &points, "after thick"), "l-after"),
        None => (dots(&frame, plot.x.iter().copied().zip(plot.model.iter().copied()).step_by(every), "model"), "d-model"),
    };
    layers.push_str(&model);
    let title = format!("{} against {}, measured and as the finding explains it", plot.y_label, plot.x_label);
    let drawn = Plot { title: &title, frame: &frame, x_label: &plot.x_label, y_label: &plot.y_label, class: "tall", layers: &layers };
    Some(format!(
        concat!(
            "{}<figcaption class=\"legend\"><span class=\"key d-train\">fitted samples</span><span class=\"key d-held\">held-out samples</span>",
            "<span class=\"key {}\">this finding</span></figcaption>",
        ),
        drawn.render(),
        key
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_legend_shows_what_is_drawn() {
        let along = |model: &dyn Fn(f64) -> f64| {
            let x: Vec<f64> = (0..40).map(|i| f64::from(i % 20)).collect();
            let model: Vec<f64> = (0..40).map(|i| model(f64::from(i))).collect();
            picture(&FindingPlot { y: x.clone(), is_heldout: vec![false; 40], x, model, ..FindingPlot::default() }).unwrap()
        };
        // Two values at every place are no curve.
        let (line, cloud) = (along(&|i| i % 20.0), along(&|i| i));
        assert!(line.contains("\"key l-after\"") && line.contains("after thick") && !line.contains("d-model"));
        assert!(cloud.contains("\"key d-model\"") && !cloud.contains("after thick") && !cloud.contains("l-after"));
    }

    #[test]
    fn a_plot_with_bad_numbers_stays_finite() {
        let plot = FindingPlot {
            x: vec![0.0, f64::NAN, 2.0],
            y: vec![1.0, 2.0, f64::INFINITY],
            model: vec![1.0],
            is_heldout: vec![true],
            ..FindingPlot::default()
        };
        let drawn = picture(&plot).unwrap();
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
        assert!(picture(&FindingPlot::default()).is_none());
    }

    #[test]
    fn confidence_above_the_last_percent_is_escaped() {
        let finding = Finding {
            rank: 1,
            effect: "e".to_owned(),
            place: Vec::new(),
            regime: Vec::new(),
            when: String::new(),
            confidence: 0.999,
            p_value: 0.005,
            parameters: [].into(),
            heldout_rms_before: 0.2,
            heldout_rms_after: 0.1,
            says: String::new(),
            equation: String::new(),
            look_alikes: Vec::new(),
            cannot_tell_from: Vec::new(),
            ..Finding::default()
        };
        assert!(facts(&finding, 199).contains("&gt;\u{a0}99\u{a0}%"));
    }
}
