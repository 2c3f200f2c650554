//! A push that comes at some time and goes: its force, constant meanwhile, through the link's Jacobian or along a drive's coordinate.
//!
//! When it came and where is looked for beforehand ([`crate::window`]), in what friction and weight of each drive leave of the fitted
//! rows: a grid of times for every link would be thousands of columns. Held-out rows play no part in that, and they confirm or do not.

use pkm_dyn::effects::{Law, LinkState, find};

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, global, local};
use crate::motion::Motion;
use crate::verdict::Use;
use crate::window::{Place, Window, windows};

const FORCE: [&str; 3] = ["fx", "fy", "fz"];
const MOMENT: [&str; 3] = ["mx", "my", "mz"];

/// It acts at that time of every recording.
const ALWAYS: f64 = 0.0;

/// It acted at that time of the fitted recordings alone.
const FITTED: f64 = 1.0;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("external_force")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let has_others = ctx.motions.iter().any(|m| m.segment.used == Use::Holdout);
        windows(ctx.motions)
            .into_iter()
            .map(|(place, window)| match place {
                Place::Drive(k) => Proposal::at_drive(ctx, k, at_drive(k, window, has_others)),
                Place::Link(link) => Proposal::on_link(ctx, link, on_link(link, window, has_others)),
            })
            .collect()
    }

    fn lasts(&self, shape: &[f64]) -> Option<f64> {
        Some(shape[1] - shape[0])
    }

    fn read(&self, view: &View) -> Reading {
        let [start, end] = [view.shape[0], view.shape[1]];
        if view.own.iter().all(|f| f.abs() <= 0.0) {
            return Err("there is no force".to_string());
        }
        let mut out = vec![("start", start), ("end", end)];
        out.extend(FORCE.iter().chain(&MOMENT).copied().zip(view.own.iter().copied()));
        Ok(out)
    }
}

/// The window, and those that begin or end a little sooner or later: that is how well its times are known.
fn tried(w: Window) -> Vec<[f64; 2]> {
    let [start, end, d] = [w.start, w.end, w.step];
    let all = [[start, end], [start - d, end], [start + d, end], [start, end - d], [start, end + d]];
    all.into_iter().filter(|[s, e]| *s >= 0.0 && e - s > 2.0 * d).collect()
}

/// What is left of a push of one at a time `[s]` since the recording began.
fn height(start: f64, end: f64, time: f64) -> f64 {
    let Some(Law::Wrench(law)) = find("external_force").map(|e| e.law) else { return 0.0 };
    -law(&[start, end, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], &LinkState { time, ..LinkState::default() })[0]
}

/// Height at every sample; zero in recordings that it did not act in.
fn heights(m: &Motion, [start, end]: [f64; 2], mode: f64) -> Vec<f64> {
    let acts = mode < 0.5 * (ALWAYS + FITTED) || m.segment.used != Use::Holdout;
    let at = |i: usize| if acts { height(start, end, m.segment.dt * i as f64) } else { 0.0 };
    (0..m.segment.valid.len()).map(at).collect()
}

fn at_drive(drive: usize, window: Window, has_others: bool) -> Vec<Shape> {
    let shape = |times: [f64; 2], mode: f64| {
        let source = local(drive, move |m, _| heights(m, times, mode).iter().map(|h| -h).collect());
        Shape::free(vec![source]).with(vec![times[0], times[1], mode])
    };
    let mut out: Vec<Shape> = tried(window).into_iter().map(|times| shape(times, ALWAYS)).collect();
    out.extend(has_others.then(|| shape([window.start, window.end], FITTED)));
    out
}

