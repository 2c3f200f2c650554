//! One run: a true robot under a controller that knows only the nominal one, and what a recorder writes meanwhile.

mod commands;
mod drive_pds;
mod instrumented;
mod log;
mod pilot;
mod rates;
mod world;

use pkm_ctrl::Running;
use pkm_dyn::effects::Robot;
use pkm_dyn::model::Model;
use pkm_ident::Recording;

use crate::consistent::{Consistent, has_surplus_drives};
use crate::dae::{ConstrainedOptions, ConstrainedPlant};
use crate::error::SimError;
use crate::laws::ForeignLaw;
use crate::plant::{Plant, ReducedPlant, has_states};
use crate::reference::{Reference, ReferenceOptions};
use crate::trajectory::Trajectory;
pub use commands::replay_commands;
pub use instrumented::{Instrumented, run_instrumented};
use log::Log;
pub use pilot::{Step, Watch};
use rates::Rates;
use world::World;

/// A motion that begins slower than this begins at rest `[m/s | rad/s]`: its velocity is a rounding error.
const AT_REST: f64 = 1e-9;

/// Progress is told so often `[s of the motion]`.
const TOLD_S: f64 = 0.1;

/// Which plant moves the true robot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PlantKind {
    /// The reduced one where it is right, the constrained one where an effect has states or freedoms of its own ([`needs_states`]) or where
    /// there are more drives than freedoms.
    #[default]
    Auto,
    /// [`ReducedPlant`].
    Reduced,
    /// [`ConstrainedPlant`].
    Constrained(ConstrainedOptions),
    /// [`crate::RapierPlant`].
    #[cfg(feature = "rapier")]
    Rapier(crate::RapierOptions),
}

impl PlantKind {
    /// The plant for a robot at rest at `start`, moving at `velocity`, both per drive `[m | rad]`, `[m/s | rad/s]`.
    ///
    /// # Errors
    /// Whatever the plant does not start with; the reduced plant with effects that have states.
    pub fn build(self, truth: &Robot, seed: u64, start: &[f64], velocity: &[f64]) -> Result<Box<dyn Plant>, SimError> {
        self.build_with_laws(truth, seed, start, velocity, Vec::new())
    }

    /// As [`PlantKind::build`], with laws that are not the catalogue's; they want the constrained plant.
    ///
    /// # Errors
    /// As [`PlantKind::build`]; the reduced plant with any such law.
    pub fn build_with_laws(
        self,
        truth: &Robot,
        seed: u64,
        start: &[f64],
        velocity: &[f64],
        laws: Vec<Box<dyn ForeignLaw>>,
    ) -> Result<Box<dyn Plant>, SimError> {
        let engine = match self {
            Self::Auto | Self::Constrained(_) => None,
            Self::Reduced => Some("the reduced plant"),
            #[cfg(feature = "rapier")]
            Self::Rapier(_) => Some("rapier"),
        };
        if let (Some(engine), Some(law)) = (engine, laws.first()) {
            let joint = truth.model.joints.get(law.joint()).map_or("", |j| j.name.as_str());
            let what = format!("the form of an effect at joint {joint:?}");
            return Err(SimError::NotRepresentable { engine, what, problem: "take the constrained one" });
        }
        let is_moving = velocity.iter().any(|v| v.abs() > AT_REST);
        let options = match self {
            Self::Constrained(options) => options,
            #[cfg(feature = "rapier")]
            Self::Rapier(options) => {
                let mut plant = crate::RapierPlant::try_new(truth.clone(), start, options)?;
                if is_moving {
                    plant.set_velocity(velocity)?;
                }
                return Ok(Box::new(plant));
            }
            Self::Auto if needs_states(truth) || has_surplus_drives(&truth.model) || !laws.is_empty() => {
                ConstrainedOptions { seed, ..ConstrainedOptions::default() }
            }
            Self::Auto | Self::Reduced => {
                let mut plant = ReducedPlant::try_new(truth.clone(), start)?;
                if is_moving {
                    plant.set_velocity(velocity);
                }
                return Ok(Box::new(plant));
            }
        };
        let mut plant = ConstrainedPlant::with_laws(truth.clone(), start, options, laws)?;
        if is_moving {
            plant.set_velocity(velocity);
        }
        Ok(Box::new(plant))
    }
}

/// Whether an effect of the robot has states, freedoms or a place that only [`ConstrainedPlant`] has.
#[must_use]
pub fn needs_states(robot: &Robot) -> bool {
    robot.effects.iter().any(|e| has_states(&e.entry.law))
}

/// What to simulate. The noise of every sensor is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scenario {
    /// Seed of motion and noise.
    pub seed: u64,
    /// Length of the recording `[s]`.
    pub duration_s: f64,
    /// Rate of the recording `[Hz]`.
    pub rate_hz: f64,
    /// Period of the motion `[s]`.
    pub period_s: f64,
    /// Share of the travel that the motion uses, 0 to 1.
    pub amplitude: f64,
    /// Width of an encoder count `[m | rad]`; 0 does not round.
    pub encoder_resolution: f64,
    /// Standard deviation of encoder noise `[m | rad]`.
    pub encoder_noise: f64,
    /// Standard deviation of effort noise, as a share of the effort's rms.
    pub effort_noise: f64,
    /// What moves the true robot.
    pub plant: PlantKind,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            seed: 1,
            duration_s: 20.0,
            rate_hz: 500.0,
            period_s: 5.0,
            amplitude: 0.6,
            encoder_resolution: 1e-6,
            encoder_noise: 1e-6,
            effort_noise: 0.01,
            plant: PlantKind::Auto,
        }
    }
}

