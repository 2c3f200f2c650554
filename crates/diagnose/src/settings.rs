//! What a user may set, and the constants of the decision with their reasons.

use std::path::PathBuf;

use crate::columns;
use crate::error::InputError;

/// Settings of a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Zero-phase low-pass for effort and model alike `[Hz]`; chosen from the motion when `None`.
    pub band_hz: Option<f64>,
    /// Smallest held-out gain worth a name, as a share of the squared error it acts on. A real half-millisecond hold is
    /// statistically true and practically nothing: an effect must be worth having as well as real.
    pub floor: f64,
    /// Smallest size worth a name, as a share of the effort of the drives it acts on: what a recording can resolve may still be nothing
    /// that a controller would feel.
    pub tolerance: f64,
    /// Null runs per decision.
    pub null_runs: usize,
    /// Family-wise level at which the search lets a candidate through, over all candidates, places and shapes at once. It is generous
    /// because everything let through must then pass [`Settings::confirm_level`] on data the search has not seen.
    pub search_level: f64,
    /// Level of the test each finding must pass on held-out data. A false finding needs both: about one run in a hundred.
    pub confirm_level: f64,
    /// Seed of the null runs' random phases.
    pub seed: u64,
    /// Folder for a temporary file in which series of long recordings wait, beyond [`Settings::room`] of them; without one all stay in memory.
    /// It changes no number.
    pub scratch: Option<PathBuf>,
    /// Names of effects that are not looked for: what would be said if it were none of these? The library without an effect is also how a
    /// verdict on physics that the library lacks is tried.
    pub without: Vec<String>,
    /// Bytes of these series that stay in memory where there is a folder for the others.
    pub room: usize,
}

impl Settings {
    /// Names of the effects that are looked for; `None` is all of them.
    ///
    /// # Errors
    /// A name in `without` that no effect has.
    pub(crate) fn looked_for(&self) -> Result<Option<Vec<&'static str>>, InputError> {
        if let Some(name) = self.without.iter().find(|name| pkm_dyn::effects::find(name).is_none()) {
            return Err(InputError::Unknown { name: name.clone(), known: columns::looked_for().join(", ") });
        }
        let left = || columns::looked_for().into_iter().filter(|name| !self.leaves_out(name)).collect();
        Ok(if self.without.is_empty() { None } else { Some(left()) })
    }

    /// Whether an effect is not looked for.
    pub(crate) fn leaves_out(&self, effect: &str) -> bool {
        self.without.iter().any(|name| name == effect)
    }

    /// What a verdict says of effects that were not looked for.
    pub(crate) fn note_of_without(&self) -> Option<String> {
        let names = || self.without.iter().map(String::as_str).collect::<alloc::collections::BTreeSet<_>>();
        let list = || names().into_iter().collect::<Vec<_>>().join(", ");
        (!self.without.is_empty()).then(|| format!("left out on request, so not looked for and in no list of this verdict: {}", list()))
    }

    /// Smallest share of the squared error worth a name of a law with `n` coefficients: each must be worth what a single one must.
    pub(crate) fn floor_of(&self, n: usize) -> f64 {
        self.floor * n.max(1) as f64
    }

    /// Smallest size worth a name of a law with `n` coefficients: each must be worth what a single one must, in squared effort.
    pub(crate) fn tolerance_of(&self, n: usize) -> f64 {
        self.tolerance * pkm_dyn::math::sqrt(n.max(1) as f64)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            band_hz: None,
            floor: 0.03,
            tolerance: 0.005,
            null_runs: 199,
            search_level: 0.2,
            confirm_level: 0.05,
            seed: 1,
            scratch: None,
            without: Vec::new(),
            room: ROOM,
        }
    }
}

/// Bytes of series that stay in memory: half a gigabyte, more than ten minutes at 1 kHz need.
const ROOM: usize = 1 << 29;

/// Harmonics of the fastest motion that the band keeps: dry friction answers a sine with its odd harmonics, and the seventh still has a seventh of
/// the first's size. What delays, soft transmissions and screws that are not round do shows above what friction leaves unexplained, which is slow.
pub(crate) const HARMONICS: f64 = 7.0;

/// Above it `[Hz]` frames and drives swing in ways that no model of rigid links with one spring here and there has, and small servos are compared no
/// higher: up to there all [`HARMONICS`] are kept, beyond it no more than the [`FEWEST_HARMONICS`] without which friction is not told from damping.
pub(crate) const LUMPED_HZ: f64 = 12.0;

/// Harmonics that are kept of a motion however fast it is.
pub(crate) const FEWEST_HARMONICS: f64 = 5.0;

/// Blocks a recording is cut into; without a separate hold-out every second one is held out.
pub(crate) const BLOCKS: usize = 10;

/// Smoothing of the direction of motion near zero speed where reversals are not fitted ([`crate::turning`]), as shares of the joint's top speed.
///
/// The widest is the speed at which a joint counts as standing still: a wider smoothing would bend the friction of a moving joint.
pub(crate) const SOFTNESS: [f64; 3] = [0.001, 0.003, 0.01];

/// A joint slower than this share of its top speed stands still: friction is undetermined there.
pub(crate) const STANDSTILL: f64 = 0.01;

/// How many times slower than the others a recording may be and still lose no more than what they lose at standstill: of a slower one a tenth of
/// its own top speed is kept out, or nothing of it would be left.
pub(crate) const SLOWEST: f64 = 10.0;

/// How far a CAD value may be off, as candidate prior strengths: not at all, a tenth, a half. Cross-validation picks one.
pub(crate) const PRIORS: [f64; 3] = [0.0, 0.1, 0.5];

/// An explanation that takes away this share of what the finding takes away cannot be told from it, unless the finding takes away a share worth
/// naming of what it leaves, and the blocks say so clearly.
pub(crate) const ALIAS_SHARE: f64 = 0.9;

/// An explanation of most of it cannot be told from it either, unless the blocks say so clearly.
pub(crate) const WEAK_ALIAS_SHARE: f64 = 0.5;

/// From this share on, a rejected explanation is worth a line.
pub(crate) const LOOK_ALIKE_SHARE: f64 = 0.3;

/// Share of the rms error that must stay at a joint for it to count as unexplained: most of it.
pub(crate) const UNEXPLAINED_SHARE: f64 = 0.5;

/// More findings than this in one diagnosis would be a fit, not an explanation.
pub(crate) const MAX_STRUCTURAL: usize = 6;

/// Parameter shifts that may be reported.
pub(crate) const MAX_SHIFTS: usize = 24;

/// Samples of all recordings together up to which each is taken as it is: ten minutes at 1 kHz.
pub(crate) const LONG: usize = 600_000;

/// Samples per period of the band of recordings that are longer: columns are built at more than twice the fine grid's rate.
pub(crate) const RATE: f64 = 50.0;

/// Smallest number of samples a recording must have: filters and folds need that many to mean anything.
pub const MIN_SAMPLES: usize = 200;
