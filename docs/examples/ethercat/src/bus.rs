//! What is believed of a cycle of the bus: all drives took part, all follow their targets, none repeats itself.

use pkm_hal::backends::cia402::{DriveInputs, DriveOutputs, Fieldbus};
use pkm_hal::{Clock, HalError};

use crate::image::{INPUT_BYTES, OUTPUT_BYTES, bytes_of, inputs_of};

/// What a master says of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// How often drives took part: each adds 1 for what was read and 2 for what was written.
    pub working_counter: u16,
    /// Whether every drive follows what it is sent (state OP).
    pub is_operational: bool,
}

/// A master of the bus: one cycle of process data.
pub trait Master {
    /// Sends what the drives are to have, and takes what they have to say; `None` where nothing came back in time.
    fn cycle(&mut self, outputs: &[[u8; OUTPUT_BYTES]], inputs: &mut [[u8; INPUT_BYTES]]) -> Option<Turn>;
}

/// Codes of [`HalError::Gone`]: nothing came back.
pub const LOST: i32 = 1;
/// Not every drive took part.
pub const MISSING: i32 = 2;
/// A drive takes part but does not follow.
pub const NOT_OPERATIONAL: i32 = 3;
/// A drive repeats itself; its number from zero is added.
pub const FROZEN: i32 = 100;

/// A drive that says it moves, and at least this fast `[ticks/s]`, ...
const MOVES: u32 = 1000;
/// ... does not send the same bytes for so long `[ns]`: some twenty ticks are missing then.
const REPEATS_NS: u64 = 20_000_000;

/// `N` drives behind a master.
///
/// The working counter tells a drive that is off the bus, the state one that is on it and stands aside. Neither tells one whose interface
/// answers while its firmware stands still: such a drive sends its last bytes for ever, and is known by a position that does not follow from
/// its velocity.
#[derive(Debug)]
pub struct Bus<M, C, const N: usize> {
    master: M,
    clock: C,
    inputs: [[u8; INPUT_BYTES]; N],
    /// When each drive last sent something else `[ns]`.
    changed_ns: [u64; N],
}

impl<M: Master, C: Clock, const N: usize> Bus<M, C, N> {
    /// Drives behind `master`, stamped by the clock that the daemon reads.
    pub fn new(master: M, clock: C) -> Self {
        let now_ns = clock.now_ns();
        Self { master, clock, inputs: [[0; INPUT_BYTES]; N], changed_ns: [now_ns; N] }
    }

    /// The master.
    pub const fn master_mut(&mut self) -> &mut M {
        &mut self.master
    }
}

// ANCHOR: exchange
impl<M: Master, C: Clock, const N: usize> Fieldbus for Bus<M, C, N> {
    fn exchange(&mut self, outputs: &[DriveOutputs], inputs: &mut [DriveInputs]) -> Result<u64, HalError> {
        // Before the frame goes: a state is never older than it says.
        let stamp_ns = self.clock.now_ns();
        let (mut sent, mut came) = ([[0; OUTPUT_BYTES]; N], self.inputs);
        for (bytes, output) in sent.iter_mut().zip(outputs) {
            *bytes = bytes_of(output);
        }
        let turn = self.master.cycle(&sent, &mut came).ok_or(HalError::Gone { code: LOST })?;
        if usize::from(turn.working_counter) != 3 * N {
            return Err(HalError::Gone { code: MISSING });
        }
        if !turn.is_operational {
            return Err(HalError::Gone { code: NOT_OPERATIONAL });
        }
        for (k, input) in inputs.iter_mut().enumerate().take(N) {
            *input = inputs_of(&came[k]);
            if came[k] != self.inputs[k] {
                (self.inputs[k], self.changed_ns[k]) = (came[k], stamp_ns);
            } else if input.velocity.unsigned_abs() >= MOVES && stamp_ns.saturating_sub(self.changed_ns[k]) >= REPEATS_NS {
                return Err(HalError::Gone { code: FROZEN.saturating_add(i32::try_from(k).unwrap_or(0)) });
            }
        }
        Ok(stamp_ns)
    }
}
// ANCHOR_END
