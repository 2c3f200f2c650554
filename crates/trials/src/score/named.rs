//! How often each effect is named, and what it is called where it is not.

use alloc::collections::BTreeMap;
use core::fmt::Write as _;

use super::judge::Marks;
use super::picture::effect;
use super::table::{is_large, share};
use super::tally::Count;
use crate::case::Level;

/// Table in Markdown: per effect, of the cases with one effect of size 1.5 and more; nothing where there are none.
#[must_use]
pub(crate) fn named(marks: &[Marks]) -> String {
    let mut groups: BTreeMap<&str, Vec<&Marks>> = BTreeMap::new();
    for m in marks.iter().filter(|m| m.level <= Level::L3 && is_large(m)) {
        if let [concealed] = &m.concealed[..] {
            groups.entry(effect(concealed)).or_default().push(m);
        }
    }
    if groups.is_empty() {
        return String::new();
    }
    let mut out = String::from(
        "How often an effect is named, of L0 to L3 with size 1.5 and more:\n\n\
         | effect | first name right | in the set | place | something said | called instead |\n|---|---|---|---|---|---|\n",
    );
    let mut rows: Vec<(Count, &str, Vec<&Marks>)> =
        groups.into_iter().map(|(name, of)| (Count::of(of.iter().map(|m| m.is_first_right)), name, of)).collect();
    // The best first; of those alike the one that was asked oftener.
    rows.sort_by(|(a, ..), (b, ..)| (b.yes * a.all).cmp(&(a.yes * b.all)).then(b.all.cmp(&a.all)));
    for (first, name, of) in rows {
        let [set, place, said] = [|m: &Marks| m.is_in_set, |m: &Marks| m.is_place_right, |m: &Marks| m.is_detected]
            .map(|is: fn(&Marks) -> bool| share(Count::of(of.iter().map(|m| is(m)))));
        let _ = writeln!(out, "| {name} | {} | {set} | {place} | {said} | {} |", share(first), instead(&of));
    }
    out
}

/// Names that came first and are not right, the commonest first.
fn instead(of: &[&Marks]) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for m in of.iter().filter(|m| !m.is_first_right) {
        let Some(said) = m.said.first() else { continue };
        let (truth, said) = (m.concealed.first().map_or("", |c| effect(c)), effect(said));
        let name = if said == truth { format!("{said} elsewhere") } else { said.to_string() };
        *counts.entry(name).or_default() += 1;
    }
    let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
    counts.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    counts.iter().map(|(name, n)| format!("{name} {n}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Ran, judge};
    use super::*;
    use crate::case::Answer;

    #[test]
    fn effects_stand_in_the_order_in_which_they_are_named_and_with_what_they_are_called_instead() {
        let answer = |effect: &str, size: f64| Answer {
            schema: String::new(),
            salt: String::new(),
            level: Level::L2,
            robot: String::new(),
            concealed: vec![serde_json::from_str(&format!(r#"{{"effect":"{effect}","where":["q1"],"size":{size}}}"#)).unwrap()],
            has_patient: false,
            noise_factor: None,
            recordings: None,
            floor: Vec::new(),
        };
        let verdict = |effect: &str, place: &str| {
            serde_json::from_str(&format!(r#"{{"status":"ok","findings":[{{"effect":"{effect}","where":["{place}"]}}]}}"#)).unwrap()
        };
        let marks = [
            judge("1", &answer("spring", 2.0), Some(&verdict("contact", "q1")), &Ran::default()),
            judge("2", &answer("spring", 2.0), Some(&verdict("spring", "q2")), &Ran::default()),
            judge("3", &answer("spring", 4.0), Some(&verdict("contact", "q2")), &Ran::default()),
            judge("4", &answer("payload", 2.0), Some(&verdict("payload", "q1")), &Ran::default()),
            // Too small to count.
            judge("5", &answer("backlash", 1.0), Some(&verdict("payload", "q1")), &Ran::default()),
        ];
        let table = named(&marks);
        let rows: Vec<&str> = table.lines().skip(4).collect();
        assert_eq!(rows.len(), 2, "{table}");
        assert!(rows[0].starts_with("| payload | 100 % (1/1;") && rows[0].ends_with("|  |"), "{}", rows[0]);
        assert!(rows[1].starts_with("| spring | 0 % (0/3;") && rows[1].ends_with("| contact 2, spring elsewhere 1 |"), "{}", rows[1]);
        assert!(named(&marks[4..]).is_empty());
    }
}
