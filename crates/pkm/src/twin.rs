//! `pkm twin`: a recording replayed in simulation, measured against simulated.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail};
use pkm_dyn::Model;
use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_ident::degrees::{other_positions, unit_that_closes_at_first};
use pkm_report::{Curve, Figure, Ink, Scale, Sheet, Table, Tone, sheet};
use pkm_sim::Setup;
use pkm_sim::twin::{Apart, Follow, Twin, TwinJoint, twin_along};
use serde_json::{Value, json};

use crate::diagnosis::{positive, read_recordings};
use crate::outputs::Outputs;
use crate::simulate::controller::ControllerArgs;
use crate::simulate::hidden;
use crate::simulate::plant::PlantArgs;
use crate::{check, out, robot_file};

/// Arguments of `pkm twin`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The controller of `pkm simulate` (PD with the weight of ROBOT as feed-forward, or the one that --controller names) follows the reference in the recording (q_ref.<joint>, and \
dq_ref.<joint> where recorded) in a simulation without noise. What the robot did and what the simulated one does are compared joint by \
joint: position, effort, and the work of the drive. A robot that was moved by another controller differs by that as well.

Examples:
  pkm twin prs3 --recording A.mcap
  pkm twin robot.toml --recording A.csv --follow measured --smooth 20
  pkm twin robot.toml --recording A.mcap --with 'payload@platform:mass=5' --html twin.html")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// The recording (.csv or .mcap) to replay.
    #[arg(long, value_name = "FILE")]
    recording: PathBuf,
    /// An effect that the simulated robot has besides its file, NAME@PLACE:PARAMETER=VALUE,...; may be given several times.
    #[arg(long = "with", value_name = "EFFECT")]
    with: Vec<String>,
    #[command(flatten)]
    controller: ControllerArgs,
    #[command(flatten)]
    plant: PlantArgs,
    /// What the simulated robot follows: the recorded reference, or the measured motion where none was recorded.
    #[arg(long, value_enum, default_value_t = FollowArg::Reference)]
    follow: FollowArg,
    /// With --follow measured: smooth the motion, without delay, at this frequency [default: not at all].
    #[arg(long, value_name = "HZ", value_parser = positive)]
    smooth: Option<f64>,
    /// Topic of the joint states, where an MCAP file has several.
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Seed of what persons do.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write a page with curves here; it needs no network.
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FollowArg {
    /// The recorded reference.
    Reference,
    /// The columns q.
    Measured,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    let nominal = &description.robot;
    check::must_assemble(&nominal.model, &file)?;
    let added = hidden::Concealed::parse("--with", &args.with, &nominal.model)?;
    let controller = args.controller.read(nominal)?.map(|(_, controller)| controller);
    let targets: Vec<PathBuf> = args.html.iter().cloned().collect();
    let inputs: Vec<&Path> = [args.robot.as_path(), &args.recording].into_iter().chain(args.controller.path()).collect();
    let mut outputs = Outputs::reserve(&targets, &inputs)?;
    let recording = read_recordings(core::slice::from_ref(&args.recording), args.topic.as_deref(), false)?;
    let recording = recording.first().ok_or_else(|| anyhow!("no recording"))?;
    in_its_units(&nominal.model, recording)?;
    let truth = Robot::new(description.bare.clone(), nominal.effects.iter().cloned().chain(added.effects).collect());
    let name = args.recording.display().to_string();
    let follow = match args.follow {
        FollowArg::Reference => Follow::Reference,
        FollowArg::Measured => Follow::Measured(args.smooth.unwrap_or(0.0)),
    };
    let setup = Setup { robots: [&truth, nominal], laws: added.laws, controller, watch: None };
    let found = twin_along(setup, recording, args.plant.kind(args.seed)?, follow).with_context(|| name.clone())?;
    if let Some(target) = &args.html {
        outputs.write(target, &page(&nominal.model.name, recording, &found))?;
    }
    outputs.publish()?;
    let text = if args.json { serde_json::to_string_pretty(&as_json(&nominal.model.name, &name, &found))? } else { as_text(&name, &found) };
    out::say(&out::clean(&text))?;
    Ok(ExitCode::SUCCESS)
}

/// Refuses positions that are in another unit than the robot's: a simulation would follow them wherever they lead.
fn in_its_units(model: &Model, recording: &Recording) -> anyhow::Result<()> {
    if let Some(found) = other_positions(model, recording).first() {
        bail!("{found}");
    }
    unit_that_closes_at_first(model, recording)
        .map_or(Ok(()), |unit| Err(anyhow!("{}: positions do not close the loops as they are, but would in {unit}", recording.name)))
}

