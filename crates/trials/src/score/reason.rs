//! Why a case failed, from what the verdict itself says of the effect that was concealed: its own reasons, opened beside the answer.

use alloc::collections::BTreeMap;
use core::fmt::Write as _;

use super::judge::{Marks, is_it, meets};
use super::table::{has_failed, is_large};
use super::verdict::{Finding, Verdict};
use crate::case::{Answer, Concealed, Level};

/// A reason for every effect that is not the first name, every name of a healthy robot, and every name of what no catalogue has.
///
/// Empty where nothing went wrong. The texts are the verdict's where it has one.
pub(super) fn reasons(answer: &Answer, verdict: Option<&Verdict>) -> Vec<String> {
    let Some(v) = verdict else { return vec!["no verdict".to_string()] };
    match answer.level {
        Level::L6 | Level::L7 => v.findings.iter().map(weight).collect(),
        Level::L5 if v.findings.is_empty() && !v.unexplained.present => {
            vec![format!("what repeats of the rest did not stand out; left of the effort: {:.1} %", 100.0 * v.heldout.rms_final)]
        }
        Level::L5 => v.findings.iter().map(weight).collect(),
        // Two effects have no order: each must be there.
        _ => answer.concealed.iter().filter_map(|t| reason(t, v, answer.concealed.len() > 1)).collect(),
    }
}

/// What a name that should not be there takes away, and how sure it is.
fn weight(f: &Finding) -> String {
    let ratio = f.after / f.before.max(1e-300);
    let gain = 1.0 - ratio * ratio;
    format!("{} takes away {:.1} % of the squared error, confidence {:.2}", f.effect, 100.0 * gain, f.confidence)
}

/// Why `truth` is not the first finding, or none at all where the order does not matter; none where it is.
fn reason(truth: &Concealed, v: &Verdict, any_rank: bool) -> Option<String> {
    let is = |effect: &str, place: &[String]| is_it(effect, place, truth);
    match v.findings.iter().position(|f| is(&f.effect, &f.place)) {
        Some(0) => return None,
        Some(_) if any_rank => return None,
        Some(rank) => return Some(format!("finding {}", rank + 1)),
        None => {}
    }
    if let Some(f) = v.findings.iter().find(|f| f.cannot_tell_from.iter().any(|o| is(&o.effect, &o.place))) {
        return Some(format!("in the set of {}", f.effect));
    }
    if let Some(r) = v.ruled_out.iter().find(|r| is(&r.effect, &r.place)) {
        return Some(r.why_not.clone());
    }
    for f in &v.findings {
        if let Some(o) = f.look_alikes.iter().find(|o| is(&o.effect, &o.place)) {
            return Some(format!("look-alike of {}: {}", f.effect, o.why_not));
        }
    }
    if v.findings.iter().any(|f| f.effect == truth.effect && !meets(&f.place, &truth.place)) {
        return Some("named elsewhere".to_string());
    }
    if let Some(i) = v.invisible.iter().find(|i| is(&i.effect, &i.place)) {
        return Some(format!("cannot be seen: {}", i.why));
    }
    Some(limit(truth, v))
}

/// What was concealed beside the smallest that the verdict says it can see.
fn limit(truth: &Concealed, v: &Verdict) -> String {
    for m in v.minimum_detectable.iter().filter(|m| is_it(&m.effect, &m.place, truth)) {
        if let Some(p) = truth.parameters.iter().find(|p| p.name == m.parameter) {
            let change = (p.value - p.from).abs();
            let side = if change < m.value { "below" } else { "above" };
            return format!("{side} its limit: {change:.3e} of {} concealed, {:.3e} can be seen", p.name, m.value);
        }
    }
    if v.minimum_detectable.iter().any(|m| is_it(&m.effect, &m.place, truth)) {
        return "its gain is not among the forty largest that were ruled out".to_string();
    }
    "not looked for there".to_string()
}

/// A reason without its numbers, so that like reasons can be counted.
fn kind(reason: &str) -> String {
    let mut out = String::new();
    let mut in_number = false;
    let mut rest = reason.chars().peekable();
    let mut before = ' ';
    while let Some(c) = rest.next() {
        let next_is_digit = rest.peek().is_some_and(char::is_ascii_digit);
        let starts = c.is_ascii_digit() && !before.is_alphanumeric() || (c == '-' && next_is_digit && !before.is_alphanumeric());
        let goes_on =
            in_number && (c.is_ascii_digit() || ['.', 'e', '-', '+'].contains(&c)) && (c.is_ascii_digit() || next_is_digit || c == 'e');
        if starts && !in_number {
            out.push('…');
        }
        in_number = starts || goes_on;
        if !in_number {
            out.push(c);
        }
        before = c;
    }
    out
}

