//! The rules of the house that no compiler checks. Each rule is a function from text or lists to offences, and is shown one offence.

extern crate alloc;

use alloc::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the workspace")
}

// ---- arrows between crates

/// Which workspace crates a crate may use. `None`: any, because nothing uses it.
const ARROWS: [(&str, Option<&[&str]>); 20] = [
    ("pkm-hal", Some(&[])),
    ("pkm-dyn", Some(&[])),
    ("pkm-robots", Some(&[])),
    ("pkm-ctrl", Some(&["pkm-dyn"])),
    ("pkm-lapack-shim", Some(&[])),
    ("pkm-ident", Some(&["pkm-dyn", "pkm-lapack-shim"])),
    ("pkm-diagnose", Some(&["pkm-dyn", "pkm-ident"])),
    // Of ident only the type of a recording: the twin writes what a robot would have recorded.
    ("pkm-sim", Some(&["pkm-dyn", "pkm-hal", "pkm-ctrl", "pkm-ident"])),
    ("pkm-daemon", Some(&["pkm-dyn", "pkm-hal", "pkm-ctrl"])),
    ("pkm-record", Some(&["pkm-ident", "pkm-hal"])),
    ("pkm-live", Some(&["pkm-record", "pkm-hal"])),
    ("pkm-report", Some(&["pkm-dyn", "pkm-ident", "pkm-diagnose"])),
    ("pkm-papers", Some(&["pkm-dyn", "pkm-robots", "pkm-ctrl", "pkm-ident", "pkm-sim"])),
    // A proof must not share the mistakes of what it proves: files of robots, nothing else.
    ("pkm-trials", Some(&["pkm-robots"])),
    ("pkm-ethercat", Some(&["pkm-hal", "pkm-daemon"])),
    ("xtask", Some(&[])),
    ("pkm", None),
    ("pkm-python", None),
    ("pkm-tests", None),
    ("pkm-benches", None),
];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    kind: Option<String>,
    path: Option<String>,
}

/// Edges between workspace crates, optional ones included; edges of tests (dev) may go anywhere.
fn edges(metadata: &Metadata) -> Vec<(String, String)> {
    let is_built_in = |d: &&Dependency| d.path.is_some() && d.kind.as_deref() != Some("dev");
    let of = |p: &Package| p.dependencies.iter().filter(is_built_in).map(|d| (p.name.clone(), d.name.clone())).collect::<Vec<_>>();
    metadata.packages.iter().flat_map(of).collect()
}

fn forbidden(edges: &[(String, String)]) -> Vec<String> {
    let allowed: BTreeMap<&str, Option<&[&str]>> = ARROWS.into_iter().collect();
    let is_allowed = |from: &str, to: &str| allowed.get(from).is_some_and(|to_any| to_any.is_none_or(|list| list.contains(&to)));
    edges.iter().filter(|(from, to)| !is_allowed(from, to)).map(|(from, to)| format!("{from} -> {to}")).collect()
}

fn metadata() -> Metadata {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = ["metadata", "--no-deps", "--offline", "--format-version", "1"];
    let output = Command::new(cargo).args(arguments).current_dir(root()).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo's own format")
}

#[test]
fn crates_use_only_what_lies_below_them() {
    let metadata = metadata();
    let known: BTreeSet<&str> = ARROWS.iter().map(|(name, _)| *name).collect();
    let strangers: Vec<&String> = metadata.packages.iter().map(|p| &p.name).filter(|name| !known.contains(name.as_str())).collect();
    assert!(strangers.is_empty(), "crates without a place in the table: {strangers:?}");
    let edges = edges(&metadata);
    assert!(edges.len() > 5, "the workspace has arrows");
    assert!(forbidden(&edges).is_empty(), "{:?}", forbidden(&edges));
}

#[test]
fn a_forbidden_arrow_is_noticed() {
    let text = r#"{"packages": [
        {"name": "pkm-ctrl", "dependencies": [
            {"name": "pkm-dyn", "kind": null, "path": "x"}, {"name": "pkm-ident", "kind": null, "path": "x"},
            {"name": "pkm-sim", "kind": "dev", "path": "x"}, {"name": "libm", "kind": null, "path": null}]},
        {"name": "stranger", "dependencies": [{"name": "pkm-dyn", "kind": "build", "path": "x"}]}]}"#;
    let edges = edges(&serde_json::from_str(text).expect("metadata"));
    assert_eq!(forbidden(&edges), ["pkm-ctrl -> pkm-ident", "stranger -> pkm-dyn"]);
}

// ---- files

