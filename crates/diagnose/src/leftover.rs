//! What is left after every finding: where most of the error stays, and on what it depends.

use crate::contest::{Contest, Score};
use crate::dependence::{Depends, Tables, curves, dependences, lines};
use crate::evidence::{Dependence, Lines};
use crate::final_fit::{JointError, errors, errors_in_motion, white_power};
use crate::rows::Rows;
use crate::settings::{Settings, UNEXPLAINED_SHARE};
use crate::verdict::Unexplained;
use crate::work::Work;

/// Effort share below which a leftover is a nuisance, not a mismatch worth a name: a fifth, with nothing to explain it.
const LARGE: f64 = 0.2;
/// Neighbouring rows of filtered white noise correlate by 0.23; above this it is a shape.
const COLOURED: f64 = 0.5;

type Left = [Vec<Vec<f64>>];

/// What stays, and the pictures of it.
pub(crate) struct Leftover {
    pub(crate) verdict: Unexplained,
    pub(crate) curves: Vec<Dependence>,
    pub(crate) lines: Vec<Lines>,
}

/// The same leftover as the verdict judges it, standstill included, before and after, and as fits see it, where a joint moves.
pub(crate) struct Views<'v> {
    pub(crate) nominal: &'v Left,
    pub(crate) left: &'v Left,
    /// Before, as fits see it.
    pub(crate) given: &'v Left,
    pub(crate) moving: &'v Left,
}

/// Judges the leftover of the final model against that of the model as given; `last` are the last decisions, for the best explanation
/// that was refused.
pub(crate) fn unexplained(work: &Work, views: &Views, last: &[Contest], settings: &Settings) -> Leftover {
    let (before, after) = (errors(work, views.nominal), errors(work, views.left));
    let (given, in_motion) = (errors_in_motion(work, views.given), errors_in_motion(work, views.moving));
    let tables = Tables::of(work);
    let depends = dependences(work, &tables, views.moving, settings);
    let mut places = Vec::new();
    let (mut sum_before, mut sum_after) = (0.0, 0.0);
    for j in 0..work.design.n_drives {
        let noise = white_power(&work.design.rows, &views.left[j]);
        let power = |e: &JointError| (e.error * e.error - noise).max(0.0);
        if after[j].effort > 0.0 {
            let scale = after[j].effort * after[j].effort;
            sum_before += before[j].error * before[j].error / scale;
            sum_after += after[j].error * after[j].error / scale;
        }
        let stays = power(&after[j]) > UNEXPLAINED_SHARE * UNEXPLAINED_SHARE * power(&before[j]) && power(&after[j]) > 0.0;
        let is_function = depends[j].iter().any(|d| is_plain(d, (given[j], in_motion[j]), settings));
        // A joint that sticks at its reversals leaves much there that no law of friction can tell: what has no name must stay where it moves.
        let is_large = in_motion[j].error > LARGE * in_motion[j].effort.max(f64::MIN_POSITIVE);
        let is_shape = is_large && correlation(&work.design.rows, &views.moving[j]) > COLOURED;
        if ((stays && is_shape) || is_function) && !is_a_trifle(work, j, last) {
            places.push(j);
        }
    }
    let mut on: Vec<&Depends> =
        places.iter().flat_map(|&j| depends[j].iter().filter(move |d| is_real(d, settings))).filter(|d| d.gain > 0.0).collect();
    on.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut depends_on: Vec<String> = Vec::new();
    for d in on {
        if !depends_on.contains(&d.signal) && depends_on.len() < 5 {
            depends_on.push(d.signal.clone());
        }
    }
    let share = if sum_before > 0.0 { (sum_after / sum_before).min(1e6) } else { 0.0 };
    let says = sentence(work, &places, &depends_on, last);
    let pictured = |j: usize| depends[j].iter().filter(|d| is_real(d, settings)).take(3).map(|d| d.signal.clone()).collect::<Vec<_>>();
    let curves = places.iter().flat_map(|&j| curves(work, &tables, j, views.moving, &pictured(j))).collect();
    let lines = places.iter().flat_map(|&j| lines(work, j, views.moving)).collect();
    let names = places.iter().map(|&j| drive_name(work, j)).collect();
    Leftover {
        verdict: Unexplained { present: !places.is_empty(), share_of_residual: share, place: names, depends_on, says },
        curves,
        lines,
    }
}

/// Whether most of what stays at a joint has a name, and is too small for it: it is explained, and not worth a word.
fn is_a_trifle(work: &Work, joint: usize, last: &[Contest]) -> bool {
    let explains_most = |s: &Score| s.is_small && s.gain > 1.0 - UNEXPLAINED_SHARE * UNEXPLAINED_SHARE;
    last.iter().flat_map(|c| &c.scores).any(|s| explains_most(s) && work.candidates[s.candidate].scope.contains(&joint))
}

fn drive_name(work: &Work, joint: usize) -> String {
    work.robot.model.joints[work.robot.model.actuators[joint]].name.clone()
}

/// More than chance, over all signals and joints at once.
fn is_real(d: &Depends, settings: &Settings) -> bool {
    d.p_value <= settings.confirm_level
}

/// Plain enough to be said without a name for it: no null run reaches it, it holds in blocks that it was not read from, it is worth a share of what
/// the model as given leaves where the joint moves, and it is large enough to be felt: the shares from which an effect is worth a name.
fn is_plain(d: &Depends, (given, now): (JointError, JointError), settings: &Settings) -> bool {
    let is_worth = d.size * d.size > settings.floor * given.error * given.error;
    d.is_beyond_chance && d.is_steady && is_worth && d.size > settings.tolerance * now.effort
}

fn sentence(work: &Work, places: &[usize], depends_on: &[String], last: &[Contest]) -> String {
    if places.is_empty() {
        return String::new();
    }
    let on = if depends_on.is_empty() {
        "no single signal explains it".to_string()
    } else {
        format!("it varies with {}", depends_on.join(", "))
    };
    let names: Vec<String> = places.iter().map(|&j| drive_name(work, j)).collect();
    let is_there = |c: usize| work.candidates[c].scope.iter().any(|j| places.contains(j)) && !work.picks.iter().any(|p| p.candidate == c);
    let rivals = last.iter().flat_map(|c| &c.scores).filter(|s| is_there(s.candidate) && s.gain > 0.0);
    let best = rivals.max_by(|a, b| a.gain.total_cmp(&b.gain)).map_or(String::new(), |s| {
        let c = &work.candidates[s.candidate];
        format!(
            "; the nearest name, {} at {}, would take away {:.0} % of its square and is refused",
            c.effect_name(),
            c.name,
            100.0 * s.gain
        )
    });
    format!("most of the error at {} stays, and nothing in the library explains it; {on}{best}", names.join(", "))
}

/// Correlation of neighbouring rows, those in gaps left out.
fn correlation(rows: &[Rows], left: &[Vec<f64>]) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for (rows, x) in rows.iter().zip(left) {
        let known = |i: usize| rows.valid[i];
        product += (1..x.len()).filter(|&i| known(i) && known(i - 1)).map(|i| x[i] * x[i - 1]).sum::<f64>();
        square += (0..x.len()).filter(|&i| known(i)).map(|i| x[i] * x[i]).sum::<f64>();
    }
    if square > 0.0 { product / square } else { 0.0 }
}
