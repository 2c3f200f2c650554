//! Identification in the manner of scikit-learn: the constructor stores, `fit` learns, learned names end in an underscore.

use alloc::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pkm_dyn::effects;
use pkm_dyn::urdf::{self, Description};
use pkm_ident::answer::{self, JointError};
use pkm_ident::estimate::Method;
use pkm_ident::observation::RowOptions;
use pkm_ident::refine::identified;
use pkm_ident::{Recording, Settings, Term, identify_in_closed_loop};
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::{matrix, read_only};
use crate::diagnosis::signals;
use crate::dynamics::Robot;
use crate::error;

/// Estimates the parameters of a robot from recordings: `Identification(robot).fit(recording)`.
#[pyclass(module = "pkm")]
pub(crate) struct Identification {
    description: Arc<Description>,
    settings: Settings,
    learned: Option<answer::Identification>,
}

fn method(name: &str) -> PyResult<Method> {
    let known = || Method::EVERY.map(Method::name).join(", ");
    let found = Method::EVERY.into_iter().find(|m| m.name() == name);
    found.ok_or_else(|| error::value(format!("method = {name:?} (must be one of {})", known())))
}

fn term(name: &str) -> PyResult<Term> {
    let known = || Term::ALL.map(Term::name).join(", ");
    let found = Term::ALL.into_iter().find(|t| t.name() == name);
    found.ok_or_else(|| error::value(format!("hold names {name:?} (must be of {})", known())))
}

impl Identification {
    fn learned(&self) -> PyResult<&answer::Identification> {
        self.learned.as_ref().ok_or_else(|| PyAttributeError::new_err("not fitted yet: call fit first"))
    }
}

#[pymethods]
impl Identification {
    /// Stores settings only. `method`: sdp, wls, relevant, ols, huber, bisquare, tls, ridge or iv (along
    /// the simulated loop: recordings then need `q_ref.*`); `band_hz`: low-pass for effort and model
    /// alike `[Hz]`, chosen from the motion when None; `hold`: terms that stay as the robot has them (rotor, friction,
    /// passive-friction, offset, stiffness).
    #[new]
    #[pyo3(signature = (robot, *, method = "sdp", band_hz = None, hold = Vec::new()))]
    fn new(robot: &Bound<'_, Robot>, method: &str, band_hz: Option<f64>, hold: Vec<String>) -> PyResult<Self> {
        let held = hold.iter().map(|h| term(h)).collect::<PyResult<Vec<_>>>()?;
        let rows = RowOptions { band_hz, ..RowOptions::default() };
        let settings = Settings { method: self::method(method)?, rows, held, ..Settings::default() };
        Ok(Self { description: Arc::clone(robot.get().description()), settings, learned: None })
    }

    /// Learns from a recording or a sequence of them, judges on `holdout` (without it, on every second of ten blocks of each), and
    /// returns the object itself.
    #[pyo3(signature = (recordings, *, holdout = None))]
    fn fit<'py>(slf: Bound<'py, Self>, recordings: &Bound<'_, PyAny>, holdout: Option<&Bound<'_, PyAny>>) -> PyResult<Bound<'py, Self>> {
        let train = signals("recordings", recordings)?;
        let holdout = holdout.map_or(Ok(Vec::new()), |h| signals("holdout", h))?;
        let (description, settings) = {
            let this = slf.borrow();
            (Arc::clone(&this.description), this.settings.clone())
        };
        let answer = slf.py().detach(|| {
            let nominal = &description.robot;
            let mut simulate = |robot: &effects::Robot, like: &Recording| pkm_sim::rerun([robot, nominal], like).map_err(|e| e.to_string());
            identify_in_closed_loop(nominal, [&train, &holdout], &settings, &mut simulate, &mut |_| {})
        });
        slf.borrow_mut().learned = Some(answer.map_err(|e| error::value(e.to_string()))?);
        Ok(slf)
    }

    /// `identified`, `doubtful` or `not_identified`.
    #[getter]
    fn status_(&self) -> PyResult<String> {
        let text = serde_json::to_string(&self.learned()?.status).map_err(|e| error::value(e.to_string()))?;
        Ok(text.trim_matches('"').to_string())
    }

    /// What speaks against the answer, one sentence each.
    #[getter]
    fn notes_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.notes.iter().map(ToString::to_string).collect())
    }

    /// Names of all parameters, in the order of `theta_`.
    #[getter]
    fn names_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.columns.list.iter().map(|p| p.name.clone()).collect())
    }

    /// All parameters of the identified robot, SI; read-only.
    #[getter]
    fn theta_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(read_only(py, &self.learned()?.theta))
    }

    /// Names of the base parameters, in the order of `theta_base_`.
    #[getter]
    fn names_base_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.parameters.iter().map(|p| p.name.clone()).collect())
    }

    /// Base parameters, SI; read-only.
    #[getter]
    fn theta_base_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values: Vec<f64> = self.learned()?.parameters.iter().map(|p| p.value).collect();
        Ok(read_only(py, &values))
    }

    /// Their covariance, residuals taken as coloured as they are.
    #[getter]
    fn covariance_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let c = &self.learned()?.covariance;
        let values = (0..c.nrows()).flat_map(|i| (0..c.ncols()).map(move |j| c[(i, j)])).collect();
        matrix(py, values, [c.nrows(), c.ncols()])
    }

    /// Held-out error of each drive as a share of its effort's rms: `{joint: (nominal, identified)}`.
    #[getter]
    fn heldout_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for JointError { joint, nominal, identified, .. } in &self.learned()?.joints {
            out.set_item(joint, (nominal, identified))?;
        }
        Ok(out)
    }

    /// The identified robot.
    #[getter]
    fn robot_(&self) -> PyResult<Robot> {
        let robot = identified(&self.description, self.learned()?);
        let [toml, urdf] = robot.texts(&self.description, "identified.urdf").map_err(error::value)?;
        let description = urdf::parse(&toml, &urdf, ["identified robot.toml", "identified.urdf"]).map_err(|e| error::load(&e))?;
        Ok(Robot::new(description))
    }

    fn __repr__(&self) -> String {
        let name = &self.description.spec.name;
        let method = self.settings.method.name();
        match &self.learned {
            None => format!("<Identification {name}: {method}, not fitted>"),
            Some(a) => {
                let (before, after) = (a.pooled(|j| j.nominal), a.pooled(|j| j.identified));
                format!("<Identification {name}: {method}, held-out error {before:.3} -> {after:.3} of tau rms>")
            }
        }
    }
}
