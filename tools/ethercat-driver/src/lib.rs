//! CiA 402 drives as one image of bytes, whatever carries it; the bus is in main.rs.
//!
//! Every drive has the same process data objects, little-endian and without gaps: 1600h with controlword, target torque and mode; 1A00h with
//! statusword, position, velocity and torque. `main.rs` writes that mapping into the drives before they go to operation.

use pkm_hal::backends::cia402::{DriveInputs, DriveOutputs, Fieldbus};
use pkm_hal::units::EncoderTicks;
use pkm_hal::{Clock, HalError};

/// Bytes to a drive: controlword, target torque, mode of operation.
pub const OUTPUT: usize = 5;

/// Bytes from a drive: statusword, position, velocity, torque.
pub const INPUT: usize = 12;

/// Objects of 1600h: index, subindex and bits in one word, as they stand in the mapping.
pub const OUTPUT_OBJECTS: [u32; 3] = [0x6040_0010, 0x6071_0010, 0x6060_0008];

/// Objects of 1A00h.
pub const INPUT_OBJECTS: [u32; 4] = [0x6041_0010, 0x6064_0020, 0x606c_0020, 0x6077_0010];

/// What carries the image.
pub trait Wire {
    /// One cycle: [`OUTPUT`] bytes to every drive, [`INPUT`] bytes from every drive, in the order of the bus.
    ///
    /// # Errors
    /// [`HalError::Gone`] where not every drive took part.
    fn cycle(&mut self, outputs: &[u8], inputs: &mut [u8]) -> Result<(), HalError>;
}

/// `N` drives on a wire.
pub struct Image<W, C, const N: usize> {
    wire: W,
    clock: C,
    outputs: [[u8; OUTPUT]; N],
    inputs: [[u8; INPUT]; N],
}

impl<W: Wire, C: Clock, const N: usize> Image<W, C, N> {
    /// Drives that are sent nothing but zeros until the first cycle says otherwise; states are stamped by `clock`.
    pub const fn new(wire: W, clock: C) -> Self {
        Self { wire, clock, outputs: [[0; OUTPUT]; N], inputs: [[0; INPUT]; N] }
    }

    /// The wire.
    pub const fn wire_mut(&mut self) -> &mut W {
        &mut self.wire
    }
}

impl<W: Wire, C: Clock, const N: usize> Fieldbus for Image<W, C, N> {
    fn exchange(&mut self, outputs: &[DriveOutputs], inputs: &mut [DriveInputs]) -> Result<u64, HalError> {
        for (bytes, output) in self.outputs.iter_mut().zip(outputs) {
            *bytes = pack(output);
        }
        // Before the frame goes out: a state may be younger than it says, never older.
        let stamp_ns = self.clock.now_ns();
        self.wire.cycle(self.outputs.as_flattened(), self.inputs.as_flattened_mut())?;
        for (bytes, input) in self.inputs.iter().zip(inputs) {
            *input = unpack(bytes);
        }
        Ok(stamp_ns)
    }
}

/// What a drive is sent, as bytes.
#[must_use]
pub fn pack(output: &DriveOutputs) -> [u8; OUTPUT] {
    let [c0, c1] = output.control.to_le_bytes();
    let [t0, t1] = output.torque.to_le_bytes();
    [c0, c1, t0, t1, output.mode.to_le_bytes()[0]]
}

/// What a drive has sent.
#[must_use]
pub fn unpack(&[s0, s1, p0, p1, p2, p3, v0, v1, v2, v3, t0, t1]: &[u8; INPUT]) -> DriveInputs {
    DriveInputs {
        status: u16::from_le_bytes([s0, s1]),
        position: EncoderTicks(i32::from_le_bytes([p0, p1, p2, p3])),
        velocity: i32::from_le_bytes([v0, v1, v2, v3]),
        torque: i16::from_le_bytes([t0, t1]),
    }
}
