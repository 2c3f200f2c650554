//! The whole diagnosis: gate, search, confirmation, and the verdict with everything that stands behind it.

use pkm_dyn::urdf::Description;
use pkm_ident::Recording;

use crate::assemble::assemble;
use crate::error::InputError;
use crate::evidence::Diagnosis;
use crate::settings::Settings;
use crate::verdict::Use;
use crate::work::Work;
use crate::{motion, search, segment};

/// Finds the physics that the robot's files leave out of what the recordings show.
///
/// `train` is fitted and searched; `holdout` is only judged on. Without `holdout`, every second of ten blocks of each recording is held
/// out. `progress` is called with the share done, 0 to 1.
///
/// # Errors
/// Recordings that are missing columns, too short, or not of this robot: one line that names recording, place, value and limit.
pub fn diagnose(
    description: &Description,
    train: &[Recording],
    holdout: &[Recording],
    settings: &Settings,
    progress: &mut dyn FnMut(f64),
) -> Result<Diagnosis, InputError> {
    let robot = &description.robot;
    let first = if holdout.is_empty() { Use::Both } else { Use::Train };
    let all: Vec<(&Recording, Use)> = train.iter().map(|r| (r, first)).chain(holdout.iter().map(|r| (r, Use::Holdout))).collect();
    if train.is_empty() {
        return Err(InputError::NoRecording);
    }
    let (segments, band) = segment::segments(robot, &all, settings.band_hz)?;
    let n = segments.len();
    let mut motions = Vec::with_capacity(n);
    for (i, s) in segments.into_iter().enumerate() {
        motions.push(motion::motion(robot, s)?);
        progress(0.2 * (i + 1) as f64 / n as f64);
    }
    if let Some(reasons) = crate::gate::reasons(robot, &motions) {
        return Ok(crate::gate::unusable(robot, &motions, reasons));
    }
    let mut work = Work::new(robot, &motions, band);
    if let Some(reasons) = crate::enough::reasons(&work.design, band) {
        return Ok(crate::gate::unusable(robot, &motions, reasons));
    }
    progress(0.3);
    let found = search::search(&mut work, band, settings, progress);
    let out = assemble(&mut work, &found, &description.bare, band, settings);
    progress(1.0);
    Ok(out)
}
