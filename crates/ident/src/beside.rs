//! What recordings say beside the parameters of a robot: gains of its drives, and what rides on it.

use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::answer::{IdentifyError, Settings};
use crate::gains::{DriveGains, drive_gains};
use crate::identify::preparation::Prepared;
use crate::note::Note;
use crate::payload::{Payload, payload};

/// Which of it is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question<'q> {
    /// Gains of the drives, from a known load.
    Gains,
    /// The payload on the link of that name.
    Payload(&'q str),
}

/// The answers to those that were asked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Beside {
    /// Gains of the drives.
    pub gains: Option<DriveGains>,
    /// The payload on a link.
    pub payload: Option<Payload>,
}

impl Beside {
    /// Answers from recordings, prepared as `settings` say; the robot's own parameters are those of its files.
    ///
    /// # Errors
    /// Recordings that do not fit the robot; a link that it does not have.
    pub fn of(robot: &Robot, recordings: &[Recording], settings: &Settings, questions: &[Question<'_>]) -> Result<Self, IdentifyError> {
        let mut out = Self::default();
        if questions.is_empty() {
            return Ok(out);
        }
        let Prepared { fit, notes, .. } = Prepared::of(robot, [recordings, &[]], settings)?;
        for question in questions {
            match question {
                Question::Gains => {
                    let mut found = drive_gains(robot, &fit, settings.rows)?;
                    found.notes.extend(notes.iter().cloned());
                    out.gains = Some(DriveGains { status: Note::worst(&found.notes), ..found });
                }
                Question::Payload(link) => {
                    let mut found = payload(robot, &fit, link, settings.rows)?;
                    found.notes.extend(notes.iter().cloned());
                    out.payload = Some(Payload { status: Note::worst(&found.notes), ..found });
                }
            }
        }
        Ok(out)
    }
}
