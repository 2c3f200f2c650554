//! `cargo xtask package`: everything that publishing does but the upload, of every crate in order, and of the wheel.

use std::fs;
use std::path::{Path, PathBuf};

use crate::prerequisites::PYTHON_PROGRAM;
use crate::python;
use crate::shell::{answer, cargo, output, program, root, run, target};

/// What must lie at the root of a project that others are to use.
const FILES: [&str; 6] = ["LICENSE-MIT", "LICENSE-APACHE", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff"];

/// Keys that a registry asks for or shows.
const KEYS: [&str; 4] = ["description", "license", "keywords", "categories"];

/// What every package has, whoever unpacks it: both licences, for they say so, and what a registry shows.
const CARRIED: [&str; 3] = ["LICENSE-MIT", "LICENSE-APACHE", "README.md"];

/// What the wheel's name says: any Python from 3.10 on.
const ABI: &str = "-cp310-abi3-";

/// Packages crates and wheel. With `--no-verify` the packages are not compiled, with `--no-wheel` the wheel is left out.
pub(crate) fn package(rest: &[&str]) -> Result<(), String> {
    if let Some(other) = rest.iter().find(|o| !["--no-verify", "--no-wheel"].contains(*o)) {
        return Err(format!("unexpected argument {other:?} (--no-verify, --no-wheel)"));
    }
    for file in FILES {
        let length = fs::metadata(root().join(file)).map_err(|e| format!("{file}: {e}"))?.len();
        println!("   {file}: {length} bytes");
    }
    citation()?;
    metadata()?;
    contents()?;
    let products = target().join("packages");
    // A package is taken for the one that was compiled before as long as its version is, whatever it holds.
    run(cargo("clean --quiet --workspace").env("CARGO_TARGET_DIR", &products))?;
    // In the order in which they depend on each other, against an overlay of the registry that holds those before; a tree that is not
    // committed can be tried as well.
    let excluded = "--exclude xtask --exclude pkm-tests --exclude pkm-benches --exclude pkm-python";
    let mut command = cargo(&format!("publish --dry-run --workspace {excluded} --allow-dirty"));
    command.args(rest.iter().filter(|o| **o == "--no-verify"));
    // What is looked for is whether they compile: without what only a debugger reads.
    run(command.env("CARGO_TARGET_DIR", &products).env("CARGO_PROFILE_DEV_DEBUG", "0"))?;
    if !rest.contains(&"--no-wheel") {
        wheel()?;
        installed()?;
    }
    println!("   nothing was uploaded");
    Ok(())
}

/// Looks at CITATION.cff with its makers' own checker, which wants older packages than the tests of the wheel do.
fn citation() -> Result<(), String> {
    let programs = environment("citation")?;
    python::install(&programs, &["cffconvert"])?;
    run(&mut program(programs.join(python::name("cffconvert")), &["--validate", "--infile", "CITATION.cff"]))
}

/// A virtual environment of its own, anew.
fn environment(name: &str) -> Result<PathBuf, String> {
    let folder = target().join("environments").join(name);
    run(program(PYTHON_PROGRAM, &["-m", "venv", "--clear"]).arg(&folder))?;
    Ok(folder.join(if cfg!(windows) { "Scripts" } else { "bin" }))
}

/// Looks whether every package carries what it must.
fn contents() -> Result<(), String> {
    let manifests = manifests()?;
    for manifest in &manifests {
        let text = fs::read_to_string(manifest).map_err(|e| format!("{}: {e}", manifest.display()))?;
        let name = stated(&text, "name").ok_or_else(|| format!("{}: no name", manifest.display()))?;
        let files = output(&mut cargo(&format!("package --list --allow-dirty --locked -p {name}")))?;
        if let Some(file) = lacks(&files, &CARRIED) {
            return Err(format!("{name}: its package has no {file}"));
        }
    }
    println!("   {} packages have {}", manifests.len(), CARRIED.join(", "));
    Ok(())
}

/// What is wanted and not among the lines.
fn lacks<'a>(lines: &str, wanted: &[&'a str]) -> Option<&'a str> {
    wanted.iter().copied().find(|file| !lines.lines().any(|line| line.trim() == *file))
}

/// The text that a manifest states for a key.
fn stated<'a>(manifest: &'a str, key: &str) -> Option<&'a str> {
    let value = manifest.lines().find_map(|l| l.strip_prefix(key)?.trim_start().strip_prefix('='))?;
    value.trim().strip_prefix('"')?.split('"').next()
}

