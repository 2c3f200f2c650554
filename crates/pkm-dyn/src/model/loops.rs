//! What closes the tree: loops and couplings.

use alloc::string::String;
use alloc::vec::Vec;

use crate::spatial::Pose;

/// Names of the six relative motions a loop can forbid, in the order of [`LoopClosure::constrain`].
pub const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// A frame fixed to a body (or to the root).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOnBody {
    /// Body that carries the frame; `None` is the root.
    pub body: Option<usize>,
    /// The frame in the body's frame.
    pub pose: Pose,
}

/// A joint that closes a loop: some motions of frame b relative to frame a, seen in a, are forbidden.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopClosure {
    /// Name.
    pub name: String,
    /// Frame a.
    pub a: FrameOnBody,
    /// Frame b.
    pub b: FrameOnBody,
    /// Which of [`AXES`] are forbidden: x y z of the vector from a to b, then of the rotation vector from a to b.
    pub constrain: [bool; 6],
}

impl LoopClosure {
    /// Number of scalar constraints.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.rows().count()
    }

    /// The forbidden motions, as indices into [`AXES`].
    #[inline]
    pub fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        (0..6).filter(|&k| self.constrain[k])
    }

    /// Whether any rotation is forbidden.
    #[must_use]
    #[inline]
    pub fn forbids_turns(&self) -> bool {
        self.constrain[3] || self.constrain[4] || self.constrain[5]
    }
}

/// A linear relation a drive imposes: `q[joint] = Σ ratio·q[of] + offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupling {
    /// The joint that follows.
    pub joint: usize,
    /// The joints it follows, with their ratios.
    pub of: Vec<(usize, f64)>,
    /// Constant part `[m | rad]`.
    pub offset: f64,
}
