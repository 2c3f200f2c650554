//! An excitation in words and as JSON.

use pkm_dyn::math;
use pkm_dyn::model::Model;
use pkm_ident::excitation::{Basis, CONDITION_LIMIT, Criterion, Excitation, Margin, Quality};
use serde_json::{Value, json};

use crate::out::{number, table};

/// Margins listed: the tightest.
const MARGINS: usize = 12;

/// What was asked for, in one line.
pub(super) fn outcome(found: &Excitation) -> String {
    let q = &found.quality;
    match (found.settings.criterion, &q.separation) {
        (Criterion::Angle, Some(s)) => format!("angle between the two effects {} degrees", number(s.angle_deg())),
        (Criterion::Power, Some(s)) => {
            format!("effort by which the two effects differ {} and {} rms", number(s.alone[0]), number(s.alone[1]))
        }
        (Criterion::Determinant, _) => format!("log-determinant {}", number(q.log_determinant)),
        _ => format!("condition number {}", number(q.condition)),
    }
}

/// The answer in words: the criterion and what drawing at random gives, ranks, the tightest limits.
pub(super) fn text(found: &Excitation) -> String {
    let (q, n) = (&found.quality, found.columns.len());
    let mut out = vec![format!("{}: {}, {} columns", found.robot, outcome(found), n)];
    out.push(format!("  {}", gained(found)));
    out.push(format!(
        "  condition number {} (in SI units {}), log-determinant {}",
        number(q.condition),
        number(q.condition_raw),
        number(q.log_determinant)
    ));
    out.push(format!(
        "  structural rank {} (tolerance {:.0e}); {} columns stay below condition number {} together",
        found.structural,
        found.tolerance,
        found.well_conditioned,
        number(CONDITION_LIMIT)
    ));
    if let Some(s) = &q.separation {
        out.push(format!(
            "  effects: angle {} degrees; {} % and {} % of their squares are left beside the base parameters; {} and {} rms alone",
            number(s.angle_deg()),
            number(100.0 * s.left[0]),
            number(100.0 * s.left[1]),
            number(s.alone[0]),
            number(s.alone[1])
        ));
    }
    let failed = if found.failed > 0 { format!(", {} found none", found.failed) } else { String::new() };
    out.push(format!("  {} restarts{failed}, seed {}", found.settings.restarts, found.settings.seed));
    out.push("\nNearest to their limits".to_string());
    let mut rows = vec![["what", "where", "value", "from", "to", "room", "at"].map(str::to_string).to_vec()];
    rows.extend(tightest(found).iter().take(MARGINS).map(|m| row(m)));
    out.push(table(&rows));
    out.join("\n")
}

/// What the search gained over drawing at random.
pub(super) fn gained(found: &Excitation) -> String {
    let n = found.random.motions;
    match (&found.random.best, found.gain()) {
        (Some(best), Some(gain)) => format!(
            "best of {n} random motions with the same limits: {}; the motion is {} times better",
            number(of(found.settings.criterion, best)),
            number(gain)
        ),
        _ => format!("best of {n} random motions with the same limits: none keeps them between its samples, so the gain is not known"),
    }
}

/// The criterion of a quality as people read it.
fn of(criterion: Criterion, q: &Quality) -> f64 {
    match (criterion, &q.separation) {
        (Criterion::Condition, _) => q.condition,
        (Criterion::Determinant, _) => q.log_determinant,
        (Criterion::Angle, Some(s)) => s.angle_deg(),
        (Criterion::Power, Some(s)) => math::sqrt(s.alone[0] * s.alone[1]),
        (Criterion::Angle | Criterion::Power, None) => 0.0,
    }
}

/// Margins, the tightest first.
pub(super) fn tightest(found: &Excitation) -> Vec<&Margin> {
    let mut all: Vec<&Margin> = found.margins.iter().collect();
    all.sort_by(|a, b| a.room.total_cmp(&b.room));
    all
}

/// A margin as cells.
pub(super) fn row(m: &Margin) -> Vec<String> {
    let room = format!("{:.1} %", 100.0 * m.room);
    vec![m.what.name().to_string(), m.place.clone(), number(m.value), number(m.lower), number(m.upper), room, format!("{:.2} s", m.time)]
}

/// Every number.
pub(super) fn json(found: &Excitation, model: &Model, file: &str) -> Value {
    let s = &found.settings;
    let names: Vec<&String> = model.actuators.iter().map(|&j| &model.joints[j].name).collect();
    let functions = match s.basis {
        Basis::Fourier { harmonics } => json!({"name": "fourier", "harmonics": harmonics}),
        Basis::Spline { pieces } => json!({"name": "spline", "pieces": pieces}),
    };
    let effects: Vec<Value> =
        s.effects.iter().map(|e| json!({"effect": e.entry.name, "where": e.place_name(model), "values": e.values})).collect();
    json!({
        "schema": "pkm.excitation/1",
        "robot": found.robot,
        "motion": file,
        "criterion": s.criterion.name(),
        "value": of(s.criterion, &found.quality),
        "gain_over_random": found.gain(),
        "quality": found.quality,
        "random": {"motions": found.random.motions, "best": found.random.best, "median": found.random.median},
        "columns": found.columns,
        "structural_rank": found.structural,
        "tolerance": found.tolerance,
        "well_conditioned": found.well_conditioned,
        "condition_limit": CONDITION_LIMIT,
        "margins": found.margins,
        "restarts": found.traces,
        "restarts_failed": found.failed,
        "coefficients": names.iter().zip(&found.motion.coefficients).map(|(n, c)| json!({"joint": n, "values": c})).collect::<Vec<_>>(),
        "settings": {
            "basis": functions,
            "period_s": s.period_s,
            "share": s.limits.share,
            "velocity": s.limits.velocity,
            "acceleration": s.limits.acceleration,
            "cone_rad": s.limits.cone,
            "singularity": s.limits.singularity,
            "held": s.held.iter().map(|t| t.name()).collect::<Vec<_>>(),
            "effects": effects,
            "restarts": s.restarts,
            "draws": s.draws,
            "iterations": s.iterations,
            "seed": s.seed,
        },
    })
}
