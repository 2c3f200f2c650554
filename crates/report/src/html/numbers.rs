//! The held-out numbers: from the model as given to the refined one, step by step.

use pkm_diagnose::Diagnosis;
use pkm_diagnose::evidence::ChainStep;
use pkm_diagnose::verdict::{Heldout, HeldoutJoint};

use super::{esc, num};
use crate::format::{fixed, percent, short, significant};
use crate::{svg, words};

/// Tiles, chain and table per joint; empty without held-out numbers.
pub(super) fn section(diagnosis: &Diagnosis) -> String {
    let heldout = &diagnosis.verdict.heldout;
    if !words::has_heldout(heldout) {
        return String::new();
    }
    let mut out = tiles(heldout);
    out.push_str(&chain(&steps(heldout, &diagnosis.evidence.chain), heldout.noise_floor));
    put!(out, r#"<p class="soft">{}.</p>"#, definition(heldout));
    out.push_str(&joints(&heldout.joints));
    out
}

/// What the number is; a sceptic asks this first.
fn definition(heldout: &Heldout) -> String {
    let band = if heldout.band_hz.is_finite() && heldout.band_hz > 0.0 {
        format!("after the same zero-phase {} Hz low-pass on measurement and model", num(&short(heldout.band_hz)))
    } else {
        "without a low-pass".to_owned()
    };
    format!(
        "rms error over rms of the measured effort, averaged (root mean square) over the actuated joints, {band}, on samples that no fit \
         and no selection has seen. The noise floor is the estimated measurement noise: no model can go below it"
    )
}

/// The four numbers, large.
fn tiles(heldout: &Heldout) -> String {
    let tile = |class: &str, value: f64, label: &str, hint: &str| {
        format!(r#"<div class="tile {class}"><b>{}</b><span>{label}</span><small>{hint}</small></div>"#, num(&percent(value)))
    };
    let ratio = heldout.rms_nominal / heldout.rms_final;
    let factor = match ratio {
        r if r.is_finite() && r > 1.05 => format!("{} times smaller", num(&significant(r, 2))),
        _ => "every finding added".to_owned(),
    };
    let mut out = "<div class=\"tiles\">".to_owned();
    out.push_str(&tile("before", heldout.rms_nominal, "model as given", "nothing refitted"));
    out.push_str(&tile("mid", heldout.rms_refit, "refitted", "same model, better parameters"));
    out.push_str(&tile("after", heldout.rms_final, "with the findings", &factor));
    out.push_str(&tile("floor", heldout.noise_floor, "noise floor", "limit for any model"));
    out.push_str("</div>");
    out
}

/// The chain as recorded, or the three numbers of the verdict when there is none.
fn steps(heldout: &Heldout, chain: &[ChainStep]) -> Vec<ChainStep> {
    if chain.len() > 1 {
        return chain.to_vec();
    }
    let step = |label: &str, heldout_rms| ChainStep { label: label.to_owned(), heldout_rms };
    vec![
        step("model as given", heldout.rms_nominal),
        step("parameters refitted", heldout.rms_refit),
        step("every finding added", heldout.rms_final),
    ]
}

/// One bar per step, with the noise floor as a mark through all of them.
fn chain(steps: &[ChainStep], noise_floor: f64) -> String {
    let largest = steps.iter().map(|s| s.heldout_rms).filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let mut out = r#"<div class="chain">"#.to_owned();
    for (i, step) in steps.iter().enumerate() {
        let class = match i {
            0 => "fill-before",
            i if i + 1 == steps.len() => "fill-after",
            _ => "fill-mid",
        };
        let (label, value) = (esc(words::added(&step.label)).to_string(), num(&percent(step.heldout_rms)));
        let bar = svg::bar(step.heldout_rms / largest, Some(noise_floor / largest), class, &format!("{label}: {value}"));
        let sign = if i == 0 { "" } else { "+ " };
        put!(out, r#"<div class="step"><span class="what">{sign}{label}</span>{bar}<span class="val">{value}</span></div>"#);
    }
    if noise_floor.is_finite() && noise_floor > 0.0 {
        put!(out, r#"<p class="legend"><span class="key k-floor">noise floor {}</span></p>"#, num(&percent(noise_floor)));
    }
    out.push_str("</div>");
    out
}

/// The same per joint, in the joint's own unit.
fn joints(joints: &[HeldoutJoint]) -> String {
    if joints.is_empty() {
        return String::new();
    }
    let mut out = concat!(
        r#"<div class="scroll"><table class="params"><thead><tr><th>joint</th><th class="n">rms measured</th><th class="n">as given</th>"#,
        r#"<th class="n">refitted</th><th class="n">with the findings</th><th>unit</th><th class="n">error left</th></tr></thead><tbody>"#
    )
    .to_owned();
    for j in joints {
        let left = if j.rms_nominal > 0.0 { percent(j.rms_final / j.rms_nominal) } else { fixed(f64::NAN, 0) };
        put!(out, "<tr><th>{}</th>", esc(&j.joint));
        for value in [j.rms_tau, j.rms_nominal, j.rms_refit, j.rms_final] {
            put!(out, r#"<td class="n">{}</td>"#, num(&significant(value, 3)));
        }
        put!(out, r#"<td>{}</td><td class="n">{}</td></tr>"#, esc(&j.unit), num(&left));
    }
    out.push_str("</tbody></table></div>");
    out
}
