//! Physics beyond rigid bodies: one cause, one name, one file.
//!
//! Sign convention: `tau = rigid bodies + sum of effects`, so an effect's effort is what the drive must supply in addition. Each file
//! holds the law, its parameters, a plain sentence, what it is easily confused with and the experiment that tells them apart. The
//! columns with which the law is looked for in recordings are in `pkm-diagnose`, one file per effect as well.

mod actuator_lag;
mod applied;
mod encoder_offset;
mod friction_asymmetric;
mod friction_coulomb;
mod friction_load;
mod friction_passive;
mod friction_stribeck;
mod friction_viscous;
mod gravity_tilt;
mod inertia_error;
mod payload;
mod rotor_inertia;
mod spring;
mod time_delay;
mod torque_constant;
mod torque_offset;
mod torque_ripple;

pub use applied::{Applied, EffectError, Robot};

use crate::model::{JointKind, Model};

/// Every effect of the library, in the order in which equal explanations are preferred: the commoner and simpler cause first.
pub const CATALOGUE: &[&Entry] = &[
    &friction_coulomb::ENTRY,
    &friction_viscous::ENTRY,
    &torque_offset::ENTRY,
    &friction_stribeck::ENTRY,
    &friction_asymmetric::ENTRY,
    &friction_load::ENTRY,
    &friction_passive::ENTRY,
    &payload::ENTRY,
    &inertia_error::ENTRY,
    &torque_constant::ENTRY,
    &rotor_inertia::ENTRY,
    &spring::ENTRY,
    &gravity_tilt::ENTRY,
    &encoder_offset::ENTRY,
    &torque_ripple::ENTRY,
    &time_delay::ENTRY,
    &actuator_lag::ENTRY,
];

/// The catalogue entry of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().copied().find(|e| e.name == name)
}

/// Where an effect can sit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlaceKind {
    /// A driven joint.
    Joint,
    /// A joint that no drive moves.
    PassiveJoint,
    /// A link.
    Link,
    /// The root link: the mounting.
    RootLink,
}

/// What an effect does with energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Energy {
    /// Takes it in and gives it back.
    Stores,
    /// Turns it into heat; its power is never negative.
    Dissipates,
    /// Is no force at all.
    Neither,
}

/// Unit of a parameter; for joint quantities it depends on the joint's kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// N or N·m.
    Effort,
    /// N·s/m or N·m·s/rad.
    EffortPerVelocity,
    /// N/m or N·m/rad.
    EffortPerPosition,
    /// m/s or rad/s.
    Velocity,
    /// m or rad.
    Position,
    /// 1/m or 1/rad.
    PerPosition,
    /// kg or kg·m², at a joint.
    Inertia,
    /// kg.
    Mass,
    /// m.
    Length,
    /// kg·m.
    FirstMoment,
    /// kg·m².
    InertiaRot,
    /// rad.
    Rad,
    /// s.
    Second,
    /// A pure number.
    One,
}

impl Unit {
    /// As text, for a joint of the given kind.
    #[must_use]
    pub fn text(self, kind: JointKind) -> &'static str {
        let revolute = kind == JointKind::Revolute;
        match self {
            Self::Effort if revolute => "N·m",
            Self::Effort => "N",
            Self::EffortPerVelocity if revolute => "N·m·s/rad",
            Self::EffortPerVelocity => "N·s/m",
            Self::EffortPerPosition if revolute => "N·m/rad",
            Self::EffortPerPosition => "N/m",
            Self::Velocity if revolute => "rad/s",
            Self::Velocity => "m/s",
            Self::Position if revolute => "rad",
            Self::Position | Self::Length => "m",
            Self::PerPosition if revolute => "1/rad",
            Self::PerPosition => "1/m",
            Self::Inertia if revolute => "kg·m²",
            Self::Inertia | Self::Mass => "kg",
            Self::FirstMoment => "kg·m",
            Self::InertiaRot => "kg·m²",
            Self::Rad => "rad",
            Self::Second => "s",
            Self::One => "1",
        }
    }
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name, as in robot.toml and in verdicts.
    pub name: &'static str,
    /// Unit.
    pub unit: Unit,
    /// Smallest physical value.
    pub lower: f64,
    /// Value when not stated; `None` makes the parameter required.
    pub default: Option<f64>,
}

/// An effect that looks similar in recordings, and what would tell the two apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LookAlike {
    /// Its name (it need not be in the library yet).
    pub effect: &'static str,
    /// The cheapest experiment that separates them.
    pub experiment: &'static str,
}

/// State of one joint, as a law sees it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointState {
    /// Position `[m | rad]`.
    pub q: f64,
    /// Velocity `[m/s | rad/s]`.
    pub v: f64,
    /// Acceleration `[m/s² | rad/s²]`.
    pub a: f64,
    /// Direction of motion, −1 to 1. The caller decides how it passes through zero: a plant solves for it, an estimator smooths it.
    pub sign: f64,
    /// Effort the rigid model transmits at the joint `[N | N·m]`.
    pub load: f64,
}

/// How an effect enters the equations.
#[derive(Debug, Clone, Copy)]
pub enum Law {
    /// An effort at a joint's coordinate.
    JointEffort(fn(&[f64], &JointState) -> f64),
    /// A change of a link's mass properties.
    Inertia(fn(&mut Model, usize, &[f64])),
    /// A change of gravity in the root frame.
    Gravity(fn(&mut Model, usize, &[f64])),
    /// Recorded effort = acting effort / parameter 0.
    EffortScale,
    /// Recorded effort = acting + parameter 0 · d(acting)/dt.
    EffortLag,
    /// Recorded effort at t = acting effort at t + parameter 0.
    EffortDelay,
    /// True position = reading + parameter 0.
    PositionOffset,
}

/// One effect of the library.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Name, as in robot.toml and in verdicts.
    pub name: &'static str,
    /// What it is, as a clause a robot engineer would write.
    pub sentence: &'static str,
    /// Canonical equation; `s` is the direction of motion.
    pub equation: &'static str,
    /// Parameters in the order laws take them.
    pub parameters: &'static [Parameter],
    /// Where it can sit.
    pub place: PlaceKind,
    /// What it is confused with.
    pub look_alikes: &'static [LookAlike],
    /// What a controller does about it.
    pub compensation: &'static str,
    /// What it does with energy.
    pub energy: Energy,
    /// How it enters the equations.
    pub law: Law,
}
