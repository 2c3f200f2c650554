//! Momentum observer in the coordinates of the drives: the effort on a closed-loop robot that its drives do not supply.
//!
//! With `p = M·v` and the loops' efforts gone, `p' = tau + tau_ext − nle + M'·v`; the observer is a low-pass of what is left,
//! `r' = rate·(p' − tau + nle − M'·v − r)` \[Luca2005\], so `r = tau_ext·(1 − exp(−rate·t))` for a constant effort. Accelerations
//! are not needed. Between two samples `p' − M'·v` is the mean mass matrix times the change of velocity, which is exact for the product;
//! `nle`, friction included, is the mean of both ends.

use pkm_dyn::effects::Robot;

use crate::controller::{ConfigError, must_be_usable};
use crate::drive_model::{DriveModel, DriveModelState};
use crate::filter::low_pass_share;

/// Numbers of a [`MomentumObserver`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentumObserverConfig<const N: usize> {
    /// Rate at which the residual follows the effort from outside `[1/s]`.
    pub rate: [f64; N],
    /// Residual beyond which a drive counts as touched `[N | N·m]`; infinite never does.
    pub threshold: [f64; N],
}

/// Momentum observer.
#[derive(Debug, Clone)]
pub struct MomentumObserver<const N: usize> {
    model: DriveModel<N>,
    config: MomentumObserverConfig<N>,
}

/// What a [`MomentumObserver`] remembers.
#[derive(Debug, Clone)]
pub struct MomentumObserverState<const N: usize> {
    model: DriveModelState,
    tau_ext: [f64; N],
    last: Option<End<N>>,
}

/// The robot at one end of a period.
#[derive(Debug, Clone, Copy)]
struct End<const N: usize> {
    mass: [[f64; N]; N],
    nle: [f64; N],
    v: [f64; N],
}

/// Effort from outside.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Outside<const N: usize> {
    /// Residual: effort from outside, low-passed `[N | N·m]`. Positive pushes the drive forward.
    pub tau_ext: [f64; N],
    /// Drives whose residual is beyond its threshold.
    pub is_touched: [bool; N],
    /// A number was not finite or the loops did not close: the residual is the last one that could be computed.
    pub is_held: bool,
}

impl<const N: usize> MomentumObserver<N> {
    /// On `robot`, with as many drives as freedoms.
    ///
    /// # Errors
    /// Rates that are not positive and finite, thresholds that are not positive, a robot without `N` drives and freedoms or whose loops
    /// do not close.
    pub fn try_new(robot: Robot, config: MomentumObserverConfig<N>) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("rate", &config.rate)?;
        let (what, limit) = ("threshold", "must be > 0");
        if let Some(drive) = config.threshold.iter().position(|x| x.is_nan() || *x <= 0.0) {
            return Err(ConfigError { drive, what, value: config.threshold[drive], limit });
        }
        let model = DriveModel::try_new(robot)?;
        let freedoms = model.freedoms();
        if freedoms != N {
            return Err(ConfigError { drive: 0, what: "number of freedoms", value: freedoms as f64, limit: "must be that of drives" });
        }
        Ok(Self { model, config })
    }

    /// The state before the first sample: no effort from outside. Allocates.
    #[must_use]
    pub fn at_rest(&self) -> MomentumObserverState<N> {
        MomentumObserverState { model: self.model.at_rest(), tau_ext: [0.0; N], last: None }
    }

    /// Forgets the residual and the last sample: after a touch has been dealt with, or a gap in the samples.
    pub fn reset(&self, state: &mut MomentumObserverState<N>) {
        (state.tau_ext, state.last) = ([0.0; N], None);
    }

    /// One period of `dt` `[s]` under the efforts `tau` `[N | N·m]` ended at positions `q` `[m | rad]` and velocities `v`
    /// `[m/s | rad/s]`. Never fails, never allocates.
    pub fn step(&self, state: &mut MomentumObserverState<N>, [q, v, tau]: [&[f64; N]; 3], dt: f64) -> Outside<N> {
        let end = if must_be_usable(&[q, v, tau], dt).is_ok() { self.end(state, q, v) } else { None };
        if let (Some(end), Some(last)) = (end, state.last) {
            for (k, tau_ext) in state.tau_ext.iter_mut().enumerate() {
                let mean = |i: usize| 0.5 * (end.mass[k][i] + last.mass[k][i]) * (end.v[i] - last.v[i]);
                let inertial: f64 = (0..N).map(mean).sum::<f64>() / dt;
                let left = inertial + 0.5 * (end.nle[k] + last.nle[k]) - tau[k];
                *tau_ext += low_pass_share(1.0 / self.config.rate[k], dt) * (left - *tau_ext);
            }
        }
        state.last = end;
        let is_touched = core::array::from_fn(|k| state.tau_ext[k].abs() > self.config.threshold[k]);
        Outside { tau_ext: state.tau_ext, is_touched, is_held: end.is_none() }
    }

    fn end(&self, state: &mut MomentumObserverState<N>, q: &[f64; N], v: &[f64; N]) -> Option<End<N>> {
        let nle = self.model.effort(&mut state.model, [q, v, &[0.0; N]], v).ok()?;
        let mass = self.model.mass(&mut state.model);
        mass.iter().flatten().all(|x| x.is_finite()).then_some(End { mass, nle, v: *v })
    }
}
