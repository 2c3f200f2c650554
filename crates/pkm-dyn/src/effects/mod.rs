//! Physics beyond rigid bodies: one cause, one name, one file.
//!
//! Sign convention: `tau = rigid bodies + sum of effects`, so an effect's effort is what the drive must supply in addition. Each file
//! holds the law, its parameters, a plain sentence, what it is easily confused with and the experiment that tells them apart. The
//! columns with which the law is looked for in recordings are in `pkm-diagnose`, one file per effect as well.

mod active_limb;
mod actuator_lag;
mod applied;
mod backlash;
mod cable_force;
mod contact;
mod controller_mismatch;
mod dead_zone;
mod directional_efficiency;
mod encoder_eccentricity;
mod encoder_offset;
mod external_force;
mod friction_asymmetric;
mod friction_coulomb;
mod friction_load;
mod friction_passive;
mod friction_position;
mod friction_presliding;
mod friction_quadratic;
mod friction_stribeck;
mod friction_thermal;
mod friction_viscous;
mod geometry_error;
mod gravity_tilt;
mod inertia_error;
mod joint_elasticity;
mod limb_impedance;
mod payload;
mod rotor_inertia;
mod saturation;
mod sensor_drift;
mod spring;
mod structure_flexibility;
mod time_delay;
mod torque_constant;
mod torque_offset;
mod torque_ripple;
mod transmission_coupling;

pub use applied::{Applied, EffectError, Robot};
pub use spring::bent_away;

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
    &friction_quadratic::ENTRY,
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
    &friction_position::ENTRY,
    &friction_thermal::ENTRY,
    &directional_efficiency::ENTRY,
    &friction_presliding::ENTRY,
    &backlash::ENTRY,
    &joint_elasticity::ENTRY,
    &cable_force::ENTRY,
    &transmission_coupling::ENTRY,
    &saturation::ENTRY,
    &dead_zone::ENTRY,
    &encoder_eccentricity::ENTRY,
    &geometry_error::ENTRY,
    &structure_flexibility::ENTRY,
    &limb_impedance::ENTRY,
    &contact::ENTRY,
    &external_force::ENTRY,
    &active_limb::ENTRY,
    &sensor_drift::ENTRY,
    &controller_mismatch::ENTRY,
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
    /// Two joints.
    JointPair,
    /// A driven joint or a sensor.
    JointOrSensor,
    /// A link.
    Link,
    /// A link or a joint.
    LinkOrJoint,
    /// A link or a loop.
    LinkOrLoop,
    /// The root link: the mounting.
    RootLink,
}

impl PlaceKind {
    /// What a place of this kind counts where its name does not say otherwise.
    #[must_use]
    pub const fn site(self) -> Site {
        match self {
            Self::Joint | Self::PassiveJoint | Self::JointPair | Self::JointOrSensor => Site::Joint,
            Self::Link | Self::LinkOrJoint | Self::LinkOrLoop | Self::RootLink => Site::Link,
        }
    }

    /// In words, with an article.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Joint => "a driven joint",
            Self::PassiveJoint => "a passive joint",
            Self::JointPair => "two joints",
            Self::JointOrSensor => "a driven joint or a sensor",
            Self::Link => "a link",
            Self::LinkOrJoint => "a link or a joint",
            Self::LinkOrLoop => "a link or a loop",
            Self::RootLink => "the root link (the mounting)",
        }
    }
}

/// What the number of an effect's place counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Site {
    /// Joints of the tree.
    Joint,
    /// Links.
    Link,
    /// Loop closures.
    Loop,
    /// Sensors.
    Sensor,
}

/// What an effect does with energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Energy {
    /// Takes it in and gives it back.
    Stores,
    /// Turns it into heat; its power is never negative.
    Dissipates,
    /// Stores some and turns the rest into heat: over any motion from rest it gives back at most what it took in.
    Passive,
    /// Brings in energy from outside.
    Feeds,
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
    /// N/m² or N·m/rad².
    EffortPerPositionSquared,
    /// N/m³ or N·m/rad³.
    EffortPerPositionCubed,
    /// N/m⁴ or N·m/rad⁴.
    EffortPerPositionFourth,
    /// Effort at unit speed, for a power of speed that another parameter states.
    Drag,
    /// N·m, whatever moves.
    Moment,
    /// N·m/rad, whatever moves.
    MomentPerAngle,
    /// N·m·s/rad, whatever moves.
    MomentPerAngularVelocity,
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
    /// Per degree of warming or per second of running, whichever [`JointState::warmth`] counts.
    PerWarmth,
    /// m/s or rad/s of a position; of another sensor its own unit per second.
    ReadingPerSecond,
    /// A pure number.
    One,
    /// A pure number that cannot exceed one.
    Share,
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
            Self::EffortPerPositionSquared if revolute => "N·m/rad²",
            Self::EffortPerPositionSquared => "N/m²",
            Self::EffortPerPositionCubed if revolute => "N·m/rad³",
            Self::EffortPerPositionCubed => "N/m³",
            Self::EffortPerPositionFourth if revolute => "N·m/rad⁴",
            Self::EffortPerPositionFourth => "N/m⁴",
            Self::Drag if revolute => "N·m·(s/rad)^exponent",
            Self::Drag => "N·(s/m)^exponent",
            Self::Moment => "N·m",
            Self::MomentPerAngle => "N·m/rad",
            Self::MomentPerAngularVelocity => "N·m·s/rad",
            Self::Velocity | Self::ReadingPerSecond if revolute => "rad/s",
            Self::Velocity | Self::ReadingPerSecond => "m/s",
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
            Self::PerWarmth => "1/°C or 1/s",
            Self::One | Self::Share => "1",
        }
    }

    /// Largest physical value of a parameter in this unit.
    #[must_use]
    pub const fn upper(self) -> f64 {
        match self {
            Self::Share => 1.0,
            _ => f64::INFINITY,
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
    /// Nominal viscous friction of the joint `[N·s/m | N·m·s/rad]`: what a change of friction is a share of.
    pub viscous: f64,
    /// Nominal Coulomb friction of the joint `[N | N·m]`: what a reduction of friction cannot exceed.
    pub coulomb: f64,
    /// How far the joint has warmed up: temperature above that of the first sample `[°C]` where one is recorded, otherwise time since then `[s]`.
    pub warmth: f64,
    /// Time since the motion began `[s]`.
    pub time: f64,
}

/// State of one link, as a law sees it; all in the root frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinkState {
    /// Position of the link's origin `[m]`.
    pub position: [f64; 3],
    /// Displacement of the link's origin since the motion began `[m]`, then the rotation vector since then `[rad]`.
    pub displacement: [f64; 6],
    /// Velocity of the link's origin `[m/s]`, then angular velocity `[rad/s]`.
    pub velocity: [f64; 6],
    /// The link's x, y and z axis in the root frame; zero for a joint.
    pub axes: [[f64; 3]; 3],
    /// Time since the motion began `[s]`.
    pub time: f64,
}

