//! Active disturbance rejection \[Arceo2021, Fig. 6; Han2009; Gao2003\]: everything that the input does not explain is one unknown
//! acceleration per drive, estimated by an extended state observer and cancelled.
//!
//! `q'' = B·(u − tau_ff) + f`, `u = tau_ff + B⁻¹·(u0 − f̂)`, where `u0` is what a double integrator needs to follow the reference. `B` may
//! couple the drives. The observer is fed the *clipped* input; it starts in agreement with the command it has to go on from.

use crate::controller::{Command, ConfigError, Controller, Health, Input, clipped, must_be_finite, must_be_usable};
use crate::fault::{Fault, FaultCode};
use crate::linear_system;
use crate::observer::{Gap, LinearEso, NonlinearEso};
use crate::tracking_differentiator::{TrackingDifferentiator, fhan};

/// Which extended state observer estimates position, velocity and the unknown acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extended {
    /// The linear one with its three poles at `-bandwidth` `[1/s]`.
    Linear {
        /// Bandwidth `[1/s]`.
        bandwidth: f64,
    },
    /// Han's, with gains of one period.
    Nonlinear(NonlinearEso),
}

/// How the double integrator that is left is made to follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Feedback {
    /// `u0 = a_ref + kd·(v_ref − z2) + kp·(q_ref − z1)` with both poles at `-bandwidth` `[1/s]`.
    Linear {
        /// Bandwidth `[1/s]`.
        bandwidth: f64,
    },
    /// `u0 = −fhan(q_ref − z1, c·(v_ref − z2), r, h)` \[Arceo2021, Fig. 6\].
    TimeOptimal {
        /// Largest acceleration `[m/s² | rad/s²]`.
        r: f64,
        /// Damping.
        c: f64,
        /// Step of the law `[s]`, at least the period.
        h: f64,
    },
}

/// Numbers of an [`Adrc`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdrcConfig<const N: usize> {
    /// Acceleration per input, row per drive, column per input `[1/kg | 1/(kg·m²)]`, or per volt where inputs are voltages.
    pub b: [[f64; N]; N],
    /// Observer.
    pub extended: Extended,
    /// Law.
    pub feedback: Feedback,
    /// Acceleration at which steps of the reference are smoothed beforehand `[m/s² | rad/s²]`; infinite takes the reference as it is.
    pub reference_acceleration: f64,
    /// Largest input of each drive `[N | N·m]` or `[V]`.
    pub limit: [f64; N],
}

/// Active disturbance rejection control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adrc<const N: usize> {
    config: AdrcConfig<N>,
    b_inverse: [[f64; N]; N],
}

