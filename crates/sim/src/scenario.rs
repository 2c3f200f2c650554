//! One run: a true robot under a controller that knows only the nominal one, and what a recorder writes meanwhile.

use pkm_ctrl::{Controller, Input, PdGravity, PdGravityConfig, PdGravityState};
use pkm_dyn::Data;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::model::Model;
use pkm_ident::{EffortKind, Recording};

use crate::actuators::ActuatorChain;
use crate::dae::{ConstrainedOptions, ConstrainedPlant};
use crate::error::SimError;
use crate::plant::{Plant, ReducedPlant, check, has_states};
use crate::random::{Random, Stream};
use crate::reference::{Reference, ReferenceOptions, Sample};
use crate::sensors::{Encoder, add_noise};
use crate::trajectory::Trajectory;

/// The controller runs at this rate or the next one above that is a multiple of the recording's `[Hz]`.
const CONTROL_HZ: f64 = 1000.0;

/// Plant steps per control period: at 1 kHz the leapfrog's error is then below 1e-5 of the efforts.
const SUBSTEPS: usize = 2;

/// Bandwidth of the position loop `[rad/s]` (8 Hz): stable with the lags and delays of common drives, stiff enough to track.
const BANDWIDTH: f64 = 50.0;

/// Damping ratio of the position loop.
const DAMPING: f64 = 0.9;

/// Time constant of the controller's velocity filter `[s]`.
const FILTER_S: f64 = 1e-3;

/// Longest run `[samples of the controller]`: five hours at 1 kHz.
const MAX_STEPS: f64 = 2e7;

/// A motion that begins slower than this begins at rest `[m/s | rad/s]`: its velocity is a rounding error.
const AT_REST: f64 = 1e-9;

/// Progress is told so often `[s of the motion]`.
const TOLD_S: f64 = 0.1;

/// Which plant moves the true robot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PlantKind {
    /// The reduced one where it is right, the constrained one where an effect has states or freedoms of its own ([`needs_states`]).
    #[default]
    Auto,
    /// [`ReducedPlant`].
    Reduced,
    /// [`ConstrainedPlant`].
    Constrained(ConstrainedOptions),
}

impl PlantKind {
    /// The plant for a robot at rest at `start`, moving at `velocity`, both per drive `[m | rad]`, `[m/s | rad/s]`.
    ///
    /// # Errors
    /// Whatever the plant does not start with; the reduced plant with effects that have states.
    pub fn build(self, truth: &Robot, seed: u64, start: &[f64], velocity: &[f64]) -> Result<Box<dyn Plant>, SimError> {
        let is_moving = velocity.iter().any(|v| v.abs() > AT_REST);
        let options = match self {
            Self::Constrained(options) => options,
            Self::Auto if needs_states(truth) => ConstrainedOptions { seed, ..ConstrainedOptions::default() },
            Self::Auto | Self::Reduced => {
                let mut plant = ReducedPlant::try_new(truth.clone(), start)?;
                if is_moving {
                    plant.set_velocity(velocity);
                }
                return Ok(Box::new(plant));
            }
        };
        let mut plant = ConstrainedPlant::try_new(truth.clone(), start, options)?;
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
        let steps = self.duration_s * self.rate_hz * self.steps_per_sample();
        if steps > MAX_STEPS {
            return Err(SimError::Scenario { what: "duration_s", value: self.duration_s, limit: "too long: over 2e7 control periods" });
        }
        Ok(())
    }

