//! Perturbations of a structure: shown, not claimed.

use alloc::vec::Vec;

use nalgebra::{Complex, DVector};

use super::ascent::eigenvalues;
use super::structure::{Placed, Structure};
use super::{Block, CMatrix};

/// One block of a perturbation.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Of a block of real scalars.
    Real(f64),
    /// Of a block of complex scalars.
    Complex(Complex<f64>),
    /// Of a full block.
    Full(CMatrix),
}

impl Value {
    /// Largest singular value.
    #[must_use]
    pub fn size(&self) -> f64 {
        match self {
            Self::Real(x) => x.abs(),
            Self::Complex(x) => pkm_dyn::math::hypot(x.re, x.im),
            Self::Full(X) => largest_singular_value(X),
        }
    }
}

/// A perturbation of the structure that makes I − M·Δ singular.
#[derive(Debug, Clone, PartialEq)]
pub struct Perturbation {
    /// Value of every block, in order.
    pub blocks: Vec<Value>,
    /// Size of the largest block; its inverse is a lower bound of μ.
    pub size: f64,
    /// How far from singular I − M·Δ is, 0 at best: the larger of its smallest singular value as a share of 1 + σ(M·Δ), in balanced
    /// coordinates, and the distance of the nearest eigenvalue of M·Δ from one.
    pub singularity: f64,
}

/// A perturbation counts as one that makes the loop singular below this [`Perturbation::singularity`].
pub const SINGULAR: f64 = 1.0e-9;

impl Perturbation {
    /// Measures a perturbation on M.
    pub(crate) fn measured(M: &CMatrix, structure: &Structure, blocks: Vec<Value>) -> Self {
        let size = blocks.iter().map(Value::size).fold(0.0, f64::max);
        let mut out = Self { blocks, size, singularity: f64::INFINITY };
        let product = M * out.delta(structure);
        let largest = largest_singular_value(&product);
        let loop_ = CMatrix::identity(product.nrows(), product.nrows()) - &product;
        let smallest = singular_values(&loop_).iter().copied().fold(f64::INFINITY, f64::min) / (1.0 + largest);
        let away = |l: Complex<f64>| pkm_dyn::math::hypot(l.re - 1.0, l.im);
        out.singularity = eigenvalues(&product).into_iter().map(away).fold(f64::INFINITY, f64::min).max(smallest);
        out
    }

    /// The whole Δ, `n_w` × `n_z`.
    ///
    /// # Panics
    /// When the blocks are not those of the structure.
    #[must_use]
    pub fn delta(&self, structure: &Structure) -> CMatrix {
        assert_eq!(self.blocks.len(), structure.blocks().len(), "one value per block");
        let mut out = CMatrix::zeros(structure.n_w(), structure.n_z());
        for (value, p) in self.blocks.iter().zip(structure.placed()) {
            let (w, z) = (p.w.start, p.z.start);
            match value {
                Value::Real(x) => (0..p.w.len()).for_each(|i| out[(w + i, z + i)] = Complex::new(*x, 0.0)),
                Value::Complex(x) => (0..p.w.len()).for_each(|i| out[(w + i, z + i)] = *x),
                Value::Full(X) => out.view_mut((w, z), X.shape()).copy_from(X),
            }
        }
        out
    }
}

/// One block of a perturbation of size at most one, as the searches move it: full blocks have rank one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Part {
    Real(f64),
    /// On the unit circle.
    Phase(Complex<f64>),
    /// u·v*, both of length one.
    Pair(DVector<Complex<f64>>, DVector<Complex<f64>>),
}

impl Part {
    /// The block divided by `lambda`.
    pub(crate) fn value(&self, lambda: f64) -> Value {
        match self {
            Self::Real(q) => Value::Real(q / lambda),
            Self::Phase(q) => Value::Complex(q / lambda),
            Self::Pair(u, v) => Value::Full(u * v.adjoint() / Complex::new(lambda, 0.0)),
        }
    }
}

/// Q·M: the rows of M seen through the parts.
pub(crate) fn apply(parts: &[Part], placed: &[Placed], M: &CMatrix) -> CMatrix {
    let n = M.ncols();
    let mut out = CMatrix::zeros(n, n);
    for (part, p) in parts.iter().zip(placed) {
        let rows = M.rows(p.z.start, p.z.len());
        let mut target = out.rows_mut(p.w.start, p.w.len());
        match part {
            Part::Real(q) => target.copy_from(&(rows * Complex::new(*q, 0.0))),
            Part::Phase(q) => target.copy_from(&(rows * *q)),
            Part::Pair(u, v) => target.copy_from(&(u * (v.adjoint() * rows))),
        }
    }
    out
}

/// A part of size one (or a real one within its bounds) for a block, that sends `z_k` along `x_k` as nearly as its kind allows.
pub(crate) fn sending(block: Block, z: &DVector<Complex<f64>>, x: &DVector<Complex<f64>>, beta: f64) -> Part {
    match block {
        Block::Real { .. } => {
            let square = z.norm_squared();
            Part::Real(if square > 0.0 { (beta * z.dotc(x).re / square).clamp(-1.0, 1.0) } else { 1.0 })
        }
        Block::Complex { .. } => Part::Phase(unit(z.dotc(x))),
        Block::Full { .. } => Part::Pair(normalised(x.clone()), normalised(z.clone())),
    }
}

/// A complex number brought to the unit circle.
pub(crate) fn unit(x: Complex<f64>) -> Complex<f64> {
    let size = pkm_dyn::math::hypot(x.re, x.im);
    if size > 0.0 && size.is_finite() { x / size } else { Complex::new(1.0, 0.0) }
}

/// A vector brought to length one; the first unit vector when it has none.
pub(crate) fn normalised(mut x: DVector<Complex<f64>>) -> DVector<Complex<f64>> {
    let size = x.norm_squared().sqrt();
    if size > 0.0 && size.is_finite() {
        x.iter_mut().for_each(|v| *v /= size);
    } else {
        x.fill(Complex::new(0.0, 0.0));
        x[0] = Complex::new(1.0, 0.0);
    }
    x
}

/// Singular values, largest first; empty when they cannot be computed.
pub(crate) fn singular_values(A: &CMatrix) -> Vec<f64> {
    let copy = faer::Mat::from_fn(A.nrows(), A.ncols(), |i, j| A[(i, j)]);
    copy.singular_values().unwrap_or_default()
}

/// Largest singular value.
pub(crate) fn largest_singular_value(A: &CMatrix) -> f64 {
    singular_values(A).first().copied().unwrap_or(f64::INFINITY)
}
