//! A robot and its mechanics, vectorised over samples.

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pkm_dyn::constrained::{self, Stabilisation};
use pkm_dyn::effects::{Applied, JointState, Robot as Physics};
use pkm_dyn::jacobian::Reference;
use pkm_dyn::model::{FrameOnBody, Model};
use pkm_dyn::spatial::Pose;
use pkm_dyn::urdf::{self, Description, EffectSpec, Places, export};
use pkm_dyn::{Data, loops};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyType};

use crate::array::{ArrayLike, Motion, Samples, matrices, matrix, read_only, vector};
use crate::long::Progress;
use crate::motion::AtPose;
use crate::{error, long, mechanics, motion, units, workspace};

/// Work over samples as a long call: what it borrows goes with it.
macro_rules! over {
    ($robot:ident, $py:ident, $n:expr, [$($x:ident),*], |$model:ident| $work:expr) => {{
        let n = $n;
        let description = Arc::clone(&$robot.description);
        $(let $x = $x.clone();)*
        long::over($py, n, move || {
            let $model = &description.robot.model;
            $work
        })
    }};
}

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// A robot: rigid bodies, joints, loops, drives, and physics beyond rigid bodies. It never changes; `with_effect` returns another.
#[pyclass(frozen, module = "pkm")]
pub(crate) struct Robot {
    description: Arc<Description>,
}

impl Robot {
    pub(crate) fn new(description: Description) -> Self {
        Self { description: Arc::new(description) }
    }

    pub(crate) fn shared(description: Arc<Description>) -> Self {
        Self { description }
    }

    pub(crate) fn description(&self) -> &Arc<Description> {
        &self.description
    }

    fn model(&self) -> &Model {
        &self.description.robot.model
    }

    fn joint_names(&self, joints: impl IntoIterator<Item = usize>) -> Vec<&str> {
        joints.into_iter().map(|j| self.model().joints[j].name.as_str()).collect()
    }

    /// Motion of the drives.
    fn driven(&self, arrays: [&ArrayLike<'_>; 3]) -> PyResult<Motion> {
        Motion::try_new(arrays, self.model().n_act(), "drive (robot.actuators)")
    }

    /// Samples per joint of the tree.
    fn tree<const N: usize>(&self, arrays: [(&str, &ArrayLike<'_>); N]) -> PyResult<[Samples; N]> {
        Samples::each(arrays, self.model().nv(), "joint (robot.joints)")
    }

    /// The frame of a link.
    fn frame(&self, link: &str) -> PyResult<FrameOnBody> {
        self.model().frame_on("link", link, Pose::identity()).map_err(|e| error::value(e.to_string()))
    }

    /// A matrix at every pose of the drives, loops closed.
    fn of_poses<'py>(&self, py: Python<'py>, q: &ArrayLike<'_>, matrix: AtPose) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let poses = Motion::try_still(q, self.model().n_act(), "drive (robot.actuators)")?;
        let (all, [rows, columns]) = over!(self, py, poses.len(), [poses], |model| motion::matrices_along(model, &poses, matrix))??;
        matrices(py, all, [poses.len(), rows, columns])
    }

    /// Motion of all joints of the tree.
    fn whole(&self, arrays: [&ArrayLike<'_>; 3]) -> PyResult<Motion> {
        Motion::try_new(arrays, self.model().nv(), "joint (robot.joints)")
    }
}

#[pymethods]
impl Robot {
    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        &self.model().name
    }

    /// Names of the joints of the spanning tree, parents first; the order of tree coordinates.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.joint_names(0..self.model().nv())
    }

    /// Names of the driven joints, in the order of `tau`.
    #[getter]
    fn actuators(&self) -> Vec<&str> {
        self.joint_names(self.model().actuators.iter().copied())
    }

    /// Names of the joints that no drive moves.
    #[getter]
    fn passive(&self) -> Vec<&str> {
        self.joint_names(self.model().passive())
    }

    /// Names of the links, the root included.
    #[getter]
    fn links(&self) -> Vec<&str> {
        self.model().links.iter().map(|l| l.name.as_str()).collect()
    }

    /// Number of tree coordinates, which is the number of bodies.
    #[getter]
    fn nv(&self) -> usize {
        self.model().nv()
    }

    /// Number of drives.
    #[getter]
    fn n_act(&self) -> usize {
        self.model().n_act()
    }

    /// Degrees of freedom at the assembly pose: tree coordinates less independent constraints.
    #[getter]
    fn mobility(&self) -> PyResult<usize> {
        let mut data = motion::assembled(self.model())?;
        let q = data.q.clone();
        Ok(loops::mobility(self.model(), &mut data, &q))
    }

    /// Rotor inertia seen at each joint of the tree `[kg | kg·m²]`, shape `(nv,)`.
    #[getter]
    fn armature<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let all: Vec<f64> = self.model().joints.iter().map(|j| j.armature).collect();
        read_only(py, &all)
    }