/// What an [`Adrc`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdrcState<const N: usize> {
    /// Estimates of every drive: position, velocity, unknown acceleration.
    pub z: [[f64; 3]; N],
    gap: Gap<N>,
    reference: [TrackingDifferentiator; N],
    /// Acceleration of the last input, clipped, without the feed-forward `[m/s² | rad/s²]`.
    a_sent: [f64; N],
    /// Input to go on from in the first step; none goes on from the feed-forward.
    resume: Option<[f64; N]>,
    tau_safe: [f64; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize> Adrc<N> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Bandwidths, gains, limits that are not positive, an input matrix that is singular, anything that is not finite.
    pub fn try_new(config: AdrcConfig<N>) -> Result<Self, ConfigError> {
        match config.extended {
            Extended::Linear { bandwidth } => ConfigError::unless_positive("bandwidth of the observer", &[bandwidth])?,
            Extended::Nonlinear(eso) => {
                ConfigError::unless_positive("beta", &eso.beta)?;
                ConfigError::unless_positive("delta", &[eso.delta])?;
            }
        }
        match config.feedback {
            Feedback::Linear { bandwidth } => ConfigError::unless_positive("bandwidth of the law", &[bandwidth])?,
            Feedback::TimeOptimal { r, c, h } => {
                ConfigError::unless_positive("r", &[r])?;
                ConfigError::unless_positive("c", &[c])?;
                ConfigError::unless_positive("h", &[h])?;
            }
        }
        ConfigError::unless_positive("limit", &config.limit)?;
        let bad = |what, value, limit| ConfigError { drive: 0, what, value, limit };
        let r = config.reference_acceleration;
        if r.is_nan() || r <= 0.0 {
            return Err(bad("reference_acceleration", r, "must be > 0"));
        }
        let b_inverse = linear_system::inverse(&config.b).ok_or(bad("b", config.b[0][0], "must be finite and have an inverse"))?;
        Ok(Self { config, b_inverse })
    }

    /// The state of a controller that takes over from another without a jump: the unknown acceleration is the one that explains why the
    /// robot rests under the input `u` `[N | N·m]` or `[V]`.
    #[must_use]
    pub fn resuming(&self, u: [f64; N]) -> AdrcState<N> {
        AdrcState { resume: Some(u), ..self.at_rest() }
    }

    /// Reference positions, velocities and accelerations, smoothed.
    fn smoothed(&self, state: &mut AdrcState<N>, input: &Input<N>) -> [[f64; N]; 3] {
        let r = self.config.reference_acceleration;
        if !r.is_finite() {
            return [input.q_ref, input.v_ref, input.a_ref];
        }
        let a = core::array::from_fn(|k| state.reference[k].step(input.q_ref[k], r, input.dt, input.dt));
        [state.reference.map(|x| x.x), state.reference.map(|x| x.rate), a]
    }

    fn start(&self, state: &mut AdrcState<N>, input: &Input<N>) {
        let u = state.resume.unwrap_or(input.tau_ff);
        let beyond = core::array::from_fn(|k| u[k] - input.tau_ff[k]);
        let f = linear_system::product(&self.config.b, &beyond);
        state.z = core::array::from_fn(|k| [input.q_meas[k], 0.0, -f[k]]);
        state.reference = input.q_meas.map(|x| TrackingDifferentiator { x, rate: 0.0 });
        state.has_started = true;
    }

    /// One period, or a new start from the velocities over a gap in the measurements.
    fn observe(&self, state: &mut AdrcState<N>, input: &Input<N>, over_gap: Option<[f64; N]>) {
        for (k, z) in state.z.iter_mut().enumerate() {
            if let Some(v) = over_gap {
                // What was unknown of the acceleration is so still.
                *z = [input.q_meas[k], v[k], z[2]];
                continue;
            }
            match self.config.extended {
                Extended::Linear { bandwidth } => {
                    let mut drive = LinearEso { z: *z };
                    drive.step(state.a_sent[k], input.q_meas[k], bandwidth, input.dt);
                    *z = drive.z;
                }
                Extended::Nonlinear(eso) => *z = eso.step(*z, state.a_sent[k], input.q_meas[k], input.dt),
            }
        }
    }

    fn attempt(&self, state: &mut AdrcState<N>, input: &Input<N>) -> Result<Command<N>, Fault> {
        let signals = [&input.q_meas, &input.q_ref, &input.v_ref, &input.a_ref, &input.tau_ff];
        must_be_usable(&signals, input.dt)?;
        let over_gap = state.gap.ended(input);
        if state.has_started {
            self.observe(state, input, over_gap);
        } else {
            self.start(state, input);
        }
        let [q_ref, v_ref, a_ref] = self.smoothed(state, input);
        let left: [f64; N] = core::array::from_fn(|k| {
            let [z1, z2, z3] = state.z[k];
            let (e, e_rate) = (q_ref[k] - z1, v_ref[k] - z2);
            let u0 = match self.config.feedback {
                Feedback::Linear { bandwidth } => a_ref[k] + 2.0 * bandwidth * e_rate + bandwidth * bandwidth * e,
                Feedback::TimeOptimal { r, c, h } => -fhan(e, c * e_rate, r, h),
            };
            u0 - z3
        });
        let push = linear_system::product(&self.b_inverse, &left);
        let wanted: [f64; N] = core::array::from_fn(|k| input.tau_ff[k] + push[k]);
        must_be_finite(FaultCode::CommandNotFinite, &[&wanted])?;
        let (tau, is_saturated) = clipped(&wanted, &self.config.limit);
        let sent = core::array::from_fn(|k| tau[k] - input.tau_ff[k]);
        state.a_sent = linear_system::product(&self.config.b, &sent);
        state.tau_safe = clipped(&input.tau_ff, &self.config.limit).0;
        Ok(Command { tau, health: Health { is_saturated, ..Health::default() } })
    }
}