/// How often each reason was given, in Markdown: of effects that L0 to L4 conceal, below size 1.5 and from there on, then the others.
pub(super) fn counted(marks: &[Marks]) -> String {
    let mut rows: BTreeMap<String, [usize; 4]> = BTreeMap::new();
    for m in marks.iter().filter(|m| has_failed(m)) {
        let column = match m.level {
            Level::L5 => 2,
            Level::L6 | Level::L7 => 3,
            _ => usize::from(is_large(m)),
        };
        for why in &m.reasons {
            rows.entry(kind(why)).or_default()[column] += 1;
        }
    }
    let mut rows: Vec<(String, [usize; 4])> = rows.into_iter().collect();
    rows.sort_by(|a, b| (b.1[1], b.1.iter().sum::<usize>()).cmp(&(a.1[1], a.1.iter().sum::<usize>())).then(a.0.cmp(&b.0)));
    let mut out = String::from(
        "| reason, numbers left out | L0 to L4, below size 1.5 | from 1.5 | outside the catalogue (L5) | healthy (L6, L7) |\n|---|---|---|---|---|\n",
    );
    for (why, [small, large, outside, healthy]) in rows {
        let _ = writeln!(out, "| {} | {small} | {large} | {outside} | {healthy} |", cell(&why));
    }
    out
}

/// Text that ends no cell of a table.
pub(super) fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Ran, judge};
    use super::*;
    use crate::menu::Parameter;

    fn answer(level: Level, effects: &[(&str, &str)]) -> Answer {
        let one = |(effect, place): &(&str, &str)| Concealed {
            effect: (*effect).to_string(),
            place: vec![(*place).to_string()],
            form: String::new(),
            is_textbook: false,
            size: Some(2.0),
            beside_refit: None,
            effort_share: None,
            parameters: vec![Parameter { name: "mu".to_string(), value: 0.3, from: 0.1 }],
        };
        Answer {
            schema: String::new(),
            salt: String::new(),
            level,
            robot: "prs3".to_string(),
            concealed: effects.iter().map(one).collect(),
            has_patient: false,
            noise_factor: None,
            recordings: None,
            floor: Vec::new(),
        }
    }

    const VERDICT: &str = r#"{"status":"ok","findings":[
        {"effect":"backlash","where":["q1"],"confidence":0.62,"heldout_rms_before":0.10,"heldout_rms_after":0.09,
         "cannot_tell_from":[{"effect":"spring","where":["q1"]}],
         "look_alikes":[{"effect":"contact","where":["q1"],"why_not":"explains less"}]},
        {"effect":"friction_load","where":["q6"]}],
        "ruled_out":[{"effect":"cable_force","where":["q1"],"why_not":"helps in 12 of 20 blocks only"}],
        "invisible":[{"effect":"payload","where":["q1"],"why":"its columns are zero"}],
        "minimum_detectable":[{"effect":"friction_load","where":["q1"],"parameter":"mu","value":0.5},
         {"effect":"friction_viscous","where":["q1"],"parameter":"mu","value":0.05},
         {"effect":"dead_zone","where":["q1"],"parameter":"width","value":0.05}]}"#;

    fn why(level: Level, effects: &[(&str, &str)]) -> Vec<String> {
        reasons(&answer(level, effects), Some(&serde_json::from_str(VERDICT).unwrap()))
    }

    #[test]
    fn the_verdicts_own_words_say_why_the_truth_is_not_the_first_name() {
        let one = |effect: &str, place: &str| why(Level::L2, &[(effect, place)]).join("; ");
        assert_eq!(one("backlash", "q1"), "");
        assert_eq!(one("friction_load", "q6"), "finding 2");
        assert_eq!(one("spring", "q1"), "in the set of backlash");
        assert_eq!(one("cable_force", "q1"), "helps in 12 of 20 blocks only");
        assert_eq!(one("contact", "q1"), "look-alike of backlash: explains less");
        assert_eq!(one("backlash", "q8"), "named elsewhere");
        assert_eq!(one("payload", "q1"), "cannot be seen: its columns are zero");
        assert_eq!(one("friction_viscous", "q1"), "above its limit: 2.000e-1 of mu concealed, 5.000e-2 can be seen");
        assert_eq!(one("dead_zone", "q1"), "its gain is not among the forty largest that were ruled out");
        assert_eq!(one("torque_ripple", "q1"), "not looked for there");
    }

    #[test]
    fn of_two_effects_each_must_be_there_in_any_order() {
        assert!(why(Level::L4, &[("friction_load", "q6"), ("backlash", "q1")]).is_empty());
        assert_eq!(why(Level::L4, &[("friction_load", "q6"), ("spring", "q1")]), ["in the set of backlash"]);
    }

    #[test]
    fn names_of_healthy_robots_tell_what_they_take_away() {
        let named = why(Level::L6, &[]);
        // 1 − 0.9².
        assert_eq!(named[0], "backlash takes away 19.0 % of the squared error, confidence 0.62");
        assert_eq!(reasons(&answer(Level::L6, &[]), None), ["no verdict"]);
    }

    #[test]
    fn like_reasons_are_counted_together() {
        assert_eq!(kind("helps in 12 of 20 blocks only"), "helps in … of … blocks only");
        assert_eq!(kind("stiffens (compliance -3.020e-7), q1 of -0.5 %"), "stiffens (compliance …), q1 of … %");
        let verdict: Verdict = serde_json::from_str(VERDICT).unwrap();
        let truth = answer(Level::L2, &[("cable_force", "q1")]);
        let marks: Vec<Marks> = ["1", "2"].iter().map(|n| judge(n, &truth, Some(&verdict), &Ran::default())).collect();
        assert!(counted(&marks).contains("| helps in … of … blocks only | 0 | 2 | 0 | 0 |"), "{}", counted(&marks));
    }
}
