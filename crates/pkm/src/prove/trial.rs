//! One diagnosis of a trial: a process of its own, in a folder that holds the public files and nothing else.

use core::time::Duration;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, ensure};
use pkm_hal::{Clock, MonotonicClock};
use pkm_trials::score::Ran;

use super::folder::{Folder, write};

/// How often a running diagnosis is looked at.
const LOOK: Duration = Duration::from_millis(50);

/// Diagnoses a case and moves its verdict to the run's folder.
///
/// # Errors
/// When files are missing or a process cannot be started; a diagnosis that fails is no error but a result.
pub(super) fn diagnose(folder: &Folder, name: &str, timeout: f64) -> anyhow::Result<Ran> {
    let manifest = folder.manifest(name)?;
    // Elsewhere, under a name that says nothing: neither answers nor other cases lie beside it.
    let room = tempfile::tempdir()?;
    copy(&folder.case(name), room.path())?;
    let mut command = Command::new(std::env::current_exe()?);
    command.arg("diagnose").arg("robot.toml").args(["--json", "verdict.json", "--quiet"]);
    manifest.recordings.iter().for_each(|r| {
        command.args(["--recording", r]);
    });
    manifest.holdouts.iter().for_each(|r| {
        command.args(["--holdout", r]);
    });
    let errors = fs::File::create(room.path().join("stderr.txt"))?;
    command.current_dir(room.path()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors);
    let clock = MonotonicClock::start();
    let mut child = command.spawn().context("pkm diagnose")?;
    let exit = wait(&mut child, &clock, timeout)?;
    let seconds = clock.now_ns() as f64 * 1e-9;
    let told = fs::read_to_string(room.path().join("stderr.txt")).unwrap_or_default();
    if let Ok(text) = fs::read_to_string(room.path().join("verdict.json")) {
        let path = folder.verdict_path(name);
        fs::create_dir_all(crate::outputs::folder(&path))?;
        write(&path, &text)?;
    }
    Ok(Ran { seconds, exit, error: told.lines().next().unwrap_or_default().to_string() })
}

/// Exit status; none when it was stopped, after `timeout` `[s]` or by a signal.
fn wait(child: &mut Child, clock: &MonotonicClock, timeout: f64) -> anyhow::Result<Option<i32>> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.code());
        }
        if clock.now_ns() as f64 * 1e-9 > timeout {
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
