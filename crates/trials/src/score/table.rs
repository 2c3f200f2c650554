//! Tallies as a table in Markdown.

use alloc::collections::BTreeSet;
use core::fmt::Write as _;

use super::asked::asked;
use super::judge::Marks;
use super::named::named;
use super::reason::{cell, counted};
use super::tally::{Count, Tally, tally};
use crate::case::Level;

pub(crate) fn share(c: Count) -> String {
    c.share().map_or_else(
        || "–".to_string(),
        |[p, low, high]| format!("{:.0} % ({}/{}; {:.0}–{:.0})", 100.0 * p, c.yes, c.all, 100.0 * low, 100.0 * high),
    )
}

fn number(x: Option<f64>) -> String {
    x.map_or_else(|| "–".to_string(), |x| format!("{x:.2}"))
}

/// Whether all that is concealed is large enough to be told with some room: half as large again as what is just seen.
pub(crate) fn is_large(m: &Marks) -> bool {
    m.size.is_some_and(|s| s >= 1.5)
}

/// Bins of sizes.
pub(crate) const SIZES: [(f64, f64); 6] = [(0.0, 0.75), (0.75, 1.5), (1.5, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, f64::INFINITY)];

/// Tallies: all, per level, per size, per noise and number of recordings where they differ, per robot.
pub(crate) fn tallies(marks: &[Marks]) -> Vec<Tally> {
    let mut out = vec![tally("all", marks, |_| true)];
    for (label, most) in [("L2 and L3, size 1.5 and more", f64::INFINITY), ("L2 and L3, size 1.5 to 3", 3.0)] {
        out.push(tally(label, marks, |m| [Level::L2, Level::L3].contains(&m.level) && is_large(m) && m.size.is_some_and(|s| s < most)));
    }
    let is_counted = |m: &Marks| m.level <= Level::L4 && is_large(m);
    out.push(tally("L0 to L4, size 1.5 and more", marks, is_counted));
    out.push(tally("of these, where something is said", marks, |m| is_counted(m) && m.is_detected));
    out.extend(Level::ALL.map(|l| tally(&format!("{l:?}"), marks, move |m| m.level == l)));
    for (low, high) in SIZES {
        let label = if high.is_finite() { format!("size {low} to {high}") } else { format!("size {low} and more") };
        out.push(tally(&label, marks, move |m| m.level <= Level::L4 && m.size.is_some_and(|s| s >= low && s < high)));
    }
    let mut noises: Vec<f64> = marks.iter().map(|m| m.noise).collect();
    noises.sort_by(f64::total_cmp);
    noises.dedup();
    for noise in noises.iter().filter(|_| noises.len() > 1) {
        out.push(tally(&format!("noise × {noise}"), marks, |m| m.noise.total_cmp(noise).is_eq()));
    }
    let counts: BTreeSet<usize> = marks.iter().map(|m| m.recordings).collect();
    for count in counts.iter().filter(|_| counts.len() > 1) {
        out.push(tally(&format!("recordings to learn from: {count}"), marks, |m| m.recordings == *count));
    }
    let robots: BTreeSet<&str> = marks.iter().map(|m| m.robot.as_str()).collect();
    out.extend(robots.into_iter().map(|r| tally(r, marks, move |m| m.robot == r)));
    out.retain(|t| t.cases > 0);
    out
}