impl Scenario {
    /// The motion this scenario asks for.
    #[must_use]
    pub fn reference_options(&self) -> ReferenceOptions {
        ReferenceOptions { seed: self.seed, period_s: self.period_s, amplitude: self.amplitude }
    }

    fn check(&self) -> Result<(), SimError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let not_negative = |x: f64| x.is_finite() && x >= 0.0;
        for (what, value, limit, is_good) in [
            ("duration_s", self.duration_s, "must be finite and > 0", positive(self.duration_s)),
            ("rate_hz", self.rate_hz, "must be finite and > 0", positive(self.rate_hz)),
            ("encoder_resolution", self.encoder_resolution, "must be finite and >= 0", not_negative(self.encoder_resolution)),
            ("encoder_noise", self.encoder_noise, "must be finite and >= 0", not_negative(self.encoder_noise)),
            ("effort_noise", self.effort_noise, "must be finite and >= 0", not_negative(self.effort_noise)),
        ] {
            if !is_good {
                return Err(SimError::Scenario { what, value, limit });
            }
        }
        Ok(())
    }
}

/// Who moves, and under which controller.
pub struct Setup<'r> {
    /// The true robot and the one that the controller knows.
    pub robots: [&'r Robot; 2],
    /// Laws of the true robot that are not the catalogue's; they want the constrained plant.
    pub laws: Vec<Box<dyn ForeignLaw>>,
    /// The controller, at its own rate; none is the PD of [`run`].
    pub controller: Option<Box<dyn Running>>,
    /// Who is told every step of the controller.
    pub watch: Option<Watch<'r>>,
}

impl<'r> Setup<'r> {
    /// The true robot and the nominal one under the PD of [`run`].
    #[must_use]
    pub fn new(robots: [&'r Robot; 2]) -> Self {
        Self { robots, laws: Vec::new(), controller: None, watch: None }
    }
}

/// Runs `truth` along the scenario's motion under a PD controller with the weight of `nominal` as feed-forward.
///
/// The recording holds `q.<joint>` as the encoders read it, `tau.<joint>` as a current measurement would (the mean command around the
/// sample's time, plus noise), `q_ref.<joint>` and `dq_ref.<joint>`. `progress` is told the share done, 0 to 1.
///
/// # Errors
/// A scenario out of range, two robots that are not the same mechanism, and everything a motion can fail with.
pub fn run(truth: &Robot, nominal: &Robot, scenario: &Scenario, progress: &mut dyn FnMut(f64)) -> Result<Recording, SimError> {
    scenario.check()?;
    same_mechanism(&truth.model, &nominal.model)?;
    let drawn = Reference::draw(&nominal.model, &scenario.reference_options())?;
    let reference: Box<dyn Trajectory + '_> = match has_surplus_drives(&nominal.model) {
        true => Box::new(Consistent::try_new(&nominal.model, Box::new(drawn))?),
        false => Box::new(drawn),
    };
    let share = |t: f64| (t / scenario.duration_s).min(1.0);
    let mut last = 0.0;
    let recording = run_along([truth, nominal], scenario, reference.as_ref(), &mut |t| {
        if t <= 0.0 || t - last >= TOLD_S {
            last = t;
            progress(share(t));
        }
    })?;
    progress(1.0);
    Ok(recording)
}

/// As [`run`] for any motion: `robots` are the true and the nominal one, period and amplitude of the scenario are not used. `each` is
/// told the time `[s]` before every control period, and may wait there. Limits are [`crate::check_limits`]' business.
///
/// # Errors
/// As [`run`]; a motion of another number of drives.
pub fn run_along(
    robots: [&Robot; 2],
    scenario: &Scenario,
    reference: &dyn Trajectory,
    each: &mut dyn FnMut(f64),
) -> Result<Recording, SimError> {
    run_with(Setup::new(robots), scenario, reference, each)
}

/// As [`run_along`] for any controller and any law. A controller holds its command until its next step; the recording's rate is its own.
///
/// # Errors
/// As [`run_along`]; a controller for another number of drives, one whose rate has no common multiple with the recording's, and its first
/// fault, which ends the run.
pub fn run_with(
    setup: Setup<'_>,
    scenario: &Scenario,
    reference: &dyn Trajectory,
    each: &mut dyn FnMut(f64),
) -> Result<Recording, SimError> {
    let [truth, nominal] = setup.robots;
    scenario.check()?;
    same_mechanism(&truth.model, &nominal.model)?;
    let rates = Rates::try_new(scenario, setup.controller.as_ref().map(|c| c.about().rate_hz))?;
    let mut world = World::try_new(setup, scenario, reference, &rates)?;
    let mut log = Log::new(world.drives.len());
    for step in 0..=rates.steps {
        let t = rates.period * step as f64;
        each(t);
        world.control(reference, t, step % rates.per_control == 0)?;
        log.record(&world, step % rates.per_sample == 0);
        if step < rates.steps {
            world.advance()?;
        }
    }
    Ok(log.finish(&world, &nominal.model, scenario, rates.per_sample))
}

fn same_mechanism(truth: &Model, nominal: &Model) -> Result<(), SimError> {
    let names = |m: &Model| m.joints.iter().map(|j| j.name.clone()).collect::<Vec<_>>();
    for (what, is_same) in [("joints", names(truth) == names(nominal)), ("actuators", truth.actuators == nominal.actuators)] {
        if !is_same {
            return Err(SimError::NotTheSameRobot { what });
        }
    }
    Ok(())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "counts checked against MAX_STEPS, never negative")]
fn whole(x: f64) -> usize {
    x as usize
}
