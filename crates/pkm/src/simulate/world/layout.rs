//! The tables of a world.toml as they stand in the file.

extern crate alloc;

use alloc::collections::BTreeMap;

use serde::Deserialize;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct World {
    pub(super) seed: Option<u64>,
    pub(super) substeps: Option<u32>,
    #[serde(default)]
    pub(super) drive: Drive,
    #[serde(default)]
    pub(super) joint: BTreeMap<String, Drive>,
    pub(super) sampling: Option<Sampling>,
    #[serde(default)]
    pub(super) wrench: BTreeMap<String, Wrench>,
    pub(super) limb: Option<Limb>,
}

/// One drive; what is left out is that of `[drive]`, and there ideal.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Drive {
    pub(super) encoder: Option<Encoder>,
    pub(super) second_encoder: Option<Encoder>,
    pub(super) velocity: Option<Velocity>,
    pub(super) effort: Option<Cell>,
    pub(super) output: Option<Output>,
    pub(super) delay_s: Option<f64>,
    pub(super) current_lag_s: Option<f64>,
    pub(super) three_mass: Option<ThreeMass>,
}

#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Encoder {
    pub(super) counts_per_unit: Option<f64>,
    pub(super) noise: f64,
    pub(super) offset: f64,
    pub(super) drift: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Velocity {
    pub(super) kind: VelocityKind,
    pub(super) timer_s: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum VelocityKind {
    Exact,
    None,
    PulseCounting,
    PulseTiming,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Cell {
    pub(super) gain: f64,
    pub(super) lag_s: f64,
    pub(super) bias: f64,
    pub(super) rate: f64,
    pub(super) walk: f64,
    pub(super) noise: f64,
    pub(super) ceiling: f64,
    pub(super) step: f64,
}

impl Default for Cell {
    fn default() -> Self {
        Self { gain: 1.0, lag_s: 0.0, bias: 0.0, rate: 0.0, walk: 0.0, noise: 0.0, ceiling: f64::INFINITY, step: 0.0 }
    }
}

#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Output {
    pub(super) ceiling: Option<f64>,
    pub(super) step: Option<f64>,
    pub(super) bits: Option<u32>,
    pub(super) pulse_counts: Option<u32>,
    pub(super) dead_zone: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ThreeMass {
    pub(super) motor_inertia: f64,
    pub(super) motor_viscous: f64,
    pub(super) motor_pulley: f64,
    pub(super) screw_inertia: f64,
    pub(super) screw_viscous: f64,
    pub(super) screw_pulley: f64,
    pub(super) screw_ratio: f64,
    pub(super) belt_stiffness: f64,
    pub(super) belt_damping: f64,
    pub(super) rod_mass: f64,
    pub(super) rod_viscous: f64,
    pub(super) rod_coulomb: f64,
    pub(super) cell_stiffness: f64,
    pub(super) cell_damping: f64,
    pub(super) current_lag_s: f64,
}

#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Sampling {
    pub(super) jitter_s: f64,
    pub(super) loss_begins: f64,
    pub(super) loss_goes_on: f64,
}

/// Three cells of one kind for forces, three for moments.
#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Wrench {
    pub(super) force: Cell,
    pub(super) moment: Cell,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limb {
    /// The link it is strapped to; without one its axes are joints.
    pub(super) link: Option<String>,
    #[serde(default)]
    pub(super) axis: BTreeMap<String, Axis>,
    #[serde(default)]
    pub(super) person: Person,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Axis {
    pub(super) stiffness: f64,
    pub(super) damping: f64,
    pub(super) rest: f64,
    pub(super) lower: f64,
    pub(super) upper: f64,
    pub(super) stop_stiffness: f64,
    pub(super) stop_exponent: f64,
    pub(super) stop_damping: f64,
    pub(super) strength: f64,
    pub(super) tremor: f64,
}

impl Default for Axis {
    fn default() -> Self {
        Self {
            stiffness: 0.0,
            damping: 0.0,
            rest: 0.0,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            stop_stiffness: 0.0,
            stop_exponent: 1.0,
            stop_damping: 0.0,
            strength: 0.0,
            tremor: 0.0,
        }
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Will {
    #[default]
    Passive,
    Resists,
    Assists,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Person {
    pub(super) will: Will,
    pub(super) seed: Option<u64>,
    pub(super) speed: f64,
    pub(super) variation: f64,
    pub(super) variation_time_s: f64,
    pub(super) tremor_hz: f64,
    pub(super) tremor_width_hz: f64,
}

impl Default for Person {
    fn default() -> Self {
        let usual = pkm_sim::limb::PatientConfig::default();
        Self {
            will: Will::Passive,
            seed: None,
            speed: usual.speed,
            variation: usual.variation,
            variation_time_s: usual.variation_time,
            tremor_hz: usual.tremor_frequency,
            tremor_width_hz: usual.tremor_width,
        }
    }
}
