//! A robot that moves under efforts, sample by sample or over whole arrays.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::ndarray::Array1;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pkm_dyn::loops::mid_pose;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Plant as Moves, ReducedPlant, needs_states};
use pyo3::prelude::*;

use crate::array::{ArrayLike, Samples, matrix, vector};
use crate::dynamics::Robot;
use crate::long::Progress;
use crate::{error, long};

type Vector<'py> = Bound<'py, PyArray1<f64>>;
type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Longest step that is taken `[s]`: longer ones are a mistake.
const DT_MAX: f64 = 1.0;

/// A robot that moves under the efforts of its drives, with its state.
#[pyclass(frozen, name = "Plant", module = "pkm")]
pub(crate) struct Plant {
    moves: Mutex<Box<dyn Moves>>,
    kind: &'static str,
    joints: Vec<String>,
    tree_joints: usize,
}

impl Plant {
    fn moves(&self) -> MutexGuard<'_, Box<dyn Moves>> {
        // Steps end in an error, not in a panic: nothing half done can be behind a poisoned lock.
        self.moves.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn period(dt: f64) -> PyResult<f64> {
    if dt.is_finite() && dt > 0.0 && dt <= DT_MAX {
        return Ok(dt);
    }
    Err(error::value(format!("dt = {dt} s (must be > 0 and at most {DT_MAX})")))
}

#[pymethods]
impl Plant {
    /// `robot` with its effects at rest at positions `q` of its drives `[m | rad]`, by default in the middle of their travel.
    ///
    /// `kind`: "reduced", in the coordinates of the drives; "constrained", in those of the whole tree, for effects that have states or
    /// freedoms of their own and for more drives than freedoms; "auto" takes the first that is right. Effects of actuators and sensors
    /// (lags, delays, scales, encoders) are not a plant's: `simulate` has them. `seed`: of what persons do.
    #[new]
    #[pyo3(signature = (robot, q = None, *, kind = "auto", seed = 1))]
    fn new(robot: &Bound<'_, Robot>, q: Option<ArrayLike<'_>>, kind: &str, seed: u64) -> PyResult<Self> {
        let physics = robot.get().description().robot.clone();
        let model = &physics.model;
        let q = q.map_or_else(|| Ok(mid_pose(model)), |q| vector("q", &q, Some(model.n_act())))?;
        if let Some(k) = q.iter().position(|x| !x.is_finite()) {
            return Err(error::value(format!("q[{k}] = {} (must be finite)", q[k])));
        }
        let (joints, tree_joints) = (model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect(), model.nv());
        let is_reduced = match kind {
            "reduced" => true,
            "constrained" => false,
            "auto" => !needs_states(&physics) && pkm_dyn::Data::new(model).n_ind() == model.n_act(),
            other => return Err(error::value(format!("kind = {other:?} (must be auto, reduced or constrained)"))),
        };
        let moves: Result<Box<dyn Moves>, _> = if is_reduced {
            ReducedPlant::try_new(physics, &q).map(|plant| Box::new(plant) as Box<dyn Moves>)
        } else {
            let options = ConstrainedOptions { seed, ..ConstrainedOptions::default() };
            ConstrainedPlant::try_new(physics, &q, options).map(|plant| Box::new(plant) as Box<dyn Moves>)
        };
        let moves = Mutex::new(moves.map_err(|e| error::sim(&e))?);
        Ok(Self { moves, kind: if is_reduced { "reduced" } else { "constrained" }, joints, tree_joints })
    }

    /// `reduced` or `constrained`.
    #[getter]
    fn kind(&self) -> &str {
        self.kind
    }

    /// Names of the driven joints, in the order of every array.
    #[getter]
    fn joints(&self) -> Vec<String> {
        self.joints.clone()
    }

    /// Positions of the drives `[m | rad]`, shape `(n_act,)`.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, self.moves().position())
    }

    /// Velocities of the drives `[m/s | rad/s]`, shape `(n_act,)`.
    #[getter]
    fn v<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, self.moves().velocity())
    }

    /// Time since the start `[s]`.
    #[getter]
    fn time(&self) -> Option<f64> {
        self.moves().time()
    }

    /// Positions and velocities of all joints of the tree, shape `(nv,)` each; None of a reduced plant, whose `Robot.closed_loop_motion` tells.
    #[getter]
    fn tree<'py>(&self, py: Python<'py>) -> Option<(Vector<'py>, Vector<'py>)> {
        let moves = self.moves();
        let [q, v] = moves.tree()?;
        let own = |x: &[f64]| Array1::from(x[..self.tree_joints].to_vec()).into_pyarray(py);
        Some((own(q), own(v)))
    }

    /// Moves on by `dt` `[s]` under efforts `tau` `[N | N·m]` that are constant meanwhile: `(q, v)` of the drives at the end.
    fn step<'py>(&self, py: Python<'py>, tau: ArrayLike<'_>, dt: f64) -> PyResult<(Vector<'py>, Vector<'py>)> {
        let (tau, dt) = (vector("tau", &tau, Some(self.joints.len()))?, period(dt)?);
        if let Some(k) = tau.iter().position(|x| !x.is_finite()) {
            return Err(error::value(format!("tau[{k}] = {} (must be finite)", tau[k])));
        }
        let mut moves = self.moves();
        moves.step(&tau, dt).map_err(|e| error::sim(&e))?;
        Ok((PyArray1::from_slice(py, moves.position()), PyArray1::from_slice(py, moves.velocity())))
    }

    /// One step of `dt` `[s]` per row of efforts `(n_samples, n_act)`: `(q, v)` at the end of each, of the same shape. `progress`: a callable
    /// that takes the share done, or True for a bar.
    #[pyo3(signature = (tau, dt, *, progress = None))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        tau: ArrayLike<'_>,
        dt: f64,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let (n, dt) = (self.joints.len(), period(dt)?);
        let tau = Samples::try_new("tau", &tau, n, "drive (plant.joints)")?;
        let mut out = [Vec::with_capacity(n * tau.len()), Vec::with_capacity(n * tau.len())];
        let progress = Progress::of(py, progress, "moving")?;
        let failed = long::here(py, &progress, tau.len(), |tick| {
            for i in 0..tau.len() {
                // Not held while the interpreter is asked: who has that may be waiting for the plant.
                let mut moves = self.moves();
                if let Err(e) = moves.step(tau.row(i), dt) {
                    return Some((i, e));
                }
                out[0].extend_from_slice(moves.position());
                out[1].extend_from_slice(moves.velocity());
                drop(moves);
                tick();
            }
            None
        })?;
        if let Some((i, e)) = failed {
            return Err(error::value(format!("tau[{i}]: {e}")));
        }
        let ([q, v], shape) = (out, [tau.len(), n]);
        Ok((matrix(py, q, shape)?, matrix(py, v, shape)?))
    }

    fn __repr__(&self) -> String {
        format!("<Plant {}: {} drives>", self.kind, self.joints.len())
    }
}
