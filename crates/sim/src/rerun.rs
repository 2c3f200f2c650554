//! A recording once more, by simulation: what a robot would have recorded along the same references.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;

use crate::error::SimError;
use crate::playback::Playback;
use crate::replay::{between, rate_hz, under_stated_conditions};
use crate::scenario::{Scenario, run_along};

/// Stamps further than this share of a period from the simulated ones are interpolated.
const ON_GRID: f64 = 1e-3;

/// What the first of `robots` would have recorded along the references (`q_ref.*`) of `like`, under a controller that knows the second,
/// with perfect sensors: `q.*` and `tau.*` at the stamps of `like`. Gravity and load that `like` states hold for both.
///
/// The controller is that of [`crate::run`], whatever moved the robot in `like`.
///
/// # Errors
/// A recording without references or with a load on a link that is none, and everything a simulation can fail with.
pub fn rerun(robots: [&Robot; 2], like: &Recording) -> Result<Recording, SimError> {
    let [truth, nominal] = robots;
    let model = &nominal.model;
    let mut q_ref = Vec::new();
    for &j in &model.actuators {
        let column = format!("q_ref.{}", model.joints[j].name);
        let Some(signal) = like.signal(&column) else { return Err(SimError::NoReference { column }) };
        q_ref.push(signal.to_vec());
    }
    let reference = Playback::try_new(&like.time, q_ref)?;
    let (truth, nominal) = (under_stated_conditions(truth, like)?, under_stated_conditions(nominal, like)?);
    let scenario = Scenario {
        duration_s: like.duration(),
        rate_hz: rate_hz(like),
        encoder_resolution: 0.0,
        encoder_noise: 0.0,
        effort_noise: 0.0,
        ..Scenario::default()
    };
    let said = run_along([&truth, &nominal], &scenario, &reference, &mut |_| {})?;
    let start = like.time.first().copied().unwrap_or(0.0);
    let limit = ON_GRID / scenario.rate_hz;
    let is_on_grid = said.len() == like.len() && said.time.iter().zip(&like.time).all(|(a, b)| (a + start - b).abs() < limit);
    let mut out = Recording { name: like.name.clone(), time: like.time.clone(), meta: like.meta.clone(), ..Recording::default() };
    for &j in &model.actuators {
        for kind in ["q", "tau"] {
            let column = format!("{kind}.{}", model.joints[j].name);
            let signal = said.signal(&column).unwrap_or_default().to_vec();
            let value = |t: &f64| between(&said.time, &signal, t - start);
            let signal = if is_on_grid { signal } else { like.time.iter().map(value).collect() };
            out.signals.insert(column, signal);
        }
    }
    Ok(out)
}
