//! The guide in docs/guide: every command in it is run, and the book is built where mdBook is installed.

use std::fs;
use std::path::{Path, PathBuf};

use crate::picture::{Panel, Table, svg};
use crate::shell::{answer, cargo, program, root, run, target};

/// Folder of the pages.
const PAGES: &str = "docs/guide/src";

/// What opens a block of commands.
const OPEN: &str = "```console";

/// Between the outputs of two commands.
const BETWEEN: &str = "@@ end of a command @@";

/// Most lines of a command's output that a page shows.
const SHOWN: usize = 34;

/// A line that asks for a picture: a name, a CSV file of the page's folder, and one or two of its columns, drawn over `t`.
const PICTURE: &str = "<!-- picture ";

/// Commands of a page: lines that begin with `$ ` in its console blocks, continued where they end in a backslash.
fn commands(page: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let (mut is_inside, mut goes_on) = (false, false);
    for line in page.lines() {
        if line.starts_with("```") {
            (is_inside, goes_on) = (!is_inside && line.trim_end() == OPEN, false);
        } else if is_inside && goes_on {
            if let Some(last) = out.last_mut() {
                last.push('\n');
                last.push_str(line);
            }
            goes_on = line.ends_with('\\');
        } else if let Some(command) = line.strip_prefix("$ ").filter(|_| is_inside) {
            out.push(command.to_string());
            goes_on = line.ends_with('\\');
        }
    }
    out
}

/// The page with the commands' outputs in the place of older ones.
fn with_outputs(page: &str, outputs: &[String]) -> String {
    let mut left = outputs.iter();
    let (mut out, mut is_inside, mut goes_on) = (String::new(), false, false);
    let mut pending: Option<&String> = None;
    let flush = |out: &mut String, pending: &mut Option<&String>| {
        if let Some(text) = pending.take() {
            let lines: Vec<&str> = text.trim_end().lines().collect();
            lines.iter().take(SHOWN).for_each(|l| *out += &format!("{}\n", l.trim_end()));
            if lines.len() > SHOWN {
                *out += "…\n";
            }
        }
    };
    for line in page.lines() {
        if line.starts_with("```") {
            flush(&mut out, &mut pending);
            (is_inside, goes_on) = (!is_inside && line.trim_end() == OPEN, false);
        } else if is_inside {
            let is_command = line.starts_with("$ ");
            if is_command {
                flush(&mut out, &mut pending);
                pending = left.next();
            }
            if !is_command && !goes_on {
                continue;
            }
            goes_on = line.ends_with('\\');
        }
        out += line;
        out.push('\n');
    }
    out
}

/// Every page below a folder, in order of path.
pub(crate) fn pages(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut out = Vec::new();
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    for path in entries.flatten().map(|e| e.path()) {
        if path.is_dir() {
            out.extend(pages(&path)?);
        } else if path.extension().is_some_and(|e| e == "md") {
            out.push(path);
        }
    }
    out.sort();
    Ok(out)
}

/// The program of this workspace, optimised; the folder it is in. `PKM_BIN` names a folder with one that is built already.
pub(crate) fn built() -> Result<PathBuf, String> {
    if let Some(folder) = std::env::var_os("PKM_BIN") {
        return Ok(PathBuf::from(folder));
    }
    run(&mut cargo("build --release --locked -p pkm"))?;
    Ok(target().join("release"))
}

/// Runs every command of the guide, or of the pages whose path holds one of `only`; each page in an empty folder of its own. With `--write`
/// among them the pages get what the commands print, and their pictures.
pub(crate) fn run_commands(only: &[&str]) -> Result<(), String> {
    let programs = built()?;
    let is_writing = only.contains(&"--write");
    let only: Vec<&str> = only.iter().copied().filter(|o| *o != "--write").collect();
    let (mut failed, mut count) = (Vec::new(), 0);
    for page in pages(&root().join(PAGES))? {
        let name = page.strip_prefix(root().join(PAGES)).unwrap_or(&page).display().to_string();
        let text = fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
        let commands = commands(&text);
        if commands.is_empty() || !(only.is_empty() || only.iter().any(|o| name.contains(o))) {
            continue;
        }
        count += commands.len();
        println!("   {name}: {} commands", commands.len());
        let folder = target().join("guide").join(name.replace('/', "-").replace(".md", ""));
        match in_a_folder(&folder, &commands, &programs) {
            // What stands on an effect's page comes from `cargo xtask atlas`.
            Ok(outputs) if is_writing && !name.starts_with("effects") => {
                fs::write(&page, with_outputs(&text, &outputs)).map_err(|e| format!("{}: {e}", page.display()))?;
                text.lines().filter(|l| l.starts_with(PICTURE)).try_for_each(|line| picture(line, &folder))?;
            }
            Ok(_) => {}
            Err(reason) => {
                println!("   {name}: {reason}");
                failed.push(name);
            }
        }
    }
    if failed.is_empty() {
        println!("   {count} commands of the guide ran");
        return Ok(());
    }
    Err(format!("commands fail in {}", failed.join(", ")))
}

