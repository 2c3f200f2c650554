//! When a finding shows: the regimes in which the error it takes away is concentrated.

use pkm_dyn::Model;

use crate::columns::Family;
use crate::design::Design;
use crate::motion::{Motion, top_speed};
use crate::work::Work;

/// A named subset of rows of one joint.
pub(crate) struct Regime {
    pub(crate) name: &'static str,
    /// The condition in numbers.
    pub(crate) condition: String,
    /// Membership: [segment][row].
    pub(crate) mask: Vec<Vec<bool>>,
}

/// The regimes of one joint.
pub(crate) fn regimes(work: &Work, joint: usize) -> Vec<Regime> {
    regimes_on(&work.robot.model, work.motions, &work.design, joint)
}

/// The same before there is anything but rows.
pub(crate) fn regimes_on(model: &Model, motions: &[Motion], design: &Design, joint: usize) -> Vec<Regime> {
    let tree = model.actuators[joint];
    let (name, kind) = (&model.joints[tree].name, model.joints[tree].kind);
    let speed_unit = pkm_dyn::effects::Unit::Velocity.text(kind);
    let top = motions.iter().map(|m| top_speed(&m.segment.v[joint])).fold(0.0, f64::max);
    let mut loads: Vec<f64> = motions.iter().flat_map(|m| m.rigid[joint].iter().map(|l| l.abs())).collect();
    loads.sort_by(f64::total_cmp);
    let heavy = loads.get(loads.len() * 2 / 3).copied().unwrap_or(0.0);
    let rows = |f: &dyn Fn(usize, usize) -> bool| -> Vec<Vec<bool>> {
        design.rows.iter().enumerate().map(|(s, r)| (0..r.time.len()).map(|i| f(s, i)).collect()).collect()
    };
    let v = |s: usize, i: usize| design.rows[s].v[joint][i];
    let near = |s: usize, i: usize| {
        let lo = i.saturating_sub(2);
        let hi = (i + 2).min(design.rows[s].time.len() - 1);
        (lo..hi).any(|k| v(s, k) * v(s, k + 1) < 0.0)
    };
    let load = |s: usize, i: usize| {
        let raw = &motions[s].rigid[joint];
        raw[design.fine[s].raw_index(i).min(raw.len() - 1)].abs()
    };
    let third = |s: usize, i: usize| 3 * i / design.rows[s].time.len().max(1);
    let regime = |name, condition, mask| Regime { name, condition, mask };
    vec![
        regime("moving", format!("{name} moving"), rows(&|s, i| design.rows[s].moving[joint][i])),
        regime("standstill", format!("{name} standing"), rows(&|s, i| !design.rows[s].moving[joint][i])),
        regime("reversal", format!("dq.{name} changes sign"), rows(&near)),
        regime("low_speed", format!("|dq.{name}| < {:.3} {speed_unit}", 0.1 * top), rows(&|s, i| v(s, i).abs() < 0.1 * top)),
        regime("high_speed", format!("|dq.{name}| > {:.3} {speed_unit}", 0.6 * top), rows(&|s, i| v(s, i).abs() > 0.6 * top)),
        regime("high_load", format!("|tau_model.{name}| > {heavy:.3} {}", kind.unit_effort()), rows(&|s, i| load(s, i) > heavy)),
        regime("early", "first third of the time".to_string(), rows(&|s, i| third(s, i) == 0)),
        regime("late", "last third of the time".to_string(), rows(&|s, i| third(s, i) == 2)),
    ]
}

/// Regimes of a pick and the leading one in numbers. `part` is the pick's contribution and `left` what the final model leaves, both
/// [joint][segment][row].
pub(crate) fn of_pick(work: &Work, pick: usize, part: &[Vec<Vec<f64>>], left: &[Vec<Vec<f64>>]) -> (Vec<String>, String) {
    let candidate = &work.candidates[work.picks[pick].candidate];
    let joint = main_joint(work, pick, part);
    let mut out: Vec<(f64, String, String)> = Vec::new();
    let mut moving = String::new();
    for r in regimes(work, joint) {
        let (mut inside, mut n, mut all, mut total) = (0.0, 0_usize, 0.0, 0_usize);
        for (s, rows) in work.design.rows.iter().enumerate() {
            for i in (0..rows.time.len()).filter(|&i| rows.valid[i]) {
                let (e, p) = (left[joint][s][i], part[joint][s][i]);
                let taken = (e + p) * (e + p) - e * e;
                all += taken;
                total += 1;
                if r.mask[s][i] {
                    inside += taken;
                    n += 1;
                }
            }
        }
        let share = n as f64 / total.max(1) as f64;
        let when = format!("{}, {:.0} % of samples", r.condition, 100.0 * share);
        if r.name == "moving" {
            moving = when;
            continue;
        }
        // Concentrated: at least half again as much per sample as on average, in a part that is neither everything nor a handful.
        let density = if all > 0.0 && share > 0.0 { (inside / all) / share } else { 0.0 };
        if density > 1.5 && (0.02..0.6).contains(&share) {
            out.push((density, r.name.to_string(), when));
        }
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut names: Vec<String> = out.iter().map(|r| r.1.clone()).collect();
    let mut when = out.into_iter().next().map(|r| r.2).unwrap_or(moving);
    if candidate.effect.family() == Family::Chain {
        names.insert(0, "high_band".to_string());
        when = format!("fast changes of effort at {}", candidate.places(&work.robot.model).join(" and "));
    }
    if names.is_empty() {
        names.push("moving".to_string());
    }
    (names, when)
}

/// The drive where a pick contributes most to the effort, in units of what a refit leaves there.
pub(crate) fn main_joint(work: &Work, pick: usize, part: &[Vec<Vec<f64>>]) -> usize {
    let scope = &work.candidates[work.picks[pick].candidate].scope;
    let size = |j: usize| -> f64 { work.design.weight[j] * work.design.weight[j] * part[j].iter().flatten().map(|v| v * v).sum::<f64>() };
    scope.iter().copied().filter(|&j| j < work.design.n_drives).max_by(|&a, &b| size(a).total_cmp(&size(b))).unwrap_or(0)
}
