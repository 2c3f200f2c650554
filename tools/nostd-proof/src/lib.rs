//! Numbers of the control loop's crates as hashes of bits: the same constants must come out with std (the test below) and without
//! (the program).
#![cfg_attr(not(test), no_std)]

use nalgebra::Vector3;
use pkm_ctrl::{Controller, Input, PdGravity, PdGravityConfig, PdGravityState};
use pkm_dyn::model::{JointKind, ModelBuilder};
use pkm_dyn::rnea::rnea;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters, Model, math};

/// What is computed, in this order, by a build with std: functions, efforts of a robot, commands of a controller.
pub const HASHES: [u64; 3] = [0xA275_0160_F27C_64BD, 0x593C_9380_D97B_7D46, 0x9704_9E06_D886_3072];

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

/// Every transcendental function, over arguments of all sizes that occur.
pub fn functions() -> u64 {
    let mut hash = Fnv::new();
    for k in 1..=1000 {
        let x = 0.0137 * f64::from(k);
        for y in [math::sin(x), math::cos(x), math::tan(x), math::atan2(x, 3.1), math::exp(-x), math::ln(x), math::log10(x)] {
            hash.add(y);
        }
        let unit = math::tanh(0.1 * x);
        for y in [unit, math::asin(unit), math::acos(unit), math::powf(x, 1.7), math::sqrt(x), math::hypot(x, 2.3)] {
            hash.add(y);
        }
    }
    hash.0
}

/// A turning column with an arm that slides out of it at an angle; `None` never happens.
pub fn robot() -> Option<Model> {
    let body = |mass: f64, x: f64| {
        let central = nalgebra::Matrix3::from_diagonal(&Vector3::new(0.02, 0.05, 0.04)) * mass;
        InertialParameters::from_centre_of_mass(mass, Vector3::new(x, 0.03, -0.05), central)
    };
    let mut builder = ModelBuilder::new("column", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default());
    builder.link("column", body(3.0, 0.0)).link("arm", body(1.2, 0.25));
    let tilted = Pose::from_xyz_rpy([0.1, 0.0, 0.5], [0.3, -0.4, 0.2]);
    builder.moving_joint("turn", JointKind::Revolute, ("base", "column"), Pose::identity(), Vector3::z());
    builder.moving_joint("slide", JointKind::Prismatic, ("column", "arm"), tilted, Vector3::x());
    builder.build().ok()
}

/// Efforts along a motion. `data` is made for `model`; nothing is allocated here.
pub fn efforts(model: &Model, data: &mut Data) -> u64 {
    let mut hash = Fnv::new();
    for k in 0..200 {
        let t = 0.01 * f64::from(k);
        let q = [math::sin(2.0 * t), 0.1 * math::cos(3.0 * t)];
        let v = [2.0 * math::cos(2.0 * t), -0.3 * math::sin(3.0 * t)];
        let a = [-4.0 * math::sin(2.0 * t), -0.9 * math::cos(3.0 * t)];
        rnea(model, data, &q, &v, &a).iter().for_each(|&tau| hash.add(tau));
    }
    hash.0
}

/// Commands of a controller that moves two masses, until a number that is none latches its fault; `None` never happens.
pub fn commands() -> Option<u64> {
    let config = PdGravityConfig { kp: [400.0, 90.0], kd: [35.0, 12.0], tau_limit: [60.0, 9.0], dt: 1e-3, filter_s: 2e-3 };
    let controller = PdGravity::try_new(config).ok()?;
    let mut state = PdGravityState::default();
    let (mut q, mut v, mut hash) = ([0.0; 2], [0.0; 2], Fnv::new());
    for k in 0..2000 {
        let t = 1e-3 * f64::from(k);
        let q_ref = [math::sin(t), 0.5 * math::sin(2.0 * t)];
        let mut input = Input { q_meas: q, q_ref, v_ref: [math::cos(t), math::cos(2.0 * t)], tau_ff: [1.5, -0.7] };
        if k == 1900 {
            input.q_meas[0] = f64::NAN;
        }
        let command = controller.step(&mut state, &input);
        for i in 0..2 {
            v[i] += 1e-3 * command.tau[i] / [2.0, 0.5][i];
            q[i] += 1e-3 * v[i];
            hash.add(command.tau[i]);
        }
        hash.add(f64::from(u8::from(command.health.is_saturated) + 2 * u8::from(command.health.is_faulted)));
    }
    Some(hash.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_with_std_gives_the_constants() {
        // Only there with the feature that brings std.
        assert!(pkm_dyn::urdf::parse("", "", ["robot.toml", "robot.urdf"]).is_err());
        let model = robot().expect("two joints are a tree");
        let got = [functions(), efforts(&model, &mut Data::new(&model)), commands().expect("good gains")];
        assert_eq!(got, HASHES, "{got:#018X?}");
    }
}
