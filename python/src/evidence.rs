//! The numbers behind the pictures as dicts of arrays; `pkm/evidence.py` says what each holds.

use numpy::IntoPyArray;
use pkm_diagnose::Evidence;
use pkm_diagnose::evidence::{FindingPlot, JointSeries};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::{matrix, read_only};

/// A dict with the given items.
macro_rules! dict {
    ($py:expr, $($key:literal: $value:expr),+ $(,)?) => {{
        let out = PyDict::new($py);
        $(out.set_item($key, $value)?;)+
        out
    }};
}

fn list<'py, T>(py: Python<'py>, items: &[T], each: impl Fn(&T) -> PyResult<Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyList>> {
    let out = PyList::empty(py);
    for item in items {
        out.append(each(item)?)?;
    }
    Ok(out)
}

fn joint<'py>(py: Python<'py>, j: &JointSeries) -> PyResult<Bound<'py, PyDict>> {
    let spans = j.heldout_spans.iter().flatten().copied().collect();
    Ok(dict!(py,
        "joint": &j.joint,
        "unit": &j.unit,
        "recording": &j.recording,
        "time": read_only(py, &j.time),
        "measured": read_only(py, &j.measured),
        "nominal": read_only(py, &j.nominal),
        "refined": read_only(py, &j.refined),
        "heldout_spans": matrix(py, spans, [j.heldout_spans.len(), 2])?,
        "rms_nominal": j.rms_nominal,
        "rms_refined": j.rms_refined,
    ))
}

fn finding<'py>(py: Python<'py>, f: &FindingPlot) -> PyResult<Bound<'py, PyDict>> {
    Ok(dict!(py,
        "rank": f.rank,
        "x_label": &f.x_label,
        "y_label": &f.y_label,
        "x": read_only(py, &f.x),
        "y": read_only(py, &f.y),
        "is_heldout": f.is_heldout.clone().into_pyarray(py),
        "model": read_only(py, &f.model),
    ))
}

/// Everything a report shows besides the verdict.
pub(crate) fn as_dict<'py>(py: Python<'py>, e: &Evidence) -> PyResult<Bound<'py, PyDict>> {
    let regimes = list(py, &e.regimes, |r| {
        Ok(dict!(py, "joint": &r.joint, "regime": &r.regime, "share": r.share, "before": r.before, "after": r.after))
    })?;
    let chain = list(py, &e.chain, |c| Ok(dict!(py, "label": &c.label, "heldout_rms": c.heldout_rms)))?;
    let ruled_out = list(py, &e.ruled_out, |s| {
        let wins = (s.wins[0], s.wins[1]);
        Ok(dict!(py, "effect": &s.effect, "where": &s.place, "gain": s.gain, "surprise": s.surprise, "wins": wins, "why_not": &s.why_not))
    })?;
    let dependences = list(py, &e.dependences, |d| {
        let (x, mean, error) = (read_only(py, &d.x), read_only(py, &d.mean), read_only(py, &d.error));
        Ok(dict!(py, "joint": &d.joint, "unit": &d.unit, "signal": &d.signal, "x": x, "mean": mean, "error": error))
    })?;
    let lines = list(py, &e.lines, |l| {
        let (x, amplitude) = (read_only(py, &l.x), read_only(py, &l.amplitude));
        Ok(dict!(py, "joint": &l.joint, "unit": &l.unit, "over": &l.over, "x": x, "amplitude": amplitude))
    })?;
    Ok(dict!(py,
        "joints": list(py, &e.joints, |j| joint(py, j))?,
        "findings": list(py, &e.findings, |f| finding(py, f))?,
        "regimes": regimes,
        "chain": chain,
        "ruled_out": ruled_out,
        "null_surprise": (e.null_surprise[0], e.null_surprise[1]),
        "null_runs": e.null_runs,
        "dependences": dependences,
        "lines": lines,
    ))
}
