//! Singularities and workspaces.

use alloc::collections::BTreeMap;

use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{IntoPyArray, PyArray1};
use pkm_dyn::loops::{Coordinate, Guide, Output, Singularities};
use pkm_dyn::workspace::{Axis, Cause, Margins, Scanner, Slice, cones, coordinate_name, coordinate_named, home, prescribe};
use pkm_dyn::{Data, Model};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::{ArrayLike, Motion, matrix, vector};
use crate::long::Progress;
use crate::motion::along_positions;
use crate::{error, long};

/// The output of that name, or the one that stands out.
pub(crate) fn output(model: &Model, link: Option<&str>) -> PyResult<Output> {
    match link {
        Some(name) => Output::named(model, name).ok_or_else(|| error::value(format!("link {name:?}: no such link, sensor or loop"))),
        None => Output::evident(model).ok_or_else(|| error::value("no link stands out as the output: name one with link=")),
    }
}

fn named(model: &Model, name: &str) -> PyResult<Coordinate> {
    coordinate_named(model, name).ok_or_else(|| error::value(format!("{name:?} is no coordinate (x y z rx ry rz or a driven joint)")))
}

fn checked_length(length: f64) -> PyResult<f64> {
    let is_length = length.is_finite() && length > 0.0;
    if is_length { Ok(length) } else { Err(error::value(format!("length = {length} m (must be finite and > 0)"))) }
}

fn closed_home(model: &Model) -> PyResult<Vec<f64>> {
    home(model, &mut Data::new(model)).ok_or_else(|| error::value("loops do not close near the stated assembly"))
}

/// What [`crate::dynamics::Robot::singularities`] is asked beside the poses.
pub(crate) struct Question<'a> {
    pub(crate) link: Option<&'a str>,
    pub(crate) coordinates: Option<Vec<String>>,
    pub(crate) length: f64,
}

/// Distances from singularities at every sample, as a dict of arrays.
pub(crate) fn singularities<'py>(py: Python<'py>, model: &Model, motion: &Motion, asked: &Question<'_>) -> PyResult<Bound<'py, PyDict>> {
    let (output, home, length) = (output(model, asked.link)?, closed_home(model)?, checked_length(asked.length)?);
    let components: Vec<usize> = match &asked.coordinates {
        Some(names) => {
            let of = |name: &String| match named(model, name)? {
                Coordinate::Output(k) => Ok(k),
                Coordinate::Joint(_) => Err(error::value(format!("{name:?} is a joint, coordinates are of x y z rx ry rz"))),
            };
            names.iter().map(of).collect::<PyResult<_>>()?
        }
        None => prescribe(model, &home, &output, &[], length).map_or_else(|_| (0..6).collect(), |(_, components)| components),
    };
    let (n, nv, n_components) = (motion.len(), model.nv(), components.len());
    let mut numbers: [Vec<f64>; 5] = Default::default();
    let (mut motions, mut outputs) = (Vec::with_capacity(n * nv), Vec::with_capacity(n * n_components));
    py.detach(|| {
        let mut all = Singularities::new(model, &mut Data::new(model), &home, output, &components, length);
        let mut loosest = vec![0.0; nv];
        along_positions(model, motion, |data| {
            let q = data.q.clone();
            let s = all.at(model, data, &q);
            for (column, x) in numbers.iter_mut().zip([s.parallel, s.serial, s.condition, s.passive, s.constraint]) {
                column.push(x);
            }
            all.loosest_motion(&mut loosest);
            motions.extend_from_slice(&loosest);
            outputs.extend_from_slice(all.loosest_output());
        })
    })?;
    let out = PyDict::new(py);
    for (name, column) in ["parallel", "serial", "condition", "passive", "constraint"].into_iter().zip(numbers) {
        out.set_item(name, PyArray1::from_vec(py, column))?;
    }
    out.set_item("loosest_motion", matrix(py, motions, [n, nv])?)?;
    out.set_item("loosest_output", matrix(py, outputs, [n, n_components])?)?;
    out.set_item("coordinates", components.iter().map(|&k| coordinate_name(model, Coordinate::Output(k))).collect::<Vec<_>>())?;
    Ok(out)
}

/// What [`crate::dynamics::Robot::workspace`] is asked beside the axes.
pub(crate) struct Limits<'a> {
    pub(crate) link: Option<&'a str>,
    pub(crate) at: BTreeMap<String, f64>,
    pub(crate) cone_deg: Option<f64>,
    pub(crate) singularity: f64,
    pub(crate) condition: f64,
    pub(crate) length: f64,
    pub(crate) progress: &'a Progress<'a>,
}

