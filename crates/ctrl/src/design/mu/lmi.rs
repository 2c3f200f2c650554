//! The linear matrix inequality of the upper bound and its barrier.
//!
//! With D > 0 and G Hermitian of the structure, β is an upper bound of μ when [Fan1991, theorem 1]
//! `F = t·D_w − M*·D_z·M − j·(G·M − M*·G) > 0`, t = β².
//! F is linear in the entries of D and G. With F = L·L*, V = L⁻¹ and N = V·M*, the matrix that multiplies one unknown, seen in the metric
//! of F, is a sum of a few outer products of columns of V and N; gradient and Hessian of −log det F are its trace and the Gram matrix of
//! all of them. The Gram form keeps directions that hardly matter from drowning in the rounding of those that do.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{Complex, DMatrix, DVector};

use super::hermitian::{cholesky, inverse_lower, log_det};
use super::structure::{Placed, Structure};
use super::{Block, CMatrix};

/// Largest eigenvalue of G, after balancing and with D near one: where a larger G would help without end, the interior has no centre.
/// What counts is G relative to its own D, and that stays free: D may be as small as it likes.
const G_BOX: f64 = 1.0e4;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    D,
    G,
}

/// Entry (row, column, value) of a matrix that multiplies one unknown.
type Entry = (usize, usize, Complex<f64>);

/// One real unknown: an element of a Hermitian basis of its block.
#[derive(Debug, Clone)]
struct Unknown {
    kind: Kind,
    block: usize,
    /// Entries in the coordinates of w and, one to one for square blocks, of z.
    w: Vec<Entry>,
    z: Vec<Entry>,
}

impl Unknown {
    fn is_diagonal(&self) -> bool {
        self.kind == Kind::D && self.w[0].0 == self.w[0].1
    }
}

/// The inequality of one (balanced) matrix.
#[derive(Debug, Clone)]
pub(crate) struct Lmi {
    pub(crate) M: CMatrix,
    pub(crate) placed: Vec<Placed>,
    unknowns: Vec<Unknown>,
}

/// Barrier and derivatives at one point.
pub(crate) struct Local {
    pub(crate) gradient: DVector<f64>,
    pub(crate) hessian: DMatrix<f64>,
    /// Derivative of the gradient with respect to t = β².
    pub(crate) gradient_t: DVector<f64>,
    /// Distance to the smallest feasible t, exact at a centre and an estimate beside it.
    pub(crate) gap: f64,
    /// F⁻¹; near the end of the path its leading eigenvectors point at the worst perturbation.
    pub(crate) P: CMatrix,
}

impl Lmi {
    pub(crate) fn new(M: CMatrix, structure: &Structure) -> Self {
        let placed = structure.placed();
        let mut unknowns = Vec::new();
        for (k, p) in placed.iter().enumerate() {
            match p.block {
                Block::Full { .. } => {
                    let one = Complex::new(1.0, 0.0);
                    let diagonal = |r: core::ops::Range<usize>| r.map(|i| (i, i, one)).collect::<Vec<_>>();
                    unknowns.push(Unknown { kind: Kind::D, block: k, w: diagonal(p.w.clone()), z: diagonal(p.z.clone()) });
                }
                Block::Real { repeats } | Block::Complex { repeats } => {
                    unknowns.extend(hermitian_basis(Kind::D, k, p, repeats));
                    if p.block.is_real() {
                        unknowns.extend(hermitian_basis(Kind::G, k, p, repeats));
                    }
                }
            }
        }
        Self { M, placed, unknowns }
    }

    /// The centre for t without end: G = 0, and D a number per block.
    pub(crate) fn start(&self) -> DVector<f64> {
        let value = |u: &Unknown| match self.placed[u.block].block {
            Block::Real { .. } | Block::Complex { .. } => 2.0,
            Block::Full { rows, .. } => 1.0 + rows as f64,
        };
        DVector::from_iterator(self.unknowns.len(), self.unknowns.iter().map(|u| if u.is_diagonal() { value(u) } else { 0.0 }))
    }

    /// Gradient of the trace of D over the unknowns, which fixes the scale that the inequality leaves open.
    fn weights(&self) -> DVector<f64> {
        DVector::from_iterator(self.unknowns.len(), self.unknowns.iter().map(|u| if u.is_diagonal() { 1.0 } else { 0.0 }))
    }

