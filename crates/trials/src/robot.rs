//! A robot read from its files, with a reader of its own: bodies with ten numbers each, joints of a tree, loops that close it, drives.

use alloc::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Deserialize;
use urdf_rs::JointType;

/// What makes a robot unusable for trials.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// The URDF or the robot.toml cannot be read.
    #[error("{file}: {reason}")]
    Text {
        /// Name of the file.
        file: String,
        /// What the reader says.
        reason: String,
    },
    /// Something the trials' own mechanics does not know.
    #[error("{0}")]
    Unknown(String),
}

/// What a joint lets its child do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Turn about the axis.
    Turn,
    /// Slide along the axis.
    Slide,
}

/// Mass, first moments and moments of inertia about the origin of the body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass `[kg]`.
    pub mass: f64,
    /// Mass times centre of mass `[kg·m]`.
    pub moment: Vector3<f64>,
    /// Inertia about the origin `[kg·m²]`.
    pub tensor: Matrix3<f64>,
}

impl Inertia {
    /// Nothing.
    pub const ZERO: Self =
        Self { mass: 0.0, moment: Vector3::new(0.0, 0.0, 0.0), tensor: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) };

    /// From mass `[kg]`, centre `[m]` and inertia about it `[kg·m²]`.
    #[must_use]
    pub fn about_centre(mass: f64, centre: Vector3<f64>, central: Matrix3<f64>) -> Self {
        Self { mass, moment: centre * mass, tensor: central + steiner(&centre) * mass }
    }

    /// Centre of mass `[m]`; the origin when there is no mass.
    #[must_use]
    pub fn centre(&self) -> Vector3<f64> {
        if self.mass > 0.0 { self.moment / self.mass } else { Vector3::zeros() }
    }

    /// Inertia about the centre of mass `[kg·m²]`.
    #[must_use]
    pub fn central(&self) -> Matrix3<f64> {
        self.tensor - steiner(&self.centre()) * self.mass
    }

    /// The sum of two, in one frame.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self { mass: self.mass + other.mass, moment: self.moment + other.moment, tensor: self.tensor + other.tensor }
    }

    /// Everything times a number.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self { mass: self.mass * factor, moment: self.moment * factor, tensor: self.tensor * factor }
    }

    /// The ten numbers m, mx, my, mz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
    #[must_use]
    pub fn numbers(&self) -> [f64; 10] {
        let (h, t) = (&self.moment, &self.tensor);
        [self.mass, h.x, h.y, h.z, t[(0, 0)], t[(1, 1)], t[(2, 2)], t[(0, 1)], t[(0, 2)], t[(1, 2)]]
    }

    /// From the ten numbers of [`Inertia::numbers`].
    #[must_use]
    pub fn from_numbers(x: &[f64; 10]) -> Self {
        let tensor = Matrix3::new(x[4], x[7], x[8], x[7], x[5], x[9], x[8], x[9], x[6]);
        Self { mass: x[0], moment: Vector3::new(x[1], x[2], x[3]), tensor }
    }

    /// Smallest eigenvalue of the second moments about the centre over the largest, with mass > 0: positive for a body that can exist.
    #[must_use]
    pub fn solidity(&self) -> f64 {
        let central = self.central();
        // Second moments: tr(I)/2·1 − I. Positive definite together with a positive mass means: some distribution of mass has it.
        let second = Matrix3::identity() * (central.trace() / 2.0) - central;
        let values = second.symmetric_eigenvalues();
        if self.mass > 0.0 && values.max() > 0.0 { values.min() / values.max() } else { -1.0 }
    }
}

fn steiner(c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * c.norm_squared() - c * c.transpose()
}

/// A joint with the body it carries.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// Link it carries.
    pub link: String,
    /// Index of the joint that carries it; none for the root link.
    pub parent: Option<usize>,
    /// What it lets the link do.
    pub motion: Motion,
    /// Unit axis in the joint's frame.
    pub axis: Vector3<f64>,
    /// Orientation of the joint's frame in the parent's.
    pub turn: Matrix3<f64>,
    /// Origin of the joint's frame in the parent's `[m]`.
    pub origin: Vector3<f64>,
    /// Lower and upper limit `[m | rad]`.
    pub limits: [f64; 2],
    /// Highest speed `[m/s | rad/s]`.
    pub speed: f64,
    /// Viscous friction `[N·s/m | N·m·s/rad]`.
    pub viscous: f64,
    /// Coulomb friction `[N | N·m]`.
    pub coulomb: f64,
    /// What the link weighs.
    pub inertia: Inertia,
}

/// A joint that closes a loop: some components of the vector from `a` to `b`, seen in `a`, stay zero.
#[derive(Debug, Clone)]
pub struct Loop {
    /// Name.
    pub name: String,
    /// Joint whose link carries frame a, place and orientation in it; none for the root link.
    pub a: (Option<usize>, Vector3<f64>, Matrix3<f64>),
    /// Joint whose link carries frame b and place in it.
    pub b: (Option<usize>, Vector3<f64>),
    /// Which of x, y, z are held.
    pub held: Vec<usize>,
}

