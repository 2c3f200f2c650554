//! `pkm simulate`: a robot moves with physics that its files do not have, and what a recorder would have written goes into a file.

pub(crate) mod controller;
pub(crate) mod hidden;
pub(crate) mod plant;
mod reference;
pub(crate) mod world;

use core::cell::RefCell;
use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use pkm_dyn::effects::Robot;
use pkm_dyn::model::Model;
use pkm_dyn::urdf::Description;
use pkm_hal::{Clock, MonotonicClock};
use pkm_ident::Recording;
use pkm_record::{Attachments, WriteError};
use pkm_sim::{Consistent, Equipment, Instrumented, Scenario, Setup, Trajectory, Watch, check_limits, run_instrumented, run_with};
use serde_json::{Value, json};

use crate::convert::with_robot;
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::{check, out, robot_file};

/// Progress is told so often `[s of the motion]`.
const TOLD_S: f64 = 0.1;

/// Arguments of `pkm simulate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A PD controller with the weight of the robot as feed-forward follows the reference at 1 kHz or the rate of the recording, whichever is \
higher; or the one that --controller names, at its own rate (its first fault ends the run), whose every step is then in an .mcap file for \
`pkm replay`. It knows the robot's files only; what is concealed moves the robot and is not in the file that is written. Joints pass their limits \
unless --end-stops is given. The same arguments give the same bytes.

The reduced plant moves in the coordinates of the drives and is the default; the constrained one in those of the whole tree, for effects \
with states of their own (play, elastic drives and structures, memories, contacts, persons), and is taken by itself where there are any.

