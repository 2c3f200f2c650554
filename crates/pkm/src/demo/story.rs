//! What the demo tells while it runs.

use std::path::{Path, PathBuf};

use pkm_diagnose::verdict::{Estimate, Finding};
use pkm_diagnose::{Diagnosis, Verdict};
use pkm_dyn::effects::Applied;
use pkm_dyn::urdf::Description;
use pkm_report::Style;

use super::Args;
use super::compare::Errors;
use crate::out::{self, clean, is_coloured, number};
use crate::seal::Seal;

/// Who tells it: nobody, where the outcome is printed as JSON.
#[derive(Debug, Clone, Copy)]
pub(super) struct Story {
    /// Whether nothing is told.
    pub(super) is_silent: bool,
}

impl Story {
    fn say(self, text: &str) -> anyhow::Result<()> {
        if self.is_silent { Ok(()) } else { out::say(text) }
    }

    pub(super) fn begin(self, nominal: &Description, args: &Args, folder: &Path) -> anyhow::Result<()> {
        let model = &nominal.robot.model;
        self.say(&clean(&format!(
            "Robot {} (drives: {}, loops: {}), seed {}; files go to {}/",
            model.name,
            model.n_act(),
            model.loops.len(),
            args.seed,
            folder.display()
        )))
    }

    pub(super) fn sealed(self, seal: &Seal) -> anyhow::Result<()> {
        self.say("\n1. A copy of the robot gets physics that its files do not have, or none. What it is, is sealed in sealed.json:")?;
        self.say(&format!("   SHA-256 {}", seal.hash))
    }

    pub(super) fn recorded(self, paths: &[PathBuf; 2], duration: f64) -> anyhow::Result<()> {
        let [first, second] = paths.each_ref().map(|p| p.file_name().unwrap_or_default().to_string_lossy());
        self.say(&format!(
            "\n2. The copy moved for {duration} s twice, with noise in every sensor: {first}, and {second} of another motion."
        ))?;
        self.say("\n3. Diagnosis from the nominal robot and these two files; the second is only judged on.")
    }

    pub(super) fn answer(self, diagnosis: &Diagnosis) -> anyhow::Result<()> {
        let style = if is_coloured() { Style::Colour } else { Style::Plain };
        let text = pkm_report::terminal(diagnosis, style);
        // What was ruled out and what could not have been seen fill a page; they are in the report.
        let short: Vec<&str> = text.lines().take(SHOWN_LINES).collect();
        for line in &short {
            self.say(&format!("   {line}"))?;
        }
        if text.lines().count() > SHOWN_LINES { self.say("   … more in report.html") } else { Ok(()) }
    }

    /// Says what was concealed and what was found; whether they agree.
    pub(super) fn compare(self, concealed: &[Applied], nominal: &Description, verdict: &Verdict) -> anyhow::Result<bool> {
        let model = &nominal.robot.model;
        self.say("\n4. The seal is unbroken.")?;
        self.say(&clean(&format!("   Concealed: {}", pkm_sim::describe(concealed, model))))?;
        let found: Vec<String> = verdict.findings.iter().map(named).collect();
        self.say(&clean(&format!("   Found:     {}", if found.is_empty() { "nothing".to_string() } else { found.join("; ") })))?;
        if verdict.unexplained.present {
            self.say(&clean(&format!("              and something without a name at {}", verdict.unexplained.place.join(", "))))?;
        }
        let answers: Vec<Answer> = concealed.iter().map(|e| judge(e.entry.name, e.place_name(model), verdict)).collect();
        let is_quiet = verdict.findings.is_empty() && !verdict.unexplained.present;
        let (is_right, words) = match answers.first() {
            None if is_quiet => (true, "Nothing was there and nothing was found."),
            None => (false, "Nothing was there, and something was found all the same."),
            Some(Answer::Named) => (true, "The effect is named and its place is right."),
            Some(Answer::Alias) => {
                (true, "It is among the explanations that these recordings cannot tell from the finding, and the verdict says so.")
            }
            Some(Answer::Elsewhere) => (false, "The effect is named, but at another place."),
            Some(Answer::Other) => (false, "The place is right, but the effect is not named."),
            Some(Answer::Missed) => (false, "It was not found."),
        };
        self.say(&format!("   {words}"))?;
        let extra = verdict.findings.len().saturating_sub(concealed.len().max(1));
        if is_right && extra > 0 {
            self.say(&format!("   Further findings: {extra}."))?;
        }
        Ok(is_right)
    }

