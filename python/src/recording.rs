//! Recordings: named signals over one time axis, from files and from arrays.

use alloc::collections::BTreeMap;
use std::path::PathBuf;

use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArrayMethods};
use pkm_ident::{EffortKind, KnownLoad, Meta, Recording as Signals};
use pkm_record::{Attachments, ReadOptions};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator, PyList, PyTuple};

use crate::array::{ArrayLike, vector};
use crate::dynamics::Robot;
use crate::error;

/// One recording: equally long named signals over one time axis. It never changes.
///
/// Signals are named as the columns of a CSV recording: `q.<joint>` `[m | rad]`, `tau.<joint>` `[N | N·m]`, `dq.<joint>`, ... NaN is a
/// missing sample.
#[pyclass(frozen, module = "pkm")]
pub(crate) struct Recording {
    signals: Signals,
}

impl Recording {
    pub(crate) fn new(signals: Signals) -> Self {
        Self { signals }
    }

    pub(crate) fn signals(&self) -> &Signals {
        &self.signals
    }
}

#[pymethods]
impl Recording {
    /// From arrays: time `[s]` of shape `(n_samples,)`, strictly increasing, and a dict of signals of the same length.
    ///
    /// `meta` may hold `tau` ("measured" or "commanded"), `load` (dict of link, mass `[kg]`, xyz `[m]`), `gravity` (3 numbers `[m/s²]`),
    /// `session`, `controller` and further texts.
    #[new]
    #[pyo3(signature = (time, signals, *, name = "recording", meta = None))]
    fn from_arrays(
        time: ArrayLike<'_>,
        signals: BTreeMap<String, ArrayLike<'_>>,
        name: &str,
        meta: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let time = vector("time", &time, None)?;
        let mut before = f64::NEG_INFINITY;
        for (i, &t) in time.iter().enumerate() {
            if !t.is_finite() || t <= before {
                return Err(error::value(format!("time[{i}] = {t} s (must be finite and increase; before it: {before} s)")));
            }
            before = t;
        }
        let mut out = Signals { name: name.to_string(), time, ..Signals::default() };
        for (column, values) in signals {
            let values = vector(&format!("signal {column:?}"), &values, Some(out.len()))?;
            if let Some(i) = values.iter().position(|x| x.is_infinite()) {
                return Err(error::value(format!("signal {column:?}: sample {i} is infinite (a missing sample is NaN)")));
            }
            out.signals.insert(column, values);
        }
        if let Some(meta) = meta {
            out.meta = meta_from(meta)?;
        }
        Ok(Self::new(out))
    }

    /// How the recording is called in a verdict: the path it was read from, or what the caller chose.
    #[getter]
    fn name(&self) -> &str {
        &self.signals.name
    }

    /// Sample times `[s]`, shape `(n_samples,)`; read-only, the recording's own memory.
    #[getter]
    fn time<'py>(slf: &Bound<'py, Self>) -> Bound<'py, PyArray1<f64>> {
        view(slf, &slf.get().signals.time)
    }

    /// Names of the signals, sorted.
    #[getter(signals)]
    fn signal_names(&self) -> Vec<&str> {
        self.signals.signals.keys().map(String::as_str).collect()
    }

    /// Time from the first to the last sample `[s]`.
    #[getter]
    fn duration(&self) -> f64 {
        self.signals.duration()
    }

    /// What the recording says of itself, as a dict; empty where it says nothing.
    #[getter]
    fn meta<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        meta_as_dict(py, &self.signals.meta)
    }

    /// One signal, shape `(n_samples,)`; read-only, the recording's own memory. `KeyError` names what there is.
    fn __getitem__<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let this = slf.get();
        let known = || this.signal_names().join(", ");
        let signal =
            this.signals.signal(name).ok_or_else(|| PyKeyError::new_err(format!("no signal {name:?} (there are: {})", known())))?;
        Ok(view(slf, signal))
    }

    fn __contains__(&self, name: &str) -> bool {
        self.signals.signal(name).is_some()
    }

    // Over names, as a table of pandas does; without it Python would ask for signal 0.
    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        PyList::new(py, self.signal_names())?.try_iter()
    }

    /// Number of samples.
    fn __len__(&self) -> usize {
        self.signals.len()
    }

    /// A `pandas.DataFrame` with a column per signal over `time`; units in `attrs`, those of joints with the `robot`. Needs pandas.
    #[pyo3(signature = (robot = None))]
    fn to_pandas<'py>(slf: &Bound<'py, Self>, robot: Option<&Bound<'py, Robot>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("pkm.tables")?.call_method1("to_pandas", (slf, robot))
    }

    /// An `xarray.Dataset` with a variable per signal over `time`; units in `attrs`, those of joints with the `robot`. Needs xarray.
    #[pyo3(signature = (robot = None))]
    fn to_xarray<'py>(slf: &Bound<'py, Self>, robot: Option<&Bound<'py, Robot>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("pkm.tables")?.call_method1("to_xarray", (slf, robot))
    }

    /// From a `pandas.DataFrame`: its column `t` or `time`, or an index that is more than a count of rows, is time `[s]`, every other column a
    /// signal.
    #[staticmethod]
    fn from_pandas<'py>(py: Python<'py>, frame: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        py.import("pkm.tables")?.call_method1("from_pandas", (frame,))
    }

    /// From an `xarray.Dataset`: its coordinate `time` is time `[s]`, every variable over it alone a signal.
    #[staticmethod]
    fn from_xarray<'py>(py: Python<'py>, dataset: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        py.import("pkm.tables")?.call_method1("from_xarray", (dataset,))
    }

    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let (py, this) = (slf.py(), &slf.get().signals);
        let signals = PyDict::new(py);
        for (name, values) in &this.signals {
            signals.set_item(name, view(slf, values))?;
        }
        let keywords = PyDict::new(py);
        keywords.set_item("name", &this.name)?;
        keywords.set_item("meta", meta_as_dict(py, &this.meta)?)?;
        Ok(((view(slf, &this.time), signals).into_pyobject(py)?, keywords))
    }

    fn __repr__(&self) -> String {
        let s = &self.signals;
        format!("<Recording {:?}: {} samples, {:.3} s, {} signals>", s.name, s.len(), s.duration(), s.signals.len())
    }
}

