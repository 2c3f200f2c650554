//! Where a hand could lie that makes the drives scatter, and whether it looks like one hand at all.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::jacobian::{Reference, frame_jacobian};
use pkm_dyn::model::{FrameOnBody, Link};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, loops, math};

use crate::one_hand::Together;
use crate::repeatable::Scatter;
use crate::settings::Settings;
use crate::work::Work;

/// Another link explains the scatter as well when it leaves less than so much more of it.
pub(crate) const AS_WELL: f64 = 0.05;

/// Rows that are asked whether the drives scatter together: hours of a hand say no more than minutes.
const ROWS: usize = 6000;

/// Links on which a force could make the scatter, best first, the farther from the root of equals: link, rms of the force `[N]`, share of
/// the scatter that it leaves. The force acts at the link's origin, or at its centre of mass where that leaves clearly less: nobody knows where a hand lies.
pub(crate) fn places(work: &Work, scatter: &Scatter) -> Vec<(usize, f64, f64)> {
    let points = points(work);
    // Force squared, what is left, what there was, rows.
    let mut sums = vec![[0.0_f64; 4]; points.len()];
    let rows: Vec<(usize, usize)> = rows_of(scatter).collect();
    let is_closed = along(work, &rows, &mut |data, row| {
        let (s, i) = rows[row];
        let y = DVector::from_iterator(work.robot.model.n_act(), (0..work.robot.model.n_act()).map(|j| felt(work, scatter, j, (s, i))));
        for (sum, (_, point)) in sums.iter_mut().zip(&points) {
            let (force, left) = force_at(&lever(work, data, point), &y);
            sum[0] += force.norm_squared();
            sum[1] += left;
            sum[2] += y.norm_squared();
            sum[3] += 1.0;
        }
    });
    if !is_closed {
        return Vec::new();
    }
    let each = points.iter().zip(sums).filter(|(_, s)| s[3] > 0.0 && s[2] > 0.0 && s[0] > 0.0);
    let found: Vec<(usize, f64, f64)> = each.map(|((link, _), s)| (*link, math::sqrt(s[0] / s[3]), s[1] / s[2])).collect();
    // The origin comes first, and stays where the centre of mass is no better.
    let better = |of_link: &[(usize, f64, f64)]| of_link.iter().copied().reduce(|a, b| if b.2 + AS_WELL < a.2 { b } else { a });
    let mut out: Vec<(usize, f64, f64)> = found.chunk_by(|a, b| a.0 == b.0).filter_map(better).collect();
    let best = out.iter().map(|o| o.2).fold(f64::INFINITY, f64::min);
    // Among those that do as well as the best, the last link comes first: people hold on to the end of a robot.
    out.sort_by_key(|o| o.2 >= best + AS_WELL);
    out
}

/// How probable it is that drives which scatter each on its own look as much like one force on a link as these do; one where the robot cannot be followed.
pub(crate) fn chance_alone(work: &Work, scatter: &Scatter, settings: &Settings) -> f64 {
    let all = contrasts(scatter);
    let kept: Vec<Contrast> = all.iter().copied().step_by(all.len().div_ceil(ROWS).max(1)).collect();
    let same = |c: &Contrast| &scatter.alike[c.segment][c.instant][..c.periods];
    let rows: Vec<(usize, usize)> = kept.iter().filter_map(|c| Some((c.segment, *same(c).last()?))).collect();
    let of_drive = |j: usize| kept.iter().map(|c| contrast(same(c), |i| felt(work, scatter, j, (c.segment, i)))).collect();
    let series: Vec<Vec<f64>> = (0..work.robot.model.n_act()).map(of_drive).collect();
    let run = |c: &Contrast| (c.segment, c.periods);
    let starts: Vec<usize> = (1..kept.len()).filter(|&i| run(&kept[i]) != run(&kept[i - 1])).collect();
    let points = points(work);
    let mut together = Together::new(&series, &starts, points.len(), (settings.null_runs, settings.seed));
    let is_closed = along(work, &rows, &mut |data, row| {
        points.iter().enumerate().for_each(|(p, (_, point))| together.add(row, p, &lever(work, data, point)));
    });
    if is_closed { together.chance() } else { 1.0 }
}

/// An instant of the motion in the last of so many periods, against those before it.
#[derive(Clone, Copy)]
struct Contrast {
    segment: usize,
    instant: usize,
    periods: usize,
}

/// All of them, by segment, period and then instant.
fn contrasts(scatter: &Scatter) -> Vec<Contrast> {
    let of_segment = |(segment, instants): (usize, &Vec<Vec<usize>>)| {
        let most = instants.iter().map(Vec::len).max().unwrap_or(0);
        let that_have = |periods: usize| (0..instants.len()).filter(move |&i| instants[i].len() >= periods);
        (2..=most).flat_map(|periods| that_have(periods).map(move |instant| Contrast { segment, instant, periods })).collect::<Vec<_>>()
    };
    scatter.alike.iter().enumerate().flat_map(of_segment).collect()
}

