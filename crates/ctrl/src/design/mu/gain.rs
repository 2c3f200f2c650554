//! Worst-case gain: how much the uncertainty, within its stated size, can raise the gain from disturbances to errors.
//!
//! By the main loop theorem [Packard1993, theorem 4.3] the gain stays below γ for every |Δ| ≤ 1 if and only if μ of M with its
//! error outputs divided by γ, and with a full block from errors to disturbances beside the uncertainty, stays below one.

use alloc::vec::Vec;

use nalgebra::Complex;

use super::perturbation::{Perturbation, Value, largest_singular_value};
use super::response::Response;
use super::structure::Structure;
use super::sweep::{Guarantee, Settings, Sweep, sweep};
use super::system::StateSpace;
use super::{Block, CMatrix, MuError};

/// The bounds are brought this close to each other, relatively, where mu's own bounds allow it.
const CLOSE: f64 = 1.0e-3;

/// Sweeps at most.
const SWEEPS: usize = 40;

/// Channels of a system that are no uncertainty: its last inputs and outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Performance {
    /// Disturbances: last inputs.
    pub inputs: usize,
    /// Errors: last outputs.
    pub outputs: usize,
}

/// Bounds of the worst-case gain over a range of frequencies.
#[derive(Debug, Clone, PartialEq)]
pub struct Gain {
    /// No perturbation of size up to one gives more; infinite when robust stability could not be shown.
    pub upper: f64,
    /// A perturbation of size up to one that gives this much is known; infinite when one destabilises.
    pub lower: f64,
    /// That perturbation; none when the nominal gain is the largest found.
    pub worst: Option<Perturbation>,
    /// Frequency at which it acts `[rad/s]`.
    pub w: f64,
    /// Whether `upper` holds between the points looked at.
    pub guarantee: Guarantee,
    /// μ of the uncertainty alone: robust stability.
    pub stability: Sweep,
}

/// Worst-case gain of a system whose last channels are disturbances and errors, for |Δ| ≤ 1 of the structure on the others.
///
/// # Errors
/// As [`sweep`]; a structure that does not leave exactly the channels of `performance`.
pub fn worst_case_gain(
    system: &StateSpace,
    uncertainty: &Structure,
    performance: Performance,
    range: [f64; 2],
    settings: &Settings,
) -> Result<Gain, MuError> {
    let mut blocks: Vec<Block> = uncertainty.blocks().to_vec();
    blocks.push(Block::Full { rows: performance.inputs, cols: performance.outputs });
    let all = Structure::try_new(blocks)?;
    all.check(&super::system::complex(system.matrices()[3]))?;
    let (n_w, n_z) = (uncertainty.n_w(), uncertainty.n_z());
    let stability = sweep(&part(system, [0, n_z], [0, n_w])?, uncertainty, range, settings)?;
    let nominal = part(system, [n_z, all.n_z()], [n_w, all.n_w()])?;
    let only = Structure::try_new(alloc::vec![Block::Full { rows: performance.inputs, cols: performance.outputs }])?;
    let plain = sweep(&nominal, &only, range, settings)?;
    let guarantee = stability.guarantee.clone();
    let mut out = Gain { upper: f64::INFINITY, lower: plain.worst.beta, worst: None, w: plain.worst.w, guarantee, stability };
    if out.stability.worst.beta >= 1.0 {
        (out.lower, out.worst, out.w) = (f64::INFINITY, out.stability.worst.perturbation.clone(), out.stability.worst.w);
        return Ok(out);
    }
    if out.stability.upper >= 1.0 {
        return Ok(out);
    }
    let mut low = plain.upper.max(f64::MIN_POSITIVE);
    let mut level = 2.0 * low;
    for _ in 0..SWEEPS {
        let found = sweep(&scaled(system, performance, level)?, &all, range, settings)?;
        improve(&mut out, system, uncertainty, &found);
        if found.upper < 1.0 {
            (out.upper, out.guarantee) = (level, found.guarantee);
        } else {
            low = level;
        }
        if out.upper <= low.max(out.lower) * (1.0 + CLOSE) {
            break;
        }
        level = if out.upper.is_finite() { (low.max(out.lower) * out.upper).sqrt() } else { 4.0 * level };
    }
    Ok(out)
}

