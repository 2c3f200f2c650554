//! How far one pair of scalings proves a level: an eigenvalue test that covers every frequency of an interval at once.
//!
//! With D, G and β frozen, `Φ(jw) = β²·D_w − M(jw)*·D_z·M(jw) − j·(G·M(jw) − M(jw)*·G)` can lose positive definiteness only at a frequency
//! where it is singular, and those are the imaginary eigenvalues of one Hamiltonian matrix [Boyd1989;
//! Ferreres2003 for D and G]. Eigenvalues anywhere near the axis count as suspects and are examined one by one, so rounding can shorten an
//! interval but not lengthen it. This is floating-point arithmetic with wide tolerances, not a proof in the sense of
//! [`Certificate::holds`](super::Certificate::holds).

use alloc::vec::Vec;

use nalgebra::Complex;

use super::CMatrix;
use super::ascent::eigenvalues;
use super::balance::balance_square;
use super::certificate::Certificate;
use super::hermitian::cholesky;
use super::response::Response;
use super::system::{StateSpace, complex};

/// An eigenvalue is suspected of lying on the axis within this share of its own size …
const NEAR_OWN: f64 = 1.0e-5;
/// … plus this share of the largest.
const NEAR_ALL: f64 = 1.0e-9;

/// A continuous system with constants of the test at hand.
pub(crate) struct Prover<'a> {
    pub(crate) system: &'a StateSpace,
    A: CMatrix,
    B: CMatrix,
    C: CMatrix,
    D: CMatrix,
    /// Imaginary parts of the poles.
    resonances: Vec<f64>,
}

impl<'a> Prover<'a> {
    pub(crate) fn new(system: &'a StateSpace) -> Self {
        let [a, b, c, d] = system.matrices();
        let resonances = system.poles().iter().map(|p| p.im).filter(|w| *w > 0.0).collect();
        Self { system, A: complex(a), B: complex(b), C: complex(c), D: complex(d), resonances }
    }

    /// The largest interval found around `w` on which the scalings prove their level; none when they do not prove it at `w`.
    pub(crate) fn interval(&self, proof: &Certificate, w: f64) -> Option<[f64; 2]> {
        if !self.is_proved_at(proof, w) {
            return None;
        }
        if self.A.nrows() == 0 {
            return Some([0.0, f64::INFINITY]);
        }
        let Some(suspects) = self.suspects(proof) else { return Some([w, w]) };
        let below: Vec<f64> = suspects.iter().copied().filter(|s| *s < w).rev().chain([0.0]).collect();
        let above: Vec<f64> = suspects.iter().copied().filter(|s| *s > w).chain([f64::INFINITY]).collect();
        let [mut low, mut high] = [self.reach(proof, w, &below), self.reach(proof, w, &above)];
        // A crossing that the eigenvalues missed would be a mistake of theirs; resonances and a few points between are looked at as well.
        for s in self.samples(w, [low, high]) {
            if !self.is_proved_at(proof, s) {
                if s < w { low = low.max(between(s, w)) } else { high = high.min(between(w, s)) }
            }
        }
        Some([low, high])
    }

    /// Resonances and a few frequencies between the ends of an interval around `w`.
    fn samples(&self, w: f64, [low, high]: [f64; 2]) -> Vec<f64> {
        let mut out: Vec<f64> = self.resonances.iter().copied().filter(|s| *s > low && *s < high).collect();
        for end in [low, high] {
            let mut s = end;
            for _ in 0..4 {
                s = between(s, w);
                out.push(s);
            }
        }
        out
    }

    /// Whether the inequality holds at one frequency, infinity included.
    fn is_proved_at(&self, proof: &Certificate, w: f64) -> bool {
        self.system.at(w).is_some_and(|M| cholesky(&inequality(proof, &M)).is_some())
    }