/// The last of these rows against the mean of those before it, with the spread of a single one: as scatter about a mean sums to zero over the periods, its
/// rows are not independent; these differences are (Helmert's).
fn contrast(same: &[usize], value: impl Fn(usize) -> f64) -> f64 {
    let [before @ .., last] = same else { return 0.0 };
    let n = before.len() as f64;
    (before.iter().map(|&i| value(i)).sum::<f64>() / n - value(*last)) * math::sqrt(n / (n + 1.0))
}

/// Segment and row of all scatter.
fn rows_of(scatter: &Scatter) -> impl Iterator<Item = (usize, usize)> {
    scatter.rows.iter().enumerate().flat_map(|(s, rows)| rows.iter().map(move |&i| (s, i)))
}

/// Weighted scatter of a drive: what pushes the robot is effort that the drives are spared.
fn felt(work: &Work, scatter: &Scatter, joint: usize, (segment, row): (usize, usize)) -> f64 {
    -work.design.weight[joint] * scatter.series[segment][joint][row]
}

/// Takes the robot along these rows, segment and row each, and calls back with the robot there and the number of the row; whether its loops close all along.
fn along(work: &Work, rows: &[(usize, usize)], visit: &mut dyn FnMut(&mut Data, usize)) -> bool {
    let model = &work.robot.model;
    let mut data = Data::new(model);
    let mut before = None;
    for (number, &(s, i)) in rows.iter().enumerate() {
        let segment = &work.motions[s].segment;
        let raw = work.design.fine[s].raw_index(i).min(segment.valid.len() - 1);
        let at = |x: &[Vec<f64>]| x.iter().map(|x| x[raw]).collect::<Vec<f64>>();
        let (q, v, a) = (at(&segment.q), at(&segment.v), at(&segment.a));
        if before != Some(s) && loops::assemble(model, &mut data).is_closed && loops::walk_to(model, &mut data, &q).is_closed {
            before = Some(s);
        }
        if !closed_loop_motion(model, &mut data, &q, &v, &a).is_closed {
            return false;
        }
        loops::drive_reduction(model, &mut data);
        visit(&mut data, number);
    }
    true
}

/// Where a hand may lie: origin and centre of mass of each link that moves, the farthest from the root first.
fn points(work: &Work) -> Vec<(usize, FrameOnBody)> {
    let model = &work.robot.model;
    let links = model.massive_links().into_iter().rev().filter(|&l| model.links[l].body.is_some());
    links.flat_map(|l| points_on(&model.links[l]).map(|point| (l, point))).collect()
}

/// A link's origin and its centre of mass.
fn points_on(link: &Link) -> [FrameOnBody; 2] {
    let centre = link.parameters.first_moment() / link.parameters.mass.max(f64::MIN_POSITIVE);
    let at = |point| FrameOnBody { body: link.body, pose: link.pose.compose(&Pose { translation: point, ..Pose::identity() }) };
    [at(Vector3::zeros()), at(centre)]
}

/// Weighted effort at the drives, drives x 3, of a unit force at a point along each axis of the base.
fn lever(work: &Work, data: &mut Data, point: &FrameOnBody) -> DMatrix<f64> {
    let model = &work.robot.model;
    let jacobian = frame_jacobian(model, data, point, Reference::LocalWorldAligned).clone();
    let entry = |k: usize, axis: usize| (0..model.nv()).map(|j| jacobian[(axis, j)] * data.drive_reduction[(j, k)]).sum::<f64>();
    DMatrix::from_fn(model.n_act(), 3, |k, axis| work.design.weight[k] * entry(k, axis))
}

/// Force of that lever that explains weighted efforts `y` at the drives best, and the square that it leaves.
fn force_at(lever: &DMatrix<f64>, y: &DVector<f64>) -> (Vector3<f64>, f64) {
    let normal: Matrix3<f64> = (lever.transpose() * lever).fixed_view::<3, 3>(0, 0).into_owned();
    let rhs = lever.transpose() * y;
    // Directions that no drive feels stay free of force.
    let ridge = 1e-6 * normal.trace().max(f64::MIN_POSITIVE);
    let force = (normal + Matrix3::identity() * ridge).try_inverse().map_or(Vector3::zeros(), |m| m * Vector3::new(rhs[0], rhs[1], rhs[2]));
    let left = (y - lever * force).norm_squared();
    (force, left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contrasts_hold_the_scatter_about_the_mean_and_nothing_twice() {
        let y = [0.3, -1.2, 2.5, 0.7];
        let of = |periods: usize| contrast(&(0..periods).collect::<Vec<_>>(), |i| y[i]);
        let mean = y.iter().sum::<f64>() / 4.0;
        let about: f64 = y.iter().map(|x| (x - mean) * (x - mean)).sum();
        let held: f64 = (2..=4).map(|n| of(n) * of(n)).sum();
        assert!((held - about).abs() < 1e-12, "{held} of {about}");
    }
}
