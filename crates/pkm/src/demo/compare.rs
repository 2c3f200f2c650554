//! The nominal and the refined robot in the simulator, along a motion that neither was fitted to.

use std::path::Path;

use anyhow::{Context, anyhow};
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::{Description, load};
use pkm_ident::Recording;
use pkm_ident::filter::LowPass;
use pkm_sim::Scenario;

/// Effort errors of two simulations against a recording, as shares of the recorded effort's rms.
#[derive(Debug, Clone, Copy)]
pub(super) struct Errors {
    /// The robot as it was believed to be.
    pub(super) nominal: f64,
    /// The robot with every finding in it.
    pub(super) refined: f64,
    /// Low-pass on all efforts `[Hz]`.
    pub(super) band_hz: f64,
}

/// Loads the refined robot from the file at `refined`, as any user would, runs it and the nominal one, and compares efforts.
///
/// `measured` is the recording of the same motion, with the low-pass `[Hz]` to compare below.
///
/// # Errors
/// A refined robot that does not load or does not run.
pub(super) fn on_second_motion(
    refined: &Path,
    nominal: &Description,
    scenario: &Scenario,
    measured: (&Recording, f64),
) -> anyhow::Result<Errors> {
    let name = refined.display().to_string();
    let loaded = load(refined)?;
    let quiet = Scenario { effort_noise: 0.0, ..*scenario };
    let simulate = |robot: &Robot| pkm_sim::run(robot, &nominal.robot, &quiet, &mut |_| {});
    let as_believed = simulate(&nominal.robot)?;
    let as_found = simulate(&loaded.robot).with_context(|| name)?;
    Ok(Errors { nominal: error(nominal, measured, &as_believed)?, refined: error(nominal, measured, &as_found)?, band_hz: measured.1 })
}

/// `sqrt(mean over drives of (rms(error) / rms(effort))²)`, the number that verdicts use.
fn error(robot: &Description, measured: (&Recording, f64), simulated: &Recording) -> anyhow::Result<f64> {
    let (recording, band_hz) = measured;
    let dt = recording.duration() / (recording.len().max(2) - 1) as f64;
    let filter = LowPass::new(band_hz, dt);
    let model = &robot.robot.model;
    let mut sum = 0.0;
    for &j in &model.actuators {
        let column = format!("tau.{}", model.joints[j].name);
        let signal = |r: &Recording| r.signal(&column).map(|x| filter.apply(x)).ok_or_else(|| anyhow!("{}: no column {column:?}", r.name));
        let (real, model) = (signal(recording)?, signal(simulated)?);
        let square = |x: &mut dyn Iterator<Item = f64>| x.map(|v| v * v).sum::<f64>();
        let off = square(&mut real.iter().zip(&model).map(|(r, m)| r - m));
        sum += off / square(&mut real.iter().copied()).max(f64::MIN_POSITIVE);
    }
    Ok((sum / model.n_act() as f64).sqrt())
}