    /// Walks from `w` over the suspects in turn, as far as all of them and the stretches between turn out harmless.
    fn reach(&self, proof: &Certificate, w: f64, suspects: &[f64]) -> f64 {
        let mut proved = w;
        for &suspect in suspects {
            if self.is_proved_at(proof, suspect) && self.is_proved_at(proof, between(proved, suspect)) {
                proved = suspect;
                continue;
            }
            // A true crossing: stop short of it, by more where rounding blurs it. One at infinity may lie anywhere beyond the last suspect.
            for share in [1e-9, 1e-7, 1e-5, 1e-3, 1e-2, 0.1, 0.3, 0.6] {
                let stop = suspect + share * (proved - suspect);
                if suspect.is_finite() && self.is_proved_at(proof, stop) && self.is_proved_at(proof, between(proved, stop)) {
                    return stop;
                }
            }
            return proved;
        }
        proved
    }

    /// Frequencies at which the inequality may be singular, in order; none when the test cannot be made.
    fn suspects(&self, proof: &Certificate) -> Option<Vec<f64>> {
        let H = self.hamiltonian(proof)?;
        let all = eigenvalues(&H);
        if all.is_empty() || all.iter().any(|l| !(l.re.is_finite() && l.im.is_finite())) {
            return None;
        }
        let size = |l: &Complex<f64>| l.norm_sqr().sqrt();
        let largest = all.iter().map(size).fold(0.0, f64::max);
        let is_near = |l: &&Complex<f64>| l.re.abs() <= NEAR_OWN * size(l) + NEAR_ALL * largest;
        // Real M(-jw) is the conjugate of M(jw), but D and G are not real: only positive frequencies are asked for. One that rounding
        // has put just below zero is asked for as well.
        let is_asked = |w: &f64| *w > -(NEAR_ALL * largest);
        let mut out: Vec<f64> = all.iter().filter(is_near).map(|l| l.im).filter(is_asked).map(f64::abs).collect();
        out.sort_by(f64::total_cmp);
        Some(out)
    }

    /// Hamiltonian matrix of Φ, balanced; none when Φ(∞) is singular.
    fn hamiltonian(&self, proof: &Certificate) -> Option<CMatrix> {
        let n = self.A.nrows();
        let j = Complex::new(0.0, 1.0);
        let Q = -(self.C.adjoint() * &proof.d_z * &self.C);
        let cross = -(&proof.d_z * &self.D) + proof.g.adjoint() * j;
        let S = self.C.adjoint() * cross;
        let R = inequality(proof, &self.D);
        let lu = R.lu();
        let RS = lu.solve(&S.adjoint())?;
        let RB = lu.solve(&self.B.adjoint())?;
        let F = &self.A - &self.B * &RS;
        let mut H = CMatrix::zeros(2 * n, 2 * n);
        H.view_mut((0, 0), (n, n)).copy_from(&F);
        H.view_mut((0, n), (n, n)).copy_from(&-(&self.B * &RB));
        H.view_mut((n, 0), (n, n)).copy_from(&-(Q - &S * &RS));
        H.view_mut((n, n), (n, n)).copy_from(&-F.adjoint());
        if H.iter().any(|h| !(h.re.is_finite() && h.im.is_finite())) {
            return None;
        }
        balance_square(&mut H);
        Some(H)
    }
}

/// Middle of two frequencies, geometric where possible.
pub(crate) fn between(a: f64, b: f64) -> f64 {
    let (low, high) = (a.min(b), a.max(b));
    if !high.is_finite() {
        2.0 * low + 1.0
    } else if low > 0.0 {
        (low * high).sqrt()
    } else {
        0.5 * (low + high)
    }
}

/// `β²·D_w − M*·D_z·M − j·(G·M − M*·G)`.
fn inequality(proof: &Certificate, M: &CMatrix) -> CMatrix {
    let skew = &proof.g * M;
    let j = Complex::new(0.0, 1.0);
    &proof.d_w * Complex::new(proof.beta * proof.beta, 0.0) - M.adjoint() * (&proof.d_z * M) - (&skew - skew.adjoint()) * j
}
