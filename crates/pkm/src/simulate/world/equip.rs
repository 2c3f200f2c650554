//! From the tables of a world.toml to what the simulator takes; every number is checked where it is named.

use anyhow::{Context, bail, ensure};
use pkm_dyn::model::{Model, SensorKind};
use pkm_sim::actuators::{OutputStage, ThreeMass, ThreeMassParameters};
use pkm_sim::limb::{EndStops, Impedance, Patient, PatientConfig, Will};
use pkm_sim::sensors::{ForceCellConfig, SamplingConfig, VelocitySensing};
use pkm_sim::{DriveEquipment, Equipment, LimbEquipment, LimbPlace};

use super::layout::{self, VelocityKind};

/// Most steps of the plant per base period.
const SUBSTEPS_MAX: u32 = 100;

/// Coordinates of a limb at a link.
const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// All of the equipment; `seed` is taken where the file states none.
pub(super) fn equipment(file: &layout::World, model: &Model, seed: u64) -> anyhow::Result<Equipment> {
    let seed = file.seed.unwrap_or(seed);
    let substeps = file.substeps.unwrap_or(2);
    ensure!((1..=SUBSTEPS_MAX).contains(&substeps), "substeps = {substeps} (must be 1 to {SUBSTEPS_MAX})");
    let driven = || model.actuators.iter().map(|&j| model.joints[j].name.as_str());
    if let Some(name) = file.joint.keys().find(|name| !driven().any(|n| n == name.as_str())) {
        bail!("joint.{name}: no drive of that name (there are: {})", driven().collect::<Vec<_>>().join(", "));
    }
    let drives = driven().map(|name| drive(file, name)).collect::<anyhow::Result<_>>()?;
    Ok(Equipment {
        seed,
        substeps,
        drives,
        sampling: sampling(file.sampling.unwrap_or_default())?,
        wrenches: wrenches(file, model)?,
        limb: file.limb.as_ref().map(|l| limb(l, model, seed)).transpose()?,
    })
}

