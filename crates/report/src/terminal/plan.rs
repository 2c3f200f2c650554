//! A plan as text.

use pkm_diagnose::{Plan, Required};

use super::Style;
use super::ink::{Ink, Tone, clean, left, right};
use super::sections;
use crate::format::fixed;
use crate::words;

/// Pairs listed.
const PAIRS_MAX: usize = 10;

/// A plan as text of about 100 columns: what is asked for, what would be mistaken for what, and the smallest sizes.
#[must_use]
pub fn plan_terminal(plan: &Plan, required: &[Required], style: Style) -> String {
    let mut ink = Ink::new(style);
    let (outcome, class) = words::plan_outcome(plan, required);
    let tone = match class {
        "good" => Tone::Good,
        "bad" => Tone::Before,
        _ => Tone::After,
    };
    ink.line(&[(Tone::Bold, &clean(&plan.robot)), (Tone::Soft, " · "), (tone, &clean(&outcome))]);
    ink.wrapped("", &words::plan_answer(plan));
    let pair = |ink: &mut Ink, effects: &[pkm_diagnose::verdict::EffectAt; 2], cosine: f64, end: (Tone, &str)| {
        let [a, b] = effects.each_ref().map(|e| clean(&words::at(&e.effect, &e.place)));
        let cosine = right(&fixed(cosine, 3), 7);
        ink.line(&[
            (Tone::Plain, "  "),
            (Tone::Bold, &cosine),
            (Tone::Plain, "  "),
            (Tone::Plain, &left(&a, 36)),
            (Tone::Plain, &left(&b, 36)),
            end,
        ]);
    };
    if !required.is_empty() {
        ink.heading("Asked for (cosine of the angle)");
        for r in required {
            pair(&mut ink, &r.effects, r.cosine, if r.ok { (Tone::Good, "told apart") } else { (Tone::Before, "NOT told apart") });
        }
    }
    if !plan.aliases.is_empty() {
        ink.heading("Could not be told apart (cosine of the angle)");
        for a in plan.aliases.iter().take(PAIRS_MAX) {
            pair(&mut ink, &a.effects, a.cosine, (Tone::Plain, ""));
        }
        if plan.aliases.len() > PAIRS_MAX {
            ink.line(&[(Tone::Soft, &format!("  … and {} more", plan.aliases.len() - PAIRS_MAX))]);
        }
    }
    sections::detectable(&mut ink, &plan.minimum_detectable);
    sections::invisible(&mut ink, &plan.invisible);
    ink.finish()
}
