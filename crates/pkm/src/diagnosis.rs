//! What every verb that diagnoses shares: settings from flags, recordings from files, the run itself, the verdict as text.

use alloc::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, ensure};
use pkm_diagnose::{ControllerTwin, Diagnosis, InputError, Located, Settings, Verdict, Watch, diagnose_watched};
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::Description;
use pkm_ident::{Recording, seconds};
use pkm_record::ReadOptions;
use pkm_sim::SimError;

use crate::effects;
use crate::out;
use crate::outputs::is_same_file;
use crate::progress::Progress;

/// Flags that change how a diagnosis decides.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct SettingsArgs {
    /// Compare efforts below this frequency only [default: chosen from the motion].
    #[arg(long, value_name = "HZ", value_parser = positive, help_heading = "Decision")]
    band: Option<f64>,
    /// Smallest share of the squared error that a finding must explain to be worth a name [default: 0.03].
    #[arg(long, value_name = "SHARE", value_parser = share, help_heading = "Decision")]
    floor: Option<f64>,
    /// Seed of the null runs [default: 1].
    #[arg(long, value_name = "N", help_heading = "Decision")]
    seed: Option<u64>,
    /// Null runs per decision, 19 to 9999 [default: 199].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(19..=9999), help_heading = "Decision")]
    null_runs: Option<u16>,
    /// Do not look for this effect: what if it were not friction? May be given several times, or with commas between the names.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',', value_parser = effects::names(), hide_possible_values = true)]
    without: Vec<String>,
}

impl SettingsArgs {
    /// The defaults of the engine where no flag says otherwise.
    pub(crate) fn settings(&self) -> Settings {
        let default = Settings::default();
        Settings {
            band_hz: self.band,
            floor: self.floor.unwrap_or(default.floor),
            seed: self.seed.unwrap_or(default.seed),
            null_runs: self.null_runs.map_or(default.null_runs, usize::from),
            scratch: Some(std::env::temp_dir()),
            without: self.without.clone(),
            ..default
        }
    }
}

/// A finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("must be a number > 0".to_string()),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number >= 0 and < 1".to_string()),
    }
}

/// Reads recordings from their files; a doubt about their clocks is told unless `quiet`.
///
/// # Errors
/// One line that names the file and the place in it.
pub(crate) fn read_recordings(paths: &[PathBuf], topic: Option<&str>, quiet: bool) -> anyhow::Result<Vec<Recording>> {
    let options = ReadOptions { topic: topic.map(str::to_string), recover: false };
    let mut out = Vec::new();
    for path in paths {
        let recording = pkm_record::read(path, &options)?;
        if !quiet {
            doubt_the_clock(&recording);
        }
        tracing::info!("recording {}: {} samples, {:.1} s", path.display(), recording.len(), recording.duration());
        out.push(recording);
    }
    Ok(out)
}

/// A word on standard error where a clock seems to tell milliseconds.
fn doubt_the_clock(recording: &Recording) {
    let (apart, duration) = (seconds::apart(recording), recording.duration());
    if apart > seconds::SLOW_S {
        let told = format!("{} samples in {duration:.0} s, {apart:.3} s apart: are these milliseconds? t is in seconds", recording.len());
        out::line_on_stderr(&out::clean(&format!("note: {}: {told}", recording.name)));
    }
}

/// Refuses a file that is given twice: held-out data that was fitted proves nothing.
///
/// # Errors
/// Names the file.
pub(crate) fn each_once(recordings: &[PathBuf], holdouts: &[PathBuf]) -> anyhow::Result<()> {
    let all: Vec<&Path> = recordings.iter().chain(holdouts).map(PathBuf::as_path).collect();
    for (i, path) in all.iter().enumerate() {
        let is_twice = all[..i].iter().any(|before| is_same_file(before, path));
        ensure!(!is_twice, "{}: given twice among --recording and --holdout (limit: once)", path.display());
    }
    Ok(())
}

/// A robot with the name its errors are told under, and the controller that its recordings are said to be made with.
pub(crate) struct Subject<'d> {
    pub(crate) description: &'d Description,
    pub(crate) file: &'d str,
    pub(crate) controller: Stated<'d>,
}

