//! Identification in the manner of scikit-learn: the constructor stores, `fit` learns, learned names end in an underscore.

use alloc::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pkm_dyn::effects;
use pkm_dyn::parameters::NAMES;
use pkm_dyn::urdf::{self, Description};
use pkm_ident::beside::{Beside, Question};
use pkm_ident::estimate::Method;
use pkm_ident::observation::RowOptions;
use pkm_ident::preprocess::differentiation::Derivative;
use pkm_ident::preprocess::{Clock, Preprocess};
use pkm_ident::{Recording, Settings, Shapes, Term, identify_in_closed_loop};
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::array::{matrix, read_only};
use crate::diagnosis::signals;
use crate::dynamics::Robot;
use crate::learned::{Learned, Number};
use crate::long::{self, Progress};
use crate::names::Names;
use crate::{error, state};

/// Estimates the parameters of a robot from recordings: `Identification(robot).fit(recording)`.
#[pyclass(module = "pkm")]
pub(crate) struct Identification {
    description: Arc<Description>,
    settings: Settings,
    asked: Asked,
    learned: Option<Learned>,
}

/// The keywords of the constructor, as they were given: what travels, and what `get_params` returns.
#[derive(Clone)]
struct Asked {
    method: String,
    band_hz: Option<f64>,
    hold: Vec<String>,
    shapes: bool,
    gains: bool,
    payload: Option<String>,
    outliers: Option<f64>,
    rate_hz: Option<f64>,
    period_s: Option<f64>,
    late_s: Option<f64>,
    find_late_s: Option<f64>,
    derivative: String,
}

impl Asked {
    fn settings(&self) -> PyResult<Settings> {
        Ok(Settings {
            method: method(&self.method)?,
            rows: RowOptions { band_hz: self.band_hz, derivative: derivative(&self.derivative)?, ..RowOptions::default() },
            held: self.hold.iter().map(|h| term(h)).collect::<PyResult<Vec<_>>>()?,
            preprocess: Preprocess {
                outliers: positive("outliers", self.outliers)?,
                rate_hz: positive("rate_hz", self.rate_hz)?,
                period_s: positive("period_s", self.period_s)?,
                clock: clock(self.late_s, self.find_late_s)?,
            },
            shapes: if self.shapes { Shapes::Estimated } else { Shapes::Stated },
            ..Settings::default()
        })
    }

    fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item("method", &self.method)?;
        out.set_item("hold", &self.hold)?;
        out.set_item("shapes", self.shapes)?;
        out.set_item("gains", self.gains)?;
        out.set_item("payload", &self.payload)?;
        out.set_item("derivative", &self.derivative)?;
        let numbers = [
            ("band_hz", self.band_hz),
            ("outliers", self.outliers),
            ("rate_hz", self.rate_hz),
            ("period_s", self.period_s),
            ("late_s", self.late_s),
            ("find_late_s", self.find_late_s),
        ];
        for (key, number) in numbers {
            out.set_item(key, number)?;
        }
        Ok(out)
    }
}

fn method(name: &str) -> PyResult<Method> {
    let known = || Method::EVERY.map(Method::name).join(", ");
    let found = Method::EVERY.into_iter().find(|m| m.name() == name);
    found.ok_or_else(|| error::value(format!("method = {name:?} (must be one of {})", known())))
}

pub(crate) fn term(name: &str) -> PyResult<Term> {
    let known = || Term::ALL.map(Term::name).join(", ");
    let found = Term::ALL.into_iter().find(|t| t.name() == name);
    found.ok_or_else(|| error::value(format!("hold names {name:?} (must be of {})", known())))
}

fn derivative(name: &str) -> PyResult<Derivative> {
    let known = || Derivative::ALL.map(Derivative::name).join(", ");
    let found = Derivative::ALL.into_iter().find(|d| d.name() == name);
    found.ok_or_else(|| error::value(format!("derivative = {name:?} (must be one of {})", known())))
}

/// A positive number or none.
fn positive(name: &str, value: Option<f64>) -> PyResult<Option<f64>> {
    match value {
        Some(x) if !(x.is_finite() && x > 0.0) => Err(error::value(format!("{name} = {x} (must be finite and > 0)"))),
        _ => Ok(value),
    }
}

fn clock(late_s: Option<f64>, find_late_s: Option<f64>) -> PyResult<Clock> {
    match (late_s, positive("find_late_s", find_late_s)?) {
        (Some(_), Some(_)) => Err(error::value("late_s and find_late_s cannot both be given")),
        (Some(late), None) if !late.is_finite() => Err(error::value(format!("late_s = {late} (must be finite)"))),
        (Some(late), None) => Ok(Clock::Late(late)),
        (None, Some(most)) => Ok(Clock::Estimated(most)),
        (None, None) => Ok(Clock::Stamped),
    }
}

/// Estimated numbers as dicts.
fn numbers<'py>(py: Python<'py>, all: &[Number]) -> PyResult<Bound<'py, PyList>> {
    let out = PyList::empty(py);
    for e in all {
        out.append(number(py, e)?)?;
    }
    Ok(out)
}

