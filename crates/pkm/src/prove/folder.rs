//! The folder of a run: cases, answers, seals, verdicts, scores.

extern crate alloc;

use alloc::collections::BTreeMap;
use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, ensure};
use pkm_trials::case::Case;
use pkm_trials::score::{Marks, Ran, Verdict};
use pkm_trials::seal;
use serde::Deserialize;
use serde_json::json;

/// Files of a case, as its case.toml lists them.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Recordings to learn from.
    pub(super) recordings: Vec<String>,
    /// Recordings to judge on.
    #[serde(default)]
    pub(super) holdouts: Vec<String>,
}

/// The folder of a run.
pub(super) struct Folder {
    root: PathBuf,
}

impl Folder {
    /// The run in `root`.
    pub(super) fn new(root: &Path) -> Self {
        Self { root: root.to_path_buf() }
    }

    /// Name of the case with that number.
    pub(super) fn name(number: u64) -> String {
        format!("{number:04}")
    }

    /// Folder with the public files of a case.
    pub(super) fn case(&self, name: &str) -> PathBuf {
        self.root.join("cases").join(name)
    }

    /// Where the verdict on a case goes.
    pub(super) fn verdict_path(&self, name: &str) -> PathBuf {
        self.root.join("verdicts").join(format!("{name}.json"))
    }

    fn answer_path(&self, name: &str) -> PathBuf {
        self.root.join("answers").join(format!("{name}.json"))
    }

    fn run_path(&self, name: &str) -> PathBuf {
        self.root.join("runs").join(format!("{name}.json"))
    }

    /// Whether the run has been sealed.
    pub(super) fn has_seals(&self) -> bool {
        self.root.join("seals.txt").exists()
    }

    /// Whether a case is complete: its answer is written last.
    pub(super) fn has_case(&self, name: &str) -> bool {
        self.answer_path(name).exists()
    }

    /// Whether a case has been diagnosed.
    pub(super) fn has_run(&self, name: &str) -> bool {
        self.run_path(name).exists()
    }

