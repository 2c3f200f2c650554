//! Ascent: the perturbation moves within its bounds so that a real eigenvalue of Q·M grows.
//!
//! A real λ > 0 in the spectrum of Q·M with |Q| ≤ 1 shows μ(M) ≥ λ, since Δ = Q/λ makes I − M·Δ singular. First-order changes of λ under
//! every real number in Q (parameters, phases, directions of full blocks) and, for a frequency response, under the frequency are known
//! from its left and right eigenvectors. Each step maximises the real part's linear model less a damping term, keeps the imaginary part
//! at zero and every parameter in [−1, 1]: a small quadratic program with one equality, solved by bisection on its multiplier.

use alloc::vec::Vec;

use nalgebra::{Complex, DVector};

use super::CMatrix;
use super::perturbation::{Part, apply, normalised, unit};
use super::response::Response;
use super::structure::Placed;

/// Steps at most.
const STEPS: usize = 150;

/// A relative gain below this ends the ascent.
const GAIN: f64 = 1.0e-10;

/// Where a search stands.
#[derive(Debug, Clone)]
pub(crate) struct Climber {
    pub(crate) parts: Vec<Part>,
    /// Frequency, where there is one.
    pub(crate) w: f64,
    /// Eigenvalue of Q·M(w).
    pub(crate) lambda: Complex<f64>,
    x: DVector<Complex<f64>>,
    y: DVector<Complex<f64>>,
}

/// Where a climber may go.
pub(crate) struct Ground<'a> {
    pub(crate) placed: &'a [Placed],
    pub(crate) response: &'a dyn Response,
    /// Frequencies it may use; equal for a fixed one.
    pub(crate) range: [f64; 2],
}

impl Climber {
    /// Begins at the most promising eigenvalue of Q·M(w); none when the eigenvalues cannot be computed.
    pub(crate) fn start(ground: &Ground<'_>, mut parts: Vec<Part>, w: f64) -> Option<Self> {
        let M = ground.response.at(w)?;
        let all = eigenvalues(&apply(&parts, ground.placed, &M));
        let has_real = parts.iter().any(|p| matches!(p, Part::Real(_)));
        // Without real blocks any phase can be turned away.
        let score = |l: &Complex<f64>| if has_real { l.re - 0.5 * l.im.abs() } else { l.norm_sqr() };
        let lambda = all.into_iter().max_by(|a, b| score(a).total_cmp(&score(b)))?;
        if !has_real {
            let back = unit(lambda).conj();
            for part in &mut parts {
                match part {
                    Part::Phase(q) => *q *= back,
                    Part::Pair(u, _) => u.iter_mut().for_each(|v| *v *= back),
                    Part::Real(_) => {}
                }
            }
        }
        let lambda = if has_real { lambda } else { Complex::new(lambda.norm_sqr().sqrt(), 0.0) };
        let n = M.ncols();
        let seed = DVector::from_fn(n, |i, _| Complex::new(1.0, 0.1 * i as f64));
        let mut climber = Self { parts, w, lambda, x: normalised(seed.clone()), y: normalised(seed) };
        climber.settle(&apply(&climber.parts, ground.placed, &M), 4).then_some(climber)
    }

    /// Inverse iteration for the eigenvalue nearest to the last one, with both eigenvectors.
    fn settle(&mut self, A: &CMatrix, rounds: usize) -> bool {
        let n = A.nrows();
        let size = A.iter().map(|a| a.norm_sqr()).sum::<f64>().sqrt();
        for _ in 0..rounds {
            // Off the eigenvalue by rounding, so that the solve stays finite.
            let shift = self.lambda + Complex::new(size * 1e-14 + f64::MIN_POSITIVE, size * 1e-14);
            let B = A - CMatrix::identity(n, n) * shift;
            let Some(x) = B.clone().lu().solve(&self.x) else { return false };
            let Some(y) = B.adjoint().lu().solve(&self.y) else { return false };
            (self.x, self.y) = (normalised(x), normalised(y));
            let across = self.y.dotc(&self.x);
            let lambda = self.y.dotc(&(A * &self.x)) / across;
            if !(lambda.re.is_finite() && lambda.im.is_finite()) {
                return false;
            }
            let moved = (lambda - self.lambda).norm_sqr();
            self.lambda = lambda;
            if moved <= 1e-28 * size * size {
                break;
            }
        }
        let residual = A * &self.x - &self.x * self.lambda;
        residual.norm_squared() <= 1e-20 * size * size
    }