    fn steps_per_sample(&self) -> f64 {
        (CONTROL_HZ / self.rate_hz - 1e-6).ceil().max(1.0)
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
    let reference = Reference::draw(&nominal.model, &scenario.reference_options())?;
    let share = |t: f64| (t / scenario.duration_s).min(1.0);
    let mut last = 0.0;
    let recording = run_along([truth, nominal], scenario, &reference, &mut |t| {
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
    let [truth, nominal] = robots;
    scenario.check()?;
    same_mechanism(&truth.model, &nominal.model)?;
    let per_sample = scenario.steps_per_sample();
    let period = 1.0 / (scenario.rate_hz * per_sample);
    let per_sample = whole(per_sample);
    let steps = whole((scenario.duration_s * scenario.rate_hz).round()) * per_sample;
    let mut world = World::try_new(truth, nominal, scenario, reference, period)?;
    let mut log = Log::new(world.drives.len());
    for step in 0..=steps {
        let t = period * step as f64;
        each(t);
        world.control(reference, t)?;
        log.record(&world, step % per_sample == 0);
        if step < steps {
            world.advance()?;
        }
    }
    Ok(log.finish(&world, &nominal.model, scenario, per_sample))
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

/// One drive with its controller, actuator chain and encoder.
struct Drive {
    controller: PdGravity<1>,
    state: PdGravityState<1>,
    chain: ActuatorChain,
    encoder: Encoder,
    reading: f64,
    command: f64,
}

struct World<'r> {
    plant: Box<dyn Plant>,
    nominal: &'r Model,
    nominal_data: Data,
    drives: Vec<Drive>,
    sample: Sample,
    random: Random,
    period: f64,
    tau: Vec<f64>,
    zero: Vec<f64>,
}

impl<'r> World<'r> {
    fn try_new(truth: &Robot, nominal: &'r Robot, scenario: &Scenario, reference: &dyn Trajectory, period: f64) -> Result<Self, SimError> {
        let model = &nominal.model;
        let mut sample = Sample::default();
        reference.at(0.0, &mut sample);
        if sample.q.len() != model.n_act() {
            return Err(SimError::NotTheSameRobot { what: "number of drives" });
        }
        let gains = mass_at_mid_pose(model)?;
        let mut drives = Vec::new();
        for (&j, mass) in model.actuators.iter().zip(gains) {
            let limit = model.joints[j].limits.effort;
            let config = PdGravityConfig {
                kp: [mass * BANDWIDTH * BANDWIDTH],
                kd: [mass * 2.0 * DAMPING * BANDWIDTH],
                tau_limit: [if limit.is_finite() && limit > 0.0 { limit } else { f64::MAX }],
                dt: period,
                filter_s: FILTER_S,
            };
            drives.push(Drive {
                controller: PdGravity::try_new(config)?,
                state: PdGravityState::default(),
                chain: ActuatorChain::try_new(truth, j, period)?,
                encoder: Encoder::new(truth, j, scenario.encoder_resolution, scenario.encoder_noise),
                reading: 0.0,
                command: 0.0,
            });
        }
        let start: Vec<f64> = sample.q.iter().zip(&drives).map(|(q, d)| d.encoder.true_position(*q)).collect();
        let n = drives.len();
        let mut nominal_data = Data::new(model);
        for closure in [assemble(model, &mut nominal_data), walk_to(model, &mut nominal_data, &sample.q)] {
            check(&closure, 0.0)?;
        }
        let plant = scenario.plant.build(truth, scenario.seed, &start, &sample.v)?;
        Ok(Self {
            plant,
            nominal: model,
            nominal_data,
            drives,
            sample,
            random: Random::new(scenario.seed, Stream::Encoders),
            period,
            tau: vec![0.0; n],
            zero: vec![0.0; n],
        })
    }

    /// Reads the sensors and computes the commands of the period that begins at `t`.
    fn control(&mut self, reference: &dyn Trajectory, t: f64) -> Result<(), SimError> {
        reference.at(t, &mut self.sample);
        let Self { nominal_data, sample, zero, .. } = self;
        let closure = inverse_dynamics(self.nominal, nominal_data, &sample.q, zero, zero);
        check(&closure, t)?;
        for (k, drive) in self.drives.iter_mut().enumerate() {
            drive.reading = drive.encoder.read(self.plant.position()[k], t, &mut self.random);
            let input = Input {
                q_ref: [self.sample.q[k]],
                v_ref: [self.sample.v[k]],
                tau_ff: [self.nominal_data.tau_act[k]],
                ..Input::standing([drive.reading], self.period)
            };
            let is_first = t <= 0.0;
            drive.command = drive.controller.step(&mut drive.state, &input).tau[0];
            if is_first {
                drive.chain.settle(drive.command);
            }
            drive.chain.push(drive.command);
        }
        Ok(())
    }

    /// Moves the plant on by one control period.
    fn advance(&mut self) -> Result<(), SimError> {
        let h = self.period / SUBSTEPS as f64;
        for part in 0..SUBSTEPS {
            for (tau, drive) in self.tau.iter_mut().zip(&mut self.drives) {
                *tau = drive.chain.mean_over(h * part as f64, h);
            }
            self.plant.step(&self.tau, h)?;
        }
        Ok(())
    }
}

/// Diagonal of the nominal mass matrix in the middle of travel `[kg | kg·m²]`; what the gains are scaled with.
fn mass_at_mid_pose(model: &Model) -> Result<Vec<f64>, SimError> {
    let mut data = Data::new(model);
    let (n, middle) = (model.n_act(), mid_pose(model));
    let zero = vec![0.0; n];
    for closure in [assemble(model, &mut data), walk_to(model, &mut data, &middle)] {
        check(&closure, 0.0)?;
    }
    let mut effort = |a: &[f64], k: usize| -> Result<f64, SimError> {
        check(&inverse_dynamics(model, &mut data, &middle, &zero, a), 0.0)?;
        Ok(data.tau_act[k])
    };
    let mut masses = Vec::new();
    for k in 0..n {
        let mut unit = zero.clone();
        unit[k] = 1.0;
        masses.push(effort(&unit, k)? - effort(&zero, k)?);
    }
    Ok(masses)
}

/// Signals by drive.
struct Log {
    time: Vec<f64>,
    /// Commands of every control period: efforts are averaged over them.
    commands: Vec<Vec<f64>>,
    readings: Vec<Vec<f64>>,
    q_ref: Vec<Vec<f64>>,
    v_ref: Vec<Vec<f64>>,
    steps: usize,
}

impl Log {
    fn new(n: usize) -> Self {
        let empty = vec![Vec::new(); n];
        Self { time: Vec::new(), commands: empty.clone(), readings: empty.clone(), q_ref: empty.clone(), v_ref: empty, steps: 0 }
    }

    fn record(&mut self, world: &World, is_sample: bool) {
        for (k, drive) in world.drives.iter().enumerate() {
            self.commands[k].push(drive.command);
            if is_sample {
                self.readings[k].push(drive.reading);
                self.q_ref[k].push(world.sample.q[k]);
                self.v_ref[k].push(world.sample.v[k]);
            }
        }
        if is_sample {
            self.time.push(world.period * self.steps as f64);
        }
        self.steps += 1;
    }

    fn finish(self, world: &World, model: &Model, scenario: &Scenario, per_sample: usize) -> Recording {
        let mut out = Recording { name: format!("{}, simulated", model.name), ..Recording::default() };
        let mut random = Random::new(scenario.seed, Stream::Efforts);
        let columns = self.readings.into_iter().zip(self.q_ref).zip(self.v_ref);
        for (k, ((readings, q_ref), v_ref)) in columns.enumerate() {
            let late = world.drives[k].chain.recording_delay() / world.period;
            let mut tau: Vec<f64> = (0..self.time.len()).map(|i| measured(&self.commands[k], (i * per_sample) as f64 - late)).collect();
            let share = world.drives[k].chain.recorded_share();
            tau.iter_mut().for_each(|tau| *tau *= share);
            add_noise(&mut tau, scenario.effort_noise, &mut random);
            let joint = &model.joints[model.actuators[k]].name;
            for (prefix, column) in [("q", readings), ("tau", tau), ("q_ref", q_ref), ("dq_ref", v_ref)] {
                out.signals.insert(format!("{prefix}.{joint}"), column);
            }
        }
        out.meta.tau = Some(EffortKind::Measured);
        out.meta.other.insert("simulated_seed".to_string(), scenario.seed.to_string());
        out.time = self.time;
        out
    }
}

/// Mean of the held commands over one control period on either side of time `at` (in periods).
///
/// A current sensor integrates; and taken on one side only, the hold would look like half a period of delay.
fn measured(commands: &[f64], at: f64) -> f64 {
    let floor = at.floor();
    let share = at - floor;
    let command = |i: f64| commands[whole(i.max(0.0)).min(commands.len() - 1)];
    0.5 * ((1.0 - share) * command(floor - 1.0) + command(floor) + share * command(floor + 1.0))
}
