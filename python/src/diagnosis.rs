//! A diagnosis and its report.

use alloc::sync::Arc;
use std::env::temp_dir;
use std::path::{Path, PathBuf};

use pkm_diagnose::{Diagnosis, Evidence, Refined, Settings, Verdict};
use pkm_dyn::urdf::{self, Description};
use pkm_ident::Recording as Signals;
use pkm_report::Style;
use pyo3::exceptions::{PyOSError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};
use serde::{Deserialize, Serialize};

use crate::dynamics::Robot;
use crate::long::{self, Progress};
use crate::names::Names;
use crate::recording::Recording;
use crate::{error, state};

/// A finished diagnosis: the verdict, the numbers behind it, and the robot it leads to. `print(report)` tells the whole story.
#[pyclass(frozen, module = "pkm")]
pub(crate) struct Report {
    description: Arc<Description>,
    diagnosis: Diagnosis,
}

/// A report as it travels: robots as their texts.
#[derive(Serialize, Deserialize)]
struct Travelling {
    robot: [String; 2],
    verdict: Verdict,
    evidence: Evidence,
    refined: Option<[String; 2]>,
}

fn json(verdict: &Verdict) -> PyResult<String> {
    serde_json::to_string_pretty(verdict).map_err(|e| error::value(format!("verdict: {e}")))
}

fn write_text(path: &Path, text: &str) -> PyResult<()> {
    std::fs::write(path, text).map_err(|e| PyOSError::new_err(format!("{}: {e}", path.display())))
}

impl Report {
    /// Refuses to write where the diagnosed robot's own files lie, by what they hold: a robot does not know where it came from.
    fn spare(&self, path: &Path) -> PyResult<()> {
        let there = std::fs::read(path).unwrap_or_default();
        let own = [&self.description.toml_text, &self.description.urdf_text];
        if own.iter().any(|text| !text.is_empty() && text.as_bytes() == there) {
            return Err(error::value(format!("{}: would overwrite the robot's own file; choose another name", path.display())));
        }
        Ok(())
    }
}

#[pymethods]
impl Report {
    /// The verdict as a dict in the layout `pkm.verdict/1`.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let verdict = py.import("json")?.call_method1("loads", (json(&self.diagnosis.verdict)?,))?;
        Ok(verdict.cast_into()?)
    }

    /// The findings of the verdict, most important first, as dicts.
    #[getter]
    fn findings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.verdict(py)?.as_any().get_item("findings")
    }

    /// The numbers behind the pictures: dicts of arrays (see `pkm.evidence.Evidence`).
    #[getter]
    fn evidence<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        crate::evidence::as_dict(py, &self.diagnosis.evidence)
    }

    /// One self-contained HTML page with every number and picture.
    fn html(&self) -> String {
        pkm_report::html(&self.diagnosis)
    }

    /// Writes the verdict as JSON to `path_json`, the refined robot beside it, and the HTML page to `html` if that is given.
    ///
    /// For `OUT.json` the refined robot is `OUT.robot.toml` and `OUT.robot.urdf`, as from `pkm diagnose`; `refined_model` in the JSON names the
    /// former. `ValueError` where one of them would take the place of the robot's own files: then nothing is written.
    #[pyo3(signature = (path_json, *, html = None))]
    fn save(&self, path_json: PathBuf, html: Option<PathBuf>) -> PyResult<()> {
        let mut diagnosis = self.diagnosis.clone();
        let stem = path_json.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let beside = [".robot.toml", ".robot.urdf"].map(|end| path_json.with_file_name(format!("{stem}{end}")));
        beside.iter().chain([&path_json]).chain(&html).try_for_each(|path| self.spare(path))?;
        if self.diagnosis.refined.is_some() {
            let [toml_name, urdf_name] = [format!("{stem}.robot.toml"), format!("{stem}.robot.urdf")];
            let (toml, urdf) = self.refined(&urdf_name)?;
            write_text(&path_json.with_file_name(&toml_name), &toml)?;
            write_text(&path_json.with_file_name(&urdf_name), &urdf)?;
            diagnosis.verdict.refined_model = toml_name;
        }
        write_text(&path_json, &json(&diagnosis.verdict)?)?;
        if let Some(path) = html {
            write_text(&path, &pkm_report::html(&diagnosis))?;
        }
        Ok(())
    }

    /// The refined robot as the texts of its robot.toml, which names the URDF `urdf_name`, and of that URDF.
    ///
    /// `ValueError` when the recordings were unusable: then there is none.
    fn refined(&self, urdf_name: &str) -> PyResult<(String, String)> {
        let none = || error::value(format!("no refined robot: {}", self.diagnosis.verdict.says));
        let refined = self.diagnosis.refined.as_ref().ok_or_else(none)?;
        let [toml, urdf] = refined.texts(&self.description, urdf_name).map_err(error::value)?;
        Ok((toml, urdf))
    }

    /// The refined robot itself, with every finding in it; `ValueError` as `refined`.
    fn refined_robot(&self) -> PyResult<Robot> {
        let (toml, urdf) = self.refined("refined.urdf")?;
        let description = urdf::parse(&toml, &urdf, ["refined robot.toml", "refined.urdf"]).map_err(|e| error::load(&e))?;
        Ok(Robot::new(description))
    }

    /// What pickle puts back together.
    #[classmethod]
    #[pyo3(name = "_from_bytes")]
    fn from_bytes(_cls: &Bound<'_, PyType>, bytes: &[u8]) -> PyResult<Self> {
        let Travelling { robot, verdict, evidence, refined } = state::from_bytes("Report", bytes)?;
        let read = |[toml, urdf]: &[String; 2]| urdf::parse(toml, urdf, ["robot.toml", "robot.urdf"]).map_err(|e| error::load(&e));
        let description = Arc::new(read(&robot)?);
        let refined = refined.as_ref().map(read).transpose()?;
        let refined = refined.map(|r| Refined { model: r.bare, effects: r.robot.effects });
        Ok(Self { description, diagnosis: Diagnosis { verdict, evidence, refined } })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let Self { description, diagnosis } = slf.get();
        let texts = |refined: &Refined| refined.texts(description, "refined.urdf").map_err(error::value);
        let travelling = Travelling {
            robot: [description.toml_text.clone(), description.urdf_text.clone()],
            verdict: diagnosis.verdict.clone(),
            evidence: diagnosis.evidence.clone(),
            refined: diagnosis.refined.as_ref().map(texts).transpose()?,
        };
        let bytes = state::to_bytes(&travelling)?;
        Ok((slf.get_type().getattr("_from_bytes")?, (PyBytes::new(slf.py(), &bytes),)))
    }

    fn __str__(&self) -> String {
        pkm_report::terminal(&self.diagnosis, Style::Plain)
    }

    fn __repr__(&self) -> String {
        let v = &self.diagnosis.verdict;
        let (before, after) = (v.heldout.rms_nominal, v.heldout.rms_final);
        let found: Vec<String> = v.findings.iter().map(|f| format!("{} at {}", f.effect, f.place.join(" "))).collect();
        let found = if found.is_empty() { "no finding".to_string() } else { found.join(", ") };
        format!("<Report {}: {found}; held-out error {before:.3} -> {after:.3} of tau rms>", v.robot)
    }

    /// The HTML page in a frame of its own, so that its style stays off the notebook.
    fn _repr_html_(&self) -> String {
        let page = self.html().replace('&', "&amp;").replace('"', "&quot;");
        format!("<iframe srcdoc=\"{page}\" style=\"width: 100%; height: 48em; border: 0\"></iframe>")
    }
}

