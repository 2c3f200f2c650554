//! What an uncertainty looks like: blocks on a diagonal.

use alloc::vec::Vec;
use core::ops::Range;

use super::{CMatrix, MuError};

/// One block of the uncertainty Δ; Δ maps outputs z of M to its inputs w.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// δ·I with δ real: a parameter that enters `repeats` times.
    Real {
        /// Size of the identity.
        repeats: usize,
    },
    /// δ·I with δ complex.
    Complex {
        /// Size of the identity.
        repeats: usize,
    },
    /// Any complex matrix, measured by its largest singular value.
    Full {
        /// Rows of Δ: inputs w of M.
        rows: usize,
        /// Columns of Δ: outputs z of M.
        cols: usize,
    },
}

impl Block {
    /// Rows of the block, inputs w of M.
    #[must_use]
    pub fn rows(self) -> usize {
        match self {
            Self::Real { repeats } | Self::Complex { repeats } => repeats,
            Self::Full { rows, .. } => rows,
        }
    }

    /// Columns of the block, outputs z of M.
    #[must_use]
    pub fn cols(self) -> usize {
        match self {
            Self::Real { repeats } | Self::Complex { repeats } => repeats,
            Self::Full { cols, .. } => cols,
        }
    }

    /// Whether the block is a real parameter.
    #[must_use]
    pub fn is_real(self) -> bool {
        matches!(self, Self::Real { .. })
    }
}

/// A block with its place in Δ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Placed {
    pub(crate) block: Block,
    /// Rows of Δ, columns of M.
    pub(crate) w: Range<usize>,
    /// Columns of Δ, rows of M.
    pub(crate) z: Range<usize>,
}

/// The block structure of an uncertainty, in the order of M's channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Structure {
    blocks: Vec<Block>,
}

impl Structure {
    /// Checks that there is at least one block and none is empty.
    ///
    /// # Errors
    /// No block, or one of size zero.
    pub fn try_new(blocks: Vec<Block>) -> Result<Self, MuError> {
        if blocks.is_empty() {
            return Err(MuError::NoBlock);
        }
        match blocks.iter().position(|b| b.rows() == 0 || b.cols() == 0) {
            Some(block) => Err(MuError::EmptyBlock { block }),
            None => Ok(Self { blocks }),
        }
    }

    /// The blocks, in order.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Rows of Δ: inputs w of M.
    #[must_use]
    pub fn n_w(&self) -> usize {
        self.blocks.iter().map(|b| b.rows()).sum()
    }

    /// Columns of Δ: outputs z of M.
    #[must_use]
    pub fn n_z(&self) -> usize {
        self.blocks.iter().map(|b| b.cols()).sum()
    }

    /// Every block with its rows and columns.
    pub(crate) fn placed(&self) -> Vec<Placed> {
        let (mut w, mut z) = (0, 0);
        let mut place = |block: &Block| {
            let placed = Placed { block: *block, w: w..w + block.rows(), z: z..z + block.cols() };
            (w, z) = (placed.w.end, placed.z.end);
            placed
        };
        self.blocks.iter().map(&mut place).collect()
    }

    /// Refuses a matrix that does not fit or holds what is no number.
    ///
    /// # Errors
    /// Other dimensions than `n_z` × `n_w`, an entry that is not finite.
    pub fn check(&self, M: &CMatrix) -> Result<(), MuError> {
        let (expected, found) = ((self.n_z(), self.n_w()), M.shape());
        if expected != found {
            return Err(MuError::Shape { what: "M", rows: found.0, cols: found.1, expected_rows: expected.0, expected_cols: expected.1 });
        }
        super::must_be_finite("M", M.iter().flat_map(|c| [c.re, c.im]), M.nrows())
    }
}
