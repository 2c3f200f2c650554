//! Power iteration for the lower bound of mixed μ \[Young1990\].

use alloc::vec::Vec;

use nalgebra::{Complex, DVector};

use super::perturbation::{Part, normalised, sending, unit};
use super::structure::Placed;
use super::{Block, CMatrix};

/// Rounds at most; the iteration converges within them or wanders.
const ROUNDS: usize = 60;

/// Perturbation of size one that the iteration ends at, from the direction `b` in w.
pub(crate) fn power_iteration(M: &CMatrix, placed: &[Placed], b: DVector<Complex<f64>>) -> Vec<Part> {
    let M_adjoint = M.adjoint();
    let mut b = normalised(b);
    let mut q = alloc::vec![1.0; placed.len()];
    let mut a = normalised(M * &b);
    // A first guess of w on the far side: what sends z back along b.
    let mut w = b.clone();
    let mut last = 0.0;
    for _ in 0..ROUNDS {
        let mut z = DVector::zeros(M.nrows());
        for (k, p) in placed.iter().enumerate() {
            let (a_k, w_k) = (a.rows(p.z.start, p.z.len()), w.rows(p.w.start, p.w.len()));
            let z_k = match p.block {
                Block::Real { .. } => {
                    w_k * Complex::new(
                        real_value(&mut q[k], &b.rows(p.w.start, p.w.len()).into_owned(), &a_k.into_owned(), &w_k.into_owned()),
                        0.0,
                    )
                }
                Block::Complex { .. } => w_k * unit(w_k.dotc(&a_k)),
                Block::Full { .. } => normalised(a_k.into_owned()) * Complex::new(w_k.norm_squared().sqrt(), 0.0),
            };
            z.rows_mut(p.z.start, p.z.len()).copy_from(&z_k);
        }
        w = normalised(&M_adjoint * z);
        for (k, p) in placed.iter().enumerate() {
            let (a_k, w_k) = (a.rows(p.z.start, p.z.len()), w.rows(p.w.start, p.w.len()));
            let b_k = match p.block {
                Block::Real { .. } => {
                    a_k * Complex::new(
                        real_value(&mut q[k], &b.rows(p.w.start, p.w.len()).into_owned(), &a_k.into_owned(), &w_k.into_owned()),
                        0.0,
                    )
                }
                Block::Complex { .. } => a_k * unit(a_k.dotc(&w_k)),
                Block::Full { .. } => normalised(w_k.into_owned()) * Complex::new(a_k.norm_squared().sqrt(), 0.0),
            };
            b.rows_mut(p.w.start, p.w.len()).copy_from(&b_k);
        }
        let next = M * &b;
        let beta = next.norm_squared().sqrt();
        a = normalised(next);
        let has_settled = (beta - last).abs() <= 1e-7 * beta;
        last = beta;
        if has_settled {
            break;
        }
    }
    let part = |(k, p): (usize, &Placed)| match p.block {
        Block::Real { .. } => Part::Real(q[k]),
        Block::Complex { .. } => Part::Phase(unit(a.rows(p.z.start, p.z.len()).dotc(&w.rows(p.w.start, p.w.len())))),
        block @ Block::Full { .. } => {
            sending(block, &a.rows(p.z.start, p.z.len()).into_owned(), &w.rows(p.w.start, p.w.len()).into_owned(), 1.0)
        }
    };
    placed.iter().enumerate().map(part).collect()
}

/// The iteration's choice for a real scalar, kept in [−1, 1].
fn real_value(q: &mut f64, b: &DVector<Complex<f64>>, a: &DVector<Complex<f64>>, w: &DVector<Complex<f64>>) -> f64 {
    let size = a.norm_squared().sqrt();
    let along = if size > 0.0 { b.norm_squared().sqrt() / size } else { 0.0 };
    *q = (pkm_dyn::math::sign(*q) * along + a.dotc(w).re).clamp(-1.0, 1.0);
    *q
}