fn number<'py>(py: Python<'py>, e: &Number) -> PyResult<Bound<'py, PyDict>> {
    let one = PyDict::new(py);
    one.set_item("name", &e.name)?;
    one.set_item("unit", &e.unit)?;
    one.set_item("value", e.value)?;
    one.set_item("ci95", e.ci95)?;
    Ok(one)
}

impl Identification {
    fn learned(&self) -> PyResult<&Learned> {
        self.learned.as_ref().ok_or_else(|| PyAttributeError::new_err("not fitted yet: call fit first"))
    }
}

#[pymethods]
impl Identification {
    /// Stores settings only. `method`: sdp, wls, relevant, ols, huber, bisquare, tls, ridge or iv (along
    /// the simulated loop: recordings then need `q_ref.*`); `band_hz`: low-pass for effort and model
    /// alike `[Hz]`, chosen from the motion when None; `hold`: terms that stay as the robot has them (rotor, friction,
    /// passive-friction, offset, stiffness); `shapes`: also the values that friction laws of the robot are not linear in; `gains`: also
    /// the gains of the drives, from recordings with a known load (`meta["load"]`) beside recordings without; `payload`: also what rides
    /// on this link, the robot itself being as it is.
    ///
    /// First, in this order: `outliers`: samples further than this many robust standard deviations from the median around them are
    /// replaced; `rate_hz`: thinned to the rate nearest above `[Hz]`; `period_s`: averaged over this period `[s]`; `late_s`: efforts
    /// are stamped this much too late `[s]`, or `find_late_s`: how late is estimated, to this much to either side `[s]`. `derivative`:
    /// how velocities come from positions (filtered, central, savitzky-golay, spline).
    #[new]
    #[pyo3(signature = (robot, *, method = "sdp", band_hz = None, hold = None, shapes = false, gains = false, payload = None,
        outliers = None, rate_hz = None, period_s = None, late_s = None, find_late_s = None, derivative = "filtered"))]
    #[expect(
        clippy::too_many_arguments,
        clippy::fn_params_excessive_bools,
        reason = "keywords of Python: the flags of `pkm identify` by name"
    )]
    fn new(
        robot: &Bound<'_, Robot>,
        method: &str,
        band_hz: Option<f64>,
        hold: Option<Names>,
        shapes: bool,
        gains: bool,
        payload: Option<String>,
        outliers: Option<f64>,
        rate_hz: Option<f64>,
        period_s: Option<f64>,
        late_s: Option<f64>,
        find_late_s: Option<f64>,
        derivative: &str,
    ) -> PyResult<Self> {
        let (method, derivative) = (method.to_string(), derivative.to_string());
        let hold = Names::all(hold);
        let asked = Asked { method, band_hz, hold, shapes, gains, payload, outliers, rate_hz, period_s, late_s, find_late_s, derivative };
        Ok(Self { description: Arc::clone(robot.get().description()), settings: asked.settings()?, asked, learned: None })
    }

    /// Learns from a recording or a sequence of them, judges on `holdout` (without it, on every second of ten blocks of each), and
    /// returns the object itself. `progress`: called with the share done, 0 to 1, or True for a bar.
    #[pyo3(signature = (recordings, *, holdout = None, progress = None))]
    fn fit<'py>(
        slf: Bound<'py, Self>,
        recordings: &Bound<'_, PyAny>,
        holdout: Option<&Bound<'_, PyAny>>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, Self>> {
        let train = signals("recordings", recordings)?;
        let holdout = holdout.map_or(Ok(Vec::new()), |h| signals("holdout", h))?;
        let (description, settings, asked) = {
            let this = slf.borrow();
            (Arc::clone(&this.description), this.settings.clone(), this.asked.clone())
        };
        let progress = Progress::of(slf.py(), progress, "identifying")?;
        let answer = long::run(slf.py(), &progress, move |told| {
            let nominal = &description.robot;
            let questions: Vec<Question<'_>> =
                asked.gains.then_some(Question::Gains).into_iter().chain(asked.payload.as_deref().map(Question::Payload)).collect();
            let beside = Beside::of(nominal, &train, &settings, &questions).map_err(|e| e.to_string())?;
            let mut simulate = |robot: &effects::Robot, like: &Recording| pkm_sim::rerun([robot, nominal], like).map_err(|e| e.to_string());
            let found = identify_in_closed_loop(nominal, [&train, &holdout], &settings, &mut simulate, &mut |share| told(share));
            Learned::of(&description, &found.map_err(|e| e.to_string())?, &beside)
        })?;
        slf.borrow_mut().learned = Some(answer.map_err(error::value)?);
        Ok(slf)
    }

    /// The keywords of the constructor with their values, as a dict.
    fn get_params<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.asked.as_dict(py)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((Robot,), Bound<'py, PyDict>)> {
        Ok(((Robot::shared(Arc::clone(&self.description)),), self.asked.as_dict(py)?))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let bytes = self.learned.as_ref().map(state::to_bytes).transpose()?;
        Ok(bytes.map(|b| PyBytes::new(py, &b)))
    }

    fn __setstate__(&mut self, state: &[u8]) -> PyResult<()> {
        self.learned = Some(state::from_bytes("Identification", state)?);
        Ok(())
    }

    /// `identified`, `doubtful` or `not_identified`.
    #[getter]
    fn status_(&self) -> PyResult<&str> {
        Ok(&self.learned()?.status)
    }

    /// What speaks against the answer, one sentence each.
    #[getter]
    fn notes_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.notes.clone())
    }

    /// Names of all parameters, in the order of `theta_`.
    #[getter]
    fn names_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.names.clone())
    }

    /// All parameters of the identified robot, SI; read-only.
    #[getter]
    fn theta_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(read_only(py, &self.learned()?.theta))
    }

    /// Names of the base parameters, in the order of `theta_base_`.
    #[getter]
    fn names_base_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.names_base.clone())
    }

    /// Base parameters, SI; read-only.
    #[getter]
    fn theta_base_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(read_only(py, &self.learned()?.theta_base))
    }

    /// Their covariance, residuals taken as coloured as they are, by the equations of the method.
    #[getter]
    fn covariance_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let learned = self.learned()?;
        let n = learned.theta_base.len();
        matrix(py, learned.covariance.clone(), [n, n])
    }

    /// 95 % intervals of the base parameters, shape `(n, 2)`; `intervals_` says what they are about.
    #[getter]
    fn ci95_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all = &self.learned()?.ci95;
        matrix(py, all.iter().flatten().copied().collect(), [all.len(), 2])
    }

    /// What the intervals are about, in words.
    #[getter]
    fn intervals_(&self) -> PyResult<&str> {
        Ok(&self.learned()?.intervals)
    }

    /// Shapes of friction laws that were estimated: dicts of `name`, `unit`, `stated`, `value`, `ci95` and `is_shown`.
    #[getter]
    fn shapes_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let out = PyList::empty(py);
        for s in &self.learned()?.shapes {
            let one = number(py, &s.number)?;
            one.set_item("stated", s.stated)?;
            one.set_item("is_shown", s.is_shown)?;
            out.append(one)?;
        }
        Ok(out)
    }

    /// What was done to the recordings first, one line each.
    #[getter]
    fn preprocessing_(&self) -> PyResult<Vec<String>> {
        Ok(self.learned()?.preprocessing.clone())
    }

    /// Gains of the drives, acting effort over recorded effort: a dict of `status`, `notes` and `drives`, `{joint: {gain, ci95,
    /// load_share}}`; None where they were not asked for.
    #[getter]
    fn gains_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(found) = &self.learned()?.gains else { return Ok(None) };
        let (out, drives) = (PyDict::new(py), PyDict::new(py));
        for g in &found.drives {
            let one = PyDict::new(py);
            one.set_item("gain", g.gain)?;
            one.set_item("ci95", g.ci95)?;
            one.set_item("load_share", g.load_share)?;
            drives.set_item(&g.joint, one)?;
        }
        out.set_item("status", &found.status)?;
        out.set_item("notes", &found.notes)?;
        out.set_item("drives", drives)?;
        Ok(Some(out))
    }

    /// The payload: a dict of `link`, `status`, `notes`, `body` (the ten parameters by name, about the link's frame) and `shown` (what
    /// the motion shows of it: dicts of `name`, `unit`, `value`, `ci95`); None where it was not asked for.
    #[getter]
    fn payload_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(found) = &self.learned()?.payload else { return Ok(None) };
        let (out, body) = (PyDict::new(py), PyDict::new(py));
        for (name, x) in NAMES.iter().zip(&found.body) {
            body.set_item(name, x)?;
        }
        out.set_item("link", &found.link)?;
        out.set_item("status", &found.status)?;
        out.set_item("notes", &found.notes)?;
        out.set_item("body", body)?;
        out.set_item("shown", numbers(py, &found.shown)?)?;
        Ok(Some(out))
    }

    /// Held-out error of each drive as a share of its effort's rms: `{joint: (nominal, identified)}`.
    #[getter]
    fn heldout_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (joint, [nominal, identified]) in &self.learned()?.heldout {
            out.set_item(joint, (nominal, identified))?;
        }
        Ok(out)
    }

    /// The identified robot.
    #[getter]
    fn robot_(&self) -> PyResult<Robot> {
        let [toml, urdf] = &self.learned()?.robot;
        let description = urdf::parse(toml, urdf, ["identified robot.toml", "identified.urdf"]).map_err(|e| error::load(&e))?;
        Ok(Robot::new(description))
    }

    fn __repr__(&self) -> String {
        let name = &self.description.spec.name;
        let method = self.settings.method.name();
        match &self.learned {
            None => format!("<Identification {name}: {method}, not fitted>"),
            Some(a) => {
                let [before, after] = a.pooled;
                format!("<Identification {name}: {method}, held-out error {before:.3} -> {after:.3} of tau rms>")
            }
        }
    }
}