/// Takes the gain under the perturbation that a sweep found worst, cut to size one.
fn improve(out: &mut Gain, system: &StateSpace, uncertainty: &Structure, found: &Sweep) {
    let Some(p) = &found.worst.perturbation else { return };
    let n = uncertainty.blocks().len();
    let cut = 1.0_f64.min(1.0 / p.size);
    // Grown to size one, or cut to it: gain grows with size more often than not, and what counts is measured below.
    for factor in [cut, 1.0 / p.blocks[..n].iter().map(Value::size).fold(f64::MIN_POSITIVE, f64::max)] {
        let blocks: Vec<Value> = p.blocks[..n].iter().map(|v| times(v, factor)).collect();
        let size = blocks.iter().map(Value::size).fold(0.0, f64::max);
        if size > 1.0 + 1e-12 {
            continue;
        }
        let candidate = Perturbation { blocks, size, singularity: f64::INFINITY };
        if let Some(gain) = gain_at(system, uncertainty, &candidate, found.worst.w)
            && gain > out.lower
        {
            (out.lower, out.w) = (gain, found.worst.w);
            out.worst = Some(candidate);
        }
    }
}

fn times(value: &Value, factor: f64) -> Value {
    match value {
        Value::Real(x) => Value::Real(x * factor),
        Value::Complex(x) => Value::Complex(x * factor),
        Value::Full(X) => Value::Full(X * Complex::new(factor, 0.0)),
    }
}

/// Largest singular value of `M22 + M21·Δ·(I − M11·Δ)⁻¹·M12` at a frequency; none where the loop is singular.
fn gain_at(system: &StateSpace, uncertainty: &Structure, perturbation: &Perturbation, w: f64) -> Option<f64> {
    let M = system.at(w)?;
    let (n_w, n_z) = (uncertainty.n_w(), uncertainty.n_z());
    let (p, m) = (M.nrows() - n_z, M.ncols() - n_w);
    let delta = perturbation.delta(uncertainty);
    let loop_ = CMatrix::identity(n_z, n_z) - M.view((0, 0), (n_z, n_w)) * &delta;
    let inner = loop_.lu().solve(&M.view((0, n_w), (n_z, m)).into_owned())?;
    let closed = M.view((n_z, n_w), (p, m)) + M.view((n_z, 0), (p, n_w)) * (&delta * inner);
    let gain = largest_singular_value(&closed);
    gain.is_finite().then_some(gain)
}

fn part(system: &StateSpace, z: [usize; 2], w: [usize; 2]) -> Result<StateSpace, MuError> {
    let [a, b, c, d] = system.matrices();
    let (p, m) = (z[1] - z[0], w[1] - w[0]);
    let b = b.columns(w[0], m).into_owned();
    let c = c.rows(z[0], p).into_owned();
    StateSpace::try_new([a.clone(), b, c, d.view((z[0], w[0]), (p, m)).into_owned()], system.dt())
}

/// The system with its errors divided by `level`.
fn scaled(system: &StateSpace, performance: Performance, level: f64) -> Result<StateSpace, MuError> {
    let [a, b, c, d] = system.matrices().map(Clone::clone);
    let (mut c, mut d) = (c, d);
    let first = d.nrows() - performance.outputs;
    c.rows_mut(first, performance.outputs).iter_mut().for_each(|x| *x /= level);
    d.rows_mut(first, performance.outputs).iter_mut().for_each(|x| *x /= level);
    StateSpace::try_new([a, b, c, d], system.dt())
}
