//! Where the drives' coordinates meet those of a task: its position, its Jacobians, the forces on it, and the way back.

use alloc::vec::Vec;

use nalgebra::DMatrix;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{Coordinate, Guide, Output, assemble, coordinates, drive_jacobian, output_jacobian};
use pkm_dyn::svd::Svd;
use pkm_dyn::{Data, Model, math};

use crate::controller::{ConfigError, Input};
use crate::pose_walk::walk_if_far;

/// A task of `M` coordinates at one pose of `N` drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task<const N: usize, const M: usize> {
    /// Coordinates of the task `[m | rad]`.
    pub x: [f64; M],
    /// Rates of the task over rates of the drives; of those that fit, the one of least norm where there are more drives.
    pub jacobian: [[f64; N]; M],
    /// Rates of the drives over rates of the task.
    pub inverse_jacobian: [[f64; M]; N],
    /// Smallest singular value of the latter, angles over a length: zero where the drives no longer hold the task.
    pub margin: f64,
}

impl<const N: usize, const M: usize> Task<N, M> {
    /// Rates of the drives for rates of the task.
    #[must_use]
    pub fn to_drives(&self, x_dot: &[f64; M]) -> [f64; N] {
        core::array::from_fn(|i| (0..M).map(|k| self.inverse_jacobian[i][k] * x_dot[k]).sum())
    }

    /// Rates of the task for rates of the drives.
    #[must_use]
    pub fn of_drives(&self, v: &[f64; N]) -> [f64; M] {
        core::array::from_fn(|k| (0..N).map(|i| self.jacobian[k][i] * v[i]).sum())
    }

    /// Efforts of the drives that amount to forces on the task; of those that fit, the ones of least norm.
    #[must_use]
    pub fn efforts(&self, force: &[f64; M]) -> [f64; N] {
        core::array::from_fn(|i| (0..M).map(|k| self.jacobian[k][i] * force[k]).sum())
    }

    fn is_finite(&self) -> bool {
        let all = self.x.iter().chain(self.jacobian.iter().flatten()).chain(self.inverse_jacobian.iter().flatten());
        all.chain([&self.margin]).all(|x| x.is_finite())
    }
}

/// What knows a task: geometry, and which measured forces act on it.
pub trait TaskMap<const N: usize, const M: usize> {
    /// Room, and the pose that was last looked at.
    type State;

    /// The state before the first step. The one place that may allocate.
    fn at_rest(&self) -> Self::State;

    /// The task at positions `q` of the drives `[m | rad]`; none where loops do not close or the drives do not determine it.
    fn at(&self, state: &mut Self::State, q: &[f64; N]) -> Option<Task<N, M>>;

    /// Positions of the drives `[m | rad]` for coordinates `x` of the task; none where it is out of reach.
    fn drives(&self, state: &mut Self::State, x: &[f64; M]) -> Option<[f64; N]>;

    /// Forces of the environment on the task, measured and wanted `[N | N·m]`.
    fn forces(&self, input: &Input<N>, task: &Task<N, M>) -> [[f64; M]; 2];
}

/// Smallest singular value and left inverse of an N × M matrix whose columns count in units of `length`; none without full column rank.
fn left_inverse<const N: usize, const M: usize>(svd: &mut Svd, A: &[[f64; M]; N], length: &[f64; M]) -> Option<(f64, [[f64; N]; M])> {
    svd.factor(|i, k| A[i][k] / length[k]);
    let values = svd.values();
    let least = values.last().copied().unwrap_or(0.0);
    if least.is_nan() || least <= 1e-12 * values.first().copied().unwrap_or(0.0) {
        return None;
    }
    let entry = |k: usize, i: usize| (0..M).map(|s| svd.right(s)[k] * svd.image(s)[i] / (values[s] * values[s])).sum::<f64>() / length[k];
    Some((least, core::array::from_fn(|k| core::array::from_fn(|i| entry(k, i)))))
}

/// The drives themselves are the task. The environment's efforts are what the model asks for and the drives do not give, `tau_ff − tau_meas`:
/// good as long as the model is and accelerations are small. None are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct JointTask;

impl<const N: usize> TaskMap<N, N> for JointTask {
    type State = ();

    fn at_rest(&self) -> Self::State {}

    fn at(&self, (): &mut (), q: &[f64; N]) -> Option<Task<N, N>> {
        let one = core::array::from_fn(|i| core::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        Some(Task { x: *q, jacobian: one, inverse_jacobian: one, margin: 1.0 })
    }

    fn drives(&self, (): &mut (), x: &[f64; N]) -> Option<[f64; N]> {
        Some(*x)
    }

    fn forces(&self, input: &Input<N>, _: &Task<N, N>) -> [[f64; N]; 2] {
        [core::array::from_fn(|k| input.tau_ff[k] - input.tau_meas[k]), [0.0; N]]
    }
}

/// A task that is linear in the drives, `q = q_0 + J_inv·(x − x_0)`: a robot near one pose, or a table of slides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearTask<const N: usize, const M: usize> {
    q_0: [f64; N],
    x_0: [f64; M],
    task: Task<N, M>,
    components: [usize; M],
}

