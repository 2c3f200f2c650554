//! What a robot is equipped with, and who is in it: drives that are not ideal, sensors that err, a limb.

use crate::actuators::{OutputStage, ThreeMassParameters};
use crate::limb::{Impedance, PatientConfig};
use crate::sensors::{ForceCellConfig, SamplingConfig, VelocitySensing};

/// The electronics and sensors of one drive; the default is ideal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveEquipment {
    /// Width of a count of the encoder `[m | rad]`; 0 does not round.
    pub resolution: f64,
    /// Standard deviation of its noise `[m | rad]`.
    pub noise: f64,
    /// True position less reading when the run begins `[m | rad]`.
    pub offset: f64,
    /// How fast the reading leaves the truth `[m/s | rad/s]`.
    pub drift: f64,
    /// How velocity is measured.
    pub velocity: VelocitySensing,
    /// How the effort is measured.
    pub effort: ForceCellConfig,
    /// Ceiling, steps and dead zone of the electronics.
    pub output: OutputStage,
    /// Time from a command to its effort `[s]`.
    pub delay: f64,
    /// Time constant of the current loop `[s]`.
    pub lag: f64,
    /// Elastic transmission between motor and joint; none drives the joint directly.
    pub transmission: Option<ThreeMassParameters>,
    /// A second encoder, on the load's side.
    pub second: Option<ForceCellConfig>,
}

impl Default for DriveEquipment {
    fn default() -> Self {
        Self {
            resolution: 0.0,
            noise: 0.0,
            offset: 0.0,
            drift: 0.0,
            velocity: VelocitySensing::Exact,
            effort: ForceCellConfig::default(),
            output: OutputStage::ideal(),
            delay: 0.0,
            lag: 0.0,
            transmission: None,
            second: None,
        }
    }
}

/// Where a limb is.
#[derive(Debug, Clone, PartialEq)]
pub enum LimbPlace {
    /// Strapped to a link, with impedances along x, y, z and about them, at rest where the link is when the run begins.
    Link(usize, Box<[Impedance; 6]>),
    /// At the drives, one impedance each.
    Drives(Vec<Impedance>),
}

/// A limb and the person whose it is.
#[derive(Debug, Clone, PartialEq)]
pub struct LimbEquipment {
    /// Where it is.
    pub place: LimbPlace,
    /// What the person adds.
    pub patient: PatientConfig,
    /// Chooses what he does.
    pub seed: u64,
}

/// All of a robot's equipment.
#[derive(Debug, Clone, PartialEq)]
pub struct Equipment {
    /// Chooses every error of drives and sensors.
    pub seed: u64,
    /// Steps of the plant per base period.
    pub substeps: u32,
    /// One entry per drive.
    pub drives: Vec<DriveEquipment>,
    /// When samples are taken and which arrive.
    pub sampling: SamplingConfig,
    /// Wrench sensors of the model that are recorded, by number, with their six cells: fx, fy, fz, mx, my, mz.
    pub wrenches: Vec<(usize, [ForceCellConfig; 6])>,
    /// The limb in the robot.
    pub limb: Option<LimbEquipment>,
}

impl Equipment {
    /// Ideal equipment of a robot with so many drives.
    #[must_use]
    pub fn ideal(n_drives: usize) -> Self {
        Self {
            seed: 1,
            substeps: 2,
            drives: vec![DriveEquipment::default(); n_drives],
            sampling: SamplingConfig::default(),
            wrenches: Vec::new(),
            limb: None,
        }
    }
}
