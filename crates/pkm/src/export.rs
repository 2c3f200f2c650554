//! `pkm export`: a robot as other programs read it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::ValueEnum;
use pkm_dyn::urdf::export::{gepetto, mjcf};
use serde_json::json;

use crate::outputs::Outputs;
use crate::{out, robot_file};

/// Arguments of `pkm export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Loops, drives, rotor inertias, friction, travel and the closed assembly are exported with the bodies. What a format cannot say is \
told, and stands at the head of the file; a loop or an inertia that it cannot say exactly is refused.

Examples:
  pkm export prs3 --format mjcf --out prs3.xml
  pkm export my/robot.toml --format gepetto --out for_pinocchio")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// What to write.
    #[arg(long)]
    format: Format,
    /// The file (mjcf) or the folder (gepetto) to write; a folder is made if it is not there.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Replace files that exist.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    /// One MJCF file for MuJoCo 3.2 or later.
    Mjcf,
    /// robot.urdf and robot.yaml for Pinocchio, in the style of toolbox-parallel-robots.
    Gepetto,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let description = robot_file::read(&args.robot)?;
    let file = || args.robot.display().to_string();
    let (files, notes) = match args.format {
        Format::Mjcf => {
            let made = mjcf(&description.robot).with_context(file)?;
            (vec![(args.out.clone(), made.xml)], made.notes)
        }
        Format::Gepetto => {
            let made = gepetto(&description).with_context(file)?;
            let named = [("robot.urdf", made.urdf), ("robot.yaml", made.yaml)];
            (named.map(|(name, text)| (args.out.join(name), text)).into(), made.notes)
        }
    };
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    write(args, &files, &[&args.robot, &urdf])?;
    let names: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
    if args.json {
        let told = json!({"schema": "pkm.export/1", "robot": description.robot.model.name, "files": names, "left_out": notes});
        out::say(&out::clean(&serde_json::to_string_pretty(&told)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    let names = names.join(", ");
    let told = notes.iter().map(|note| format!("\n  note: {note}")).collect::<String>();
    out::say(&out::clean(&format!("{names}{told}")))?;
    Ok(ExitCode::SUCCESS)
}

fn write(args: &Args, files: &[(PathBuf, String)], inputs: &[&Path]) -> anyhow::Result<()> {
    for (path, _) in files.iter().filter(|_| !args.force) {
        ensure!(!path.exists() || path.is_dir(), "{}: exists already (--force replaces it)", path.display());
    }
    let new_folder = matches!(args.format, Format::Gepetto) && !args.out.exists();
    if new_folder {
        fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    }
    let targets: Vec<PathBuf> = files.iter().map(|(path, _)| path.clone()).collect();
    let mut outputs = Outputs::reserve(&targets, inputs)?;
    for (path, text) in files {
        outputs.write(path, text)?;
    }
    outputs.publish()
}
