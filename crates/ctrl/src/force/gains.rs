//! Gain matrices of a coupled force loop: along the directions of the effective mass, or from the decoupling disturbance observer.

use pkm_dyn::math;
use pkm_dyn::svd::Svd;

use crate::force::curve::GainCurve;
use crate::force::task::Task;

/// A square matrix of one entry per pair of drives.
pub type Square<const N: usize> = [[f64; N]; N];

/// Room for the decomposition of an N × N matrix.
#[must_use]
pub fn room(n: usize) -> Svd {
    Svd::new(n, n)
}

fn all_finite<const N: usize>(X: &Square<N>) -> bool {
    X.iter().flatten().all(|x| x.is_finite())
}

/// `Σ k_i·u_i·u_iᵀ` over the directions that `svd` holds.
fn along<const N: usize>(svd: &Svd, k: impl Fn(usize) -> f64) -> Square<N> {
    let mut out = [[0.0; N]; N];
    for s in 0..N {
        let (u, gain) = (svd.right(s), k(s));
        for i in 0..N {
            for j in 0..N {
                out[i][j] += gain * u[i] * u[j];
            }
        }
    }
    out
}

/// `K = [U'_m v_0]·diag(k)·[U'_m v_0]ᵀ` with the directions of the effective mass `M'_e = (J⁺)ᵀ·M_e·J⁺`, J the rates of the drives over
/// rates of the task \[McDaid, eq. 8.48\]; none where a number is none.
///
/// `curves` belong to falling singular values, each at its own; `null` is the gain on efforts that strain the robot and move nothing.
pub fn directional<const N: usize, const M: usize>(
    svd: &mut Svd,
    task: &Task<N, M>,
    inertia: &[[f64; M]; M],
    curves: &[GainCurve; M],
    null: f64,
) -> Option<Square<N>> {
    let pinv = &task.jacobian;
    let mass = |i: usize, j: usize| {
        let mut sum = 0.0;
        for a in 0..M {
            for b in 0..M {
                sum += pinv[a][i] * inertia[a][b] * pinv[b][j];
            }
        }
        sum
    };
    svd.factor(mass);
    if svd.values().iter().any(|s| !s.is_finite()) {
        return None;
    }
    let K = along(svd, |s| if s < M { curves[s].at(svd.values()[s]) } else { null });
    all_finite(&K).then_some(K)
}

/// Numbers of the decoupling disturbance observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decoupling {
    /// Share `K_f` of the disturbance that is made up for, 0 … below 1.
    pub share: f64,
    /// Power n of the decoupling matrix D⁻¹, 0 (none) … 1 (complete).
    pub power: f64,
    /// The same share for efforts that move nothing, `K_v0`, in addition, 0 … below 1.
    pub null_share: f64,
    /// Mass that a drive's rotor seems to have at its output, `m_a` `[kg]`.
    pub apparent_mass: f64,
    /// What the commanded force is fed forward for.
    pub forward: Forward,
}

/// What a commanded force is fed forward for: its gain is one there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Forward {
    /// Against a platform that gives way as its mass does: `G = D⁻¹ + H`, the paper's.
    Moving,
    /// Against surroundings that hold it: `G = I + H`.
    Holding,
}

/// `[G, H]` of `K_t·K_a·i = G·F_c − H·F` \[McDaid, eq. 8.13\]; none where a number is none.
///
/// `D⁻¹ = I + m_a·J·M⁻¹·Jᵀ`, `H = K_f/(1−K_f)·D⁻ⁿ + K_v0/(1−K_v0)·v_0·v_0ᵀ`. For n = 1 `D⁻¹ + H` is the paper's
/// `D⁻¹/(1−K_f)` with the same null-space term as H: as printed, with `1/(1−K_v0)`, the force along `v_0` would not be the commanded one. For
/// n < 1 the printed G makes no force right.
pub fn decoupling<const N: usize, const M: usize>(
    svd: &mut Svd,
    task: &Task<N, M>,
    inertia_inverse: &[[f64; M]; M],
    numbers: &Decoupling,
) -> Option<[Square<N>; 2]> {
    let J = &task.inverse_jacobian;
    let coupling = |i: usize, j: usize| {
        let mut sum = if i == j { 1.0 } else { 0.0 };
        for a in 0..M {
            for b in 0..M {
                sum += numbers.apparent_mass * J[i][a] * inertia_inverse[a][b] * J[j][b];
            }
        }
        sum
    };
    svd.factor(coupling);
    if svd.values().iter().any(|s| !s.is_finite()) {
        return None;
    }
    let (h, h0) = (numbers.share / (1.0 - numbers.share), numbers.null_share / (1.0 - numbers.null_share));
    let null = |s: usize| if s < M { 0.0 } else { h0 };
    let H: Square<N> = along(svd, |s| h * math::powf(svd.values()[s], numbers.power) + null(s));
    let forward = |s: usize| if numbers.forward == Forward::Moving { svd.values()[s] } else { 1.0 };
    let G = along(svd, |s| forward(s) + h * math::powf(svd.values()[s], numbers.power) + null(s));
    (all_finite(&H) && all_finite(&G)).then_some([G, H])
}

/// `A·x`.
#[must_use]
pub fn times<const N: usize>(A: &Square<N>, x: &[f64; N]) -> [f64; N] {
    core::array::from_fn(|i| (0..N).map(|j| A[i][j] * x[j]).sum())
}

/// Inverse of a small symmetric positive definite matrix by Gauss-Jordan elimination; none where it is not.
#[must_use]
pub(crate) fn inverse_of<const M: usize>(A: &[[f64; M]; M]) -> Option<[[f64; M]; M]> {
    let (mut left, mut right) = (*A, [[0.0; M]; M]);
    (0..M).for_each(|i| right[i][i] = 1.0);
    for k in 0..M {
        let pivot = left[k][k];
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        for j in 0..M {
            left[k][j] /= pivot;
            right[k][j] /= pivot;
        }
        for i in (0..M).filter(|&i| i != k) {
            let share = left[i][k];
            for j in 0..M {
                left[i][j] -= share * left[k][j];
                right[i][j] -= share * right[k][j];
            }
        }
    }
    right.iter().flatten().all(|x| x.is_finite()).then_some(right)
}
