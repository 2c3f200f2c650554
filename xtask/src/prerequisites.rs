//! What the system must have beforehand, each missing thing named with what to install.

use crate::shell::{answer, program};

/// Oldest Rust the workspace builds with (`rust-version` in Cargo.toml).
const RUST: (u32, u32) = (1, 89);

/// Oldest Python the wheel runs on.
const PYTHON: (u32, u32) = (3, 10);

/// The Python interpreter's name.
pub(crate) const PYTHON_PROGRAM: &str = "python3";

/// First `major.minor` in a text such as `rustc 1.95.0 (…)`.
fn version(text: &str) -> Option<(u32, u32)> {
    text.split_whitespace().find_map(|word| {
        let mut parts = word.split('.');
        Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
    })
}

/// Checks one program's version; the line to show, or what to do.
fn at_least(name: &str, answer: Option<String>, oldest: (u32, u32), remedy: &str) -> Result<String, String> {
    let (major, minor) = oldest;
    let Some(text) = answer else { return Err(format!("{name} is not there: {remedy}")) };
    match version(&text) {
        Some(found) if found >= oldest => Ok(text),
        Some(_) => Err(format!("{text} is too old (at least {major}.{minor}): {remedy}")),
        None => Err(format!("{name} gives no version ({text:?}): {remedy}")),
    }
}

/// Prints what is there; an error lists everything that is missing.
pub(crate) fn check() -> Result<(), String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let found = [
        at_least(
            "rustc",
            answer(program(rustc, &["--version"]).env_remove("RUSTC_WRAPPER")),
            RUST,
            "install Rust with rustup, https://rustup.rs",
        ),
        c_compiler(),
        at_least(
            PYTHON_PROGRAM,
            answer(&mut program(PYTHON_PROGRAM, &["--version"])),
            PYTHON,
            "install Python (Debian, Ubuntu: apt-get install python3 python3-venv)",
        ),
        module("venv"),
        module("ensurepip"),
    ];
    let mut missing = Vec::new();
    for line in found {
        match line {
            Ok(text) => println!("   {text}"),
            Err(text) => missing.push(text),
        }
    }
    if missing.is_empty() { Ok(()) } else { Err(missing.join("\n       ")) }
}

fn c_compiler() -> Result<String, String> {
    let name = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let text = answer(&mut program(&name, &["--version"]));
    let first = text.as_deref().and_then(|t| t.lines().next()).map(str::to_string);
    first.ok_or_else(|| {
        let name = name.to_string_lossy();
        format!("no C compiler {name:?}: install one (Debian, Ubuntu: apt-get install build-essential; macOS: xcode-select --install)")
    })
}

fn module(name: &str) -> Result<String, String> {
    let import = format!("import {name}");
    let is_there = answer(&mut program(PYTHON_PROGRAM, &["-c", &import])).is_some();
    let remedy = "install it (Debian, Ubuntu: apt-get install python3-venv)";
    if is_there { Ok(format!("Python module {name}")) } else { Err(format!("Python module {name} is not there: {remedy}")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_from_what_programs_say() {
        assert_eq!(version("rustc 1.95.0 (59807616e 2026-04-14)"), Some((1, 95)));
        assert_eq!(version("Python 3.11.7"), Some((3, 11)));
        assert_eq!(version("no number"), None);
    }

    #[test]
    fn an_old_or_absent_program_is_named_with_its_remedy() {
        assert!(at_least("p", Some("p 3.11.7".into()), (3, 10), "buy it").is_ok());
        let old = at_least("p", Some("p 3.9.2".into()), (3, 10), "buy it");
        assert_eq!(old, Err("p 3.9.2 is too old (at least 3.10): buy it".to_string()));
        assert_eq!(at_least("p", None, (3, 10), "buy it"), Err("p is not there: buy it".to_string()));
    }
}
