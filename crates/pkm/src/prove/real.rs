//! The other leg of the proof: recordings of real robots whose missing physics others have published.

use core::sync::atomic::AtomicBool;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, ensure};
use pkm_trials::real::{Outcome, Real, halves, judge, known, stripped, table};
use pkm_trials::score::{Ran, Verdict};
use serde_json::json;

use super::folder::{Manifest, write};
use super::trial::{Engine, Limits, diagnose_in};
use crate::out;
use crate::progress::Progress;

/// Diagnoses every robot of the list that lies below `data`, writes the scores to `to`; false when it was stopped.
///
/// # Errors
/// Recordings that are not there, or files that cannot be written.
pub(super) fn run(data: &Path, to: &Path, (timeout, stop): (f64, &AtomicBool), quiet: bool) -> anyhow::Result<bool> {
    let list: Vec<Real> = known()?.into_iter().filter(|r| data.join(&r.folder).is_dir()).collect();
    ensure!(!list.is_empty(), "{}: none of the folders of the list of real recordings", data.display());
    let engine = Engine::this()?;
    let mut progress = Progress::new("diagnosing", quiet);
    let mut outcomes: Vec<Outcome> = Vec::new();
    for (i, real) in list.iter().enumerate() {
        let Some(outcome) = one(real, &data.join(&real.folder), to, (&engine, (timeout, stop)))? else { return Ok(false) };
        outcomes.push(outcome);
        // After every robot: a run that is stopped has told what it knew.
        save(&outcomes, to)?;
        progress.update((i + 1) as f64 / list.len() as f64);
    }
    drop(progress);
    if !quiet {
        out::say(&out::clean(table(&outcomes).trim_end()))?;
    }
    Ok(true)
}

fn save(outcomes: &[Outcome], to: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(to).with_context(|| to.display().to_string())?;
    let results = json!({"schema": "pkm.proof_real/1", "pkm": crate::VERSION, "robots": outcomes});
    write(&to.join("real.json"), &(serde_json::to_string_pretty(&results)? + "\n"))?;
    write(&to.join("real.md"), &table(outcomes))
}

/// All recordings of a robot, then each half of those to learn from.
fn one(real: &Real, folder: &Path, to: &Path, (engine, limits): (&Engine, Limits<'_>)) -> anyhow::Result<Option<Outcome>> {
    let Some((ran, whole)) = diagnosed(real, folder, (engine, limits), None)? else { return Ok(None) };
    let mut parts = [None, None];
    for (half, part) in parts.iter_mut().enumerate() {
        let Some((_, text)) = diagnosed(real, folder, (engine, limits), Some(half))? else { return Ok(None) };
        *part = text.map(|t| read_verdict(&real.folder, &t)).transpose()?;
    }
    if let Some(text) = &whole {
        let path = to.join("real").join(format!("{}.json", real.folder));
        fs::create_dir_all(crate::outputs::folder(&path))?;
        write(&path, text)?;
    }
    let verdict = whole.map(|t| read_verdict(&real.folder, &t)).transpose()?;
    Ok(Some(judge(real, verdict.as_ref(), &ran, &parts)))
}

fn read_verdict(robot: &str, text: &str) -> anyhow::Result<Verdict> {
    serde_json::from_str(text).map_err(|e| anyhow!("verdict on {robot}: {e}"))
}

/// A diagnosis in a folder that holds the stripped robot and the recordings, all or one half of them, and not what is known about them.
fn diagnosed(
    real: &Real,
    folder: &Path,
    (engine, limits): (&Engine, Limits<'_>),
    half: Option<usize>,
) -> anyhow::Result<Option<(Ran, Option<String>)>> {
    let room = tempfile::tempdir()?;
    let text = |path: PathBuf| fs::read_to_string(&path).with_context(|| path.display().to_string());
    let robot = text(folder.join("robot.toml"))?;
    let spec: toml::Table = toml::from_str(&robot).map_err(|e| anyhow!("{}/robot.toml: {}", folder.display(), e.message()))?;
    let urdf = spec.get("urdf").and_then(toml::Value::as_str).ok_or_else(|| anyhow!("{}/robot.toml: no urdf", folder.display()))?;
    let [robot, model] = stripped(&robot, &text(folder.join(urdf))?)?;
    write(&room.path().join("robot.toml"), &robot)?;
    write(&room.path().join(urdf), &model)?;
    // With few recordings the halves are halves in time of each; with many, every second one.
    let is_cut = real.learn.len() < 4;
    let mut manifest = Manifest { recordings: Vec::new(), holdouts: real.judge.clone() };
    for (i, name) in real.learn.iter().enumerate() {
        let whole = text(folder.join(name))?;
        let part = match half {
            Some(half) if is_cut => Some(halves(&whole)[half].clone()),
            Some(half) => (i % 2 == half).then_some(whole),
            None => Some(whole),
        };
        if let Some(part) = part {
            write(&room.path().join(name), &part)?;
            manifest.recordings.push(name.clone());
        }
    }
    for name in &real.judge {
        write(&room.path().join(name), &text(folder.join(name))?)?;
    }
    let band: Vec<String> = real.band.iter().flat_map(|b| ["--band".to_string(), b.to_string()]).collect();
    diagnose_in(room.path(), &manifest, engine, (&band, limits))
}
