//! A reproduction as terminal text and as JSON.

use pkm_papers::{Gate, Paper, Reproduction, Row, Verdict};
use serde_json::json;

use crate::out;

/// The table, the reasons below it, and a count.
pub(super) fn text(paper: &Paper, found: &Reproduction) -> String {
    let mut rows = vec![["where", "what", "ours", "paper", "held against", "verdict"].map(String::from).to_vec()];
    rows.extend(found.rows.iter().map(cells));
    let mut parts = vec![format!("{}: {}", paper.key, paper.title), String::new(), out::table(&rows)];
    let reasons = reasons(found);
    if !reasons.is_empty() {
        parts.extend([String::new(), "Notes".to_string()]);
        parts.extend(reasons.into_iter().map(|reason| format!("  {reason}")));
    }
    parts.extend([String::new(), count(found)]);
    parts.join("\n")
}

/// One row as cells of a table.
pub(super) fn cells(row: &Row) -> Vec<String> {
    vec![
        row.place.to_string(),
        row.what.clone(),
        digits(row.ours),
        row.paper.map_or("not printed".to_string(), digits),
        gate(row),
        row.verdict.word().to_string(),
    ]
}

/// Every reason once, with the rows it belongs to.
pub(super) fn reasons(found: &Reproduction) -> Vec<String> {
    let mut out: Vec<(&str, Vec<&str>)> = Vec::new();
    for row in found.rows.iter().filter(|row| !row.why.is_empty()) {
        match out.iter_mut().find(|(why, _)| *why == row.why) {
            Some((_, places)) if places.contains(&row.place) => {}
            Some((_, places)) => places.push(row.place),
            None => out.push((&row.why, vec![row.place])),
        }
    }
    out.into_iter().map(|(why, places)| format!("{}: {why}", places.join(", "))).collect()
}

/// How many rows ended how.
pub(super) fn count(found: &Reproduction) -> String {
    let all = [Verdict::Reproduced, Verdict::ConclusionHolds, Verdict::NotReproducible, Verdict::Missed];
    let of = |verdict: Verdict| found.rows.iter().filter(|row| row.verdict == verdict).count();
    let told: Vec<String> = all.into_iter().filter(|v| of(*v) > 0).map(|v| format!("{} {}", of(v), v.word())).collect();
    format!("{} rows: {}", found.rows.len(), told.join(", "))
}

fn gate(row: &Row) -> String {
    match row.gate {
        Gate::Within(width) if row.paper == Some(row.target) => format!("the paper's ± {}", out::number(width)),
        Gate::Within(width) => format!("{} ± {}", digits(row.target), out::number(width)),
        Gate::AtMost(most) => format!("at most {}", digits(most)),
        Gate::AtLeast(least) => format!("at least {}", digits(least)),
        Gate::Told => "-".to_string(),
    }
}

/// Seven significant digits at most, nothing that says nothing.
fn digits(x: f64) -> String {
    let size = x.abs();
    if !x.is_finite() {
        return "-".to_string();
    }
    if size > 0.0 && !(1e-4..1e7).contains(&size) {
        return format!("{x:.4e}");
    }
    let before = [1e1, 1e2, 1e3, 1e4, 1e5, 1e6].iter().take_while(|&&limit| size >= limit).count();
    let text = format!("{x:.*}", 6 - before.min(6));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

/// The reproduction as JSON.
pub(super) fn json(paper: &Paper, found: &Reproduction) -> anyhow::Result<String> {
    let gate = |row: &Row| match row.gate {
        Gate::Within(width) => json!({"kind": "within", "of": row.target, "width": width}),
        Gate::AtMost(most) => json!({"kind": "at_most", "limit": most}),
        Gate::AtLeast(least) => json!({"kind": "at_least", "limit": least}),
        Gate::Told => json!({"kind": "told"}),
    };
    let row = |row: &Row| {
        json!({
            "place": row.place,
            "what": row.what,
            "ours": row.ours,
            "paper": row.paper,
            "gate": gate(row),
            "verdict": row.verdict.word().to_lowercase(),
            "why": row.why,
        })
    };
    let told = json!({
        "schema": "pkm.reproduction/1",
        "paper": paper.key,
        "title": paper.title,
        "is_sound": found.is_sound(),
        "rows": found.rows.iter().map(row).collect::<Vec<_>>(),
    });
    Ok(serde_json::to_string_pretty(&told)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_enough_to_compare_and_not_more() {
        let texts = [0.0, 20.0, 0.1234567, 8.422_95, 1.000_476, 123_456.7, 2.0e-5, -0.006_012_2].map(digits);
        assert_eq!(texts, ["0", "20", "0.123457", "8.42295", "1.000476", "123456.7", "2.0000e-5", "-0.006012"]);
    }

    #[test]
    fn a_reason_that_several_rows_share_is_told_once() {
        let row = |place| Row::new(place, "x", 1.0, None, Gate::Told).because("no lengths");
        let found = Reproduction { rows: vec![row("eq. 1"), row("eq. 2"), row("eq. 1")], plots: Vec::new() };
        assert_eq!(reasons(&found), ["eq. 1, eq. 2: no lengths"]);
        assert_eq!(count(&found), "3 rows: 3 reproduced");
    }
}
