//! The library of effects as dicts.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::{CATALOGUE, Energy, Entry};
use pkm_dyn::model::JointKind;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

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
        one.set_item("upper", p.unit.upper())?;
        one.set_item("default", p.default)?;
        parameters.append(one)?;
    }
    let look_alikes = PyList::empty(py);
    for l in entry.look_alikes {
        look_alikes.append(BTreeMap::from([("effect", l.effect), ("experiment", l.experiment)]))?;
    }
    let out = PyDict::new(py);
    let place = entry.place.words();
    let energy = match entry.energy {
        Energy::Stores => "stores",
        Energy::Dissipates => "dissipates",
        Energy::Passive => "passive",
        Energy::Feeds => "feeds",
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