/// The signals of one recording or of a sequence of them.
pub(crate) fn signals(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Signals>> {
    let wrong = |found: &Bound<'_, PyAny>| {
        let kind = found.get_type().name().map_or_else(|_| "something else".to_string(), |n| n.to_string());
        PyTypeError::new_err(format!("{name} holds {kind} (must be a Recording or a sequence of Recordings)"))
    };
    if let Ok(one) = value.cast::<Recording>() {
        return Ok(vec![one.get().signals().clone()]);
    }
    let mut all = Vec::new();
    for item in value.try_iter().map_err(|_| wrong(value))? {
        let item = item?;
        all.push(item.cast::<Recording>().map_err(|_| wrong(&item))?.get().signals().clone());
    }
    Ok(all)
}

fn settings(
    band_hz: Option<f64>,
    floor: Option<f64>,
    seed: Option<u64>,
    without: Option<Names>,
    scratch: Option<PathBuf>,
) -> PyResult<Settings> {
    let given = scratch.iter().find(|folder| **folder != temp_dir());
    if let Some(folder) = given.filter(|folder| !folder.is_dir()) {
        return Err(error::value(format!("scratch = {} (must be a folder that is there, or None)", folder.display())));
    }
    let mut settings = Settings { band_hz, scratch, without: Names::all(without), ..Settings::default() };
    if let Some(floor) = floor {
        if !(0.0..1.0).contains(&floor) {
            return Err(error::value(format!("floor = {floor} (must be >= 0 and < 1)")));
        }
        settings.floor = floor;
    }
    settings.seed = seed.unwrap_or(settings.seed);
    Ok(settings)
}

/// Compares recordings with the robot's model: where they differ, which physics is missing, how much, and how much better it fits.
///
/// `recordings`, `holdout`: a recording or a sequence of them; without `holdout`, part of each recording is held out. `band_hz`:
/// low-pass for effort and model alike `[Hz]`, chosen from the motion when None; `floor`: smallest held-out gain worth a name, as a
/// share of the squared error; `seed`: of the null runs; `without`: names of effects that are not looked for (what if it were not
/// friction?); `scratch`: folder for a nameless temporary file in which the series of long recordings wait, beyond half a gigabyte of them,
/// by default the system's own; with None all stay in memory, and no number changes; `progress`: called with the share done, 0 to 1, or
/// True for a bar.
#[pyfunction]
#[pyo3(signature = (robot, recordings, *, holdout = None, band_hz = None, floor = None, seed = None,
    without = None, scratch = Some(temp_dir()), progress = None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python: the fields of the settings by name")]
pub(crate) fn diagnose(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recordings: &Bound<'_, PyAny>,
    holdout: Option<&Bound<'_, PyAny>>,
    band_hz: Option<f64>,
    floor: Option<f64>,
    seed: Option<u64>,
    without: Option<Names>,
    scratch: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Report> {
    let settings = settings(band_hz, floor, seed, without, scratch)?;
    let train = signals("recordings", recordings)?;
    let holdout = holdout.map_or(Ok(Vec::new()), |h| signals("holdout", h))?;
    let description = Arc::clone(robot.get().description());
    let progress = Progress::of(py, progress, "diagnosing")?;
    let diagnosed = Arc::clone(&description);
    let diagnosis =
        long::run(py, &progress, move |told| pkm_diagnose::diagnose(&diagnosed, &train, &holdout, &settings, &mut |share| told(share)))?;
    let diagnosis = diagnosis.map_err(|e| error::input(&e))?;
    Ok(Report { description, diagnosis })
}
