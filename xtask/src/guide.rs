//! The guide in docs/guide, and what README.md has its reader type: every command is run, and the book is built.

use std::fs;
use std::path::{Path, PathBuf};

use crate::blocks::{commands, copied, section, with_outputs};
use crate::picture::{Panel, Table, svg};
use crate::screen::shoot;
use crate::shell::{answer, cargo, program, root, run, target};

/// Folder of the pages.
const PAGES: &str = "docs/guide/src";

/// Between the outputs of two commands.
const BETWEEN: &str = "@@ end of a command @@";

/// A line that asks for a picture: a name and a file of the page's folder. Of a CSV file one or two columns are drawn over `t`; of a page
/// follow width and greatest height in pixels, and what is shown of it: headings with ` | ` between, `top` for what is above the first.
const PICTURE: &str = "<!-- picture ";

/// What mdBook replaces by another file.
const INCLUDE: &str = "{{#include ";

/// The section of README.md whose commands run as they stand; those of the others build, install, or want two terminals.
const TYPED: &str = "## Your own robot";

/// What to do where mdBook is not there.
const NO_BOOK: &str = "mdbook is not installed: `cargo install mdbook --locked`";

/// A text with commands.
struct Document {
    /// As it is told, and asked for.
    name: String,
    path: PathBuf,
    text: String,
    commands: Vec<String>,
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

/// The pages of the guide and the files that they include, and README.md; those of them that have commands.
fn documents() -> Result<Vec<Document>, String> {
    let mut out: Vec<Document> = Vec::new();
    for path in texts()? {
        let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let inside = path.strip_prefix(root().join(PAGES)).or_else(|_| path.strip_prefix(root())).unwrap_or(&path);
        out.push(Document { name: inside.display().to_string(), commands: commands(&text), path, text });
    }
    let path = root().join("README.md");
    let text = fs::read_to_string(&path).map_err(|e| format!("README.md: {e}"))?;
    let typed = section(&text, TYPED).ok_or_else(|| format!("README.md: no section {TYPED:?}"))?;
    let commands = copied(typed).into_iter().map(str::to_string).collect();
    out.push(Document { name: "repository/README.md".to_string(), commands, path, text });
    out.retain(|document| !document.commands.is_empty());
    Ok(out)
}

/// Pages of the guide, each followed by the files that it includes and no page before it did.
fn texts() -> Result<Vec<PathBuf>, String> {
    let mut out: Vec<PathBuf> = Vec::new();
    for page in pages(&root().join(PAGES))? {
        let text = fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
        let mut found = vec![page.clone()];
        for included in text.lines().filter_map(|line| line.trim().strip_prefix(INCLUDE)) {
            let path = page.with_file_name(included.trim_end_matches('}'));
            found.push(path.canonicalize().map_err(|e| format!("{}: {}: {e}", page.display(), path.display()))?);
        }
        found.retain(|path| !out.contains(path));
        out.extend(found);
    }
    Ok(out)
}

/// Runs every command of the guide and of README.md and builds the book, or runs the commands of the texts whose name holds one of `only`;
/// each text in an empty folder of its own. With `--write` among them the pages get what the commands print, and their pictures.
pub(crate) fn guide(only: &[&str]) -> Result<(), String> {
    let is_writing = only.contains(&"--write");
    let only: Vec<&str> = only.iter().copied().filter(|o| *o != "--write").collect();
    if only.is_empty() {
        // Before minutes of commands.
        needs_book()?;
    }
    run_commands(&only, is_writing)?;
    if only.is_empty() { book() } else { Ok(()) }
}

fn run_commands(only: &[&str], is_writing: bool) -> Result<(), String> {
    let programs = built()?;
    let (mut failed, mut count) = (Vec::new(), 0);
    for document in documents()? {
        let Document { name, commands, .. } = &document;
        if !(only.is_empty() || only.iter().any(|o| name.contains(o))) {
            continue;
        }
        count += commands.len();
        println!("   {name}: {} commands", commands.len());
        let folder = target().join("guide").join(name.replace('/', "-").replace(".md", ""));
        // What stands on an effect's page comes from `cargo xtask atlas`.
        let is_written = is_writing && !name.starts_with("effects");
        let written = |outputs: Vec<String>| if is_written { write(&document, &outputs, &folder) } else { Ok(()) };
        if let Err(reason) = in_a_folder(&folder, commands, &programs).and_then(written) {
            println!("   {name}: {reason}");
            failed.push(name.clone());
        }
    }
    if failed.is_empty() {
        println!("   {count} commands of the guide ran");
        return Ok(());
    }
    Err(format!("commands fail in {}", failed.join(", ")))
}

/// Puts what the commands of a text print into it, and makes its pictures.
fn write(document: &Document, outputs: &[String], folder: &Path) -> Result<(), String> {
    let Document { path, text, .. } = document;
    fs::write(path, with_outputs(text, outputs)).map_err(|e| format!("{}: {e}", path.display()))?;
    text.lines().filter(|l| l.starts_with(PICTURE)).try_for_each(|line| picture(line, folder))
}

/// What each command prints, in a shell that stops at the first failure, where the repository's folders are at hand as they are at its root.
fn in_a_folder(folder: &Path, commands: &[String], programs: &Path) -> Result<Vec<String>, String> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    // What a page leaves running in the background ends with it.
    let mut script = "set -eu\ntrap 'jobs -p > .jobs; kill $(cat .jobs) 2> /dev/null || :' EXIT\n".to_string();
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

/// Makes the picture that a line asks for.
fn picture(line: &str, folder: &Path) -> Result<(), String> {
    let words: Vec<&str> = line.trim_start_matches(PICTURE).trim_end_matches("-->").split_whitespace().collect();
    let [name, file, rest @ ..] = words.as_slice() else { return Err(format!("{line}: name and file are asked for")) };
    let pictures = root().join(PAGES).join("pictures");
    fs::create_dir_all(&pictures).map_err(|e| format!("{}: {e}", pictures.display()))?;
    let name = name.trim_end_matches(':');
    let path = pictures.join(name);
    let file = folder.join(file);
    if file.extension().is_none_or(|e| e != "html") {
        return plot(&file, rest, &path.with_extension("svg"));
    }
    let [size, parts @ ..] = rest else { return Err(format!("{line}: size and headings are asked for")) };
    let numbers = size.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let size = numbers.ok_or_else(|| format!("{line}: {size:?} is no size (such as 1280x900)"))?;
    let parts = parts.join(" ");
    if !shoot(&file, &parts.split(" | ").collect::<Vec<_>>(), size, &path.with_extension("png"))? {
        println!("   not made: {name} is a picture that Chromium takes, which is not installed");
    }
    Ok(())
}

/// Draws columns of a recording over time.
fn plot(file: &Path, columns: &[&str], picture: &Path) -> Result<(), String> {
    let table = Table::read(file)?;
    // Since its beginning: a daemon records the time of day.
    let mut time = table.column("t")?;
    let begin = time.first().copied().unwrap_or_default();
    time.iter_mut().for_each(|t| *t -= begin);
    let drawn: Vec<Vec<f64>> = columns.iter().map(|c| table.column(c)).collect::<Result<_, _>>()?;
    let panels: Vec<Panel<'_>> = drawn.iter().map(|y| Panel { x: &time, y, label: "time [s]", is_line: true }).collect();
    fs::write(picture, svg(&panels, &columns.join(" and "))).map_err(|e| format!("{}: {e}", picture.display()))
}

/// Whether the book can be built; where it cannot, what to do.
pub(crate) fn needs_book() -> Result<(), String> {
    answer(&mut program("mdbook", &["--version"])).map(drop).ok_or_else(|| NO_BOOK.to_string())
}

/// Builds the book into target/book.
fn book() -> Result<(), String> {
    let out = target().join("book");
    run(program("mdbook", &["build", "docs/guide", "--dest-dir"]).arg(&out))?;
    println!("   {}/index.html", out.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// What a block to be copied may hold, by how its lines begin, and why it is not run.
    const NOT_RUN: [(&str, &str); 6] = [
        ("cargo ", "builds, or measures"),
        ("chrt ", "measures, with a right that not everybody has"),
        ("pkm completions bash > ~/", "writes to the reader's home"),
        ("pkm man --out ~/", "writes to the reader's home"),
        ("pkm prove ", "takes hours, or wants a folder of somebody else"),
        ("python -m pkm.fleet --bench", "measures"),
    ];

    #[test]
    fn a_command_that_is_not_run_has_a_reason() {
        let reason = |line: &str| NOT_RUN.iter().find(|(start, _)| line.starts_with(start)).map(|(_, why)| *why);
        assert_eq!((reason("cargo xtask plants"), reason("pkm check prs3")), (Some("builds, or measures"), None));
        let mut used = vec![];
        for path in texts().unwrap() {
            for line in copied(&fs::read_to_string(&path).unwrap()) {
                let why = reason(line).unwrap_or_else(|| panic!("{}: {line:?} belongs into a console block, after `$ `", path.display()));
                used.push(why);
            }
        }
        assert!(NOT_RUN.iter().all(|(_, why)| used.contains(why)), "of {NOT_RUN:?} the guide has {used:?}");
    }

    #[test]
    fn what_readme_says_that_runs_is_run_with_the_guide() {
        let documents = documents().unwrap();
        let readme = documents.iter().find(|d| d.name == "repository/README.md").unwrap();
        let verbs: Vec<&str> = readme.commands.iter().map(|c| c.split_whitespace().nth(1).unwrap()).collect();
        assert!(verbs.len() >= 10 && verbs.contains(&"diagnose") && verbs.contains(&"reproduce"), "{verbs:?}");
        assert!(readme.commands.iter().all(|c| c.starts_with("pkm ")), "{:?}", readme.commands);
    }

    #[test]
    fn included_files_are_read_once_after_the_page_that_includes_them() {
        let texts = texts().unwrap();
        let place = |end: &str| texts.iter().position(|path| path.ends_with(end)).unwrap();
        assert_eq!(place("python/README.md"), place("src/python.md") + 1);
        assert_eq!((place("docs/BENCHES.md"), place("benches/README.md")), (place("src/benches.md") + 1, place("src/benches.md") + 2));
    }

    /// Verbs of the program, from its list of them.
    fn verbs() -> Vec<String> {
        let source = fs::read_to_string(root().join("crates/pkm/src/main.rs")).unwrap();
        let list = source.split_once("enum Verb {").unwrap().1.split("\n}").next().unwrap().to_string();
        let modules = list.lines().filter_map(|l| l.split_once('(')?.1.strip_suffix("::Args),"));
        modules.map(|module| module.replace('_', "-")).collect()
    }

    #[test]
    fn every_verb_has_a_page_with_an_example_and_a_line_in_the_overview() {
        let verbs = verbs();
        assert!(verbs.len() > 20 && verbs.contains(&"trial-null".to_string()), "{verbs:?}");
        let folder = root().join(PAGES).join("verbs");
        let overview = fs::read_to_string(folder.join("index.md")).unwrap();
        for verb in &verbs {
            let page = fs::read_to_string(folder.join(format!("{verb}.md"))).unwrap_or_else(|e| panic!("{verb}: {e}"));
            assert!(page.starts_with(&format!("# `pkm {verb}`: ")), "{verb}: the title");
            assert!(commands(&page).iter().any(|c| c.contains(&format!("pkm {verb} "))), "{verb}: no example");
            assert!(overview.contains(&format!("- [{verb}]({verb}.md): ")), "{verb}: not in the overview");
        }
        let there = pages(&folder).unwrap().len();
        assert_eq!(there, verbs.len() + 1, "a page of a verb that is none");
    }

    #[test]
    fn every_picture_that_is_asked_for_is_there_small_and_shown() {
        for path in texts().unwrap() {
            let text = fs::read_to_string(&path).unwrap();
            let lines: Vec<&str> = text.lines().collect();
            for pair in lines.windows(2).filter(|pair| pair[0].starts_with(PICTURE)) {
                let mut words = pair[0].trim_start_matches(PICTURE).split_whitespace();
                let name = words.next().unwrap().trim_end_matches(':').to_string();
                let kind = if words.next().unwrap().ends_with(".html") { "png" } else { "svg" };
                let shown = pair[1].split_once("](").map(|(_, rest)| rest.trim_end_matches(')'));
                let file = path.with_file_name(shown.unwrap_or_default());
                assert!(file.ends_with(format!("pictures/{name}.{kind}")), "{}: {} is not shown", path.display(), pair[0]);
                let bytes = fs::metadata(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).len();
                assert!(bytes <= crate::screen::LARGEST, "{}: {bytes} bytes", file.display());
            }
        }
    }
}