    pub(super) fn replayed(self, errors: &Errors) -> anyhow::Result<()> {
        self.say("\n5. The refined robot, loaded from refined.robot.toml, runs in the simulator on the second motion.")?;
        self.say(&format!(
            "   Effort off the recording by {:.1} % of its rms (nominal robot: {:.1} %), {:.1} times less, below {:.1} Hz.",
            100.0 * errors.refined,
            100.0 * errors.nominal,
            errors.nominal / errors.refined.max(f64::MIN_POSITIVE),
            errors.band_hz
        ))
    }

    pub(super) fn files(self, folder: &Path) -> anyhow::Result<()> {
        let names = "report.html verdict.json refined.robot.toml refined.robot.urdf motion1.mcap motion2.mcap sealed.json";
        self.say(&clean(&format!("\nIn {}/: {names}", folder.display())))
    }
}

/// Lines of the report that the demo shows.
const SHOWN_LINES: usize = 45;

fn named(f: &Finding) -> String {
    let unit = |unit: &str| if unit == "1" { String::new() } else { format!(" {unit}") };
    let one = |(name, e): (&String, &Estimate)| format!("{name} = {}{}", number(e.value), unit(&e.unit));
    let parameters: Vec<String> = f.parameters.iter().map(one).collect();
    format!("{} at {}: {} (confidence {:.2})", f.effect, f.place.join(", "), parameters.join(", "), f.confidence)
}

/// How an answer compares with the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// Effect and place.
    Named,
    /// Listed as indistinguishable from a finding.
    Alias,
    /// Right effect, wrong place.
    Elsewhere,
    /// Right place, wrong effect.
    Other,
    /// Neither.
    Missed,
}

fn judge(effect: &str, place: &str, verdict: &Verdict) -> Answer {
    let is_here = |places: &[String]| places.iter().any(|p| p == place);
    let findings = &verdict.findings;
    if findings.iter().any(|f| f.effect == effect && is_here(&f.place)) {
        Answer::Named
    } else if findings.iter().any(|f| f.cannot_tell_from.iter().any(|a| a.effect == effect && is_here(&a.place))) {
        Answer::Alias
    } else if findings.iter().any(|f| f.effect == effect) {
        Answer::Elsewhere
    } else if findings.iter().any(|f| is_here(&f.place)) {
        Answer::Other
    } else {
        Answer::Missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_diagnose::verdict::{EffectAt, Heldout, SCHEMA, Status, Unexplained};

    fn verdict() -> Verdict {
        let at = |effect: &str, place: &str| EffectAt {
            effect: effect.to_string(),
            place: vec![place.to_string()],
            separating_experiment: String::new(),
        };
        let finding = Finding {
            rank: 1,
            effect: "friction_coulomb".to_string(),
            place: vec!["q1".to_string()],
            regime: vec![],
            when: String::new(),
            confidence: 0.9,
            p_value: 0.01,
            parameters: [].into(),
            heldout_rms_before: 0.2,
            heldout_rms_after: 0.1,
            says: String::new(),
            equation: String::new(),
            look_alikes: vec![],
            cannot_tell_from: vec![at("friction_load", "q1")],
            ..Finding::default()
        };
        Verdict {
            schema: SCHEMA.to_string(),
            status: Status::Ok,
            robot: String::new(),
            recordings: vec![],
            nothing_missing: false,
            heldout: Heldout::default(),
            findings: vec![finding],
            unexplained: Unexplained::default(),
            minimum_detectable: vec![],
            refined_model: String::new(),
            says: String::new(),
            notes: vec![],
            ..Verdict::default()
        }
    }

    #[test]
    fn answers_are_judged_by_effect_and_place() {
        let v = verdict();
        assert_eq!(judge("friction_coulomb", "q1", &v), Answer::Named);
        assert_eq!(judge("friction_load", "q1", &v), Answer::Alias);
        assert_eq!(judge("friction_coulomb", "q2", &v), Answer::Elsewhere);
        assert_eq!(judge("spring", "q1", &v), Answer::Other);
        assert_eq!(judge("spring", "q2", &v), Answer::Missed);
    }
}