impl<const N: usize, const M: usize> LinearTask<N, M> {
    /// `inverse_jacobian` is dq/dx; `components` are those of the wrench (fx fy fz mx my mz) that act on the task's coordinates.
    ///
    /// # Errors
    /// Numbers that are not finite, components above 5, a Jacobian without full column rank.
    pub fn try_new(q_0: [f64; N], x_0: [f64; M], inverse_jacobian: [[f64; M]; N], components: [usize; M]) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        for (what, values) in [("q_0", &q_0[..]), ("x_0", &x_0), ("inverse_jacobian", inverse_jacobian.as_flattened())] {
            if let Some(k) = values.iter().position(|x| !x.is_finite()) {
                return bad(k, what, values[k], "must be finite");
            }
        }
        if let Some(k) = components.iter().position(|&c| c > 5) {
            return bad(k, "component", components[k] as f64, "must be 0 to 5");
        }
        match left_inverse(&mut Svd::new(N, M), &inverse_jacobian, &[1.0; M]) {
            Some((margin, jacobian)) => Ok(Self { q_0, x_0, task: Task { x: x_0, jacobian, inverse_jacobian, margin }, components }),
            None => bad(0, "inverse_jacobian", 0.0, "must have full column rank"),
        }
    }
}

impl<const N: usize, const M: usize> TaskMap<N, M> for LinearTask<N, M> {
    type State = ();

    fn at_rest(&self) -> Self::State {}

    fn at(&self, (): &mut (), q: &[f64; N]) -> Option<Task<N, M>> {
        let moved = self.task.of_drives(&core::array::from_fn(|i| q[i] - self.q_0[i]));
        let task = Task { x: core::array::from_fn(|k| self.x_0[k] + moved[k]), ..self.task };
        task.is_finite().then_some(task)
    }

    fn drives(&self, (): &mut (), x: &[f64; M]) -> Option<[f64; N]> {
        let moved = self.task.to_drives(&core::array::from_fn(|k| x[k] - self.x_0[k]));
        let q: [f64; N] = core::array::from_fn(|i| self.q_0[i] + moved[i]);
        q.iter().all(|q| q.is_finite()).then_some(q)
    }

    fn forces(&self, input: &Input<N>, _: &Task<N, M>) -> [[f64; M]; 2] {
        [self.components.map(|c| input.wrench_meas[c]), self.components.map(|c| input.wrench_ref[c])]
    }
}

/// Coordinates of a frame of a robot's model, closed loops included. The wrench acts at the frame's origin, in the root's axes.
#[derive(Debug, Clone)]
pub struct PlatformTask<const M: usize> {
    model: Model,
    output: Output,
    components: [usize; M],
    length: [f64; M],
}

/// What a [`PlatformTask`] remembers.
#[derive(Debug, Clone)]
pub struct PlatformState {
    here: Data,
    goal: Data,
    guide: Guide,
    jacobian: DMatrix<f64>,
    of_output: Svd,
    of_drives: Svd,
    zero: Vec<f64>,
    /// Tree coordinates of the last pose at which the loops closed; the assembly before there is any.
    good: Vec<f64>,
}

impl<const M: usize> PlatformTask<M> {
    /// `components` index the coordinates x y z rx ry rz of `output`, as many as the robot has freedoms; `length` `[m]` makes angles
    /// comparable with lengths in the margin.
    ///
    /// # Errors
    /// Components above 5, a length that is not positive, another number of coordinates than freedoms, an assembly that does not close.
    pub fn try_new(model: Model, output: Output, components: [usize; M], length: f64) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        if let Some(k) = components.iter().position(|&c| c > 5) {
            return bad(k, "component", components[k] as f64, "must be 0 to 5");
        }
        if !(length.is_finite() && length > 0.0) {
            return bad(0, "length", length, "must be finite and > 0");
        }
        let mut data = Data::new(&model);
        let closure = assemble(&model, &mut data);
        if !closure.is_closed {
            return bad(0, "loop gap of the assembly", closure.gap, "must close");
        }
        if data.reduction.ncols() != M {
            return bad(0, "freedoms", data.reduction.ncols() as f64, "must be as many as coordinates of the task");
        }
        let length = components.map(|c| if c < 3 { 1.0 } else { length });
        Ok(Self { model, output, components, length })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }
}

impl<const N: usize, const M: usize> TaskMap<N, M> for PlatformTask<M> {
    type State = PlatformState;

