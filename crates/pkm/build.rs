//! `PKM_VERSION`: the version, and the commit it is built from where this is the repository; a packaged crate has its version alone.
//! The wheel is built with this script as well.
//!
//! Files are read, no program is run: builds without git or without a network are the same as others.

use std::fs;
use std::path::{Path, PathBuf};

/// Digits of a commit that are told.
const DIGITS: usize = 12;

/// Where the crates that tell it are in the repository: the program and the wheel.
const CRATES: [&str; 2] = ["crates/pkm", "python"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let version = env("CARGO_PKG_VERSION");
    let commit = repository(Path::new(&env("CARGO_MANIFEST_DIR"))).and_then(|git| commit(&git));
    let told = commit.map_or_else(|| version.clone(), |commit| format!("{version} ({commit})"));
    println!("cargo::rustc-env=PKM_VERSION={told}");
}

fn env(name: &str) -> String {
    std::env::var(name).unwrap_or_default()
}

/// Git's folder of the repository in which `crate_dir` is one of [`CRATES`], and of no other: a packaged crate may lie in somebody else's.
fn repository(crate_dir: &Path) -> Option<PathBuf> {
    let root = crate_dir.ancestors().find(|dir| CRATES.iter().any(|name| dir.join(name) == crate_dir))?;
    if !root.join("xtask/Cargo.toml").is_file() {
        return None;
    }
    let git = root.join(".git");
    if git.is_dir() {
        return Some(git);
    }
    // A second work tree: a file that says where the folder is.
    let text = fs::read_to_string(&git).ok()?;
    Some(root.join(text.trim().strip_prefix("gitdir: ")?))
}

/// The commit that is checked out. What it is read from is watched: the program is linked anew when another one is, and never otherwise.
fn commit(git: &Path) -> Option<String> {
    let head = watched(&git.join("HEAD"))?;
    let Some(name) = head.strip_prefix("ref: ") else { return shown(&head) };
    // Branches of a second work tree are with the first one's.
    let common = fs::read_to_string(git.join("commondir")).map_or_else(|_| git.to_path_buf(), |dir| git.join(dir.trim()));
    let loose = common.join(name);
    if let Some(id) = watched(&loose) {
        return shown(&id);
    }
    // The next commit makes a file of its own: the nearest folder that is there will show it.
    if let Some(folder) = loose.ancestors().skip(1).find(|folder| folder.is_dir()) {
        println!("cargo::rerun-if-changed={}", folder.display());
    }
    let packed = watched(&common.join("packed-refs"))?;
    packed.lines().find_map(|line| line.strip_suffix(name).and_then(|id| shown(id.strip_suffix(' ')?)))
}

/// The text of a file, which is watched from now on; none, and not watched, where it is not there: cargo would build anew each time.
fn watched(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    println!("cargo::rerun-if-changed={}", path.display());
    Some(text.trim().to_string())
}

/// The first digits of a commit's name, if it is one.
fn shown(id: &str) -> Option<String> {
    let is_id = id.len() >= 40 && id.chars().all(|c| c.is_ascii_hexdigit());
    is_id.then(|| id.chars().take(DIGITS).collect())
}
