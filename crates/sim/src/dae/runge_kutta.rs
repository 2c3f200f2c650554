//! The classical Runge-Kutta rule of order four between events.

use pkm_dyn::configuration::integrate;
use pkm_dyn::constrained::project;

use crate::dae::system::{State, System};

/// Scratch of [`RungeKutta::step`].
#[derive(Debug)]
pub(crate) struct RungeKutta {
    stage: State,
    way: Vec<f64>,
    /// Sums over the stages of velocities, accelerations and rates of memories.
    sums: [Vec<f64>; 3],
}

/// Where each stage lies in the step, and its weight.
const STAGES: [(f64, f64); 4] = [(0.0, 1.0 / 6.0), (0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0)];

impl RungeKutta {
    pub(crate) fn new(state: &State) -> Self {
        let zero = vec![0.0; state.q.len()];
        Self { stage: state.clone(), way: zero.clone(), sums: [zero.clone(), zero, vec![0.0; state.z.len()]] }
    }

    /// Moves `state` on by `h` `[s]`; directions of sliding are those in `system` all the while. `None` where loops open.
    ///
    /// Joints of several coordinates turn about the velocity of each stage, which is of order two for them.
    #[must_use]
    pub(crate) fn step(&mut self, system: &mut System, state: &mut State, push: &[f64], h: f64) -> Option<()> {
        let Self { stage, way, sums } = self;
        sums.iter_mut().for_each(|sum| sum.fill(0.0));
        stage.copy_from(state);
        for (i, &(share, weight)) in STAGES.iter().enumerate() {
            if i > 0 {
                // From the start, along the velocity and acceleration of the stage before.
                way.iter_mut().zip(&stage.v).for_each(|(way, v)| *way = share * h * v);
                stage.q.copy_from_slice(&state.q);
                integrate(&system.model, &mut stage.q, way);
                for (v, (start, a)) in stage.v.iter_mut().zip(state.v.iter().zip(&system.data.a)) {
                    *v = start + share * h * a;
                }
                for (z, (start, dz)) in stage.z.iter_mut().zip(state.z.iter().zip(&system.dz)) {
                    *z = start + share * h * dz;
                }
                stage.time = state.time + share * h;
            }
            system.accelerate(stage, push)?;
            for (sum, x) in sums.iter_mut().zip([&stage.v, &system.data.a, &system.dz]) {
                sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
            }
        }
        way.iter_mut().zip(&sums[0]).for_each(|(way, v)| *way = h * v);
        integrate(&system.model, &mut state.q, way);
        state.v.iter_mut().zip(&sums[1]).for_each(|(v, a)| *v += h * a);
        state.z.iter_mut().zip(&sums[2]).for_each(|(z, dz)| *z += h * dz);
        state.load.copy_from_slice(&stage.load);
        state.a.copy_from_slice(&stage.a);
        state.time += h;
        project(&system.model, &mut system.data, &mut state.q, &mut state.v).is_closed.then_some(())
    }
}
