//! What is left of a controller around another after a fault: the inner one holds the pose it was last sent to, and its own clipped command
//! carries the robot.

use crate::controller::{Command, Controller, Input};
use crate::fault::{Fault, FaultCode};

/// Where an inner controller was sent, and why it is sent no further.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Held<const N: usize> {
    /// The last reference; none before the first step.
    q_ref: Option<[f64; N]>,
    /// The last finite feed-forward effort.
    tau_ff: [f64; N],
    fault: Option<Fault>,
}

impl<const N: usize> Held<N> {
    pub(crate) fn new() -> Self {
        Self { q_ref: None, tau_ff: [0.0; N], fault: None }
    }

    /// Latches the first fault, whether this one or one before it; whether there is any.
    pub(crate) fn stops_at(&mut self, fault: Option<Fault>) -> bool {
        self.fault = self.fault.or(fault);
        self.fault.is_some()
    }

    /// One period of `inner` along `moved`.
    pub(crate) fn follow<C: Controller<N>>(&mut self, inner: &C, state: &mut C::State, moved: &Input<N>) -> Command<N> {
        (self.q_ref, self.tau_ff) = (Some(moved.q_ref), moved.tau_ff);
        self.judged(inner.step(state, moved))
    }

    /// One period of `inner` after a fault: it stays where it was sent, wants no force and hears of none.
    pub(crate) fn hold<C: Controller<N>>(&mut self, inner: &C, state: &mut C::State, input: &Input<N>) -> Command<N> {
        let q_ref = *self.q_ref.get_or_insert(input.q_meas);
        if input.tau_ff.iter().all(|t| t.is_finite()) {
            self.tau_ff = input.tau_ff;
        }
        let (zero, none, tau_ff) = ([0.0; N], [0.0; 6], self.tau_ff);
        self.judged(inner.step(state, &Input { q_ref, v_ref: zero, a_ref: zero, wrench_meas: none, wrench_ref: none, tau_ff, ..*input }))
    }

