//! Recordings of simulated robots.

use alloc::sync::Arc;

use pkm_dyn::effects::Robot as Physics;
use pkm_ident::Recording as Signals;
use pkm_sim::{Playback, Scenario, check_limits};
use pyo3::prelude::*;

use crate::dynamics::Robot;
use crate::error;
use crate::long::{self, Progress};
use crate::recording::Recording;

/// Moves `truth` under a controller that knows only `nominal` and returns what a recorder would have written.
///
/// `seed`: of motion and noise (1); `duration_s`: length `[s]` (20); `rate_hz`: of the recording `[Hz]` (500); `period_s`: of the
/// motion `[s]` (5); `amplitude`: share of the travel used, 0 to 1 (0.6); `encoder_resolution`, `encoder_noise`: `[m | rad]` (1e-6
/// both); `effort_noise`: standard deviation as a share of the effort's rms (0.01); `name`: of the recording; `reference`: a recording whose
/// `q_ref.*`, or else `q.*`, is followed from end to end in place of a motion drawn by chance; `progress`: called with
/// the share done, 0 to 1, or True for a bar. The same arguments give the same bits.
#[pyfunction]
#[pyo3(signature = (truth, nominal, *, seed = None, duration_s = None, rate_hz = None, period_s = None, amplitude = None,
    encoder_resolution = None, encoder_noise = None, effort_noise = None, name = None, reference = None, progress = None))]
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
    reference: Option<&Bound<'_, Recording>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Recording> {
    let usual = Scenario::default();
    let playback = reference.map(|r| played(&nominal.get().description().robot, r.get().signals())).transpose()?;
    let duration_s = duration_s.or_else(|| playback.as_ref().map(Playback::duration_s));
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
    let ran = long::run(py, &progress, move |told| match playback {
        None => pkm_sim::run(&truth.robot, &nominal.robot, &scenario, &mut |share| told(share)),
        Some(motion) => {
            let ran =
                pkm_sim::run_along([&truth.robot, &nominal.robot], &scenario, &motion, &mut |t| told((t / scenario.duration_s).min(1.0)));
            told(1.0);
            ran
        }
    })?;
    let mut signals = ran.map_err(|e| error::sim(&e))?;
    if let Some(name) = name {
        signals.name = name;
    }
    Ok(Recording::new(signals))
}

/// The motion of a recording's references, or where it has none of its positions, within the robot's limits.
fn played(robot: &Physics, recording: &Signals) -> PyResult<Playback> {
    let model = &robot.model;
    let column = |j: &usize| {
        let joint = &model.joints[*j].name;
        let found = recording.signal(&format!("q_ref.{joint}")).or_else(|| recording.signal(&format!("q.{joint}")));
        found.map(<[f64]>::to_vec).ok_or_else(|| error::value(format!("reference {:?}: no q_ref.{joint} and no q.{joint}", recording.name)))
    };
    let columns = model.actuators.iter().map(column).collect::<PyResult<Vec<_>>>()?;
    let motion = Playback::try_new(&recording.time, columns).map_err(|e| error::sim(&e))?;
    check_limits(model, &motion, motion.duration_s()).map_err(|e| error::sim(&e))?;
    Ok(motion)
}
