//! The series behind the report's pictures.

use crate::columns::Axis;
use crate::design::View;
use crate::evidence::{FindingPlot, JointSeries, RegimeCell};
use crate::final_fit::{JointError, errors};
use crate::regimes::{main_joint, regimes};
use crate::work::Work;

type Left = [Vec<Vec<f64>>];

/// Held-out spans of a segment `[s]`.
pub(crate) fn heldout_spans(work: &Work, segment: usize) -> Vec<[f64; 2]> {
    let rows = &work.design.rows[segment];
    let mut out: Vec<[f64; 2]> = Vec::new();
    for (i, fold) in rows.fold.iter().enumerate() {
        if fold.is_some() {
            continue;
        }
        let starts = i == 0 || rows.fold[i - 1].is_some();
        match out.last_mut() {
            Some(span) if !starts => span[1] = rows.time[i],
            _ => out.push([rows.time[i]; 2]),
        }
    }
    out
}

/// Measured effort and both models over time.
pub(crate) fn joints(work: &Work, nominal: &Left, left: &Left) -> Vec<JointSeries> {
    let (before, after) = (errors(work, nominal), errors(work, left));
    let model = &work.robot.model;
    let mut out = Vec::new();
    for (s, m) in work.motions.iter().enumerate() {
        for j in 0..work.design.n_drives {
            let joint = &model.joints[model.actuators[j]];
            let measured = work.design.measured_rows(j, s, View::Judge);
            let minus = |e: &[f64]| measured.iter().zip(e).map(|(y, e)| y - e).collect();
            out.push(JointSeries {
                joint: joint.name.clone(),
                unit: joint.kind.unit_effort().to_string(),
                recording: m.segment.name.clone(),
                time: work.design.rows[s].time.clone(),
                nominal: minus(&nominal[j][s]),
                refined: minus(&left[j][s]),
                measured,
                heldout_spans: heldout_spans(work, s),
                rms_nominal: before[j].error,
                rms_refined: after[j].error,
            });
        }
    }
    out
}

/// What is left without a finding, against the variable that explains it.
pub(crate) fn finding(work: &Work, pick: usize, rank: usize, part: &Left, left: &Left) -> FindingPlot {
    let c = &work.candidates[work.picks[pick].candidate];
    let j = main_joint(work, pick, part);
    let model = &work.robot.model;
    let joint = &model.joints[model.actuators[j]];
    let (name, unit) = (&joint.name, joint.kind.unit_effort());
    let (position, velocity) = (joint.kind.unit_position(), pkm_dyn::effects::Unit::Velocity.text(joint.kind));
    let axis = c.effect.axis();
    let x_label = match axis {
        Axis::Velocity => format!("velocity of {name} [{velocity}]"),
        Axis::Position => format!("position of {name} [{position}]"),
        Axis::Acceleration => format!("acceleration of {name} [{velocity}/s]"),
        Axis::Load => format!("rigid effort of the nominal model at {name} [{unit}]"),
        Axis::Column => format!("effort that {} explains at {name} [{unit}]", c.effect_name()),
    };
    let mut out = FindingPlot { rank, x_label, y_label: format!("effort left at {name} [{unit}]"), ..FindingPlot::default() };
    for (s, rows) in work.design.rows.iter().enumerate() {
        let m = &work.motions[s];
        for i in (0..rows.time.len()).filter(|&i| rows.valid[i]) {
            let raw = work.design.fine[s].raw_index(i).min(m.segment.valid.len() - 1);
            out.x.push(match axis {
                Axis::Velocity => m.segment.v[j][raw],
                Axis::Position => m.segment.q[j][raw],
                Axis::Acceleration => m.segment.a[j][raw],
                Axis::Load => m.rigid[j][raw],
                Axis::Column => part[j][s][i],
            });
            out.y.push(left[j][s][i] + part[j][s][i]);
            out.is_heldout.push(rows.fold[i].is_none());
            out.model.push(part[j][s][i]);
        }
    }
    out
}

/// Errors per joint and regime, before and after.
pub(crate) fn regime_cells(work: &Work, nominal: &Left, left: &Left) -> Vec<RegimeCell> {
    let mut out = Vec::new();
    let efforts: Vec<JointError> = errors(work, left);
    for j in 0..work.design.n_drives {
        for r in regimes(work, j) {
            let (mut before, mut after, mut n, mut total) = (0.0, 0.0, 0_usize, 0_usize);
            for (s, rows) in work.design.rows.iter().enumerate() {
                for i in (0..rows.time.len()).filter(|&i| rows.valid[i]) {
                    total += 1;
                    if r.mask[s][i] {
                        before += nominal[j][s][i] * nominal[j][s][i];
                        after += left[j][s][i] * left[j][s][i];
                        n += 1;
                    }
                }
            }
            let share = |sum: f64| {
                let effort = efforts[j].effort;
                if effort > 0.0 { pkm_dyn::math::sqrt(sum / n.max(1) as f64) / effort } else { 0.0 }
            };
            out.push(RegimeCell {
                joint: work.robot.model.joints[work.robot.model.actuators[j]].name.clone(),
                regime: r.name.to_string(),
                share: n as f64 / total.max(1) as f64,
                before: share(before),
                after: share(after),
            });
        }
    }
    out
}