/// The controller that recordings are said to be made with.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stated<'d> {
    /// Not said: no command is held against it.
    Nothing,
    /// That of the simulator.
    Simulators,
    /// A controller.toml.
    File(&'d Path),
}

/// A stated controller, replayed by the simulator.
struct ReplayedController<'d> {
    stated: Stated<'d>,
    robot: &'d Robot,
}

impl ControllerTwin for ReplayedController<'_> {
    fn commands(&mut self, recording: &Recording) -> Result<Option<BTreeMap<String, Vec<f64>>>, String> {
        let controller = match self.stated {
            Stated::Nothing => return Ok(None),
            Stated::Simulators => None,
            // Anew for every recording: each begins with filters and integrators at rest.
            Stated::File(path) => Some(pkm_ctrl::config::load(path, self.robot).map_err(|e| e.to_string())?),
        };
        match pkm_sim::replay_commands(controller, self.robot, recording) {
            Ok(commands) => Ok(Some(commands)),
            Err(SimError::NoSignal { .. }) => Ok(None),
            Err(other) => Err(other.to_string()),
        }
    }
}

/// Whoever waits for a diagnosis: sees a bar, and where the largest mismatch is as soon as that is known.
struct Told(Progress);

impl Watch for Told {
    fn progress(&mut self, share: f64) {
        self.0.update(share);
    }

    fn located(&mut self, first: Option<&Located>) {
        let Some(first) = first else { return };
        // Where the log is shown it has the line already.
        if tracing::enabled!(tracing::Level::INFO) {
            tracing::info!("{first} (after {:.1} s)", self.0.seconds());
        } else {
            self.0.say(&first.to_string());
        }
    }
}

/// Runs the engine.
///
/// # Errors
/// Recordings that do not fit the robot: one line.
pub(crate) fn run(
    subject: &Subject,
    train: &[Recording],
    holdout: &[Recording],
    settings: &Settings,
    quiet: bool,
) -> anyhow::Result<Diagnosis> {
    let mut watch = Told(Progress::new("diagnosing", quiet));
    let mut twin = ReplayedController { stated: subject.controller, robot: &subject.description.robot };
    let twin: Option<&mut dyn ControllerTwin> = if matches!(twin.stated, Stated::Nothing) { None } else { Some(&mut twin) };
    let result = diagnose_watched(subject.description, (train, holdout), settings, twin, &mut watch);
    tracing::info!("diagnosis took {:.1} s", watch.0.seconds());
    result.map_err(|e| input_error(e, subject.file))
}

/// An error of the engine with the file it is about: it knows recordings by their names, but robots by theirs alone.
pub(crate) fn input_error(error: InputError, robot: &str) -> anyhow::Error {
    match error {
        InputError::Mobility { .. } => anyhow!("{robot}: {error}"),
        InputError::Band { .. } => anyhow!("--band: {error}"),
        other => other.into(),
    }
}

/// The verdict as JSON text.
///
/// # Panics
/// With a number that is not finite: whoever reads the file relies on there being none.
pub(crate) fn json(verdict: &Verdict) -> anyhow::Result<String> {
    let value = serde_json::to_value(verdict)?;
    // No field of a verdict is optional, so a null is a number that JSON cannot write.
    if let Some(place) = null_in(&value, "verdict") {
        panic!("{place} is not a finite number");
    }
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

pub(crate) fn null_in(value: &serde_json::Value, at: &str) -> Option<String> {
    match value {
        serde_json::Value::Null => Some(at.to_string()),
        serde_json::Value::Array(items) => items.iter().enumerate().find_map(|(i, v)| null_in(v, &format!("{at}[{i}]"))),
        serde_json::Value::Object(items) => items.iter().find_map(|(k, v)| null_in(v, &format!("{at}.{k}"))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_json_cannot_write_is_found() {
        let value = serde_json::json!({"a": [1.0, f64::NAN]});
        assert_eq!(null_in(&value, "v").as_deref(), Some("v.a[1]"));
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for text in ["0", "-1", "nan", "inf", "x", ""] {
            assert!(positive(text).is_err(), "{text}");
        }
        assert!(share("1").is_err() && share("-0.1").is_err() && share("0.03").is_ok());
    }
}
