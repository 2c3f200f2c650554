//! Controllers from files: a controller.toml and a robot give something that runs.
//!
//! Every key is known or refused; every error is one line that names file, line, key, value and what is allowed. Numbers of drives may be
//! one for all or a list; gains may come from one `bandwidth` and the inertia at the assembly, as the [catalogue](crate::catalogue)'s do.
//! Limits that the file leaves out are the robot's own.

mod bounds;
mod contact;
mod erased;
mod exercises;
mod observers;
mod section;
mod tasks;
mod tracking;

use alloc::boxed::Box;
use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use std::io::Read;
use std::path::Path;

use pkm_dyn::effects::{Law, Robot};

use crate::catalogue::Drives;
use crate::limits::Limited;
use crate::running::{About, Running, Runs};
use erased::AnyLaw;
use section::Section;

pub use tracking::LAWS as TRACKING;

/// Laws of contact, by name; they move a position loop, or set efforts themselves.
pub const CONTACT: [&str; 6] = ["explicit_force", "impedance", "admittance", "hybrid", "exercise", "actuator_force"];

/// Largest file `[bytes]`.
const MAX_BYTES: u64 = 1 << 20;

/// Slowest and fastest controller `[Hz]`.
const RATES_HZ: [f64; 2] = [1.0, 1e5];

/// Why a file is no controller for a robot; one line that names file, line, key, value and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {problem}")]
pub struct FileError {
    /// The file, as given.
    pub file: String,
    /// Line, key, value, limit.
    pub problem: String,
}

/// What a builder has at hand.
struct Site<'a> {
    robot: &'a Robot,
    rate_hz: f64,
}

impl Site<'_> {
    fn dt(&self) -> f64 {
        1.0 / self.rate_hz
    }
}

/// Reads the controller.toml at `path` and builds what it says for `robot`.
///
/// # Errors
/// A file that cannot be read, or is larger than a megabyte, and everything [`parse`] refuses.
pub fn load(path: &Path, robot: &Robot) -> Result<Box<dyn Running>, FileError> {
    let (file, text) = read(path)?;
    parse(&text, &file, robot)
}

/// Name and text of a controller.toml.
///
/// # Errors
/// A file that cannot be read, is larger than a megabyte, or no UTF-8.
pub fn read(path: &Path) -> Result<(String, String), FileError> {
    let file = path.display().to_string();
    let bad = |problem: String| FileError { file: file.clone(), problem };
    let mut bytes = Vec::new();
    let opened = std::fs::File::open(path).map_err(|e| bad(e.to_string()))?;
    // No more than the limit is read, whatever size is claimed: devices claim none and never end.
    opened.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|e| bad(e.to_string()))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(bad(format!("more than {MAX_BYTES} bytes (the limit)")));
    }
    let text = String::from_utf8(bytes).map_err(|e| bad(format!("byte {} is not UTF-8", e.utf8_error().valid_up_to())))?;
    Ok((file, text))
}

/// The controller that `text` states for `robot`; errors call it `file`.
///
/// # Errors
/// Bad syntax, unknown laws or keys, numbers out of range, a robot with no drive or more than eight, or one that the law cannot be for.
pub fn parse(text: &str, file: &str, robot: &Robot) -> Result<Box<dyn Running>, FileError> {
    section::with_root(text, file, |root| match robot.model.n_act() {
        1 => build::<1>(root, robot),
        2 => build::<2>(root, robot),
        3 => build::<3>(root, robot),
        4 => build::<4>(root, robot),
        5 => build::<5>(root, robot),
        6 => build::<6>(root, robot),
        7 => build::<7>(root, robot),
        8 => build::<8>(root, robot),
        n => Err(root.whole(&format!("robot {:?} has {n} drives (must be 1 to 8)", robot.model.name))),
    })
}

fn build<const N: usize>(root: &Section<'_>, robot: &Robot) -> Result<Box<dyn Running>, FileError>
where
    (): contact::Dispatch<N>,
{
    let rate_hz = root.number("rate_hz", (|x| (RATES_HZ[0]..=RATES_HZ[1]).contains(&x), "must be 1 to 1e5 Hz"))?;
    let robot = without_friction(root, robot)?;
    let site = Site { robot: &robot, rate_hz };
    let name = root.text("law")?;
    let bounds = bounds::Bounds::<N>::read(root, &site)?;
    let about = |drives, effort_per_rate| About { name: name.clone(), rate_hz, drives, effort_per_rate, n_drives: N };
    if name == "computed_torque_dae" {
        let (law, b0) = tracking::voltage::<N>(root, &site, &bounds)?;
        root.finish()?;
        return Ok(Box::new(Runs::new(law, about(Drives::Voltage, b0.to_vec()))));
    }
    let law: AnyLaw<N> = if CONTACT.contains(&name.as_str()) {
        <() as contact::Dispatch<N>>::law(&name, root, &site, &bounds)?
    } else {
        tracking::law(&name, root, &site, &bounds)?
    };
    root.finish()?;
    let limited = Limited::try_new(law, bounds.config).map_err(|e| root.refusal(&e))?;
    Ok(Box::new(Runs::new(limited, about(Drives::Effort, Vec::new()))))
}

/// The robot that the controller knows: without its friction where the file says so.
fn without_friction(root: &Section<'_>, robot: &Robot) -> Result<Robot, FileError> {
    let mut robot = robot.clone();
    let Some(friction) = root.section("friction")? else { return Ok(robot) };
    if friction.choice("compensate", &["all", "none"])?.as_deref() == Some("none") {
        for joint in &mut robot.model.joints {
            (joint.viscous, joint.coulomb) = (0.0, 0.0);
        }
        robot.effects.retain(|e| !(matches!(e.entry.law, Law::JointEffort(_)) && e.entry.name.starts_with("friction_")));
    }
    Ok(robot)
}