    fn at_rest(&self) -> PlatformState {
        let model = &self.model;
        let mut here = Data::new(model);
        // Closed once already, when the task was made.
        let _ = assemble(model, &mut here);
        let prescribed = self.components.into_iter().map(Coordinate::Output).collect();
        PlatformState {
            goal: here.clone(),
            guide: Guide::new(model, self.output.clone(), prescribed),
            jacobian: DMatrix::zeros(6, model.nv()),
            of_output: Svd::new(M, M),
            of_drives: Svd::new(N, M),
            zero: alloc::vec![0.0; N],
            good: here.q.clone(),
            here,
        }
    }

    fn at(&self, state: &mut PlatformState, q: &[f64; N]) -> Option<Task<N, M>> {
        let PlatformState { here, jacobian, of_output, of_drives, zero, good, .. } = state;
        let model = &self.model;
        if model.n_act() != N || q.iter().any(|q| !q.is_finite()) {
            return None;
        }
        if !walk_if_far(model, here, q) || !closed_loop_motion(model, here, q, zero, zero).is_closed {
            // What Newton left behind is no start for the next sample.
            here.q.copy_from_slice(good);
            return None;
        }
        good.copy_from_slice(&here.q);
        output_jacobian(model, here, &self.output, jacobian);
        let drives = drive_jacobian(model, here);
        let (mut forward, mut along) = ([[0.0; M]; M], [[0.0; M]; N]);
        let nv = model.nv();
        let b: [[f64; M]; N] = core::array::from_fn(|i| core::array::from_fn(|k| drives[(i, k)]));
        for (k, row) in forward.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = (0..nv).map(|t| jacobian[(self.components[k], t)] * here.reduction[(t, j)]).sum();
            }
        }
        let (_, back) = left_inverse(of_output, &forward, &[1.0; M])?;
        for i in 0..N {
            for k in 0..M {
                along[i][k] = (0..M).map(|j| b[i][j] * back[j][k]).sum();
            }
        }
        let (margin, inverse) = left_inverse(of_drives, &along, &self.length)?;
        let pose = coordinates(&self.output.pose(here));
        let task = Task { x: self.components.map(|c| pose[c]), jacobian: inverse, inverse_jacobian: along, margin };
        task.is_finite().then_some(task)
    }

    fn drives(&self, state: &mut PlatformState, x: &[f64; M]) -> Option<[f64; N]> {
        let PlatformState { goal, guide, .. } = state;
        if self.model.n_act() != N || x.iter().any(|x| !x.is_finite()) || !guide.move_to(&self.model, goal, x) {
            return None;
        }
        Some(core::array::from_fn(|k| goal.q[self.model.actuators[k]]))
    }

    fn forces(&self, input: &Input<N>, task: &Task<N, M>) -> [[f64; M]; 2] {
        // Angles are turns about x, about the turned y, and about the z that both have turned.
        let angle = |c: usize| self.components.iter().position(|&k| k == c).map_or(0.0, |k| task.x[k]);
        let ((sa, ca), (sb, cb)) = (math::sin_cos(angle(3)), math::sin_cos(angle(4)));
        let axes = [[1.0, 0.0, 0.0], [0.0, ca, sa], [sb, -sa * cb, ca * cb]];
        [&input.wrench_meas, &input.wrench_ref]
            .map(|w| self.components.map(|c| if c < 3 { w[c] } else { (0..3).map(|i| axes[c - 3][i] * w[3 + i]).sum() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_task_goes_there_and_back_and_power_is_the_same_on_both_sides() {
        let J = [[1.0, 0.3], [1.0, -0.2], [0.5, 0.1]];
        let map = LinearTask::try_new([0.1, 0.2, 0.3], [1.0, -1.0], J, [2, 3]).unwrap();
        let q = map.drives(&mut (), &[1.05, -0.98]).unwrap();
        let task = map.at(&mut (), &q).unwrap();
        assert!((task.x[0] - 1.05).abs() < 1e-14 && (task.x[1] + 0.98).abs() < 1e-14);
        let (x_dot, force) = ([0.2, -0.4], [30.0, 2.0]);
        let (v, tau) = (task.to_drives(&x_dot), task.efforts(&force));
        let power: f64 = v.iter().zip(tau).map(|(v, t)| v * t).sum();
        assert!((power - (0.2 * 30.0 - 0.4 * 2.0)).abs() < 1e-13);
        assert!(LinearTask::try_new([0.0; 2], [0.0; 2], [[1.0, 1.0], [2.0, 2.0]], [0, 1]).is_err());
        assert!(LinearTask::try_new([0.0], [0.0], [[f64::NAN]], [0]).is_err());
        assert!(LinearTask::try_new([0.0], [0.0], [[1.0]], [6]).is_err());
        assert!(map.at(&mut (), &[f64::MAX; 3]).is_none() || map.at(&mut (), &[f64::NAN; 3]).is_none());
    }
}