    /// Physics beyond rigid bodies: dicts with `effect`, `where` and `parameters` (SI).
    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for e in &self.description.robot.effects {
            let values: BTreeMap<&str, f64> = e.entry.parameters.iter().map(|p| p.name).zip(e.values.iter().copied()).collect();
            let one = PyDict::new(py);
            one.set_item("effect", e.entry.name)?;
            one.set_item("where", e.place_names(self.model()))?;
            one.set_item("parameters", values)?;
            out.append(one)?;
        }
        Ok(out)
    }

    /// Tree coordinates that close the loops near the stated assembly `[m | rad]`, shape `(nv,)`.
    fn assemble<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, motion::assembled(self.model())?.q))
    }

    /// Positions of the drives in the middle of their travel `[m | rad]`, shape `(n_act,)`; the assembly's where a drive has no limits.
    fn mid_pose<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_vec(py, loops::mid_pose(self.model()))
    }

    /// Inertial parameters of the bodies, shape `(10 * nv,)`: mass, mx, my, mz, ixx, ixy, iyy, ixz, iyz, izz of each `[kg, kg·m, kg·m²]`.
    ///
    /// About the origin of the body's frame, in Pinocchio's order; what `regressor` is multiplied with.
    fn parameters<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let all = self.model().bodies.iter().flat_map(|b| b.to_vector().iter().copied().collect::<Vec<_>>()).collect();
        PyArray1::from_vec(py, all)
    }

    /// Motion of all joints for a motion of the drives: `(q_tree, v_tree, a_tree)`, each of shape `(n_samples, nv)`.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, n_act)`. The loops are followed from sample to sample.
    fn closed_loop_motion<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let shape = [driven.len(), model.nv()];
        let [q, v, a] = over!(self, py, driven.len(), [driven], |model| motion::tree_motion(model, &driven))??;
        Ok((matrix(py, q, shape)?, matrix(py, v, shape)?, matrix(py, a, shape)?))
    }

    /// Names of the joints whose motion determines all others at the assembly: the drives, or as many of them as there are freedoms.
    #[getter]
    fn independent(&self) -> Vec<&str> {
        self.joint_names(Data::new(self.model()).independent)
    }

    /// Indices into `joints` of the independent coordinates at every pose, shape `(n_samples, independent)`: of more drives than freedoms
    /// those that determine the motion well there, which is another choice where another drive moves faster. q of the drives `(n_samples, n_act)`.
    fn independent_at<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray2<usize>>> {
        let (poses, n) = (Motion::try_still(&q, self.model().n_act(), "drive (robot.actuators)")?, self.independent().len());
        let all = over!(self, py, poses.len(), [poses], |model| motion::independents(model, &poses))??;
        matrix(py, all, [poses.len(), n])
    }

    /// Mass matrix of the tree, shape `(n_samples, nv, nv)`, loops open, rotors included. q `(n_samples, nv)`.
    fn crba<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let ([q], model) = (self.tree([("q", &q)])?, self.model());
        let all = over!(self, py, q.len(), [q], |model| mechanics::mass_matrices(model, &q))?;
        matrices(py, all, [q.len(), model.nv(), model.nv()])
    }

    /// Accelerations of the tree for its efforts, shape `(n_samples, nv)`, loops open. Arguments `(n_samples, nv)`.
    fn aba<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, tau: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let ([q, v, tau], model) = (self.tree([("q", &q), ("v", &v), ("tau", &tau)])?, self.model());
        let all = over!(self, py, q.len(), [q, v, tau], |model| mechanics::accelerations(model, [&q, &v, &tau]))?;
        matrix(py, all, [q.len(), model.nv()])
    }

    /// Coriolis, centrifugal and gravity efforts of the tree, shape `(n_samples, nv)`. Arguments `(n_samples, nv)`.
    fn nle<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let ([q, v], model) = (self.tree([("q", &q), ("v", &v)])?, self.model());
        let all = over!(self, py, q.len(), [q, v], |model| mechanics::nle(model, [&q, &v]))?;
        matrix(py, all, [q.len(), model.nv()])
    }

    /// Efforts that hold the tree against gravity, shape `(n_samples, nv)`. q `(n_samples, nv)`.
    fn generalized_gravity<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let ([q], model) = (self.tree([("q", &q)])?, self.model());
        let all = over!(self, py, q.len(), [q], |model| mechanics::gravity(model, &q))?;
        matrix(py, all, [q.len(), model.nv()])
    }

    /// Accelerations `(n_samples, nv)` and loop efforts `(n_samples, rows)` for efforts of the tree, loops closed:
    /// `M a + nle = tau + J^T lambda`, `J a + drift + 2 rate J v + rate² gap = 0`. Arguments `(n_samples, nv)`; q and v close the loops.
    /// `stabilisation` is the rate at which gaps of a simulated robot are closed `[1/s]`; zero leaves them.
    #[pyo3(signature = (q, v, tau, *, stabilisation = 0.0))]
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        tau: ArrayLike<'py>,
        stabilisation: f64,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        if !(stabilisation.is_finite() && stabilisation >= 0.0) {
            return Err(error::value(format!("stabilisation = {stabilisation} 1/s (must be finite and >= 0)")));
        }
        let ([q, v, tau], model) = (self.tree([("q", &q), ("v", &v), ("tau", &tau)])?, self.model());
        let rate = Stabilisation { rate: stabilisation };
        let [a, lambda] = over!(self, py, q.len(), [q, v, tau], |model| mechanics::constrained(model, [&q, &v, &tau], rate))??;
        Ok((matrix(py, a, [q.len(), model.nv()])?, matrix(py, lambda, [q.len(), model.n_constraints()])?))
    }

    /// Closure error of every constraint row `(n_samples, rows)` and its Jacobian `(n_samples, rows, nv)`. q `(n_samples, nv)`.
    fn loop_gap<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<(Matrix<'py>, Bound<'py, PyArray3<f64>>)> {
        let ([q], model) = (self.tree([("q", &q)])?, self.model());
        let [gap, jacobian] = over!(self, py, q.len(), [q], |model| mechanics::gaps(model, &q))?;
        let rows = model.n_constraints();
        Ok((matrix(py, gap, [q.len(), rows])?, matrices(py, jacobian, [q.len(), rows, model.nv()])?))
    }

    /// Kinetic and potential energy `[J]`, shape `(n_samples,)` each. Arguments `(n_samples, nv)`.
    fn energies<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let [q, v] = self.tree([("q", &q), ("v", &v)])?;
        let [kinetic, potential] = over!(self, py, q.len(), [q, v], |model| mechanics::energies(model, [&q, &v]))?;
        Ok((PyArray1::from_vec(py, kinetic), PyArray1::from_vec(py, potential)))
    }

    /// Centre of mass `[m]`, shape `(n_samples, 3)`, and its Jacobian `(n_samples, 3, nv)`. q `(n_samples, nv)`.
    fn center_of_mass<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<(Matrix<'py>, Bound<'py, PyArray3<f64>>)> {
        let ([q], model) = (self.tree([("q", &q)])?, self.model());
        let [centre, jacobian] = over!(self, py, q.len(), [q], |model| mechanics::centres(model, &q))?;
        Ok((matrix(py, centre, [q.len(), 3])?, matrices(py, jacobian, [q.len(), 3, model.nv()])?))
    }

    /// Kinetic and potential energy per inertial parameter `[J per unit]`, shape `(n_samples, 10 * nv)` each: times `parameters()` they are
    /// `energies` without rotors. Arguments `(n_samples, nv)`.
    fn energy_regressors<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let ([q, v], n) = (self.tree([("q", &q), ("v", &v)])?, 10 * self.model().nv());
        let [kinetic, potential] = over!(self, py, q.len(), [q, v], |model| mechanics::energy_regressors(model, [&q, &v]))?;
        Ok((matrix(py, kinetic, [q.len(), n])?, matrix(py, potential, [q.len(), n])?))
    }

    /// Velocity and acceleration of the origin of a link's frame in the root's axes, shape `(n_samples, 6)` each, linear part first
    /// `[m/s, rad/s]`, `[m/s², rad/s²]`: the derivatives of its position, gravity not in them. Arguments `(n_samples, nv)`.
    fn frame_motion<'py>(
        &self,
        py: Python<'py>,
        link: &str,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let ([q, v, a], frame) = (self.tree([("q", &q), ("v", &v), ("a", &a)])?, self.frame(link)?);
        let [v, a] = over!(self, py, q.len(), [frame, q, v, a], |model| mechanics::frame_motions(model, &frame, [&q, &v, &a]))?;
        Ok((matrix(py, v, [q.len(), 6])?, matrix(py, a, [q.len(), 6])?))
    }

    /// Pose of a link's frame in the root frame, shape `(n_samples, 4, 4)`. q `(n_samples, nv)`.
    fn frame_pose<'py>(&self, py: Python<'py>, link: &str, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let ([q], frame) = (self.tree([("q", &q)])?, self.frame(link)?);
        let all = over!(self, py, q.len(), [frame, q], |model| mechanics::frame_poses(model, &frame, &q))?;
        matrices(py, all, [q.len(), 4, 4])
    }

    /// Jacobian of a link's frame, shape `(n_samples, 6, nv)`, linear part first; its time derivative when `v` is given.
    ///
    /// `reference` is `"world"`, `"local"` or `"local_world_aligned"`, as in Pinocchio. Arguments `(n_samples, nv)`.
    #[pyo3(signature = (link, q, v = None, *, reference = "local_world_aligned"))]
    fn frame_jacobian<'py>(
        &self,
        py: Python<'py>,
        link: &str,
        q: ArrayLike<'py>,
        v: Option<ArrayLike<'py>>,
        reference: &str,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (model, frame) = (self.model(), self.frame(link)?);
        let reference = match reference {
            "world" => Reference::World,
            "local" => Reference::Local,
            "local_world_aligned" => Reference::LocalWorldAligned,
            _ => return Err(error::value(format!("reference = {reference:?} (must be world, local or local_world_aligned)"))),
        };
        let (q, v) = match v {
            None => {
                let [q] = self.tree([("q", &q)])?;
                (q, None)
            }
            Some(v) => {
                let [q, v] = self.tree([("q", &q), ("v", &v)])?;
                (q, Some(v))
            }
        };
        let all = over!(self, py, q.len(), [frame, q, v], |model| mechanics::frame_jacobians(model, &frame, &q, v.as_ref(), reference))?;
        matrices(py, all, [q.len(), 6, model.nv()])
    }

    /// Tree positions moved by a velocity held for unit time, shape `(n_samples, nv)`. Arguments `(n_samples, nv)`.
    fn integrate<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, dv: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let ([q, dv], model) = (self.tree([("q", &q), ("dv", &dv)])?, self.model());
        let all = over!(self, py, q.len(), [q, dv], |model| mechanics::integrated(model, [&q, &dv]))?;
        matrix(py, all, [q.len(), model.nv()])
    }

    /// The velocity that leads from one tree position to another in unit time, shape `(n_samples, nv)`. Arguments `(n_samples, nv)`.
    fn difference<'py>(&self, py: Python<'py>, from_q: ArrayLike<'py>, to_q: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let ([from, to], model) = (self.tree([("from_q", &from_q), ("to_q", &to_q)])?, self.model());
        let all = over!(self, py, from.len(), [from, to], |model| mechanics::differences(model, [&from, &to]))?;
        matrix(py, all, [from.len(), model.nv()])
    }

    /// Mass matrix in the independent coordinates, shape `(n_samples, independent, independent)`. q of the drives `(n_samples, n_act)`.
    fn reduced_mass_matrix<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, constrained::reduced_mass_matrix)
    }

    /// Columns of rotor inertia, viscous and Coulomb friction of every joint, passive ones included, in the independent coordinates,
    /// shape `(n_samples, independent, 3 * nv)`. Arguments `(n_samples, n_act)`.
    fn friction_regressor<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let all = over!(self, py, driven.len(), [driven], |model| motion::friction_regressors(model, &driven))??;
        matrices(py, all, [driven.len(), self.independent().len(), 3 * model.nv()])
    }

    /// Efforts of the loops for a motion of the drives `[N | N·m]`, shape `(n_samples, rows)`: link a on link b, seen in a.
    fn loop_efforts<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, a: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let all = over!(self, py, driven.len(), [driven], |model| motion::loop_efforts(model, &driven))??;
        matrix(py, all, [driven.len(), model.n_constraints()])
    }

    /// Wrench that each joint of the tree transmits to its body for a motion of the drives, loops closed, shape `(n_samples, nv, 6)`: force
    /// `[N]` and moment about the root's origin `[N·m]`, in the root's axes. Arguments `(n_samples, n_act)`.
    fn joint_wrenches<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let all = over!(self, py, driven.len(), [driven], |model| motion::joint_wrenches(model, &driven))??;
        matrices(py, all, [driven.len(), model.nv(), 6])
    }

    /// Efforts of the drives that strain the robot and move nothing, as orthonormal columns, shape `(n_samples, n_act, n_act - mobility)`:
    /// no columns unless there are more drives than freedoms. q of the drives `(n_samples, n_act)`.
    fn internal_efforts<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, loops::internal_efforts)
    }

    /// Wrench that each loop's joint exerts on the link of its frame b for a motion of the drives, shape `(n_samples, loops, 6)`: force
    /// `[N]` and moment about b's origin `[N·m]`, in the axes of frame a; the link of a feels the opposite. Arguments `(n_samples, n_act)`.
    fn loop_wrenches<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let all = over!(self, py, driven.len(), [driven], |model| motion::loop_wrenches(model, &driven))??;
        matrices(py, all, [driven.len(), model.loops.len(), 6])
    }

    /// Motion of every joint of the tree per motion of the independent coordinates (`independent_at`), `v_tree = G v_ind`, shape
    /// `(n_samples, nv, independent)`. q of the drives `(n_samples, n_act)`.
    fn reduction<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, |_, data| &data.reduction)
    }

    /// Motion of the drives per motion of the independent coordinates, `v_act = B v_ind`, shape `(n_samples, n_act, independent)`: the
    /// identity unless there are more drives than freedoms. q of the drives `(n_samples, n_act)`.
    fn drive_jacobian<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, loops::drive_jacobian)
    }

    /// The smallest efforts of the drives that supply those of the independent coordinates, `tau_act = D tau_ind`, shape
    /// `(n_samples, n_act, independent)`. q of the drives `(n_samples, n_act)`.
    fn distribution<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, loops::distribution)
    }

    /// Motion of every joint of the tree per motion of each drive, `R = G Dᵀ`, shape `(n_samples, nv, n_act)`; its transpose brings
    /// efforts of the tree to the drives. q of the drives `(n_samples, n_act)`.
    fn drive_reduction<'py>(&self, py: Python<'py>, q: ArrayLike<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.of_poses(py, &q, loops::drive_reduction)
    }

    /// The state with loops closed, the independent coordinates (`independent`) kept: `(q, v)`, each `(n_samples, nv)`, as the arguments are.
    fn project<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let ([q, v], model) = (self.tree([("q", &q), ("v", &v)])?, self.model());
        let shape = [q.len(), model.nv()];
        let [q, v] = over!(self, py, q.len(), [q, v], |model| mechanics::projected(model, [&q, &v]))??;
        Ok((matrix(py, q, shape)?, matrix(py, v, shape)?))
    }

    /// Coordinates of the output, x y z `[m]` and rx ry rz `[rad]` with rotation `Rx Ry Rz`, `(n_samples, 6)`, and their rates per rate of
    /// each joint of the tree, `(n_samples, 6, nv)`. q `(n_samples, nv)`; `link`: a link, sensor or loop, by default what stands out.
    #[pyo3(signature = (q, *, link = None))]
    fn output_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        link: Option<&str>,
    ) -> PyResult<(Matrix<'py>, Bound<'py, PyArray3<f64>>)> {
        let ([q], model) = (self.tree([("q", &q)])?, self.model());
        let (output, n) = (workspace::output(model, link)?, q.len());
        let [places, rates] = over!(self, py, n, [q], |model| mechanics::outputs(model, &output, &q))?;
        Ok((matrix(py, places, [n, 6])?, matrices(py, rates, [n, 6, model.nv()])?))
    }

    /// Effort of one joint's own laws, friction of the URDF and effects of the robot file, `[N | N·m]`, shape of `v`.
    ///
    /// `v` `[m/s | rad/s]` of shape `(n_samples,)`; `q` `[m | rad]` and the transmitted effort `load` `[N | N·m]`: the same throughout.
    /// At rest no law says what friction is: zero is returned there. Laws with a memory, and those of links, are not in it.
    #[pyo3(signature = (joint, v, *, q = 0.0, load = 0.0))]
    fn joint_effort<'py>(&self, py: Python<'py>, joint: &str, v: ArrayLike<'py>, q: f64, load: f64) -> PyResult<Vector<'py>> {
        let model = self.model();
        let known = || self.joint_names(0..model.nv()).join(", ");
        let j = model.joint_index(joint).ok_or_else(|| error::value(format!("no joint {joint:?} (there are: {})", known())))?;
        let v = vector("v", &v, None)?;
        let at = |v: &f64| {
            let sign = if *v == 0.0 { 0.0 } else { v.signum() };
            self.description.robot.joint_effort(j, &JointState { q, v: *v, sign, load, ..JointState::default() })
        };
        Ok(PyArray1::from_vec(py, v.iter().map(at).collect()))
    }

    /// Effort of the drives `[N | N·m]`, shape `(n_samples, n_act)`: rigid bodies and rotor inertia, no friction.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, n_act)`. The loops are followed from sample to sample.
    fn inverse_dynamics<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, a: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let tau = over!(self, py, driven.len(), [driven], |model| motion::inverse_dynamics(model, &driven))??;
        matrix(py, tau, [driven.len(), model.n_act()])
    }

    /// Regressor of the independent coordinates, which are the drives unless there are more drives than freedoms (`independent_at`), shape
    /// `(n_samples, independent, 10 * nv)`.
    ///
    /// `actuated_regressor(q, v, a) @ parameters()` is `inverse_dynamics(q, v, a)` less rotor inertia. Arguments as there. `out` is an array of
    /// that shape to write into, C-contiguous float64.
    #[pyo3(signature = (q, v, a, *, out = None))]
    fn actuated_regressor<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
        out: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let shape = [driven.len(), self.independent().len(), 10 * model.nv()];
        let array = |out: Bound<'py, PyAny>| {
            let wrong = |_| error::value(format!("out must be an array of numpy, float64, of shape {shape:?}"));
            out.cast_into::<PyArray3<f64>>().map_err(wrong)
        };
        let out = out.map_or_else(|| Ok(PyArray3::zeros(py, shape, false)), array)?;
        if out.shape() != shape || !out.is_c_contiguous() {
            return Err(error::value(format!("out has shape {:?}, must be {shape:?} and C-contiguous", out.shape())));
        }
        let mut writable = out.try_readwrite().map_err(|e| error::value(format!("out: {e}")))?;
        let values = writable.as_slice_mut()?;
        py.detach(|| motion::actuated_regressors(model, &driven, values))?;
        drop(writable);
        Ok(out)
    }

    /// Products of the regressor `W` and the efforts `tau` of the independent coordinates `[N | N·m]`, shape `(n_samples, independent)`:
    /// `(WᵀW, Wᵀtau, tauᵀtau)`, of shapes `(10 * nv, 10 * nv)`, `(10 * nv,)` and one number.
    ///
    /// `W` is that of `actuated_regressor(q, v, a)` and is never stored, so a day of samples needs no more memory than one. What least squares
    /// wants; the condition number is squared, so directions below 1e-8 of the largest are rounding.
    fn regressor_products<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
        tau: ArrayLike<'py>,
    ) -> PyResult<(Matrix<'py>, Vector<'py>, f64)> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let tau = Samples::try_new("tau", &tau, self.independent().len(), "coordinate (robot.independent)")?;
        if tau.len() != driven.len() {
            return Err(error::value(format!("tau has {} samples, q has {}", tau.len(), driven.len())));
        }
        let n = 10 * model.nv();
        let found = over!(self, py, driven.len(), [driven, tau], |model| motion::products(model, &driven, &tau))??;
        let w_w = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|at| found.w_w[at]).collect();
        Ok((matrix(py, w_w, [n, n])?, PyArray1::from_vec(py, found.w_tau), found.tau_tau))
    }

    /// Generalized efforts of the spanning tree `[N | N·m]`, shape `(n_samples, nv)`: rigid bodies and rotor inertia, loops open.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, nv)`, all joints.
    fn rnea<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, a: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let (whole, model) = (self.whole([&q, &v, &a])?, self.model());
        let tau = over!(self, py, whole.len(), [whole], |model| motion::tree_efforts(model, &whole))?;
        matrix(py, tau, [whole.len(), model.nv()])
    }

    /// Regressor of the spanning tree, shape `(n_samples, nv, 10 * nv)`: `rnea` less rotor inertia, per inertial parameter.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, nv)`, all joints.
    fn joint_torque_regressor<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (whole, model) = (self.whole([&q, &v, &a])?, self.model());
        let all = over!(self, py, whole.len(), [whole], |model| motion::tree_regressors(model, &whole))?;
        matrices(py, all, [whole.len(), model.nv(), 10 * model.nv()])
    }

    /// Distances from singularities at every pose of the drives, as a dict of arrays with one entry per sample.
    ///
    /// q `[m | rad]`: shape `(n_samples, n_act)`. `parallel` (type 2) and `serial` (type 1) are the smallest singular values of dq/dx and
    /// dx/dq with metres divided by `length`, `condition` that of dx/dq, `passive` and `constraint` those of the loops' constraints.
    #[pyo3(signature = (q, *, link=None, coordinates=None, length=1.0))]
    fn singularities<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        link: Option<&str>,
        coordinates: Option<Vec<String>>,
        length: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let poses = Motion::try_still(&q, self.model().n_act(), "drive (robot.actuators)")?;
        workspace::singularities(py, self.model(), &poses, &workspace::Question { link, coordinates, length })
    }

    /// Which poses can be reached: a dict of arrays with one axis per entry of `axes`, a dict from names to values.
    ///
    /// Names are x y z rx ry rz of the link, or driven joints; `cause` indexes `causes`, 0 is reachable. `progress`: a callable that takes
    /// the share done, or True for a bar.
    #[pyo3(signature = (axes, *, link=None, at=None, cone_deg=None, singularity_limit=0.0, condition_limit=f64::INFINITY, length=1.0, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn workspace<'py>(
        &self,
        py: Python<'py>,
        axes: &Bound<'py, PyDict>,
        link: Option<&str>,
        at: Option<BTreeMap<String, f64>>,
        cone_deg: Option<f64>,
        singularity_limit: f64,
        condition_limit: f64,
        length: f64,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let progress = &Progress::of(py, progress, "scanning")?;
        let limits = workspace::Limits {
            link,
            at: at.unwrap_or_default(),
            cone_deg,
            singularity: singularity_limit,
            condition: condition_limit,
            length,
            progress,
        };
        workspace::workspace(py, self.model(), axes, &limits)
    }

    /// The same robot with one more effect of the library at a joint or link; parameters are keywords, SI.
    #[pyo3(signature = (name, r#where, **parameters))]
    fn with_effect(&self, name: &str, r#where: &str, parameters: Option<BTreeMap<String, f64>>) -> PyResult<Self> {
        let parameters: BTreeMap<String, f64> = parameters.unwrap_or_default();
        let mut description = (*self.description).clone();
        let pairs: Vec<(String, f64)> = parameters.iter().map(|(k, v)| (k.clone(), *v)).collect();
        let applied = Applied::try_new(&description.bare, name, r#where, &pairs).map_err(|e| error::effect(&e))?;
        let mut effects = description.robot.effects.clone();
        effects.push(applied);
        description.robot = Physics::new(description.bare.clone(), effects);
        description.spec.effects.push(EffectSpec { name: name.to_string(), places: Places::One(r#where.to_string()), parameters });
        // The text is what travels: it must have the effect as well.
        description.toml_text = toml::to_string_pretty(&description.spec).map_err(|e| error::value(format!("robot.toml: {e}")))?;
        Ok(Self::new(description))
    }

    /// The robot as the texts of its robot.toml and of its URDF, every effect included: what `from_texts` reads.
    fn texts(&self) -> (&str, &str) {
        (&self.description.toml_text, &self.description.urdf_text)
    }

    /// A robot from the texts of a robot.toml and of the URDF that it names; `ValueError` as `load`.
    #[classmethod]
    fn from_texts(_cls: &Bound<'_, PyType>, toml: &str, urdf: &str) -> PyResult<Self> {
        Ok(Self::new(urdf::parse(toml, urdf, ["robot.toml", "robot.urdf"]).map_err(|e| error::load(&e))?))
    }

    /// Unit of a signal of this robot's recordings, by its name (`q.<joint>`, `tau.<joint>`, ...); None where that says nothing.
    fn unit(&self, signal: &str) -> Option<&'static str> {
        units::of(self.model(), signal)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, String))> {
        let (toml, urdf) = slf.get().texts();
        Ok((slf.get_type().getattr("from_texts")?, (toml.to_string(), urdf.to_string())))
    }

    /// The robot as MJCF, for MuJoCo; its closed assembly is the keyframe `home`. Comments at the head say what is not in it.
    fn to_mjcf(&self) -> PyResult<String> {
        Ok(export::mjcf(&self.description.robot).map_err(|e| error::export(&e))?.xml)
    }

    /// The robot for Pinocchio as the texts of `robot.urdf` and `robot.yaml`, the loop file of toolbox-parallel-robots.
    fn to_gepetto(&self) -> PyResult<(String, String)> {
        let written = export::gepetto(&self.description).map_err(|e| error::export(&e))?;
        Ok((written.urdf, written.yaml))
    }

    fn __repr__(&self) -> String {
        let m = self.model();
        let beyond = self.description.robot.effects.len();
        let effects = if beyond == 0 { String::new() } else { format!(", {beyond} effects") };
        format!("<Robot {}: {} joints, {} driven, {} loops{effects}>", m.name, m.nv(), m.n_act(), m.loops.len())
    }
}

/// Reads the robot.toml at `path` and the URDF it names.
///
/// `OSError` for files that cannot be read, `ValueError` for what is in them; one line that names file, place, value and limit.
#[pyfunction]
pub(crate) fn load(py: Python<'_>, path: PathBuf) -> PyResult<Robot> {
    let description = py.detach(|| urdf::load(&path)).map_err(|e| {
        let shipped = path.to_str().filter(|name| pkm_robots::find(name).is_some());
        shipped.map_or_else(|| error::load(&e), |name| error::missing(format!("{e}; the shipped robot is pkm.robots.load({name:?})")))
    })?;
    Ok(Robot::new(description))
}
