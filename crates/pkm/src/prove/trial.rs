//! One diagnosis of a trial: a process of its own, in a folder that holds the public files and nothing else.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::fs;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, ensure};
use pkm_hal::{Clock, MonotonicClock};
use pkm_trials::score::Ran;
use pkm_trials::seal;

use super::folder::{Folder, Manifest, write};

/// How often a running diagnosis is looked at.
const LOOK: Duration = Duration::from_millis(50);

/// The program that diagnoses: this one, as it is on the disk when the run begins.
pub(super) struct Engine {
    path: PathBuf,
    name: String,
}

impl Engine {
    /// Asks for its version and hashes its file.
    ///
    /// # Errors
    /// A program that cannot be read or started.
    pub(super) fn this() -> anyhow::Result<Self> {
        let path = std::env::current_exe()?;
        let said = Command::new(&path).arg("--version").stdin(Stdio::null()).output().context("pkm --version")?;
        let version = String::from_utf8_lossy(&said.stdout).trim().to_string();
        let bytes = fs::read(&path).with_context(|| path.display().to_string())?;
        Ok(Self { path, name: format!("{version}, SHA-256 {}", seal::sha256(&bytes)) })
    }
}

/// When a diagnosis has to end: after a time `[s]`, or when the flag is raised.
pub(super) type Limits<'a> = (f64, &'a AtomicBool);

/// Diagnoses a case and moves its verdict to the run's folder; none when the flag was raised meanwhile, and then nothing is kept.
///
/// # Errors
/// When files are missing or a process cannot be started; a diagnosis that fails is no error but a result.
pub(super) fn diagnose(folder: &Folder, name: &str, engine: &Engine, limits: Limits<'_>) -> anyhow::Result<Option<Ran>> {
    let manifest = folder.manifest(name)?;
    // Elsewhere, under a name that says nothing: neither answers nor other cases lie beside it.
    let room = tempfile::tempdir()?;
    copy(&folder.case(name), room.path())?;
    let Some((ran, text)) = diagnose_in(room.path(), &manifest, engine, (&[], limits))? else { return Ok(None) };
    if let Some(text) = text {
        let path = folder.verdict_path(name);
        fs::create_dir_all(crate::outputs::folder(&path))?;
        write(&path, &text)?;
    }
    Ok(Some(ran))
}

/// Diagnoses the recordings in a folder with its robot.toml; how it ran, and the text of the verdict.
///
/// # Errors
/// When a process cannot be started.
pub(super) fn diagnose_in(
    room: &Path,
    manifest: &Manifest,
    engine: &Engine,
    (more, (timeout, stop)): (&[String], Limits<'_>),
) -> anyhow::Result<Option<(Ran, Option<String>)>> {
    let mut command = Command::new(&engine.path);
    command.arg("diagnose").arg("robot.toml").args(["--json", "verdict.json", "--quiet"]).args(more);
    manifest.recordings.iter().for_each(|r| {
        command.args(["--recording", r]);
    });
    manifest.holdouts.iter().for_each(|r| {
        command.args(["--holdout", r]);
    });
    let errors = fs::File::create(room.join("stderr.txt"))?;
    // A group of its own: Ctrl-C reaches this process alone, so that a diagnosis that was stopped is not taken for one that failed.
    command.current_dir(room).stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors).process_group(0);
    let clock = MonotonicClock::start();
    let mut child = command.spawn().context("pkm diagnose")?;
    let exit = wait(&mut child, &clock, timeout, stop)?;
    if stop.load(Ordering::SeqCst) {
        return Ok(None);
    }
    let seconds = clock.now_ns() as f64 * 1e-9;
    let told = fs::read_to_string(room.join("stderr.txt")).unwrap_or_default();
    let text = fs::read_to_string(room.join("verdict.json")).ok();
    let error = told.lines().next().unwrap_or_default().to_string();
    let ran = Ran { seconds, exit, error, engine: engine.name.clone(), verdict: text.as_ref().map(seal::sha256) };
    Ok(Some((ran, text)))
}

/// Exit status; none when it was stopped, after `timeout` `[s]`, by `stop` or by a signal.
fn wait(child: &mut Child, clock: &MonotonicClock, timeout: f64, stop: &AtomicBool) -> anyhow::Result<Option<i32>> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.code());
        }
        if clock.now_ns() as f64 * 1e-9 > timeout || stop.load(Ordering::SeqCst) {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(LOOK);
    }
}

/// The public files of a case: regular files, not folders.
fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let mut count = 0;
    for entry in fs::read_dir(from).with_context(|| from.display().to_string())? {
        let path = entry?.path();
        if let Some(name) = path.file_name().filter(|n| path.is_file() && *n != "case.toml") {
            fs::copy(&path, to.join(name)).with_context(|| path.display().to_string())?;
            count += 1;
        }
    }
    ensure!(count > 0, "{}: no files", from.display());
    Ok(())
}
