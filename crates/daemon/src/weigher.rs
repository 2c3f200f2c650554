//! The model in the loop: what the weight asks of the drives, and where a wrench sensor's axes point.

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::Model;
use pkm_hal::MAX_AXES;

/// A wrench: force first `[N, N·m]`.
pub type Wrench = [f64; 6];

/// A model with the pose it was last weighed at.
pub struct Weigher {
    model: Model,
    data: Data,
    zero: Vec<f64>,
    is_placed: bool,
}

impl core::fmt::Debug for Weigher {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Weigher").field("robot", &self.model.name).field("is_placed", &self.is_placed).finish_non_exhaustive()
    }
}

impl Weigher {
    /// A model that has been nowhere.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let (data, zero) = (Data::new(&model), vec![0.0; model.n_act()]);
        Self { model, data, zero, is_placed: false }
    }

    /// Efforts that hold the robot with its drives at `q` `[m | rad]`, into `tau` `[N | N·m]`; the slices have the model's drives.
    ///
    /// # Errors
    /// The gap that its loops keep there `[m | rad]`. It then begins anew from its assembly.
    pub fn weigh(&mut self, q: &[f64], tau: &mut [f64; MAX_AXES]) -> Result<(), f64> {
        if !self.is_placed {
            for closure in [assemble(&self.model, &mut self.data), walk_to(&self.model, &mut self.data, q)] {
                if !closure.is_closed {
                    return Err(closure.gap);
                }
            }
            self.is_placed = true;
        }
        let closure = inverse_dynamics(&self.model, &mut self.data, q, &self.zero, &self.zero);
        self.is_placed = closure.is_closed;
        if !closure.is_closed {
            return Err(closure.gap);
        }
        for (to, from) in tau.iter_mut().zip(self.data.tau_act.iter()) {
            *to = *from;
        }
        Ok(())
    }

    /// A wrench in the axes of sensor number `sensor` of the model, turned into the root's axes at the pose weighed last.
    #[must_use]
    pub fn in_root_axes(&self, sensor: usize, wrench: &Wrench) -> Wrench {
        let Some(sensor) = self.model.sensors.get(sensor) else { return *wrench };
        let link = &self.model.links[sensor.link];
        let pose = link.body.map_or(link.pose, |body| self.data.pose_wb[body].compose(&link.pose)).compose(&sensor.pose);
        let turned = |x: &[f64]| pose.rotation * nalgebra::Vector3::new(x[0], x[1], x[2]);
        let (force, moment) = (turned(&wrench[..3]), turned(&wrench[3..]));
        [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    }
}
