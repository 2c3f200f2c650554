//! numpy arrays in and out. Inputs are copied once, so that the interpreter is free while Rust computes; outputs are moved.

use core::ops::Range;

use numpy::ndarray::{Array1, Array2, Array3};
use numpy::{AllowTypeChange, Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayLikeDyn, PyArrayMethods, PyUntypedArrayMethods};
use pkm_ident::bulk::Rows;
use pyo3::prelude::*;

use crate::error;

/// Whatever `numpy.asarray(x, dtype=float)` accepts.
pub(crate) type ArrayLike<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Numbers that are checked at a time.
const STRETCH: usize = 1024;

/// Samples of a vector: `n_samples × n`, row by row.
#[derive(Clone)]
pub(crate) struct Samples {
    values: Vec<f64>,
    /// Length of each vector.
    n: usize,
    /// Number of samples.
    len: usize,
}

impl Samples {
    /// Checks the shape against `(n_samples, n)` and that every number is finite; `name` and `columns` are for the message.
    pub(crate) fn try_new(name: &str, array: &ArrayLike<'_>, n: usize, columns: &str) -> PyResult<Self> {
        let shape = array.shape();
        let [len, found] = *shape else { return Err(bad_shape(name, shape, n, columns)) };
        if found != n {
            return Err(bad_shape(name, shape, n, columns));
        }
        let view = array.as_array();
        let values: Vec<f64> = view.as_slice().map_or_else(|| view.iter().copied().collect(), <[f64]>::to_vec);
        // In stretches, so that a stretch is one sweep of wide instructions; the place only where there is one to tell.
        let is_finite = values.chunks(STRETCH).all(|part| part.iter().fold(true, |all, x| all & x.is_finite()));
        if let Some(at) = values.iter().position(|x| !is_finite && !x.is_finite()) {
            return Err(error::value(format!("{name}[{}, {}] = {} (must be finite)", at / n, at % n, values[at])));
        }
        Ok(Self { values, n, len })
    }

    /// So many vectors of zeros.
    pub(crate) fn zeros(len: usize, n: usize) -> Self {
        Self { values: vec![0.0; len * n], n, len }
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Several arrays of shape `(n_samples, n)` with equally many samples, each with its name.
    pub(crate) fn each<const N: usize>(arrays: [(&str, &ArrayLike<'_>); N], n: usize, columns: &str) -> PyResult<[Self; N]> {
        let mut all = Vec::with_capacity(N);
        for (name, array) in arrays {
            all.push(Self::try_new(name, array, n, columns)?);
        }
        if let Some((k, other)) = all.iter().enumerate().find(|(_, s)| s.len != all[0].len) {
            return Err(error::value(format!("{} has {} samples, {} has {}", arrays[k].0, other.len, arrays[0].0, all[0].len)));
        }
        <[Self; N]>::try_from(all).map_err(|_| error::value("no arrays".to_string()))
    }

    /// Some samples, one after the other.
    pub(crate) fn rows(&self, samples: Range<usize>) -> &[f64] {
        &self.values[samples.start * self.n..samples.end * self.n]
    }

    /// Sample `i`.
    pub(crate) fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }
}

fn bad_shape(name: &str, shape: &[usize], n: usize, columns: &str) -> PyErr {
    error::value(format!("{name} has shape {}, must be (n_samples, {n}): one column per {columns}", as_tuple(shape)))
}

/// A shape as Python writes it.
fn as_tuple(shape: &[usize]) -> String {
    let axes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    if axes.len() == 1 { format!("({},)", axes[0]) } else { format!("({})", axes.join(", ")) }
}

/// Positions, velocities and accelerations of equally many samples.
#[derive(Clone)]
pub(crate) struct Motion {
    /// Positions `[m | rad]`.
    pub(crate) q: Samples,
    /// Velocities `[m/s | rad/s]`.
    pub(crate) v: Samples,
    /// Accelerations `[m/s² | rad/s²]`.
    pub(crate) a: Samples,
}

impl Motion {
    /// From three arrays of shape `(n_samples, n)`.
    pub(crate) fn try_new(arrays: [&ArrayLike<'_>; 3], n: usize, columns: &str) -> PyResult<Self> {
        let [q, v, a] = arrays;
        let [q, v, a] = Samples::each([("q", q), ("v", v), ("a", a)], n, columns)?;
        Ok(Self { q, v, a })
    }

    /// At rest in the poses of one array of shape `(n_samples, n)`.
    pub(crate) fn try_still(q: &ArrayLike<'_>, n: usize, columns: &str) -> PyResult<Self> {
        let q = Samples::try_new("q", q, n, columns)?;
        let rest = || Samples::zeros(q.len, n);
        Ok(Self { v: rest(), a: rest(), q })
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.q.len
    }

    /// Some samples.
    pub(crate) fn rows(&self, samples: Range<usize>) -> Rows<'_> {
        Rows { q: self.q.rows(samples.clone()), v: self.v.rows(samples.clone()), a: self.a.rows(samples) }
    }
}

/// A vector from Python; `wanted` is its length where that is fixed by another.
pub(crate) fn vector(name: &str, array: &ArrayLike<'_>, wanted: Option<usize>) -> PyResult<Vec<f64>> {
    let shape = array.shape();
    let fits = shape.len() == 1 && wanted.is_none_or(|n| n == shape[0]);
    if !fits {
        let wanted = wanted.map_or("n_samples".to_string(), |n| n.to_string());
        return Err(error::value(format!("{name} has shape {}, must be ({wanted},)", as_tuple(shape))));
    }
    Ok(array.as_array().iter().copied().collect())
}

fn bad_length<E: core::fmt::Display>(e: E) -> PyErr {
    error::value(e.to_string())
}

/// A vector that Python may read but not write: it is a copy, and writing to it would change nothing.
pub(crate) fn read_only<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    let array = Array1::from(values.to_vec()).into_pyarray(py);
    drop(array.readwrite().make_nonwriteable());
    array
}

/// Row by row as an array of two axes.
pub(crate) fn matrix<T: Element>(py: Python<'_>, values: Vec<T>, shape: [usize; 2]) -> PyResult<Bound<'_, PyArray2<T>>> {
    Ok(Array2::from_shape_vec((shape[0], shape[1]), values).map_err(bad_length)?.into_pyarray(py))
}

/// Matrix after matrix, each row by row, as an array of three axes.
pub(crate) fn matrices(py: Python<'_>, values: Vec<f64>, shape: [usize; 3]) -> PyResult<Bound<'_, PyArray3<f64>>> {
    Ok(Array3::from_shape_vec((shape[0], shape[1], shape[2]), values).map_err(bad_length)?.into_pyarray(py))
}
