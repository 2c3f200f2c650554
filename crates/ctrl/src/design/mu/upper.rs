//! Upper bound of μ: the generalised eigenvalue problem of the D-G scalings, solved to the end by following its central path.
//!
//! For each t = β² that the inequality admits there is one point that is farthest from all its borders, the centre. Newton's method finds
//! it; the tangent of the path of centres predicts the next one at a smaller t; the distance to the smallest t is known at a centre from
//! its multipliers. The result does not rest on any of this: the scalings reached are checked by [`Certificate::holds`], with rounding.

use alloc::vec::Vec;

use nalgebra::{Cholesky, Complex, DVector};

use super::balance::{Balanced, balance};
use super::certificate::Certificate;
use super::lmi::{Lmi, Local};
use super::structure::Structure;
use super::{CMatrix, MuError};

/// Newton steps at most, whatever happens; typically 25 to 40 are used.
const STEPS: usize = 200;

/// The path is left when the remaining distance is below this share of t = β².
const GAP: f64 = 3.0e-7;

/// The path is left as well when t has fallen to this share of where it began: the bound is then negligible beside σ(M), and below it
/// rounding leaves nothing to prove.
const NEGLIGIBLE: f64 = 1.0e-11;

/// Newton decrement below which a point counts as central enough to go on, and to believe in the distance to the end.
const CENTRAL: f64 = 1.3;
const CLOSE: f64 = 0.6;

/// Upper bound of μ with its proof.
#[derive(Debug, Clone, PartialEq)]
pub struct UpperBound {
    /// Proof of the bound; its `beta` is the bound.
    pub certificate: Certificate,
    /// How the iterations ended; the bound is proved either way.
    pub status: UpperStatus,
    /// Newton steps taken.
    pub steps: usize,
    /// Leading directions of the multipliers, in balanced coordinates of w, best first: where the worst perturbation acts.
    pub(crate) directions: CMatrix,
}

/// How the iterations of an upper bound ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UpperStatus {
    /// No better D-G scalings exist, up to 1e-7 of the bound or 1e-5 of σ(M).
    Optimal,
    /// The limit of iterations or of arithmetic was reached first: the bound is proved but may not be the best.
    Stopped,
}

/// Smallest β that D-G scalings prove, with the scalings.
///
/// # Errors
/// A matrix that does not fit the structure or holds what is no number.
pub fn upper_bound(M: &CMatrix, structure: &Structure) -> Result<UpperBound, MuError> {
    structure.check(M)?;
    let balanced = balance(M, &structure.placed());
    let lmi = Lmi::new(balanced.M.clone(), structure);
    let x = lmi.start();
    let t = start_t(&lmi, &x);
    let end = follow(&lmi, x, t, 0.0);
    let certificate = prove(M, structure, &balanced, (&lmi, &end));
    Ok(UpperBound { certificate, status: end.status, steps: end.steps, directions: directions(&end) })
}

/// Scalings that prove the bound `beta` with room to spare (the centre of all that do), or none when there are none.
///
/// # Errors
/// A matrix that does not fit the structure or holds what is no number.
pub fn scalings_for(M: &CMatrix, structure: &Structure, beta: f64) -> Result<Option<Certificate>, MuError> {
    structure.check(M)?;
    let balanced = balance(M, &structure.placed());
    let lmi = Lmi::new(balanced.M.clone(), structure);
    let goal = (beta / balanced.size) * (beta / balanced.size);
    let x = lmi.start();
    let t = start_t(&lmi, &x).max(goal);
    let end = follow(&lmi, x, t, goal);
    if end.t > goal {
        return Ok(None);
    }
    let certificate = unbalance(&balanced, structure, &lmi, &end.x, beta);
    Ok(certificate.holds(M, structure).then_some(certificate))
}

/// Where the path was left.
pub(crate) struct End {
    pub(crate) x: DVector<f64>,
    pub(crate) t: f64,
    status: UpperStatus,
    steps: usize,
    P: CMatrix,
    /// Centres passed, with their t.
    path: Vec<(DVector<f64>, f64)>,
}