/// Files below `folder` with one of these extensions, relative to it; build products and hidden folders left out.
fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let (mut out, mut open) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).expect("a readable folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let is_product = name.starts_with('.') || ["target", "node_modules", "__pycache__", "venv"].contains(&name.as_str());
            if path.is_dir() && !is_product {
                open.push(path);
            } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
                out.push(path.strip_prefix(folder).expect("below the folder").to_path_buf());
            }
        }
    }
    out.sort();
    out
}

fn sources() -> Vec<(PathBuf, String)> {
    let root = root();
    let read = |path: PathBuf| {
        let text = fs::read_to_string(root.join(&path)).expect("readable text");
        (path, text)
    };
    files(&root, &["rs", "py", "pyi"]).into_iter().map(read).collect()
}

/// Names that say nothing about what is inside.
fn says_nothing(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    ["util", "utils", "common", "helper", "helpers", "misc", "manager"].contains(&stem.as_ref())
}

#[test]
fn file_names_say_what_is_inside() {
    assert!(says_nothing(Path::new("a/utils.rs")) && !says_nothing(Path::new("a/solve.rs")));
    let empty: Vec<PathBuf> = files(&root(), &["rs"]).into_iter().filter(|p| says_nothing(p)).collect();
    assert!(empty.is_empty(), "{empty:?}");
}

const MOST_LINES: usize = 800;

#[test]
fn no_source_file_is_longer_than_800_lines() {
    let long = |(path, text): &(PathBuf, String)| (text.lines().count() > MOST_LINES).then(|| path.clone());
    assert!(long(&(PathBuf::from("x.rs"), "\n".repeat(MOST_LINES + 1))).is_some());
    let found: Vec<PathBuf> = sources().iter().filter_map(long).collect();
    assert!(found.is_empty(), "{found:?}");
}

/// Folders that a text names: whatever stands in backticks and ends with a slash.
fn named_folders(text: &str) -> Vec<&str> {
    text.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).filter(|s| s.ends_with('/') && !s.contains(' ')).collect()
}

#[test]
fn folders_named_in_architecture_md_exist() {
    assert_eq!(named_folders("- `crates/pkm-dyn/`: mechanics of `a/b`, `tests/`\n`no/such folder/`"), ["crates/pkm-dyn/", "tests/"]);
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md at the root of the workspace");
    let folders = named_folders(&text);
    assert!(folders.len() >= 5, "a code map names folders: {folders:?}");
    let lost: Vec<&str> = folders.into_iter().filter(|f| !root().join(f).is_dir()).collect();
    assert!(lost.is_empty(), "{lost:?}");
}

// ---- text

// Written in two parts, so that this file does not offend itself.
const LIBM: &str = concat!("libm", "::");
const UNFINISHED: [&str; 2] = [concat!("todo", "!"), concat!("unimplemented", "!")];
const MACHINE_PATHS: [&str; 5] =
    [concat!("/ho", "me/"), concat!("/ro", "ot/"), concat!("/wo", "rk/"), concat!("/Us", "ers/"), concat!("C:", "\\")];

fn mentions(text: &str, patterns: &[&str]) -> Option<usize> {
    text.lines().position(|line| patterns.iter().any(|p| line.contains(p))).map(|line| line + 1)
}

fn offences(patterns: &[&str], is_exempt: impl Fn(&Path) -> bool) -> Vec<String> {
    let all = sources().into_iter().filter(|(path, _)| !is_exempt(path));
    all.filter_map(|(path, text)| mentions(&text, patterns).map(|line| format!("{}:{line}", path.display()))).collect()
}

#[test]
fn only_math_rs_calls_libm() {
    assert_eq!(mentions(&format!("fn f() {{}}\nlet y = {LIBM}sin(x);"), &[LIBM]), Some(2));
    let found = offences(&[LIBM], |path| path.ends_with("crates/pkm-dyn/src/math.rs"));
    assert!(found.is_empty(), "{found:?}");
    assert!(!offences(&[LIBM], |_| false).is_empty(), "math.rs itself is found");
}

// Likewise.
const GLAM: [&str; 2] = [concat!("rapier3d_f64::", "math"), concat!("gl", "am::")];

#[test]
fn only_convert_rs_knows_the_vectors_of_the_foreign_engine() {
    let found = offences(&GLAM, |path| path.ends_with("crates/sim/src/rapier/convert.rs"));
    assert!(found.is_empty(), "{found:?}");
    assert!(!offences(&GLAM, |_| false).is_empty(), "convert.rs itself is found");
}

// Likewise.
const DAY: [&str; 2] = [concat!("ClockId::", "Realtime"), concat!("System", "Time::")];
const DAY_ASKED: &str = concat!("epoch_offset", "_ns()");

