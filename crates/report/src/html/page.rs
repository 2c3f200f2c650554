//! The page: order of the sections, and what is left out when there is nothing to say.

use pkm_diagnose::Diagnosis;
use pkm_diagnose::verdict::Status;

use super::{esc, findings, isolability, joints, leftover, numbers, prose, replay, tables};
use crate::words;

/// Style sheet of every page.
pub(crate) const STYLE: &str = include_str!("style.css");

/// The diagnosis as one self-contained HTML page: no network, no script, pictures inline.
///
/// Everything that comes from files is escaped; numbers that are not finite are shown as a dash.
#[must_use]
pub fn html(diagnosis: &Diagnosis) -> String {
    let verdict = &diagnosis.verdict;
    let sections = sections(diagnosis);
    let mut body = header(diagnosis, &sections);
    for section in &sections {
        put!(body, r#"<section id="{}"><h2>{}</h2>{}</section>"#, section.id, section.title, section.body);
    }
    put!(
        body,
        "<footer>Verdict layout <code>{}</code>. Every number comes from the nominal robot and the recordings named here",
        esc(&verdict.schema)
    );
    if !verdict.refined_model.is_empty() {
        put!(body, "; the refined model is <code>{}</code>", esc(&verdict.refined_model));
    }
    body.push_str(".</footer>");
    document(&format!("{} – {}", esc(&verdict.robot), esc(&words::outcome(verdict))), &body)
}

/// A whole page; title and body are HTML already.
pub(super) fn document(title: &str, body: &str) -> String {
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">",
            "<title>{}</title><style>{}</style></head>\n<body><main>{}</main></body></html>\n",
        ),
        title, STYLE, body
    )
}

/// One section of the page.
struct Section {
    /// Target of the link to it.
    id: &'static str,
    /// Heading.
    title: &'static str,
    /// Content as HTML.
    body: String,
}

/// The sections that have something to say, in the order of the page.
fn sections(diagnosis: &Diagnosis) -> Vec<Section> {
    let (verdict, evidence) = (&diagnosis.verdict, &diagnosis.evidence);
    let all = [
        ("numbers", "Held-out error", numbers::section(diagnosis)),
        ("findings", "Findings", findings::section(diagnosis)),
        ("unexplained", "What stays unexplained", leftover::section(verdict, evidence)),
        ("joints", "Measured against model", joints::section(&evidence.joints)),
        ("replay", "Replayed in simulation", replay::section(verdict, &evidence.replay)),
        ("compensation", "For the controller", replay::compensation(verdict)),
        ("regimes", "Where the error was, and where it is left", tables::regimes(&evidence.regimes)),
        ("ruled-out", "What was ruled out", tables::ruled_out(evidence)),
        ("isolability", "What these motions can tell apart", isolability::section(&verdict.isolability)),
        ("detectable", "What could not have been seen", tables::unseen(&verdict.minimum_detectable, &verdict.invisible)),
        ("recordings", "Recordings", tables::recordings(&verdict.recordings)),
        ("notes", "Notes on the recordings", tables::notes(&verdict.notes)),
    ];
    let is_usable = verdict.status != Status::Unusable;
    all.into_iter()
        .filter(|(id, _, body)| !body.is_empty() && (is_usable || matches!(*id, "recordings" | "notes")))
        .map(|(id, title, body)| Section { id, title, body })
        .collect()
}

/// Robot, outcome and answer, and links to the sections.
fn header(diagnosis: &Diagnosis, sections: &[Section]) -> String {
    let verdict = &diagnosis.verdict;
    let class = match verdict.status {
        Status::Ok if verdict.findings.is_empty() && !verdict.unexplained.present => "good",
        Status::Ok => "found",
        Status::Unusable | Status::NotRepeatable => "bad",
    };
    let mut out = format!(
        r#"<header><p class="eyebrow">Model against recordings</p><h1>{}</h1><p class="outcome {class}">{}</p><p class="answer">{}</p>"#,
        esc(&verdict.robot),
        esc(&words::outcome(verdict)),
        prose(words::answer(verdict)),
    );
    if verdict.status == Status::Unusable {
        out.push_str(r#"<p class="soft">The gate rejected the recordings, so no model was judged and no effect was looked for.</p>"#);
    }
    if sections.len() > 2 {
        out.push_str("<nav aria-label=\"Sections\">");
        for section in sections {
            put!(out, r##"<a href="#{}">{}</a>"##, section.id, section.title);
        }
        out.push_str("</nav>");
    }
    out.push_str("</header>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::words::tests::{empty, hostile};

    /// Values of one attribute of every element.
    fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
        page.split(&format!(" {name}=\"")).skip(1).filter_map(|rest| rest.split('"').next()).collect()
    }

    #[test]
    fn every_empty_status_renders() {
        for status in [Status::Ok, Status::Unusable, Status::NotRepeatable] {
            let page = html(&empty(status));
            assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));
            assert!(page.contains("<h1>r</h1>") && !page.contains("NaN"));
        }
    }

    #[test]
    fn unusable_shows_reasons_and_recordings_only() {
        let mut d = hostile();
        d.verdict.status = Status::Unusable;
        d.verdict.says = "A.csv: 40 % of the samples are missing".to_owned();
        let page = html(&d);
        assert!(page.contains("40\u{a0}% of the samples") && page.contains("id=\"recordings\""));
        assert!(!page.contains("id=\"findings\"") && !page.contains("id=\"numbers\"") && !page.contains("<svg"));
    }

    #[test]
    fn nothing_from_a_file_becomes_markup() {
        let page = html(&hostile());
        assert!(page.contains("&lt;script&gt;") && !page.contains("<script"), "a name must not become an element");
        assert!(!page.contains("\"><script") && !page.contains("onload=\""));
    }

    #[test]
    fn bad_numbers_never_reach_the_page() {
        let page = html(&hostile());
        assert!(!page.contains("NaN") && !page.contains("inf"), "{page}");
        for d in attributes(&page, "d") {
            assert!(d.chars().all(|c| c.is_ascii_digit() || "MHVhlm -".contains(c)), "{d}");
        }
        for name in ["x", "width", "height", "style"] {
            let bad = |v: &&str| !v.chars().any(|c| c.is_ascii_digit());
            let values = attributes(&page, name);
            assert!(!values.is_empty() && !values.iter().any(bad), "{name}");
        }
    }

    #[test]
    fn the_page_needs_no_network_and_no_script() {
        let page = html(&hostile());
        for word in ["http", "url(", "@import", "<link", "<img", "src="] {
            assert!(!page.contains(word), "{word}");
        }
    }

    #[test]
    fn every_link_has_its_target_and_every_picture_its_title() {
        let page = html(&hostile());
        for target in attributes(&page, "href") {
            assert!(page.contains(&format!("id=\"{}\"", target.trim_start_matches('#'))), "{target}");
        }
        assert_eq!(page.matches("<svg").count(), page.matches("<title>").count() - 1);
        assert!(page.matches("<svg").count() > 4);
    }

    #[test]
    fn tags_are_balanced() {
        let page = html(&hostile());
        for tag in
            ["div", "section", "article", "table", "thead", "tbody", "tr", "th", "td", "svg", "ul", "li", "dl", "p", "figure", "span", "h3"]
        {
            let open = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(open, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
