//! `pkm replay`: the inputs that a recorded controller was given go through the same controller again; its commands must be the same bits.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail, ensure};
use pkm_ctrl::{Running, Signals, config};
use pkm_dyn::urdf::{Description, parse};
use pkm_record::{Attachment, Control, ControlStep, ReadOptions};
use serde_json::{Value, json};

use crate::out;
use crate::simulate::controller::{ATTACHED, ATTACHED_HOLD};

/// Arguments of `pkm replay`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Robot and controller are those attached to the first file; where a daemon ran another law than that of its position loop, both.

Exit status: 0 every command is the same to the bit, 1 some are not; the first that is not is named with both values.

Examples:
  pkm simulate prs3 --out A.mcap --controller controller.toml
  pkm replay A.mcap
  pkm daemon --start --seconds 5 --record runs
  pkm replay runs/prs3_0001.mcap
  pkm replay A.mcap --controller other.toml --json")]
pub(crate) struct Args {
    /// Recordings (.mcap) with the steps of a controller; of one that was rotated all files in order.
    #[arg(required = true, value_name = "FILE")]
    recordings: Vec<PathBuf>,
    /// Another controller than the attached one: where does it begin to differ?
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Replay what is complete of a damaged file.
    #[arg(long)]
    recover: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A command that came out otherwise.
struct Difference {
    file: String,
    step: u64,
    t: f64,
    drive: usize,
    recorded: f64,
    replayed: f64,
    is_about_fault: bool,
}

/// The controllers of a recording.
struct Laws {
    controller: Box<dyn Running>,
    /// That of the position loop, where it is another one.
    hold: Option<Box<dyn Running>>,
}

impl Laws {
    /// The one that did a step.
    fn of(&mut self, step: &ControlStep) -> &mut dyn Running {
        match &mut self.hold {
            Some(hold) if !step.as_control().is_other_law => hold.as_mut(),
            _ => self.controller.as_mut(),
        }
    }
}

/// What a replay found.
#[derive(Default)]
struct Found {
    steps: u64,
    differing: u64,
    largest: f64,
    first: Option<Difference>,
    /// Whether a law was at rest once: the position loop's or the only one, and another.
    has_begun: [bool; 2],
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let options = ReadOptions { topic: None, recover: args.recover };
    let first = args.recordings.first().ok_or_else(|| anyhow!("no recording"))?;
    let name = first.display().to_string();
    let carried = pkm_record::read_attachments(first, &options)?.files;
    let description = attached_robot(&name, &carried)?;
    let attached = |file: &str| -> anyhow::Result<Box<dyn Running>> {
        let text = text(&name, &carried, |carried| carried.name == file)?;
        Ok(config::parse(text, &format!("{name}:{file}"), &description.robot)?)
    };
    let controller = args.controller.as_ref().map_or_else(|| attached(ATTACHED), |path| Ok(config::load(path, &description.robot)?))?;
    let hold = carried.iter().any(|file| file.name == ATTACHED_HOLD).then(|| attached(ATTACHED_HOLD)).transpose()?;
    let mut laws = Laws { controller, hold };
    let mut found = Found::default();
    for path in &args.recordings {
        let file = path.display().to_string();
        let mut refused = Ok(());
        pkm_record::read_controls(path, &options, &mut |step| {
            if refused.is_ok() {
                refused = found.step(laws.of(&step), &file, &step);
            }
        })?;
        refused?;
    }
    // A daemon that waited for an order filled whole files with it.
    ensure!(found.steps > 0, "{name}: no steps of a controller (topic /pkm/control; `pkm simulate --controller` records them)");
    let controller = laws.controller;
    let text = if args.json {
        serde_json::to_string_pretty(&as_json(args, &found, controller.as_ref(), &description))?
    } else {
        as_text(args, &found, controller.as_ref(), &description)
    };
    out::say(&out::clean(&text))?;
    Ok(if found.first.is_some() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// The robot whose files are attached.
fn attached_robot(name: &str, carried: &[Attachment]) -> anyhow::Result<Description> {
    let toml = text(name, carried, |file| file.name == "robot.toml")?;
    let urdf = text(name, carried, |file| file.media_type == "application/xml")?;
    Ok(parse(toml, urdf, [&format!("{name}:robot.toml"), &format!("{name}:urdf")])?)
}

fn text<'a>(name: &str, carried: &'a [Attachment], is_it: impl Fn(&Attachment) -> bool) -> anyhow::Result<&'a str> {
    let Some(file) = carried.iter().find(|file| is_it(file)) else {
        let there: Vec<&str> = carried.iter().map(|file| file.name.as_str()).collect();
        let there = if there.is_empty() { "none".to_string() } else { there.join(", ") };
        bail!("{name}: robot.toml, a URDF and controller.toml must be attached (attached: {there}); `pkm simulate --controller` does so");
    };
    core::str::from_utf8(&file.bytes).with_context(|| format!("{name}: attached file {}", file.name))
}

impl Found {
    /// Does one step again.
    fn step(&mut self, controller: &mut dyn Running, file: &str, step: &ControlStep) -> anyhow::Result<()> {
        let control = step.as_control();
        let n = controller.about().n_drives;
        let place = || format!("{file}: step {} at t = {} s", step.number, step.t);
        ensure!(control.command.len() == n, "{}: {} drives (the attached robot has {n})", place(), control.command.len());
        let has_begun = &mut self.has_begun[usize::from(control.is_other_law)];
        *has_begun |= control.is_first;
        ensure!(*has_begun, "{}: the controller was not at rest before it; give the files before this one as well", place());
        if control.is_first {
            controller.reset();
        }
        let mut tau = vec![0.0; n];
        let health = controller.step(&signals(&control), &mut tau);
        self.steps += 1;
        let drive = tau.iter().zip(control.command).position(|(a, b)| a.to_bits() != b.to_bits());
        let is_about_fault = drive.is_none() && health.is_faulted != control.is_faulted;
        if drive.is_none() && !is_about_fault {
            return Ok(());
        }
        self.differing += 1;
        let apart = tau.iter().zip(control.command).map(|(a, b)| (a - b).abs());
        self.largest = apart.filter(|x| x.is_finite()).fold(self.largest, f64::max);
        let k = drive.unwrap_or(0);
        let (recorded, replayed) = (control.command[k], tau[k]);
        let (file, number, t) = (file.to_string(), step.number, step.t);
        self.first.get_or_insert(Difference { file, step: number, t, drive: k, recorded, replayed, is_about_fault });
        Ok(())
    }
}

fn signals<'a>(control: &Control<'a>) -> Signals<'a> {
    Signals {
        dt: control.dt,
        q_dt: control.q_dt,
        q_meas: control.q_meas,
        tau_meas: control.tau_meas,
        wrench_meas: control.wrench_meas,
        q_ref: control.q_ref,
        v_ref: control.v_ref,
        a_ref: control.a_ref,
        wrench_ref: control.wrench_ref,
        tau_ff: control.tau_ff,
    }
}