#[test]
fn the_time_of_day_is_read_in_one_place_and_asked_for_where_a_recording_begins() {
    let read = offences(&DAY, |_| false);
    assert!(read.len() == 1 && read[0].starts_with("crates/hal/src/clock.rs:"), "{read:?}");
    let asked = offences(&[DAY_ASKED], |path| path.ends_with("crates/hal/src/clock.rs"));
    assert!(asked.len() == 1 && asked[0].starts_with("crates/pkm/src/daemon/recording.rs:"), "{asked:?}");
}

#[test]
fn nothing_is_left_unfinished() {
    let found = offences(&UNFINISHED, |_| false);
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    assert_eq!(mentions(concat!("see /ho", "me/me/x"), &MACHINE_PATHS), Some(1));
    let root = root();
    let mut found = offences(&MACHINE_PATHS, |_| false);
    for path in files(&root, &["toml", "md", "urdf", "json", "yml", "yaml", "cff"]) {
        let text = fs::read_to_string(root.join(&path)).expect("readable text");
        found.extend(mentions(&text, &MACHINE_PATHS).map(|line| format!("{}:{line}", path.display())));
    }
    assert!(found.is_empty(), "{found:?}");
}

/// First line of program text, tests and comments left out, that prints.
fn prints(text: &str) -> Option<usize> {
    let program = text.split("#[cfg(test)]").next().unwrap_or_default();
    let is_macro = |line: &str| {
        ["print!(", "println!(", "eprint!(", "eprintln!(", "dbg!("]
            .iter()
            .any(|p| line.trim_start().starts_with(p) || line.contains(&format!(" {p}")))
    };
    let is_print = |line: &str| !line.trim_start().starts_with("//") && is_macro(line);
    program.lines().position(is_print).map(|line| line + 1)
}

#[test]
fn libraries_never_print() {
    assert_eq!(prints("/// println!(1)\nfn f() {\n  eprintln!(\"x\");\n}"), Some(3));
    assert_eq!(prints("fn f() {}\n#[cfg(test)]\nmod t { fn g() { println!(); } }"), None);
    let libraries = ["pkm-dyn", "ctrl", "lapack-shim", "ident", "diagnose", "hal", "sim", "record", "report", "daemon", "trials"];
    let in_library = |path: &Path| libraries.iter().any(|l| path.starts_with(Path::new("crates").join(l).join("src")));
    let all = sources().into_iter().filter(|(path, _)| in_library(path) && !path.ends_with("tests.rs"));
    let found: Vec<String> = all.filter_map(|(path, text)| prints(&text).map(|line| format!("{}:{line}", path.display()))).collect();
    assert!(found.is_empty(), "{found:?}");
}

// ---- lists that must stay equal

fn stems(folder: &str, without: &[&str]) -> BTreeSet<String> {
    let all = files(&root().join(folder), &["rs"]);
    let name = |p: &PathBuf| p.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    all.iter().map(name).filter(|n| !without.contains(&n.as_str())).collect()
}

#[test]
fn every_effect_has_a_law_and_a_line_in_the_catalogue_and_columns_have_an_effect() {
    // `applied.rs` puts effects with numbers on a robot; it is no effect.
    let laws = stems("crates/pkm-dyn/src/effects", &["mod", "applied"]);
    let catalogue: BTreeSet<String> = pkm_dyn::effects::CATALOGUE.iter().map(|e| e.name.to_string()).collect();
    assert_eq!(laws, catalogue, "files of laws and the catalogue");
    let columns = stems("crates/diagnose/src/columns", &["mod"]);
    assert!(columns.is_subset(&laws), "columns without a law: {:?}", columns.difference(&laws).collect::<Vec<_>>());
    let looked_for: BTreeSet<String> = pkm_diagnose::looked_for().into_iter().map(str::to_string).collect();
    assert_eq!(columns, looked_for, "files of columns and what is looked for");
}

#[test]
fn every_test_file_is_in_the_table_of_contents_with_a_comment() {
    let contents = fs::read_to_string(root().join("tests/Cargo.toml")).expect("tests/Cargo.toml");
    let lines: Vec<&str> = contents.lines().collect();
    let listed: BTreeSet<String> =
        lines.iter().filter_map(|l| l.strip_prefix("path = \"")?.strip_suffix(".rs\"").map(str::to_string)).collect();
    let here = files(&root().join("tests"), &["rs"]).into_iter().filter(|p| p.components().count() == 1);
    let there: BTreeSet<String> = here.map(|p| p.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
    assert_eq!(listed, there, "a file that is not listed never runs");
    for (i, _) in lines.iter().enumerate().filter(|(_, l)| **l == "[[test]]") {
        assert!(lines[i - 1].starts_with("# "), "line {}: no comment above", i + 1);
    }
}
