//! Excitation: a periodic motion for identification, as an object that is sampled and written.

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use std::path::PathBuf;

use numpy::{PyArray1, PyArray2};
use pkm_dyn::Data;
use pkm_dyn::effects::Applied;
use pkm_dyn::urdf::Description;
use pkm_ident::excitation::{self, Basis, Criterion, Limits, Margin, Periodic, Quality, Settings};
use pkm_record::Attachments;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyType};
use serde::{Deserialize, Serialize};

use crate::array::{ArrayLike, matrix, read_only, vector};
use crate::dynamics::Robot;
use crate::identification::term;
use crate::long::{self, Progress};
use crate::names::Names;
use crate::recording::Recording;
use crate::{error, state};

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// A function and what it makes the object of.
type Pickled<'py> = (Bound<'py, PyAny>, (Robot, Bound<'py, PyBytes>));

/// A periodic motion of all drives, and how good it is: what `pkm.excite` returns. It never changes.
#[pyclass(frozen, module = "pkm")]
pub(crate) struct Excitation {
    description: Arc<Description>,
    found: Found,
}

/// What a search found, as it travels.
#[derive(Serialize, Deserialize)]
struct Found {
    criterion: Criterion,
    /// As text: it may have 64 bits, which TOML's numbers do not.
    seed: String,
    gain: Option<f64>,
    columns: Vec<String>,
    structural: usize,
    well_conditioned: usize,
    motion: Periodic,
    quality: Quality,
    random: Option<Quality>,
    margins: Vec<Margin>,
}

impl Found {
    fn of(found: excitation::Excitation) -> Self {
        Self {
            criterion: found.settings.criterion,
            seed: found.settings.seed.to_string(),
            gain: found.gain(),
            columns: found.columns,
            structural: found.structural,
            well_conditioned: found.well_conditioned,
            motion: found.motion,
            quality: found.quality,
            random: found.random.best,
            margins: found.margins,
        }
    }

    /// Whether the motion can be one of `robot`.
    fn is_of(&self, robot: &Description) -> bool {
        let Periodic { basis, period_s, coefficients } = &self.motion;
        period_s.is_finite()
            && *period_s > 0.0
            && coefficients.len() == Data::new(&robot.robot.model).n_ind().min(robot.robot.model.n_act())
            && coefficients.iter().all(|row| row.len() == basis.len() && row.iter().all(|c| c.is_finite()))
            && self.seed.parse::<u64>().is_ok()
    }
}

impl Excitation {
    /// Positions, velocities and accelerations at these times.
    fn states<'py>(&self, py: Python<'py>, time: &[f64]) -> PyResult<[Matrix<'py>; 3]> {
        let n = self.description.robot.model.n_act();
        let mut all = [const { Vec::new() }; 3];
        for state in self.found.motion.states(&self.description.robot.model, time) {
            for (out, row) in all.iter_mut().zip([state.q, state.v, state.a]) {
                out.extend(row);
            }
        }
        let [q, v, a] = all;
        let shape = [time.len(), n];
        Ok([matrix(py, q, shape)?, matrix(py, v, shape)?, matrix(py, a, shape)?])
    }

    fn signals(&self, rate_hz: f64, periods: usize) -> PyResult<pkm_ident::Recording> {
        let motion = &self.found.motion;
        let samples = excitation::samples(motion.basis, motion.period_s, periods, rate_hz).map_err(|e| error::value(e.to_string()))?;
        let origin = (self.found.criterion, self.found.seed.parse().unwrap_or_default());
        Ok(excitation::references(motion, &self.description.robot.model, origin, samples, rate_hz))
    }
}

#[pymethods]
impl Excitation {
    /// Period `[s]`.
    #[getter]
    fn period_s(&self) -> f64 {
        self.found.motion.period_s
    }

    /// Names of the driven joints, in the order of the columns of `sample`.
    #[getter]
    fn actuators(&self) -> Vec<&str> {
        let model = &self.description.robot.model;
        model.actuators.iter().map(|&j| model.joints[j].name.as_str()).collect()
    }

    /// What was made good, as it was asked for.
    #[getter]
    fn criterion(&self) -> &str {
        self.found.criterion.name()
    }

