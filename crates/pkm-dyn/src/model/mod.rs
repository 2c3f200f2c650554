//! The robot as the algorithms see it: immutable once built.

mod builder;
mod joint;
mod loops;

pub use builder::{BuildError, ModelBuilder};
#[cfg(feature = "urdf")]
pub(crate) use builder::{Freedom, JointPart};
pub(crate) use joint::Principal;
pub use joint::{Compound, Joint, JointKind, Limits, Part};
pub use loops::{AXES, Coupling, FrameOnBody, LoopClosure};

use alloc::string::String;
use alloc::vec::Vec;

use nalgebra::Vector3;

use crate::parameters::InertialParameters;
use crate::spatial::Pose;

/// A named part of the robot: moves with a body, at a fixed pose in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name in the URDF.
    pub name: String,
    /// Body that carries it; `None` when it is fixed to the root.
    pub body: Option<usize>,
    /// Pose of the link's frame in the body's frame (in the root's frame without a body).
    pub pose: Pose,
    /// Mass properties in the link's own frame.
    pub parameters: InertialParameters,
}

/// What a sensor reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorKind {
    /// Force and moment of the environment on the robot.
    Wrench,
    /// Pose of the sensor's frame in the root link's frame.
    Pose,
}

/// A sensor fixed to a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Name.
    pub name: String,
    /// What it reports.
    pub kind: SensorKind,
    /// Link it sits on.
    pub link: usize,
    /// Its frame in the link's frame.
    pub pose: Pose,
}

/// A robot: spanning tree, loops, couplings, drives.
///
/// Joint `i` moves body `i`; parents come before children. Coordinates `q`, `v`, `a`, `tau` of the tree have one entry per joint, in
/// this order; actuated vectors have one entry per drive, in the order of [`Model::actuators`].
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Robot name.
    pub name: String,
    /// Name of the root link.
    pub root: String,
    /// Gravity in the root link's frame `[m/s²]`.
    pub gravity: Vector3<f64>,
    /// Joints of the tree, parents first.
    pub joints: Vec<Joint>,
    /// Mass properties of each body (all its links lumped), in the body's frame.
    pub bodies: Vec<InertialParameters>,
    /// Every link, the root included.
    pub links: Vec<Link>,
    /// Loop closures.
    pub loops: Vec<LoopClosure>,
    /// Linear relations the drive imposes.
    pub couplings: Vec<Coupling>,
    /// Driven joints, in the order of `tau`.
    pub actuators: Vec<usize>,
    /// Rough tree coordinates of the intended assembly `[m | rad]`.
    pub assembly: Vec<f64>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
}

impl Model {
    /// Number of tree coordinates.
    #[must_use]
    pub fn nv(&self) -> usize {
        self.joints.len()
    }

    /// Number of drives.
    #[must_use]
    pub fn n_act(&self) -> usize {
        self.actuators.len()
    }

    /// Number of scalar constraint rows: couplings, then loops.
    #[must_use]
    pub fn n_constraints(&self) -> usize {
        self.couplings.len() + self.loops.iter().map(LoopClosure::n_rows).sum::<usize>()
    }

    /// Joints that are not driven.
    #[must_use]
    pub fn passive(&self) -> Vec<usize> {
        (0..self.nv()).filter(|j| !self.actuators.contains(j)).collect()
    }

    /// Index of a joint by name.
    #[must_use]
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }

    /// Index of a link by name.
    #[must_use]
    pub fn link_index(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// Whether any loop or coupling constrains the tree.
    #[must_use]
    pub fn is_constrained(&self) -> bool {
        !self.loops.is_empty() || !self.couplings.is_empty()
    }

    /// Links with mass, as indices; their ten parameters are the robot's standard parameters.
    #[must_use]
    pub fn massive_links(&self) -> Vec<usize> {
        (0..self.links.len()).filter(|&l| self.links[l].body.is_some() && self.links[l].parameters.mass > 0.0).collect()
    }

    /// Sets the mass properties of a link and updates the body that carries it.
    pub fn set_link_parameters(&mut self, link: usize, parameters: InertialParameters) {
        self.links[link].parameters = parameters;
        if let Some(body) = self.links[link].body {
            self.bodies[body] = self.lumped(body);
        }
    }

    fn lumped(&self, body: usize) -> InertialParameters {
        self.links
            .iter()
            .filter(|l| l.body == Some(body))
            .fold(InertialParameters::default(), |sum, l| sum.joined(&l.parameters.transformed(&l.pose)))
    }

    /// Whether joint `ancestor` lies on the path from the root to body `body` (itself included).
    #[must_use]
    pub fn supports(&self, ancestor: usize, body: Option<usize>) -> bool {
        let mut at = body;
        while let Some(b) = at {
            if b == ancestor {
                return true;
            }
            at = self.joints[b].parent;
        }
        false
    }
}
