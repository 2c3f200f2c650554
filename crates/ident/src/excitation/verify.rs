//! Verification: a motion on a dense grid against every limit, with the columns as they will be recorded.

use faer::Mat;
use pkm_dyn::math;

use super::basis::Periodic;
use super::criterion::{Separation, separation};
use super::limits::{Bound, Bounded, Bounds};
use super::mechanism::{Direction, Mechanism};
use super::problem::Refused;
use crate::factor::Factor;

/// A bound where a motion comes nearest to it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Margin {
    /// What is bounded.
    pub what: Bounded,
    /// Joint, ball joint, or the robot's name.
    pub place: String,
    /// The value nearest to its limit, in SI units; a share for the distance from singularities.
    pub value: f64,
    /// Lower limit; minus infinity for none.
    pub lower: f64,
    /// Upper limit; infinity for none.
    pub upper: f64,
    /// Room that is left, as a share of half the range: 1 in the middle, 0 at a limit.
    pub room: f64,
    /// When `[s]`.
    pub time: f64,
}

/// How good a motion is.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Quality {
    /// Condition number of the columns that count at length one.
    pub condition: f64,
    /// Condition number of the same columns in SI units.
    pub condition_raw: f64,
    /// `ln det(WᵀW/rows)` of the same columns in SI units.
    pub log_determinant: f64,
    /// Two effects after the base parameters; none without effects, or where one of them lies in the span of the base parameters.
    pub separation: Option<Separation>,
}

/// A verified motion.
#[derive(Debug, Clone)]
pub(super) struct Verified {
    pub(super) quality: Quality,
    pub(super) margins: Vec<Margin>,
}

/// Walks over one period in `n` steps; refuses the first bound that is not kept. Room is counted in `counted`, which have names.
pub(super) fn verify(
    mechanism: &mut Mechanism<'_>,
    motion: &Periodic,
    bounds: &Bounds,
    n: usize,
    name: &dyn Fn(&Bound) -> String,
) -> Result<Verified, Refused> {
    let all: Vec<&Bound> = bounds.drives.iter().flatten().chain(&bounds.robot).collect();
    let mut nearest = vec![(f64::INFINITY, f64::NAN, 0.0); all.len()];
    let p = mechanism.n_columns();
    let mut factor = Factor::new(p);
    for i in 0..n {
        let t = motion.period_s * i as f64 / n as f64;
        let state = motion.at(t);
        if (i == 0 && !mechanism.go(&state.q)) || !mechanism.look(&state, bounds, Direction::Sharp) {
            return Err(Refused::Open);
        }
        let of_drives = (0..state.q.len()).flat_map(|k| [state.q[k], state.v[k], state.a[k]]);
        for ((bound, value), nearest) in all.iter().zip(of_drives.chain(mechanism.values.iter().copied())).zip(&mut nearest) {
            let room = bound.least(value);
            if room < 0.0 {
                return Err(Refused::Outside((*bound).clone(), value));
            }
            if room < nearest.0 {
                *nearest = (room, value, t);
            }
        }
        mechanism.rows.chunks(p).for_each(|row| factor.push(row, 0.0, 0.0));
    }
    let is_bound = |b: &&&Bound| b.lower.is_finite() || b.upper.is_finite();
    let margin = |(b, (room, value, time)): (&&Bound, (f64, f64, f64))| Margin {
        what: b.what,
        place: name(b),
        value,
        lower: b.lower,
        upper: b.upper,
        room,
        time,
    };
    let margins = all.iter().zip(nearest).filter(|(b, _)| is_bound(b)).map(margin).collect();
    Ok(Verified { quality: quality(&factor, mechanism.n_effects()), margins })
}

fn quality(factor: &Factor, n_effects: usize) -> Quality {
    let triangle = factor.triangle();
    let p = triangle.ncols() - 1;
    let counted = triangle.submatrix(0, 0, p + 1, p - n_effects).to_owned();
    let [condition, condition_raw] = conditions(&counted);
    let rows = factor.count().max(1) as f64;
    let values = counted.singular_values().unwrap_or_default();
    let log_determinant = values.iter().map(|s| math::ln(s * s / rows)).sum();
    let square = triangle.subcols(0, p).to_owned();
    let separation = if n_effects == 2 { separation(&(square.transpose() * &square * (1.0 / rows))) } else { None };
    Quality { condition, condition_raw, log_determinant, separation }
}

/// Condition numbers of a matrix: with its columns at length one, and as it is. Infinite for a singular one.
#[must_use]
pub fn conditions(m: &Mat<f64>) -> [f64; 2] {
    let lengths: Vec<f64> = (0..m.ncols()).map(|j| m.col(j).norm_l2()).collect();
    let unit = Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / lengths[j]);
    [&unit, m].map(|m| {
        let values = m.singular_values().unwrap_or_default();
        match (values.first(), values.last()) {
            (Some(first), Some(last)) if *last > 0.0 => first / last,
            _ => f64::INFINITY,
        }
    })
}