/// Says which of a registry's keys each crate lacks.
fn metadata() -> Result<(), String> {
    let workspace = fs::read_to_string(root().join("Cargo.toml")).map_err(|e| format!("Cargo.toml: {e}"))?;
    let manifests = manifests()?;
    let mut without = 0;
    for manifest in &manifests {
        let text = fs::read_to_string(manifest).map_err(|e| format!("{}: {e}", manifest.display()))?;
        if let Some(key) = KEYS.iter().find(|key| !has(&text, &workspace, key)) {
            return Err(format!("{}: no {key} in [package]", manifest.display()));
        }
        without += usize::from(!has(&text, &workspace, "repository"));
    }
    if without > 0 {
        println!("   {without} of {} crates have no repository: a registry takes them, and warns", manifests.len());
    }
    Ok(())
}

/// Whether a manifest states a key, by itself or by the workspace.
fn has(manifest: &str, workspace: &str, key: &str) -> bool {
    let states = |text: &str| text.lines().any(|l| l.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('=')));
    states(manifest) || manifest.lines().any(|l| l.trim() == format!("{key}.workspace = true")) && states(workspace)
}

/// Manifests of the crates that are published.
fn manifests() -> Result<Vec<PathBuf>, String> {
    let crates = root().join("crates");
    let entries = fs::read_dir(&crates).map_err(|e| format!("{}: {e}", crates.display()))?;
    let mut out: Vec<PathBuf> = entries.flatten().map(|e| e.path().join("Cargo.toml")).filter(|p| p.is_file()).collect();
    out.push(root().join("robots/Cargo.toml"));
    out.sort();
    Ok(out)
}

/// The wheel as it would be uploaded, looked at by the registry's own checker.
fn wheel() -> Result<(), String> {
    let programs = python::environment()?;
    let wheel = python::build(&programs, &["--release"])?;
    let name = wheel.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if !name.contains(ABI) {
        return Err(format!("{name}: not for every Python from 3.10 on ({ABI})"));
    }
    // Names in it begin with a folder that says its version.
    let names = "import sys, zipfile; print(*(n.rpartition('/')[2] for n in zipfile.ZipFile(sys.argv[1]).namelist()), sep='\\n')";
    let files = output(program(programs.join(python::name("python")), &["-c", names]).arg(&wheel))?;
    if let Some(file) = lacks(&files, &CARRIED[..2]) {
        return Err(format!("{name} has no {file}"));
    }
    python::install(&programs, &["twine"])?;
    run(program(programs.join("python"), &["-m", "twine", "check", "--strict"]).arg(&wheel))?;
    println!("   {}", shown(&wheel));
    Ok(())
}

/// Installs from the source as its reader does, where nothing is installed yet, and asks it for its version.
fn installed() -> Result<(), String> {
    let programs = environment("installed")?;
    python::install(&programs, &["./python"])?;
    // Not at the root, where other folders could be taken for the package.
    let mut ask = program(programs.join(python::name("python")), &["-c", "import pkm; print(pkm.__version__)"]);
    println!("   installed from ./python: pkm {}", output(ask.current_dir(&programs))?.trim());
    Ok(())
}

/// A path with its size.
fn shown(path: &Path) -> String {
    let size = fs::metadata(path).map_or(0, |m| m.len()) / 1024;
    let version = answer(&mut program("uname", &["-m"])).unwrap_or_default();
    format!("{}, {size} KiB, {version}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_counts_where_it_is_stated() {
        let workspace = "license = \"MIT\"\n";
        assert!(has("license.workspace = true\n", workspace, "license") && has("license = \"MIT\"\n", "", "license"));
        assert!(!has("license.workspace = true\n", "", "license") && !has("name = \"license\"\n", workspace, "license"));
    }

    #[test]
    fn a_manifest_states_its_name() {
        assert_eq!(stated("[package]\nname = \"a-b\" # why\n", "name"), Some("a-b"));
        assert_eq!(stated("rename = \"c\"\nname.workspace = true\n", "name"), None);
    }

    #[test]
    fn what_a_package_lacks_is_named() {
        assert_eq!(lacks("Cargo.toml\nLICENSE-MIT\n", &["LICENSE-MIT", "README.md"]), Some("README.md"));
        assert_eq!(lacks("LICENSE-MIT\nREADME.md\n", &["LICENSE-MIT", "README.md"]), None);
    }

    #[test]
    fn every_published_folder_has_the_licences_of_the_root() {
        let folders = manifests().unwrap().into_iter().map(|m| m.with_file_name("")).chain([root().join("python")]);
        for folder in folders {
            for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
                let text = fs::read(folder.join(name)).unwrap_or_else(|e| panic!("{}: {name}: {e}", folder.display()));
                assert!(text == fs::read(root().join(name)).unwrap(), "{}: {name} is another text", folder.display());
            }
        }
    }

    #[test]
    fn every_crate_but_those_for_development_is_published() {
        let names: Vec<String> = manifests().unwrap().iter().map(|p| fs::read_to_string(p).unwrap()).collect();
        assert!(names.len() >= 15 && names.iter().all(|text| text.contains("publish.workspace = true")));
        for folder in ["xtask", "tests", "benches", "python"] {
            let text = fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
            assert!(text.contains("publish = false"), "{folder}");
        }
    }
}