    /// The matrices `(D_w, D_z, G)`, G from z to w.
    pub(crate) fn matrices(&self, x: &DVector<f64>) -> (CMatrix, CMatrix, CMatrix) {
        let (n_z, n_w) = self.M.shape();
        let (mut D_w, mut D_z, mut G) = (CMatrix::zeros(n_w, n_w), CMatrix::zeros(n_z, n_z), CMatrix::zeros(n_w, n_z));
        for (u, &value) in self.unknowns.iter().zip(x.iter()) {
            match u.kind {
                Kind::D => {
                    u.w.iter().for_each(|&(i, j, a)| D_w[(i, j)] += a * value);
                    u.z.iter().for_each(|&(i, j, a)| D_z[(i, j)] += a * value);
                }
                Kind::G => u.w.iter().zip(&u.z).for_each(|(&(i, _, a), &(_, j, _))| G[(i, j)] += a * value),
            }
        }
        (D_w, D_z, G)
    }

    /// F at t = β².
    fn F(&self, (D_w, D_z, G): (&CMatrix, &CMatrix, &CMatrix), t: f64) -> CMatrix {
        let skew = G * &self.M;
        let mut F = self.M.adjoint() * (D_z * &self.M);
        F.iter_mut().for_each(|f| *f = -*f);
        F.zip_apply(D_w, |f, d| *f += d * t);
        // -j(S - S*).
        let minus_j = Complex::new(0.0, -1.0);
        CMatrix::from_fn(F.nrows(), F.ncols(), |i, k| F[(i, k)] + minus_j * (skew[(i, k)] - skew[(k, i)].conj()))
    }

    /// Factors of the blocks of the barrier beside F: D, and the box around G of real blocks; none outside the domain.
    fn sides(&self, D_w: &CMatrix, G: &CMatrix) -> Option<Vec<Side>> {
        let mut out = Vec::with_capacity(3 * self.placed.len());
        for (block, p) in self.placed.iter().enumerate() {
            let (w, size) = (p.w.start, p.w.len());
            let mut put = |kind: Kind, sign: f64, B: CMatrix| {
                out.push(Side { block, kind, sign, L: cholesky(&B)? });
                Some(())
            };
            // Of a full block one number, once.
            let size_d = if matches!(p.block, Block::Full { .. }) { 1 } else { size };
            put(Kind::D, 1.0, D_w.view((w, w), (size_d, size_d)).into_owned())?;
            if p.block.is_real() {
                let G = G.view((w, p.z.start), (size, size));
                let box_ = CMatrix::identity(size, size) * Complex::new(G_BOX, 0.0);
                put(Kind::G, 1.0, &box_ + G)?;
                put(Kind::G, -1.0, box_ - G)?;
            }
        }
        Some(out)
    }

    /// Value of the barrier, none outside the domain.
    pub(crate) fn barrier(&self, x: &DVector<f64>, t: f64) -> Option<f64> {
        let (D_w, D_z, G) = self.matrices(x);
        let sides = self.sides(&D_w, &G)?;
        let L = cholesky(&self.F((&D_w, &D_z, &G), t))?;
        let value = self.weights().dot(x) - log_det(&L) - sides.iter().map(|s| log_det(&s.L)).sum::<f64>();
        value.is_finite().then_some(value)
    }

    /// Barrier derivatives, none outside the domain.
    pub(crate) fn local(&self, x: &DVector<f64>, t: f64) -> Option<Local> {
        let (D_w, D_z, G) = self.matrices(x);
        let sides = self.sides(&D_w, &G)?;
        let V = inverse_lower(&cholesky(&self.F((&D_w, &D_z, &G), t))?);
        let N = &V * self.M.adjoint();
        let n = V.nrows();
        // One column per unknown: its matrix in the metric of F, as n² real numbers.
        let mut J = DMatrix::zeros(n * n, self.unknowns.len());
        let mut gradient = self.weights();
        let mut gradient_t = DVector::zeros(self.unknowns.len());
        let grown = &V * D_w * V.adjoint();
        let grown_flat = flat(&grown);
        let share = grown.trace().re;
        for (a, u) in self.unknowns.iter().enumerate() {
            let seen = in_metric(u, t, &V, &N);
            let column = flat(&seen);
            gradient[a] -= seen.trace().re;
            gradient_t[a] = column.dot(&grown_flat) - own_t(u, &V);
            J.set_column(a, &column);
        }
        let mut hessian = J.tr_mul(&J);
        let mut boxes = 0.0;
        for side in &sides {
            boxes += self.add_side(side, &mut gradient, &mut hessian);
        }
        Some(Local { gradient, hessian, gradient_t, gap: (self.weights().dot(x) + boxes) / share, P: V.adjoint() * V })
    }

