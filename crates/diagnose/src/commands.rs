//! Recorded commands that are not the stated controller's, as findings and in the refined robot.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::{Applied, Entry, find};

use crate::controller::Replayed;
use crate::design::View;
use crate::evidence::Refined;
use crate::explain::number;
use crate::final_fit::{errors, left_as_given, pooled};
use crate::refine::combine;
use crate::settings::Settings;
use crate::verdict::{Compensation, Estimate, Finding, LookAlike};
use crate::work::Work;

fn entry() -> Option<&'static Entry> {
    find("controller_mismatch")
}

/// One finding per drive, first of all findings: nothing can be said of a robot whose efforts are not what is recorded.
pub(crate) fn findings(work: &Work, mismatches: &[Replayed], settings: &Settings) -> Vec<Finding> {
    let Some(entry) = entry() else { return Vec::new() };
    let mut missing = work.missing.clone();
    let heldout = |missing: &[f64]| pooled(&errors(work, &left_as_given(work, missing, View::Judge)));
    let mut out: Vec<Finding> = Vec::new();
    for m in mismatches {
        let before = heldout(&missing);
        missing[m.drive] = 0.0;
        let after = heldout(&missing);
        let ci95 = [m.share - m.half_width, m.share + m.half_width];
        let share = Estimate { value: m.share, ci95, unit: "1".to_string() };
        let p_value = m.p_value().max(1.0 / (settings.null_runs + 1) as f64);
        let confidence = if work.motions.len() < 2 { 0.79 } else { 0.95 } * (1.0 - p_value);
        let says = format!(
            "At {}, {}: share = {} (correlation of the two {:.3}). Taking the controller's takes the held-out error from {:.1} % to {:.1} % of the effort.",
            m.joint,
            entry.sentence,
            number(m.share),
            m.correlation,
            100.0 * before,
            100.0 * after
        );
        let look_alikes = entry.look_alikes.iter().map(|l| LookAlike {
            effect: l.effect.to_string(),
            place: vec![m.joint.clone()],
            why_not: "it is no physics of the robot that changes what a replayed controller computes".to_string(),
            separating_experiment: l.experiment.to_string(),
        });
        out.push(Finding {
            rank: out.len() + 1,
            effect: entry.name.to_string(),
            place: vec![m.joint.clone()],
            regime: vec!["all".to_string()],
            when: "at all times: the recorded signals alone say so".to_string(),
            confidence,
            p_value,
            heldout_rms_before: before,
            heldout_rms_after: after,
            says,
            equation: format!("{}; share = {}", entry.equation, number(m.share)),
            parameters: BTreeMap::from([("share".to_string(), share)]),
            look_alikes: look_alikes.collect(),
            cannot_tell_from: Vec::new(),
            compensation: Compensation { in_refined_model: false, says: entry.compensation.to_string() },
            experiments: Vec::new(),
            depends_on_prior: None,
        });
    }
    out
}

/// Puts the shares into the robot, so that it predicts what is recorded. What is no factor cannot be put into one.
pub(crate) fn refine(out: &mut Refined, work: &Work, mismatches: &[Replayed]) {
    let Some(entry) = entry() else { return };
    for m in mismatches.iter().filter(|m| m.is_scaled()) {
        let mut applied = Applied::at(entry, work.robot.model.actuators[m.drive], vec![m.share]);
        combine(out, &mut applied);
        out.effects.push(applied);
    }
}
