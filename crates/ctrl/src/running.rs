//! A controller whose number of drives is known at run time only: slices in place of arrays, the state inside.

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::fmt::{self, Write};

use crate::catalogue::Drives;
use crate::controller::{Controller, Health, Input};
use crate::fault::{Fault, FaultCode};

/// What a controller sees in one period, as [`Input`]; one entry per drive in every slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signals<'a> {
    /// Time since the last step `[s]`.
    pub dt: f64,
    /// Time from the last measured positions to these, by the stamps of both `[s]`; zero where these are not new.
    pub q_dt: f64,
    /// Measured positions `[m | rad]`.
    pub q_meas: &'a [f64],
    /// Measured efforts of the drives `[N | N·m]`.
    pub tau_meas: &'a [f64],
    /// Measured wrench of the environment on the robot, force first `[N, N·m]`.
    pub wrench_meas: [f64; 6],
    /// Wanted positions `[m | rad]`.
    pub q_ref: &'a [f64],
    /// Wanted velocities `[m/s | rad/s]`.
    pub v_ref: &'a [f64],
    /// Wanted accelerations `[m/s² | rad/s²]`.
    pub a_ref: &'a [f64],
    /// Wanted wrench of the environment on the robot, force first `[N, N·m]`.
    pub wrench_ref: [f64; 6],
    /// Effort the model asks for, weight at least `[N | N·m]`.
    pub tau_ff: &'a [f64],
}

impl Signals<'_> {
    /// As an input of `N` drives; none where a slice has another length.
    fn input<const N: usize>(&self) -> Option<Input<N>> {
        Some(Input {
            dt: self.dt,
            q_dt: self.q_dt,
            q_meas: self.q_meas.try_into().ok()?,
            tau_meas: self.tau_meas.try_into().ok()?,
            wrench_meas: self.wrench_meas,
            q_ref: self.q_ref.try_into().ok()?,
            v_ref: self.v_ref.try_into().ok()?,
            a_ref: self.a_ref.try_into().ok()?,
            wrench_ref: self.wrench_ref,
            tau_ff: self.tau_ff.try_into().ok()?,
        })
    }
}

/// What can be said of a controller before it runs.
#[derive(Debug, Clone, PartialEq)]
pub struct About {
    /// Name of its law.
    pub name: String,
    /// Steps per second that it is made for `[Hz]`.
    pub rate_hz: f64,
    /// What its command is.
    pub drives: Drives,
    /// Effort per rate of the voltage, one entry per drive, where its command is one `[N·s/V | N·m·s/V]`; empty where it is an effort.
    pub effort_per_rate: Vec<f64>,
    /// Number of drives.
    pub n_drives: usize,
}

/// The numbers that a controller was made of, gains and model: they never change, unless memory does.
#[derive(Clone)]
pub struct Numbers(Arc<dyn fmt::Debug + Send + Sync>);

impl Numbers {
    /// These, which must show all of themselves in their `Debug`.
    #[must_use]
    pub fn new(numbers: Arc<dyn fmt::Debug + Send + Sync>) -> Self {
        Self(numbers)
    }

    /// A checksum of all of them, which one flipped bit in any of them changes. Takes its time: not for the loop.
    #[must_use]
    pub fn seal(&self) -> u64 {
        let mut sum = Sum(0xCBF2_9CE4_8422_2325);
        // Shortest decimals lead back to the same bits, so other bits are another text; a sum refuses none.
        let _ = write!(sum, "{:?}", self.0);
        sum.0
    }

    /// Whether the controller is still there.
    #[must_use]
    pub fn is_used(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }
}

impl fmt::Debug for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// FNV-1a of what is written.
struct Sum(u64);

impl Write for Sum {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 = text.bytes().fold(self.0, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3));
        Ok(())
    }
}

/// A controller with its state.
pub trait Running: Send {
    /// What can be said of it.
    fn about(&self) -> &About;