    /// Adds the part of one block of the barrier beside F; returns its share in the distance to the smallest t.
    fn add_side(&self, side: &Side, gradient: &mut DVector<f64>, hessian: &mut DMatrix<f64>) -> f64 {
        let w = self.placed[side.block].w.start;
        let V = inverse_lower(&side.L);
        let own: Vec<usize> =
            (0..self.unknowns.len()).filter(|&a| self.unknowns[a].block == side.block && self.unknowns[a].kind == side.kind).collect();
        let mut columns = Vec::with_capacity(own.len());
        for &a in &own {
            let u = &self.unknowns[a];
            let mut seen = CMatrix::zeros(V.nrows(), V.nrows());
            for &(i, j, c) in u.w.iter().filter(|e| e.0 - w < V.nrows()) {
                add_outer(&mut seen, c * side.sign, V.column(i - w), V.column(j - w));
            }
            gradient[a] -= seen.trace().re;
            columns.push(flat(&seen));
        }
        for (c, &a) in own.iter().enumerate() {
            for (d, &b) in own.iter().enumerate() {
                hessian[(a, b)] += columns[c].dot(&columns[d]);
            }
        }
        if side.kind == Kind::G { G_BOX * V.norm_squared() } else { 0.0 }
    }
}

/// `V·F_u·V*` for the matrix `F_u` that multiplies one unknown.
fn in_metric(u: &Unknown, t: f64, V: &CMatrix, N: &CMatrix) -> CMatrix {
    let n = V.nrows();
    let mut out = CMatrix::zeros(n, n);
    match u.kind {
        Kind::D => {
            u.w.iter().for_each(|&(i, j, a)| add_outer(&mut out, a * t, V.column(i), V.column(j)));
            u.z.iter().for_each(|&(i, j, a)| add_outer(&mut out, -a, N.column(i), N.column(j)));
            out
        }
        Kind::G => {
            let minus_j = Complex::new(0.0, -1.0);
            for (&(i, _, a), &(_, j, _)) in u.w.iter().zip(&u.z) {
                add_outer(&mut out, minus_j * a, V.column(i), N.column(j));
            }
            let adjoint = out.adjoint();
            out + adjoint
        }
    }
}

/// Trace of F⁻¹ with the derivative of `F_u` along t.
fn own_t(u: &Unknown, V: &CMatrix) -> f64 {
    if u.kind == Kind::G {
        return 0.0;
    }
    u.w.iter().map(|&(i, j, a)| (a * V.column(j).dotc(&V.column(i))).re).sum()
}

/// Factor of one block of the barrier beside F.
struct Side {
    block: usize,
    /// Whether it holds D, or G with its sign.
    kind: Kind,
    sign: f64,
    L: CMatrix,
}

/// A += a·x·y*.
fn add_outer(A: &mut CMatrix, a: Complex<f64>, x: nalgebra::DVectorView<'_, Complex<f64>>, y: nalgebra::DVectorView<'_, Complex<f64>>) {
    for c in 0..y.len() {
        let factor = a * y[c].conj();
        for r in 0..x.len() {
            A[(r, c)] += x[r] * factor;
        }
    }
}

/// A Hermitian matrix as real numbers whose dot product is the trace of the product.
fn flat(A: &CMatrix) -> DVector<f64> {
    let n = A.nrows();
    let mut out = DVector::zeros(n * n);
    for j in 0..n {
        out[j * n + j] = A[(j, j)].re;
        for i in j + 1..n {
            out[j * n + i] = core::f64::consts::SQRT_2 * A[(i, j)].re;
            out[i * n + j] = core::f64::consts::SQRT_2 * A[(i, j)].im;
        }
    }
    out
}

fn hermitian_basis(kind: Kind, block: usize, p: &Placed, size: usize) -> Vec<Unknown> {
    let mut out = Vec::new();
    let (one, j) = (Complex::new(1.0, 0.0), Complex::new(0.0, 1.0));
    let mut push = |entries: Vec<Entry>| {
        let at = |o: usize| entries.iter().map(|&(r, c, a)| (r + o, c + o, a)).collect::<Vec<_>>();
        out.push(Unknown { kind, block, w: at(p.w.start), z: at(p.z.start) });
    };
    for r in 0..size {
        push(vec![(r, r, one)]);
        for c in 0..r {
            push(vec![(r, c, one), (c, r, one)]);
            push(vec![(r, c, j), (c, r, -j)]);
        }
    }
    out
}
