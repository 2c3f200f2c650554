//! A script around a position controller: hybrid control in the coordinates of the task, with a selection that fades.
//!
//! The commanded place `x_cmd` follows a path in one coordinate and the force loop in another, `x'_cmd = (1 − s)·x'_path + s·PID(f_ref − f)`;
//! the drives follow it through the inverse kinematics. A phase begins where the last one was, with the speed and the force it had.

use crate::controller::{Command, ConfigError, Controller, Input, first_not_finite};
use crate::exercise::channel::{Assistance, Channel, Path, Resistance, fade};
use crate::exercise::script::{Phase, Script};
use crate::fault::{FaultCode, Limit};
use crate::filter::low_pass_share;
use crate::force::explicit::check_limits;
use crate::force::held::Held;
use crate::force::pid::{ForcePid, ForcePidConfig, ForcePidState, usable_dt};
use crate::force::task::{Task, TaskMap};

/// Numbers of an [`Exercise`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExerciseConfig<const M: usize> {
    /// The phases.
    pub script: Script<M>,
    /// Force error to speed of the task `[m/s | rad/s]`.
    pub pid: ForcePidConfig<M>,
    /// Smallest coordinates of the task that are commanded `[m | rad]`.
    pub lower: [f64; M],
    /// Largest coordinates of the task that are commanded `[m | rad]`.
    pub upper: [f64; M],
}

/// A script around a position controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Exercise<const N: usize, const M: usize, K, C> {
    map: K,
    inner: C,
    config: ExerciseConfig<M>,
    pid: ForcePid<M>,
}

/// Time constant with which damping feels the commanded rate `[s]`: the rate is the force loop's own answer to the damping, and fed back
/// at once it would alternate from step to step.
const FELT_S: f64 = 0.05;

