//! Per joint and recording: measured against model over time, and the residual before and after.

use pkm_diagnose::evidence::JointSeries;

use super::{esc, num};
use crate::format::significant;
use crate::svg::{Axis, Frame, Plot, decimate, path, spans};

/// Points per line at most.
const POINTS_MAX: usize = 1500;

/// Points of all lines together at most: keeps the page below 2 MB however many recordings there are.
const POINTS_TOTAL: usize = 160_000;

/// Lines drawn per joint and recording.
const LINES: usize = 5;

/// One pair of pictures per joint and recording.
pub(super) fn section(series: &[JointSeries]) -> String {
    let n_max = (POINTS_TOTAL / (LINES * series.len().max(1))).clamp(120, POINTS_MAX);
    let mut out = String::new();
    for s in series {
        out.push_str(&pair(s, n_max));
    }
    if out.is_empty() {
        return out;
    }
    let legend = concat!(
        r#"<p class="legend"><span class="key l-measured">measured</span><span class="key l-before">model as given</span>"#,
        r#"<span class="key l-after">refined model</span><span class="key k-span">held out: seen by no fit</span></p>"#,
    );
    format!("{legend}{out}")
}

/// Effort on top, residual below, on the same time axis; empty without a finite sample.
fn pair(s: &JointSeries, n_max: usize) -> String {
    let efforts = || s.measured.iter().chain(&s.nominal).chain(&s.refined).copied();
    let residual = |model: &[f64]| -> Vec<f64> { s.measured.iter().zip(model).map(|(m, f)| m - f).collect() };
    let (before, after) = (residual(&s.nominal), residual(&s.refined));
    // An effort left is judged by its size: zero belongs into the picture.
    let left = || before.iter().chain(&after).copied().chain([0.0]);
    let (Some(x), Some(y), Some(z)) =
        (Axis::over(s.time.iter().copied(), 0.0, 8.0), Axis::over(efforts(), 0.06, 4.0), Axis::over(left(), 0.06, 4.0))
    else {
        return String::new();
    };
    let (top, bottom) = (Frame { x: x.clone(), y }, Frame { x, y: z });
    let line = |frame: &Frame, values: &[f64], class: &str| path(frame, &decimate(&s.time, values, n_max), class);
    let shade = spans(&top, &s.heldout_spans);
    let efforts =
        shade.clone() + &line(&top, &s.measured, "measured") + &line(&top, &s.nominal, "before") + &line(&top, &s.refined, "after");
    let residuals = shade + &line(&bottom, &before, "before") + &line(&bottom, &after, "after");
    let plot = |title: &str, frame: &Frame, labels: [&str; 2], class: &str, layers: &str| {
        let title = format!("{title} at {} over time, recording {}", s.joint, s.recording);
        Plot { title: &title, frame, x_label: labels[0], y_label: labels[1], class, layers }.render()
    };
    let effort = plot("Measured and modelled effort", &top, ["", &format!("effort [{}]", s.unit)], "mid flush", &efforts);
    let error = plot("Effort left", &bottom, ["time [s]", &format!("measured − model [{}]", s.unit)], "low", &residuals);
    format!(r#"<div class="card joint">{}{effort}{error}</div>"#, heading(s))
}

/// Joint, recording and what the error was and is.
fn heading(s: &JointSeries) -> String {
    let left = match s.rms_refined / s.rms_nominal {
        r if r.is_finite() && r < 0.995 => format!(" ({} % less)", num(&significant(100.0 * (1.0 - r), 2))),
        _ => String::new(),
    };
    format!(
        concat!(
            r#"<div class="jhead"><h3>{} <span class="soft">in <code>{}</code></span></h3><p>rms error of all that is held out "#,
            r#"<b class="c-before">{}</b> → <b class="c-after">{}</b> {}{}</p></div>"#
        ),
        esc(&s.joint),
        esc(&s.recording),
        num(&significant(s.rms_nominal, 3)),
        num(&significant(s.rms_refined, 3)),
        esc(&s.unit),
        left
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(n: u32) -> JointSeries {
        let time: Vec<f64> = (0..n).map(|i| f64::from(i) * 1.0e-3).collect();
        let wave = |gain: f64| time.iter().map(|t| gain * ((t * 1.7) % 3.0 - 1.5)).collect::<Vec<f64>>();
        JointSeries {
            joint: "q<1>".to_owned(),
            unit: "N".to_owned(),
            recording: "A.csv".to_owned(),
            measured: wave(100.0),
            nominal: wave(80.0),
            refined: wave(99.0),
            time,
            ..JointSeries::default()
        }
    }

    #[test]
    fn many_long_recordings_stay_below_two_megabytes() {
        let all: Vec<JointSeries> = (0..18).map(|_| series(20_000)).collect();
        let drawn = section(&all);
        assert!(drawn.len() < 1_900_000, "{}", drawn.len());
        assert!(!drawn.contains("NaN") && !drawn.contains("q<1>"));
    }

    #[test]
    fn empty_series_are_left_out() {
        assert!(section(&[]).is_empty() && section(&[JointSeries::default()]).is_empty());
        let ragged = JointSeries { time: vec![0.0, 1.0], measured: vec![1.0], ..JointSeries::default() };
        assert!(section(&[ragged]).contains("<svg"));
    }
}
