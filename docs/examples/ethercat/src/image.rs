//! Which bytes of the process image mean what: the objects that the drives are told to exchange, in this order.

use pkm_hal::backends::cia402::{DriveInputs, DriveOutputs};
use pkm_hal::units::EncoderTicks;

/// An object of a drive in its process data: index, and length `[bit]`.
pub type Entry = (u16, u8);

/// What a drive is sent: controlword, target torque, mode of operation.
pub const OUTPUTS: [Entry; 3] = [(0x6040, 16), (0x6071, 16), (0x6060, 8)];

/// What it sends: statusword, actual position, velocity and torque.
pub const INPUTS: [Entry; 4] = [(0x6041, 16), (0x6064, 32), (0x606c, 32), (0x6077, 16)];

/// Length of what a drive is sent `[byte]`.
pub const OUTPUT_BYTES: usize = 5;

/// Length of what it sends `[byte]`.
pub const INPUT_BYTES: usize = 12;

/// The bytes that a drive is sent; `EtherCAT` is little-endian.
#[must_use]
pub fn bytes_of(output: &DriveOutputs) -> [u8; OUTPUT_BYTES] {
    let ([c0, c1], [t0, t1], [mode]) = (output.control.to_le_bytes(), output.torque.to_le_bytes(), output.mode.to_le_bytes());
    [c0, c1, t0, t1, mode]
}

/// What the bytes of a drive say.
#[must_use]
pub const fn inputs_of(bytes: &[u8; INPUT_BYTES]) -> DriveInputs {
    let [s0, s1, p0, p1, p2, p3, v0, v1, v2, v3, t0, t1] = *bytes;
    DriveInputs {
        status: u16::from_le_bytes([s0, s1]),
        position: EncoderTicks(i32::from_le_bytes([p0, p1, p2, p3])),
        velocity: i32::from_le_bytes([v0, v1, v2, v3]),
        torque: i16::from_le_bytes([t0, t1]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_lie_as_the_lists_of_objects_say() {
        let length = |entries: &[Entry]| entries.iter().map(|(_, bits)| usize::from(*bits)).sum::<usize>();
        assert_eq!((length(&OUTPUTS), length(&INPUTS)), (8 * OUTPUT_BYTES, 8 * INPUT_BYTES));
        let output = DriveOutputs { control: 0x010f, mode: 10, torque: -2 };
        assert_eq!(bytes_of(&output), [0x0f, 0x01, 0xfe, 0xff, 0x0a]);
        let input = inputs_of(&[0x37, 0x12, 0xff, 0xff, 0xff, 0xff, 0, 0, 1, 0, 0x18, 0xfc]);
        assert_eq!(input, DriveInputs { status: 0x1237, position: EncoderTicks(-1), velocity: 65536, torque: -1000 });
    }
}