/// What an [`Exercise`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct ExerciseState<const N: usize, const M: usize, S, I> {
    map: S,
    inner: I,
    pid: ForcePidState<M>,
    /// Time since the start `[s]`.
    pub t: f64,
    /// Commanded coordinates of the task `[m | rad]`.
    pub x_cmd: [f64; M],
    /// Their rates `[m/s | rad/s]`.
    pub v_cmd: [f64; M],
    /// Wanted forces of the robot on the patient `[N | N·m]`; towards zero in coordinates that follow a path.
    pub f_ref: [f64; M],
    /// Index of the phase; none before the first step.
    pub phase: Option<usize>,
    paths: [Path; M],
    /// Share of the force loop and the measured force when the phase began.
    share_from: [f64; M],
    share: [f64; M],
    f_from: [f64; M],
    /// Learned part of an assistance `[N | N·m]`.
    learned: [f64; M],
    /// The commanded rate as damping feels it `[m/s | rad/s]`.
    felt: [f64; M],
    q_ref: [f64; N],
    held: Held<N>,
    is_inner_saturated: bool,
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Exercise<N, M, K, C> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// What [`ForcePid::try_new`] refuses; ranges that are empty or not finite; more damping than the force loop's `kp` can follow.
    pub fn try_new(map: K, inner: C, config: ExerciseConfig<M>) -> Result<Self, ConfigError> {
        for k in 0..M {
            check_limits("upper - lower", &[config.upper[k] - config.lower[k]])?;
        }
        let pid = ForcePid::try_new(config.pid)?;
        let share = low_pass_share(FELT_S, config.pid.dt);
        for channel in config.script.phases().flat_map(|p| p.channels.iter().enumerate()) {
            let (drive, Channel::Resist(Resistance { damping, .. }) | Channel::Assist(Assistance { damping, .. })) = channel else {
                continue;
            };
            // The pole of that loop, from rate to damping to rate, is 1 - share·(1 + kp·damping): it must not alternate for long.
            if share * (1.0 + config.pid.kp[drive] * damping) > 1.5 {
                return Err(ConfigError { drive, what: "damping", value: *damping, limit: "too much for the kp of the force loop" });
            }
        }
        Ok(Self { map, inner, pid, config })
    }

    /// A phase begins: from the commanded place and speed, the present share of the force loop and the measured force.
    fn begin(&self, state: &mut ExerciseState<N, M, K::State, C::State>, (index, phase): (usize, &Phase<M>), force: &[f64; M]) {
        for (k, channel) in phase.channels.iter().enumerate() {
            let (x, v) = (state.x_cmd[k], state.v_cmd[k]);
            state.paths[k] = match channel {
                Channel::Position(wave) | Channel::Assist(Assistance { path: wave, .. }) => Path::new(x, v, wave.mean, phase.ramp_s),
                Channel::Force(_) | Channel::Resist(_) => Path::new(x, v, x + 0.5 * v * phase.ramp_s, phase.ramp_s),
            };
            state.learned[k] = 0.0;
        }
        state.share_from = state.share;
        state.f_from = *force;
        state.phase = Some(index);
    }

    /// The coordinates of the task one period later.
    fn advance(&self, state: &mut ExerciseState<N, M, K::State, C::State>, task: &Task<N, M>, force: &[f64; M], dt: f64) {
        let Some((index, since, phase)) = self.config.script.at(state.t) else { return };
        if state.phase != Some(index) {
            self.begin(state, (index, phase), force);
        }
        let (mut error, mut path_speed) = ([0.0; M], [0.0; M]);
        let into = fade(since, phase.ramp_s);
        let felt = low_pass_share(FELT_S, dt);
        for k in 0..M {
            let wanted = if phase.channels[k].follows_force() { 1.0 } else { 0.0 };
            state.share[k] = state.share_from[k] + (wanted - state.share_from[k]) * into;
            state.felt[k] += felt * (state.v_cmd[k] - state.felt[k]);
            let (x, v) = (task.x[k], state.felt[k]);
            let [mut along, mut speed] = state.paths[k].at(since);
            // Waves come in when the ramp is over, with their slope faded in over one more.
            let after = since - phase.ramp_s;
            let mut ride = |wave: [f64; 2], zero: f64| {
                if after > 0.0 {
                    let soft = fade(after, phase.ramp_s);
                    along += soft * (wave[0] - zero);
                    speed += soft * wave[1];
                }
            };
            let force_ref = match &phase.channels[k] {
                Channel::Position(wave) => {
                    ride(wave.at(after), wave.mean);
                    0.0
                }
                Channel::Force(wave) => wave.at(since)[0],
                Channel::Resist(r) => r.load - r.stiffness * (x - r.centre) - r.damping * v,
                Channel::Assist(a) => {
                    ride(a.path.at(after), a.path.mean);
                    help(a, &mut state.learned[k], along - x, dt) - a.damping * (v - speed)
                }
            };
            state.f_ref[k] = state.f_from[k] + (force_ref - state.f_from[k]) * into;
            error[k] = state.share[k] * (state.f_ref[k] - force[k]);
            if state.share[k] <= 0.0 {
                state.pid.rest(k);
            }
            path_speed[k] = match phase.channels[k] {
                // Follow the path's place, not only its speed: after a force phase the two differ by rounding only.
                Channel::Position(_) => speed + (along - state.x_cmd[k]) / dt,
                // Let the last motion run out while the force loop comes in.
                Channel::Force(_) | Channel::Resist(_) | Channel::Assist(_) => state.paths[k].at(since)[1],
            };
        }
        let (loop_speed, _) = self.pid.step(&mut state.pid, &error, dt);
        for k in 0..M {
            let share = state.share[k];
            let is_path = !phase.channels[k].follows_force();
            let v = if is_path && share <= 0.0 { path_speed[k] } else { (1.0 - share) * path_speed[k] + share * loop_speed[k] };
            let v = if state.is_inner_saturated && !is_path { 0.0 } else { v };
            // From outside its range it comes back along the path: the range as it is would be a step.
            let (lower, upper) = (self.config.lower[k].min(state.x_cmd[k]), self.config.upper[k].max(state.x_cmd[k]));
            let x = (state.x_cmd[k] + v * dt).clamp(lower, upper);
            state.v_cmd[k] = (x - state.x_cmd[k]) / dt;
            state.x_cmd[k] = x;
        }
    }
}