Examples:
  pkm simulate prs3 --out A.mcap
  pkm simulate prs3 --out A.csv --seed 7 \\
      --hide 'friction_stribeck@q1:coulomb=12,stiction=21.3,stribeck_velocity=0.01'
  pkm simulate prs3 --out A.csv --hide \\
    'friction_stribeck@q1:form=lugre,coulomb=12,stiction=21.3,stribeck_velocity=0.01,stiffness=1e5'
  pkm simulate prs3 --out A.mcap --controller controller.toml
  pkm simulate prs3 --out A.mcap --world world.toml
  pkm simulate serial_arm --out A.mcap --reference chirp --sweep 0.1:2 --noise none
  pkm simulate motobotte --out A.csv --reference gait --duration 8
  pkm simulate robot.toml --out B.mcap --reference A.csv --paced
  pkm simulate prs3 --out A.mcap --plant constrained --integrator radau --step 2e-4 --end-stops 0.2")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// The recording to write, .mcap or .csv.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Conceal an effect, NAME@PLACE:PARAMETER=VALUE,... in SI units; may be given several times (`pkm effects` lists them). With form=
    /// among the parameters in another form than the catalogue's.
    #[arg(long, value_name = "EFFECT")]
    hide: Vec<String>,
    #[command(flatten)]
    controller: controller::ControllerArgs,
    #[command(flatten)]
    world: world::WorldArgs,
    #[command(flatten)]
    plant: plant::PlantArgs,
    #[command(flatten)]
    motion: reference::MotionArgs,
    /// Length [default: 20 s, or that of the reference file].
    #[arg(long, value_name = "S", help_heading = "Motion")]
    duration: Option<f64>,
    /// Samples per second.
    #[arg(long, value_name = "HZ", default_value_t = 1000.0, help_heading = "Sensors")]
    rate: f64,
    /// Seed of motion and noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// White noise, any of resolution=, encoder= (m or rad) and effort= (share of the effort's rms), or none
    /// [default: resolution=1e-6,encoder=1e-6,effort=0.01].
    #[arg(long, value_name = "NOISE", help_heading = "Sensors")]
    noise: Option<String>,
    /// Run no faster than real time.
    #[arg(long)]
    paced: bool,
    /// Replace a file that exists.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    let model = &description.robot.model;
    let surplus = check::must_be_driven(model, &file)?;
    let concealed = hidden::Concealed::parse("--hide", &args.hide, model)?;
    let equipment = args.world.read(model, args.seed)?;
    let controller = args.controller.read(&description.robot)?;
    reserve(args, &description)?;
    let (trajectory, duration_s) = motion(args, model, surplus)?;
    let scenario = scenario(args, duration_s)?;
    let told = (concealed.describe(model), concealed.as_json(model));
    let truth = Robot::new(description.bare.clone(), description.robot.effects.iter().cloned().chain(concealed.effects).collect());
    let (controller_file, controller) = controller.unzip();
    let is_mcap = args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let steps = RefCell::new(Vec::new());
    // Only a controller whose file is attached can be replayed.
    let watch =
        (is_mcap && controller.is_some()).then(|| -> Watch<'_> { Box::new(|step| steps.borrow_mut().push(controller::noted(step))) });
    let setup = Setup { robots: [&truth, &description.robot], laws: concealed.laws, controller, watch };
    let moved = move_along(args, setup, (&scenario, equipment.as_ref()), trajectory.as_ref()).with_context(|| file.clone())?;
    let Moved { mut recording, lost, seconds } = moved;
    recording.meta.other.insert("simulated_reference".to_string(), args.motion.name());
    if let Some(name) = args.world.path().and_then(Path::file_name) {
        recording.meta.other.insert("simulated_world".to_string(), name.to_string_lossy().into_owned());
    }
    let mut attachments = if is_mcap { with_robot(&description) } else { Attachments::default() };
    if let Some(file) = controller_file {
        file.note(&mut recording, is_mcap.then_some(&mut attachments));
    }
    attachments.controls = steps.take();
    pkm_record::write(&args.out, &recording, &attachments)?;
    if !args.quiet {
        tell(args, model, told, &recording, (lost, scenario.duration_s / seconds))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The motion and its length `[s]`; drives in surplus follow from the others.
fn motion<'m>(args: &Args, model: &'m Model, surplus: usize) -> anyhow::Result<(Box<dyn Trajectory + 'm>, f64)> {
    let (trajectory, duration_s) = args.motion.build(model, args.duration, args.seed)?;
    if surplus == 0 {
        return Ok((trajectory, duration_s));
    }
    let place = || format!("{}: --reference {}", args.robot.display(), args.motion.name());
    let consistent = Consistent::try_new(model, trajectory).with_context(place)?;
    check_limits(model, &consistent, duration_s).with_context(place)?;
    Ok((Box::new(consistent), duration_s))
}

/// Tells at once, before a long run, that the file cannot be written.
fn reserve(args: &Args, description: &Description) -> anyhow::Result<()> {
    let name = args.out.display();
    let is_known = args.out.extension().is_some_and(|e| ["csv", "mcap"].iter().any(|k| e.eq_ignore_ascii_case(k)));
    if !is_known {
        return Err(WriteError::UnknownFormat { file: name.to_string() }.into());
    }
    ensure!(args.force || !args.out.exists() || args.out.is_dir(), "{name}: exists already (--force replaces it)");
    let urdf = args.robot.with_file_name(&description.spec.urdf);
    let inputs: Vec<&Path> = [args.robot.as_path(), &urdf]
        .into_iter()
        .chain(args.motion.file())
        .chain(args.controller.path())
        .chain(args.world.path())
        .collect();
    drop(Outputs::reserve(core::slice::from_ref(&args.out), &inputs)?);
    Ok(())
}

fn scenario(args: &Args, duration_s: f64) -> anyhow::Result<Scenario> {
    let plant = args.world.plant(args.plant.kind(args.seed)?, args.seed);
    let mut scenario = Scenario { seed: args.seed, duration_s, rate_hz: args.rate, plant, ..Scenario::default() };
    let Some(noise) = args.noise.as_deref() else { return Ok(scenario) };
    (scenario.encoder_resolution, scenario.encoder_noise, scenario.effort_noise) = (0.0, 0.0, 0.0);
    if noise == "none" {
        return Ok(scenario);
    }
    for (name, value) in hidden::numbers(noise).with_context(|| format!("--noise {noise:?}"))? {
        let slot = match name.as_str() {
            "resolution" => &mut scenario.encoder_resolution,
            "encoder" => &mut scenario.encoder_noise,
            "effort" => &mut scenario.effort_noise,
            _ => anyhow::bail!("--noise {noise:?}: {name:?} is unknown (has: resolution, encoder, effort)"),
        };
        ensure!(value.is_finite() && value >= 0.0, "--noise {noise:?}: {name} = {value} (must be finite and >= 0)");
        *slot = value;
    }
    Ok(scenario)
}

/// What a run leaves.
struct Moved {
    recording: Recording,
    /// Samples that never arrived, where some may be lost.
    lost: Option<usize>,
    /// How long it took `[s]`.
    seconds: f64,
}

fn move_along(
    args: &Args,
    setup: Setup<'_>,
    (scenario, equipment): (&Scenario, Option<&Equipment>),
    trajectory: &dyn Trajectory,
) -> anyhow::Result<Moved> {
    let mut progress = Progress::new("simulating", args.quiet || args.json);
    let clock = MonotonicClock::start();
    let mut told = 0.0;
    let mut each = |t: f64| {
        if args.paced {
            wait_until(&clock, t);
        }
        if t - told >= TOLD_S {
            told = t;
            progress.update(t / scenario.duration_s);
        }
    };
    let (recording, lost) = match equipment {
        None => (run_with(setup, scenario, trajectory, &mut each)?, None),
        Some(equipment) => {
            let Instrumented { recording, lost } = run_instrumented(setup, scenario, equipment, trajectory, &mut each)?;
            (recording, Some(lost))
        }
    };
    Ok(Moved { recording, lost, seconds: clock.now_ns() as f64 * 1e-9 })
}

/// Sleeps until `clock` reads `t` `[s]`.
fn wait_until(clock: &MonotonicClock, t: f64) {
    let left = t - clock.now_ns() as f64 * 1e-9;
    if left > 0.0 {
        std::thread::sleep(Duration::from_secs_f64(left));
    }
}

/// Tells what was done; `concealed` is told for people and for programs; samples lost, and how much faster than real time it was.
fn tell(
    args: &Args,
    model: &Model,
    concealed: (String, Vec<Value>),
    recording: &Recording,
    (lost, factor): (Option<usize>, f64),
) -> anyhow::Result<()> {
    let (samples, file) = (recording.len(), args.out.display().to_string());
    if args.json {
        let mut told = json!({
            "schema": "pkm.simulation/1",
            "robot": model.name,
            "recording": file,
            "samples": samples,
            "duration_s": recording.duration(),
            "rate_hz": args.rate,
            "seed": args.seed,
            "reference": args.motion.name(),
            "concealed": concealed.1,
            "real_time_factor": factor,
        });
        if let Some(lost) = lost {
            told["samples_lost"] = json!(lost);
        }
        return out::say(&serde_json::to_string_pretty(&told)?);
    }
    let concealed = concealed.0;
    let signals = recording.signals.len();
    let text = format!(
        "{file}: {samples} samples of {signals} signals, {:.3} s of {} at {} times real time\nConcealed: {concealed}",
        recording.duration(),
        model.name,
        out::number(factor)
    );
    let text = text + &lost.map_or(String::new(), |lost| format!("\nSamples that never arrived: {lost}"));
    out::say(&out::clean(&text))
}
