//! The simulator that a diagnosis replays recordings in.

use pkm_ctrl::{Running, config};
use pkm_diagnose::{Simulation, Twin};
use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_sim::replay::rate_hz;
use pkm_sim::twin::{Follow, TwinJoint, twin_along};
use pkm_sim::{PlantKind, Setup};

use crate::simulate::controller::ControllerArgs;

/// Replays under the controller of a file, or under the PD of `pkm simulate`.
pub(crate) struct Simulated<'a> {
    /// Which controller.
    pub(crate) controller: &'a ControllerArgs,
}

impl Simulated<'_> {
    /// The recorded reference under the controller that followed it. Another controller would leave other errors of its own, so without
    /// its file, or without a reference, the measured motion is followed, with what it has in the band of the comparison.
    fn follow(&self, robot: &Robot, recording: &Recording, band_hz: f64) -> Follow {
        let model = &robot.model;
        let has_reference = |j: &usize| {
            let column = recording.signal(&format!("q_ref.{}", model.joints[*j].name));
            column.is_some_and(|c| c.iter().all(|x| x.is_finite()))
        };
        let is_known = self.controller.path().is_some();
        if is_known && model.actuators.iter().all(has_reference) { Follow::Reference } else { Follow::Measured(2.0 * band_hz) }
    }
}

impl Twin for Simulated<'_> {
    fn about(&self, nominal: &Robot, recording: &Recording) -> String {
        match (self.follow(nominal, recording, 1.0), self.controller.path()) {
            (Follow::Reference, Some(path)) => format!("Simulated without noise along the recorded reference under {}", path.display()),
            _ => "Simulated without noise, held to the measured motion by computed torque that knows the simulated robot \
                  (--controller FILE replays the recorded reference under the controller that ran)"
                .to_string(),
        }
    }

    fn replay(&self, [truth, nominal]: [&Robot; 2], recording: &Recording, band_hz: f64) -> Result<Vec<Simulation>, String> {
        let follow = self.follow(nominal, recording, band_hz);
        let line = |e: anyhow::Error| format!("{e:#}");
        let (knows, controller) = match follow {
            Follow::Reference => (nominal, self.controller.read(nominal).map_err(line)?.map(|(_, c)| c)),
            Follow::Measured(_) => (truth, Some(holder(truth, recording, band_hz)?)),
        };
        let setup = Setup { robots: [truth, knows], laws: Vec::new(), controller, watch: None };
        let found = twin_along(setup, recording, PlantKind::Auto, follow).map_err(|e| e.to_string())?;
        let first = recording.time.first().copied().unwrap_or(0.0);
        let times: Vec<f64> = recording.time.iter().map(|t| t - first).collect();
        let joint = |j: &TwinJoint| {
            let of = |kind: &str| found.at(&format!("{kind}.{}", j.joint), &times).unwrap_or_default();
            Simulation { joint: j.joint.clone(), q: of("q"), tau: of("tau") }
        };
        Ok(found.joints.iter().map(joint).collect())
    }
}

/// Loop bandwidth over the band of the comparison. The controller feeds the motion forward, so what feedback has to do is little; a
/// faster loop would not bear the lags and delays that the simulated robot may have.
const STIFF: f64 = 4.0;

/// Computed torque that holds a robot to its motion.
fn holder(robot: &Robot, recording: &Recording, band_hz: f64) -> Result<Box<dyn Running>, String> {
    let recorded = rate_hz(recording);
    let bandwidth = STIFF * core::f64::consts::TAU * band_hz;
    // A whole multiple of the recording's rate, fast enough for the loop.
    let rate = recorded * (4.0 * bandwidth / recorded).ceil().max(1.0);
    let text = format!("law = \"computed_torque\"\nrate_hz = {rate:?}\nbandwidth = {bandwidth:?}\n");
    config::parse(&text, "the controller of the replay", robot).map_err(|e| e.to_string())
}
