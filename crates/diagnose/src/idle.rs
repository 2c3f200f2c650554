//! Spans in which the drives are off: every recorded effort is exactly nothing while the robot stands.
//!
//! It is held by something that no model of the drives knows, brakes or a table, and would look like a robot without weight.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;

use crate::integrity::{Integrity, STUCK_S, range};

/// Travel of a joint within a span, as a share of all its travel, up to which it stands.
const STANDS: f64 = 0.01;

/// Where more than this share of a recording would go, nothing is taken out: then it is a recording of nothing, and others say so.
const MOST: f64 = 0.5;

/// Takes out spans of at least the time that makes a channel stuck in which every effort is exactly zero and no drive moves.
pub(crate) fn drives_off(robot: &Robot, r: &Recording, out: &mut Integrity) {
    let names: Vec<&str> = robot.model.actuators.iter().map(|&j| robot.model.joints[j].name.as_str()).collect();
    let all = |kind: &str| names.iter().map(|name| r.signal(&format!("{kind}.{name}"))).collect::<Option<Vec<&[f64]>>>();
    let (Some(q), Some(tau)) = (all("q"), all("tau")) else { return };
    let travel: Vec<f64> = q.iter().map(|x| travel(x)).collect();
    let stands = |from: usize, to: usize| q.iter().zip(&travel).all(|(x, all)| self::travel(&x[from..to]) <= STANDS * all);
    let spans: Vec<(usize, usize)> =
        zero_spans(&tau).into_iter().filter(|&(from, to)| r.time[to - 1] - r.time[from] > STUCK_S && stands(from, to)).collect();
    let count: usize = spans.iter().map(|(from, to)| to - from).sum();
    if count == 0 || count as f64 > MOST * r.len() as f64 {
        return;
    }
    let (from, to) = spans.iter().copied().max_by_key(|(from, to)| to - from).unwrap_or_default();
    out.notes.push(format!(
        "{}: every effort is exactly zero while nothing moves, for up to {:.2} s (from t = {:.3} s), {:.1} % of the samples: drives are off \
         there; they are left out",
        r.name,
        r.time[to.saturating_sub(1)] - r.time[from],
        r.time[from],
        100.0 * count as f64 / r.len() as f64
    ));
    let at: Vec<usize> = spans.into_iter().flat_map(|(from, to)| from..to).collect();
    out.spoiled.extend(names.iter().map(|name| (format!("tau.{name}"), at.clone())));
}

/// Range of what is known of a series; nothing of nothing.
fn travel(x: &[f64]) -> f64 {
    let (low, high) = range(x);
    (high - low).max(0.0)
}

/// Spans of samples, end excluded, in which all series are exactly zero.
fn zero_spans(all: &[&[f64]]) -> Vec<(usize, usize)> {
    let n = all.iter().map(|x| x.len()).min().unwrap_or(0);
    let at: Vec<usize> = (0..n).filter(|&i| all.iter().all(|x| x[i].abs() <= 0.0)).collect();
    at.chunk_by(|a, b| a + 1 == *b).map(|run| (run[0], run[0] + run.len())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Bench;

    /// Ten seconds at 100 Hz of a slider that goes forth and back; `off` changes position and effort.
    fn seen(off: impl Fn(usize, &mut f64, &mut f64)) -> Integrity {
        let robot = Robot::new(Bench::sine(0.2, 1.0).model, Vec::new());
        let time: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
        let (mut q, mut tau) = (Vec::new(), Vec::new());
        for (i, t) in time.iter().enumerate() {
            let (mut x, mut f) = (pkm_dyn::math::sin(2.0 * t), 3.0 * pkm_dyn::math::cos(2.0 * t));
            off(i, &mut x, &mut f);
            q.push(x);
            tau.push(f);
        }
        let mut recording = Recording { name: "A".to_string(), time, ..Recording::default() };
        recording.signals.insert("q.j0".to_string(), q);
        recording.signals.insert("tau.j0".to_string(), tau);
        let mut out = Integrity::default();
        drives_off(&robot, &recording, &mut out);
        out
    }

    #[test]
    fn a_robot_that_stands_without_any_effort_is_left_out_there() {
        let off = seen(|i, q, tau| {
            if (200..350).contains(&i) {
                (*q, *tau) = (pkm_dyn::math::sin(4.0), 0.0);
            }
        });
        assert_eq!(off.spoiled, vec![("tau.j0".to_string(), (200..350).collect::<Vec<_>>())]);
        assert!(off.reasons.is_empty() && off.notes[0].contains("15.0 %") && off.notes[0].contains("t = 2.000 s"), "{off:?}");
    }

    #[test]
    fn one_that_coasts_or_holds_or_never_does_anything_is_not() {
        assert!(
            !seen(|i, _, tau| if (200..350).contains(&i) {
                *tau = 0.0;
            })
            .is_spoiled(),
            "it coasts"
        );
        assert!(
            !seen(|i, q, tau| if (200..350).contains(&i) {
                (*q, *tau) = (0.3, 1e-9);
            })
            .is_spoiled(),
            "it holds"
        );
        assert!(
            !seen(|i, q, tau| if i >= 400 {
                (*q, *tau) = (0.3, 0.0);
            })
            .is_spoiled(),
            "mostly off"
        );
        assert!(
            !seen(|i, q, tau| if (200..220).contains(&i) {
                (*q, *tau) = (0.3, 0.0);
            })
            .is_spoiled(),
            "for a moment"
        );
    }
}
