//! A recording once more, by simulation: what a robot would have recorded along the same references.

use pkm_dyn::effects::Robot;
use pkm_dyn::parameters::InertialParameters;
use pkm_ident::Recording;

use crate::error::SimError;
use crate::playback::Playback;
use crate::reference::Sample;
use crate::scenario::{Scenario, run_along};
use crate::trajectory::Trajectory;

/// Stamps further than this share of a period from the simulated ones are interpolated.
const ON_GRID: f64 = 1e-3;

/// What the first of `robots` would have recorded along the references (`q_ref.*`) of `like`, under a controller that knows the second,
/// with perfect sensors: `q.*` and `tau.*` at the stamps of `like`. Gravity and load that `like` states hold for both.
///
/// The controller is that of [`crate::run`], whatever moved the robot in `like`.
///
/// # Errors
/// A recording without references, and everything a simulation can fail with.
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
    let stated = [truth, nominal].map(|robot| under_stated_conditions(robot, like));
    let scenario = Scenario {
        duration_s: like.duration(),
        rate_hz: like.len().saturating_sub(1) as f64 / like.duration(),
        encoder_resolution: 0.0,
        encoder_noise: 0.0,
        effort_noise: 0.0,
        ..Scenario::default()
    };
    let said = run_along([&stated[0], &stated[1]], &scenario, &reference, &mut |_| {})?;
    let start = like.time.first().copied().unwrap_or(0.0);
    let limit = ON_GRID / scenario.rate_hz;
    let is_on_grid = said.len() == like.len() && said.time.iter().zip(&like.time).all(|(a, b)| (a + start - b).abs() < limit);
    let mut out = Recording { name: like.name.clone(), time: like.time.clone(), meta: like.meta.clone(), ..Recording::default() };
    for &j in &model.actuators {
        for kind in ["q", "tau"] {
            let column = format!("{kind}.{}", model.joints[j].name);
            let signal = said.signal(&column).unwrap_or_default().to_vec();
            let signal = if is_on_grid { signal } else { at_stamps(&said.time, signal, like, start)? };
            out.signals.insert(column, signal);
        }
    }
    Ok(out)
}

fn at_stamps(time: &[f64], signal: Vec<f64>, like: &Recording, start: f64) -> Result<Vec<f64>, SimError> {
    let spline = Playback::try_new(time, vec![signal])?;
    let mut sample = Sample::default();
    let value = |t: &f64| {
        spline.at(t - start, &mut sample);
        sample.q[0]
    };
    Ok(like.time.iter().map(value).collect())
}

/// The robot with the gravity and the load that the recording states.
fn under_stated_conditions(robot: &Robot, like: &Recording) -> Robot {
    let mut out = robot.clone();
    if let Some(g) = like.meta.gravity {
        out.model.gravity = g.into();
    }
    if let Some(load) = &like.meta.load
        && let Some(link) = out.model.link_index(&load.link)
    {
        let body = InertialParameters::from_centre_of_mass(load.mass, load.xyz.into(), nalgebra::Matrix3::zeros());
        let sum = out.model.links[link].parameters.joined(&body);
        out.model.set_link_parameters(link, sum);
    }
    out
}
