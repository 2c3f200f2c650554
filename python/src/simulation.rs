//! Recordings of simulated robots.

use alloc::sync::Arc;

use pkm_sim::Scenario;
use pyo3::prelude::*;

use crate::dynamics::Robot;
use crate::error;
use crate::long::{self, Progress};
use crate::recording::Recording;

/// Moves `truth` under a controller that knows only `nominal` and returns what a recorder would have written.
///
/// `seed`: of motion and noise (1); `duration_s`: length `[s]` (20); `rate_hz`: of the recording `[Hz]` (500); `period_s`: of the
/// motion `[s]` (5); `amplitude`: share of the travel used, 0 to 1 (0.6); `encoder_resolution`, `encoder_noise`: `[m | rad]` (1e-6
/// both); `effort_noise`: standard deviation as a share of the effort's rms (0.01); `name`: of the recording; `progress`: called with
/// the share done, 0 to 1, or True for a bar. The same arguments give the same bits.
#[pyfunction]
#[pyo3(signature = (truth, nominal, *, seed = None, duration_s = None, rate_hz = None, period_s = None, amplitude = None,
    encoder_resolution = None, encoder_noise = None, effort_noise = None, name = None, progress = None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python: the fields of a scenario by name")]
pub(crate) fn simulate(
    py: Python<'_>,
    truth: &Bound<'_, Robot>,
    nominal: &Bound<'_, Robot>,
    seed: Option<u64>,
    duration_s: Option<f64>,
    rate_hz: Option<f64>,
    period_s: Option<f64>,
    amplitude: Option<f64>,
    encoder_resolution: Option<f64>,
    encoder_noise: Option<f64>,
    effort_noise: Option<f64>,
    name: Option<String>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Recording> {
    let usual = Scenario::default();
    let scenario = Scenario {
        seed: seed.unwrap_or(usual.seed),
        duration_s: duration_s.unwrap_or(usual.duration_s),
        rate_hz: rate_hz.unwrap_or(usual.rate_hz),
        period_s: period_s.unwrap_or(usual.period_s),
        amplitude: amplitude.unwrap_or(usual.amplitude),
        encoder_resolution: encoder_resolution.unwrap_or(usual.encoder_resolution),
        encoder_noise: encoder_noise.unwrap_or(usual.encoder_noise),
        effort_noise: effort_noise.unwrap_or(usual.effort_noise),
        plant: pkm_sim::PlantKind::Auto,
    };
    let progress = Progress::of(py, progress, "simulating")?;
    let [truth, nominal] = [truth, nominal].map(|r| Arc::clone(r.get().description()));
    let ran = long::run(py, &progress, move |told| pkm_sim::run(&truth.robot, &nominal.robot, &scenario, &mut |share| told(share)))?;
    let mut signals = ran.map_err(|e| error::sim(&e))?;
    if let Some(name) = name {
        signals.name = name;
    }
    Ok(Recording::new(signals))
}
