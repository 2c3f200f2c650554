//! The same bits on every machine and in every build: a hash of a minute of every contact controller in its loop is a constant of this file.
//!
//! A change of a constant is a change of results: it needs a reason in the change log, not a new number here.

#[path = "contact/controllers.rs"]
mod controllers;

use controllers::{DT, Platform, all};
use pkm_tests::Draw;

/// FNV-1a over the bits of numbers.
struct Fnv(u64);

impl Fnv {
    fn add(&mut self, x: f64) {
        for byte in x.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

/// A minute in the loop: hash of all commands, largest speed of a drive.
fn minute(which: usize) -> (&'static str, u64, f64) {
    let (name, mut controller) = all().swap_remove(which);
    let (mut platform, mut hash, mut fastest) = (Platform::new(), Fnv(0xCBF2_9CE4_8422_2325), 0.0_f64);
    for k in 0..6000 {
        let command = controller.step(&platform.input(DT * f64::from(k)));
        assert!(!command.health.is_faulted, "{name} at step {k}: {:?}", command.health);
        command.tau.iter().for_each(|&tau| hash.add(tau));
        platform.step(&command.tau);
        platform.q.iter().for_each(|&q| hash.add(q));
        fastest = platform.v.iter().fold(fastest, |f, v| f.max(v.abs()));
    }
    (name, hash.0, fastest)
}

/// In the order of `all`; limits that do not act change no bit, so that the last is the second.
const HASHES: [u64; 10] = [
    0x2EFD_0CAE_A04D_3033,
    0x9310_4EC5_8A8B_3BC2,
    0x3157_36C0_25A0_15AF,
    0x17C2_04C9_4B3D_B16F,
    0x2BBF_E0BE_D6AC_277A,
    0xFDB2_5C54_1F5E_B51B,
    0x8D47_F1BD_1015_FEAB,
    0x753C_1E6B_7BC7_2469,
    0xA154_90A1_1FF4_A5E7,
    0x9310_4EC5_8A8B_3BC2,
];

#[test]
fn a_minute_of_every_controller_has_the_same_bits_as_ever() {
    let runs: Vec<(&str, u64, f64)> = (0..all().len()).map(minute).collect();
    for (name, hash, fastest) in &runs {
        println!("{name}: {hash:#018X}, fastest {fastest:.3} m/s");
        assert!(*fastest < 0.2, "{name} runs away: {fastest} m/s");
    }
    let got: Vec<u64> = runs.iter().map(|run| run.1).collect();
    assert_eq!(got, HASHES, "{got:#018X?}");
}

/// Bits drawn at random as numbers: small, huge, infinite, none.
fn hostile(draw: &mut Draw) -> f64 {
    match draw.choice(6) {
        0 => f64::from_bits(draw.bits()),
        1 => [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 0.0][draw.choice(6)],
        _ => draw.uniform(-1.0..1.0),
    }
}

#[test]
fn whatever_arrives_the_answer_is_finite() {
    let mut draw = Draw::new(77);
    for round in 0..400 {
        for (name, mut controller) in all() {
            for step in 0..6 {
                let mut input = Platform::new().input(0.0);
                let is_calm = step < 2 || draw.choice(3) == 0;
                if !is_calm {
                    let mut put = |values: &mut [f64]| values.iter_mut().for_each(|x| *x = hostile(&mut draw));
                    put(&mut input.q_meas);
                    put(&mut input.tau_meas);
                    put(&mut input.wrench_meas);
                    put(&mut input.q_ref);
                    put(&mut input.v_ref);
                    put(&mut input.a_ref);
                    put(&mut input.wrench_ref);
                    put(&mut input.tau_ff);
                    input.dt = hostile(&mut draw);
                }
                let command = controller.step(&input);
                assert!(command.tau.iter().all(|t| t.is_finite()), "{name}, round {round}: {command:?} after {input:?}");
            }
        }
    }
}

#[test]
fn a_number_that_is_none_latches_a_fault_in_every_controller() {
    for (name, mut controller) in all() {
        let calm = Platform::new().input(0.0);
        assert!(!controller.step(&calm).health.is_faulted, "{name}");
        let mut input = calm;
        (input.q_meas[1], input.tau_meas[1], input.wrench_meas[2]) = (f64::NAN, f64::NAN, f64::NAN);
        assert!(controller.step(&input).health.is_faulted, "{name}");
        assert!(controller.step(&calm).health.is_faulted, "{name} forgets its fault");
    }
}
