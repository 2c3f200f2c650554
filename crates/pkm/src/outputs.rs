//! Output files that appear together and complete, or not at all.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail, ensure};
use tempfile::NamedTempFile;

use crate::out;

/// Target that means standard output.
const STDOUT: &str = "-";

/// Files to be written: reserved before a long computation, so that a directory that cannot be written is told at once.
#[derive(Debug, Default)]
pub(crate) struct Outputs {
    pending: Vec<Pending>,
    /// What goes to standard output, where that is a target.
    printed: Option<String>,
}

#[derive(Debug)]
struct Pending {
    target: PathBuf,
    /// Beside the target: a rename across file systems is a copy, and a copy can be seen half done.
    file: NamedTempFile,
    is_written: bool,
}

impl Outputs {
    /// Checks every target and opens a temporary file beside it; `-` is standard output. `inputs` are files that must not be overwritten.
    ///
    /// # Errors
    /// A directory that is missing or cannot be written, a target that is no regular file, that is given twice or that is an input.
    pub(crate) fn reserve(targets: &[PathBuf], inputs: &[&Path]) -> anyhow::Result<Self> {
        let mut pending: Vec<Pending> = Vec::new();
        let mut printed = None;
        for target in targets {
            let name = target.display();
            if is_stdout(target) {
                ensure!(printed.is_none(), "-: standard output is named for two outputs");
                printed = Some(String::new());
                continue;
            }
            ensure!(target.file_name().is_some(), "{name}: not a file name");
            if let Ok(there) = fs::metadata(target) {
                ensure!(!there.is_dir(), "{name}: is a directory");
                ensure!(there.is_file(), "{name}: is not a regular file");
            }
            let twice = pending.iter().any(|p| is_same_file(&p.target, target));
            ensure!(!twice, "{name}: is named for two outputs");
            if let Some(input) = inputs.iter().find(|i| is_same_file(i, target)) {
                bail!("{name}: would overwrite the input {}", input.display());
            }
            pending.push(Pending { target: target.clone(), file: temporary(target)?, is_written: false });
        }
        Ok(Self { pending, printed })
    }

    /// Fills a reserved file; it is not yet to be seen.
    ///
    /// # Errors
    /// When the file system refuses.
    pub(crate) fn write(&mut self, target: &Path, text: &str) -> anyhow::Result<()> {
        if let Some(printed) = self.printed.as_mut().filter(|_| is_stdout(target)) {
            printed.push_str(text);
            return Ok(());
        }
        let slot = self.pending.iter_mut().find(|p| p.target == target);
        let pending = slot.ok_or_else(|| anyhow!("{}: not reserved", target.display()))?;
        let file = pending.file.as_file_mut();
        file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).with_context(|| target.display().to_string())?;
        pending.is_written = true;
        Ok(())
    }

    /// Whether standard output is a target, and words for people have no place there.
    pub(crate) const fn takes_stdout(&self) -> bool {
        self.printed.is_some()
    }

    /// Moves every filled file to its place; reserved ones that were not filled vanish. What was written for standard output is printed last.
    ///
    /// # Errors
    /// When the file system refuses; files that were moved before are taken away again, unless they replaced older ones.
    pub(crate) fn publish(self) -> anyhow::Result<()> {
        let mut new: Vec<PathBuf> = Vec::new();
        for pending in self.pending.into_iter().filter(|p| p.is_written) {
            let replaces = pending.target.exists();
            if let Err(e) = pending.file.persist(&pending.target) {
                for path in &new {
                    // Best effort: the error that matters is the one above.
                    let _ = fs::remove_file(path);
                }
                bail!("{}: {}", pending.target.display(), e.error);
            }
            if !replaces {
                new.push(pending.target);
            }
        }
        match self.printed.as_deref().map(str::trim_end) {
            Some(text) if !text.is_empty() => out::say(text),
            _ => Ok(()),
        }
    }
}

/// Whether a target means standard output; a file of that name is `./-`.
pub(crate) fn is_stdout(target: &Path) -> bool {
    target.as_os_str() == STDOUT
}

fn temporary(target: &Path) -> anyhow::Result<NamedTempFile> {
    let directory = folder(target);
    ensure!(directory.is_dir(), "{}: no directory {}", target.display(), directory.display());
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any other new file: the umask decides, not the privacy of temporary files.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let made = builder.prefix(".").suffix(".part").tempfile_in(directory);
    // The error of the library names the temporary file, which says nothing to the user.
    made.map_err(|e| anyhow!("{}: {}", target.display(), e.kind()))
}

/// Folder a file lies in.
pub(crate) fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether two paths name one file, which need not exist yet.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    let place = |p: &Path| fs::canonicalize(p).or_else(|_| fs::canonicalize(folder(p)).map(|f| f.join(p.file_name().unwrap_or_default())));
    a == b || matches!((place(a), place(b)), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn nothing_is_seen_before_everything_is() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.json", "b.html"].map(|n| folder.path().join(n));
        let mut outputs = Outputs::reserve(&[a.clone(), b.clone()], &[]).unwrap();
        outputs.write(&a, "1").unwrap();
        assert!(!a.exists());
        outputs.publish().unwrap();
        assert_eq!((fs::read_to_string(&a).unwrap().as_str(), names(folder.path())), ("1", vec!["a.json".to_string()]));
        drop(Outputs::reserve(&[b], &[]).unwrap());
        assert_eq!(names(folder.path()), ["a.json"]);
    }

    #[test]
    fn bad_targets_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let a = folder.path().join("a.json");
        for (targets, inputs) in [
            (vec![folder.path().join("no/such/x.json")], vec![]),
            (vec![folder.path().to_path_buf()], vec![]),
            (vec![a.clone(), folder.path().join(".").join("a.json")], vec![]),
            (vec![a.clone()], vec![a.as_path()]),
        ] {
            let error = Outputs::reserve(&targets, &inputs).unwrap_err().to_string();
            assert!(!error.contains(".part"), "{error}");
        }
        assert!(names(folder.path()).is_empty());
    }
}
