//! What orders need, made outside the loop: controllers at rest, motions from their beginning, fresh numbers.

use alloc::sync::Arc;
use core::hash::{BuildHasher, Hasher};
use std::hash::RandomState;

use pkm_ctrl::Running;
use pkm_daemon::supervisor::Workshop;
use pkm_daemon::{Motion, Wanted};
use pkm_hal::Phase;
use pkm_sim::{Playback, Sample, Trajectory};

use super::setup::Setup;

/// Makes what the orders of one setup need.
pub(crate) struct FromFiles(pub(crate) Arc<Setup>);

impl Workshop for FromFiles {
    fn hold(&mut self) -> Option<Box<dyn Running>> {
        self.0.hold.build(&self.0.robot.robot)
    }

    fn run(&mut self) -> Option<Box<dyn Running>> {
        self.0.run.as_ref().and_then(|run| run.build(&self.0.robot.robot))
    }

    fn motion(&mut self) -> Option<Box<dyn Motion>> {
        self.0.motion.as_ref().map(|motion| Box::new(Played::new(motion.clone(), self.0.robot.robot.model.n_act())) as Box<dyn Motion>)
    }

    fn phase(&self) -> Phase {
        self.0.phase()
    }

    fn length_s(&self) -> Option<f64> {
        self.0.settings.length_s
    }

    fn nonce(&mut self) -> u64 {
        // Keys of the standard library's hasher are drawn by the operating system.
        RandomState::new().build_hasher().finish() | 1
    }
}

/// A recorded motion as the loop plays it.
struct Played {
    motion: Playback,
    sample: Sample,
}

impl Played {
    fn new(motion: Playback, n: usize) -> Self {
        // With its room made here, none is asked for in the loop.
        Self { motion, sample: Sample { q: vec![0.0; n], v: vec![0.0; n], a: vec![0.0; n] } }
    }
}

impl Motion for Played {
    fn duration_s(&self) -> Option<f64> {
        Some(self.motion.duration_s())
    }

    fn at(&mut self, t: f64, wanted: &mut Wanted) {
        self.motion.at(t, &mut self.sample);
        for (to, from) in [(&mut wanted.q, &self.sample.q), (&mut wanted.v, &self.sample.v), (&mut wanted.a, &self.sample.a)] {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
        }
    }
}
