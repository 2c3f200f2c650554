//! Brakes of the simulated drives: they hold while no efforts are asked for, as those of a limb that would fall without power.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};

use pkm_daemon::weigher::reflected;
use pkm_dyn::model::Model;
use pkm_hal::{Backend, CommandFrame, HalError, MAX_AXES, Mode, StateFrame};
use pkm_sim::{Plant, SimError};

/// How stiff a brake is, in masses over a step squared; of all drives together, far below 4, where a spring in steps becomes unstable.
const STIFFNESS: f64 = 0.2;

/// How firmly it damps, in masses over a step: about critical.
const DAMPING: f64 = 0.6;

/// A plant whose drives have brakes.
pub(crate) struct Braked {
    plant: Box<dyn Plant>,
    /// What each drive moves at the assembly with the others free, over the number of drives `[kg | kg·m²]`.
    mass: Vec<f64>,
    is_engaged: Arc<AtomicBool>,
    /// Where the brakes closed `[m | rad]`.
    closed_at: Option<[f64; MAX_AXES]>,
}

impl Braked {
    /// `plant` of `model` with its brakes closed, and what opens them.
    pub(crate) fn new(plant: Box<dyn Plant>, model: &Model) -> (Self, Arc<AtomicBool>) {
        let is_engaged = Arc::new(AtomicBool::new(true));
        let mass = reflected(model).iter().map(|mass| mass / model.n_act().max(1) as f64).collect();
        (Self { plant, mass, is_engaged: Arc::clone(&is_engaged), closed_at: None }, is_engaged)
    }
}

impl Plant for Braked {
    fn position(&self) -> &[f64] {
        self.plant.position()
    }

    fn velocity(&self) -> &[f64] {
        self.plant.velocity()
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        if !self.is_engaged.load(Ordering::Relaxed) {
            self.closed_at = None;
            return self.plant.step(tau, h);
        }
        let (q, v) = (self.plant.position(), self.plant.velocity());
        let closed_at = self.closed_at.get_or_insert_with(|| core::array::from_fn(|k| q.get(k).copied().unwrap_or(0.0)));
        let mut braked = [0.0; MAX_AXES];
        for (k, tau) in tau.iter().enumerate() {
            let mass = self.mass[k];
            braked[k] = tau + mass * (STIFFNESS * (closed_at[k] - q[k]) / (h * h) - DAMPING * v[k] / h);
        }
        self.plant.step(&braked[..tau.len()], h)
    }

    fn time(&self) -> Option<f64> {
        self.plant.time()
    }

    fn load_position(&self) -> &[f64] {
        self.plant.load_position()
    }

    fn tree(&self) -> Option<[&[f64]; 2]> {
        self.plant.tree()
    }

    fn stored_energy(&mut self) -> Option<f64> {
        self.plant.stored_energy()
    }

    fn link_motion(&mut self, link: usize) -> Option<(pkm_dyn::spatial::Pose, pkm_dyn::spatial::Motion)> {
        self.plant.link_motion(link)
    }

    fn sensor_wrench(&mut self, sensor: usize) -> Option<pkm_dyn::spatial::Force> {
        self.plant.sensor_wrench(sensor)
    }

    fn push_link(&mut self, link: usize, wrench: &pkm_dyn::spatial::Force) -> Result<(), SimError> {
        self.plant.push_link(link, wrench)
    }

    fn expect_motion(&mut self, q_ref: &[f64], v_ref: &[f64]) {
        self.plant.expect_motion(q_ref, v_ref);
    }
}

/// A device that opens its brakes when efforts are asked for, and closes them when they no longer are.
pub(crate) struct Brakes<B> {
    inner: B,
    is_engaged: Arc<AtomicBool>,
}

impl<B> Brakes<B> {
    /// `inner`, whose plant listens to `is_engaged`.
    pub(crate) const fn new(inner: B, is_engaged: Arc<AtomicBool>) -> Self {
        Self { inner, is_engaged }
    }
}

impl<B: Backend> Backend for Brakes<B> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.inner.read()
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        // Braking is switching off with brakes that close by themselves.
        let off = CommandFrame { mode: Mode::Off.code(), ..*command }.sealed();
        self.inner.write(if mode == Mode::Brake { &off } else { command })?;
        self.is_engaged.store(mode != Mode::Effort, Ordering::Relaxed);
        Ok(())
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }

    fn reconnect(&mut self) {
        self.inner.reconnect();
    }
}
