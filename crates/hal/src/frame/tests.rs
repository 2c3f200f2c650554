use core::mem::offset_of;

use super::*;

fn filled() -> StateFrame {
    let mut frame = StateFrame::new(3, 2);
    (frame.nonce, frame.sequence, frame.stamp_ns, frame.command_sequence) = (0x0102_0304_0506_0708, 7, 1_000_000, 6);
    (frame.valid_q, frame.valid_v, frame.valid_tau, frame.valid_sensor) = (0b111, 0b011, 0b101, 0b11);
    for (i, x) in frame.q.iter_mut().enumerate() {
        *x = i as f64 - 0.25;
    }
    (frame.v[0], frame.tau[2], frame.sensor[1]) = (-1e-300, 1e300, 0.1);
    frame.sealed()
}

#[test]
fn bytes_are_those_in_memory_and_lead_back_to_the_frame() {
    let frame = filled();
    let bytes = frame.to_bytes();
    assert_eq!(StateFrame::from_bytes(&bytes), frame);
    assert_eq!(bytes[offset_of!(StateFrame, nonce)..][..8], [8, 7, 6, 5, 4, 3, 2, 1]);
    let at = offset_of!(StateFrame, tau) + 16;
    assert_eq!(bytes[at..at + 8], 1e300_f64.to_le_bytes());
    assert_eq!(offset_of!(StateFrame, checksum) + 8, StateFrame::BYTES);
    assert_eq!(offset_of!(CommandFrame, checksum) + 8, CommandFrame::BYTES);
}

#[test]
fn any_flipped_bit_is_noticed() {
    let bytes = filled().to_bytes();
    assert_eq!(StateFrame::from_bytes(&bytes).check(), Ok(()));
    for bit in 0..8 * StateFrame::BYTES {
        let mut broken = bytes;
        broken[bit / 8] ^= 1 << (bit % 8);
        assert!(StateFrame::from_bytes(&broken).check().is_err(), "bit {bit}");
    }
}

#[test]
fn layouts_differ_and_name_every_field_with_its_unit() {
    assert_ne!(StateFrame::LAYOUT, CommandFrame::LAYOUT);
    assert!(StateFrame::FIELDS.contains("stamp_ns: u64 [ns]") && CommandFrame::FIELDS.ends_with("checksum: u64 [crc32]"));
    // Programs built apart agree on these: a change of layout must be meant.
    assert_eq!((StateFrame::BYTES, CommandFrame::BYTES), (592, 192));
    let foreign = StateFrame { layout: 1, ..filled() };
    assert_eq!(foreign.check(), Err(HalError::Layout { found: 1, expected: StateFrame::LAYOUT }));
}

#[test]
fn a_value_that_is_none_is_refused_where_it_is_said_to_be_measured_only() {
    let mut frame = filled();
    frame.v[2] = f64::NAN;
    assert_eq!(frame.sealed().check(), Ok(()));
    assert_eq!(frame.measured(Signal::Velocity, 2), None);
    frame.valid_v |= 0b100;
    assert_eq!(frame.sealed().check(), Err(HalError::NotFinite { signal: "v", index: 2 }));
    assert_eq!(frame.measured(Signal::Position, 40), None);
    frame = filled();
    frame.valid_sensor = 0b100;
    assert_eq!(frame.sealed().check(), Err(HalError::Axes { found: 3, expected: 2 }));
    frame = StateFrame { n_axes: 17, ..filled() };
    assert_eq!(frame.sealed().check(), Err(HalError::Axes { found: 17, expected: 16 }));
}

#[test]
fn commands_are_refused_for_each_reason_apart() {
    let good = CommandFrame::new(2, Mode::Effort);
    assert_eq!(good.sealed().check(2), Ok(Mode::Effort));
    assert_eq!(good.check(2), Err(HalError::Checksum { sequence: 0 }));
    assert_eq!(good.sealed().check(3), Err(HalError::Axes { found: 2, expected: 3 }));
    assert_eq!(CommandFrame { mode: 9, ..good }.sealed().check(2), Err(HalError::Mode { code: 9 }));
    let mut bad = good;
    bad.tau[1] = f64::INFINITY;
    assert_eq!(bad.sealed().check(2), Err(HalError::NotFinite { signal: "tau", index: 1 }));
    for mode in [Mode::Off, Mode::Arm, Mode::Effort, Mode::Brake] {
        assert_eq!(Mode::of(mode.code()), Some(mode));
    }
}