/// Help for an error: elastic beyond the tolerance, and what has been learned.
fn help(a: &Assistance, learned: &mut f64, error: f64, dt: f64) -> f64 {
    let beyond = error - error.clamp(-a.tolerance, a.tolerance);
    *learned += dt * (a.learning * beyond - *learned / a.forgetting_s);
    *learned = learned.clamp(-a.most, a.most);
    (a.stiffness * beyond + *learned).clamp(-a.most, a.most)
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Controller<N> for Exercise<N, M, K, C> {
    type State = ExerciseState<N, M, K::State, C::State>;

    const FOLLOWS_REFERENCE: bool = false;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; M];
        ExerciseState {
            map: self.map.at_rest(),
            inner: self.inner.at_rest(),
            pid: ForcePidState::default(),
            t: 0.0,
            x_cmd: zero,
            v_cmd: zero,
            f_ref: zero,
            phase: None,
            paths: [Path::new(0.0, 0.0, 0.0, 0.0); M],
            share_from: zero,
            share: zero,
            f_from: zero,
            learned: zero,
            felt: zero,
            q_ref: [0.0; N],
            held: Held::new(),
            is_inner_saturated: false,
        }
    }

    /// One period. The script starts at the measured pose; references of `input` are not looked at, `tau_ff` is.
    ///
    /// After a fault the inner controller holds the reference it had, and its clipped command carries the robot. Where the task cannot be
    /// known, or a place is out of reach, the script waits and the drives hold. A robot that stands outside the range of its coordinates is
    /// led back by the script and no further out.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let signals = [
            (FaultCode::WrenchNotFinite, &input.wrench_meas[..]),
            (FaultCode::ReferenceNotFinite, &input.wrench_ref),
            (FaultCode::PositionNotFinite, &input.q_meas),
            (FaultCode::EffortNotFinite, &input.tau_meas),
            (FaultCode::ReferenceNotFinite, &input.tau_ff),
        ];
        if state.held.stops_at(first_not_finite(&signals)) {
            return state.held.hold(&self.inner, &mut state.inner, input);
        }
        let dt = usable_dt(input.dt, self.config.pid.dt);
        let mut v_ref = [0.0; N];
        let mut is_waiting = true;
        let task = self.map.at(&mut state.map, &input.q_meas);
        if state.phase.is_none() {
            state.q_ref = input.q_meas;
            if let Some(task) = &task {
                state.x_cmd = task.x;
            }
        }
        if let Some(task) = task {
            let before = (state.x_cmd, state.v_cmd);
            let force = self.map.forces(input, &task)[0].map(|f| -f);
            self.advance(state, &task, &force, dt);
            match self.map.drives(&mut state.map, &state.x_cmd) {
                Some(q) => {
                    state.q_ref = q;
                    v_ref = task.to_drives(&state.v_cmd);
                    state.t += dt;
                    is_waiting = false;
                }
                None => (state.x_cmd, state.v_cmd) = (before.0, [0.0; M]),
            }
        }
        let moved = Input { q_ref: state.q_ref, v_ref, a_ref: [0.0; N], ..*input };
        let mut command = state.held.follow(&self.inner, &mut state.inner, &moved);
        state.is_inner_saturated = command.health.is_saturated;
        for k in (0..M).filter(|&k| state.x_cmd[k] < self.config.lower[k] || state.x_cmd[k] > self.config.upper[k]) {
            command.health.acted.note(Limit::Position, k);
        }
        if is_waiting {
            command.health.acted.note(Limit::Workspace, 0);
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exercise::Wave;
    use crate::force::LinearTask;
    use crate::pd_gravity::{PdGravity, PdGravityConfig};

    #[test]
    fn a_robot_outside_its_range_is_led_back_without_a_step() {
        let (dt, start) = (0.01, 0.5);
        let map = LinearTask::try_new([0.0], [0.0], [[1.0]], [2]).unwrap();
        let inner = PdGravity::try_new(PdGravityConfig { kp: [1e3], kd: [0.0], tau_limit: [1e6], dt, filter_s: 0.0 }).unwrap();
        let pid = ForcePidConfig { kp: [1e-3], ki: [0.0], kd: [0.0], output_limit: [0.1], rate_limit: [10.0], filter_s: 0.0, dt };
        let script =
            Script::try_new(&[Phase { duration_s: 9.0, ramp_s: 4.0, channels: [Channel::Position(Wave::constant(0.1))] }]).unwrap();
        let controller = Exercise::try_new(map, inner, ExerciseConfig { script, pid, lower: [-0.2], upper: [0.2] }).unwrap();
        let (mut state, mut x) = (controller.at_rest(), start);
        for step in 0..900 {
            let command = controller.step(&mut state, &Input::standing([x], dt));
            // A path of 0.4 m in four seconds is nowhere faster than 0.2 m/s.
            assert!((state.x_cmd[0] - x).abs() < 0.2 * dt + 1e-12, "step {step}: {x} to {}", state.x_cmd[0]);
            assert_eq!(command.health.acted.at(Limit::Position, 0), state.x_cmd[0] > 0.2, "step {step}");
            x = state.x_cmd[0];
        }
        assert!((x - 0.1).abs() < 1e-9, "{x}");
    }
}
