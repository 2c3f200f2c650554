//! The model's effort along a recorded motion, at the recording's own samples.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::Law;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_ident::filter::{advanced, derivative};

use crate::error::InputError;
use crate::verdict::Use;
use crate::{motion, segment};

/// Effort `[N | N·m]` that the robot, with everything its files state, needs for the recorded motion: by joint name, one value per
/// recorded sample.
///
/// # Errors
/// As [`crate::diagnose`]: columns that are missing, loops that do not close.
pub fn predict(description: &Description, recording: &Recording) -> Result<BTreeMap<String, Vec<f64>>, InputError> {
    let robot = &description.robot;
    let (mut segments, _) = segment::segments(robot, &[(recording, Use::Train)], None)?;
    let Some(segment) = segments.pop() else { return Err(InputError::NoRecording) };
    let m = motion::motion(robot, segment)?;
    let (start, dt) = (m.segment.start, m.segment.dt);
    let mut out = BTreeMap::new();
    for (k, &j) in robot.model.actuators.iter().enumerate() {
        let lag: f64 = robot.chain(j, |law| matches!(law, Law::EffortLag)).sum();
        let delay: f64 = robot.chain(j, |law| matches!(law, Law::EffortDelay)).sum();
        let mut acts = m.nominal[0][k].clone();
        if !m.moves.is_empty() {
            // Efforts of surplus drives are what acts.
            let scale: f64 = robot.chain(j, |law| matches!(law, Law::EffortScale)).product();
            acts.iter_mut().for_each(|x| *x /= scale);
        }
        let mut effort = if delay.abs() > 0.0 { advanced(&acts, delay, dt) } else { acts };
        if lag.abs() > 0.0 {
            let rate = derivative(&effort, dt);
            effort.iter_mut().zip(rate).for_each(|(e, r)| *e += lag * r);
        }
        let at = |t: f64| {
            let x = ((t - start) / dt).clamp(0.0, (effort.len() - 1) as f64);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
            let i = (x.floor() as usize).min(effort.len().saturating_sub(2));
            effort[i] + (x - i as f64) * (effort[i + 1] - effort[i])
        };
        out.insert(robot.model.joints[j].name.clone(), recording.time.iter().map(|&t| at(t)).collect());
    }
    Ok(out)
}