/// Numbers of a recording as an array over the same memory, which keeps the recording and cannot be written to.
#[expect(unsafe_code, reason = "numpy is shown memory of Rust's: hours of recordings need not be there twice")]
fn view<'py>(owner: &Bound<'py, Recording>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    // SAFETY: the caller hands in numbers of `owner`, whose vectors never change or move (the class is frozen and nothing in it is behind a
    // lock); the array keeps a reference to it, and is made read-only before anybody else sees it.
    let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(values), owner.clone().into_any()) };
    drop(array.readwrite().make_nonwriteable());
    array
}

fn meta_as_dict<'py>(py: Python<'py>, meta: &Meta) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (key, text) in &meta.other {
        out.set_item(key, text)?;
    }
    let tau = meta.tau.map(|kind| match kind {
        EffortKind::Measured => "measured",
        EffortKind::Commanded => "commanded",
    });
    for (key, text) in [("tau", tau), ("session", meta.session.as_deref()), ("controller", meta.controller.as_deref())] {
        if let Some(text) = text {
            out.set_item(key, text)?;
        }
    }
    if let Some(gravity) = meta.gravity {
        out.set_item("gravity", gravity)?;
    }
    if let Some(load) = &meta.load {
        let one = PyDict::new(py);
        one.set_item("link", &load.link)?;
        one.set_item("mass", load.mass)?;
        one.set_item("xyz", load.xyz)?;
        out.set_item("load", one)?;
    }
    Ok(out)
}

fn meta_from(dict: &Bound<'_, PyDict>) -> PyResult<Meta> {
    let mut meta = Meta::default();
    for (key, value) in dict {
        let key: String = key.extract()?;
        let bad = |wanted: &str| error::value(format!("meta[{key:?}] = {value} (must be {wanted})"));
        let text = || value.extract::<String>().map_err(|_| bad("text"));
        match key.as_str() {
            "tau" => {
                meta.tau = Some(match text()?.as_str() {
                    "measured" => EffortKind::Measured,
                    "commanded" => EffortKind::Commanded,
                    _ => return Err(bad("\"measured\" or \"commanded\"")),
                });
            }
            "gravity" => meta.gravity = Some(value.extract().map_err(|_| bad("three numbers"))?),
            "load" => meta.load = Some(load_from(&value).ok_or_else(|| bad("a dict of link, mass and xyz"))?),
            "session" => meta.session = Some(text()?),
            "controller" => meta.controller = Some(text()?),
            _ => {
                meta.other.insert(key.clone(), text()?);
            }
        }
    }
    Ok(meta)
}

fn load_from(value: &Bound<'_, PyAny>) -> Option<KnownLoad> {
    let dict = value.cast::<PyDict>().ok()?;
    let get = |key: &str| dict.get_item(key).ok().flatten();
    let xyz = get("xyz").map_or(Some([0.0; 3]), |xyz| xyz.extract().ok())?;
    Some(KnownLoad { link: get("link")?.extract().ok()?, mass: get("mass")?.extract().ok()?, xyz })
}

/// Reads a recording from a `.csv` or `.mcap` file, or from the folder of a rosbag2 with one `.mcap` file.
///
/// `topic` chooses the joint states of an MCAP file that has several; with `recover`, what is complete of a damaged file is returned.
/// `OSError` for a file that cannot be read, `ValueError` for what is in it; one line that names the place.
#[pyfunction]
#[pyo3(signature = (path, *, topic = None, recover = false))]
pub(crate) fn read(py: Python<'_>, path: PathBuf, topic: Option<String>, recover: bool) -> PyResult<Recording> {
    let options = ReadOptions { topic, recover };
    let signals = py.detach(|| pkm_record::read(&path, &options)).map_err(|e| error::read(&e))?;
    Ok(Recording::new(signals))
}

/// Writes a recording as `.csv` or `.mcap`; the file appears complete or not at all.
#[pyfunction]
pub(crate) fn write(py: Python<'_>, path: PathBuf, recording: &Bound<'_, Recording>) -> PyResult<()> {
    let signals = recording.get().signals();
    py.detach(|| pkm_record::write(&path, signals, &Attachments::default())).map_err(|e| error::write(&e))
}
