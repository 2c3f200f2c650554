//! A robot and its mechanics, vectorised over samples.

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3};
use pkm_dyn::effects::{Applied, CATALOGUE, Energy, Entry, PlaceKind, Robot as Physics};
use pkm_dyn::loops;
use pkm_dyn::model::{JointKind, Model};
use pkm_dyn::urdf::{self, Description, EffectSpec, Places, export};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::{ArrayLike, Motion, matrices, matrix, read_only};
use crate::{error, motion};

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
            one.set_item("where", [e.place_name(self.model())])?;
            one.set_item("parameters", values)?;
            out.append(one)?;
        }
        Ok(out)
    }

    /// Tree coordinates that close the loops near the stated assembly `[m | rad]`, shape `(nv,)`.
    fn assemble<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, motion::assembled(self.model())?.q))
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
    fn tree_motion<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let shape = [driven.len(), model.nv()];
        let [q, v, a] = py.detach(|| motion::tree_motion(model, &driven))?;
        Ok((matrix(py, q, shape)?, matrix(py, v, shape)?, matrix(py, a, shape)?))
    }

    /// Effort of the drives `[N | N·m]`, shape `(n_samples, n_act)`: rigid bodies and rotor inertia, no friction.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, n_act)`. The loops are followed from sample to sample.
    fn inverse_dynamics<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, a: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let tau = py.detach(|| motion::inverse_dynamics(model, &driven))?;
        matrix(py, tau, [driven.len(), model.n_act()])
    }

    /// Regressor of the drives, shape `(n_samples, n_act, 10 * nv)`.
    ///
    /// `regressor(q, v, a) @ parameters()` is `inverse_dynamics(q, v, a)` less rotor inertia. Arguments as there.
    fn regressor<'py>(
        &self,
        py: Python<'py>,
        q: ArrayLike<'py>,
        v: ArrayLike<'py>,
        a: ArrayLike<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (driven, model) = (self.driven([&q, &v, &a])?, self.model());
        let all = py.detach(|| motion::actuated_regressors(model, &driven))?;
        matrices(py, all, [driven.len(), model.n_act(), 10 * model.nv()])
    }

    /// Generalized efforts of the spanning tree `[N | N·m]`, shape `(n_samples, nv)`: rigid bodies and rotor inertia, loops open.
    ///
    /// q `[m | rad]`, v `[m/s | rad/s]`, a `[m/s² | rad/s²]`: shape `(n_samples, nv)`, all joints.
    fn rnea<'py>(&self, py: Python<'py>, q: ArrayLike<'py>, v: ArrayLike<'py>, a: ArrayLike<'py>) -> PyResult<Matrix<'py>> {
        let (whole, model) = (self.whole([&q, &v, &a])?, self.model());
        let tau = py.detach(|| motion::tree_efforts(model, &whole));
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
        let all = py.detach(|| motion::tree_regressors(model, &whole));
        matrices(py, all, [whole.len(), model.nv(), 10 * model.nv()])
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
        Ok(Self::new(description))
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
    let description = py.detach(|| urdf::load(&path)).map_err(|e| error::load(&e))?;
    Ok(Robot::new(description))
}

/// The effects of the library, in the order in which equal explanations are preferred, as dicts.
#[pyfunction]
pub(crate) fn effects(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let out = PyList::empty(py);
    for entry in CATALOGUE {
        out.append(as_dict(py, entry)?)?;
    }
    Ok(out)
}

fn as_dict<'py>(py: Python<'py>, entry: &Entry) -> PyResult<Bound<'py, PyDict>> {
    let parameters = PyList::empty(py);
    for p in entry.parameters {
        let one = PyDict::new(py);
        let units = PyDict::new(py);
        units.set_item("prismatic", p.unit.text(JointKind::Prismatic))?;
        units.set_item("revolute", p.unit.text(JointKind::Revolute))?;
        one.set_item("name", p.name)?;
        one.set_item("unit", units)?;
        one.set_item("lower", p.lower)?;
        one.set_item("default", p.default)?;
        parameters.append(one)?;
    }
    let look_alikes = PyList::empty(py);
    for l in entry.look_alikes {
        look_alikes.append(BTreeMap::from([("effect", l.effect), ("experiment", l.experiment)]))?;
    }
    let out = PyDict::new(py);
    let place = match entry.place {
        PlaceKind::Joint => "joint",
        PlaceKind::PassiveJoint => "passive joint",
        PlaceKind::Link => "link",
        PlaceKind::RootLink => "root link",
    };
    let energy = match entry.energy {
        Energy::Stores => "stores",
        Energy::Dissipates => "dissipates",
        Energy::Neither => "neither",
    };
    let texts = [
        ("name", entry.name),
        ("sentence", entry.sentence),
        ("equation", entry.equation),
        ("place", place),
        ("compensation", entry.compensation),
        ("energy", energy),
    ];
    for (key, text) in texts {
        out.set_item(key, text)?;
    }
    out.set_item("parameters", parameters)?;
    out.set_item("look_alikes", look_alikes)?;
    Ok(out)
}
