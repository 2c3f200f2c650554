//! Controllers from files, sample by sample or over whole arrays.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pkm_ctrl::config::{self, FileError};
use pkm_ctrl::{Fault, FaultCode, Health, Limit, Running, Signals};
use pkm_dyn::urdf::Description;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyType};

use crate::array::{ArrayLike, Samples, matrix, vector};
use crate::dynamics::Robot;
use crate::long::Progress;
use crate::{error, long};

/// Components of a wrench, in their order.
const WRENCH: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];

/// A controller for a robot, with its state.
#[pyclass(frozen, name = "Controller", module = "pkm")]
pub(crate) struct Controller {
    running: Mutex<Box<dyn Running>>,
    /// Names of the driven joints.
    joints: Vec<String>,
    description: Arc<Description>,
    /// Name and text of its file.
    file: [String; 2],
    /// Whether it is no longer as it was made.
    has_stepped: AtomicBool,
}

impl Controller {
    fn parsed(robot: &Robot, text: String, file: String) -> Result<Self, FileError> {
        let description = Arc::clone(robot.description());
        let running = config::parse(&text, &file, &description.robot)?;
        let model = &description.robot.model;
        let joints = model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect();
        Ok(Self { running: Mutex::new(running), joints, description, file: [file, text], has_stepped: AtomicBool::new(false) })
    }

    fn running(&self) -> MutexGuard<'_, Box<dyn Running>> {
        // A step cannot panic, so nothing half done can be behind a poisoned lock.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The joint of a number, or the number where it is none.
    fn joint(&self, k: usize) -> String {
        self.joints.get(k).cloned().unwrap_or_else(|| k.to_string())
    }

    fn place(&self, limit: Limit, k: usize) -> Option<String> {
        match limit {
            Limit::Position | Limit::Velocity | Limit::Effort | Limit::EffortRate => Some(self.joint(k)),
            Limit::Wrench => WRENCH.get(k).map(ToString::to_string),
            Limit::Workspace | Limit::Singularity => None,
        }
    }

    fn fault<'py>(&self, py: Python<'py>, fault: &Fault) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item("code", format!("{:?}", fault.code))?;
        out.set_item("number", fault.code as u8)?;
        let place = match fault.code {
            FaultCode::Wrench | FaultCode::WrenchNotFinite => WRENCH.get(fault.drive).map(ToString::to_string),
            FaultCode::Late | FaultCode::Frozen | FaultCode::Controller => None,
            _ => Some(self.joint(fault.drive)),
        };
        out.set_item("where", place)?;
        out.set_item("value", fault.value)?;
        out.set_item("limit", fault.limit)?;
        Ok(out)
    }
}

/// An optional vector: zeros where there is none.
fn or_zero(name: &str, given: Option<&ArrayLike<'_>>, n: usize) -> PyResult<Vec<f64>> {
    given.map_or_else(|| Ok(vec![0.0; n]), |x| vector(name, x, Some(n)))
}

/// An optional wrench.
fn wrench(name: &str, given: Option<&ArrayLike<'_>>) -> PyResult<[f64; 6]> {
    Ok(six(&or_zero(name, given, WRENCH.len())?))
}

/// A row of six as a wrench.
fn six(row: &[f64]) -> [f64; 6] {
    core::array::from_fn(|k| row[k])
}

/// Optional rows of the shape that they must have: zeros where there are none.
fn or_zeros(name: &str, given: Option<&ArrayLike<'_>>, [len, n]: [usize; 2], columns: &str) -> PyResult<Samples> {
    let Some(given) = given else { return Ok(Samples::zeros(len, n)) };
    let samples = Samples::try_new(name, given, n, columns)?;
    if samples.len() == len { Ok(samples) } else { Err(error::value(format!("{name} has {} samples, q_meas has {len}", samples.len()))) }
}

#[pymethods]
impl Controller {
    /// The controller that the file at `path` states, for `robot`, at rest.
    #[new]
    fn new(robot: &Bound<'_, Robot>, path: PathBuf) -> PyResult<Self> {
        let read = config::read(&path).and_then(|(file, text)| Self::parsed(robot.get(), text, file));
        read.map_err(|e| error::controller(&path, &e))
    }

