//! The same bits on every machine and in every build: a hash of efforts along a fixed motion is a constant of this file.
//!
//! A change of the constant is a change of results: it needs a reason in the change log, not a new number here.

use pkm_ctrl::catalogue::{ALL, Entry, Tuning, every};
use pkm_ctrl::{Command, Input};
use pkm_dyn::aba::aba;
use pkm_dyn::constrained::forward_dynamics;
use pkm_dyn::crba::crba;
use pkm_dyn::inverse_dynamics::{actuated_regressor, inverse_dynamics, loop_efforts};
use pkm_dyn::loops::assemble;
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, Model};
use pkm_tests::closed_loop::{Runs, Sines, shipped_robot, tuning};
use pkm_tests::{Draw, Motion};
use serde::Deserialize;

/// Robots that never change: those of the golden files, one over three legs, one closed by a pin, one with redundant rows.
const ROBOTS: [&str; 3] = [
    include_str!("golden/pinocchio/spatial_loop.json"),
    include_str!("golden/pinocchio/spatial_pin.json"),
    include_str!("golden/pinocchio/five_bar.json"),
];

#[derive(Deserialize)]
struct Texts {
    toml: String,
    urdf: String,
}

fn robot(k: usize) -> (Model, Motion) {
    let texts: Texts = serde_json::from_str(ROBOTS[k]).expect("golden file");
    let model = parse(&texts.toml, &texts.urdf, ["golden.toml", "golden.urdf"]).expect("the golden robot reads").bare;
    let motion = Motion::about_assembly(&model, 0.05, &mut Draw::new(40 + k as u64));
    (model, motion)
}

/// FNV-1a over the bits of numbers.
struct Fnv(u64);

impl Fnv {
    fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    fn add(&mut self, x: f64) {
        for byte in x.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

fn hash_of_a_motion(model: &Model, motion: &Motion) -> u64 {
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed);
    let mut hash = Fnv::new();
    for k in 0..100 {
        let [q, v, a] = motion.at(0.01 * f64::from(k));
        assert!(inverse_dynamics(model, &mut data, &q, &v, &a).is_closed);
        data.q.iter().chain(&data.v).chain(&data.a).chain(&data.tau_act).for_each(|&x| hash.add(x));
        actuated_regressor(model, &mut data).iter().for_each(|&x| hash.add(x));
        loop_efforts(model, &mut data).iter().for_each(|&x| hash.add(x));
        let (q, v, tau) = (data.q.clone(), data.v.clone(), data.tau.clone());
        assert!(forward_dynamics(model, &mut data, &q, &v, &tau).is_closed);
        data.a.iter().chain(&data.lambda).for_each(|&x| hash.add(x));
        crba(model, &mut data, &q).iter().for_each(|&x| hash.add(x));
        aba(model, &mut data, &q, &v, &tau).iter().for_each(|&x| hash.add(x));
    }
    hash.0
}

const HASHES: [u64; 3] = [0x83C4_5AF6_4FF9_DBD6, 0xABD6_FF4D_9291_7BB0, 0x340E_5DBF_425C_EE0F];

#[test]
fn efforts_along_a_fixed_motion_have_the_same_bits_as_ever() {
    let got = [0, 1, 2].map(|k| {
        let (model, motion) = robot(k);
        hash_of_a_motion(&model, &motion)
    });
    assert_eq!(got, HASHES, "{got:#018x?}");
}

#[test]
fn a_second_run_in_used_data_gives_the_same_bits() {
    let (model, motion) = robot(0);
    assert_eq!(hash_of_a_motion(&model, &motion), hash_of_a_motion(&model, &motion));
    let mut hash = Fnv::new();
    hash.add(0.0);
    let zero = hash.0;
    let mut hash = Fnv::new();
    hash.add(-0.0);
    assert_ne!(zero, hash.0, "the hash sees single bits");
}

/// Commands of every controller of the catalogue over 60 s of closed loop with the five-bar, 200 per second.
const COMMANDS: [(&str, u64); ALL.len()] = [
    ("pd_gravity", 0xE82A_5C36_262F_C512),
    ("pd_model", 0x5661_4A37_2F29_E21E),
    ("pid", 0x83A2_D3A3_69C7_8526),
    ("pid_clamping", 0x3A24_6D2F_F80B_E88D),
    ("computed_torque", 0xE97A_534F_EB73_D47F),
    ("computed_torque_dae", 0xD9C8_0C07_6287_8C5F),
    ("adrc", 0x899E_F31A_542B_1518),
    ("adrc_nonlinear", 0x7A5A_E08F_4A1C_6121),
];

#[test]
fn sixty_seconds_of_every_controller_have_the_same_bits_as_ever() {
    let robot = shipped_robot("five_bar");
    let motion = Sines::<2>::about_the_middle(&robot, 0.15);
    // The peaks of every effort are clipped: saturation and what follows it have their bits too.
    let tuning = Tuning { tau_limit: [4.4; 2], ..tuning::<2>(&robot, 20.0, 5e-3) };
    let mut got: Vec<(&str, Fnv)> = Vec::new();
    let each = |entry: &'static Entry, _: u32, _: &Input<2>, command: &Command<2>| {
        if got.last().is_none_or(|last| last.0 != entry.name) {
            got.push((entry.name, Fnv::new()));
        }
        let (_, hash) = got.last_mut().expect("just pushed");
        command.tau.iter().for_each(|&tau| hash.add(tau));
        hash.add(f64::from(u8::from(command.health.is_saturated) + 2 * u8::from(command.health.is_faulted)));
    };
    every(&robot, &tuning, &mut Runs { robot: &robot, motion: &motion, tuning, periods: 12_000, each }).expect("all can be built");
    let got: Vec<(&str, u64)> = got.into_iter().map(|(name, hash)| (name, hash.0)).collect();
    assert_eq!(got, COMMANDS, "{got:#018x?}");
}
