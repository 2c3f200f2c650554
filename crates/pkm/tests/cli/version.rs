//! `pkm --version`: the version, and the commit that is checked out.

use std::path::Path;
use std::process::Command;

use crate::fixture::pkm;

fn git(arguments: &[&str]) -> Option<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let told = Command::new("git").args(arguments).current_dir(root).output().ok().filter(|told| told.status.success())?;
    Some(String::from_utf8_lossy(&told.stdout).trim().to_string())
}

#[test]
fn it_names_the_commit_it_was_built_from() {
    let told = pkm(Path::new("."), &["--version"]);
    let text = String::from_utf8_lossy(&told.stdout).trim().to_string();
    let version = env!("CARGO_PKG_VERSION");
    assert!(told.status.success() && text.lines().count() == 1, "{text}");
    // Git itself is asked here, which the build does not do. Without a repository there is nothing to name.
    let want = match git(&["rev-parse", "HEAD"]) {
        Some(commit) if Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.git").exists() => format!("pkm {version} ({})", &commit[..12]),
        _ => format!("pkm {version}"),
    };
    assert_eq!(text, want);
}