    /// Makes the folders.
    pub(super) fn create(&self) -> anyhow::Result<()> {
        for part in ["cases", "answers", "verdicts", "runs"] {
            let path = self.root.join(part);
            fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }

    /// Writes a case, its answer last.
    pub(super) fn write_case(&self, name: &str, case: &Case) -> anyhow::Result<()> {
        let folder = self.case(name);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        for (file, text) in &case.files {
            write(&folder.join(file), text)?;
        }
        write(&self.answer_path(name), &(serde_json::to_string_pretty(&case.answer)? + "\n"))
    }

    /// What other methods said of the cases: their names, and folders with verdicts and runs.
    pub(super) fn others(&self) -> anyhow::Result<Vec<(String, Self)>> {
        let path = self.root.join("baselines");
        let mut out = Vec::new();
        if path.is_dir() {
            for entry in fs::read_dir(&path).with_context(|| path.display().to_string())? {
                let entry = entry.with_context(|| path.display().to_string())?;
                if entry.path().is_dir() {
                    out.push((entry.file_name().to_string_lossy().into_owned(), Self::new(&entry.path())));
                }
            }
        }
        out.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(out)
    }

    /// Names of the cases, in order.
    pub(super) fn names(&self) -> anyhow::Result<Vec<String>> {
        let path = self.root.join("cases");
        let entries = fs::read_dir(&path).with_context(|| path.display().to_string())?;
        let mut names = Vec::new();
        for entry in entries {
            let entry = entry.with_context(|| path.display().to_string())?;
            if entry.path().join("case.toml").is_file() {
                let name = entry.file_name().into_string().map_err(|_| anyhow!("{}: a name that is no text", path.display()))?;
                names.push(name);
            }
        }
        names.sort();
        ensure!(!names.is_empty(), "{}: no case", path.display());
        Ok(names)
    }

    /// Hashes every answer that has no seal yet and writes the list; a seal once made stays.
    pub(super) fn write_seals(&self) -> anyhow::Result<()> {
        let mut seals = if self.has_seals() { self.read_seals()? } else { BTreeMap::new() };
        for name in self.names()?.into_iter().filter(|n| self.has_case(n)) {
            if let alloc::collections::btree_map::Entry::Vacant(open) = seals.entry(name) {
                let hash = seal::sha256(&self.answer(open.key())?);
                open.insert(hash);
            }
        }
        write(&self.root.join("seals.txt"), &seal::list(&seals))
    }

    /// The seals; every case must have one.
    pub(super) fn seals(&self) -> anyhow::Result<BTreeMap<String, String>> {
        let seals = self.read_seals()?;
        for name in self.names()? {
            ensure!(seals.contains_key(&name), "{}: no seal of case {name}", self.root.join("seals.txt").display());
        }
        Ok(seals)
    }

    fn read_seals(&self) -> anyhow::Result<BTreeMap<String, String>> {
        let path = self.root.join("seals.txt");
        seal::read_list(&read(&path)?).map_err(|e| anyhow!("{}: {e}", path.display()))
    }

    /// Text of an answer.
    pub(super) fn answer(&self, name: &str) -> anyhow::Result<String> {
        read(&self.answer_path(name))
    }

    /// What the case consists of.
    pub(super) fn manifest(&self, name: &str) -> anyhow::Result<Manifest> {
        let path = self.case(name).join("case.toml");
        toml::from_str(&read(&path)?).map_err(|e| anyhow!("{}: {}", path.display(), e.message()))
    }

    /// Notes how a diagnosis ran; its verdict is there by then.
    pub(super) fn write_run(&self, name: &str, ran: &Ran) -> anyhow::Result<()> {
        fs::create_dir_all(self.root.join("runs"))?;
        write(&self.run_path(name), &(serde_json::to_string_pretty(ran)? + "\n"))
    }

    /// How a diagnosis ran; none where it has not.
    pub(super) fn run(&self, name: &str) -> anyhow::Result<Option<Ran>> {
        optional(&self.run_path(name))
    }

    /// Whether the verdict is another than the one that was noted when the diagnosis ended.
    pub(super) fn is_verdict_changed(&self, name: &str, ran: &Ran) -> anyhow::Result<bool> {
        let Some(noted) = &ran.verdict else { return Ok(false) };
        let path = self.verdict_path(name);
        Ok(!path.exists() || seal::sha256(&read(&path)?) != *noted)
    }

    /// The verdict on a case; none where there is none.
    pub(super) fn verdict(&self, name: &str) -> anyhow::Result<Option<Verdict>> {
        optional(&self.verdict_path(name))
    }

    /// Writes the scores.
    pub(super) fn write_scores(&self, marks: &[Marks], table: &str, page: &str) -> anyhow::Result<String> {
        let results = json!({"schema": "pkm.proof/1", "pkm": crate::VERSION, "cases": marks});
        let results = serde_json::to_string_pretty(&results)? + "\n";
        write(&self.root.join("results.json"), &results)?;
        write(&self.root.join("results.md"), table)?;
        write(&self.root.join("results.html"), page)?;
        Ok(results)
    }
}

fn optional<T: for<'a> Deserialize<'a>>(path: &Path) -> anyhow::Result<Option<T>> {
    match fs::read_to_string(path) {
        Ok(text) => serde_json::from_str(&text).map(Some).map_err(|e| anyhow!("{}: {e}", path.display())),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(anyhow!("{}: {e}", path.display())),
    }
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).map_err(|e| anyhow!("{}: {e}", path.display()))
}

/// A file is seen complete or not at all: a run that is stopped can go on.
pub(super) fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let name = || path.display().to_string();
    let mut file = tempfile::NamedTempFile::new_in(crate::outputs::folder(path)).with_context(name)?;
    file.write_all(text.as_bytes()).with_context(name)?;
    file.persist(path).map_err(|e| anyhow!("{}: {}", path.display(), e.error))?;
    Ok(())
}
