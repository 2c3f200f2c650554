//! How a loop is closed by programs that know two closures: points that coincide, and frames that coincide.
//!
//! A pin is two points on its axis: five independent rows out of six. Rows that a loop leaves out may be added where the rest of the
//! robot implies them: a planar loop that forbids x and y is closed by a point as well, since nothing in it can leave the plane.

use nalgebra::Vector3;

use super::GAP_LIMIT;
use crate::data::Data;
use crate::elimination::Elimination;
use crate::loops::{loop_gap, walk_to};
use crate::math;
use crate::model::Model;
use crate::spatial::{Pose, rotation_about};

/// Half the distance of the two points that make a pin `[m]`.
pub(super) const PIN_ARM: f64 = 0.2;

/// Closed poses beside the assembly at which rows must be implied.
const NEIGHBOURS: usize = 6;

/// How far the free coordinates go from the assembly to a neighbour, at most `[m | rad]`.
const STEP: f64 = 0.1;

/// A neighbour out of reach is sought this often, each time half as far.
const TRIES: usize = 6;

/// What two frames have in common once the loop is closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Their origins: x y z.
    Point,
    /// Their origins and this axis: x y z and the other two rotations.
    Pin(usize),
    /// Everything.
    Frame,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Point, Self::Pin(0), Self::Pin(1), Self::Pin(2), Self::Frame];

    fn rows(self) -> [bool; 6] {
        let mut rows = [true; 6];
        match self {
            Self::Point => rows[3..].fill(false),
            Self::Pin(axis) => rows[3 + axis] = false,
            Self::Frame => {}
        }
        rows
    }
}

/// How a loop may be closed: with the same closed poses, and more rows where the robot implies them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Closing {
    /// Forbidden motions: those of the loop, and rows that are implied. Only those of `kind`, if there is one.
    pub(super) rows: [bool; 6],
    /// What coincides, if the rows are such.
    pub(super) kind: Option<Kind>,
    /// Where frame a has to be put, in frame a: rows that are implied are constant, not zero.
    pub(super) shift: Pose,
}

/// Points fixed to both frames alike that coincide `[m]`: none where the frames do.
pub(super) fn points(kind: Kind) -> Vec<Vector3<f64>> {
    match kind {
        Kind::Frame => Vec::new(),
        Kind::Point => vec![Vector3::zeros()],
        Kind::Pin(axis) => [PIN_ARM, -PIN_ARM].map(|arm| Vector3::ith(axis, arm)).into(),
    }
}

/// How loop `index` may be closed in this robot; `home` is a closed pose `[m | rad]`.
pub(super) fn closing(model: &Model, home: &[f64], index: usize) -> Closing {
    let wanted = model.loops[index].constrain;
    if let Some(kind) = Kind::ALL.into_iter().find(|k| k.rows() == wanted) {
        return Closing { rows: wanted, kind: Some(kind), shift: Pose::identity() };
    }
    let implied = implied(model, home, index);
    let is_held = |k: usize| wanted[k] || implied[k].is_some();
    let fits = |kind: &Kind| (0..6).all(|k| kind.rows()[k] || !wanted[k]) && (0..6).all(|k| !kind.rows()[k] || is_held(k));
    let kind = Kind::ALL.into_iter().find(fits);
    let rows = kind.map_or_else(|| core::array::from_fn(is_held), Kind::rows);
    let constant = |k: usize| implied[k].filter(|_| rows[k]).unwrap_or(0.0);
    let turn = Vector3::new(constant(3), constant(4), constant(5));
    let angle = math::sqrt(turn.dot(&turn));
    let rotation = if angle > 0.0 { rotation_about(&(turn / angle), angle) } else { Pose::identity().rotation };
    Closing { rows, kind, shift: Pose { rotation, translation: Vector3::new(constant(0), constant(1), constant(2)) } }
}

/// Vector `[m]` and rotation vector `[rad]` from frame a to frame b of a loop, in frame a.
pub(super) fn gap(model: &Model, q: &[f64], index: usize) -> [f64; 6] {
    let mut all = model.clone();
    all.couplings.clear();
    all.loops = vec![all.loops[index].clone()];
    all.loops[0].constrain = [true; 6];
    let mut data = Data::new(&all);
    loop_gap(&all, &mut data, q);
    core::array::from_fn(|k| data.loop_gap[k])
}

/// Rows that the loop leaves out and the rest of the robot holds constant, with their values `[m | rad]`.
fn implied(model: &Model, home: &[f64], index: usize) -> [Option<f64>; 6] {
    let wanted = model.loops[index].constrain;
    let at_home = gap(model, home, index);
    let Some(poses) = neighbours(model, home) else { return [None; 6] };
    let gaps: Vec<[f64; 6]> = poses.iter().map(|q| gap(model, q, index)).collect();
    let ranks: Vec<usize> = poses.iter().map(|q| rank(model, q)).collect();
    let mut out = core::array::from_fn(|k| {
        let mut wide = model.clone();
        wide.loops[index].constrain[k] = true;
        let is_constant = !wanted[k] && gaps.iter().all(|g| (g[k] - at_home[k]).abs() < GAP_LIMIT);
        let is_implied = is_constant && poses.iter().zip(&ranks).all(|(q, &r)| rank(&wide, q) == r);
        is_implied.then_some(at_home[k])
    });
    // Beside a free rotation, a component of the rotation vector that is constant and not zero is no constant turn of the frame.
    if (3..6).any(|k| !wanted[k] && out[k].is_none()) {
        for held in &mut out[3..] {
            *held = held.filter(|c| c.abs() < GAP_LIMIT).map(|_| 0.0);
        }
    }
    out
}

fn factored(model: &Model, q: &[f64]) -> Elimination {
    let mut data = Data::new(model);
    loop_gap(model, &mut data, q);
    let mut all = Elimination::new(model.n_constraints(), model.nv());
    all.factor(|i, j| data.loop_jacobian[(i, j)]);
    all
}

fn rank(model: &Model, q: &[f64]) -> usize {
    factored(model, q).rank()
}

/// Closed poses about `home`, itself included; `None` if one of them is out of reach.
fn neighbours(model: &Model, home: &[f64]) -> Option<Vec<Vec<f64>>> {
    let mut free = model.clone();
    free.actuators = factored(model, home).free_columns().to_vec();
    let mut out = vec![home.to_vec()];
    for n in 0..NEIGHBOURS {
        out.push(neighbour(&free, home, n)?);
    }
    Some(out)
}

fn neighbour(free: &Model, home: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut step = STEP;
    for _ in 0..TRIES {
        let mut data = Data::new(free);
        data.q.copy_from_slice(home);
        // Multiples of the golden ratio: evenly spread directions, the same in every run.
        let spread = |k: usize| ((1 + k + n * free.n_act()) as f64 * 0.618_033_988_749_895).fract() * 2.0 - 1.0;
        let way: Vec<f64> = free.actuators.iter().enumerate().map(|(k, &j)| home[j] + step * spread(k)).collect();
        if walk_to(free, &mut data, &way).is_closed {
            return Some(data.q);
        }
        step *= 0.5;
    }
    None
}
