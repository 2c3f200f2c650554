//! Reading a robot: robot.toml, the URDF it names, loops, drives, couplings, sensors, effects.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::spec::{LoopSpec, Spec};
use super::tree::{MAX_BYTES, TreeError, tree};
use crate::effects::{Applied, EffectError, PlaceKind, Robot, find};
use crate::model::{AXES, BuildError, LoopClosure, Model, SensorKind};
use crate::spatial::Pose;

/// A robot as read from its files.
#[derive(Debug, Clone)]
pub struct Description {
    /// The robot, with its effects.
    pub robot: Robot,
    /// The model as the URDF has it, before any `[[effect]]` changed inertias or gravity.
    pub bare: Model,
    /// robot.toml as parsed.
    pub spec: Spec,
    /// robot.toml as text.
    pub toml_text: String,
    /// The URDF as text.
    pub urdf_text: String,
    pub(super) urdf: urdf_rs::Robot,
}

/// Why a robot cannot be read; one line that names file, place, value and limit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read at all.
    #[error("{file}: {detail}")]
    Io {
        /// Path as given.
        file: String,
        /// The operating system's reason.
        detail: String,
    },
    /// The text is no robot.toml or URDF.
    #[error("{file}: {detail}")]
    Syntax {
        /// Path as given.
        file: String,
        /// Line and reason.
        detail: String,
    },
    /// The parts do not make a robot.
    #[error("{file}: {cause}")]
    Build {
        /// Path as given.
        file: String,
        /// What is wrong; part of the line, so it is not handed on as a source as well.
        cause: BuildError,
    },
    /// An effect cannot be applied.
    #[error("{file}: {cause}")]
    Effect {
        /// Path as given.
        file: String,
        /// What is wrong; part of the line, so it is not handed on as a source as well.
        cause: EffectError,
    },
}

/// Reads the robot.toml at `path` and the URDF it names, which is looked for beside it.
///
/// # Errors
/// Files that cannot be read, and everything [`parse`] refuses.
pub fn load(path: &Path) -> Result<Description, LoadError> {
    let toml_text = read_text(path)?;
    let spec = parse_spec(&toml_text, &path.display().to_string())?;
    let urdf_path = beside(path, &spec.urdf);
    let urdf_text = read_text(&urdf_path).map_err(|e| match e {
        LoadError::Io { file, detail } => LoadError::Io { file, detail: format!("{detail} ({} names it)", path.display()) },
        other => other,
    })?;
    describe(spec, toml_text, urdf_text, [&path.display().to_string(), &urdf_path.display().to_string()])
}

/// A robot from the texts of its two files; `names` are what errors call them (robot.toml, then URDF).
///
/// # Errors
/// Bad syntax, unknown keys or names, numbers that are not finite or out of range.
pub fn parse(toml_text: &str, urdf_text: &str, names: [&str; 2]) -> Result<Description, LoadError> {
    let spec = parse_spec(toml_text, names[0])?;
    describe(spec, toml_text.to_string(), urdf_text.to_string(), names)
}

fn beside(path: &Path, name: &str) -> PathBuf {
    path.parent().unwrap_or_else(|| Path::new("")).join(name)
}

fn read_text(path: &Path) -> Result<String, LoadError> {
    let io = |detail: String| LoadError::Io { file: path.display().to_string(), detail };
    let mut bytes = Vec::new();
    // No more than the limit is read, whatever size is claimed: devices claim none and never end.
    let file = std::fs::File::open(path).map_err(|e| io(e.to_string()))?;
    file.take(MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|e| io(e.to_string()))?;
    if bytes.len() > MAX_BYTES {
        return Err(io(format!("more than {MAX_BYTES} bytes (the limit)")));
    }
    if bytes.is_empty() {
        return Err(io("the file is empty".to_string()));
    }
    String::from_utf8(bytes).map_err(|e| io(format!("byte {} is not UTF-8", e.utf8_error().valid_up_to())))
}

fn parse_spec(text: &str, file: &str) -> Result<Spec, LoadError> {
    toml::from_str(text).map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |s| 1 + text[..s.start.min(text.len())].matches('\n').count());
        let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
        LoadError::Syntax { file: file.to_string(), detail: format!("line {line}: {message}") }
    })
}

