//! The experiments of the four papers, done again.

use pkm_papers::{ALL, Gate, Plot, Row, find};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::read_only;
use crate::error;
use crate::long::{self, Progress};

/// Keys of the papers that `reproduce` knows, in the order of their years.
#[pyfunction]
pub(crate) fn papers() -> Vec<&'static str> {
    ALL.map(|p| p.key).to_vec()
}

/// Does a paper's experiments again: a dict of `title`, `rows` (every compared number, with what it is held against and what follows) and
/// `plots`, as `pkm reproduce` shows them. `progress`: called with the share done, 0 to 1, or True for a bar.
#[pyfunction]
#[pyo3(signature = (paper, *, progress = None))]
pub(crate) fn reproduce<'py>(py: Python<'py>, paper: &str, progress: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyDict>> {
    let known = || papers().join(", ");
    let found = find(paper).ok_or_else(|| error::value(format!("no paper {paper:?} (there are: {})", known())))?;
    let progress = Progress::of(py, progress, found.key)?;
    let done = long::run(py, &progress, move |told| (found.reproduce)(&mut |share| told(share)))?;
    let done = done.map_err(|e| error::value(e.to_string()))?;
    let (rows, plots) = (PyList::empty(py), PyList::empty(py));
    for one in &done.rows {
        rows.append(row(py, one)?)?;
    }
    for one in &done.plots {
        plots.append(plot(py, one)?)?;
    }
    let out = PyDict::new(py);
    out.set_item("title", found.title)?;
    out.set_item("rows", rows)?;
    out.set_item("plots", plots)?;
    Ok(out)
}

fn row<'py>(py: Python<'py>, row: &Row) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("place", row.place)?;
    out.set_item("what", &row.what)?;
    out.set_item("ours", row.ours)?;
    out.set_item("paper", row.paper)?;
    let (gate, limit) = match row.gate {
        Gate::Within(width) => ("within", Some(width)),
        Gate::AtMost(most) => ("at most", Some(most)),
        Gate::AtLeast(least) => ("at least", Some(least)),
        Gate::Told => ("told", None),
    };
    out.set_item("gate", gate)?;
    out.set_item("limit", limit)?;
    out.set_item("target", row.target)?;
    out.set_item("verdict", row.verdict.word())?;
    out.set_item("why", &row.why)?;
    Ok(out)
}

fn plot<'py>(py: Python<'py>, plot: &Plot) -> PyResult<Bound<'py, PyDict>> {
    let lines = PyList::empty(py);
    for line in &plot.lines {
        let [x, y]: [Vec<f64>; 2] = [line.points.iter().map(|p| p.0).collect(), line.points.iter().map(|p| p.1).collect()];
        let one = PyDict::new(py);
        one.set_item("label", &line.label)?;
        one.set_item("x", read_only(py, &x))?;
        one.set_item("y", read_only(py, &y))?;
        lines.append(one)?;
    }
    let out = PyDict::new(py);
    out.set_item("title", &plot.title)?;
    out.set_item("x_label", &plot.x_label)?;
    out.set_item("y_label", &plot.y_label)?;
    out.set_item("lines", lines)?;
    Ok(out)
}
