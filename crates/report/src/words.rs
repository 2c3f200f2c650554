//! The words both renderings share.

use pkm_diagnose::isolability::LEAST_SURVIVING;
use pkm_diagnose::verdict::{Heldout, Status, Unexplained, Use};
use pkm_diagnose::{Plan, Required, Verdict};

/// The outcome in a few words.
pub(crate) fn outcome(verdict: &Verdict) -> String {
    match (verdict.status, verdict.findings.len()) {
        (Status::Unusable, _) => "recordings unusable".to_owned(),
        (Status::NotRepeatable, _) => "mismatch not repeatable".to_owned(),
        (Status::Ok, 0) if verdict.unexplained.present => "something is missing that has no name here".to_owned(),
        (Status::Ok, 0) => "nothing missing".to_owned(),
        (Status::Ok, 1) => "1 finding".to_owned(),
        (Status::Ok, n) => format!("{n} findings"),
    }
}

/// The one-sentence answer, also when the verdict brings none.
pub(crate) fn answer(verdict: &Verdict) -> &str {
    match (verdict.status, verdict.says.trim()) {
        (_, says) if !says.is_empty() => says,
        (Status::Unusable, _) => "These recordings cannot be used for a diagnosis.",
        (Status::NotRepeatable, _) => "Model and recordings differ, but the difference does not repeat from period to period.",
        (Status::Ok, _) if verdict.nothing_missing => "The model as given explains the recordings; nothing is missing.",
        (Status::Ok, _) if verdict.findings.is_empty() => "No named effect explains what the model lacks.",
        (Status::Ok, _) => "The model lacks the effects below.",
    }
}

/// Places as one list, e.g. `q1, q2`.
pub(crate) fn places(place: &[String]) -> String {
    if place.is_empty() { "whole robot".to_owned() } else { place.join(", ") }
}

/// An effect with its places, e.g. `friction_coulomb at q1, q2`.
pub(crate) fn at(effect: &str, place: &[String]) -> String {
    if place.is_empty() { effect.to_owned() } else { format!("{effect} at {}", place.join(", ")) }
}

/// What a recording was used for.
pub(crate) const fn used(used: Use) -> &'static str {
    match used {
        Use::Train => "fitted on",
        Use::Holdout => "held out",
        Use::Both => "fitted on, blocks held out",
    }
}

/// Label of a step without its own plus sign: the renderings write it.
pub(crate) fn added(label: &str) -> &str {
    label.trim_start_matches(['+', ' '])
}

/// What is left, in a sentence.
pub(crate) fn left_over(unexplained: &Unexplained) -> &str {
    match (unexplained.says.trim(), unexplained.present) {
        ("", true) => "Something is missing that the library has no name for.",
        ("", false) => "What is left does not call for another effect.",
        (says, _) => says,
    }
}

/// A name from a file, readable: `low_speed` becomes `low speed`.
pub(crate) fn plain(name: &str) -> String {
    name.replace('_', " ")
}

/// Whether the verdict brings held-out numbers at all; a rejected recording has none.
pub(crate) fn has_heldout(heldout: &Heldout) -> bool {
    [heldout.rms_nominal, heldout.rms_refit, heldout.rms_final].iter().any(|x| x.is_finite() && *x > 0.0)
}

/// The outcome of a plan in a few words, and how it is to be taken.
pub(crate) fn plan_outcome(plan: &Plan, required: &[Required]) -> (String, &'static str) {
    let missed = required.iter().filter(|r| !r.ok).count();
    match (missed, required.len(), plan.aliases.len()) {
        (0, 0, 0) => ("every pair of effects is told apart".to_owned(), "good"),
        (0, 0, 1) => ("1 pair of effects could not be told apart".to_owned(), "found"),
        (0, 0, n) => (format!("{n} pairs of effects could not be told apart"), "found"),
        (0, ..) => ("what is asked for is told apart".to_owned(), "good"),
        (1, 1, _) => ("what is asked for is not told apart".to_owned(), "bad"),
        (n, of, _) => (format!("{n} of {of} pairs asked for are not told apart"), "bad"),
    }
}

