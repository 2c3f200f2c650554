//! `pkm reproduce`: a paper's experiments done again, its numbers against ours.

mod page;
mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use pkm_papers::{ALL, Paper, find};

use crate::out;
use crate::outputs::Outputs;
use crate::progress::Progress;

/// Exit code when a row misses its gate.
const MISSED: u8 = 1;

/// Arguments of `pkm reproduce`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Papers: valera2017, armas, arceo2021, mcdaid. A row is `reproduced` when our number agrees with the paper's, or with what its equations \
give once misprints are mended; `conclusion holds` when what the paper says of it is right and the number needs something it does not \
print; `not reproducible` when it does not come out, with the reason; `MISSED` when our number misses what it is held against.

Exit status: 0 no row is missed, 1 some row is, 2 bad usage.

Examples:
  pkm reproduce arceo2021
  pkm reproduce valera2017 --html valera2017.html
  pkm reproduce mcdaid --json")]
pub(crate) struct Args {
    /// Which paper.
    #[arg(value_parser = paper)]
    paper: &'static Paper,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Write a page with the table and the plots here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
}

fn paper(key: &str) -> Result<&'static Paper, String> {
    let keys = || ALL.map(|p| p.key).join(", ");
    find(key).ok_or_else(|| format!("is not one of {}", keys()))
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let targets: Vec<PathBuf> = args.html.iter().cloned().collect();
    let mut outputs = Outputs::reserve(&targets, &[])?;
    let mut progress = Progress::new("doing the experiments again", args.json);
    let found = (args.paper.reproduce)(&mut |share| progress.update(share))?;
    drop(progress);
    if let Some(target) = &args.html {
        outputs.write(target, &page::html(args.paper, &found))?;
    }
    outputs.publish()?;
    out::say(&if args.json { text::json(args.paper, &found)? } else { text::text(args.paper, &found) })?;
    Ok(if found.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(MISSED) })
}