fn joint(description: &Description, drive: usize) -> &str {
    let model = &description.robot.model;
    model.actuators.get(drive).map_or("", |&j| model.joints[j].name.as_str())
}

fn as_text(args: &Args, found: &Found, controller: &dyn Running, description: &Description) -> String {
    let files: Vec<String> = args.recordings.iter().map(|path| path.display().to_string()).collect();
    let (files, law, steps) = (files.join(", "), &controller.about().name, found.steps);
    let Some(first) = &found.first else {
        return format!("{files}: {steps} steps of {law} done again, every command the same to the bit");
    };
    let what = if first.is_about_fault {
        "one of the two reported a fault".to_string()
    } else {
        let (recorded, replayed) = (first.recorded, first.replayed);
        let bits = (recorded.to_bits(), replayed.to_bits());
        format!(
            "joint {:?}: recorded {recorded:e} ({:016x}), replayed {replayed:e} ({:016x})",
            joint(description, first.drive),
            bits.0,
            bits.1
        )
    };
    format!(
        "{files}: {} of {steps} steps of {law} differ, by {} at most\nFirst in {}, step {} at t = {} s: {what}",
        found.differing,
        out::number(found.largest),
        first.file,
        first.step,
        first.t
    )
}

fn as_json(args: &Args, found: &Found, controller: &dyn Running, description: &Description) -> Value {
    let number = |x: f64| if x.is_finite() { json!(x) } else { json!(x.to_string()) };
    let first = found.first.as_ref().map(|first| {
        json!({
            "file": first.file,
            "step": first.step,
            "t": first.t,
            "joint": joint(description, first.drive),
            "recorded": number(first.recorded),
            "replayed": number(first.replayed),
            "recorded_bits": format!("{:016x}", first.recorded.to_bits()),
            "replayed_bits": format!("{:016x}", first.replayed.to_bits()),
            "fault_differs": first.is_about_fault,
        })
    });
    json!({
        "schema": "pkm.replay/1",
        "recordings": args.recordings.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        "robot": description.robot.model.name,
        "law": controller.about().name,
        "steps": found.steps,
        "differing": found.differing,
        "largest_difference": found.largest,
        "first": first,
        "same": found.first.is_none(),
    })
}