/// A plan in a sentence.
pub(crate) fn plan_answer(plan: &Plan) -> String {
    let visible = plan.isolability.effects.iter().filter(|e| e.kappa >= LEAST_SURVIVING).count();
    let payloads = plan.minimum_detectable.iter().filter(|d| d.effect == "payload" && d.value.is_finite());
    let smallest = payloads
        .min_by(|a, b| a.value.total_cmp(&b.value))
        .map_or(String::new(), |d| format!(" The smallest load that shows: {}.", d.says));
    format!(
        "Of {} effects and places that are looked for, {visible} would be more along this motion than other friction, offsets and inertias; the others would look like those.{smallest}",
        plan.isolability.effects.len()
    )
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use pkm_diagnose::evidence::{ChainStep, FindingPlot, JointSeries, RegimeCell, Screened};
    use pkm_diagnose::isolability::{Isolability, Seen};
    use pkm_diagnose::verdict::{
        Compensation, Detectable, EffectAt, Estimate, Experiment, Finding, HeldoutJoint, Invisible, LookAlike, PriorGains, RecordingUse,
        SCHEMA,
    };
    use pkm_diagnose::{Diagnosis, Evidence};

    /// A diagnosis with nothing in it.
    pub(crate) fn empty(status: Status) -> Diagnosis {
        let verdict = Verdict {
            schema: SCHEMA.to_owned(),
            status,
            robot: "r".to_owned(),
            recordings: Vec::new(),
            nothing_missing: status == Status::Ok,
            heldout: Heldout::default(),
            findings: Vec::new(),
            unexplained: Unexplained::default(),
            minimum_detectable: Vec::new(),
            refined_model: String::new(),
            says: String::new(),
            notes: Vec::new(),
            ..Verdict::default()
        };
        Diagnosis { verdict, evidence: Evidence::default(), refined: None }
    }

    /// A diagnosis with every list filled, by names that are markup and numbers that are none.
    pub(crate) fn hostile() -> Diagnosis {
        let name = || "<script>\"'&\u{1b}".to_owned();
        let places = || vec![name()];
        let (nan, inf) = (f64::NAN, f64::INFINITY);
        let mut d = empty(Status::Ok);
        let v = &mut d.verdict;
        (v.robot, v.says, v.refined_model, v.notes, v.nothing_missing) = (name(), name(), name(), places(), false);
        v.recordings =
            vec![RecordingUse { path: name(), samples: 3, duration_s: nan, used: Use::Both, heldout_spans: vec![[nan, inf], [0.0, 1.0]] }];
        v.heldout = Heldout { rms_nominal: 0.4, rms_refit: inf, rms_final: nan, noise_floor: 0.1, band_hz: nan, ..Heldout::default() };
        v.heldout.joints = vec![HeldoutJoint { joint: name(), unit: name(), rms_tau: nan, ..HeldoutJoint::default() }];
        v.findings = vec![Finding {
            compensation: Compensation::default(),
            rank: 1,
            effect: name(),
            place: places(),
            regime: places(),
            when: name(),
            confidence: nan,
            p_value: nan,
            parameters: [(name(), Estimate { value: nan, ci95: [nan, inf], unit: name() })].into(),
            heldout_rms_before: nan,
            heldout_rms_after: inf,
            says: name(),
            equation: name(),
            look_alikes: vec![LookAlike { effect: name(), place: places(), why_not: name(), separating_experiment: name() }],
            cannot_tell_from: vec![EffectAt { effect: name(), place: places(), separating_experiment: name() }],
            experiments: vec![Experiment {
                against: name(),
                place: places(),
                intervention: name(),
                cos_now: nan,
                cos_expected: inf,
                separates: false,
                says: name(),
            }],
            depends_on_prior: Some(PriorGains { anchored: nan, soft: inf, refit: nan, soft_prior: nan, depends: true }),
        }];
        v.unexplained = Unexplained { present: true, share_of_residual: nan, place: places(), depends_on: places(), says: name() };
        v.minimum_detectable =
            vec![Detectable { effect: name(), place: places(), parameter: name(), value: inf, unit: name(), says: name() }];
        v.invisible = vec![Invisible { effect: name(), place: places(), why: name() }];
        let seen = |kappa| Seen { effect: name(), place: places(), kappa, found: true };
        v.isolability = Isolability { prior: nan, effects: vec![seen(nan), seen(0.5)], cosines: vec![vec![1.0, nan], vec![inf]] };
        let e = &mut d.evidence;
        let joint = JointSeries { joint: name(), unit: name(), recording: name(), time: vec![0.0, 1.0, nan], ..JointSeries::default() };
        e.joints = vec![JointSeries {
            measured: vec![1.0, inf, 2.0],
            nominal: vec![1.0, 2.0],
            heldout_spans: vec![[nan, 1.0], [0.2, 0.7]],
            ..joint
        }];
        let plot = FindingPlot { rank: 1, x_label: name(), y_label: name(), ..FindingPlot::default() };
        e.findings = vec![FindingPlot { x: vec![0.0, nan, 2.0], y: vec![1.0, 2.0, inf], model: vec![1.0], is_heldout: vec![true], ..plot }];
        e.regimes = vec![RegimeCell { joint: name(), regime: name(), share: nan, before: 0.3, after: nan }];
        e.chain = vec![ChainStep { label: name(), heldout_rms: nan }, ChainStep { label: name(), heldout_rms: 0.1 }];
        e.ruled_out = vec![Screened { effect: name(), place: places(), gain: nan, surprise: inf, wins: [1, 2], why_not: name() }];
        (e.null_surprise, e.null_runs) = ([nan, inf], 199);
        d
    }

    #[test]
    fn every_outcome_has_an_answer() {
        for status in [Status::Ok, Status::Unusable, Status::NotRepeatable] {
            let d = empty(status);
            assert!(!outcome(&d.verdict).is_empty() && answer(&d.verdict).ends_with(['.', ';']));
        }
        let mut d = empty(Status::Ok);
        d.verdict.nothing_missing = false;
        d.verdict.unexplained.present = true;
        assert!(outcome(&d.verdict).contains("no name"));
    }
}
