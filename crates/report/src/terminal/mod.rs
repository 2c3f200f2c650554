//! The diagnosis as text of about 100 columns, with or without colours.

mod findings;
mod ink;
mod plan;
mod sections;
mod workspace;

use pkm_diagnose::Diagnosis;
use pkm_diagnose::verdict::Status;

use crate::words;
use ink::{Ink, Tone};
pub use plan::plan_terminal;
pub use workspace::workspace_terminal;

/// Whether the text carries colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Text only: for files and pipes.
    Plain,
    /// ANSI colours: for a terminal.
    Colour,
}

/// The diagnosis as text of about 100 columns.
///
/// Control characters in names and paths are replaced, so that a recording cannot write escape sequences to the terminal.
#[must_use]
pub fn terminal(diagnosis: &Diagnosis, style: Style) -> String {
    let (verdict, evidence) = (&diagnosis.verdict, &diagnosis.evidence);
    let mut ink = Ink::new(style);
    let tone = match verdict.status {
        Status::Ok if verdict.findings.is_empty() && !verdict.unexplained.present => Tone::Good,
        Status::Ok => Tone::After,
        Status::Unusable | Status::NotRepeatable => Tone::Before,
    };
    ink.line(&[(Tone::Bold, &verdict.robot), (Tone::Soft, " · "), (tone, &words::outcome(verdict))]);
    for line in words::answer(verdict).lines() {
        ink.wrapped("", line);
    }
    if verdict.status != Status::Unusable {
        sections::heldout(&mut ink, &verdict.heldout, &evidence.chain);
        for finding in &verdict.findings {
            findings::finding(&mut ink, finding, evidence.null_runs);
        }
        sections::replay(&mut ink, &verdict.replay);
        sections::unexplained(&mut ink, verdict);
        sections::ruled_out(&mut ink, evidence);
        sections::detectable(&mut ink, &verdict.minimum_detectable);
        sections::invisible(&mut ink, &verdict.invisible);
    }
    sections::recordings(&mut ink, &verdict.recordings);
    sections::notes(&mut ink, &verdict.notes);
    if !verdict.refined_model.is_empty() {
        ink.heading("Refined model");
        ink.wrapped("  ", &verdict.refined_model);
    }
    ink.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::words::tests::{empty, hostile};
    use pkm_diagnose::verdict::{Heldout, RecordingUse, Use};

    #[test]
    fn every_empty_status_renders() {
        for status in [Status::Ok, Status::Unusable, Status::NotRepeatable] {
            let text = terminal(&empty(status), Style::Plain);
            assert!(text.lines().count() >= 2 && !text.contains('\u{1b}'), "{text}");
        }
    }

    #[test]
    fn unusable_shows_its_reasons_and_no_numbers() {
        let mut d = empty(Status::Unusable);
        d.verdict.says = "A.csv: 40 % of the samples are missing".to_owned();
        d.verdict.heldout = Heldout { rms_nominal: 0.4, ..Heldout::default() };
        let text = terminal(&d, Style::Plain);
        assert!(text.contains("40 % of the samples") && !text.contains("Held-out"));
    }

    #[test]
    fn names_from_files_write_no_escape_sequences() {
        let mut d = empty(Status::Ok);
        d.verdict.robot = "\u{1b}[2Jr\nx".to_owned();
        d.verdict.recordings =
            vec![RecordingUse { path: "\u{7}.csv".to_owned(), samples: 1, duration_s: f64::NAN, used: Use::Both, heldout_spans: vec![] }];
        let text = terminal(&d, Style::Plain) + &terminal(&hostile(), Style::Plain);
        assert!(text.chars().all(|c| c == '\n' || !c.is_control()), "{text:?}");
        assert!(!text.contains("NaN") && !text.contains("inf"));
    }

    #[test]
    fn colours_only_add_escape_sequences() {
        let d = hostile();
        let coloured = terminal(&d, Style::Colour);
        let stripped: String =
            coloured.split('\u{1b}').enumerate().map(|(i, s)| if i == 0 { s } else { s.split_once('m').unwrap().1 }).collect();
        assert_eq!(stripped, terminal(&d, Style::Plain));
    }
}
