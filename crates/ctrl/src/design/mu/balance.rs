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

/// Balances; `is_measured` blocks alone follow the size, the others keep the scale of M.
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
    for (i, p) in placed.iter().enumerate() {
        for (j, q) in placed.iter().enumerate() {
            let factor = scales[i] / scales[j];
            out.view_mut((p.z.start, q.w.start), (p.z.len(), q.w.len())).iter_mut().for_each(|m| *m *= factor);
        }
    }
    let largest = out.iter().map(|m| m.re.abs().max(m.im.abs())).fold(0.0, f64::max);
    let size = if largest > 0.0 { power_of_two_near(largest) } else { 1.0 };
    out.iter_mut().for_each(|m| *m /= size);
    Balanced { M: out, scales, size }
}
