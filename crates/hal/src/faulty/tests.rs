use super::*;
use crate::backends::Loopback;
use crate::clock::ManualClock;

/// Reads `n` times, a millisecond apart, from a robot of two axes at (1 + 0.1·k, 2) that moves at (3, 4) under efforts (5, 6).
fn shown<const N: usize>(script: &[Injection]) -> [Result<StateFrame, HalError>; N] {
    let clock = ManualClock::new(0);
    let mut hal = FaultyHal::new(Loopback::new(2, &clock), script);
    let mut command = CommandFrame::new(2, Mode::Effort);
    command.tau[..2].copy_from_slice(&[5.0, 6.0]);
    core::array::from_fn(|k| {
        hal.inner_mut().place(&[1.0 + 0.1 * k as f64, 2.0], &[3.0, 4.0]);
        let _ = hal.write(&command.sealed());
        let state = hal.read();
        clock.advance(1_000_000);
        state
    })
}

fn during(fault: Fault) -> [Injection; 1] {
    [Injection { from: 3, to: 5, fault }]
}

#[test]
fn faults_of_values_change_that_value_in_that_time_alone() {
    let (signal, axis) = (Signal::Position, 0);
    let clean = shown::<7>(&[]);
    let cases: [(Fault, [f64; 2]); 7] = [
        (Fault::Stuck { signal, axis }, [1.2, 1.2]),
        (Fault::Offset { signal, axis, by: 0.5 }, [1.8, 1.9]),
        (Fault::Drift { signal, axis, per_s: 100.0, since_ns: 3_000_000 }, [1.3, 1.5]),
        (Fault::Flip { signal, axis }, [-1.3, -1.4]),
        (Fault::Ceiling { signal, axis, most: 1.35 }, [1.3, 1.35]),
        (Fault::Infinite { signal, axis }, [f64::INFINITY; 2]),
        (Fault::Unplugged { signal, axis }, [0.0; 2]),
    ];
    for (fault, want) in cases {
        for (k, (state, clean)) in shown::<7>(&during(fault)).into_iter().zip(clean).enumerate() {
            let (state, clean) = (state.unwrap(), clean.unwrap());
            if (3..5).contains(&k) {
                let x = state.q[0];
                assert!((x - want[k - 3]).abs() < 1e-12 || x.to_bits() == want[k - 3].to_bits(), "{fault:?}, read {k}: {x}");
                assert_eq!((state.q[1], state.v, state.tau, state.sequence), (clean.q[1], clean.v, clean.tau, clean.sequence));
            } else {
                assert_eq!(state, clean, "{fault:?}, read {k}");
            }
        }
    }
    assert_eq!(shown::<4>(&during(Fault::Unplugged { signal, axis }))[3].unwrap().valid_q, 0b10);
    let nan = shown::<4>(&during(Fault::NotANumber { signal: Signal::Effort, axis: 1 }))[3].unwrap();
    assert_eq!(nan.check(), Err(HalError::NotFinite { signal: "tau", index: 1 }));
}

#[test]
fn faults_of_frames_change_which_one_comes() {
    let sequences = |fault| shown::<7>(&during(fault)).map(|state| state.map_or(0, |state| state.sequence));
    assert_eq!(sequences(Fault::Drop), [1, 2, 3, 3, 3, 6, 7]);
    assert_eq!(sequences(Fault::Duplicate), [1, 2, 3, 3, 3, 4, 5]);
    assert_eq!(sequences(Fault::Older { by: 2 }), [1, 2, 3, 2, 3, 6, 7]);
    assert_eq!(sequences(Fault::Older { by: 99 }), [1, 2, 3, 4, 5, 6, 7], "what is not remembered does not come");
    assert_eq!(sequences(Fault::Vanish), [1, 2, 3, 0, 0, 4, 5]);
    assert_eq!(shown::<4>(&during(Fault::Vanish))[3], Err(HalError::Gone { code: 0 }));
    let state = |fault| shown::<4>(&during(fault))[3].unwrap();
    assert!(matches!(state(Fault::Corrupt { bit: 77 }).check(), Err(HalError::Checksum { .. })));
    assert!(matches!(state(Fault::OtherLayout).check(), Err(HalError::Layout { .. })));
    assert_eq!(state(Fault::OtherNonce { nonce: 9 }).nonce, 9);
    let stamps = shown::<6>(&during(Fault::ClockStands)).map(|state| state.unwrap().stamp_ns / 1_000_000);
    assert_eq!(stamps, [0, 1, 2, 2, 2, 5]);
}

#[test]
fn faults_of_drives_change_what_they_give() {
    let efforts = |fault| shown::<6>(&during(fault)).map(|state| state.unwrap().tau[1].to_bits());
    let bits = |efforts: [f64; 6]| efforts.map(f64::to_bits);
    assert_eq!(efforts(Fault::DeadDrive { axis: 1 }), bits([6.0, 6.0, 6.0, 0.0, 0.0, 6.0]));
    assert_eq!(efforts(Fault::WeakDrive { axis: 1, most: 2.5 }), bits([6.0, 6.0, 6.0, 2.5, 2.5, 6.0]));
    assert_eq!(efforts(Fault::ReversedDrive { axis: 1 }), bits([6.0, 6.0, 6.0, -6.0, -6.0, 6.0]));
    assert_eq!(efforts(Fault::DeadDrive { axis: 99 }), bits([6.0; 6]));
    let clock = ManualClock::new(0);
    let script = [Injection { from: 1, to: 2, fault: Fault::LostCommand }];
    let mut hal = FaultyHal::new(Loopback::new(1, &clock), &script);
    for sequence in 1..=2 {
        hal.write(&CommandFrame { sequence, ..CommandFrame::new(1, Mode::Effort) }.sealed()).unwrap();
    }
    assert_eq!(hal.read().unwrap().command_sequence, 1);
}

#[test]
fn one_script_gives_the_same_bits_twice() {
    let script = [
        Injection { from: 0, to: 7, fault: Fault::Drift { signal: Signal::Sensor, axis: 3, per_s: 0.1, since_ns: 0 } },
        Injection { from: 2, to: 6, fault: Fault::Older { by: 1 } },
        Injection { from: 4, to: 5, fault: Fault::Corrupt { bit: 4000 } },
    ];
    let bytes = || shown::<7>(&script).map(|state| state.unwrap().to_bytes());
    assert_eq!(bytes(), bytes());
}