    /// The controller that a text states, for `robot`, at rest; errors call it `name`.
    #[classmethod]
    #[pyo3(signature = (robot, text, name = "controller.toml"))]
    fn from_text(_cls: &Bound<'_, PyType>, robot: &Bound<'_, Robot>, text: String, name: &str) -> PyResult<Self> {
        Self::parsed(robot.get(), text, name.to_string()).map_err(|e| error::value(e.to_string()))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Robot, String, String))> {
        let this = slf.get();
        if this.has_stepped.load(Ordering::Relaxed) {
            // What it has learned of the motion would be lost without a word.
            return Err(error::value("a controller that has stepped does not travel: its state would stay behind (reset() first)"));
        }
        let [file, text] = &this.file;
        Ok((slf.get_type().getattr("from_text")?, (Robot::shared(Arc::clone(&this.description)), text.clone(), file.clone())))
    }

    /// Name of its law.
    #[getter]
    fn law(&self) -> String {
        self.running().about().name.clone()
    }

    /// Steps per second that it is made for `[Hz]`.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.running().about().rate_hz
    }

    /// Names of the driven joints, in the order of every array.
    #[getter]
    fn joints(&self) -> Vec<String> {
        self.joints.clone()
    }

    /// One period: efforts for the drives [N | N·m], or voltages [V].
    ///
    /// What is left out of the references is standing where the robot is; of the measurements and the effort of the model, zero. `dt`: time
    /// since the last step `[s]`, one period by default. Numbers that are not finite are a fault, as on the robot.
    #[pyo3(signature = (*, q_meas, q_ref = None, v_ref = None, a_ref = None, tau_ff = None, tau_meas = None, wrench_meas = None,
        wrench_ref = None, dt = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python: the signals of a step by name")]
    fn step<'py>(
        &self,
        py: Python<'py>,
        q_meas: ArrayLike<'_>,
        q_ref: Option<ArrayLike<'_>>,
        v_ref: Option<ArrayLike<'_>>,
        a_ref: Option<ArrayLike<'_>>,
        tau_ff: Option<ArrayLike<'_>>,
        tau_meas: Option<ArrayLike<'_>>,
        wrench_meas: Option<ArrayLike<'_>>,
        wrench_ref: Option<ArrayLike<'_>>,
        dt: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let n = self.joints.len();
        let q_meas = vector("q_meas", &q_meas, Some(n))?;
        let q_ref = q_ref.as_ref().map_or_else(|| Ok(q_meas.clone()), |q| vector("q_ref", q, Some(n)))?;
        let (v_ref, a_ref) = (or_zero("v_ref", v_ref.as_ref(), n)?, or_zero("a_ref", a_ref.as_ref(), n)?);
        let (tau_ff, tau_meas) = (or_zero("tau_ff", tau_ff.as_ref(), n)?, or_zero("tau_meas", tau_meas.as_ref(), n)?);
        let wrench_meas = wrench("wrench_meas", wrench_meas.as_ref())?;
        let wrench_ref = wrench("wrench_ref", wrench_ref.as_ref())?;
        let mut tau = vec![0.0; n];
        let mut running = self.running();
        let dt = dt.unwrap_or(1.0 / running.about().rate_hz);
        let signals = Signals {
            dt,
            q_dt: dt,
            q_meas: &q_meas,
            tau_meas: &tau_meas,
            wrench_meas,
            q_ref: &q_ref,
            v_ref: &v_ref,
            a_ref: &a_ref,
            wrench_ref,
            tau_ff: &tau_ff,
        };
        self.has_stepped.store(true, Ordering::Relaxed);
        running.step(&signals, &mut tau);
        Ok(tau.into_pyarray(py))
    }

    /// One period per row of arrays of shape `(n_samples, n_drives)`, wrenches `(n_samples, 6)`: the commands, `(n_samples, n_drives)`.
    ///
    /// What is left out is as in `step`; every row is one period of `dt` `[s]` after the one before, one of the controller's by default. After a
    /// fault the rest are safe commands. Ctrl-C ends it between two rows; what state the controller has then is that of the last one.
    /// `progress`: a callable that takes the share done, or True for a bar.
    #[pyo3(signature = (*, q_meas, q_ref = None, v_ref = None, a_ref = None, tau_ff = None, tau_meas = None, wrench_meas = None,
        wrench_ref = None, dt = None, progress = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python: the signals of a step by name")]
    fn run<'py>(
        &self,
        py: Python<'py>,
        q_meas: ArrayLike<'_>,
        q_ref: Option<ArrayLike<'_>>,
        v_ref: Option<ArrayLike<'_>>,
        a_ref: Option<ArrayLike<'_>>,
        tau_ff: Option<ArrayLike<'_>>,
        tau_meas: Option<ArrayLike<'_>>,
        wrench_meas: Option<ArrayLike<'_>>,
        wrench_ref: Option<ArrayLike<'_>>,
        dt: Option<f64>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.joints.len();
        let q_meas = Samples::try_new("q_meas", &q_meas, n, "drive")?;
        let len = q_meas.len();
        let driven = |name, given: Option<ArrayLike<'_>>| or_zeros(name, given.as_ref(), [len, n], "drive");
        let spatial = |name, given: Option<ArrayLike<'_>>| or_zeros(name, given.as_ref(), [len, 6], "component");
        // Standing where the robot is.
        let q_ref = q_ref.map(|q| driven("q_ref", Some(q))).transpose()?;
        let (v_ref, a_ref) = (driven("v_ref", v_ref)?, driven("a_ref", a_ref)?);
        let (tau_ff, tau_meas) = (driven("tau_ff", tau_ff)?, driven("tau_meas", tau_meas)?);
        let (wrench_meas, wrench_ref) = (spatial("wrench_meas", wrench_meas)?, spatial("wrench_ref", wrench_ref)?);
        let progress = Progress::of(py, progress, "controlling")?;
        let tau = long::here(py, &progress, len, |tick| {
            self.has_stepped.store(true, Ordering::Relaxed);
            let dt = dt.unwrap_or_else(|| 1.0 / self.running().about().rate_hz);
            let mut tau = vec![0.0; n * len];
            for (i, tau) in tau.chunks_exact_mut(n).enumerate() {
                let signals = Signals {
                    dt,
                    q_dt: dt,
                    q_meas: q_meas.row(i),
                    tau_meas: tau_meas.row(i),
                    wrench_meas: six(wrench_meas.row(i)),
                    q_ref: q_ref.as_ref().map_or(q_meas.row(i), |q| q.row(i)),
                    v_ref: v_ref.row(i),
                    a_ref: a_ref.row(i),
                    wrench_ref: six(wrench_ref.row(i)),
                    tau_ff: tau_ff.row(i),
                };
                // Not held while the interpreter is asked: who has that may be waiting for the controller.
                self.running().step(&signals, tau);
                tick();
            }
            tau
        })?;
        matrix(py, tau, [len, n])
    }

    /// How the last step went: `is_faulted`, `is_saturated`, `acted` (which limits at which places) and `fault`, None where there is none.
    #[getter]
    fn health<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Health { is_faulted, is_saturated, acted, fault } = self.running().health();
        let out = PyDict::new(py);
        out.set_item("is_faulted", is_faulted)?;
        out.set_item("is_saturated", is_saturated)?;
        let limits = PyList::empty(py);
        for (limit, k) in acted.iter() {
            let one = PyDict::new(py);
            one.set_item("limit", format!("{limit:?}"))?;
            one.set_item("where", self.place(limit, k))?;
            limits.append(one)?;
        }
        out.set_item("acted", limits)?;
        out.set_item("fault", fault.map(|f| self.fault(py, &f)).transpose()?)?;
        Ok(out)
    }

    /// To rest, as before the first step.
    fn reset(&self) {
        self.running().reset();
        self.has_stepped.store(false, Ordering::Relaxed);
    }

    fn __repr__(&self) -> String {
        format!("Controller({:?}, {} Hz, {} drives)", self.law(), self.rate_hz(), self.joints.len())
    }
}
