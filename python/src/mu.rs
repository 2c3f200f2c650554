//! Structured singular value.

use nalgebra::{Complex, DMatrix};
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLikeDyn, PyUntypedArrayMethods};
use pkm_ctrl::design::mu::{
    Block, CMatrix, Guarantee, LowerBound, Point, Settings, StateSpace, Structure, Value, lower_bound, sweep, upper_bound,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyComplex, PyDict, PyTuple, PyType};
use serde::{Deserialize, Serialize};

use crate::array::ArrayLike;
use crate::{error, long, state};

type ComplexLike<'py> = PyArrayLikeDyn<'py, numpy::Complex64, AllowTypeChange>;

/// Bounds of the structured singular value, with what shows them. It never changes.
#[pyclass(frozen, name = "Mu", module = "pkm")]
pub(crate) struct Mu {
    /// Upper bound, proved.
    #[pyo3(get)]
    upper: f64,
    /// Lower bound, shown by `worst`; 0 where no perturbation was found or looked for.
    #[pyo3(get)]
    lower: f64,
    /// Frequency at which `worst` acts [rad/s]; None of a matrix.
    #[pyo3(get)]
    w: Option<f64>,
    /// Range of frequencies [rad/s] on all of which `upper` holds; None of a matrix, and where only points are known.
    #[pyo3(get)]
    guaranteed: Option<(f64, f64)>,
    points: Vec<Point>,
    worst: Option<Vec<Value>>,
}

/// The same as it travels.
#[derive(Serialize, Deserialize)]
struct Travelling {
    upper: f64,
    lower: f64,
    w: Option<f64>,
    guaranteed: Option<(f64, f64)>,
    /// Frequency, upper and lower bound.
    points: Vec<[f64; 3]>,
    worst: Option<Vec<Worst>>,
}

/// A [`Value`]; complex numbers are pairs, matrices go column by column.
#[derive(Serialize, Deserialize)]
enum Worst {
    Real(f64),
    Complex([f64; 2]),
    Full { rows: usize, values: Vec<[f64; 2]> },
}

impl Worst {
    fn of(value: &Value) -> Self {
        match value {
            Value::Real(x) => Self::Real(*x),
            Value::Complex(x) => Self::Complex([x.re, x.im]),
            Value::Full(x) => Self::Full { rows: x.nrows(), values: x.iter().map(|x| [x.re, x.im]).collect() },
        }
    }

    /// None where the numbers are not those of a matrix.
    fn value(self) -> Option<Value> {
        let number = |[re, im]: [f64; 2]| Complex::new(re, im);
        Some(match self {
            Self::Real(x) => Value::Real(x),
            Self::Complex(x) => Value::Complex(number(x)),
            Self::Full { rows, values } => {
                let cols = values.len().checked_div(rows).filter(|cols| cols * rows == values.len())?;
                Value::Full(CMatrix::from_iterator(rows, cols, values.into_iter().map(number)))
            }
        })
    }
}

#[pymethods]
impl Mu {
    #[classmethod]
    #[pyo3(name = "_from_bytes")]
    fn from_bytes(_cls: &Bound<'_, PyType>, bytes: &[u8]) -> PyResult<Self> {
        let Travelling { upper, lower, w, guaranteed, points, worst } = state::from_bytes("Mu", bytes)?;
        let worst = worst.map(|all| all.into_iter().map(Worst::value).collect::<Option<Vec<_>>>().ok_or_else(damaged)).transpose()?;
        let points = points.into_iter().map(|[w, upper, lower]| Point { w, upper, lower }).collect();
        Ok(Self { upper, lower, w, guaranteed, points, worst })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let Self { upper, lower, w, guaranteed, points, worst } = slf.get();
        let travelling = Travelling {
            upper: *upper,
            lower: *lower,
            w: *w,
            guaranteed: *guaranteed,
            points: points.iter().map(|p| [p.w, p.upper, p.lower]).collect(),
            worst: worst.as_ref().map(|all| all.iter().map(Worst::of).collect()),
        };
        let bytes = state::to_bytes(&travelling)?;
        Ok((slf.get_type().getattr("_from_bytes")?, (PyBytes::new(slf.py(), &bytes),)))
    }