fn as_json(robot: &str, recording: &str, found: &Twin) -> Value {
    let apart = |a: &Apart| json!({"rms": a.rms, "peak": a.peak, "measured_rms": a.measured_rms});
    let joint = |j: &TwinJoint| {
        json!({
            "joint": j.joint,
            "position": apart(&j.position),
            "effort": j.effort.as_ref().map(apart),
            "work_measured_j": j.work.map(|w| w[0]),
            "work_simulated_j": j.work.map(|w| w[1]),
        })
    };
    json!({
        "schema": "pkm.twin/1",
        "robot": robot,
        "recording": recording,
        "duration_s": found.duration_s,
        "joints": found.joints.iter().map(joint).collect::<Vec<_>>(),
    })
}

fn head() -> Vec<String> {
    ["joint", "position rms", "peak", "effort rms", "peak", "of measured", "work measured", "simulated"].map(String::from).to_vec()
}

fn row(j: &TwinJoint) -> Vec<String> {
    let none = || "-".to_string();
    let effort = |of: fn(&Apart) -> f64| j.effort.as_ref().map_or_else(none, |e| out::number(of(e)));
    let share = j.effort.filter(|e| e.measured_rms > 0.0).map_or_else(none, |e| format!("{:.2} %", 100.0 * e.rms / e.measured_rms));
    let work = |k: usize| j.work.map_or_else(none, |w| format!("{} J", out::number(w[k])));
    let position = [out::number(j.position.rms), out::number(j.position.peak)];
    let [rms, peak] = position;
    vec![j.joint.clone(), rms, peak, effort(|e| e.rms), effort(|e| e.peak), share, work(0), work(1)]
}

fn as_text(name: &str, found: &Twin) -> String {
    let rows: Vec<Vec<String>> = core::iter::once(head()).chain(found.joints.iter().map(row)).collect();
    format!("{name}: {:.3} s replayed; measured less simulated, in m or rad, N or N·m\n{}", found.duration_s, out::table(&rows))
}

fn page(robot: &str, recording: &Recording, found: &Twin) -> String {
    let worst = found.joints.iter().filter_map(|j| j.effort).map(|e| e.rms / e.measured_rms.max(f64::MIN_POSITIVE)).fold(0.0, f64::max);
    let points = |name: &str, of: &Recording| -> Option<Vec<(f64, f64)>> {
        let first = of.time.first()?;
        Some(of.time.iter().map(|t| t - first).zip(of.signal(name)?.iter().copied()).collect())
    };
    let curve = |label: &str, ink, points| Curve { label: label.to_string(), ink, points };
    let figure = |title: String, unit: &str, curves| Figure {
        title,
        x_label: "time, s".to_string(),
        y_label: unit.to_string(),
        scales: [Scale::Linear; 2],
        curves,
        shaded: (String::new(), Vec::new()),
    };
    let effort = |joint: &str| -> Option<Figure> {
        let name = format!("tau.{joint}");
        let curves = vec![
            curve("measured", Ink::Plain, points(&name, recording)?),
            curve("simulated", Ink::First, points(&name, &found.simulated)?),
        ];
        Some(figure(format!("Effort of {joint}"), "N or N·m", curves))
    };
    // Under feedback both positions are one line: their difference is what can be seen.
    let position = |joint: &str| -> Option<Figure> {
        let name = format!("q.{joint}");
        let (ours, theirs) = (points(&name, &found.simulated)?, points(&name, recording)?);
        let difference = theirs.iter().zip(&ours).map(|((t, q), (_, simulated))| (*t, q - simulated)).collect();
        let curves = vec![curve("measured less simulated", Ink::Second, difference)];
        Some(figure(format!("Position of {joint}, measured less simulated"), "m or rad", curves))
    };
    sheet(&Sheet {
        eyebrow: "Replay in simulation".to_string(),
        title: robot.to_string(),
        outcome: (format!("efforts differ by up to {:.2} %", 100.0 * worst), Tone::Found),
        answer: format!(
            "{:.3} s of the recorded reference, followed by the simulated robot under the controller of pkm simulate; shares are rms over \
             rms of the measured effort about its mean.",
            found.duration_s
        ),
        figures: found.joints.iter().flat_map(|j| [effort(&j.joint), position(&j.joint)]).flatten().collect(),
        tables: vec![Table { title: "Measured less simulated".to_string(), head: head(), rows: found.joints.iter().map(row).collect() }],
        footer: "The simulation has no noise; a robot that another controller moved differs by that as well.".to_string(),
    })
}