/// The scanned axes from Python, in their order.
fn axes(dict: &Bound<'_, PyDict>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let mut out = Vec::new();
    for (name, values) in dict {
        let (name, array): (String, ArrayLike<'_>) = (name.extract()?, values.extract()?);
        let values = vector(&name, &array, None)?;
        if values.is_empty() || values.iter().any(|x| !x.is_finite()) {
            return Err(error::value(format!("axes[{name:?}]: needs one or more finite values")));
        }
        out.push((name, values));
    }
    if (1..=3).contains(&out.len()) { Ok(out) } else { Err(error::value(format!("{} axes (from one to three)", out.len()))) }
}

/// A scan as a dict of arrays, one axis of each per scanned axis.
pub(crate) fn workspace<'py>(
    py: Python<'py>,
    model: &Model,
    dict: &Bound<'py, PyDict>,
    limits: &Limits<'_>,
) -> PyResult<Bound<'py, PyDict>> {
    let (axes, output, home, length) = (axes(dict)?, output(model, limits.link)?, closed_home(model)?, checked_length(limits.length)?);
    let wanted = axes.iter().map(|(name, _)| name).chain(limits.at.keys()).map(|n| named(model, n)).collect::<PyResult<Vec<_>>>()?;
    let (coordinates, components) = prescribe(model, &home, &output, &wanted, length).map_err(|e| error::value(e.to_string()))?;
    let mut data = Data::new(model);
    let guide = Guide::new(model, output.clone(), coordinates.clone());
    let singularities = Singularities::new(model, &mut data, &home, output, &components, length);
    let cones = cones(model, &mut data, &home);
    let cone = vec![limits.cone_deg.map_or(f64::INFINITY, f64::to_radians); cones.len()];
    let margins = Margins { cone, parallel: limits.singularity, condition: limits.condition };
    let mut scanner = Scanner::new(model, &home, guide, singularities, (cones, margins));
    let mut at = scanner.home_values().to_vec();
    for (i, value) in limits.at.values().enumerate() {
        at[axes.len() + i] = *value;
    }
    let shape: Vec<usize> = axes.iter().map(|(_, values)| values.len()).collect();
    let n_poses = shape.iter().product();
    let slices = long::here(py, limits.progress, n_poses, |tick| scan(&mut scanner, &axes, &at, tick))?;
    let out = as_dict(py, &slices, &shape)?;
    let at_home: BTreeMap<String, f64> =
        coordinates.iter().map(|&c| coordinate_name(model, c)).zip(scanner.home_values().iter().copied()).collect();
    out.set_item("home", at_home)?;
    Ok(out)
}

fn scan(scanner: &mut Scanner<'_>, axes: &[(String, Vec<f64>)], at: &[f64], tick: &mut dyn FnMut()) -> Vec<Slice> {
    let axis = |index: usize| axes.get(index).map(|(_, values)| Axis { index, values: values.clone() });
    let (Some(columns), rows, stack) = (axis(0), axis(1), axis(2)) else { return Vec::new() };
    let Some(stack) = stack else { return vec![scanner.slice(&columns, rows.as_ref(), at, tick)] };
    let mut at = at.to_vec();
    let mut one = |value: f64| {
        at[stack.index] = value;
        scanner.slice(&columns, rows.as_ref(), &at, tick)
    };
    stack.values.iter().map(|&value| one(value)).collect()
}

fn as_dict<'py>(py: Python<'py>, slices: &[Slice], shape: &[usize]) -> PyResult<Bound<'py, PyDict>> {
    // Slices keep the first axis last; numpy's order is the axes' own.
    let [n_columns, n_rows, n_slices] = [0, 1, 2].map(|i| shape.get(i).copied().unwrap_or(1));
    let places = (0..n_columns * n_rows * n_slices).map(|i| (i / (n_rows * n_slices), i / n_slices % n_rows, i % n_slices));
    let cells: Vec<_> = places.map(|(i, k, s)| slices[s].cells[k * n_columns + i]).collect();
    let bad = |e: numpy::ndarray::ShapeError| error::value(e.to_string());
    let out = PyDict::new(py);
    let reachable: Vec<bool> = cells.iter().map(|c| c.cause == Cause::Reachable).collect();
    out.set_item("reachable", ArrayD::from_shape_vec(IxDyn(shape), reachable).map_err(bad)?.into_pyarray(py))?;
    let cause: Vec<u8> = cells.iter().map(|c| u8::try_from(c.cause.kind()).unwrap_or(u8::MAX)).collect();
    out.set_item("cause", ArrayD::from_shape_vec(IxDyn(shape), cause).map_err(bad)?.into_pyarray(py))?;
    for (k, name) in ["parallel", "serial", "condition"].into_iter().enumerate() {
        let column: Vec<f64> = cells.iter().map(|c| [c.parallel, c.serial, c.condition][k]).collect();
        out.set_item(name, ArrayD::from_shape_vec(IxDyn(shape), column).map_err(bad)?.into_pyarray(py))?;
    }
    out.set_item("causes", PyList::new(py, Cause::NAMES)?)?;
    Ok(out)
}
