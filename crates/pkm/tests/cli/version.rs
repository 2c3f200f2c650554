//! `pkm --version`: the version, and the commit that is checked out.

use std::fs;
use std::path::{Path, PathBuf};
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

const ONE: &str = "0123456789abcdef0123456789abcdef01234567";
const OTHER: &str = "fedcba9876543210fedcba9876543210fedcba98";

/// The build script, compiled by itself.
fn script(folder: &Path) -> PathBuf {
    let (source, program) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("build.rs"), folder.join("script"));
    let mut command = Command::new("rustc");
    let told = command.args(["--edition", "2024", "-o"]).arg(&program).arg(source).output().expect("rustc, which built this");
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    program
}

/// What it tells cargo for a crate at `crate_dir`: the version, and the files that are watched besides itself.
fn told(script: &Path, crate_dir: &Path) -> (String, Vec<String>) {
    let mut command = Command::new(script);
    let out = command.env("CARGO_PKG_VERSION", "1.2.3").env("CARGO_MANIFEST_DIR", crate_dir).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let of = |key: &str| text.lines().filter_map(|line| line.strip_prefix(key)).map(str::to_string).collect::<Vec<_>>();
    let versions = of("cargo::rustc-env=PKM_VERSION=");
    assert_eq!(versions.len(), 1, "{text}");
    let watched = of("cargo::rerun-if-changed=").into_iter().filter(|path| path != "build.rs").collect();
    (versions[0].clone(), watched)
}

/// Cargo builds anew each time where what it watches is not there.
fn is_there(watched: &[String]) -> bool {
    watched.iter().all(|path| Path::new(path).exists())
}

#[test]
fn a_build_looks_at_its_own_repository_alone_and_at_no_more_of_it_than_the_commit() {
    let folder = tempfile::tempdir().unwrap();
    let script = script(folder.path());
    let root = folder.path().join("repository");
    let write = |path: &str, text: &str| {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    let crate_dir = root.join("crates/pkm");
    write("xtask/Cargo.toml", "");
    write("crates/pkm/Cargo.toml", "");
    // No repository: a packed source, a tarball.
    assert_eq!(told(&script, &crate_dir), ("1.2.3".to_string(), Vec::new()));
    // A branch with a file of its own.
    write(".git/HEAD", "ref: refs/heads/ours/here\n");
    write(".git/refs/heads/ours/here", &format!("{ONE}\n"));
    let (version, watched) = told(&script, &crate_dir);
    assert_eq!((version.as_str(), watched.len(), is_there(&watched)), ("1.2.3 (0123456789ab)", 2, true), "{watched:?}");
    // A branch that is packed; the folder is watched, since the next commit makes its file.
    fs::remove_file(root.join(".git/refs/heads/ours/here")).unwrap();
    write(".git/packed-refs", &format!("# pack-refs with: peeled\n{ONE} refs/heads/not/ours/here\n{OTHER} refs/heads/ours/here\n^{ONE}\n"));
    let (version, watched) = told(&script, &crate_dir);
    assert_eq!((version.as_str(), is_there(&watched)), ("1.2.3 (fedcba987654)", true), "{watched:?}");
    assert!(watched.iter().any(|path| path.ends_with("refs/heads/ours")), "{watched:?}");
    // No branch.
    write(".git/HEAD", &format!("{ONE}\n"));
    assert_eq!(told(&script, &crate_dir).0, "1.2.3 (0123456789ab)");
    // A second work tree.
    fs::rename(root.join(".git"), folder.path().join("common")).unwrap();
    let tree = folder.path().join("common/worktrees/second");
    fs::create_dir_all(&tree).unwrap();
    fs::write(tree.join("HEAD"), "ref: refs/heads/ours/here\n").unwrap();
    fs::write(tree.join("commondir"), "../..\n").unwrap();
    write(".git", &format!("gitdir: {}\n", tree.display()));
    let (version, watched) = told(&script, &crate_dir);
    assert_eq!((version.as_str(), is_there(&watched)), ("1.2.3 (fedcba987654)", true), "{watched:?}");
    // What is none.
    for head in ["", "ref: refs/heads/unborn\n", "ref: ../../../etc/passwd\n", "deadbeef\n"] {
        fs::write(tree.join("HEAD"), head).unwrap();
        assert_eq!(told(&script, &crate_dir).0, "1.2.3", "{head:?}");
    }
    // A copy of the crate in somebody else's repository is not that repository's commit.
    let vendored = folder.path().join("theirs/vendor/pkm");
    fs::create_dir_all(&vendored).unwrap();
    fs::create_dir_all(folder.path().join("theirs/.git")).unwrap();
    fs::write(folder.path().join("theirs/.git/HEAD"), format!("{ONE}\n")).unwrap();
    assert_eq!(told(&script, &vendored), ("1.2.3".to_string(), Vec::new()));
}
