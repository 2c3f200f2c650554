//! The whole diagnosis: gate, search, confirmation, and the verdict with everything that stands behind it.

use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use rayon::prelude::*;

use crate::assemble::assemble;
use crate::controller::{ControllerTwin, Replayed, replay};
use crate::design::Design;
use crate::error::InputError;
use crate::evidence::Diagnosis;
use crate::integrity::{Integrity, integrity};
use crate::located::{Watch, located};
use crate::settings::Settings;
use crate::shelf::Shelf;
use crate::verdict::Use;
use crate::work::Work;
use crate::{gate, motion, reversals, search, segment, thinned, thousands};

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
    diagnose_with_controller(description, (train, holdout), settings, None, progress)
}

/// Whoever wants to know the progress and no more.
struct Share<'p>(&'p mut dyn FnMut(f64));

impl Watch for Share<'_> {
    fn progress(&mut self, share: f64) {
        (self.0)(share);
    }
}

/// Refuses a recording that is another one under another name.
fn copies(all: &[(&Recording, Use)]) -> Result<(), InputError> {
    for (i, (recording, _)) in all.iter().enumerate() {
        if let Some((other, _)) = all[..i].iter().find(|(r, _)| r.time == recording.time && r.signals == recording.signals) {
            return Err(InputError::Copy { recording: recording.name.clone(), other: other.name.clone() });
        }
    }
    Ok(())
}

/// As [`diagnose`] for recordings that a stated controller made, the first of `recordings` fitted and the second held out: before anything
/// else the controller is replayed on them, and a recorded command that is not the controller's is named.
///
/// # Errors
/// As [`diagnose`].
pub fn diagnose_with_controller(
    description: &Description,
    recordings: (&[Recording], &[Recording]),
    settings: &Settings,
    controller: Option<&mut dyn ControllerTwin>,
    progress: &mut dyn FnMut(f64),
) -> Result<Diagnosis, InputError> {
    diagnose_watched(description, recordings, settings, controller, &mut Share(progress))
}

