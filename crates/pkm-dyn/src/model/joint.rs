//! Joints of the tree: one coordinate each.

use alloc::string::String;

use nalgebra::Vector3;

use crate::spatial::{Motion, Pose};

/// What a joint's coordinate means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Rotation about the axis `[rad]` (URDF `revolute` and `continuous`).
    Revolute,
    /// Travel along the axis `[m]`.
    Prismatic,
}

impl JointKind {
    /// Unit of the coordinate.
    #[must_use]
    pub fn unit_position(self) -> &'static str {
        match self {
            Self::Revolute => "rad",
            Self::Prismatic => "m",
        }
    }

    /// Unit of the effort.
    #[must_use]
    pub fn unit_effort(self) -> &'static str {
        match self {
            Self::Revolute => "N·m",
            Self::Prismatic => "N",
        }
    }
}

/// Limits of a joint; infinite where the file states none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest coordinate `[m | rad]`.
    pub lower: f64,
    /// Highest coordinate `[m | rad]`.
    pub upper: f64,
    /// Highest speed `[m/s | rad/s]`.
    pub velocity: f64,
    /// Highest effort `[N | N·m]`.
    pub effort: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, velocity: f64::INFINITY, effort: f64::INFINITY }
    }
}

/// One joint and the place of its body in the tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// What the coordinate means.
    pub kind: JointKind,
    /// Unit axis in the joint's frame.
    pub axis: Vector3<f64>,
    /// Joint frame in the parent body's frame at coordinate zero.
    pub placement: Pose,
    /// Parent body; `None` is the root.
    pub parent: Option<usize>,
    /// Limits.
    pub limits: Limits,
    /// Nominal viscous friction `[N·s/m | N·m·s/rad]`.
    pub viscous: f64,
    /// Nominal Coulomb friction `[N | N·m]`.
    pub coulomb: f64,
    /// Rotor inertia seen at the joint `[kg | kg·m²]`.
    pub armature: f64,
}

impl Joint {
    /// Pose of the body in its parent at coordinate `q` `[m | rad]`.
    #[must_use]
    pub fn pose(&self, q: f64) -> Pose {
        match self.kind {
            JointKind::Revolute => Pose {
                rotation: self.placement.rotation * crate::spatial::rotation_about(&self.axis, q),
                translation: self.placement.translation,
            },
            JointKind::Prismatic => Pose {
                rotation: self.placement.rotation,
                translation: self.placement.translation + self.placement.rotation * self.axis * q,
            },
        }
    }

    /// The joint's unit motion, in the body's frame.
    #[must_use]
    pub fn motion(&self) -> Motion {
        match self.kind {
            JointKind::Revolute => Motion { linear: Vector3::zeros(), angular: self.axis },
            JointKind::Prismatic => Motion { linear: self.axis, angular: Vector3::zeros() },
        }
    }
}
