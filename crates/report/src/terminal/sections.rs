//! Everything around the findings: numbers, what is left, what was ruled out, what was recorded.

use pkm_diagnose::Verdict;
use pkm_diagnose::evidence::{ChainStep, Evidence};
use pkm_diagnose::verdict::{Detectable, Heldout, HeldoutJoint, Invisible, RecordingUse, Replay};

use super::ink::{Ink, Tone, bar, clean, left, right, widest};
use crate::format::{percent, short, significant};
use crate::words;

/// Rejected candidates listed.
const RULED_OUT_MAX: usize = 6;

/// Smallest visible sizes listed.
const DETECTABLE_MAX: usize = 8;

/// The verdict's held-out numbers, step by step, and per joint.
pub(super) fn heldout(ink: &mut Ink, heldout: &Heldout, chain: &[ChainStep]) {
    if !words::has_heldout(heldout) {
        return;
    }
    let band = if heldout.band_hz > 0.0 { format!(", {} Hz low-pass", short(heldout.band_hz)) } else { String::new() };
    ink.heading(&format!("Held-out error (rms, share of the measured effort's rms{band})"));
    let mut rows: Vec<(String, f64, Tone)> = match chain {
        [] | [_] => vec![
            ("model as given".to_owned(), heldout.rms_nominal, Tone::Before),
            ("+ parameters refitted".to_owned(), heldout.rms_refit, Tone::Plain),
            ("+ every finding".to_owned(), heldout.rms_final, Tone::After),
        ],
        steps => steps.iter().map(|s| (format!("+ {}", clean(words::added(&s.label))), s.heldout_rms, Tone::Plain)).collect(),
    };
    if let Some(first) = rows.first_mut() {
        first.2 = Tone::Before;
        first.0 = first.0.trim_start_matches("+ ").to_owned();
    }
    if let Some(last) = rows.last_mut() {
        last.2 = Tone::After;
    }
    rows.push(("noise floor".to_owned(), heldout.noise_floor, Tone::Good));
    let largest = rows.iter().map(|r| r.1).filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let width = widest(rows.iter().map(|r| r.0.as_str())).min(48);
    for (label, value, tone) in &rows {
        let (label, number) = (left(label, width), right(&percent(*value), 8));
        ink.line(&[(Tone::Plain, "  "), (Tone::Plain, &label), (*tone, &number), (Tone::Plain, "  "), (*tone, &bar(value / largest))]);
    }
    joints(ink, &heldout.joints);
}

/// The same per joint.
fn joints(ink: &mut Ink, joints: &[HeldoutJoint]) {
    if joints.is_empty() {
        return;
    }
    let width = widest(joints.iter().map(|j| j.joint.as_str())).max(5);
    let columns: String = ["rms measured", "as given", "refitted", "with findings"].map(|h| right(h, 15)).concat();
    ink.line(&[]);
    ink.line(&[(Tone::Soft, &format!("  {}{columns}  unit", left("joint", width)))]);
    for j in joints {
        let number = |x: f64| right(&significant(x, 3), 15);
        ink.line(&[
            (Tone::Plain, "  "),
            (Tone::Bold, &left(&clean(&j.joint), width)),
            (Tone::Plain, &number(j.rms_tau)),
            (Tone::Before, &number(j.rms_nominal)),
            (Tone::Plain, &number(j.rms_refit)),
            (Tone::After, &number(j.rms_final)),
            (Tone::Plain, "  "),
            (Tone::Plain, &j.unit),
        ]);
    }
}

/// Recordings replayed in simulation, drive by drive.
pub(super) fn replay(ink: &mut Ink, replay: &[Replay]) {
    let Some(first) = replay.first() else { return };
    ink.heading("Replayed in simulation (rms of measured less simulated)");
    ink.wrapped("  ", &first.how);
    let width = widest(replay.iter().map(|r| r.joint.as_str())).max(5);
    let columns: String = ["effort before", "after", "position before", "after"].map(|h| right(h, 17)).concat();
    ink.line(&[(Tone::Soft, &format!("  {}{columns}", left("drive", width)))]);
    for r in replay {
        let share = |x: f64| right(&percent(x / r.rms_tau), 17);
        let number = |x: f64| right(&significant(x, 3), 17);
        ink.line(&[
            (Tone::Plain, "  "),
            (Tone::Bold, &left(&clean(&r.joint), width)),
            (Tone::Before, &share(r.effort_before)),
            (Tone::After, &share(r.effort_after)),
            (Tone::Before, &number(r.position_before)),
            (Tone::After, &number(r.position_after)),
        ]);
    }
}

