//! Keys of a daemon.toml as they stand in the file.

use pkm_hal::SafeKind;
use serde::Deserialize;
use toml::Spanned;

use super::HalKind;
use crate::realtime::Policy;

/// One number for all drives, or one for each.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "a number, or a list with one for each drive")]
pub(super) enum PerDrive {
    One(f64),
    Each(Vec<f64>),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) robot: Spanned<String>,
    pub(super) controller: Spanned<String>,
    pub(super) directory: Option<Spanned<String>>,
    pub(super) user: Option<Spanned<String>>,
    pub(super) group: Option<Spanned<String>>,
    #[serde(default)]
    pub(super) realtime: Policy,
    pub(super) black_box_s: Option<Spanned<f64>>,
    pub(super) hal: Hal,
    #[serde(default, rename = "loop")]
    pub(super) timing: Timing,
    #[serde(default)]
    pub(super) limits: Bounds,
    pub(super) safe: Safe,
    pub(super) home: Option<Home>,
    #[serde(default)]
    pub(super) run: Run,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Hal {
    pub(super) kind: HalKind,
    pub(super) late_s: Option<Spanned<f64>>,
    pub(super) stale_s: Option<Spanned<f64>>,
    pub(super) valid_for_s: Option<Spanned<f64>>,
    pub(super) wrench: Option<Spanned<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Timing {
    pub(super) cpu: Option<Spanned<f64>>,
    pub(super) priority: Option<Spanned<f64>>,
    pub(super) consecutive_overruns: Option<Spanned<f64>>,
    pub(super) overrun_share: Option<Spanned<f64>>,
    pub(super) stall_s: Option<Spanned<f64>>,
    pub(super) supervisor_s: Option<Spanned<f64>>,
    pub(super) soft_start_s: Option<Spanned<f64>>,
    pub(super) stop_s: Option<Spanned<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bounds {
    pub(super) lower: Option<Spanned<PerDrive>>,
    pub(super) upper: Option<Spanned<PerDrive>>,
    pub(super) velocity: Option<Spanned<PerDrive>>,
    pub(super) effort: Option<Spanned<PerDrive>>,
    pub(super) effort_rate: Option<Spanned<PerDrive>>,
    pub(super) position_gain: Option<Spanned<PerDrive>>,
    pub(super) velocity_gain: Option<Spanned<PerDrive>>,
    pub(super) following: Option<Spanned<PerDrive>>,
    pub(super) stuck: Option<Spanned<PerDrive>>,
    pub(super) jump: Option<Spanned<PerDrive>>,
    pub(super) move_speed: Option<Spanned<PerDrive>>,
    pub(super) force: Option<Spanned<f64>>,
    pub(super) moment: Option<Spanned<f64>>,
}

/// [`SafeKind`] in words.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum SafeName {
    Off,
    Ramp,
    Damp,
    Hold,
    Brake,
}

impl SafeName {
    pub(super) const fn kind(self) -> SafeKind {
        match self {
            Self::Off => SafeKind::Off,
            Self::Ramp => SafeKind::Ramp,
            Self::Damp => SafeKind::Damp,
            Self::Hold => SafeKind::Hold,
            Self::Brake => SafeKind::Brake,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Safe {
    pub(super) kind: SafeName,
    pub(super) ramp_s: Option<Spanned<f64>>,
    pub(super) stiffness: Option<Spanned<PerDrive>>,
    pub(super) damping: Option<Spanned<PerDrive>>,
    pub(super) effort: Option<Spanned<PerDrive>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Home {
    pub(super) q: Spanned<PerDrive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Run {
    pub(super) controller: Option<Spanned<String>>,
    pub(super) motion: Option<Spanned<String>>,
    pub(super) length_s: Option<Spanned<f64>>,
}