    /// Coefficients of the functions, shape `(n_act, n_functions)`.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        let rows = &self.found.motion.coefficients;
        matrix(py, rows.iter().flatten().copied().collect(), [rows.len(), rows.first().map_or(0, Vec::len)])
    }

    /// How good the motion is, on a grid ten times as dense as that of the search: `condition` (columns at length one), `condition_raw`
    /// (SI units), `log_determinant`, and with two effects `separation` (cosine, left, effort, alone).
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        quality(py, &self.found.quality)
    }

    /// The same of the best random motion with the same limits; None where that leaves them between its samples.
    #[getter]
    fn random<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.found.random.as_ref().map(|q| quality(py, q)).transpose()
    }

    /// By how much the best random motion is worse, 1 or more; None where it is not known.
    #[getter]
    fn gain(&self) -> Option<f64> {
        self.found.gain
    }

    /// Names of the parameters whose columns count.
    #[getter]
    fn columns(&self) -> Vec<&str> {
        self.found.columns.iter().map(String::as_str).collect()
    }

    /// Independent combinations of parameters that some motion of the robot would show.
    #[getter]
    fn structural(&self) -> usize {
        self.found.structural
    }

    /// Columns that stay below condition number 300 together along this motion.
    #[getter]
    fn well_conditioned(&self) -> usize {
        self.found.well_conditioned
    }

    /// Where the motion comes nearest to each limit: dicts of `what`, `where`, `value`, `lower`, `upper`, `room` (share of half the range)
    /// and `time` `[s]`, the tightest first.
    #[getter]
    fn margins<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let mut all: Vec<_> = self.found.margins.iter().collect();
        all.sort_by(|a, b| a.room.total_cmp(&b.room));
        let out = PyList::empty(py);
        for m in all {
            let one = PyDict::new(py);
            one.set_item("what", m.what.name())?;
            one.set_item("where", &m.place)?;
            for (key, x) in [("value", m.value), ("lower", m.lower), ("upper", m.upper), ("room", m.room), ("time", m.time)] {
                one.set_item(key, x)?;
            }
            out.append(one)?;
        }
        Ok(out)
    }

    /// The motion at times `t` `[s]` of shape `(n_samples,)`: `(q, v, a)`, each of shape `(n_samples, n_act)`. It repeats every period.
    fn sample<'py>(&self, py: Python<'py>, t: ArrayLike<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
        let time = vector("t", &t, None)?;
        if let Some(i) = time.iter().position(|t| !t.is_finite()) {
            return Err(error::value(format!("t[{i}] = {} s (must be finite)", time[i])));
        }
        let [q, v, a] = self.states(py, &time)?;
        Ok((q, v, a))
    }

    /// The motion at a rate `[Hz]`, from rest to rest over whole periods: `(t, q, v, a)`, `t` `[s]` of shape `(n_samples,)`.
    #[pyo3(signature = (rate_hz = 100.0, *, periods = 1))]
    fn grid<'py>(
        &self,
        py: Python<'py>,
        rate_hz: f64,
        periods: usize,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Matrix<'py>, Matrix<'py>, Matrix<'py>)> {
        let motion = &self.found.motion;
        let n = excitation::samples(motion.basis, motion.period_s, periods, rate_hz).map_err(|e| error::value(e.to_string()))?;
        let time: Vec<f64> = (0..n).map(|i| i as f64 / rate_hz).collect();
        let [q, v, a] = self.states(py, &time)?;
        Ok((read_only(py, &time), q, v, a))
    }

    /// The motion as references `q_ref.*`, `dq_ref.*`, `ddq_ref.*` of every drive.
    #[pyo3(signature = (rate_hz = 100.0, *, periods = 1))]
    fn recording(&self, rate_hz: f64, periods: usize) -> PyResult<Recording> {
        Ok(Recording::new(self.signals(rate_hz, periods)?))
    }

    /// Writes these references as `.csv` or `.mcap`, for `pkm simulate --reference`; the file appears complete or not at all.
    #[pyo3(signature = (path, rate_hz = 100.0, *, periods = 1))]
    fn save(&self, py: Python<'_>, path: PathBuf, rate_hz: f64, periods: usize) -> PyResult<()> {
        let signals = self.signals(rate_hz, periods)?;
        py.detach(|| pkm_record::write(&path, &signals, &Attachments::default())).map_err(|e| error::write(&e))
    }

    #[classmethod]
    #[pyo3(name = "_from_bytes")]
    fn from_bytes(_cls: &Bound<'_, PyType>, robot: &Bound<'_, Robot>, bytes: &[u8]) -> PyResult<Self> {
        let description = Arc::clone(robot.get().description());
        let found: Found = state::from_bytes("Excitation", bytes)?;
        if !found.is_of(&description) {
            return Err(error::value(format!("pickle of Excitation: no motion of {:?} (damaged)", description.robot.model.name)));
        }
        Ok(Self { description, found })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Pickled<'py>> {
        let Self { description, found } = slf.get();
        let bytes = PyBytes::new(slf.py(), &state::to_bytes(found)?);
        Ok((slf.get_type().getattr("_from_bytes")?, (Robot::shared(Arc::clone(description)), bytes)))
    }

    fn __repr__(&self) -> String {
        let f = &self.found;
        let gain = f.gain.map_or("an unknown number of".to_string(), |g| format!("{g:.2}"));
        format!(
            "<Excitation {}: {} s, {} {}, condition {:.1}, {gain} times better than random>",
            self.description.robot.model.name,
            f.motion.period_s,
            f.motion.basis.name(),
            f.criterion.name(),
            f.quality.condition
        )
    }
}