/// What is left after every finding.
pub(super) fn unexplained(ink: &mut Ink, verdict: &Verdict) {
    let u = &verdict.unexplained;
    if !u.present && !words::has_heldout(&verdict.heldout) {
        return;
    }
    ink.heading("Unexplained");
    let tone = if u.present { Tone::Warn } else { Tone::Plain };
    ink.wrapped_in(tone, "  ", words::left_over(u));
    ink.wrapped("  ", &format!("{} of the squared error of the model as given is left", percent(u.share_of_residual)));
    for (label, names) in [("  where       ", &u.place), ("  depends on  ", &u.depends_on)] {
        if !names.is_empty() {
            ink.wrapped(label, &names.join(", "));
        }
    }
}

/// The best of the rejected candidates.
pub(super) fn ruled_out(ink: &mut Ink, evidence: &Evidence) {
    if evidence.ruled_out.is_empty() {
        return;
    }
    let chance = if evidence.null_runs > 0 {
        format!("; chance alone reaches {} sigma", significant(evidence.null_surprise[0], 2))
    } else {
        String::new()
    };
    ink.heading(&format!("Ruled out (gain in held-out squared error{chance})"));
    for s in evidence.ruled_out.iter().take(RULED_OUT_MAX) {
        let sigma = right(&significant(s.surprise, 2), 7);
        let start = format!("  {} {sigma} sigma  {} of {}  ", right(&percent(s.gain), 8), s.wins[0], s.wins[1]);
        ink.wrapped(&start, &format!("{}: {}", words::at(&s.effect, &s.place), s.why_not));
    }
    more(ink, evidence.ruled_out.len(), RULED_OUT_MAX);
}

/// The smallest sizes that would have been seen.
pub(super) fn detectable(ink: &mut Ink, sizes: &[Detectable]) {
    if sizes.is_empty() {
        return;
    }
    ink.heading("Smallest visible (smaller effects may be there)");
    let shown = || sizes.iter().take(DETECTABLE_MAX);
    let names: Vec<String> = shown().map(|d| clean(&words::at(&d.effect, &d.place))).collect();
    let (width, parameters) = (widest(names.iter().map(String::as_str)), widest(shown().map(|d| d.parameter.as_str())));
    for (d, name) in shown().zip(&names) {
        ink.line(&[
            (Tone::Plain, "  "),
            (Tone::Plain, &left(name, width + 2)),
            (Tone::Soft, &left(&clean(&d.parameter), parameters)),
            (Tone::Bold, &right(&significant(d.value, 2), 10)),
            (Tone::Plain, " "),
            (Tone::Plain, &d.unit),
        ]);
    }
    more(ink, sizes.len(), DETECTABLE_MAX);
}

/// What no size would show.
pub(super) fn invisible(ink: &mut Ink, effects: &[Invisible]) {
    if effects.is_empty() {
        return;
    }
    ink.heading("Not to be seen in any size");
    let names: Vec<String> = effects.iter().map(|e| words::at(&e.effect, &e.place)).collect();
    ink.wrapped("  ", &names.join(", "));
}

/// Says how many entries are not listed.
fn more(ink: &mut Ink, n: usize, shown: usize) {
    if n > shown {
        ink.line(&[(Tone::Soft, &format!("  … and {} more", n - shown))]);
    }
}

/// The recordings and what they were used for.
pub(super) fn recordings(ink: &mut Ink, recordings: &[RecordingUse]) {
    if recordings.is_empty() {
        return;
    }
    ink.heading("Recordings");
    let width = widest(recordings.iter().map(|r| r.path.as_str())).min(56);
    for r in recordings {
        let spans: Vec<String> = r.heldout_spans.iter().map(|[a, b]| format!("{}…{}", significant(*a, 3), significant(*b, 3))).collect();
        let spans = if spans.is_empty() { String::new() } else { format!(" ({} s)", spans.join(", ")) };
        let path = left(&clean(&r.path), width + 2);
        let start = format!("  {path}{} samples {} s  ", right(&r.samples.to_string(), 8), right(&significant(r.duration_s, 3), 6));
        ink.wrapped(&start, &format!("{}{spans}", words::used(r.used)));
    }
}

/// What the gate noticed.
pub(super) fn notes(ink: &mut Ink, notes: &[String]) {
    if notes.is_empty() {
        return;
    }
    ink.heading("Notes");
    for note in notes {
        ink.wrapped("  - ", note);
    }
}