/// What is allowed, in code and in words.
type Allowed = (fn(f64) -> bool, &'static str);

const FINITE: Allowed = (f64::is_finite, "must be finite");
const NOT_NEGATIVE: Allowed = (|x| x.is_finite() && x >= 0.0, "must be finite and >= 0");
const POSITIVE: Allowed = (|x| x.is_finite() && x > 0.0, "must be finite and > 0");
const UP_TO_INFINITY: Allowed = (|x| x > 0.0, "must be > 0, or inf for none");
const SECONDS: Allowed = (|x| (0.0..=1.0).contains(&x), "must be 0 to 1 s");
const PROBABILITY: Allowed = (|x| (0.0..1.0).contains(&x), "must be at least 0 and below 1");

/// A number that is allowed.
fn number(path: &str, key: &str, value: f64, (is_good, limit): Allowed) -> anyhow::Result<f64> {
    ensure!(is_good(value), "{path}.{key} = {value} ({limit})");
    Ok(value)
}

/// What a joint states, in place of what all drives have, and where it stands.
fn stated<T>(file: &layout::World, joint: &str, key: impl Fn(&layout::Drive) -> Option<T>) -> Option<(T, String)> {
    match file.joint.get(joint).and_then(&key) {
        Some(own) => Some((own, format!("joint.{joint}"))),
        None => key(&file.drive).map(|all| (all, "drive".to_string())),
    }
}

fn drive(file: &layout::World, joint: &str) -> anyhow::Result<DriveEquipment> {
    let mut out = DriveEquipment::default();
    if let Some((encoder, path)) = stated(file, joint, |d| d.encoder) {
        let path = format!("{path}.encoder");
        out.resolution = resolution(&encoder, &path)?;
        out.noise = number(&path, "noise", encoder.noise, NOT_NEGATIVE)?;
        (out.offset, out.drift) = (number(&path, "offset", encoder.offset, FINITE)?, number(&path, "drift", encoder.drift, FINITE)?);
    }
    if let Some((second, path)) = stated(file, joint, |d| d.second_encoder) {
        let path = format!("{path}.second_encoder");
        let drift = [-number(&path, "offset", second.offset, FINITE)?, number(&path, "drift", second.drift, FINITE)?, 0.0];
        let noise = number(&path, "noise", second.noise, NOT_NEGATIVE)?;
        out.second = Some(ForceCellConfig { step: resolution(&second, &path)?, noise, drift, ..ForceCellConfig::default() });
    }
    if let Some((velocity, path)) = stated(file, joint, |d| d.velocity) {
        out.velocity = self::velocity(velocity, &path, out.resolution)?;
    }
    if let Some((effort, path)) = stated(file, joint, |d| d.effort) {
        out.effort = cell(&effort, &format!("{path}.effort"))?;
    }
    if let Some((output, path)) = stated(file, joint, |d| d.output) {
        out.output = self::output(&output, &format!("{path}.output"))?;
    }
    let seconds = |stated: Option<(f64, String)>, key: &str| match stated {
        Some((s, path)) => number(&path, key, s, SECONDS),
        None => Ok(0.0),
    };
    out.delay = seconds(stated(file, joint, |d| d.delay_s), "delay_s")?;
    out.lag = seconds(stated(file, joint, |d| d.current_lag_s), "current_lag_s")?;
    if let Some((three, path)) = stated(file, joint, |d| d.three_mass) {
        out.transmission = Some(three_mass(&three).with_context(|| format!("{path}.three_mass"))?);
    }
    Ok(out)
}

fn resolution(encoder: &layout::Encoder, path: &str) -> anyhow::Result<f64> {
    let Some(counts) = encoder.counts_per_unit else { return Ok(0.0) };
    number(path, "counts_per_unit", counts, POSITIVE)?;
    Ok(1.0 / counts)
}

fn velocity(velocity: layout::Velocity, path: &str, resolution: f64) -> anyhow::Result<VelocitySensing> {
    let counted = |sensing| {
        ensure!(resolution > 0.0, "{path}.velocity: counts pulses of an encoder without counts (state encoder.counts_per_unit)");
        Ok(sensing)
    };
    let layout::Velocity { kind, timer_s } = velocity;
    let timer = number(&format!("{path}.velocity"), "timer_s", timer_s.unwrap_or(0.0), NOT_NEGATIVE)?;
    let is_used = kind == VelocityKind::PulseTiming || timer_s.is_none();
    ensure!(is_used, "{path}.velocity.timer_s = {timer} (only of kind \"pulse_timing\")");
    match kind {
        VelocityKind::Exact => Ok(VelocitySensing::Exact),
        VelocityKind::None => Ok(VelocitySensing::None),
        VelocityKind::PulseCounting => counted(VelocitySensing::PulseCounting),
        VelocityKind::PulseTiming => counted(VelocitySensing::PulseTiming { timer }),
    }
}

fn cell(cell: &layout::Cell, path: &str) -> anyhow::Result<ForceCellConfig> {
    let layout::Cell { gain, lag_s, bias, rate, walk, noise, ceiling, step } = *cell;
    for (key, value) in [("lag_s", lag_s), ("walk", walk), ("noise", noise), ("step", step)] {
        number(path, key, value, NOT_NEGATIVE)?;
    }
    for (key, value) in [("gain", gain), ("bias", bias), ("rate", rate)] {
        number(path, key, value, FINITE)?;
    }
    number(path, "ceiling", ceiling, UP_TO_INFINITY)?;
    Ok(ForceCellConfig { gain, lag: lag_s, drift: [bias, rate, walk], noise, ceiling, step })
}

fn output(output: &layout::Output, path: &str) -> anyhow::Result<OutputStage> {
    let layout::Output { ceiling, step, bits, pulse_counts, dead_zone } = *output;
    let n_stated = [step.is_some(), bits.is_some(), pulse_counts.is_some()].iter().filter(|x| **x).count();
    ensure!(n_stated <= 1, "{path}: step, bits and pulse_counts are three ways to say one thing (give one of them)");
    let needed =
        || ceiling.filter(|c| c.is_finite()).with_context(|| format!("{path}.ceiling is missing (bits and pulse_counts divide it)"));
    number(path, "dead_zone", dead_zone, NOT_NEGATIVE)?;
    if let Some(ceiling) = ceiling {
        number(path, "ceiling", ceiling, UP_TO_INFINITY)?;
    }
    match (bits, pulse_counts) {
        (Some(bits), _) => {
            ensure!((2..=24).contains(&bits), "{path}.bits = {bits} (must be 2 to 24)");
            Ok(OutputStage::of_bits(needed()?, bits, dead_zone)?)
        }
        (_, Some(counts)) => {
            ensure!(counts > 0, "{path}.pulse_counts = {counts} (must be at least 1)");
            Ok(OutputStage::of_pulse_width(needed()?, counts, dead_zone)?)
        }
        _ => {
            let step = number(path, "step", step.unwrap_or(0.0), NOT_NEGATIVE)?;
            Ok(OutputStage::try_new(ceiling.unwrap_or(f64::INFINITY), step, dead_zone)?)
        }
    }
}

fn three_mass(file: &layout::ThreeMass) -> anyhow::Result<ThreeMassParameters> {
    let parameters = ThreeMassParameters {
        motor_inertia: file.motor_inertia,
        motor_viscous: file.motor_viscous,
        motor_pulley: file.motor_pulley,
        screw_inertia: file.screw_inertia,
        screw_viscous: file.screw_viscous,
        screw_pulley: file.screw_pulley,
        screw_ratio: file.screw_ratio,
        belt_stiffness: file.belt_stiffness,
        belt_damping: file.belt_damping,
        rod_mass: file.rod_mass,
        rod_viscous: file.rod_viscous,
        rod_coulomb: file.rod_coulomb,
        cell_stiffness: file.cell_stiffness,
        cell_damping: file.cell_damping,
        current_lag: file.current_lag_s,
    };
    ThreeMass::try_new(parameters, 0.0)?;
    Ok(parameters)
}

fn sampling(file: layout::Sampling) -> anyhow::Result<SamplingConfig> {
    let layout::Sampling { jitter_s, loss_begins, loss_goes_on } = file;
    number("sampling", "jitter_s", jitter_s, NOT_NEGATIVE)?;
    for (key, value) in [("loss_begins", loss_begins), ("loss_goes_on", loss_goes_on)] {
        number("sampling", key, value, PROBABILITY)?;
    }
    Ok(SamplingConfig { jitter: jitter_s, loss_begins, loss_goes_on })
}

/// Every wrench sensor of the robot; those that the file does not name are ideal.
fn wrenches(file: &layout::World, model: &Model) -> anyhow::Result<Vec<(usize, [ForceCellConfig; 6])>> {
    let sensors = || model.sensors.iter().enumerate().filter(|(_, s)| s.kind == SensorKind::Wrench);
    if let Some(name) = file.wrench.keys().find(|name| !sensors().any(|(_, s)| s.name == **name)) {
        let known: Vec<&str> = sensors().map(|(_, s)| s.name.as_str()).collect();
        bail!("wrench.{name}: no wrench sensor of that name (there are: {})", known.join(", "));
    }
    let of = |(i, sensor): (usize, &pkm_dyn::model::Sensor)| {
        let stated = file.wrench.get(&sensor.name).copied().unwrap_or_default();
        let force = cell(&stated.force, &format!("wrench.{}.force", sensor.name))?;
        let moment = cell(&stated.moment, &format!("wrench.{}.moment", sensor.name))?;
        Ok((i, [force, force, force, moment, moment, moment]))
    };
    sensors().map(of).collect()
}

fn limb(file: &layout::Limb, model: &Model, seed: u64) -> anyhow::Result<LimbEquipment> {
    let joints: Vec<&str> = model.actuators.iter().map(|&j| model.joints[j].name.as_str()).collect();
    let names: Vec<&str> = if file.link.is_some() { AXES.to_vec() } else { joints };
    let mut impedances = vec![Impedance::FREE; names.len()];
    let (mut strength, mut tremor) = ([0.0; 6], [0.0; 6]);
    for (name, axis) in &file.axis {
        let path = format!("limb.axis.{name}");
        let Some(i) = names.iter().position(|n| n == name) else { bail!("{path}: no such axis (there are: {})", names.join(", ")) };
        impedances[i] = impedance(axis).with_context(|| path.clone())?;
        let own = [number(&path, "strength", axis.strength, NOT_NEGATIVE)?, number(&path, "tremor", axis.tremor, NOT_NEGATIVE)?];
        match strength.get_mut(i).zip(tremor.get_mut(i)) {
            Some((strength, tremor)) => [*strength, *tremor] = own,
            None => {
                ensure!(
                    own.iter().all(|x| *x <= 0.0),
                    "{path}: a person acts on the first six drives only (strength and tremor must be 0)"
                );
            }
        }
    }
    let place = match &file.link {
        None => LimbPlace::Drives(impedances),
        Some(name) => {
            let link = model.links.iter().position(|l| l.name == *name).with_context(|| format!("limb.link = {name:?} (no such link)"))?;
            ensure!(model.links[link].body.is_some(), "limb.link = {name:?} (must be a link that moves)");
            LimbPlace::Link(link, Box::new(core::array::from_fn(|i| impedances[i])))
        }
    };
    let layout::Person { will, seed: own, speed, variation, variation_time_s, tremor_hz, tremor_width_hz } = file.person;
    let will = match will {
        layout::Will::Passive => Will::Passive,
        layout::Will::Resists => Will::Resists,
        layout::Will::Assists => Will::Assists,
    };
    let (variation_time, tremor_frequency, tremor_width) = (variation_time_s, tremor_hz, tremor_width_hz);
    let patient = PatientConfig { will, strength, speed, variation, variation_time, tremor, tremor_frequency, tremor_width };
    Patient::try_new(patient, 0).context("limb.person")?;
    Ok(LimbEquipment { place, patient, seed: own.unwrap_or(seed) })
}

fn impedance(axis: &layout::Axis) -> anyhow::Result<Impedance> {
    let layout::Axis { stiffness, damping, rest, lower, upper, stop_stiffness, stop_exponent, stop_damping, .. } = *axis;
    let stops = EndStops { lower, upper, stiffness: stop_stiffness, exponent: stop_exponent, damping: stop_damping };
    let impedance = Impedance { stiffness, damping, rest, stops };
    impedance.check()?;
    Ok(impedance)
}
