//! `pkm convert`: recordings from CSV to MCAP and back, with the robot attached where there is room for it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{bail, ensure};
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_record::{Attachment, Attachments, ReadOptions};
use serde_json::json;

use crate::outputs::is_same_file;
use crate::{out, robot_file, seal};

/// Arguments of `pkm convert`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pkm convert A.csv A.mcap --robot robot.toml
  pkm convert bag.mcap A.csv --topic /arm/joint_states
  pkm convert cut.mcap mended.mcap --recover")]
pub(crate) struct Args {
    /// Recording to read, .csv or .mcap.
    input: PathBuf,
    /// File to write, .csv or .mcap; an existing one is replaced.
    output: PathBuf,
    /// Topic of the joint states, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Keep what is complete of a damaged MCAP file, and tell how much that is and how much is lost.
    #[arg(long)]
    recover: bool,
    /// Attach this robot (robot.toml and URDF) to the MCAP file that is written.
    #[arg(long, value_name = "ROBOT")]
    robot: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    ensure!(!is_same_file(&args.input, &args.output), "{}: input and output are the same file", args.output.display());
    let options = ReadOptions { topic: args.topic.clone(), recover: args.recover };
    let recording = pkm_record::read(&args.input, &options)?;
    let mut attachments = pkm_record::read_attachments(&args.input, &options)?;
    attachments.keys.clear();
    let mut steps = Vec::new();
    pkm_record::read_controls(&args.input, &options, &mut |step| steps.push(step))?;
    let has_room = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    if let Some(robot) = &args.robot {
        ensure!(has_room, "{}: --robot needs an .mcap file to attach to", args.output.display());
        let description = robot_file::read(robot)?;
        fits(&recording, &description)?;
        let new = with_robot(&description);
        attachments.files.retain(|old| !new.files.iter().any(|n| n.name == old.name));
        attachments.files.extend(new.files);
        attachments.keys = new.keys;
    }
    let n_steps = steps.len();
    if has_room {
        attachments.controls = steps;
    }
    pkm_record::write(&args.output, &recording, &attachments)?;
    let lost = if has_room { 0 } else { attachments.files.len() };
    if args.json {
        let told = json!({
            "schema": "pkm.convert/1",
            "output": args.output.display().to_string(),
            "samples": recording.len(),
            "signals": recording.signals.keys().collect::<Vec<_>>(),
            "duration_s": recording.duration(),
            "attachments_left_out": lost,
            "controller_steps_left_out": if has_room { 0 } else { n_steps },
            "recovered": recording.meta.other.get("recovered").map(ToString::to_string),
        });
        out::say(&out::clean(&serde_json::to_string_pretty(&told)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    let left_out = if lost > 0 { format!(" ({lost} attached files left out: CSV has no place for them)") } else { String::new() };
    let left_out = if has_room || n_steps == 0 { left_out } else { format!("{left_out} ({n_steps} steps of the controller left out)") };
    let recovered = recording.meta.other.get("recovered").map_or(String::new(), |told| format!("\nRecovered: {told}"));
    let (samples, signals) = (recording.len(), recording.signals.len());
    let text =
        format!("{}: {samples} samples of {signals} signals, {:.3} s{left_out}{recovered}", args.output.display(), recording.duration());
    out::say(&out::clean(&text))?;
    Ok(ExitCode::SUCCESS)
}

/// A recording of another robot must not carry this one's files.
fn fits(recording: &Recording, description: &Description) -> anyhow::Result<()> {
    let model = &description.robot.model;
    for &j in &model.actuators {
        for kind in ["q", "tau"] {
            let column = format!("{kind}.{}", model.joints[j].name);
            if recording.signal(&column).is_none() {
                let (found, robot) = (recording.columns(), &model.name);
                bail!("{}: no column {column:?} (required for every actuated joint of {robot:?}; columns: {found})", recording.name);
            }
        }
    }
    Ok(())
}

/// The robot's files as attachments, and their hash as metadata.
pub(crate) fn with_robot(description: &Description) -> Attachments {
    let urdf = Path::new(&description.spec.urdf).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let file = |name: &str, media_type: &str, text: &str| Attachment {
        name: name.to_string(),
        media_type: media_type.to_string(),
        bytes: text.as_bytes().to_vec(),
    };
    let hash = seal::sha256(&format!("{}\0{}", description.toml_text, description.urdf_text));
    Attachments {
        files: vec![file("robot.toml", "application/toml", &description.toml_text), file(&urdf, "application/xml", &description.urdf_text)],
        keys: [("configuration".to_string(), hash)].into(),
        ..Attachments::default()
    }
}
