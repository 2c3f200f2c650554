//! A robot for other programs: Pinocchio (URDF and a loop file in the style of toolbox-parallel-robots) and MuJoCo (MJCF).
//!
//! Mass matrix, bias and the manifold of closed poses are those of the robot. What a format cannot say exactly is refused where it is a
//! loop, a coupling or an inertia, and named in the notes (which stand at the head of the file as well) where it is one of the effects.

mod closure;
mod gepetto;
mod joints;
mod mjcf;

pub use gepetto::{Gepetto, gepetto};
pub use mjcf::{Mjcf, mjcf};

use alloc::collections::BTreeSet;

use crate::data::Data;
use crate::loops::assemble;
use crate::model::{AXES, LoopClosure, Model};

/// A loop counts as closed below this gap `[m | rad]`.
const GAP_LIMIT: f64 = 1e-9;

/// Why a robot cannot be written for another program; one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// A loop that the format cannot close exactly.
    #[error("loop {name:?}: {axes} cannot be closed by {program}, which has {has}; cut the loop at another of its joints")]
    Loop {
        /// The loop.
        name: String,
        /// Forbidden motions.
        axes: String,
        /// The program.
        program: &'static str,
        /// What the program has.
        has: &'static str,
    },
    /// A coupling that the format cannot say.
    #[error("coupling of {joint:?}: it follows {leaders} independent joints (a URDF's <mimic> follows 1)")]
    Coupling {
        /// The joint that follows.
        joint: String,
        /// How many independent joints it follows, directly or through other couplings.
        leaders: usize,
    },
    /// No closed pose is known.
    #[error("loops do not close near the stated assembly: {at} stays {gap:.3e} m or rad open (limit {GAP_LIMIT:e})")]
    Open {
        /// Loop and axis, or coupling.
        at: String,
        /// Largest gap `[m | rad]`.
        gap: f64,
    },
    /// An inertia that the program refuses.
    #[error(
        "link {link:?}: principal inertias {} {} {} kg·m² about the centre of mass (MuJoCo wants them > 0, each at most the sum of the others)",
        .principal[0], .principal[1], .principal[2]
    )]
    Inertia {
        /// Link that gives the moving body its name.
        link: String,
        /// Principal inertias, smallest first `[kg·m²]`.
        principal: [f64; 3],
    },
    /// The XML library's reason.
    #[error("{0}")]
    Writing(String),
}

/// Tree coordinates that close the loops near the stated assembly `[m | rad]`.
fn home(model: &Model) -> Result<Vec<f64>, ExportError> {
    let mut data = Data::new(model);
    let closure = assemble(model, &mut data);
    if closure.gap <= GAP_LIMIT { Ok(data.q) } else { Err(ExportError::Open { at: row_name(model, closure.row), gap: closure.gap }) }
}

/// Constraint rows are the couplings, then the forbidden motions of each loop.
fn row_name(model: &Model, row: usize) -> String {
    if let Some(c) = model.couplings.get(row) {
        return format!("coupling of {:?}", model.joints[c.joint].name);
    }
    let axes = |l: &LoopClosure| (0..6).filter(|&k| l.constrain[k]).collect::<Vec<_>>();
    let mut rows = model.loops.iter().flat_map(|l| axes(l).into_iter().map(move |k| (&l.name, AXES[k])));
    let named = rows.nth(row - model.couplings.len());
    named.map_or_else(String::new, |(name, axis)| format!("loop {name:?}, {axis},"))
}

/// The forbidden motions as robot.toml has them.
fn axes(constrain: &[bool; 6]) -> String {
    (0..6).filter(|&k| constrain[k]).map(|k| AXES[k]).collect::<Vec<_>>().join(" ")
}

/// Names in use, so that new ones are none of them.
#[derive(Debug, Default)]
struct Names(BTreeSet<String>);

impl Names {
    fn new<'n>(taken: impl IntoIterator<Item = &'n str>) -> Self {
        Self(taken.into_iter().map(str::to_string).collect())
    }

    /// `wanted`, or the nearest free name after it.
    fn fresh(&mut self, wanted: &str) -> String {
        let mut name = printable(wanted);
        while !self.0.insert(name.clone()) {
            name.push('_');
        }
        name
    }
}

/// The text on one line, without what XML and YAML cannot hold.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') { '_' } else { c }).collect()
}

/// Numbers with all their digits, separated by spaces.
fn numbers(values: &[f64]) -> String {
    // Zero has no sign here.
    values.iter().map(|x| format!("{:?}", x + 0.0)).collect::<Vec<_>>().join(" ")
}