    /// One period: commands into `tau`, efforts `[N | N·m]` or voltages `[V]`. Never fails, never allocates, never blocks.
    ///
    /// Slices of another length than [`About::n_drives`] are a fault that latches, and the command is zero.
    fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health;

    /// How the last step went.
    fn health(&self) -> Health;

    /// To rest, as before the first step. May allocate.
    fn reset(&mut self);

    /// What it was made of, for who looks from outside the loop whether that is still so; none where it does not say.
    fn numbers(&self) -> Option<Numbers> {
        None
    }
}

/// A [`Controller`] that runs.
#[derive(Debug, Clone)]
pub struct Runs<const N: usize, C: Controller<N>> {
    controller: Arc<C>,
    state: C::State,
    about: About,
    health: Health,
    has_wrong_lengths: bool,
}

impl<const N: usize, C: Controller<N>> Runs<N, C> {
    /// `controller` at rest; the number of drives in `about` becomes `N`.
    #[must_use]
    pub fn new(controller: C, about: About) -> Self {
        let about = About { n_drives: N, ..about };
        Self { state: controller.at_rest(), controller: Arc::new(controller), about, health: Health::default(), has_wrong_lengths: false }
    }
}

impl<const N: usize, C: Controller<N> + fmt::Debug + Send + Sync + 'static> Running for Runs<N, C>
where
    C::State: Send,
{
    fn about(&self) -> &About {
        &self.about
    }

    fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health {
        let input = signals.input::<N>();
        self.has_wrong_lengths |= input.is_none() || tau.len() != N;
        if let (Some(input), false) = (input, self.has_wrong_lengths) {
            let command = self.controller.step(&mut self.state, &input);
            tau.copy_from_slice(&command.tau);
            self.health = command.health;
        } else {
            tau.fill(0.0);
            let (value, limit) = (signals.q_meas.len() as f64, N as f64);
            let fault = Fault { code: FaultCode::Controller, drive: 0, value, limit };
            self.health = Health { is_faulted: true, fault: Some(fault), ..Health::default() };
        }
        self.health
    }

    fn health(&self) -> Health {
        self.health
    }

    fn reset(&mut self) {
        self.state = self.controller.at_rest();
        (self.health, self.has_wrong_lengths) = (Health::default(), false);
    }

    fn numbers(&self) -> Option<Numbers> {
        let controller: Arc<C> = Arc::clone(&self.controller);
        Some(Numbers::new(controller))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pd_gravity::{PdGravity, PdGravityConfig};

    fn runs(kp: f64) -> Option<Runs<1, PdGravity<1>>> {
        let config = PdGravityConfig { kp: [kp], kd: [3.0], tau_limit: [50.0], dt: 1e-3, filter_s: 0.01 };
        let about = About { name: "pd".into(), rate_hz: 1e3, drives: Drives::Effort, effort_per_rate: Vec::new(), n_drives: 1 };
        Some(Runs::new(PdGravity::try_new(config).ok()?, about))
    }

    #[test]
    fn any_flipped_bit_of_a_gain_is_another_seal() {
        let seal = |kp: f64| runs(kp).and_then(|runs| Some(runs.numbers()?.seal()));
        let gain = 123.456_f64;
        let good = seal(gain).unwrap();
        assert_eq!(seal(gain), Some(good));
        // Some of them are no gains, and refused: negative ones.
        let others: Vec<u64> = (0..64).filter_map(|bit| seal(f64::from_bits(gain.to_bits() ^ (1 << bit)))).collect();
        assert!(others.len() >= 62 && others.iter().all(|other| *other != good), "{}", others.len());
    }

    #[test]
    fn numbers_know_when_nobody_runs_with_them() {
        let runs = runs(1.0).unwrap();
        let numbers = runs.numbers().unwrap();
        assert!(numbers.is_used());
        drop(runs);
        assert!(!numbers.is_used());
    }
}