/// Tables of a run: tallies, calibration, and every case that failed.
#[must_use]
pub fn markdown(marks: &[Marks]) -> String {
    let tallies = tallies(marks);
    let mut out = String::from(
        "| cases | n | first name right | in the set | mean set | place | regime | detected | explained/oracle | size error | in ci95 | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for t in &tallies {
        let cells = [
            t.label.clone(),
            t.cases.to_string(),
            share(t.first),
            share(t.in_set),
            number(t.set),
            share(t.place),
            share(t.regime),
            share(t.detected),
            number(t.explained),
            number(t.size_error),
            share(t.covered),
            t.seconds.map_or_else(|| "–".to_string(), |s| format!("{s:.0}")),
        ];
        let _ = writeln!(out, "| {} |", cells.join(" | "));
    }
    let all = &tallies[0];
    let _ = writeln!(out, "\n| what | share (count; interval of 95 %) |\n|---|---|");
    for (what, count) in [
        ("diagnoses that ended with a verdict", all.ran),
        ("false alarms, nothing concealed (L6, L7)", all.alarms),
        ("outside the catalogue: said to be unexplained (L5)", all.flagged),
        ("outside the catalogue: given a name (L5)", all.impostors),
        ("two effects: both found (L4)", all.both),
        ("two effects: at least one found (L4)", all.either),
    ] {
        let _ = writeln!(out, "| {what} | {} |", share(count));
    }
    // Alarms per level and noise: what raises them is no news of the average.
    let is_healthy = |label: &str| ["L6", "L7"].contains(&label) || label.starts_with("noise");
    for t in tallies.iter().filter(|t| is_healthy(&t.label) && t.alarms.all > 0) {
        let _ = writeln!(out, "| false alarms, {} | {} |", t.label, share(t.alarms));
    }
    let _ = writeln!(out, "\n| engine | cases |\n|---|---|");
    let engines: BTreeSet<&str> = marks.iter().map(|m| m.engine.as_str()).collect();
    for engine in engines {
        let name = if engine.is_empty() { "not noted" } else { engine };
        let _ = writeln!(out, "| {name} | {} |", marks.iter().filter(|m| m.engine == engine).count());
    }
    let _ = writeln!(out, "\n| stated confidence | mean | right |\n|---|---|---|");
    for (from, to, mean, count) in &all.calibration {
        let _ = writeln!(out, "| {from} to {to} | {mean:.2} | {} |", share(*count));
    }
    for table in [named(marks), asked(marks)].iter().filter(|t| !t.is_empty()) {
        let _ = writeln!(out, "\n{}", table.trim_end());
    }
    let _ = writeln!(out, "\nWhy, in the verdicts' own words:\n\n{}", counted(marks).trim_end());
    let _ =
        writeln!(out, "\nCases that failed:\n\n| case | level | robot | concealed | size | said | why |\n|---|---|---|---|---|---|---|");
    for m in marks.iter().filter(|m| has_failed(m)) {
        let said = if !m.ran {
            "no verdict".to_string()
        } else if m.said.is_empty() {
            "nothing missing".to_string()
        } else {
            m.said.join(", ")
        };
        let concealed = if m.concealed.is_empty() { "nothing".to_string() } else { m.concealed.join(", ") };
        let why = cell(&m.reasons.join("; "));
        let _ = writeln!(out, "| {} | {:?} | {} | {concealed} | {} | {said} | {why} |", m.case, m.level, m.robot, number(m.size));
    }
    out
}

/// The diagnosis beside other methods on the cases that both have seen, as a table in Markdown.
///
/// Methods that name nothing are there for what they explain of the holdout.
#[must_use]
pub fn beside(marks: &[Marks], others: &[(String, Vec<Marks>)]) -> String {
    let mut out = String::from(
        "\nBeside other methods, on the cases that both have seen:\n\n\
         | method | n | first name right | in the set | place | names per healthy robot | false alarms (L6, L7) | given a name (L5) | explained/oracle | s |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut row = |name: &str, marks: &[Marks]| {
        let t = tally(name, marks, |_| true);
        let healthy: Vec<f64> = marks.iter().filter(|m| m.level.is_healthy()).map(|m| m.stated.len() as f64).collect();
        let mean = (!healthy.is_empty()).then(|| healthy.iter().sum::<f64>() / healthy.len() as f64);
        let cells = [
            t.label.clone(),
            t.cases.to_string(),
            share(t.first),
            share(t.in_set),
            share(t.place),
            number(mean),
            share(t.alarms),
            share(t.impostors),
            number(t.explained),
            number(t.seconds),
        ];
        let _ = writeln!(out, "| {} |", cells.join(" | "));
    };
    let is_common = |m: &Marks| others.iter().all(|(_, o)| o.iter().any(|x| x.case == m.case));
    row("pkm diagnose", &marks.iter().filter(|m| is_common(m)).cloned().collect::<Vec<_>>());
    for (name, other) in others {
        row(name, &other.iter().filter(|m| is_common(m) && marks.iter().any(|x| x.case == m.case)).cloned().collect::<Vec<_>>());
    }
    out
}

/// Whether a case is to be listed: a miss, a false alarm, a false name, or only one of two effects.
pub(super) fn has_failed(m: &Marks) -> bool {
    match m.level {
        Level::L6 | Level::L7 => m.is_alarm || !m.ran,
        Level::L5 => !m.is_flagged || m.is_impostor,
        Level::L4 => m.found < 2,
        _ => !m.is_first_right,
    }
}
