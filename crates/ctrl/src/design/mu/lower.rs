//! Lower bound of μ: the best perturbation found, and verified, from several starts.

use alloc::vec::Vec;

use nalgebra::{Complex, DVector};

use super::ascent::{Climber, Ground};
use super::balance::{balance, rescale};
use super::perturbation::{Part, Perturbation, SINGULAR, sending};
use super::power::power_iteration;
use super::response::{Constant, Response};
use super::structure::{Placed, Structure};
use super::upper::UpperBound;
use super::{CMatrix, MuError};

/// Lower bound of μ with the perturbation that shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct LowerBound {
    /// The bound, 0 when no perturbation was found.
    pub beta: f64,
    /// The perturbation, verified on M.
    pub perturbation: Option<Perturbation>,
    /// Frequency at which it acts; that of the start for a single matrix.
    pub w: f64,
}

/// How hard to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effort {
    /// The multipliers of the upper bound and their power iterations.
    Quick,
    /// Other directions and vertices of the real parameters as well.
    Full,
}

/// Vertices of the real parameters tried when there are no more than this many of them; otherwise as many drawn.
const VERTICES: usize = 32;

/// A lower bound this close to the upper one, relatively, needs no further search.
const CLOSE: f64 = 1.0e-7;

/// Best lower bound of μ of one matrix. `upper` guides the search: where its scalings are exact, their multiplier is the answer.
///
/// # Errors
/// A matrix that does not fit the structure or holds what is no number.
pub fn lower_bound(M: &CMatrix, structure: &Structure, upper: &UpperBound) -> Result<LowerBound, MuError> {
    structure.check(M)?;
    let response = Constant(M.clone());
    let placed = structure.placed();
    let ground = Ground { placed: &placed, response: &response, range: [0.0, 0.0] };
    Ok(search(&ground, structure, (M, 0.0), upper, Effort::Full))
}

/// A response in balanced coordinates. Perturbations are the same in both: a block's rows and columns take the same factor.
struct Rescaled<'a> {
    inner: &'a dyn Response,
    placed: &'a [Placed],
    scales: &'a [f64],
}

impl Rescaled<'_> {
    fn rescale(&self, M: Option<CMatrix>) -> Option<CMatrix> {
        M.map(|mut M| {
            rescale(&mut M, self.placed, self.scales);
            M
        })
    }
}

impl Response for Rescaled<'_> {
    fn at(&self, w: f64) -> Option<CMatrix> {
        self.rescale(self.inner.at(w))
    }

    fn slope(&self, w: f64) -> Option<CMatrix> {
        self.rescale(self.inner.slope(w))
    }
}

/// The search from a frequency `w`, where the response is `M` and its upper bound is known.
///
/// It is done in balanced coordinates, and so is the check of what it finds: how singular a matrix is depends on its scaling.
pub(crate) fn search(
    ground: &Ground<'_>,
    structure: &Structure,
    (M, w): (&CMatrix, f64),
    upper: &UpperBound,
    effort: Effort,
) -> LowerBound {
    let scales = balance(M, ground.placed).scales;
    let response = Rescaled { inner: ground.response, placed: ground.placed, scales: &scales };
    let ground = &Ground { placed: ground.placed, response: &response, range: ground.range };
    let mut M = M.clone();
    rescale(&mut M, ground.placed, &scales);
    let M = &M;
    let beta = upper.certificate.beta;
    let mut best = LowerBound { beta: 0.0, perturbation: None, w };
    let mut best_parts: Option<Vec<Part>> = None;
    if beta <= 0.0 {
        return best;
    }
    let is_fixed = ground.range[0] >= ground.range[1];
    let mut attempt = |parts: Vec<Part>| -> bool {
        if let Some(climber) = Climber::start(ground, parts, w) {
            let end = climber.climb(ground);
            if let Some(found) = verified(ground.response, structure, &end)
                && found.beta > best.beta
            {
                best_parts = Some(end.parts);
                best = found;
            }
        }
        is_fixed && best.beta >= beta * (1.0 - CLOSE)
    };
    let all = starts(M, ground.placed, upper);
    let complex = all[0].clone();
    let few = if effort == Effort::Quick { 4 } else { all.len() };
    for parts in all.into_iter().take(few) {
        if attempt(parts) {
            return best;
        }
    }
    let reals: Vec<usize> = (0..ground.placed.len()).filter(|&k| ground.placed[k].block.is_real()).collect();
    if !reals.is_empty() && effort == Effort::Full {
        for signs in vertices(reals.len()) {
            let mut parts = complex.clone();
            reals.iter().zip(&signs).for_each(|(&k, &s)| parts[k] = Part::Real(s));
            if attempt(parts) {
                return best;
            }
        }
    }
    best
}

/// Divides by the eigenvalue, and believes nothing that does not make I − M·Δ singular.
pub(crate) fn verified(response: &dyn Response, structure: &Structure, climber: &Climber) -> Option<LowerBound> {
    let lambda = climber.lambda.re;
    if !(lambda > 0.0 && lambda.is_finite()) {
        return None;
    }
    let M = response.at(climber.w)?;
    let values = climber.parts.iter().map(|p| p.value(lambda)).collect();
    let perturbation = Perturbation::measured(&M, structure, values);
    let is_singular = perturbation.singularity <= SINGULAR && perturbation.size > 0.0;
    is_singular.then(|| LowerBound { beta: 1.0 / perturbation.size, perturbation: Some(perturbation), w: climber.w })
}

/// Starts: the multipliers of the upper bound, as they are and after power iteration, and the direction M amplifies most.
fn starts(M: &CMatrix, placed: &[Placed], upper: &UpperBound) -> Vec<Vec<Part>> {
    let n = M.ncols();
    let beta = upper.certificate.beta;
    let column = |k: usize| upper.directions.column(k).into_owned();
    let direct = |b: &DVector<Complex<f64>>| -> Vec<Part> {
        let z = M * b;
        let part =
            |p: &Placed| sending(p.block, &z.rows(p.z.start, p.z.len()).into_owned(), &b.rows(p.w.start, p.w.len()).into_owned(), beta);
        placed.iter().map(part).collect()
    };
    let mut out = alloc::vec![direct(&column(0)), power_iteration(M, placed, column(0))];
    if n > 1 {
        let sum = column(0) + column(1);
        let turned = column(0) + column(1) * Complex::new(0.0, 1.0);
        out.extend([power_iteration(M, placed, sum.clone()), direct(&column(1)), direct(&sum), direct(&turned)]);
        out.extend([power_iteration(M, placed, column(1)), power_iteration(M, placed, turned)]);
    }
    out.push(power_iteration(M, placed, DVector::from_fn(n, |i, _| Complex::new(1.0, 0.3 * i as f64))));
    out
}

/// All sign patterns of a few numbers, or as many drawn by a fixed generator.
fn vertices(n: usize) -> Vec<Vec<f64>> {
    let sign = |bit: bool| if bit { 1.0 } else { -1.0 };
    if n < 6 && 1 << n <= VERTICES {
        return (0..1_u32 << n).map(|code| (0..n).map(|k| sign(code >> k & 1 == 1)).collect()).collect();
    }
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut draw = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        sign(state >> 32 & 1 == 1)
    };
    (0..VERTICES).map(|_| (0..n).map(|_| draw()).collect()).collect()
}