impl<const N: usize> Controller<N> for Adrc<N> {
    type State = AdrcState<N>;

    fn at_rest(&self) -> Self::State {
        AdrcState {
            z: [[0.0; 3]; N],
            gap: Gap::default(),
            reference: [TrackingDifferentiator::default(); N],
            a_sent: [0.0; N],
            resume: None,
            tau_safe: [0.0; N],
            has_started: false,
            fault: None,
        }
    }

    /// One period. On a fault the command is the last finite feed-forward, clipped: it carries the weight and pushes no further; zero where
    /// inputs are voltages of drives that hold themselves.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_none() {
            match self.attempt(state, input) {
                Ok(command) => return command,
                Err(fault) => state.fault = Some(fault),
            }
        }
        Command::faulted(state.tau_safe, state.fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.01;

    fn config() -> AdrcConfig<2> {
        AdrcConfig {
            b: [[0.5, 0.1], [0.1, 0.8]],
            extended: Extended::Linear { bandwidth: 30.0 },
            feedback: Feedback::Linear { bandwidth: 8.0 },
            reference_acceleration: f64::INFINITY,
            limit: [4.0, 6.0],
        }
    }

    /// The plant that the observer takes the robot for, sampled exactly: `q'' = b·u + f`.
    fn advance(x: &mut [[f64; 2]; 2], u: &[f64; 2], f: &[f64; 2]) {
        let a = linear_system::product(&config().b, u);
        for k in 0..2 {
            let a = a[k] + f[k];
            x[k][0] += DT * x[k][1] + 0.5 * DT * DT * a;
            x[k][1] += DT * a;
        }
    }

    #[test]
    fn fed_the_clipped_input_the_observer_stays_exact_through_saturation() {
        let adrc = Adrc::try_new(config()).expect("good");
        let f = [-0.7, 0.4];
        // At rest under the input that holds f: the estimates start exact.
        let hold = linear_system::product(&adrc.b_inverse, &[0.7, -0.4]);
        let mut state = adrc.resuming(hold);
        let (mut x, mut saturated) = ([[0.0; 2]; 2], 0);
        for k in 0..400 {
            let q = [x[0][0], x[1][0]];
            let command = adrc.step(&mut state, &Input { q_ref: [0.5, -0.6], ..Input::standing(q, DT) });
            for i in 0..2 {
                let want = [x[i][0], x[i][1], f[i]];
                assert!((0..3).all(|s| (state.z[i][s] - want[s]).abs() < 1e-9), "{k}: {:?} {want:?}", state.z[i]);
            }
            saturated += u32::from(command.health.is_saturated);
            advance(&mut x, &command.tau, &f);
        }
        assert!((20..200).contains(&saturated), "{saturated}");
        assert!((x[0][0] - 0.5).abs() < 1e-6 && (x[1][0] + 0.6).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn an_error_of_the_observer_decays_through_saturation_as_its_triple_pole_says() {
        let adrc = Adrc::try_new(config()).expect("good");
        let mut state = adrc.at_rest();
        let (mut x, f, mut errors) = ([[0.0, 0.0], [0.0, 0.0]], [-0.7, 0.4], [[0.0; 3]; 120]);
        for error in &mut errors {
            let q = [x[0][0], x[1][0]];
            let command = adrc.step(&mut state, &Input { q_ref: [1.5, -2.0], ..Input::standing(q, DT) });
            *error = [state.z[0][0] - x[0][0], state.z[0][1] - x[0][1], state.z[0][2] - f[0]];
            advance(&mut x, &command.tau, &f);
        }
        // Started from f̂ = 0: e_k = ((I − l·c)·A)^k·(0, 0, 0.7).
        let (p, t) = (pkm_dyn::math::exp(-30.0 * DT), DT);
        let l = LinearEso::gains(30.0, DT);
        let mut e = errors[0];
        assert!((e[2] - 0.7).abs() < 1e-15);
        for got in &errors[1..] {
            let ahead = [e[0] + t * e[1] + 0.5 * t * t * e[2], e[1] + t * e[2], e[2]];
            e = core::array::from_fn(|i| ahead[i] - l[i] * ahead[0]);
            assert!((0..3).all(|i| (got[i] - e[i]).abs() < 1e-9), "{got:?} {e:?}");
        }
        // (z − p)³ annihilates every component.
        let third =
            |i: usize, k: usize| errors[k + 3][i] - 3.0 * p * errors[k + 2][i] + 3.0 * p * p * errors[k + 1][i] - p * p * p * errors[k][i];
        assert!((0..100).all(|k| (0..3).all(|i| third(i, k).abs() < 1e-11)));
    }

    #[test]
    fn it_goes_on_from_the_input_it_takes_over_and_from_the_weight_otherwise() {
        let adrc = Adrc::try_new(config()).expect("good");
        let input = Input { tau_ff: [1.0, -2.0], ..Input::standing([0.4, 0.2], DT) };
        for (mut state, want) in [(adrc.at_rest(), [1.0, -2.0]), (adrc.resuming([2.5, 0.5]), [2.5, 0.5])] {
            let tau = adrc.step(&mut state, &input).tau;
            assert!((0..2).all(|k| (tau[k] - want[k]).abs() < 1e-12), "{tau:?}");
        }
    }

    #[test]
    fn a_smoothed_step_of_the_reference_begins_gently() {
        let adrc = Adrc::try_new(AdrcConfig { reference_acceleration: 0.2, ..config() }).expect("good");
        let mut state = adrc.at_rest();
        let mut x = [[0.0; 2]; 2];
        for _ in 0..1200 {
            let q = [x[0][0], x[1][0]];
            let command = adrc.step(&mut state, &Input { q_ref: [1.0, 0.5], ..Input::standing(q, DT) });
            assert!(!command.health.is_saturated);
            advance(&mut x, &command.tau, &[0.0; 2]);
        }
        assert!((x[0][0] - 1.0).abs() < 1e-4 && (x[1][0] - 0.5).abs() < 1e-4, "{x:?}");
    }

    #[test]
    fn not_a_number_latches_a_fault_and_unusable_numbers_are_refused() {
        let adrc = Adrc::try_new(config()).expect("good");
        let mut state = adrc.at_rest();
        let good = Input { tau_ff: [1.0, -20.0], ..Input::standing([0.4, 0.2], DT) };
        let _ = adrc.step(&mut state, &good);
        for input in [Input { q_ref: [0.0, f64::INFINITY], ..good }, good] {
            let fault = Fault { code: FaultCode::InputNotFinite, drive: 1, value: f64::INFINITY, limit: 0.0 };
            assert_eq!(adrc.step(&mut state, &input), Command::faulted([1.0, -6.0], Some(fault)));
        }
        for bad in [
            AdrcConfig { b: [[1.0, 2.0], [0.5, 1.0]], ..config() },
            AdrcConfig { b: [[f64::NAN; 2]; 2], ..config() },
            AdrcConfig { limit: [0.0, 1.0], ..config() },
            AdrcConfig { reference_acceleration: -1.0, ..config() },
            AdrcConfig { extended: Extended::Linear { bandwidth: 0.0 }, ..config() },
            AdrcConfig { feedback: Feedback::TimeOptimal { r: 1.0, c: 1.0, h: 0.0 }, ..config() },
        ] {
            assert!(Adrc::try_new(bad).is_err(), "{bad:?}");
        }
    }
}