    /// A fault of the inner controller is one of the whole.
    fn judged(&mut self, mut command: Command<N>) -> Command<N> {
        if command.health.is_faulted {
            let own = Fault { code: FaultCode::Controller, drive: 0, value: 0.0, limit: 0.0 };
            self.fault = self.fault.or(command.health.fault).or(Some(own));
        }
        if let Some(drive) = command.tau.iter().position(|t| !t.is_finite()) {
            let none = Fault { code: FaultCode::CommandNotFinite, drive, value: command.tau[drive], limit: 0.0 };
            self.fault = self.fault.or(Some(none));
            command.tau = command.tau.map(|t| if t.is_finite() { t } else { 0.0 });
        }
        if self.fault.is_some() {
            (command.health.is_faulted, command.health.fault) = (true, self.fault);
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::Health;
    use crate::exercise::{Channel, Exercise, ExerciseConfig, Phase, Script, Wave};
    use crate::force::{Admittance, AdmittanceConfig, ForcePidConfig, Hybrid, HybridConfig, LinearTask};
    use crate::pd_gravity::{PdGravity, PdGravityConfig};

    const DT: f64 = 0.01;
    const WEIGHT: f64 = 40.0;

    /// A stiff loop that knows the weight itself and takes no feed-forward.
    struct Knows;

    impl Controller<1> for Knows {
        type State = ();

        fn at_rest(&self) {}

        fn step(&self, (): &mut (), input: &Input<1>) -> Command<1> {
            let tau = WEIGHT + 1000.0 * (input.q_ref[0] - input.q_meas[0]) + 50.0 * input.v_ref[0];
            Command { tau: [tau.clamp(-100.0, 100.0)], health: Health::default() }
        }
    }

    fn position() -> PdGravity<1> {
        PdGravity::try_new(PdGravityConfig { kp: [1000.0], kd: [0.0], tau_limit: [100.0], dt: DT, filter_s: 0.0 }).unwrap()
    }

    fn map() -> LinearTask<1, 1> {
        LinearTask::try_new([0.0], [0.0], [[1.0]], [2]).unwrap()
    }

    fn pid() -> ForcePidConfig<1> {
        ForcePidConfig { kp: [1e-3], ki: [0.0], kd: [0.0], output_limit: [0.1], rate_limit: [10.0], filter_s: 0.0, dt: DT }
    }

    fn hybrid<C: Controller<1>>(inner: C) -> impl Controller<1> {
        Hybrid::try_new(map(), inner, HybridConfig { selection: [1.0], pid: pid(), travel: [0.1], margin: 0.0 }).unwrap()
    }

    fn admittance<C: Controller<1>>(inner: C) -> impl Controller<1> {
        let config = AdmittanceConfig { mass: [1.0], damping: [50.0], stiffness: [1e3], travel: [0.1], speed: [0.2], dt: DT };
        Admittance::try_new(map(), inner, config).unwrap()
    }

    fn exercise<C: Controller<1>>(inner: C) -> impl Controller<1> {
        let script =
            Script::try_new(&[Phase { duration_s: 9.0, ramp_s: 1.0, channels: [Channel::Position(Wave::constant(0.1))] }]).unwrap();
        Exercise::try_new(map(), inner, ExerciseConfig { script, pid: pid(), lower: [-1.0], upper: [1.0] }).unwrap()
    }

    /// Standing at 0.1 with the last good `tau_ff`, then the load cell says nothing, then everything is good again.
    fn spoilt(controller: &impl Controller<1>, tau_ff: f64) -> [Command<1>; 3] {
        let mut state = controller.at_rest();
        let calm = Input { tau_ff: [tau_ff], ..Input::standing([0.1], DT) };
        let mut deaf = calm;
        (deaf.wrench_meas[2], deaf.v_ref[0]) = (f64::NAN, 3.0);
        [calm, deaf, calm].map(|input| controller.step(&mut state, &input))
    }

    fn carries(controller: &impl Controller<1>, tau_ff: f64, want: f64) {
        let [calm, deaf, after] = spoilt(controller, tau_ff);
        assert!(!calm.health.is_faulted && (calm.tau[0] - want).abs() < 1e-9, "{calm:?}");
        for command in [deaf, after] {
            let fault = command.health.fault.expect("a fault");
            assert!(command.health.is_faulted && fault.code == FaultCode::WrenchNotFinite && fault.drive == 2, "{fault}");
            assert!((command.tau[0] - want).abs() < 1e-9, "the robot stays carried: {command:?}");
        }
    }

    #[test]
    fn an_inner_controller_with_a_model_of_its_own_carries_the_robot_through_a_fault_outside() {
        carries(&hybrid(Knows), 0.0, WEIGHT);
        carries(&admittance(Knows), 0.0, WEIGHT);
        carries(&exercise(Knows), 0.0, WEIGHT);
    }

    #[test]
    fn an_absurd_feed_forward_stays_clipped_through_a_fault_outside() {
        carries(&hybrid(position()), 1e6, 100.0);
        carries(&admittance(position()), 1e6, 100.0);
        carries(&exercise(position()), 1e6, 100.0);
    }

    #[test]
    fn a_robot_that_drifts_after_the_fault_is_held_where_it_was_sent() {
        let controller = hybrid(Knows);
        let mut state = controller.at_rest();
        let mut input = Input::standing([0.1], DT);
        let _ = controller.step(&mut state, &input);
        (input.wrench_meas[0], input.q_ref[0]) = (f64::INFINITY, 0.5);
        input.q_meas[0] = 0.09;
        let tau = controller.step(&mut state, &input).tau[0];
        assert!((tau - (WEIGHT + 10.0)).abs() < 1e-9, "{tau}");
        // In the first step it stays where it stands.
        let first = controller.step(&mut controller.at_rest(), &input).tau[0];
        assert!((first - WEIGHT).abs() < 1e-9, "{first}");
    }
}
