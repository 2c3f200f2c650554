//! Commands in the blocks of a page, and what is printed below them.

/// What opens a block of commands that are run, each after a `$ `.
const CONSOLE: &str = "```console";

/// What opens a block to be copied.
const COPIED: &str = "```sh";

/// What opens a block without a language.
const BARE: &str = "```";

/// Most lines of a command's output that a page shows.
const SHOWN: usize = 34;

/// Commands of a page: lines that begin with `$ ` in its console blocks, continued where they end in a backslash.
pub(crate) fn commands(page: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let (mut is_inside, mut goes_on) = (false, false);
    for line in page.lines() {
        if line.starts_with("```") {
            (is_inside, goes_on) = (!is_inside && line.trim_end() == CONSOLE, false);
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

/// Lines of a page's blocks to be copied; those of blocks without a language that are a command of this project count as well.
pub(crate) fn copied(page: &str) -> Vec<&str> {
    let mut out = Vec::new();
    let mut block = None;
    for line in page.lines() {
        if line.starts_with("```") {
            block = if block.is_none() { Some(line.trim_end()) } else { None };
            continue;
        }
        let is_copied = match block {
            Some(COPIED) => !line.trim().is_empty(),
            Some(BARE) => line.starts_with("pkm ") || line.starts_with("cargo "),
            _ => false,
        };
        if is_copied {
            out.push(line);
        }
    }
    out
}

/// A page's section, from below its heading to the next of that rank.
pub(crate) fn section<'a>(page: &'a str, heading: &str) -> Option<&'a str> {
    let (_, rest) = page.split_once(&format!("\n{heading}\n"))?;
    rest.split("\n## ").next()
}

/// The page with the commands' outputs in the place of older ones.
pub(crate) fn with_outputs(page: &str, outputs: &[String]) -> String {
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
            (is_inside, goes_on) = (!is_inside && line.trim_end() == CONSOLE, false);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_those_after_a_dollar_in_console_blocks() {
        let page =
            "a\n$ no\n```console\n$ one\nits output\n$ two \\\n  --more \\\n  --yet\n```\n```sh\n$ no\n```\n```console\n$ three\n```\n";
        assert_eq!(commands(page), ["one", "two \\\n  --more \\\n  --yet", "three"]);
    }

    #[test]
    fn what_is_to_be_copied_stands_in_blocks_of_the_shell_or_of_no_language() {
        let page = "pkm no\n```sh\nls\n\npkm a   # why\n```\n```\npkm b\nFOLDER/x\n```\n```console\n$ pkm no\n```\n```toml\npkm = 1\n```\n";
        assert_eq!(copied(page), ["ls", "pkm a   # why", "pkm b"]);
    }

    #[test]
    fn a_section_ends_where_the_next_begins() {
        let page = "# a\n\n## b\none\n### c\ntwo\n## d\nthree\n";
        assert_eq!(section(page, "## b"), Some("one\n### c\ntwo"));
        assert_eq!(section(page, "## d"), Some("three\n"));
        assert_eq!(section(page, "## e"), None);
    }

    #[test]
    fn outputs_replace_older_ones_and_nothing_else() {
        let page = "# a\n```console\n$ one \\\n  --more\nold\n$ two\n```\ntext\n";
        let new = with_outputs(page, &["1\n2".to_string(), String::new()]);
        assert_eq!(new, "# a\n```console\n$ one \\\n  --more\n1\n2\n$ two\n```\ntext\n");
        assert_eq!(with_outputs(&new, &["1\n2".to_string(), String::new()]), new);
    }
}