/// What each command prints, in a shell that stops at the first failure, where the repository's folders are at hand as they are at its root.
fn in_a_folder(folder: &Path, commands: &[String], programs: &Path) -> Result<Vec<String>, String> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut script = "set -eu\n".to_string();
    for shared in ["docs", "robots"] {
        script += &format!("ln -s '{}' {shared}\n", root().join(shared).display());
    }
    commands.iter().for_each(|command| script += &format!("{command}\nprintf '\\n%s\\n' '{BETWEEN}'\n"));
    let path = std::env::var("PATH").unwrap_or_default();
    let mut shell = program("sh", &["-c", &script]);
    shell.current_dir(folder).env("PATH", format!("{}:{path}", programs.display())).env("NO_COLOR", "1");
    let output = shell.output().map_err(|e| format!("sh could not be started: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let outputs: Vec<String> = text.split(BETWEEN).take(commands.len()).map(|t| t.trim_matches('\n').to_string()).collect();
    if output.status.success() {
        return Ok(outputs);
    }
    let last = commands.get(text.matches(BETWEEN).count()).map_or("", String::as_str);
    Err(format!("`{last}`: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr).trim_end()))
}

/// Draws what a line asks for.
fn picture(line: &str, folder: &Path) -> Result<(), String> {
    let words: Vec<&str> = line.trim_start_matches(PICTURE).trim_end_matches("-->").split_whitespace().collect();
    let [name, file, columns @ ..] = words.as_slice() else { return Err(format!("{line}: name, file and columns are asked for")) };
    let table = Table::read(&folder.join(file))?;
    let time = table.column("t")?;
    let drawn: Vec<Vec<f64>> = columns.iter().map(|c| table.column(c)).collect::<Result<_, _>>()?;
    let panels: Vec<Panel<'_>> = drawn.iter().map(|y| Panel { x: &time, y, label: "time [s]", is_line: true }).collect();
    let path = root().join(PAGES).join("pictures").join(format!("{}.svg", name.trim_end_matches(':')));
    fs::create_dir_all(path.with_file_name("")).map_err(|e| format!("{}: {e}", path.display()))?;
    fs::write(&path, svg(&panels, &columns.join(" and "))).map_err(|e| format!("{}: {e}", path.display()))
}

/// Builds the book into target/book where mdBook is installed, and says so where it is not.
pub(crate) fn book() -> Result<(), String> {
    if answer(&mut program("mdbook", &["--version"])).is_none() {
        println!("   not run: mdbook is not installed (`cargo install mdbook --locked`)");
        return Ok(());
    }
    let out = target().join("book");
    run(program("mdbook", &["build", "docs/guide", "--dest-dir"]).arg(&out))?;
    println!("   {}/index.html", out.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What mdBook replaces by another file.
    const INCLUDE: &str = "{{#include ";

    /// A page with its included files, which the book shows in its place.
    fn whole(page: &Path) -> String {
        let text = fs::read_to_string(page).unwrap();
        let of = |line: &str| match line.trim().strip_prefix(INCLUDE) {
            Some(rest) => fs::read_to_string(page.with_file_name(rest.trim_end_matches('}'))).unwrap(),
            None => line.to_string(),
        };
        text.lines().map(of).collect::<Vec<_>>().join("\n")
    }

    /// Links of a text that lead to no file of the book, seen from a page's folder; those to other sites are theirs.
    fn dead(text: &str, folder: &Path) -> Vec<String> {
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next());
        let inside = root().join(PAGES).canonicalize().unwrap();
        let is_dead = |target: &&str| {
            let file = target.split('#').next().unwrap_or_default();
            let is_own = !target.contains("://") && !target.starts_with('#') && !target.is_empty();
            is_own && !folder.join(file).canonicalize().is_ok_and(|path| path.starts_with(&inside))
        };
        targets.filter(is_dead).map(str::to_string).collect()
    }

    #[test]
    fn every_link_leads_to_a_page_of_the_book() {
        let folder = root().join(PAGES);
        assert_eq!(dead("[a](start.md#x) [b](https://c.org/d) [e](gone.md) [f](../book.toml)", &folder), ["gone.md", "../book.toml"]);
        for page in pages(&folder).unwrap() {
            assert_eq!(dead(&whole(&page), page.parent().unwrap()), Vec::<String>::new(), "{}", page.display());
            // mdBook names such a page index.html, and leaves the links to it as they are.
            let is_renamed = page.file_name().is_some_and(|n| n == "README.md") && page.parent() != Some(folder.as_path());
            assert!(!is_renamed, "{}: call it index.md", page.display());
        }
    }

    #[test]
    fn every_page_is_in_the_summary() {
        let folder = root().join(PAGES);
        let summary = fs::read_to_string(folder.join("SUMMARY.md")).unwrap();
        for page in pages(&folder).unwrap() {
            let name = page.strip_prefix(&folder).unwrap().display().to_string();
            assert!(name == "SUMMARY.md" || summary.contains(&format!("]({name})")), "{name}");
        }
    }

    #[test]
    fn commands_are_those_after_a_dollar_in_console_blocks() {
        let page =
            "a\n$ no\n```console\n$ one\nits output\n$ two \\\n  --more \\\n  --yet\n```\n```sh\n$ no\n```\n```console\n$ three\n```\n";
        assert_eq!(commands(page), ["one", "two \\\n  --more \\\n  --yet", "three"]);
    }

    #[test]
    fn outputs_replace_older_ones_and_nothing_else() {
        let page = "# a\n```console\n$ one \\\n  --more\nold\n$ two\n```\ntext\n";
        let new = with_outputs(page, &["1\n2".to_string(), String::new()]);
        assert_eq!(new, "# a\n```console\n$ one \\\n  --more\n1\n2\n$ two\n```\ntext\n");
        assert_eq!(with_outputs(&new, &["1\n2".to_string(), String::new()]), new);
    }
}
