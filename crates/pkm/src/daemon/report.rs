//! What a daemon tells: a line for every change of phase, and a file with the last seconds before what should not have been.

use alloc::sync::Arc;
use std::path::PathBuf;

use pkm_daemon::status::Told;
use pkm_daemon::supervisor::Reporter;
use pkm_hal::CycleRecord;
use pkm_hal::cycle::flags;
use pkm_ident::{EffortKind, Recording};
use pkm_record::{Attachment, Attachments};

use super::setup::Setup;
use crate::out;

/// Tells on standard output, keeps files in a directory.
pub(crate) struct OnTerminal {
    pub(crate) setup: Arc<Setup>,
    pub(crate) directory: PathBuf,
    pub(crate) is_quiet: bool,
    /// Whether standard output is for one JSON object, and everything else for standard error.
    pub(crate) is_json: bool,
}

impl Reporter for OnTerminal {
    fn transition(&mut self, told: &Told) {
        self.line(&told.to_string());
    }

    fn line(&mut self, text: &str) {
        if !self.is_quiet {
            // A terminal that has gone away is no reason to let go of a robot.
            let _ = out::words(text, self.is_json);
        }
    }

    fn black_box(&mut self, event: &Told, records: &mut dyn ExactSizeIterator<Item = &CycleRecord>) -> Result<String, String> {
        let path = self.directory.join(format!("black-box-{}-{}.mcap", std::process::id(), event.cycle));
        let mut recording = recording(&self.setup, records);
        let mut note = |key: &str, text: String| recording.meta.other.insert(key.to_string(), text);
        note("event", event.to_string());
        note("event_cause", event.cause.clone());
        note("event_cycle", event.cycle.to_string());
        let file = |name: &str, text: &str| {
            let (name, media_type) = (name.to_string(), "application/toml".to_string());
            Attachment { name, media_type, bytes: text.as_bytes().to_vec() }
        };
        let mut attachments = crate::convert::with_robot(&self.setup.robot);
        attachments.version = Some(crate::VERSION.to_string());
        attachments.files.push(file("daemon.toml", &self.setup.own.1));
        attachments.files.push(file("controller.toml", &self.setup.hold.text));
        write(&path, &recording, &attachments)?;
        self.line(&format!("black box: {}", path.display()));
        Ok(path.display().to_string())
    }
}

fn write(path: &std::path::Path, recording: &Recording, attachments: &Attachments) -> Result<(), String> {
    pkm_record::write(path, recording, attachments).map_err(|e| e.to_string())
}

/// Records as a recording: what sensors said, what was wanted, what was sent.
fn recording(setup: &Setup, records: &mut dyn ExactSizeIterator<Item = &CycleRecord>) -> Recording {
    let model = &setup.robot.robot.model;
    let mut out = Recording { name: format!("{}, black box", model.name), ..Recording::default() };
    let mut first_ns = None;
    for record in records {
        // Positions that were not read anew are no samples.
        let is_new = record.flags & flags::NEW_STATE != 0;
        let first_ns = *first_ns.get_or_insert(record.planned_ns);
        out.time.push(record.planned_ns.saturating_sub(first_ns) as f64 * 1e-9);
        for (k, &j) in model.actuators.iter().enumerate() {
            let joint = &model.joints[j].name;
            let or_missing = |x: f64| if is_new { x } else { f64::NAN };
            let columns = [
                ("q", or_missing(record.state.q[k])),
                ("dq", or_missing(record.state.v[k])),
                ("tau", record.tau_sent[k]),
                ("q_ref", record.q_ref[k]),
                ("dq_ref", record.v_ref[k]),
                ("ddq_ref", record.a_ref[k]),
            ];
            for (name, value) in columns {
                out.signals.entry(format!("{name}.{joint}")).or_default().push(value);
            }
        }
    }
    out.meta.tau = Some(EffortKind::Commanded);
    out
}