    /// The worst perturbation found: one float, complex or array per block; None where there is none.
    #[getter]
    fn worst<'py>(&self, py: Python<'py>) -> PyResult<Option<Vec<Bound<'py, PyAny>>>> {
        let one = |v: &Value| match v {
            Value::Real(x) => Ok(x.into_pyobject(py)?.into_any()),
            Value::Complex(x) => Ok(PyComplex::from_doubles(py, x.re, x.im).into_any()),
            Value::Full(x) => Ok(array(py, x).into_any()),
        };
        self.worst.as_ref().map(|all| all.iter().map(one).collect::<PyResult<Vec<_>>>()).transpose()
    }

    /// Frequencies of the points [rad/s].
    #[getter]
    fn frequencies<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.w)
    }

    /// Upper bounds at the points.
    #[getter]
    fn uppers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.upper)
    }

    /// Lower bounds at the points.
    #[getter]
    fn lowers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |p| p.lower)
    }

    fn __repr__(&self) -> String {
        let scope = match (self.guaranteed, self.w) {
            (Some((low, high)), _) => format!(", guaranteed on [{low}, {high}] rad/s"),
            (None, Some(_)) => ", grid only".to_string(),
            (None, None) => String::new(),
        };
        format!("Mu({} <= mu <= {}{scope})", self.lower, self.upper)
    }
}

impl Mu {
    fn column<'py>(&self, py: Python<'py>, of: fn(&Point) -> f64) -> Bound<'py, PyArray1<f64>> {
        self.points.iter().map(of).collect::<Vec<f64>>().into_pyarray(py)
    }
}

fn damaged() -> PyErr {
    error::value("pickle of Mu: a block of the perturbation is no matrix (damaged)")
}

fn array<'py>(py: Python<'py>, x: &CMatrix) -> Bound<'py, PyArray2<numpy::Complex64>> {
    numpy::ndarray::Array2::from_shape_fn(x.shape(), |(i, j)| numpy::Complex64::new(x[(i, j)].re, x[(i, j)].im)).into_pyarray(py)
}