/// A force with a memory: one state `z`, at rest zero.
#[derive(Debug, Clone, Copy)]
pub struct Memory {
    /// dz/dt for parameters, `z` `[m | rad]` and joint velocity `[m/s | rad/s]`.
    pub rate: fn(&[f64], f64, f64) -> f64,
    /// Effort for parameters, `z` and joint velocity `[N | N·m]`.
    pub effort: fn(&[f64], f64, f64) -> f64,
}

/// How motor and load of a drive part company.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transmission {
    /// Play: parameter 0 is the gap between both ends of the play `[m | rad]`.
    Play,
    /// A spring of stiffness parameter 0 with damping parameter 1; parameter 2 is the inertia on the motor's side `[kg | kg·m²]`, 0 the
    /// rotor's.
    Spring,
}

/// How an effect enters the equations.
///
/// What acts on efforts or readings of a drive ([`Law::is_of_a_drive`]) sits at a driven joint; everything else wherever its place kind
/// says. Which kinds a program takes into account is for it to say: it refuses or names the others.
#[derive(Debug, Clone, Copy)]
pub enum Law {
    /// An effort at a joint's coordinate.
    JointEffort(fn(&[f64], &JointState) -> f64),
    /// As [`Law::JointEffort`] for the sum of two joints' coordinates: both feel the effort.
    PairEffort(fn(&[f64], &JointState) -> f64),
    /// An effort at a joint's coordinate that depends on the way there.
    Memory(Memory),
    /// Motor and load of a drive have coordinates of their own.
    Transmission(Transmission),
    /// A link hangs on springs of stiffness parameter 0 `[N/m]` and damping parameter 1 in all three directions.
    Structure,
    /// A wrench of the robot on its environment at a link's origin, force first, in the root frame `[N, N·m]`; at a joint, the first
    /// component is an effort at its coordinate and the state's first components are the joint's, all others zero.
    Wrench(fn(&[f64], &LinkState) -> [f64; 6]),
    /// A force of a person at a link's origin that no repetition brings back: parameter 0 is its rms `[N]`.
    Person,
    /// A change of the place of a link in its parent, or of a loop's frame b.
    Geometry(fn(&mut Model, (Site, usize), &[f64])),
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
    /// Acting effort = recorded effort clipped at ± parameter 0.
    EffortLimit,
    /// Recorded efforts within ± half of parameter 0 do not act; larger ones lose that half.
    EffortDeadZone,
    /// True position = reading + parameter 0.
    PositionOffset,
    /// True position = reading + parameter 0 · sin(parameter 1 · true position + parameter 2).
    PositionPeriodic,
    /// Reading = true value + parameter 0 · time, of a position or of a sensor.
    Drift,
    /// The recorded command is not the controller's: this share of it is missing.
    CommandShare,
}

impl Law {
    /// Whether it changes the numbers of the model itself, so that everything computed from the model has it in.
    #[must_use]
    pub const fn is_in_the_model(&self) -> bool {
        matches!(self, Self::Geometry(_) | Self::Inertia(_) | Self::Gravity(_))
    }

    /// Whether it acts between command, effort and reading of a drive, so that a joint without one has no place for it.
    #[must_use]
    pub const fn is_of_a_drive(&self) -> bool {
        match self {
            Self::Transmission(_)
            | Self::EffortScale
            | Self::EffortLag
            | Self::EffortDelay
            | Self::EffortLimit
            | Self::EffortDeadZone
            | Self::PositionOffset
            | Self::PositionPeriodic
            | Self::Drift
            | Self::CommandShare => true,
            Self::JointEffort(_)
            | Self::PairEffort(_)
            | Self::Memory(_)
            | Self::Structure
            | Self::Wrench(_)
            | Self::Person
            | Self::Geometry(_)
            | Self::Inertia(_)
            | Self::Gravity(_) => false,
        }
    }
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
