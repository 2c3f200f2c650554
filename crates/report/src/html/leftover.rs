//! What stays unexplained: the sentence, what it depends on, and its spectra, as material for a name that is not in the library.

use pkm_diagnose::Verdict;
use pkm_diagnose::evidence::{Dependence, Evidence, Lines};

use super::{esc, num};
use crate::format::percent;
use crate::svg::{Axis, Frame, Plot, path};
use crate::words;

/// What is left after every finding; empty where no model was judged.
pub(super) fn section(verdict: &Verdict, evidence: &Evidence) -> String {
    let u = &verdict.unexplained;
    if !u.present && !words::has_heldout(&verdict.heldout) {
        return String::new();
    }
    let class = if u.present { "callout" } else { "card calm" };
    let mut out = format!(r#"<div class="{class}"><p><b>{}</b></p><dl>"#, esc(words::left_over(u)));
    put!(out, "<dt>left</dt><dd>{} of the squared error of the model as given</dd>", num(&percent(u.share_of_residual)));
    for (label, names) in [("where", &u.place), ("depends on", &u.depends_on)] {
        if !names.is_empty() {
            put!(out, "<dt>{label}</dt><dd>{}</dd>", esc(&names.join(", ")));
        }
    }
    out.push_str("</dl></div>");
    let plots: String = evidence.dependences.iter().map(dependence).chain(evidence.lines.iter().map(lines)).collect();
    if !plots.is_empty() {
        put!(out, r#"<div class="pairs">{plots}</div>"#);
    }
    out
}

/// Mean leftover over a signal, between two standard errors.
fn dependence(d: &Dependence) -> String {
    let (low, high): (Vec<f64>, Vec<f64>) = d.mean.iter().zip(&d.error).map(|(m, e)| (m - e, m + e)).unzip();
    let heights = low.iter().chain(&high).copied().chain([0.0]);
    let (Some(x), Some(y)) = (Axis::over(d.x.iter().copied(), 0.02, 5.0), Axis::over(heights, 0.06, 4.0)) else { return String::new() };
    let frame = Frame { x, y };
    let line = |y: &[f64], class: &str| path(&frame, &d.x.iter().copied().zip(y.iter().copied()).collect::<Vec<_>>(), class);
    let layers = line(&low, "before") + &line(&high, "before") + &line(&d.mean, "after");
    let title = format!("Leftover at {} over {}", d.joint, d.signal);
    let y_label = format!("left at {} [{}]", d.joint, d.unit);
    let x_label = format!("{}: mean and two standard errors", d.signal);
    let plot = Plot { title: &title, frame: &frame, x_label: &x_label, y_label: &y_label, class: "mid", layers: &layers };
    format!(r#"<div class="card">{}</div>"#, plot.render())
}

/// Amplitude over frequency or order.
fn lines(l: &Lines) -> String {
    let heights = l.amplitude.iter().copied().chain([0.0]);
    let (Some(x), Some(y)) = (Axis::over(l.x.iter().copied(), 0.0, 5.0), Axis::over(heights, 0.06, 4.0)) else { return String::new() };
    let frame = Frame { x, y };
    let points: Vec<(f64, f64)> = l.x.iter().copied().zip(l.amplitude.iter().copied()).collect();
    let title = format!("Amplitude of the leftover at {} over {}", l.joint, l.over);
    let y_label = format!("amplitude at {} [{}]", l.joint, l.unit);
    let plot =
        Plot { title: &title, frame: &frame, x_label: &l.over, y_label: &y_label, class: "mid", layers: &path(&frame, &points, "after") };
    format!(r#"<div class="card">{}</div>"#, plot.render())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::words::tests::hostile;

    #[test]
    fn what_is_left_is_drawn_and_hostile_names_are_text() {
        let joint = "q<1>".to_string();
        let d = Dependence {
            joint: joint.clone(),
            x: vec![0.0, 1.0],
            mean: vec![1.0, f64::NAN],
            error: vec![0.1, 0.1],
            ..Dependence::default()
        };
        let l = Lines { joint, x: vec![0.0, 1.0], amplitude: vec![0.0, 2.0], ..Lines::default() };
        let evidence = Evidence { dependences: vec![d], lines: vec![l], ..Evidence::default() };
        let page = section(&hostile().verdict, &evidence);
        assert_eq!(page.matches("<svg").count(), 2, "{page}");
        assert!(page.contains("q&lt;1&gt;") && !page.contains("q<1>") && !page.contains("NaN"));
    }
}