/// A t at which `x` (G = 0) is feasible, not far above the smallest.
fn start_t(lmi: &Lmi, x: &DVector<f64>) -> f64 {
    let frobenius: f64 = lmi.M.iter().map(|m| m.norm_sqr()).sum();
    // After balancing and scaling the sum of squares is between 1 and the number of entries, or 0.
    let mut t = 0.3 * frobenius + 1e-6;
    while lmi.barrier(x, t).is_none() && t.is_finite() {
        t *= 1.5;
    }
    t * 1.2
}

/// Follows the path from the feasible (x, t) down to the smallest t, or to `goal` and its centre.
pub(crate) fn follow(lmi: &Lmi, mut x: DVector<f64>, mut t: f64, goal: f64) -> End {
    let n = lmi.M.ncols();
    let mut end = End { x: x.clone(), t, status: UpperStatus::Stopped, steps: 0, P: CMatrix::identity(n, n), path: Vec::new() };
    let negligible = NEGLIGIBLE * t;
    let mut last: Option<(f64, f64)> = None;
    for step in 1..=STEPS {
        let Some(local) = lmi.local(&x, t) else { break };
        let Some(equations) = Newton::new(&local) else { break };
        let newton = equations.minus_solve(&local.gradient);
        let decrement = (-local.gradient.dot(&newton)).max(0.0).sqrt();
        (end.x, end.t, end.steps, end.P) = (x.clone(), t, step, local.P.clone());
        let is_central = decrement < CENTRAL;
        let is_at_goal = t <= goal;
        let is_near_end = local.gap <= GAP * t || t <= negligible;
        if is_near_end && decrement < CLOSE || is_at_goal && decrement < 0.1 {
            end.status = UpperStatus::Optimal;
            break;
        }
        if is_central && !is_at_goal && !is_near_end {
            end.path.push((x.clone(), t));
            let tangent = equations.minus_solve(&local.gradient_t);
            // The gap is a bound; from one centre to the next it shrinks in proportion, which tells how far off it is.
            let off = last.map_or(1.0, |(t_0, gap_0)| ((t_0 - t) / (gap_0 - local.gap)).clamp(0.1, 1.0));
            last = Some((t, local.gap));
            if let Some((next, t_next)) = predict(lmi, (&x, t), (&newton, &tangent), t - (t - 0.95 * off * local.gap).max(goal)) {
                (x, t) = (next, t_next);
                continue;
            }
        }
        match centre(lmi, &x, t, (&newton, decrement)) {
            Some(next) => x = next,
            None => break,
        }
    }
    end
}

/// Newton's equations, scaled to a unit diagonal.
struct Newton {
    factor: Cholesky<f64, nalgebra::Dyn>,
    scale: DVector<f64>,
}

impl Newton {
    fn new(local: &Local) -> Option<Self> {
        let H = &local.hessian;
        let scale = DVector::from_iterator(H.nrows(), H.diagonal().iter().map(|h| 1.0 / h.sqrt()));
        // A touch of regularisation where rounding near the end of the path needs it.
        [0.0, 1e-14, 1e-12, 1e-10].iter().find_map(|add| {
            let scaled =
                nalgebra::DMatrix::from_fn(H.nrows(), H.ncols(), |i, j| H[(i, j)] * scale[i] * scale[j] + if i == j { *add } else { 0.0 });
            Some(Self { factor: Cholesky::new(scaled)?, scale: scale.clone() })
        })
    }

    /// Minus the solution for the right-hand side.
    fn minus_solve(&self, right: &DVector<f64>) -> DVector<f64> {
        -self.factor.solve(&right.component_mul(&self.scale)).component_mul(&self.scale)
    }
}

