//! Recordings that can be read but not used: nothing moves, or nothing was measured.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_ident::degrees::unit_that_closes_at_first;
use pkm_ident::filter::LowPass;

use crate::evidence::{Diagnosis, Evidence};
use crate::motion::{Motion, top_speed};
use crate::segment::every;
use crate::verdict::{Heldout, RecordingUse, SCHEMA, Status, Unexplained, Use, Verdict};

/// Why the recordings cannot be used; none when they can.
pub(crate) fn reasons(robot: &Robot, motions: &[Motion]) -> Vec<String> {
    let mut out = Vec::new();
    let fitted: Vec<&Motion> = motions.iter().filter(|m| m.segment.used != Use::Holdout).collect();
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
    out
}

/// Furthest that efforts are looked for away from the motion they belong to `[s]`.
const FURTHEST_S: f64 = 1.0;

/// A drive's effort that fits the model far better at another time: reasons against the recordings, one per motion and drive.
///
/// A shift of less than half a period of the band is a delay of the drive, which has a name and columns of its own.
pub(crate) fn clocks(robot: &Robot, motions: &[Motion]) -> Vec<String> {
    let mut out = Vec::new();
    for m in motions {
        let s = &m.segment;
        let filter = LowPass::new(s.band, s.dt);
        let every = every(s.dt, 20.0 * s.band);
        let step = s.dt * every as f64;
        for (k, &j) in robot.model.actuators.iter().enumerate() {
            let thin = |x: &[f64]| -> Vec<f64> { filter.apply(x).into_iter().step_by(every).collect() };
            let (shift, there, here) = best_shift(&thin(&s.tau[k]), &thin(&m.nominal[0][k]), step);
            if shift.abs() > 0.5 / s.band && there > 0.8 && there - here > 0.3 {
                let name = &robot.model.joints[j].name;
                out.push(format!(
                    "{}: tau.{name} fits its motion {:.2} s {} only (correlation with the model {there:.2}, as recorded {here:.2})",
                    s.name,
                    shift.abs(),
                    if shift > 0.0 { "later" } else { "earlier" }
                ));
            }
        }
    }
    out
}

/// Shift of `y` at which it correlates best with `x` `[s]`, positive where `y` comes early, that correlation, and the one without shift.
fn best_shift(y: &[f64], x: &[f64], step: f64) -> (f64, f64, f64) {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive times")]
    let furthest = ((FURTHEST_S / step) as usize).min(y.len() / 4);
    let correlation = |a: &[f64], b: &[f64]| {
        let n = a.len().max(1) as f64;
        let (ma, mb) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for (a, b) in a.iter().zip(b) {
            ab += (a - ma) * (b - mb);
            aa += (a - ma) * (a - ma);
            bb += (b - mb) * (b - mb);
        }
        if aa > 0.0 && bb > 0.0 { ab / pkm_dyn::math::sqrt(aa * bb) } else { 0.0 }
    };
    let here = correlation(y, x);
    let mut best = (0.0, here);
    for lag in 1..=furthest {
        let n = y.len() - lag;
        for (shift, c) in [(lag as f64, correlation(&y[..n], &x[lag..])), (-(lag as f64), correlation(&y[lag..], &x[..n]))] {
            if c > best.1 {
                best = (shift * step, c);
            }
        }
    }
    (best.0, best.1, here)
}

/// The unit in which recorded positions would close the loops that they do not close as they are.
pub(crate) fn other_unit(robot: &Robot, recordings: &[(&Recording, Use)]) -> Option<String> {
    recordings.iter().find_map(|(r, _)| {
        let unit = unit_that_closes_at_first(&robot.model, r)?;
        Some(format!("{}: positions do not close the loops as they are, but would in {unit}", r.name))
    })
}

/// The verdict on recordings that cannot be used.
pub(crate) fn unusable(robot: &Robot, recordings: &[(&Recording, Use)], reasons: &[String], notes: Vec<String>) -> Diagnosis {
    let whole = |(r, used): &(&Recording, Use)| RecordingUse {
        path: r.name.clone(),
        samples: r.len(),
        duration_s: r.duration(),
        used: *used,
        heldout_spans: Vec::new(),
    };
    let verdict = Verdict {
        schema: SCHEMA.to_string(),
        status: Status::Unusable,
        robot: robot.model.name.clone(),
        recordings: recordings.iter().map(whole).collect(),
        nothing_missing: false,
        heldout: Heldout { unit: "fraction of tau rms".to_string(), ..Heldout::default() },
        findings: Vec::new(),
        unexplained: Unexplained::default(),
        minimum_detectable: Vec::new(),
        replay: Vec::new(),
        refined_model: String::new(),
        says: format!("recording unusable: {}", reasons.join("; ")),
        notes,
        ..Verdict::default()
    };
    Diagnosis { verdict, evidence: Evidence::default(), refined: None }
}

/// One recording as the verdict lists it.
pub(crate) fn recording_use(m: &Motion, heldout_spans: Vec<[f64; 2]>) -> RecordingUse {
    let s = &m.segment;
    RecordingUse { path: s.name.clone(), samples: s.samples, duration_s: s.duration, used: s.used, heldout_spans }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn efforts_recorded_by_another_clock_are_found_where_they_fit() {
        let wave = |t: f64| pkm_dyn::math::sin(2.0 * t) + 0.5 * pkm_dyn::math::sin(5.3 * t + 1.0);
        let x: Vec<f64> = (0..600).map(|i| wave(0.02 * i as f64)).collect();
        let late: Vec<f64> = (0..600).map(|i| 3.0 * wave(0.02 * i as f64 - 0.6)).collect();
        let (shift, there, here) = best_shift(&late, &x, 0.02);
        assert!((shift + 0.6).abs() < 1e-12 && there > 0.999 && here < 0.7, "{shift} {there} {here}");
    }
}