fn quality<'py>(py: Python<'py>, q: &Quality) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (key, x) in [("condition", q.condition), ("condition_raw", q.condition_raw), ("log_determinant", q.log_determinant)] {
        out.set_item(key, x)?;
    }
    if let Some(s) = &q.separation {
        let one = PyDict::new(py);
        one.set_item("cosine", s.cosine)?;
        one.set_item("angle_deg", s.angle_deg())?;
        for (key, both) in [("left", s.left), ("effort", s.effort), ("alone", s.alone)] {
            one.set_item(key, both)?;
        }
        out.set_item("separation", one)?;
    }
    Ok(out)
}

/// The criterion of that name.
fn criterion(name: &str) -> PyResult<Criterion> {
    let known = || Criterion::ALL.map(Criterion::name).join(", ");
    let found = Criterion::ALL.into_iter().find(|c| c.name() == name);
    found.ok_or_else(|| error::value(format!("criterion = {name:?} (must be one of {})", known())))
}

/// An effect to be told apart: its name, its place, its parameters.
type Effect = (String, String, BTreeMap<String, f64>);

/// Looks for a periodic motion that shows a robot's parameters as well as its limits allow, or tells two effects apart.
///
/// The motion begins at rest and keeps every limit of the robot. `criterion`: condition, determinant, angle or power, the last two with
/// two effects in `separate`, each `(name, where, parameters)`; `basis`: fourier with `harmonics`, or spline with `pieces`; `period_s`
/// `[s]`; `share`: of the robot's limits that may be used; `speed` `[m/s | rad/s]`, `acceleration` `[m/s² | rad/s²]`: of any drive;
/// `cone_deg`: lean of ball and universal joints; `singularity`: least distance as a share of that in the middle of the travel; `hold`:
/// terms that are not to be shown; `restarts`, `draws`, `iterations`: size of the search; `seed`. The same arguments give the same motion.
#[pyfunction]
#[pyo3(signature = (robot, *, criterion = "condition", separate = Vec::new(), basis = "fourier", harmonics = 5, pieces = 12, period_s = 10.0,
    share = 0.95, speed = None, acceleration = None, cone_deg = None, singularity = 0.1, hold = None, restarts = 4, draws = 25,
    iterations = 150, seed = 1, progress = None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python: the flags of `pkm excite` by name")]
pub(crate) fn excite(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    criterion: &str,
    separate: Vec<Effect>,
    basis: &str,
    harmonics: usize,
    pieces: usize,
    period_s: f64,
    share: f64,
    speed: Option<f64>,
    acceleration: Option<f64>,
    cone_deg: Option<f64>,
    singularity: f64,
    hold: Option<Names>,
    restarts: usize,
    draws: usize,
    iterations: usize,
    seed: u64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Excitation> {
    let description = Arc::clone(robot.get().description());
    let model = &description.robot.model;
    let effects = separate.into_iter().map(|(name, place, values)| {
        let values: Vec<(String, f64)> = values.into_iter().collect();
        Applied::try_new(model, &name, &place, &values).map_err(|e| error::effect(&e))
    });
    let basis = match basis {
        "fourier" => Basis::Fourier { harmonics },
        "spline" => Basis::Spline { pieces },
        other => return Err(error::value(format!("basis = {other:?} (must be one of fourier, spline)"))),
    };
    let settings = Settings {
        criterion: self::criterion(criterion)?,
        basis,
        period_s,
        limits: Limits { share, velocity: speed, acceleration, cone: cone_deg.map(f64::to_radians), singularity },
        held: Names::all(hold).iter().map(|h| term(h)).collect::<PyResult<Vec<_>>>()?,
        columns: None,
        effects: effects.collect::<PyResult<Vec<_>>>()?,
        restarts,
        draws,
        iterations,
        seed,
    };
    let progress = Progress::of(py, progress, "exciting")?;
    let searched = Arc::clone(&description);
    let found = long::run(py, &progress, move |told| excitation::excite(&searched.robot, &settings, &told))?;
    let found = found.map_err(|e| error::value(e.to_string()))?;
    Ok(Excitation { description, found: Found::of(found) })
}
