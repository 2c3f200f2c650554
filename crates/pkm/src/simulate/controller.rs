//! `--controller FILE`: the controller that moves the robot, and the same file beside what it recorded.

use std::path::{Path, PathBuf};

use pkm_ctrl::{Running, config};
use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_record::{Attachment, Attachments, Control, ControlStep};
use pkm_sim::Step;

/// Name of the file where it is attached.
pub(crate) const ATTACHED: &str = "controller.toml";

/// Name of the position loop's file where a daemon runs another law, whose file is the one above.
pub(crate) const ATTACHED_HOLD: &str = "controller.hold.toml";

/// Choice of controller.
#[derive(Debug, clap::Args)]
pub(crate) struct ControllerArgs {
    /// A controller.toml: law, rate, gains, limits [default: a PD per drive with the weight as feed-forward].
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
}

/// A controller.toml that was read.
pub(crate) struct ControllerFile {
    path: PathBuf,
    text: String,
}

impl ControllerArgs {
    /// The file, if there is one.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.controller.as_deref()
    }

    /// Reads the file and builds its controller for `robot`.
    ///
    /// # Errors
    /// A file that cannot be read, and everything in it that is refused.
    pub(crate) fn read(&self, robot: &Robot) -> anyhow::Result<Option<(ControllerFile, Box<dyn Running>)>> {
        let Some(path) = &self.controller else { return Ok(None) };
        let (name, text) = config::read(path)?;
        let controller = config::parse(&text, &name, robot)?;
        Ok(Some((ControllerFile { path: path.clone(), text }, controller)))
    }
}

impl ControllerFile {
    /// Names the file in the recording's metadata; where it is attached that is its name.
    pub(crate) fn note(&self, recording: &mut Recording, attachments: Option<&mut Attachments>) {
        let own = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(attachments) = attachments else {
            recording.meta.controller = Some(own);
            return;
        };
        let (name, media_type) = (ATTACHED.to_string(), "application/toml".to_string());
        attachments.files.push(Attachment { name, media_type, bytes: self.text.as_bytes().to_vec() });
        recording.meta.controller = Some(ATTACHED.to_string());
    }
}

/// A step of the controller as it is recorded.
pub(crate) fn noted(step: &Step<'_>) -> ControlStep {
    let signals = &step.signals;
    let control = Control {
        is_first: step.number == 0,
        is_other_law: false,
        is_faulted: step.health.is_faulted,
        dt: signals.dt,
        q_dt: signals.q_dt,
        q_meas: signals.q_meas,
        tau_meas: signals.tau_meas,
        wrench_meas: signals.wrench_meas,
        q_ref: signals.q_ref,
        v_ref: signals.v_ref,
        a_ref: signals.a_ref,
        wrench_ref: signals.wrench_ref,
        tau_ff: signals.tau_ff,
        command: step.command,
    };
    ControlStep::new(step.t, step.number, &control)
}