fn on_link(link: usize, window: Window, has_others: bool) -> Vec<Shape> {
    let source = |c: usize, times: [f64; 2], mode: f64| {
        global(move |m| {
            let (h, drives) = (heights(m, times, mode), m.rigid.len());
            let Some(p) = m.pushed.iter().find(|p| p.link == link) else { return vec![vec![0.0; h.len()]; drives] };
            (0..drives).map(|k| p.at_samples(c, k).iter().zip(&h).map(|(p, h)| -p * h).collect()).collect()
        })
    };
    let force =
        |times: [f64; 2], mode: f64| Shape::free((0..3).map(|c| source(c, times, mode)).collect()).with(vec![times[0], times[1], mode]);
    let times = [window.start, window.end];
    let mut out: Vec<Shape> = tried(window).into_iter().map(|times| force(times, ALWAYS)).collect();
    // The first three columns once more, with moments: it was not at the link's origin.
    let sources = (0..3).map(Source::Again).chain((3..6).map(|c| source(c, times, ALWAYS))).collect();
    out.push(Shape::free(sources).with(vec![times[0], times[1], ALWAYS]));
    out.extend(has_others.then(|| force(times, FITTED)));
    out
}

/// The values of the shape in which the push of a shape with these values did not act in recordings that are only judged on.
pub(crate) fn in_fitted_only(values: &[f64]) -> Option<[f64; 3]> {
    match values {
        [start, end, mode] if *mode < FITTED => Some([*start, *end, FITTED]),
        _ => None,
    }
}

/// Whether shapes with these values push at a time that they have in common.
pub(crate) fn are_together(a: &[f64], b: &[f64]) -> bool {
    matches!((a, b), ([from, to, ..], [start, end, ..]) if from < end && start < to)
}

/// Whether a shape with these values did not act in recordings that are only judged on.
pub(crate) fn acts_in_fitted_only(values: &[f64]) -> bool {
    values.get(2).is_some_and(|mode| *mode >= FITTED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, all_series, series, view};

    const PUSHED: Window = Window { start: 2.0, end: 4.5, step: 0.1 };

    #[test]
    fn at_a_slider_the_column_is_the_law() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in at_drive(0, PUSHED, false) {
            let reading = Effect.read(&view(&bench.model, &[3.0], &shape.values)).expect("a push may go any way");
            let values = bench.values("external_force", &reading);
            let column = series(&shape.sources[0], &bench.motion);
            assert!(column.iter().enumerate().all(|(i, x)| (3.0 * x - bench.push_at_joint("external_force", &values, i)).abs() < 1e-12));
            assert!(column.iter().any(|x| x.abs() > 0.9) && column.iter().any(|x| x.abs() <= 0.0), "it comes and goes");
        }
    }

    #[test]
    fn on_a_link_across_two_sliders_each_feels_its_own_direction() {
        let bench = Bench::pair();
        let shape = on_link(bench.model.link_index("link1").expect("a link"), PUSHED, false).swap_remove(0);
        let dt = bench.motion.segment.dt;
        for (c, source) in shape.sources.iter().enumerate() {
            for (k, felt) in all_series(source, &bench.motion) {
                for (i, x) in felt.iter().enumerate() {
                    let want = if c == k { -height(PUSHED.start, PUSHED.end, dt * i as f64) } else { 0.0 };
                    assert!((x - want).abs() < 1e-9, "component {c}, drive {k}, sample {i}: {x} instead of {want}");
                }
            }
        }
    }

    #[test]
    fn it_acts_in_fitted_recordings_alone_where_it_must() {
        let mut bench = Bench::sine(0.2, 1.0);
        bench.motion.segment.used = Use::Holdout;
        let times = [PUSHED.start, PUSHED.end];
        assert!(heights(&bench.motion, times, FITTED).iter().all(|h| h.abs() <= 0.0));
        assert!(heights(&bench.motion, times, ALWAYS).iter().any(|h| *h > 0.9));
        assert_eq!(in_fitted_only(&[2.0, 4.5, ALWAYS]), Some([2.0, 4.5, FITTED]));
        assert_eq!(in_fitted_only(&[2.0, 4.5, FITTED]), None);
        assert!(acts_in_fitted_only(&[2.0, 4.5, FITTED]) && !acts_in_fitted_only(&[2.0, 4.5, ALWAYS]));
        assert!(are_together(&[2.0, 4.5, ALWAYS], &[4.0, 6.0, FITTED]) && !are_together(&[2.0, 4.5, ALWAYS], &[4.5, 6.0, ALWAYS]));
    }
}
