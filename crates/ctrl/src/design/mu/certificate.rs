//! Scalings that prove an upper bound, checked in arithmetic that counts its own rounding.

use nalgebra::{Complex, DMatrix};

use super::hermitian::is_surely_positive;
use super::structure::Structure;
use super::{Block, CMatrix};

/// Unit roundoff of f64.
const U: f64 = f64::EPSILON / 2.0;

/// Proof that μ(M) ≤ `beta`: `M*·D_z·M + j·(G·M − M*·G) − β²·D_w < 0` with D > 0 and G of the structure \[Fan1991\].
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    /// The proved bound, same unit as M.
    pub beta: f64,
    /// D on the inputs w of M: Hermitian, positive, one full block per repeated scalar, d·I per full block.
    pub d_w: CMatrix,
    /// D on the outputs z of M: the same numbers on the columns of Δ.
    pub d_z: CMatrix,
    /// G, from z to w; zero outside blocks of real scalars, where it is Hermitian.
    pub g: CMatrix,
}

impl Certificate {
    /// Whether the inequality holds for `M` beyond doubt: the left side is formed with a bound on every rounding, and the largest
    /// matrix within that bound is shown to be negative definite.
    ///
    /// # Panics
    /// When the dimensions are not those of the structure.
    #[must_use]
    pub fn holds(&self, M: &CMatrix, structure: &Structure) -> bool {
        assert_eq!(M.shape(), (structure.n_z(), structure.n_w()), "M has the dimensions of the structure");
        self.has_structure(structure) && self.is_positive() && {
            let (F, radius) = self.inequality(M, structure);
            is_surely_positive(&F, &radius)
        }
    }

    /// Largest eigenvalue of the left side, after scaling `D_w` to the identity, as a share of β² (or of one when β is 0); negative when
    /// the inequality holds. In plain floating point.
    #[must_use]
    pub fn residual(&self, M: &CMatrix, structure: &Structure) -> f64 {
        let (F, _) = self.inequality(M, structure);
        let Some(L) = super::hermitian::cholesky(&self.d_w) else { return f64::INFINITY };
        let Some(X) = L.solve_lower_triangular(&F) else { return f64::INFINITY };
        let Some(Y) = L.solve_lower_triangular(&X.adjoint()) else { return f64::INFINITY };
        let scale = if self.beta > 0.0 { self.beta * self.beta } else { 1.0 };
        -Y.symmetric_eigenvalues().min() / scale
    }

    fn has_structure(&self, structure: &Structure) -> bool {
        let placed = structure.placed();
        let zero = |c: &Complex<f64>| c.norm_sqr() <= 0.0;
        let hermitian = |B: &CMatrix| (0..B.nrows()).all(|i| (0..=i).all(|j| zero(&(B[(i, j)] - B[(j, i)].conj()))));
        let mut covered = [self.d_w.clone(), self.d_z.clone(), self.g.clone()];
        for p in &placed {
            let (w, z, m, n) = (p.w.start, p.z.start, p.w.len(), p.z.len());
            let D_w = self.d_w.view((w, w), (m, m)).into_owned();
            let D_z = self.d_z.view((z, z), (n, n)).into_owned();
            let G = self.g.view((w, z), (m, n)).into_owned();
            let is_scalar = |D: &CMatrix| (D - CMatrix::identity(D.nrows(), D.nrows()) * D_w[(0, 0)]).iter().all(zero);
            let fits = match p.block {
                Block::Full { .. } => is_scalar(&D_w) && is_scalar(&D_z) && D_w[(0, 0)].im.abs() <= 0.0,
                _ => hermitian(&D_w) && (&D_w - &D_z).iter().all(zero),
            };
            if !fits || !(if p.block.is_real() { hermitian(&G) } else { G.iter().all(zero) }) {
                return false;
            }
            covered[0].view_mut((w, w), (m, m)).fill(Complex::new(0.0, 0.0));
            covered[1].view_mut((z, z), (n, n)).fill(Complex::new(0.0, 0.0));
            covered[2].view_mut((w, z), (m, n)).fill(Complex::new(0.0, 0.0));
        }
        covered.iter().all(|B| B.iter().all(zero))
    }

    fn is_positive(&self) -> bool {
        let none = |D: &CMatrix| DMatrix::zeros(D.nrows(), D.nrows());
        is_surely_positive(&self.d_w, &none(&self.d_w)) && is_surely_positive(&self.d_z, &none(&self.d_z))
    }

    /// `β²·D_w − M*·D_z·M − j·(G·M − M*·G)` and a bound on the error of each of its entries.
    fn inequality(&self, M: &CMatrix, structure: &Structure) -> (CMatrix, DMatrix<f64>) {
        let n = structure.n_w();
        // Rounded towards zero: a smaller β² is harder to prove.
        let t = self.beta * self.beta * (1.0 - 4.0 * U);
        let quadratic = M.adjoint() * (&self.d_z * M);
        let skew = &self.g * M;
        let j = Complex::new(0.0, 1.0);
        let F = CMatrix::from_fn(n, n, |r, c| self.d_w[(r, c)] * t - quadratic[(r, c)] - j * (skew[(r, c)] - skew[(c, r)].conj()));
        // Every entry is a sum of products; with |x| <= |re| + |im| the error of each sum of K terms is below 4·K·u times the sum of
        // moduli, two products deep.
        let size = |A: &CMatrix| DMatrix::from_fn(A.nrows(), A.ncols(), |r, c| A[(r, c)].re.abs() + A[(r, c)].im.abs());
        let (M1, D_z, G) = (size(M), size(&self.d_z), size(&self.g));
        let quadratic = M1.transpose() * (D_z * &M1);
        let skew = G * M1;
        let steps = 16.0 * (M.nrows() + n + 8) as f64 * U;
        let radius = DMatrix::from_fn(n, n, |r, c| {
            let d = self.d_w[(r, c)];
            steps * ((d.re.abs() + d.im.abs()) * t + quadratic[(r, c)] + skew[(r, c)] + skew[(c, r)]) + f64::MIN_POSITIVE
        });
        (F, radius)
    }
}
