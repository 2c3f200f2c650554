//! `pkm completions`: what a shell needs to complete verbs, flags and their values.

use std::process::ExitCode;

use clap_complete::{Shell, generate};

use crate::out;

/// Arguments of `pkm completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Where the script goes:
  bash        pkm completions bash > ~/.local/share/bash-completion/completions/pkm
  zsh         pkm completions zsh > ~/.zfunc/_pkm
              (fpath=(~/.zfunc $fpath) before compinit in ~/.zshrc)
  fish        pkm completions fish > ~/.config/fish/completions/pkm.fish
  powershell  pkm completions powershell >> $PROFILE

Examples:
  pkm completions bash > pkm.bash
  source <(pkm completions bash)")]
pub(crate) struct Args {
    /// The shell.
    shell: Shell,
}

/// Runs the verb; `command` is the whole command line.
pub(crate) fn run(args: &Args, mut command: clap::Command) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    generate(args.shell, &mut command, "pkm", &mut script);
    out::say(String::from_utf8(script)?.trim_end())?;
    Ok(ExitCode::SUCCESS)
}
