//! `--record FOLDER`: every period of the loop into MCAP files, on a thread of its own; `--live PORT`: the same to look at.

use std::path::{Path, PathBuf};

use pkm_daemon::status::RecordingStatus;
use pkm_hal::cycle::ring::{Lost, RingSink, ring};
use pkm_hal::{SystemClock, epoch_offset_ns};
use pkm_record::Attachment;
use pkm_record::cycles::{Folder, Handle, Layout, Options, Tap, spawn};

use super::setup::Setup;
use super::{IO, Stopped};
use crate::convert::with_robot;
use crate::simulate::controller::{ATTACHED, ATTACHED_HOLD};

/// Time between two lines about periods that are lost `[ns]`.
const QUIET_NS: u64 = 10_000_000_000;

/// What of a loop is kept and shown.
#[derive(Debug, clap::Args)]
pub(crate) struct RecordArgs {
    /// Record every period into MCAP files of this folder, a new one after ten minutes or 1 GiB.
    #[arg(long, value_name = "FOLDER")]
    record: Option<PathBuf>,
    /// Show what is recorded to Foxglove and `PlotJuggler` at this port of this machine; 0 takes one that is free and says which.
    #[cfg(feature = "live")]
    #[arg(long, value_name = "PORT", requires = "record")]
    live: Option<u16>,
}

/// A recording that runs.
pub(super) struct Recording {
    handle: Handle,
    /// Periods that found no room on the way to it.
    no_room: Lost,
    /// What was told last, and when `[ns]`.
    told: RecordingStatus,
    told_ns: u64,
    #[cfg(feature = "live")]
    live: Option<pkm_live::Live>,
}

impl RecordArgs {
    /// Begins the recording, if one is asked for: the loop's end of its ring, and what writes.
    ///
    /// # Errors
    /// A folder that cannot be written: what could not be recorded from the start is told at the start.
    pub(super) fn begin(&self, setup: &Setup, room: usize) -> Result<(Option<RingSink>, Option<Recording>), Stopped> {
        let Some(folder) = &self.record else { return Ok((None, None)) };
        let layout = layout(setup);
        let options = Options { keep_cycles: 0, after_cycles: 0, stem: setup.robot.robot.model.name.clone(), ..Options::default() };
        #[cfg(feature = "live")]
        let (live, taps) = self.look(&layout);
        #[cfg(not(feature = "live"))]
        let taps = Vec::new();
        let (sink, source) = ring(room);
        let no_room = sink.losses();
        let handle = start(source, folder, layout, options, taps)?;
        let recording = Recording {
            handle,
            no_room,
            told: RecordingStatus { is_recording: true, ..RecordingStatus::default() },
            told_ns: 0,
            #[cfg(feature = "live")]
            live,
        };
        Ok((Some(sink), Some(recording)))
    }

    /// The live view; a port that is taken is told and is no reason not to run.
    #[cfg(feature = "live")]
    fn look(&self, layout: &Layout) -> (Option<pkm_live::Live>, Vec<Tap>) {
        let Some(port) = self.live else { return (None, Vec::new()) };
        match pkm_live::Live::start(layout, &pkm_live::Options { port, ..pkm_live::Options::default() }) {
            Ok(live) => {
                let tap = live.tap();
                (Some(live), vec![tap])
            }
            Err(e) => {
                crate::out::line_on_stderr(&format!("warning: {e}"));
                (None, Vec::new())
            }
        }
    }
}

fn start(
    source: pkm_hal::cycle::ring::RingSource,
    folder: &Path,
    layout: Layout,
    options: Options,
    taps: Vec<Tap>,
) -> Result<Handle, Stopped> {
    spawn(source, Box::new(Folder::new(folder)), layout, options, SystemClock, taps).map_err(|e| Stopped::new(IO, e))
}

impl Recording {
    /// Where it can be looked at, for people; none where it cannot.
    #[cfg(feature = "live")]
    pub(super) fn seen_at(&self) -> Option<String> {
        self.live.as_ref().map(|live| format!("live view at ws://127.0.0.1:{}", live.port()))
    }

    /// Nowhere: built without.
    #[cfg(not(feature = "live"))]
    pub(super) fn seen_at(&self) -> Option<String> {
        None
    }

    /// How it goes at `now_ns` `[ns]`, and a line where that is worth one: it was paused, it goes on, periods are lost.
    pub(super) fn look(&mut self, now_ns: u64) -> (RecordingStatus, Option<String>) {
        let progress = self.handle.progress();
        let status = RecordingStatus {
            is_recording: progress.is_recording && self.handle.is_alive(),
            periods: progress.written,
            files: progress.files,
            lost: progress.lost + self.no_room.count(),
            error: progress.error,
        };
        let is_other = status.is_recording != self.told.is_recording;
        let is_losing = status.lost > self.told.lost && now_ns.saturating_sub(self.told_ns) > QUIET_NS;
        let line = (is_other || is_losing).then(|| status.to_string());
        if line.is_some() {
            (self.told, self.told_ns) = (status.clone(), now_ns);
        }
        (status, line)
    }

    /// Ends it; what became of it.
    pub(super) fn finish(self) -> Recorded {
        let (progress, outcome) = self.handle.finish();
        let lost = progress.lost + self.no_room.count();
        Recorded { periods: progress.written, files: progress.files, lost, error: outcome.err().map(|e| e.to_string()) }
    }
}

/// What became of a recording.
#[derive(Debug, serde::Serialize)]
pub(super) struct Recorded {
    /// Periods in its files.
    periods: u64,
    /// Its files.
    files: u64,
    /// Periods that are in none.
    lost: u64,
    /// What the disk said last, if the end is not on it.
    error: Option<String>,
}

impl core::fmt::Display for Recorded {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { periods, files, lost, error } = self;
        write!(f, "recorded {periods} periods in {files} files, {lost} lost")?;
        error.as_ref().map_or(Ok(()), |error| write!(f, "; {error}"))
    }
}

/// Names of the robot, and the files that the recording carries.
fn layout(setup: &Setup) -> Layout {
    let model = &setup.robot.robot.model;
    let name = |j: &usize| model.joints.get(*j).map_or(String::new(), |joint| joint.name.clone());
    let wrench = setup.settings.wrench.and_then(|i| model.sensors.get(i));
    let parts = ["fx", "fy", "fz", "mx", "my", "mz"];
    let mut carried = with_robot(&setup.robot);
    carried.version = Some(crate::VERSION.to_string());
    let controller = setup.run.as_ref().unwrap_or(&setup.hold);
    let hold = setup.run.as_ref().map(|_| (ATTACHED_HOLD, &setup.hold.text));
    for (name, text) in [(ATTACHED, &controller.text), ("daemon.toml", &setup.own.1)].into_iter().chain(hold) {
        let (name, media_type) = (name.to_string(), "application/toml".to_string());
        carried.files.push(Attachment { name, media_type, bytes: text.as_bytes().to_vec() });
    }
    Layout {
        joints: model.actuators.iter().map(name).collect(),
        sensors: wrench.map_or_else(Vec::new, |sensor| parts.map(|part| format!("wrench.{}.{part}", sensor.name)).to_vec()),
        epoch_ns: epoch_offset_ns(),
        carried,
    }
}
