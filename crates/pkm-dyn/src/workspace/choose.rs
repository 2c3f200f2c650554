//! Which coordinates can be prescribed together: as many independent ones as the mechanism has freedoms.

use alloc::vec::Vec;

use crate::data::Data;
use crate::loops::{Coordinate, Output, Singularities};
use crate::model::Model;

/// A coordinate that others determine up to this share of itself cannot be prescribed beside them.
const INDEPENDENT: f64 = 1e-6;

/// Offered coordinates that move less than this share of the most movable one follow the others: parasitic motions.
const PARASITIC: f64 = 0.1;

/// Why coordinates cannot be prescribed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Undetermined {
    /// This one stands still, or follows from those before it.
    #[error("it is fixed or follows from the other coordinates at the home pose")]
    Dependent(Coordinate),
    /// Nothing moves.
    #[error("the robot has no degree of freedom at the home pose")]
    Still,
    /// More are wanted than the mechanism has freedoms.
    #[error("{wanted} coordinates are prescribed, the robot has {freedoms} degrees of freedom")]
    TooMany {
        /// How many.
        wanted: usize,
        /// Degrees of freedom.
        freedoms: usize,
    },
    /// All that were offered leave freedoms undetermined.
    #[error("its coordinates determine {found} of {freedoms} degrees of freedom at the home pose")]
    TooFew {
        /// Independent coordinates.
        found: usize,
        /// Degrees of freedom.
        freedoms: usize,
    },
}

/// All coordinates that are prescribed when `wanted` are, and the components of the output (x y z rx ry rz) that `dx/dq_act` is made of.
///
/// What `wanted` leaves undetermined at the closed pose `home` is filled with drives where drives are among them, else with coordinates
/// of the output. The components are those that are prescribed, or, where drives are, as many independent ones as there are, or all
/// where the output does not show every motion.
///
/// # Errors
/// As [`choose`].
pub fn prescribe(
    model: &Model,
    home: &[f64],
    output: &Output,
    wanted: &[Coordinate],
    length: f64,
) -> Result<(Vec<Coordinate>, Vec<usize>), Undetermined> {
    let mut data = Data::new(model);
    let mut singularities = Singularities::new(model, &mut data, home, output.clone(), &[], length);
    let _ = singularities.at(model, &mut data, home);
    let outputs: Vec<Coordinate> = (0..6).map(Coordinate::Output).collect();
    let components = |all: &[Coordinate]| -> Vec<usize> {
        all.iter().filter_map(|c| if let Coordinate::Output(k) = c { Some(*k) } else { None }).collect()
    };
    if wanted.iter().all(|c| matches!(c, Coordinate::Output(_))) {
        let all = choose(&singularities, wanted, &outputs, length)?;
        let components = components(&all);
        return Ok((all, components));
    }
    let drives: Vec<Coordinate> = model.actuators.iter().map(|&j| Coordinate::Joint(j)).collect();
    let all = choose(&singularities, wanted, &drives, length)?;
    let shown = choose(&singularities, &[], &outputs, length);
    Ok((all, shown.map_or_else(|_| (0..6).collect(), |chosen| components(&chosen))))
}

/// As many coordinates as there are freedoms at the pose `singularities` was last asked about: all of `wanted`, then from `offered`, in
/// that order, what is independent and no parasitic motion. Metres count as radians times `length` `[m]`.
///
/// # Errors
/// Wanted coordinates that depend on each other or are too many, and offered ones that do not suffice.
pub fn choose(
    singularities: &Singularities,
    wanted: &[Coordinate],
    offered: &[Coordinate],
    length: f64,
) -> Result<Vec<Coordinate>, Undetermined> {
    let freedoms = singularities.freedoms();
    if freedoms == 0 {
        return Err(Undetermined::Still);
    }
    if wanted.len() > freedoms {
        return Err(Undetermined::TooMany { wanted: wanted.len(), freedoms });
    }
    let motions: Vec<Vec<f64>> = (0..freedoms).map(|k| singularities.free_motion(k).collect()).collect();
    let row = |&c: &Coordinate| -> Vec<f64> {
        let (of, unit) = match c {
            Coordinate::Joint(j) => (j, 1.0),
            Coordinate::Output(k) => (k, if k < 3 { length } else { 1.0 }),
        };
        let jacobian = singularities.output_jacobian();
        let rate = |m: &Vec<f64>| match c {
            Coordinate::Joint(_) => m[of],
            Coordinate::Output(_) => m.iter().enumerate().map(|(j, x)| jacobian[(of, j)] * x).sum::<f64>(),
        };
        motions.iter().map(|m| rate(m) / unit).collect()
    };
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut chosen = Vec::new();
    for &c in wanted {
        let all = row(&c);
        let left = remainder(&all, &basis);
        if norm(&left).is_nan() || norm(&left) <= INDEPENDENT * norm(&all).max(INDEPENDENT) {
            return Err(Undetermined::Dependent(c));
        }
        accept(c, left, &mut basis, &mut chosen);
    }
    let top = offered.iter().map(|c| norm(&row(c))).fold(0.0, f64::max);
    for share in [PARASITIC, INDEPENDENT] {
        for &c in offered.iter().filter(|c| !wanted.contains(c)) {
            let left = remainder(&row(&c), &basis);
            if chosen.len() < freedoms && !chosen.contains(&c) && norm(&left) > share * top {
                accept(c, left, &mut basis, &mut chosen);
            }
        }
    }
    if chosen.len() < freedoms { Err(Undetermined::TooFew { found: chosen.len(), freedoms }) } else { Ok(chosen) }
}

fn accept(c: Coordinate, left: Vec<f64>, basis: &mut Vec<Vec<f64>>, chosen: &mut Vec<Coordinate>) {
    let size = norm(&left);
    basis.push(left.into_iter().map(|x| x / size).collect());
    chosen.push(c);
}

fn norm(x: &[f64]) -> f64 {
    crate::math::sqrt(x.iter().map(|x| x * x).sum())
}

/// What the orthonormal `basis` does not span of `row`.
fn remainder(row: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut left = row.to_vec();
    for b in basis {
        let along: f64 = left.iter().zip(b).map(|(x, y)| x * y).sum();
        left.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
    }
    left
}
