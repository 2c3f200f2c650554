//! A plan as one HTML file: what a motion would show, in what size, and what would be mistaken for what.

use pkm_diagnose::{Alias, Belief, Plan, Required};

use super::page::document;
use super::{esc, isolability, num, tables};
use crate::format::{fixed, significant};
use crate::words;

/// Pairs shown at once; the rest is to be opened.
const PAIRS_MAX: usize = 12;

/// A plan as one self-contained HTML page: no network, no script. Everything that comes from files is escaped.
#[must_use]
pub fn plan_html(plan: &Plan, required: &[Required]) -> String {
    let (outcome, class) = words::plan_outcome(plan, required);
    let mut body = format!(
        r#"<header><p class="eyebrow">What a motion could show</p><h1>{}</h1><p class="outcome {class}">{}</p><p class="answer">{}</p></header>"#,
        esc(&plan.robot),
        esc(&outcome),
        esc(&words::plan_answer(plan)),
    );
    for (id, title, text) in [
        ("required", "What is asked for", asked(required)),
        ("aliases", "What this motion could not tell apart", aliases(plan)),
        ("isolability", "Angles between effects", isolability::section(&plan.isolability)),
        ("detectable", "Smallest sizes that would be named", tables::detectable(&plan.minimum_detectable)),
        ("invisible", "What would not be seen in any size", tables::invisible(&plan.invisible)),
        ("noise", "Taken for granted", assumed(plan)),
    ] {
        if !text.is_empty() {
            put!(body, r#"<section id="{id}"><h2>{title}</h2>{text}</section>"#);
        }
    }
    put!(
        body,
        "<footer>Layout <code>{}</code>. Computed from the nominal robot and the motion alone; nothing was measured.</footer>",
        esc(&plan.schema)
    );
    document(&format!("{} – {}", esc(&plan.robot), esc(&outcome)), &body)
}

fn asked(required: &[Required]) -> String {
    if required.is_empty() {
        return String::new();
    }
    let mut out = concat!(
        r#"<div class="scroll"><table><thead><tr><th>effect</th><th>and</th><th class="n">cosine</th><th class="n">κ</th>"#,
        r#"<th>told apart?</th></tr></thead><tbody>"#
    )
    .to_owned();
    for r in required {
        let [a, b] = r.effects.each_ref().map(|e| esc(&words::at(&e.effect, &e.place)).to_string());
        let answer = if r.ok { "yes" } else { "<b>no</b>" };
        let kappa = r.kappa.map(|k| num(&fixed(k, 2))).join(", ");
        put!(
            out,
            r#"<tr><th>{a}</th><td>{b}</td><td class="n">{}</td><td class="n">{kappa}</td><td>{answer}</td></tr>"#,
            num(&fixed(r.cosine, 3))
        );
    }
    out.push_str("</tbody></table></div>");
    out
}

fn aliases(plan: &Plan) -> String {
    if plan.aliases.is_empty() {
        return r#"<p class="card calm">Every pair of effects that are looked for opens an angle.</p>"#.to_owned();
    }
    let (first, rest) = plan.aliases.split_at(plan.aliases.len().min(PAIRS_MAX));
    let mut out = pairs(first);
    if !rest.is_empty() {
        put!(out, "<details><summary>{} more pairs</summary>{}</details>", rest.len(), pairs(rest));
    }
    out
}

fn pairs(aliases: &[Alias]) -> String {
    let mut out =
        r#"<div class="scroll"><table><thead><tr><th>effect</th><th>and</th><th class="n">cosine</th></tr></thead><tbody>"#.to_owned();
    for a in aliases {
        let [x, y] = a.effects.each_ref().map(|e| esc(&words::at(&e.effect, &e.place)).to_string());
        put!(out, r#"<tr><td>{x}</td><td>{y}</td><td class="n">{}</td></tr>"#, num(&fixed(a.cosine, 3)));
    }
    out.push_str("</tbody></table></div>");
    out
}

fn assumed(plan: &Plan) -> String {
    let belief = match plan.belief {
        Belief::Anchored => "exact",
        Belief::Soft => "within a tenth of their size",
        Belief::Refit => "refitted",
    };
    let mut out = format!(
        "<dl><dt>motion</dt><dd>{}, {} s</dd><dt>low-pass</dt><dd>{} Hz</dd><dt>inertias of the model</dt><dd>{belief}</dd>",
        esc(&plan.references.join(", ")),
        num(&significant(plan.duration_s, 3)),
        num(&significant(plan.band_hz, 3)),
    );
    for (joint, s) in &plan.noise {
        put!(out, "<dt>noise of {}</dt><dd>{} (standard deviation per sample, N or N·m)</dd>", esc(joint), num(&significant(*s, 3)));
    }
    out.push_str("</dl>");
    out
}
