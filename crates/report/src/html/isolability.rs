//! Which effects can be told apart: a heat map of those that matter, and every angle in a table to be opened.

use pkm_diagnose::isolability::{ALIAS_COSINE, Isolability, LEAST_SURVIVING};

use super::{esc, num};
use crate::format::{fixed, percent};
use crate::words;

/// Effects in the picture at most.
const SHOWN_MAX: usize = 14;

/// Neighbours shown of each effect in question.
const NEIGHBOURS: usize = 3;

/// Cosine from which on a neighbour is worth a row.
const NEAR: f64 = 0.3;

/// The section's content; empty where there is nothing to compare.
pub(super) fn section(iso: &Isolability) -> String {
    if iso.effects.len() < 2 {
        return String::new();
    }
    let shown = shown(iso);
    let belief = match iso.prior {
        p if p <= 0.0 => "the inertias of the model taken as exact".to_owned(),
        p if p >= 1e6 => "the inertias of the model refitted".to_owned(),
        p => format!("the inertias of the model within {} of their size", num(&percent(p))),
    };
    let mut out = format!(
        concat!(
            r#"<p class="soft">Cosine of the angle between what two effects leave in the efforts once friction, offsets and {} have taken their "#,
            r#"share: 1 is one and the same, 0 is perfectly separate. Beyond {} these motions hardly show one without the other. Of an effect "#,
            r#"that may take several shapes, the nearest counts. Under <b>κ</b>: the share of each effect that the parameters of the model "#,
            r#"cannot imitate; below {} it is hidden by them.</p>"#
        ),
        belief,
        num(&fixed(ALIAS_COSINE, 2)),
        num(&fixed(LEAST_SURVIVING, 2))
    );
    out.push_str(&map(iso, &shown));
    if shown.len() < iso.effects.len() {
        put!(out, "<details><summary>All {} effects</summary>{}</details>", iso.effects.len(), whole(iso));
    }
    out
}

/// Cosine of two effects; none where the file has no number.
fn cosine(iso: &Isolability, i: usize, j: usize) -> Option<f64> {
    iso.cosines.get(i)?.get(j).copied().filter(|c| c.is_finite())
}

/// What is found with its nearest neighbours; without findings, the closest pairs of all.
fn shown(iso: &Isolability) -> Vec<usize> {
    let n = iso.effects.len();
    let mut out: Vec<usize> = (0..n).filter(|&i| iso.effects[i].found).take(SHOWN_MAX).collect();
    let found = out.clone();
    for &i in &found {
        let mut near: Vec<(usize, f64)> = (0..n).filter(|&j| j != i).filter_map(|j| cosine(iso, i, j).map(|c| (j, c))).collect();
        near.retain(|(_, c)| *c >= NEAR);
        near.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (j, _) in near.into_iter().take(NEIGHBOURS) {
            if !out.contains(&j) && out.len() < SHOWN_MAX {
                out.push(j);
            }
        }
    }
    if found.is_empty() {
        let mut pairs: Vec<(usize, usize, f64)> =
            (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).filter_map(|(i, j)| cosine(iso, i, j).map(|c| (i, j, c))).collect();
        pairs.sort_by(|a, b| b.2.total_cmp(&a.2));
        for k in pairs.into_iter().flat_map(|(i, j, _)| [i, j]) {
            if !out.contains(&k) && out.len() < SHOWN_MAX {
                out.push(k);
            }
        }
    }
    out
}

/// The heat map.
fn map(iso: &Isolability, shown: &[usize]) -> String {
    let mut out = r#"<div class="scroll"><table class="heat iso"><thead><tr><th></th><th></th><th class="n">κ</th>"#.to_owned();
    (1..=shown.len()).for_each(|k| put!(out, r#"<th class="n">{k}</th>"#));
    out.push_str("</tr></thead><tbody>");
    for (k, &i) in shown.iter().enumerate() {
        let e = &iso.effects[i];
        let mark = if e.found { " found" } else { "" };
        put!(
            out,
            r#"<tr><th class="n">{}</th><th class="who{mark}"><code>{}</code> {}</th><td class="none">{}</td>"#,
            k + 1,
            esc(&e.effect),
            esc(&words::places(&e.place)),
            num(&fixed(e.kappa, 2))
        );
        for (l, &j) in shown.iter().enumerate() {
            match cosine(iso, i, j) {
                _ if l == k => out.push_str(r#"<td class="none">·</td>"#),
                Some(c) => {
                    let class = if c > ALIAS_COSINE { r#" class="alias""# } else { "" };
                    put!(out, r#"<td{class} style="--v:{:.2}">{}</td>"#, c.clamp(0.0, 1.0), num(&fixed(c, 2)));
                }
                None => out.push_str(r#"<td class="none">–</td>"#),
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

/// Every angle below the diagonal, in hundredths.
fn whole(iso: &Isolability) -> String {
    let n = iso.effects.len();
    let mut out = r#"<p class="soft">In hundredths; columns are numbered as rows.</p><div class="scroll"><table class="heat iso dense"><thead><tr><th></th><th></th><th class="n">κ</th>"#.to_owned();
    (1..n).for_each(|k| put!(out, "<th>{k}</th>"));
    out.push_str("</tr></thead><tbody>");
    for (i, e) in iso.effects.iter().enumerate() {
        let (name, place) = (esc(&e.effect), words::places(&e.place));
        put!(out, "<tr><th>{}</th><th class=\"who\">{name} {}</th><td class=\"none\">{}</td>", i + 1, esc(&place), num(&fixed(e.kappa, 2)));
        for j in 0..i {
            match cosine(iso, i, j) {
                Some(c) => put!(out, r#"<td style="--v:{:.2}">{}</td>"#, c.clamp(0.0, 1.0), fixed(100.0 * c, 0)),
                None => out.push_str("<td class=\"none\">–</td>"),
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_diagnose::isolability::Seen;

    fn matrix(n: usize, found: &[usize], cosine: impl Fn(usize, usize) -> f64) -> Isolability {
        let seen = |i: usize| Seen { effect: format!("e{i}"), place: vec!["<q>".to_owned()], kappa: 0.5, found: found.contains(&i) };
        let cosines = (0..n).map(|i| (0..n).map(|j| if i == j { 1.0 } else { cosine(i.min(j), i.max(j)) }).collect()).collect();
        Isolability { prior: 0.1, effects: (0..n).map(seen).collect(), cosines }
    }

    #[test]
    fn what_is_found_comes_with_its_nearest_and_nothing_else() {
        let iso = matrix(40, &[7], |i, j| if i == 7 { 1.0 / (j - i) as f64 } else { 0.01 });
        assert_eq!(shown(&iso), [7, 8, 9, 10], "1, 1/2 and 1/3 are near");
        let page = section(&iso);
        assert!(page.contains("<details>") && page.contains("All 40 effects") && !page.contains("<q>"));
    }

    #[test]
    fn without_findings_the_closest_pairs_are_shown() {
        let iso = matrix(30, &[], |i, j| if (i, j) == (3, 21) { 0.99 } else { 0.1 });
        assert_eq!(shown(&iso)[..2], [3, 21]);
        assert_eq!(shown(&iso).len(), SHOWN_MAX);
        assert!(section(&iso).contains(r#"class="alias""#));
    }
}