/// Bounds the structured singular value of a complex matrix, or of a system (A, B, C, D) over a range of frequencies.
///
/// `blocks`: dicts with `kind` "real", "complex" (with `repeats`) or "full" (with `rows`, `cols` of the perturbation);
/// `dt`: sample time of a discrete system [s]; `frequencies`: range [rad/s], all by default; `bounds`: "both", or "upper" to leave
/// the search for the worst perturbation out (of a matrix); `slack`: share by which the proved level may exceed the largest bound at a
/// point (1e-4).
#[pyfunction]
#[pyo3(signature = (system, blocks, *, dt = None, frequencies = None, bounds = None, slack = None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn mu(
    py: Python<'_>,
    system: &Bound<'_, PyAny>,
    blocks: Vec<Bound<'_, PyDict>>,
    dt: Option<f64>,
    frequencies: Option<(f64, f64)>,
    bounds: Option<&str>,
    slack: Option<f64>,
) -> PyResult<Mu> {
    let blocks = blocks.iter().enumerate().map(|(i, b)| block(i, b)).collect::<PyResult<Vec<Block>>>()?;
    let structure = Structure::try_new(blocks).map_err(|e| error::value(e.to_string()))?;
    let is_both = match bounds {
        None | Some("both") => true,
        Some("upper") => false,
        Some(other) => return Err(error::value(format!("bounds = {other:?} (must be \"both\" or \"upper\")"))),
    };
    if let Ok(parts) = system.cast::<PyTuple>() {
        let system = state_space(parts, dt)?;
        let range = frequencies.unwrap_or((0.0, system.nyquist()));
        let settings = Settings { slack: slack.unwrap_or(Settings::default().slack), ..Settings::default() };
        let found =
            long::apart(py, move || sweep(&system, &structure, [range.0, range.1], &settings))?.map_err(|e| error::value(e.to_string()))?;
        let guaranteed = if let Guarantee::Interval([low, high]) = found.guarantee { Some((low, high)) } else { None };
        let LowerBound { beta, perturbation, w } = found.worst;
        let worst = perturbation.map(|p| p.blocks);
        return Ok(Mu { upper: found.upper, lower: beta, w: Some(w), guaranteed, points: found.points, worst });
    }
    if dt.is_some() || frequencies.is_some() || slack.is_some() {
        return Err(error::value("dt, frequencies and slack are for a system (A, B, C, D), not for a matrix"));
    }
    let matrix = complex_matrix(&system.extract::<ComplexLike<'_>>()?)?;
    let (upper, lower) = py
        .detach(|| {
            let upper = upper_bound(&matrix, &structure)?;
            let lower = if is_both { Some(lower_bound(&matrix, &structure, &upper)?) } else { None };
            Ok((upper.certificate.beta, lower))
        })
        .map_err(|e: pkm_ctrl::design::mu::MuError| error::value(e.to_string()))?;
    let beta = lower.as_ref().map_or(0.0, |l| l.beta);
    let worst = lower.and_then(|l| l.perturbation).map(|p| p.blocks);
    Ok(Mu { upper, lower: beta, w: None, guaranteed: None, points: Vec::new(), worst })
}

/// Sizes beyond this are a mistake, or would not end today.
const SIZE_MAX: usize = 400;

fn block(i: usize, given: &Bound<'_, PyDict>) -> PyResult<Block> {
    let number = |key: &str| -> PyResult<usize> {
        let n = given.get_item(key)?.map_or(Ok(1), |v| v.extract::<usize>())?;
        if n == 0 || n > SIZE_MAX {
            return Err(error::value(format!("blocks[{i}]: {key} = {n} (must be 1 to {SIZE_MAX})")));
        }
        Ok(n)
    };
    let kind: String = given.get_item("kind")?.ok_or_else(|| error::value(format!("blocks[{i}]: no \"kind\"")))?.extract()?;
    let known: &[&str] = if kind == "full" { &["kind", "rows", "cols"] } else { &["kind", "repeats"] };
    for key in given.keys() {
        let key: String = key.extract()?;
        if !known.contains(&key.as_str()) {
            return Err(error::value(format!("blocks[{i}]: {key:?} is not known for kind {kind:?}")));
        }
    }
    match kind.as_str() {
        "real" => Ok(Block::Real { repeats: number("repeats")? }),
        "complex" => Ok(Block::Complex { repeats: number("repeats")? }),
        "full" => Ok(Block::Full { rows: number("rows")?, cols: number("cols")? }),
        other => Err(error::value(format!("blocks[{i}]: kind {other:?} (must be \"real\", \"complex\" or \"full\")"))),
    }
}

fn shape2(name: &str, shape: &[usize]) -> PyResult<[usize; 2]> {
    let [rows, cols] = *shape else { return Err(error::value(format!("{name} has {} dimensions (must have 2)", shape.len()))) };
    if rows > SIZE_MAX || cols > SIZE_MAX {
        return Err(error::value(format!("{name} is {rows} x {cols} (at most {SIZE_MAX} x {SIZE_MAX})")));
    }
    Ok([rows, cols])
}

fn complex_matrix(given: &ComplexLike<'_>) -> PyResult<CMatrix> {
    let [rows, cols] = shape2("M", given.shape())?;
    let view = given.as_array();
    Ok(CMatrix::from_fn(rows, cols, |i, j| Complex::new(view[[i, j]].re, view[[i, j]].im)))
}

fn state_space(parts: &Bound<'_, PyTuple>, dt: Option<f64>) -> PyResult<StateSpace> {
    if parts.len() != 4 {
        return Err(error::value(format!("the system has {} parts (must be A, B, C, D)", parts.len())));
    }
    let mut matrices = Vec::new();
    for (name, part) in ["A", "B", "C", "D"].into_iter().zip(parts.iter()) {
        let given = part.extract::<ArrayLike<'_>>()?;
        let [rows, cols] = shape2(name, given.shape())?;
        let view = given.as_array();
        matrices.push(DMatrix::from_fn(rows, cols, |i, j| view[[i, j]]));
    }
    let [a, b, c, d]: [DMatrix<f64>; 4] = matrices.try_into().map_err(|_| error::value("four matrices"))?;
    StateSpace::try_new([a, b, c, d], dt).map_err(|e| error::value(e.to_string()))
}