fn describe(spec: Spec, toml_text: String, urdf_text: String, names: [&str; 2]) -> Result<Description, LoadError> {
    let [toml_name, urdf_name] = names.map(str::to_string);
    let in_toml = |cause| LoadError::Build { file: toml_name.clone(), cause };
    if let Some(value) = spec.gravity.iter().find(|g| !g.is_finite()) {
        let at = "gravity".to_string();
        return Err(in_toml(BuildError::OutOfRange { at, what: "component", value: *value, unit: "m/s²", limit: "must be finite" }));
    }
    let (urdf, mut bare) = tree(&urdf_text, &spec.name, spec.gravity).map_err(|e| match e {
        TreeError::Text(detail) => LoadError::Syntax { file: urdf_name.clone(), detail },
        TreeError::Build(cause) => LoadError::Build { file: urdf_name.clone(), cause },
    })?;
    close(&mut bare, &spec).map_err(in_toml)?;
    if bare.actuators.is_empty() {
        let detail = "no [[actuator]]: at least one joint must be driven".to_string();
        return Err(LoadError::Syntax { file: toml_name, detail });
    }
    let mut effects = Vec::new();
    for e in &spec.effects {
        let parameters: Vec<(String, f64)> = e.parameters.iter().map(|(k, v)| (k.clone(), *v)).collect();
        // Several places mean one effect at each, unless two places are one.
        let is_pair = find(&e.name).is_some_and(|entry| entry.place == PlaceKind::JointPair);
        let names: Vec<String> = e.places.names().into_iter().map(String::from).collect();
        let places = if is_pair { vec![names.join(",")] } else { names };
        for place in places {
            let applied = Applied::try_new(&bare, &e.name, &place, &parameters);
            effects.push(applied.map_err(|cause| LoadError::Effect { file: toml_name.clone(), cause })?);
        }
    }
    let robot = Robot::new(bare.clone(), effects);
    Ok(Description { robot, bare, spec, toml_text, urdf_text, urdf })
}

fn close(model: &mut Model, spec: &Spec) -> Result<(), BuildError> {
    for l in &spec.loops {
        let closure = loop_closure(model, l)?;
        model.add_loop(closure)?;
    }
    for c in &spec.couplings {
        let of: Vec<(String, f64)> = c.of.iter().map(|(name, ratio)| (name.clone(), *ratio)).collect();
        model.add_coupling(&c.joint, &of, c.offset)?;
    }
    for a in &spec.actuators {
        model.add_actuator(&a.joint, a.rotor_inertia)?;
    }
    for s in &spec.sensors {
        let kind = match s.kind.as_str() {
            "wrench" => SensorKind::Wrench,
            "pose" => SensorKind::Pose,
            _ => return Err(BuildError::Unknown { at: format!("sensor {:?}", s.name), kind: "sensor kind", name: s.kind.clone() }),
        };
        model.add_sensor(&s.name, kind, &s.link, Pose::from_xyz_rpy(s.xyz, s.rpy))?;
    }
    for (joint, value) in &spec.assembly {
        model.set_assembly(joint, *value)?;
    }
    Ok(())
}

fn loop_closure(model: &Model, l: &LoopSpec) -> Result<LoopClosure, BuildError> {
    let at = format!("loop {:?}", l.name);
    for frame in [&l.a, &l.b] {
        if let Some(value) = frame.xyz.iter().chain(&frame.rpy).find(|x| !x.is_finite()) {
            return Err(BuildError::OutOfRange { at, what: "xyz or rpy", value: *value, unit: "m or rad", limit: "must be finite" });
        }
    }
    let mut constrain = [false; 6];
    for name in &l.constrain {
        let unknown = || BuildError::Unknown { at: at.clone(), kind: "axis (x y z rx ry rz)", name: name.clone() };
        let k = AXES.iter().position(|axis| axis == name).ok_or_else(unknown)?;
        constrain[k] = true;
    }
    if !constrain.contains(&true) {
        return Err(BuildError::Unknown { at, kind: "constrained axis", name: "constrain = []".to_string() });
    }
    let a = model.frame_on(&at, &l.a.link, Pose::from_xyz_rpy(l.a.xyz, l.a.rpy))?;
    let b = model.frame_on(&at, &l.b.link, Pose::from_xyz_rpy(l.b.xyz, l.b.rpy))?;
    Ok(LoopClosure { name: l.name.clone(), a, b, constrain })
}