/// A drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Joint it drives.
    pub joint: usize,
    /// Rotor inertia seen at the joint `[kg | kg·m²]`.
    pub rotor: f64,
}

/// A robot.
#[derive(Debug, Clone)]
pub struct Robot {
    /// Name.
    pub name: String,
    /// Name of the root link.
    pub root: String,
    /// Gravity in the root link's frame `[m/s²]`.
    pub gravity: Vector3<f64>,
    /// Joints, parents before children.
    pub joints: Vec<Joint>,
    /// Loops.
    pub loops: Vec<Loop>,
    /// Drives, in the order of the efforts.
    pub drives: Vec<Drive>,
    /// Rough coordinates of the intended assembly `[m | rad]`.
    pub assembly: Vec<f64>,
}

#[derive(Deserialize)]
struct RobotToml {
    name: String,
    #[serde(default = "earth")]
    gravity: [f64; 3],
    #[serde(default, rename = "loop")]
    loops: Vec<LoopToml>,
    #[serde(default)]
    actuator: Vec<ActuatorToml>,
    #[serde(default)]
    assembly: BTreeMap<String, f64>,
    coupling: Option<toml::Value>,
    effect: Option<toml::Value>,
}

fn earth() -> [f64; 3] {
    [0.0, 0.0, -9.81]
}

#[derive(Deserialize)]
struct LoopToml {
    name: String,
    a: FrameToml,
    b: FrameToml,
    constrain: Vec<String>,
}

#[derive(Deserialize)]
struct FrameToml {
    link: String,
    #[serde(default)]
    xyz: [f64; 3],
    #[serde(default)]
    rpy: [f64; 3],
}

#[derive(Deserialize)]
struct ActuatorToml {
    joint: String,
    #[serde(default)]
    rotor_inertia: f64,
}

fn rotation(rpy: [f64; 3]) -> Matrix3<f64> {
    Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]).into_inner()
}

fn unknown<T>(what: String) -> Result<T, RobotError> {
    Err(RobotError::Unknown(what))
}

impl Robot {
    /// Reads a robot from the texts of its two files.
    ///
    /// # Errors
    /// Text that cannot be read, and what these mechanics do not know: couplings, rotations held by a loop, joints other than
    /// revolute, continuous and prismatic.
    pub fn read(toml_text: &str, urdf_text: &str) -> Result<Self, RobotError> {
        let text = |file: &str, e: &dyn core::fmt::Display| RobotError::Text { file: file.to_string(), reason: e.to_string() };
        let spec: RobotToml = toml::from_str(toml_text).map_err(|e| text("robot.toml", &e.message()))?;
        let urdf = urdf_rs::read_from_string(urdf_text).map_err(|e| text("URDF", &e))?;
        if spec.coupling.is_some() || spec.effect.is_some() {
            return unknown(format!("{}: couplings and effects are not for trials", spec.name));
        }
        let (root, joints) = tree(&urdf)?;
        let index = |link: &str| {
            if link == root {
                return Ok(None);
            }
            joints.iter().position(|j| j.link == link).map(Some).ok_or_else(|| RobotError::Unknown(format!("no link {link}")))
        };
        let mut loops = Vec::new();
        for l in &spec.loops {
            let held: Option<Vec<usize>> = l.constrain.iter().map(|c| ["x", "y", "z"].iter().position(|x| x == c)).collect();
            let Some(held) = held else { return unknown(format!("loop {}: only x, y and z can be held", l.name)) };
            let a = (index(&l.a.link)?, Vector3::from(l.a.xyz), rotation(l.a.rpy));
            loops.push(Loop { name: l.name.clone(), a, b: (index(&l.b.link)?, Vector3::from(l.b.xyz)), held });
        }
        let joint = |name: &str| joints.iter().position(|j| j.name == name).ok_or_else(|| RobotError::Unknown(format!("no joint {name}")));
        let mut drives = Vec::new();
        for a in &spec.actuator {
            drives.push(Drive { joint: joint(&a.joint)?, rotor: a.rotor_inertia });
        }
        let mut assembly = vec![0.0; joints.len()];
        for (name, value) in &spec.assembly {
            assembly[joint(name)?] = *value;
        }
        Ok(Self { name: spec.name, root, gravity: Vector3::from(spec.gravity), joints, loops, drives, assembly })
    }

    /// A shipped robot.
    ///
    /// # Errors
    /// A name that is not shipped, or a robot that these mechanics do not know.
    pub fn shipped(name: &str) -> Result<Self, RobotError> {
        let Some(files) = pkm_robots::find(name) else { return unknown(format!("no shipped robot {name}")) };
        Self::read(files.toml, files.urdf)
    }