/// As [`diagnose_with_controller`], told to `watch` while it runs: the progress, and where the largest mismatch is long before its cause is
/// known.
///
/// # Errors
/// As [`diagnose`].
pub fn diagnose_watched(
    description: &Description,
    recordings: (&[Recording], &[Recording]),
    settings: &Settings,
    controller: Option<&mut dyn ControllerTwin>,
    watch: &mut dyn Watch,
) -> Result<Diagnosis, InputError> {
    let (train, holdout) = recordings;
    let only = settings.looked_for()?;
    let controller = controller.filter(|_| !settings.leaves_out("controller_mismatch"));
    let robot = &description.robot;
    let first = if holdout.is_empty() { Use::Both } else { Use::Train };
    let all: Vec<(&Recording, Use)> = train.iter().map(|r| (r, first)).chain(holdout.iter().map(|r| (r, Use::Holdout))).collect();
    if train.is_empty() {
        return Err(InputError::NoRecording);
    }
    copies(&all)?;
    let seen: Vec<Integrity> = all.iter().map(|(r, _)| integrity(robot, r)).collect();
    let mut notes: Vec<String> = seen.iter().flat_map(|s| s.notes.clone()).collect();
    let reasons: Vec<String> = seen.iter().flat_map(|s| s.reasons.clone()).collect();
    if !reasons.is_empty() {
        return Ok(gate::unusable(robot, &all, &reasons, notes));
    }
    // Recordings may be hours long: they are copied where something in them is changed, and copies are gone before anything is made of them.
    let is_changed = controller.is_some() || seen.iter().any(Integrity::is_spoiled);
    let mut cleaned: Vec<Recording> = all.iter().zip(&seen).filter(|_| is_changed).map(|((r, _), s)| s.cleaned(r)).collect();
    let mismatches = controller.map_or_else(Vec::new, |twin| mismatches(robot, twin, &mut cleaned, &mut notes));
    let used: Vec<(&Recording, Use)> = cleaned.iter().zip(&all).map(|(r, (_, used))| (r, *used)).collect();
    let (segments, band) = segment::segments(robot, if is_changed { &used } else { &all }, settings.band_hz)?;
    drop(cleaned);
    let (mut segments, thinned) = thinned::thin(segments);
    if let Some(folder) = &settings.scratch {
        let shelf = Shelf::with_room(settings.room / size_of::<f64>(), folder.clone());
        segments.iter_mut().for_each(|s| s.shelf = shelf.clone());
    }
    notes.extend(thinned);
    let n = segments.len();
    let mut motions = Vec::with_capacity(n);
    let mut waiting = segments.into_iter();
    while motions.len() < n {
        // As many at a time as there are cores, so that progress can be told between.
        let some: Vec<_> = waiting.by_ref().take(rayon::current_num_threads()).collect();
        // Of several that fail the first is told, so errors are looked for in order and not as they come.
        let made: Result<Vec<_>, _> = some.into_par_iter().map(|s| motion::motion(robot, s)).collect::<Vec<_>>().into_iter().collect();
        match made {
            Ok(made) => motions.extend(made),
            Err(open @ InputError::Open { .. }) => {
                let Some(reason) = gate::other_unit(robot, &all) else { return Err(open) };
                return Ok(gate::unusable(robot, &all, &[reason], notes));
            }
            Err(other) => return Err(other),
        }
        watch.progress(0.2 * motions.len() as f64 / n as f64);
    }
    let reasons = [gate::reasons(robot, &motions), gate::clocks(robot, &motions), thousands::reasons(robot, &motions)].concat();
    if !reasons.is_empty() {
        return Ok(gate::unusable(robot, &all, &reasons, notes));
    }
    reversals::fit_where_they_tell(robot, &mut motions, band, settings);
    let design = Design::new(robot, &motions, band);
    watch.located(located(&robot.model, &motions, &design).as_ref());
    let mut work = Work::new(robot, &mut motions, design, band, only.as_deref());
    if let Some(reasons) = crate::enough::reasons(&work.design, band) {
        return Ok(gate::unusable(robot, &all, &reasons, notes));
    }
    for m in mismatches.iter().filter(|m| m.is_scaled()) {
        work.missing[m.drive] = m.share;
    }
    watch.progress(0.3);
    let found = search::search(&mut work, band, settings, &mut |share| watch.progress(share));
    let mut out = assemble(&mut work, &found, (&description.bare, &mismatches), band, settings);
    if let Some(reason) = work.design.shelf.refused() {
        return Err(InputError::Scratch { folder: settings.scratch.clone().unwrap_or_default().display().to_string(), reason });
    }
    tracing::debug!(megabytes = work.design.shelf.on_file() >> 20, "series in a temporary file");
    notes.append(&mut out.verdict.notes);
    out.verdict.notes = notes;
    watch.progress(1.0);
    Ok(out)
}

/// Drives whose recorded command is not the controller's. Where a factor is all that lies between the two, the recordings get the
/// controller's: that is what acted.
fn mismatches(robot: &Robot, twin: &mut dyn ControllerTwin, recordings: &mut [Recording], notes: &mut Vec<String>) -> Vec<Replayed> {
    let (mut all, problems) = replay(robot, twin, recordings);
    notes.extend(problems);
    all.retain(Replayed::is_mismatch);
    for m in &all {
        let (joint, percent) = (&m.joint, 100.0 * m.share);
        notes.push(if m.is_scaled() {
            format!(
                "tau.{joint} is {:.1} % of what the stated controller computes; what it computes is taken for what acted",
                100.0 - percent
            )
        } else {
            format!(
                "tau.{joint} is not what the stated controller computes (correlation {:.2}): its gains, filters or references are others",
                m.correlation
            )
        });
        for r in recordings.iter_mut().filter(|_| m.is_scaled()) {
            if let Some(tau) = r.signals.get_mut(&format!("tau.{joint}")) {
                tau.iter_mut().for_each(|t| *t /= 1.0 - m.share);
            }
        }
    }
    all
}
