//! What is left after every finding: where most of the error stays, and on what it depends.

use crate::final_fit::{JointError, errors};
use crate::motion::Motion;
use crate::settings::UNEXPLAINED_SHARE;
use crate::verdict::Unexplained;
use crate::work::Work;

/// Effort share below which a leftover is a nuisance, not a mismatch worth a name: a fifth, with nothing to explain it.
const LARGE: f64 = 0.2;
/// Neighbouring rows of filtered white noise correlate by 0.23; above this it is a shape.
const COLOURED: f64 = 0.5;
/// Held-out share of the leftover that one signal alone must explain to say the leftover depends on it.
const DEPENDS: f64 = 0.1;

type Left = [Vec<Vec<f64>>];

/// Judges the leftover of the final model against that of the model as given, standstill included; `moving` is the same leftover as
/// fits see it, on which dependences are looked for.
pub(crate) fn unexplained(work: &Work, nominal: &Left, left: &Left, moving: &Left) -> Unexplained {
    let (before, after) = (errors(work, nominal), errors(work, left));
    let mut place = Vec::new();
    let mut depends: Vec<(f64, String)> = Vec::new();
    let (mut sum_before, mut sum_after) = (0.0, 0.0);
    for j in 0..work.design.n_drives {
        let noise = noise_power(&left[j]);
        let power = |e: &JointError| (e.error * e.error - noise).max(0.0);
        if after[j].effort > 0.0 {
            let scale = after[j].effort * after[j].effort;
            sum_before += before[j].error * before[j].error / scale;
            sum_after += after[j].error * after[j].error / scale;
        }
        let stays = power(&after[j]) > UNEXPLAINED_SHARE * UNEXPLAINED_SHARE * power(&before[j]) && power(&after[j]) > 0.0;
        let of_effort = after[j].error / after[j].effort.max(f64::MIN_POSITIVE);
        let found = dependence(work, j, &moving[j]);
        let is_shape = of_effort > LARGE && correlation(&left[j]) > COLOURED;
        let is_function = found.first().is_some_and(|(gain, _)| *gain > DEPENDS) && of_effort > 0.5 * LARGE * LARGE;
        if stays && (is_shape || is_function) {
            place.push(work.robot.model.joints[work.robot.model.actuators[j]].name.clone());
            depends.extend(found.into_iter().filter(|(gain, _)| *gain > 0.5 * DEPENDS));
        }
    }
    depends.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut depends_on: Vec<String> = Vec::new();
    for (_, name) in depends {
        if !depends_on.contains(&name) && depends_on.len() < 5 {
            depends_on.push(name);
        }
    }
    let share = if sum_before > 0.0 { (sum_after / sum_before).min(1e6) } else { 0.0 };
    let says = if place.is_empty() {
        String::new()
    } else {
        let on = if depends_on.is_empty() {
            "no single signal explains it".to_string()
        } else {
            format!("it varies with {}", depends_on.join(", "))
        };
        format!("most of the error at {} stays, and nothing in the library explains it; {on}", place.join(", "))
    };
    Unexplained { present: !place.is_empty(), share_of_residual: share, place, depends_on, says }
}

/// Mean square of the part of a leftover that looks white.
pub(crate) fn noise_power(left: &[Vec<f64>]) -> f64 {
    let (mut sum, mut n) = (0.0, 0_usize);
    for w in left.iter().flat_map(|x| x.windows(3)) {
        let d = w[0] - 2.0 * w[1] + w[2];
        sum += d * d / 6.0;
        n += 1;
    }
    sum / n.max(1) as f64
}

/// Correlation of neighbouring rows.
fn correlation(left: &[Vec<f64>]) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for x in left {
        product += x.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
        square += x.iter().map(|v| v * v).sum::<f64>();
    }
    if square > 0.0 { product / square } else { 0.0 }
}

/// A raw signal of a drive.
type Signal = fn(&Motion, usize) -> &Vec<f64>;

/// Signals the leftover of a joint depends on: held-out share that a step function of the signal, fitted on the other rows, explains.
fn dependence(work: &Work, joint: usize, left: &[Vec<f64>]) -> Vec<(f64, String)> {
    let model = &work.robot.model;
    let mut out = Vec::new();
    for (k, &j) in model.actuators.iter().enumerate() {
        let name = &model.joints[j].name;
        let signals: [(&str, Signal); 3] =
            [("q", |m, k| &m.segment.q[k]), ("dq", |m, k| &m.segment.v[k]), ("tau_model", |m, k| &m.rigid[k])];
        for (kind, signal) in signals {
            let values: Vec<Vec<f64>> = (0..work.motions.len())
                .map(|s| {
                    let (grid, raw) = (&work.design.fine[s], signal(&work.motions[s], k));
                    (0..work.design.rows[s].time.len()).map(|i| raw[grid.raw_index(i).min(raw.len() - 1)]).collect()
                })
                .collect();
            out.push((explained_by(work, joint, left, &values), format!("{kind}.{name}")));
        }
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out
}

fn explained_by(work: &Work, joint: usize, left: &[Vec<f64>], values: &[Vec<f64>]) -> f64 {
    const BINS: usize = 12;
    let mut rows: Vec<(f64, f64, bool)> = Vec::new();
    for (s, r) in work.design.rows.iter().enumerate() {
        for i in (0..r.time.len()).filter(|&i| r.valid[i] && r.moving[joint][i]) {
            rows.push((values[s][i], left[s][i], r.fold[i].is_some()));
        }
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut before, mut after) = (0.0, 0.0);
    for bin in rows.chunks(rows.len().div_ceil(BINS).max(1)) {
        let fitted: Vec<f64> = bin.iter().filter(|r| r.2).map(|r| r.1).collect();
        let mean = fitted.iter().sum::<f64>() / fitted.len().max(1) as f64;
        for r in bin.iter().filter(|r| !r.2) {
            before += r.1 * r.1;
            after += (r.1 - mean) * (r.1 - mean);
        }
    }
    if before > 0.0 { 1.0 - after / before } else { 0.0 }
}