/// The longest of a few steps along the tangent that stays inside; `drop` is the wanted decrease of t.
fn predict(
    lmi: &Lmi,
    (x, t): (&DVector<f64>, f64),
    (newton, tangent): (&DVector<f64>, &DVector<f64>),
    drop: f64,
) -> Option<(DVector<f64>, f64)> {
    let mut share = 1.0;
    for _ in 0..14 {
        let at = |s: f64| x + newton - tangent * (drop * s);
        if lmi.barrier(&at(share), t - drop * share).is_some() {
            // Landing on the border would cost the way back to the middle.
            let backed = if share < 1.0 { 0.9 * share } else { 1.0 };
            let (y, t_y) = (at(backed), t - drop * backed);
            return lmi.barrier(&y, t_y).map(|_| (y, t_y));
        }
        share *= 0.75;
    }
    None
}

/// A Newton step that lowers the barrier at fixed t; none when rounding leaves no descent.
fn centre(lmi: &Lmi, x: &DVector<f64>, t: f64, (newton, decrement): (&DVector<f64>, f64)) -> Option<DVector<f64>> {
    let before = lmi.barrier(x, t)?;
    let mut size = 1.0;
    for _ in 0..40 {
        let y = x + newton * size;
        if lmi.barrier(&y, t).is_some_and(|value| value <= before - 0.1 * size * decrement * decrement + 1e-9 * before.abs()) {
            return Some(y);
        }
        size *= 0.6;
    }
    None
}

/// Back to the scale of M.
fn unbalance(balanced: &Balanced, structure: &Structure, lmi: &Lmi, x: &DVector<f64>, beta: f64) -> Certificate {
    let (mut d_w, mut d_z, mut g) = lmi.matrices(x);
    for (p, &s) in structure.placed().iter().zip(&balanced.scales) {
        let square = Complex::new(s * s, 0.0);
        let (w, z, m, n) = (p.w.start, p.z.start, p.w.len(), p.z.len());
        d_w.view_mut((w, w), (m, m)).iter_mut().for_each(|d| *d *= square);
        d_z.view_mut((z, z), (n, n)).iter_mut().for_each(|d| *d *= square);
        g.view_mut((w, z), (m, n)).iter_mut().for_each(|d| *d *= square * balanced.size);
    }
    Certificate { beta, d_w, d_z, g }
}

/// The smallest β near the end of the path that can be proved with its scalings.
fn prove(M: &CMatrix, structure: &Structure, balanced: &Balanced, (lmi, end): (&Lmi, &End)) -> Certificate {
    let zero = unbalance(balanced, structure, lmi, &end.x, 0.0);
    if zero.holds(M, structure) {
        return zero;
    }
    // The last point, or the last one before rounding took over.
    let points = core::iter::once((&end.x, end.t)).chain(end.path.iter().rev().map(|(x, t)| (x, *t)));
    for (x, t) in points {
        let mut certificate = unbalance(balanced, structure, lmi, x, 0.0);
        let beta = t.max(0.0).sqrt() * balanced.size;
        for slack in [1e-13, 1e-11, 1e-9, 1e-8, 1e-7, 1e-6] {
            certificate.beta = beta * (1.0 + slack);
            if certificate.holds(M, structure) {
                return certificate;
            }
        }
    }
    plain(M, structure)
}

/// Proof by the norm of M alone: D = I, G = 0. What is left when nothing else can be proved.
fn plain(M: &CMatrix, structure: &Structure) -> Certificate {
    let (n_w, n_z) = (structure.n_w(), structure.n_z());
    let norm = M.iter().map(|m| m.norm_sqr()).sum::<f64>().sqrt();
    let (d_w, d_z) = (CMatrix::identity(n_w, n_w), CMatrix::identity(n_z, n_z));
    let mut certificate = Certificate { beta: norm * (1.0 + 1e-12), d_w, d_z, g: CMatrix::zeros(n_w, n_z) };
    while !certificate.holds(M, structure) && certificate.beta.is_finite() {
        certificate.beta = certificate.beta * (1.0 + 1e-9) + f64::MIN_POSITIVE;
    }
    certificate
}

/// Eigenvectors of the multiplier F⁻¹, largest first, in balanced coordinates.
fn directions(end: &End) -> CMatrix {
    let eigen = end.P.clone().symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    CMatrix::from_fn(order.len(), order.len(), |i, j| eigen.eigenvectors[(i, order[j])])
}