    /// Climbs to a local maximum.
    pub(crate) fn climb(mut self, ground: &Ground<'_>) -> Self {
        let mut damping = 1.0;
        let mut slow = 0;
        for _ in 0..STEPS {
            self.align(ground);
            let Some(moves) = self.moves(ground) else { break };
            let size = self.lambda.norm_sqr().sqrt();
            // Of real problems the imaginary part is rounding, and no constraint.
            let is_real = self.lambda.im.abs() < 1e-13 * size && moves.iter().all(|m| m.slope.im.abs() * m.scale < 1e-12 * size);
            let (d, multiplier) = if is_real { (free(&moves, damping * size), 0.0) } else { step(&moves, damping * size, self.lambda.im) };
            let mut next = self.clone();
            next.take(&moves, &d, ground);
            let is_settled = ground.response.at(next.w).is_some_and(|M| next.settle(&apply(&next.parts, ground.placed, &M), 6));
            let penalty = 2.0 * multiplier.abs() + 0.1;
            let gain = next.lambda.re - self.lambda.re - penalty * (next.lambda.im.abs() - self.lambda.im.abs());
            let expected: f64 = moves.iter().zip(&d).map(|(m, d)| m.slope.re * d).sum::<f64>() + penalty * self.lambda.im.abs();
            if is_settled && gain > 0.05 * expected.max(0.0) && gain > 0.0 {
                slow = if gain < GAIN * size && next.lambda.im.abs() < 1e-12 * size { slow + 1 } else { 0 };
                self = next;
                damping = (damping * 0.4_f64).max(1e-6);
                if slow >= 2 {
                    break;
                }
            } else {
                damping *= 4.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
        self
    }

    /// Turns the right side of every full block along what reaches it; λ and its right eigenvector stay as they are.
    fn align(&mut self, ground: &Ground<'_>) {
        let Some(M) = ground.response.at(self.w) else { return };
        let z = &M * &self.x;
        for (part, p) in self.parts.iter_mut().zip(ground.placed) {
            if let Part::Pair(u, v) = part {
                let z_k = z.rows(p.z.start, p.z.len()).into_owned();
                let phase = unit(v.dotc(&z_k));
                *v = normalised(z_k);
                u.iter_mut().for_each(|a| *a *= phase);
            }
        }
        let mut aligned = self.clone();
        if aligned.settle(&apply(&self.parts, ground.placed, &M), 4) {
            *self = aligned;
        }
    }

    /// Every real number that can be changed, with what it does to λ.
    fn moves(&self, ground: &Ground<'_>) -> Option<Vec<Move>> {
        let M = ground.response.at(self.w)?;
        let z = &M * &self.x;
        let across = self.y.dotc(&self.x);
        let mut out = Vec::new();
        let j = Complex::new(0.0, 1.0);
        for (block, (part, p)) in self.parts.iter().zip(ground.placed).enumerate() {
            // dλ = a*·dQ·z.
            let a = self.y.rows(p.w.start, p.w.len()) / across.conj();
            let z_k = z.rows(p.z.start, p.z.len());
            let mut push = |what, slope, room| out.push(Move { block, what, slope, room, scale: 1.0 });
            match part {
                Part::Real(q) => push(What::Value, a.dotc(&z_k), [-1.0 - q, 1.0 - q]),
                Part::Phase(q) => push(What::Phase, a.dotc(&z_k) * q * j, [-0.7, 0.7]),
                Part::Pair(u, v) => {
                    let length = v.dotc(&z_k);
                    push(What::Phase, a.dotc(u) * length * j, [-0.7, 0.7]);
                    let across = &a - u * u.dotc(&a);
                    let size = across.norm_squared().sqrt();
                    if size > 0.0 {
                        let side = &across / Complex::new(size, 0.0);
                        let slope = length * size;
                        push(What::Along(side.clone()), slope, [-0.7, 0.7]);
                        push(What::Along(side * j), slope * j, [-0.7, 0.7]);
                    }
                }
            }
        }
        if ground.range[1] > ground.range[0] {
            let dM = ground.response.slope(self.w)?;
            let slope = self.y.dotc(&(apply(&self.parts, ground.placed, &dM) * &self.x)) / across;
            let size = slope.norm_sqr().sqrt();
            if size > 0.0 {
                let scale = self.lambda.norm_sqr().sqrt() / size;
                let fifth = 0.2 * self.w;
                let room = [(ground.range[0] - self.w).max(-fifth).min(0.0), (ground.range[1] - self.w).min(fifth).max(0.0)];
                out.push(Move { block: 0, what: What::Frequency, slope, room, scale });
            }
        }
        Some(out)
    }

    fn take(&mut self, moves: &[Move], d: &[f64], ground: &Ground<'_>) {
        for (m, &d) in moves.iter().zip(d) {
            let turn = || {
                let (s, c) = pkm_dyn::math::sin_cos(d);
                Complex::new(c, s)
            };
            match (&m.what, &mut self.parts[m.block]) {
                (What::Frequency, _) => self.w = (self.w + d).clamp(ground.range[0], ground.range[1]),
                (What::Value, Part::Real(q)) => *q = (*q + d).clamp(-1.0, 1.0),
                (What::Phase, Part::Phase(q)) => *q = unit(*q * turn()),
                (What::Phase, Part::Pair(u, _)) => u.iter_mut().for_each(|x| *x *= turn()),
                (What::Along(side), Part::Pair(u, _)) => *u = normalised(&*u + side * Complex::new(d, 0.0)),
                _ => {}
            }
        }
    }
}

/// A real number of the perturbation that can be changed.
struct Move {
    block: usize,
    what: What,
    /// Derivative of λ.
    slope: Complex<f64>,
    /// Smallest and largest change.
    room: [f64; 2],
    /// Natural size of a change.
    scale: f64,
}

enum What {
    Value,
    Phase,
    Along(DVector<Complex<f64>>),
    Frequency,
}

/// Changes without the equality.
fn free(moves: &[Move], damping: f64) -> Vec<f64> {
    moves.iter().map(|m| (m.slope.re * m.scale * m.scale / damping).clamp(m.room[0], m.room[1])).collect()
}

/// Changes d that maximise Σ re·d − damping/2·Σ (d/scale)² with Σ im·d = −`imaginary`, within the room; and the multiplier.
fn step(moves: &[Move], damping: f64, imaginary: f64) -> (Vec<f64>, f64) {
    let at = |nu: f64| -> (Vec<f64>, f64) {
        let one = |m: &Move| ((m.slope.re + nu * m.slope.im) * m.scale * m.scale / damping).clamp(m.room[0], m.room[1]);
        let d: Vec<f64> = moves.iter().map(one).collect();
        let sum = moves.iter().zip(&d).map(|(m, d)| m.slope.im * d).sum::<f64>();
        (d, sum + imaginary)
    };
    let (mut low, mut high) = (-1.0, 1.0);
    // The sum grows with the multiplier: first bracket its zero, then halve. A multiplier beyond a thousand would trade everything for
    // an imaginary part that hardly moves.
    for _ in 0..10 {
        if at(low).1 <= 0.0 {
            break;
        }
        low *= 2.0;
    }
    for _ in 0..10 {
        if at(high).1 >= 0.0 {
            break;
        }
        high *= 2.0;
    }
    for _ in 0..70 {
        let middle = 0.5 * (low + high);
        if at(middle).1 < 0.0 { low = middle } else { high = middle }
    }
    (at(high).0, high)
}

/// Eigenvalues of a square complex matrix; empty when they cannot be computed.
pub(crate) fn eigenvalues(A: &CMatrix) -> Vec<Complex<f64>> {
    let copy = faer::Mat::from_fn(A.nrows(), A.ncols(), |i, j| A[(i, j)]);
    copy.eigenvalues().unwrap_or_default()
}
