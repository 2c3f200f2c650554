//! What these recordings could not have shown: the smallest size of each effect that would have been named.

use faer::Mat;
use pkm_dyn::effects::{Site, find};
use pkm_dyn::math;
use pkm_dyn::model::JointKind;

use crate::design::ColumnId;
use crate::settings::Settings;
use crate::solve::{Factor, Over, products};
use crate::verdict::Detectable;
use crate::work::Work;

/// Standard deviations a coefficient must stand out by; the search's own threshold over all candidates is of this order.
const SIGMAS: f64 = 3.0;

/// The parameter that the first column's coefficient stands for.
fn leading(effect: &str) -> &'static str {
    match effect {
        "friction_stribeck" => "stiction",
        "friction_asymmetric" => "viscous_pos",
        other => find(other).map_or("", |e| e.parameters[0].name),
    }
}

/// One entry per effect and place, in the candidates' order. `left` is what the final model leaves.
pub(crate) fn detectable(work: &Work, left: &[Vec<Vec<f64>>], settings: &Settings) -> Vec<Detectable> {
    let (mut base, mut prior) = work.with_rigid(work.every_model_has(work.softness), work.kappa);
    let (picked, picked_prior) = work.picked(None);
    for (id, p) in picked.into_iter().zip(picked_prior) {
        if !base.contains(&id) {
            base.push(id);
            prior.push(p);
        }
    }
    let power = left_power(work, left);
    let mut out = Vec::new();
    for c in &work.candidates {
        let mut best: Option<f64> = None;
        for v in c.variants.iter().filter(|v| v.softness.is_none_or(|w| w == work.softness)) {
            // An ordinary parameter is looked for with the others free, itself excepted.
            let others: Vec<usize> = (0..base.len()).filter(|&i| !v.columns.contains(&base[i])).collect();
            let ids: Vec<ColumnId> = others.iter().map(|&i| base[i]).collect();
            let p: Vec<f64> = others.iter().map(|&i| prior[i]).collect();
            let strength = surviving(work, &ids, &p, v.columns[0]);
            if strength <= 0.0 {
                continue;
            }
            let (sum, coloured): (f64, f64) = c.scope.iter().map(|&j| power[j]).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            let efforts = work.kinds_of_rows(&c.scope).into_iter().map(|part| work.effort_over(&part));
            let least_effort = efforts.fold(f64::INFINITY, f64::min);
            let by_chance = SIGMAS * math::sqrt(coloured / c.scope.iter().map(|&j| count(work, j)).sum::<f64>().max(1.0) / strength);
            let by_worth = math::sqrt(settings.floor * sum / strength);
            let by_tolerance = settings.tolerance * math::sqrt(least_effort / strength);
            let size = by_chance.max(by_worth).max(by_tolerance);
            best = Some(best.map_or(size, |b: f64| b.min(size)));
        }
        let Some(mut value) = best.filter(|v| v.is_finite()).and_then(|v| c.effect.smallest(v)).filter(|v| v.is_finite()) else { continue };
        let model = &work.robot.model;
        let parameter = leading(c.effect_name());
        if c.effect_name() == "inertia_error" {
            value *= model.links[c.place].parameters.mass;
        }
        let kind = match c.effect.entry().place.site() {
            Site::Joint => model.joints[c.place].kind,
            _ => JointKind::Prismatic,
        };
        let unit = c.effect.entry().parameters.iter().find(|p| p.name == parameter).map_or("", |p| p.unit.text(kind));
        out.push(Detectable {
            effect: c.effect_name().to_string(),
            place: vec![c.name.clone()],
            parameter: parameter.to_string(),
            value,
            unit: unit.to_string(),
        });
    }
    out
}

/// Squared length of a column per unit coefficient that the base cannot imitate, on the fitted rows.
fn surviving(work: &Work, base: &[ColumnId], prior: &[f64], id: ColumnId) -> f64 {
    let own = products(&work.gram, &[id], &[id], Over::All)[(0, 0)];
    let with: Mat<f64> = products(&work.gram, base, &[id], Over::All);
    let a = Factor::new(products(&work.gram, base, base, Over::All), prior).solve(&with);
    let imitated: f64 = (0..base.len()).map(|i| with[(i, 0)] * a[(i, 0)]).sum();
    let scale = work.gram.scale[id];
    // What is below a millionth of the column is rounding.
    if scale > 0.0 && own - imitated > 1e-6 * own { (own - imitated) / (scale * scale) } else { 0.0 }
}

fn rows_of<'a>(work: &'a Work<'_>, joint: usize) -> impl Iterator<Item = (usize, usize)> + 'a {
    work.design.rows.iter().enumerate().flat_map(move |(s, r)| {
        (0..r.time.len()).filter(move |&i| r.fold[i].is_some() && r.valid[i] && r.moving[joint][i]).map(move |i| (s, i))
    })
}

fn count(work: &Work, joint: usize) -> f64 {
    rows_of(work, joint).count() as f64
}

/// Per joint: weighted squared error over the fitted rows, plain and inflated by the correlation of neighbouring rows.
fn left_power(work: &Work, left: &[Vec<Vec<f64>>]) -> Vec<(f64, f64)> {
    (0..work.design.n_joints)
        .map(|j| {
            let w = work.design.weight[j] * work.design.weight[j];
            let sum: f64 = rows_of(work, j).map(|(s, i)| left[j][s][i] * left[j][s][i]).sum();
            let next: f64 = rows_of(work, j).filter(|(_, i)| *i > 0).map(|(s, i)| left[j][s][i] * left[j][s][i - 1]).sum();
            // Variance inflation of a mean of first-order autoregressive noise.
            let r = if sum > 0.0 { (next / sum).clamp(0.0, 0.95) } else { 0.0 };
            (w * sum, w * sum * (1.0 + r) / (1.0 - r))
        })
        .collect()
}
