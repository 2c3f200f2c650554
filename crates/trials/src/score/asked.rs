//! What the sizes of a run ask for: how much of the effort an effect makes at the smallest size that can be detected, and above.

use alloc::collections::BTreeMap;
use core::fmt::Write as _;

use super::judge::Marks;
use super::tally::median;

/// Table in Markdown: per effect and robot the share of the effort at sizes 1, 2 and 4.
///
/// Medians of share over size: an effect that is not linear in its size is taken as if it were between the sizes of the run.
#[must_use]
pub(crate) fn asked(marks: &[Marks]) -> String {
    let mut groups: BTreeMap<(&str, &str), Vec<[f64; 3]>> = BTreeMap::new();
    for m in marks {
        for a in m.asked.iter().filter(|a| a.size > 0.0) {
            let floor = m.floor.unwrap_or(f64::NAN);
            groups.entry((a.effect.as_str(), m.robot.as_str())).or_default().push([a.effort / a.size, a.beside, floor]);
        }
    }
    let mut out = String::from(
        "What a size asks for: share of the effort that the effect makes, of which a refit leaves the share beside it, and what the healthy\n\
         robot's own model leaves of the effort below 10 Hz (medians).\n\n\
         | effect | robot | cases | size 1 | size 2 | size 4 | beside a refit | floor |\n|---|---|---|---|---|---|---|---|\n",
    );
    for ((effect, robot), rows) in &groups {
        let middle = |k: usize| median(rows.iter().map(|r| r[k]).collect());
        let percent = |x: Option<f64>| x.map_or_else(|| "–".to_string(), |x| format!("{:.2} %", 100.0 * x));
        let at = |size: f64| percent(middle(0).map(|x| x * size));
        let [one, two, four] = [at(1.0), at(2.0), at(4.0)];
        let _ = writeln!(
            out,
            "| {effect} | {robot} | {} | {one} | {two} | {four} | {} | {} |",
            rows.len(),
            percent(middle(1)),
            percent(middle(2))
        );
    }
    out
}