    /// Name of the joint of drive `k`.
    #[must_use]
    pub fn drive_name(&self, k: usize) -> &str {
        &self.joints[self.drives[k].joint].name
    }

    /// Joint of that name.
    #[must_use]
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }

    /// Joint that carries the end effector: the link of the first loop's frame a, or the last link of a serial robot.
    #[must_use]
    pub fn end(&self) -> usize {
        let platform = self.joints.iter().position(|j| j.link == "platform");
        platform.unwrap_or(self.joints.len() - 1)
    }
}

/// Root link and joints, parents before children, in the order of the file.
fn tree(urdf: &urdf_rs::Robot) -> Result<(String, Vec<Joint>), RobotError> {
    let is_child = |link: &str| urdf.joints.iter().any(|j| j.child.link == link);
    let Some(root) = urdf.links.iter().find(|l| !is_child(&l.name)) else { return unknown("URDF: no root link".to_string()) };
    let mut out: Vec<Joint> = Vec::new();
    let mut left: Vec<&urdf_rs::Joint> = urdf.joints.iter().collect();
    while !left.is_empty() {
        let ready = left.iter().position(|j| j.parent.link == root.name || out.iter().any(|o| o.link == j.parent.link));
        let Some(ready) = ready else { return unknown("URDF: joints that hang on nothing".to_string()) };
        let j = left.remove(ready);
        out.push(read_joint(urdf, j, out.iter().position(|o| o.link == j.parent.link))?);
    }
    Ok((root.name.clone(), out))
}

fn read_joint(urdf: &urdf_rs::Robot, j: &urdf_rs::Joint, parent: Option<usize>) -> Result<Joint, RobotError> {
    let motion = match j.joint_type {
        JointType::Revolute | JointType::Continuous => Motion::Turn,
        JointType::Prismatic => Motion::Slide,
        _ => return unknown(format!("joint {}: a kind that trials do not know", j.name)),
    };
    let Some(link) = urdf.links.iter().find(|l| l.name == j.child.link) else { return unknown(format!("no link {}", j.child.link)) };
    let (i, frame) = (&link.inertial.inertia, rotation(link.inertial.origin.rpy.0));
    let central = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    let centre = Vector3::from(link.inertial.origin.xyz.0);
    let axis = Vector3::from(j.axis.xyz.0);
    Ok(Joint {
        name: j.name.clone(),
        link: j.child.link.clone(),
        parent,
        motion,
        axis: axis.try_normalize(1e-12).unwrap_or_else(Vector3::x),
        turn: rotation(j.origin.rpy.0),
        origin: Vector3::from(j.origin.xyz.0),
        limits: [j.limit.lower, j.limit.upper],
        speed: j.limit.velocity,
        viscous: j.dynamics.as_ref().map_or(0.0, |d| d.damping),
        coulomb: j.dynamics.as_ref().map_or(0.0, |d| d.friction),
        inertia: Inertia::about_centre(link.inertial.mass.value, centre, frame * central * frame.transpose()),
    })
}

/// The URDF with the inertias and frictions of `robot` in it.
///
/// # Errors
/// A URDF that cannot be read or written.
pub fn urdf_with(robot: &Robot, urdf_text: &str) -> Result<String, RobotError> {
    let text = |e: &dyn core::fmt::Display| RobotError::Text { file: "URDF".to_string(), reason: e.to_string() };
    let mut urdf = urdf_rs::read_from_string(urdf_text).map_err(|e| text(&e))?;
    for j in &robot.joints {
        if let Some(link) = urdf.links.iter_mut().find(|l| l.name == j.link && j.inertia.mass > 0.0) {
            let (c, t) = (j.inertia.centre(), j.inertia.central());
            link.inertial.origin.xyz.0 = c.into();
            link.inertial.origin.rpy.0 = [0.0; 3];
            link.inertial.mass.value = j.inertia.mass;
            // Points of mass have no central inertia: what is left of the subtraction is rounding.
            let tidy = |x: f64| if x.abs() < 1e-12 { 0.0 } else { x };
            let i = &mut link.inertial.inertia;
            (i.ixx, i.ixy, i.ixz) = (tidy(t[(0, 0)]), tidy(t[(0, 1)]), tidy(t[(0, 2)]));
            (i.iyy, i.iyz, i.izz) = (tidy(t[(1, 1)]), tidy(t[(1, 2)]), tidy(t[(2, 2)]));
        }
        if let Some(dynamics) = urdf.joints.iter_mut().find(|u| u.name == j.name).and_then(|u| u.dynamics.as_mut()) {
            (dynamics.damping, dynamics.friction) = (j.viscous, j.coulomb);
        }
    }
    urdf_rs::write_to_string(&urdf).map_err(|e| text(&e))
}
