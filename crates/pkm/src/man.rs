//! `pkm man`: a manual page for the command and one for every verb.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Command;
use clap_mangen::Man;
use roff::{Roff, roman};

use crate::out;
use crate::outputs::Outputs;

/// Arguments of `pkm man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pkm man --out man
  pkm man --out ~/.local/share/man/man1    then `man pkm-diagnose`")]
pub(crate) struct Args {
    /// Folder for pkm.1 and pkm-VERB.1; it is made if it is not there, pages that exist are replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the verb; `command` is the whole command line.
pub(crate) fn run(args: &Args, command: Command) -> anyhow::Result<ExitCode> {
    let pages = pages(command)?;
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let targets: Vec<PathBuf> = pages.iter().map(|(name, _)| args.out.join(format!("{name}.1"))).collect();
    let mut outputs = Outputs::reserve(&targets, &[])?;
    for (target, (_, text)) in targets.iter().zip(&pages) {
        outputs.write(target, text)?;
    }
    outputs.publish()?;
    out::say(&out::clean(&format!("{} pages in {}", pages.len(), Path::new(&args.out).display())))?;
    Ok(ExitCode::SUCCESS)
}

/// Every page with its name: the command's, then the verbs'.
fn pages(command: Command) -> anyhow::Result<Vec<(String, String)>> {
    let mut command = command.disable_help_subcommand(true).after_help(examples_of(crate::HELP).unwrap_or_default());
    command.build();
    let mut pages = vec![("pkm".to_string(), page(&command)?)];
    for verb in command.get_subcommands() {
        // Built, a verb's display name is that of its page: pkm-check.
        let name = verb.get_display_name().unwrap_or_else(|| verb.get_name()).to_string();
        let text = page(&verb.clone().version(env!("CARGO_PKG_VERSION")))?;
        pages.push((name, text));
    }
    Ok(pages)
}

/// What stands under `Examples:` of the command's own help, heading included.
fn examples_of(help: &str) -> Option<String> {
    help.find("\nExamples:\n").map(|at| help[at + 1..].to_string())
}

fn page(command: &Command) -> anyhow::Result<String> {
    let man = Man::new(command.clone()).manual("pkm manual").date("").source(format!("pkm {}", env!("CARGO_PKG_VERSION")));
    let mut out = Vec::new();
    man.render_title(&mut out)?;
    man.render_name_section(&mut out)?;
    man.render_synopsis_section(&mut out)?;
    man.render_description_section(&mut out)?;
    man.render_options_section(&mut out)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut out)?;
    }
    if let Some(more) = command.get_after_help() {
        notes(&more.to_string()).to_writer(&mut out)?;
    }
    Ok(String::from_utf8(out)?)
}

/// What stands below the flags in `--help`. The generator of pages would run its lines together: commands to be typed, and tables.
fn notes(text: &str) -> Roff {
    let mut roff = Roff::new();
    let mut is_begun = false;
    for block in text.split("\n\n").filter(|b| !b.trim().is_empty()) {
        let mut lines: Vec<&str> = block.lines().collect();
        let heading = lines.first().and_then(|l| l.strip_suffix(':')).filter(|l| l.starts_with("Example"));
        if heading.is_some() {
            roff.control("SH", ["EXAMPLES"]);
            lines.remove(0);
        } else if is_begun {
            roff.control("PP", []);
        } else {
            roff.control("SH", ["NOTES"]);
        }
        is_begun = true;
        let is_table = heading.is_some() || lines.iter().any(|l| l.contains("  "));
        if is_table {
            roff.control("nf", []);
        }
        lines.iter().for_each(|line| {
            roff.text([roman(*line)]);
        });
        if is_table {
            roff.control("fi", []);
        }
    }
    roff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_keep_their_lines_and_sentences_flow() {
        let text = notes("One\ntwo.\n\nExamples:\n  pkm a\n  pkm .b").to_roff();
        assert!(text.contains(".SH NOTES\nOne\ntwo.\n"), "{text}");
        assert!(text.contains(".SH EXAMPLES\n.nf\n") && text.trim_end().ends_with(".fi"), "{text}");
    }
}
