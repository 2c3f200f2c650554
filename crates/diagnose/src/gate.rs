//! Recordings that can be read but not used: nothing moves, or nothing was measured.

use pkm_dyn::effects::Robot;

use crate::evidence::{Diagnosis, Evidence};
use crate::motion::{Motion, top_speed};
use crate::verdict::{Heldout, RecordingUse, SCHEMA, Status, Unexplained, Verdict};

/// Why the recordings cannot be used; `None` when they can.
pub(crate) fn reasons(robot: &Robot, motions: &[Motion]) -> Option<Vec<String>> {
    let mut out = Vec::new();
    let fitted: Vec<&Motion> = motions.iter().filter(|m| m.segment.used != crate::verdict::Use::Holdout).collect();
    let name = |k: usize| &robot.model.joints[robot.model.actuators[k]].name;
    let n = robot.model.n_act();
    if (0..n).all(|k| fitted.iter().all(|m| top_speed(&m.segment.v[k]) <= 0.0)) {
        out.push("no driven joint moves in any recording that is to be fitted".to_string());
    }
    for m in motions {
        let valid = m.segment.valid.iter().filter(|v| **v).count();
        if 2 * valid < m.segment.valid.len() {
            let share = 100.0 * valid as f64 / m.segment.valid.len() as f64;
            out.push(format!("{}: only {share:.0} % of the time is free of gaps (at least 50 % is needed)", m.segment.name));
        }
        for k in 0..n {
            let tau = &m.segment.tau[k];
            let first = tau.first().copied().unwrap_or(0.0);
            if tau.iter().all(|t| (t - first).abs() <= 0.0) {
                out.push(format!("{}: tau.{} never changes (it is {first})", m.segment.name, name(k)));
            }
        }
    }
    if out.is_empty() { None } else { Some(out) }
}

/// The verdict on recordings that cannot be used.
pub(crate) fn unusable(robot: &Robot, motions: &[Motion], reasons: Vec<String>) -> Diagnosis {
    let verdict = Verdict {
        schema: SCHEMA.to_string(),
        status: Status::Unusable,
        robot: robot.model.name.clone(),
        recordings: motions.iter().map(|m| recording_use(m, Vec::new())).collect(),
        nothing_missing: false,
        heldout: Heldout { unit: "fraction of tau rms".to_string(), ..Heldout::default() },
        findings: Vec::new(),
        unexplained: Unexplained::default(),
        minimum_detectable: Vec::new(),
        replay: Vec::new(),
        refined_model: String::new(),
        says: format!("recording unusable: {}", reasons.join("; ")),
        notes: Vec::new(),
        ..Verdict::default()
    };
    Diagnosis { verdict, evidence: Evidence::default(), refined: None }
}

/// One recording as the verdict lists it.
pub(crate) fn recording_use(m: &Motion, heldout_spans: Vec<[f64; 2]>) -> RecordingUse {
    let s = &m.segment;
    RecordingUse { path: s.name.clone(), samples: s.samples, duration_s: s.duration, used: s.used, heldout_spans }
}
