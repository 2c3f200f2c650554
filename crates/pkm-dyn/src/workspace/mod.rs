//! The workspace of a robot, scanned in slices: which poses can be reached, what limits the others, how near each is to a singularity.
//!
//! A scan goes from the home pose from cell to neighbouring cell, so every pose belongs to the assembly that home has. A cell that is
//! reachable satisfies every limit and no singularity lies between it and home; the way there may leave the slice.
//! Scans allocate; what they call per cell does not.

mod choose;
mod cones;
mod scan;
mod summary;

pub use choose::{Undetermined, choose, prescribe};
pub use cones::{Cone, cones};
pub use scan::Scanner;
pub use summary::Scan;

use alloc::string::String;
use alloc::vec::Vec;

use crate::configuration::integrate;
use crate::data::Data;
use crate::elimination::Elimination;
use crate::loops::{Coordinate, assemble, loop_gap};
use crate::model::{AXES, Model};

/// Why a cell cannot be used, or that it can. Where several limits are exceeded, the first of this order is named.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Within every limit.
    Reachable,
    /// The loops do not close on the branch of the home pose.
    Open,
    /// A drive, by joint, is beyond its stroke.
    Stroke(u16),
    /// A passive joint, by joint, is beyond its limits.
    Passive(u16),
    /// A ball or universal joint, by its place in the list of cones, leans too far.
    Cone(u16),
    /// A type 2 singularity is nearer than the margin.
    Singular,
    /// The condition number is above its limit.
    Condition,
    /// A singularity lies between this cell and home; no way leads on from there.
    Beyond,
}

impl Cause {
    /// Kinds of causes in the order of this enumeration, in words.
    pub const NAMES: [&'static str; 8] = [
        "reachable",
        "loops do not close",
        "drive stroke",
        "passive joint limit",
        "cone limit",
        "near a singularity",
        "condition number",
        "beyond a singularity",
    ];

    /// Place of its kind in [`Cause::NAMES`].
    #[must_use]
    pub fn kind(self) -> usize {
        match self {
            Self::Reachable => 0,
            Self::Open => 1,
            Self::Stroke(_) => 2,
            Self::Passive(_) => 3,
            Self::Cone(_) => 4,
            Self::Singular => 5,
            Self::Condition => 6,
            Self::Beyond => 7,
        }
    }

    /// Name of the joint or cone that limits; empty where none does.
    #[must_use]
    pub fn place<'a>(self, model: &'a Model, cones: &'a [Cone]) -> &'a str {
        match self {
            Self::Stroke(j) | Self::Passive(j) => &model.joints[usize::from(j)].name,
            Self::Cone(c) => &cones[usize::from(c)].name,
            _ => "",
        }
    }
}

/// One pose of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Whether it can be used, and why not.
    pub cause: Cause,
    /// Distance from type 2, see [`crate::loops::Singularity::parallel`]; NaN where the loops do not close.
    pub parallel: f64,
    /// Distance from type 1, see [`crate::loops::Singularity::serial`]; NaN where the loops do not close.
    pub serial: f64,
    /// Condition number of `dx/dq_act`; NaN where the loops do not close.
    pub condition: f64,
}

/// What a cell must satisfy beside the limits of the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// Largest lean of each cone `[rad]`, in the order of the cones.
    pub cone: Vec<f64>,
    /// Least distance from type 2; 0 asks for none.
    pub parallel: f64,
    /// Largest condition number.
    pub condition: f64,
}

/// A scanned coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Its place among the prescribed coordinates.
    pub index: usize,
    /// Its values `[m | rad]`, rising.
    pub values: Vec<f64>,
}

/// The cells of two scanned axes, the other prescribed coordinates fixed.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// Values of all prescribed coordinates `[m | rad]`; those of the scanned axes are the home pose's.
    pub at: Vec<f64>,
    /// Cells, row by row: the first axis runs along a row.
    pub cells: Vec<Cell>,
}

/// Tree coordinates near the stated assembly that close the loops; none when there are none.
///
/// Drives are moved as well where the stated ones do not close the loops, as with more drives than freedoms they may not.
#[must_use]
pub fn home(model: &Model, data: &mut Data) -> Option<Vec<f64>> {
    if assemble(model, data).is_closed {
        return Some(data.q.clone());
    }
    let mut q = model.assembly.clone();
    let mut all = Elimination::new(model.n_constraints(), model.nv());
    let mut step = q.clone();
    for _ in 0..50 {
        loop_gap(model, data, &q);
        // NaN is no closed loop.
        if data.loop_gap.iter().all(|g| g.abs() <= 1e-12) {
            return Some(q);
        }
        all.factor(|i, j| data.loop_jacobian[(i, j)]);
        all.solve(|i| -data.loop_gap[i], &mut step);
        integrate(model, &mut q, &step);
    }
    None
}

/// The coordinate of that name: x y z rx ry rz of the output, or a driven joint.
#[must_use]
pub fn coordinate_named(model: &Model, name: &str) -> Option<Coordinate> {
    let joint = || model.joint_index(name).filter(|j| model.actuators.contains(j));
    AXES.iter().position(|a| *a == name).map(Coordinate::Output).or_else(|| joint().map(Coordinate::Joint))
}

/// Name of a prescribed coordinate: that of the joint, or x y z rx ry rz.
#[must_use]
pub fn coordinate_name(model: &Model, c: Coordinate) -> String {
    match c {
        Coordinate::Joint(j) => model.joints[j].name.clone(),
        Coordinate::Output(k) => AXES[k].into(),
    }
}

/// Unit of a prescribed coordinate.
#[must_use]
pub fn coordinate_unit(model: &Model, c: Coordinate) -> &'static str {
    match c {
        Coordinate::Joint(j) => model.joints[j].kind.unit_position(),
        Coordinate::Output(k) => {
            if k < 3 {
                "m"
            } else {
                "rad"
            }
        }
    }
}
