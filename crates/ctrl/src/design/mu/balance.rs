//! Osborne's balancing by blocks: a diagonal scaling by powers of two that brings rows and columns of blocks to like size.
//!
//! Powers of two make it exact, so that scalings found for the balanced matrix carry over to the given one bit by bit.

use alloc::vec;
use alloc::vec::Vec;

use super::CMatrix;
use super::hermitian::{power_of_two, power_of_two_near};
use super::structure::Placed;

const SWEEPS: usize = 12;

/// Balanced matrix `S_z·M·S_w⁻¹ / size`, scales per block, and the power of two `size` near its largest entry.
pub(crate) struct Balanced {
    pub(crate) M: CMatrix,
    pub(crate) scales: Vec<f64>,
    pub(crate) size: f64,
}

/// Balances and scales.
pub(crate) fn balance(M: &CMatrix, placed: &[Placed]) -> Balanced {
    let n = placed.len();
    let sum = |i: usize, j: usize| -> f64 {
        let (r, c) = (&placed[i].z, &placed[j].w);
        M.view((r.start, c.start), (r.len(), c.len())).iter().map(|m| m.norm_sqr()).sum::<f64>().sqrt()
    };
    let mut norms = vec![0.0; n * n];
    (0..n).for_each(|i| (0..n).for_each(|j| norms[i * n + j] = sum(i, j)));
    let mut scales = vec![1.0; n];
    for _ in 0..SWEEPS {
        let mut has_changed = false;
        for k in 0..n {
            let others = || (0..n).filter(|&j| j != k);
            let row: f64 = scales[k] * others().map(|j| norms[k * n + j] / scales[j]).sum::<f64>();
            let col: f64 = others().map(|j| norms[j * n + k] * scales[j]).sum::<f64>() / scales[k];
            if row > 0.0 && col > 0.0 {
                // Rounded to the nearest power, not the one below: else the sweep would creep.
                let factor = power_of_two_near((col / row).sqrt() * core::f64::consts::SQRT_2);
                let next = (scales[k] * factor).clamp(power_of_two(-40), power_of_two(40));
                has_changed |= next.to_bits() != scales[k].to_bits();
                scales[k] = next;
            }
        }
        if !has_changed {
            break;
        }
    }
    let mut out = M.clone();
    rescale(&mut out, placed, &scales);
    let largest = out.iter().map(|m| m.re.abs().max(m.im.abs())).fold(0.0, f64::max);
    let size = if largest > 0.0 { power_of_two_near(largest) } else { 1.0 };
    out.iter_mut().for_each(|m| *m /= size);
    Balanced { M: out, scales, size }
}

/// `S_z·M·S_w⁻¹` for the scales of the blocks.
pub(crate) fn rescale(M: &mut CMatrix, placed: &[Placed], scales: &[f64]) {
    for (p, s) in placed.iter().zip(scales) {
        for (q, t) in placed.iter().zip(scales) {
            let factor = s / t;
            M.view_mut((p.z.start, q.w.start), (p.z.len(), q.w.len())).iter_mut().for_each(|m| *m *= factor);
        }
    }
}

/// Osborne's balancing of a square matrix by a diagonal similarity of powers of two: the eigenvalues stay.
pub(crate) fn balance_square(A: &mut CMatrix) {
    let n = A.nrows();
    let size = |a: nalgebra::Complex<f64>| a.re.abs() + a.im.abs();
    for _ in 0..SWEEPS {
        let mut has_changed = false;
        for k in 0..n {
            let row: f64 = (0..n).filter(|&j| j != k).map(|j| size(A[(k, j)])).sum();
            let col: f64 = (0..n).filter(|&j| j != k).map(|j| size(A[(j, k)])).sum();
            if row > 0.0 && col > 0.0 && row.is_finite() && col.is_finite() {
                let factor = power_of_two_near((col / row).sqrt() * core::f64::consts::SQRT_2);
                if (factor - 1.0).abs() > 0.0 {
                    has_changed = true;
                    A.row_mut(k).iter_mut().for_each(|a| *a *= factor);
                    A.column_mut(k).iter_mut().for_each(|a| *a /= factor);
                }
            }
        }
        if !has_changed {
            break;
        }
    }
}
