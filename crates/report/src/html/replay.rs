//! Recordings replayed in simulation: what the drives of the robot as given and of the refined one do, and what a controller is given.

use pkm_diagnose::Verdict;
use pkm_diagnose::evidence::ReplaySeries;
use pkm_diagnose::verdict::Replay;

use super::{esc, num};
use crate::format::{percent, significant};
use crate::svg::{Axis, Frame, Plot, decimate, path};

/// Points per line at most.
const POINTS_MAX: usize = 800;

/// Pictures at most: the table has every drive.
const PICTURES_MAX: usize = 12;

/// The table of every drive, and a picture of each as long as there are few.
pub(super) fn section(verdict: &Verdict, series: &[ReplaySeries]) -> String {
    let Some(first) = verdict.replay.first() else { return String::new() };
    let mut out = format!(
        concat!(
            r#"<p class="soft">{}. Nothing is fitted here: both robots move by their own equations of motion, and what their drives did is "#,
            r#"held against what was measured, at the recording's own rate. "Before" is the robot as given.</p>"#,
            r#"<div class="scroll"><table><thead><tr><th>drive</th><th>recording</th><th class="n">effort measured</th>"#,
            r#"<th class="n">effort apart: before</th><th class="n">after</th><th class="n">position apart: before</th><th class="n">after</th>"#,
            r#"<th class="n">work measured</th><th class="n">before</th><th class="n">after</th></tr></thead><tbody>"#
        ),
        esc(&first.how)
    );
    for r in &verdict.replay {
        out.push_str(&row(r));
    }
    out.push_str("</tbody></table></div>");
    if series.is_empty() {
        return out;
    }
    out.push_str(concat!(
        r#"<p class="legend"><span class="key l-measured">measured</span><span class="key l-before">simulated as given</span>"#,
        r#"<span class="key l-after">simulated, refined</span></p>"#
    ));
    for s in series.iter().take(PICTURES_MAX) {
        out.push_str(&picture(s));
    }
    if series.len() > PICTURES_MAX {
        put!(out, r#"<p class="soft">{} more drives are in the table only.</p>"#, series.len() - PICTURES_MAX);
    }
    out
}

fn row(r: &Replay) -> String {
    let share = |x: f64| num(&percent(x / r.rms_tau));
    let value = |x: f64| num(&significant(x, 3));
    let work = |x: f64| num(&format!("{} J", significant(x, 3)));
    format!(
        concat!(
            r#"<tr><th>{}</th><td><code>{}</code></td><td class="n">{}</td><td class="n c-before">{}</td><td class="n c-after"><b>{}</b></td>"#,
            r#"<td class="n c-before">{}</td><td class="n c-after"><b>{}</b></td><td class="n">{}</td><td class="n">{}</td><td class="n">{}</td></tr>"#
        ),
        esc(&r.joint),
        esc(&r.recording),
        value(r.rms_tau),
        share(r.effort_before),
        share(r.effort_after),
        value(r.position_before),
        value(r.position_after),
        work(r.work_measured),
        work(r.work_before),
        work(r.work_after)
    )
}

fn picture(s: &ReplaySeries) -> String {
    let efforts = s.measured.iter().chain(&s.given).chain(&s.refined).copied();
    let (Some(x), Some(y)) = (Axis::over(s.time.iter().copied(), 0.0, 8.0), Axis::over(efforts, 0.06, 4.0)) else { return String::new() };
    let frame = Frame { x, y };
    let line = |values: &[f64], class: &str| path(&frame, &decimate(&s.time, values, POINTS_MAX), class);
    let layers = line(&s.measured, "measured") + &line(&s.given, "before") + &line(&s.refined, "after");
    let title = format!("Effort of {} in the replay of {}", s.joint, s.recording);
    let plot = Plot {
        title: &title,
        frame: &frame,
        x_label: "time [s]",
        y_label: &format!("effort of {}", s.joint),
        class: "low",
        layers: &layers,
    };
    format!(r#"<div class="card joint">{}</div>"#, plot.render())
}

/// What a controller is given: the file to load, a controller that computes with it, and what stays to be done by hand.
pub(super) fn compensation(verdict: &Verdict) -> String {
    if verdict.findings.is_empty() {
        return String::new();
    }
    let (inside, by_hand): (Vec<_>, Vec<_>) = verdict.findings.iter().partition(|f| f.compensation.in_refined_model);
    let mut out = String::new();
    let name = |f: &&pkm_diagnose::verdict::Finding| format!("<code>{}</code> at {}", esc(&f.effect), esc(&f.place.join(", ")));
    if !inside.is_empty() {
        let file = if verdict.refined_model.is_empty() { "refined.toml" } else { &verdict.refined_model };
        let written = if verdict.refined_model.is_empty() { "<code>--refined refined.toml</code> writes that robot. " } else { "" };
        let names: Vec<String> = inside.iter().map(name).collect();
        put!(
            out,
            concat!(
                "<p>A controller that computes with the refined robot compensates {}. With this <code>controller.toml</code>:</p><pre>",
                "law = \"computed_torque\"\nrate_hz = 1000.0      # the loop's own rate\nbandwidth = 20.0      # of the error, 1/s: start low, raise while it stays calm\n\n",
                "[friction]\ncompensate = \"all\"\nvelocity = \"reference\"\n</pre><p>{}Try it before the robot does: ",
                "<code>pkm simulate {} --controller controller.toml --out trial.csv</code></p>"
            ),
            names.join(", "),
            written,
            esc(file)
        );
    }
    for f in by_hand {
        put!(out, r#"<p>{}: not in what a controller's model computes; {}.</p>"#, name(&f), esc(&f.compensation.says));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::words::tests::hostile;

    #[test]
    fn efforts_are_shares_of_the_measured_one_and_hostile_names_are_text() {
        let mut verdict = hostile().verdict;
        let joint = "<b>q1".to_string();
        let replay = Replay { joint, rms_tau: 20.0, effort_before: 5.0, effort_after: 0.5, position_before: f64::NAN, ..Replay::default() };
        verdict.replay = vec![replay];
        let series = ReplaySeries { time: vec![0.0, 1.0], measured: vec![0.0, 1.0], ..ReplaySeries::default() };
        let page = section(&verdict, &[series]);
        assert!(page.contains("25.0") && page.contains("2.5"), "{page}");
        assert!(page.contains("&lt;b&gt;q1") && !page.contains("<b>q1") && !page.contains("NaN"));
    }

    #[test]
    fn what_the_file_has_and_what_is_done_by_hand_are_told_apart() {
        let mut verdict = hostile().verdict;
        let mut second = verdict.findings[0].clone();
        verdict.findings[0].compensation.in_refined_model = true;
        second.compensation.says = "shorten the sampling period".to_string();
        verdict.findings.push(second);
        let page = compensation(&verdict);
        assert!(page.contains("computed_torque"), "{page}");
        assert!(page.contains("shorten the sampling period"));
        verdict.findings.truncate(1);
        assert!(!compensation(&verdict).contains("not in what a controller"));
    }
}
