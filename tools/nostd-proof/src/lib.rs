//! Numbers of the control loop's crates as hashes of bits: the same constants must come out with std (the test below) and without
//! (the program).
#![cfg_attr(not(test), no_std)]

extern crate alloc;

use alloc::vec::Vec;

use nalgebra::Vector3;
use pkm_ctrl::catalogue::{Drives, Entry, Tuning, Visit, every};
use pkm_ctrl::{Controller, Input, PdGravity, PdGravityConfig, PdGravityState};
use pkm_dyn::aba::aba;
use pkm_dyn::constrained::forward_dynamics;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::{inverse_dynamics, loop_efforts};
use pkm_dyn::model::{JointKind, LoopClosure, ModelBuilder};
use pkm_dyn::rnea::rnea;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters, Model, math};

/// What is computed, in this order, by a build with std: functions, efforts of a robot, commands of a controller, dynamics of loops,
/// commands of every controller of the catalogue.
pub const HASHES: [u64; 5] =
    [0xA275_0160_F27C_64BD, 0x593C_9380_D97B_7D46, 0x9704_9E06_D886_3072, 0x31F0_BAAA_3731_B3F3, 0xA4FA_B384_5DA4_9EEF];

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
        let v_ref = [math::cos(t), math::cos(2.0 * t)];
        let mut input = Input { q_ref, v_ref, tau_ff: [1.5, -0.7], ..Input::standing(q, 1e-3) };
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

/// A crank that drives a slider through a rod, closed by a pin in space: three of its five rows are redundant. `None` never happens.
pub fn crank() -> Option<Model> {
    let mut builder = ModelBuilder::new("crank", [0.0, -9.81, 0.0]);
    builder.link("base", InertialParameters::default());
    for (name, mass) in [("crank", 1.1), ("slider", 2.3), ("rod", 0.7)] {
        let central = nalgebra::Matrix3::from_diagonal(&Vector3::new(0.01, 0.02, 0.025)) * mass;
        builder.link(name, InertialParameters::from_centre_of_mass(mass, Vector3::new(0.1, 0.01, 0.0), central));
    }
    builder.moving_joint("turn", JointKind::Revolute, ("base", "crank"), Pose::identity(), Vector3::z());
    builder.moving_joint("slide", JointKind::Prismatic, ("base", "slider"), Pose::identity(), Vector3::x());
    builder.moving_joint("swing", JointKind::Revolute, ("slider", "rod"), Pose::identity(), Vector3::z());
    let mut model = builder.build().ok()?;
    let a = model.frame_on("pin", "crank", Pose::from_xyz_rpy([0.2, 0.0, 0.0], [0.0; 3])).ok()?;
    let b = model.frame_on("pin", "rod", Pose::from_xyz_rpy([-0.5, 0.0, 0.0], [0.0; 3])).ok()?;
    model.add_loop(LoopClosure { name: "pin".into(), a, b, constrain: [true, true, true, true, true, false] }).ok()?;
    model.set_assembly("slide", 0.7).ok()?;
    model.add_actuator("turn", 0.1).ok()?;
    Some(model)
}

/// Efforts, multipliers and accelerations of a mechanism with a loop through several turns. `data` is made for `model` and assembled;
/// nothing is allocated here.
pub fn loops(model: &Model, data: &mut Data) -> u64 {
    let mut hash = Fnv::new();
    for k in 0..200 {
        let turn = 0.05 * f64::from(k);
        let is_closed = inverse_dynamics(model, data, &[turn], &[2.0], &[1.0]).is_closed;
        hash.add(f64::from(u8::from(is_closed)));
        hash.add(data.tau_act[0]);
        loop_efforts(model, data).iter().for_each(|&x| hash.add(x));
        let (q, v) = ([data.q[0], data.q[1], data.q[2]], [data.v[0], data.v[1], data.v[2]]);
        let _ = forward_dynamics(model, data, &q, &v, &[3.0, -1.0, 0.2]);
        data.a.iter().for_each(|&x| hash.add(x));
        aba(model, data, &q, &v, &[3.0, -1.0, 0.2]).iter().for_each(|&x| hash.add(x));
    }
    hash.0
}

/// Runs the mechanism of [`crank`] under every controller it visits.
struct Turns<'m> {
    model: &'m Model,
    /// Memory used so far, by which an allocation in the loop is noticed.
    used: fn() -> usize,
    has_allocated: bool,
    has_faulted: bool,
    hash: Fnv,
}

const DT: f64 = 1e-3;

impl Visit<1> for Turns<'_> {
    fn visit<C: Controller<1>>(&mut self, entry: &'static Entry, controller: &C) {
        let (mut state, mut data) = (controller.at_rest(), Data::new(self.model));
        if !pkm_dyn::loops::assemble(self.model, &mut data).is_closed {
            return;
        }
        let mut v = 0.0;
        let (mut u, before) = (0.0, (self.used)());
        for k in 0..200 {
            let t = DT * f64::from(k);
            let input = Input {
                q_ref: [0.6 * math::sin(2.0 * t)],
                v_ref: [1.2 * math::cos(2.0 * t)],
                a_ref: [-2.4 * math::sin(2.0 * t)],
                ..Input::standing([data.q[0]], DT)
            };
            let answer = controller.step(&mut state, &input);
            self.has_faulted |= answer.health.is_faulted;
            let command = answer.tau[0];
            self.hash.add(command);
            let tau = if entry.drives == Drives::Voltage { (command - u) / DT } else { command };
            u = command;
            let turn = data.q[0];
            let _ = inverse_dynamics(self.model, &mut data, &[turn], &[v], &[0.0]);
            let (q, v_tree) = ([data.q[0], data.q[1], data.q[2]], [data.v[0], data.v[1], data.v[2]]);
            let _ = forward_dynamics(self.model, &mut data, &q, &v_tree, &[tau, 0.0, 0.0]);
            v += DT * data.a[0];
            let next = turn + DT * v;
            let _ = pkm_dyn::loops::solve_positions(self.model, &mut data, &[next]);
        }
        self.has_allocated |= (self.used)() != before;
    }
}

/// Commands of every controller of the catalogue, and whether one of them allocated while it ran by what `used` says of memory; `None`
/// never happens.
pub fn tracking(model: &Model, used: fn() -> usize) -> Option<(u64, bool)> {
    let robot = Robot::new(model.clone(), Vec::new());
    let tuning = Tuning { bandwidth: 25.0, dt: DT, tau_limit: [40.0], b0: [1.0], u_limit: [1e3] };
    let mut turns = Turns { model, used, has_allocated: false, has_faulted: false, hash: Fnv::new() };
    every(&robot, &tuning, &mut turns).ok()?;
    (!turns.has_faulted).then_some((turns.hash.0, turns.has_allocated))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_with_std_gives_the_constants() {
        // Only there with the feature that brings std.
        assert!(pkm_dyn::urdf::parse("", "", ["robot.toml", "robot.urdf"]).is_err());
        let model = robot().expect("two joints are a tree");
        let mechanism = crank().expect("three joints and a pin");
        let mut assembled = Data::new(&mechanism);
        assert!(pkm_dyn::loops::assemble(&mechanism, &mut assembled).is_closed);
        let moved = loops(&mechanism, &mut assembled);
        let (tracked, _) = tracking(&mechanism, || 0).expect("every controller can be built");
        let got = [functions(), efforts(&model, &mut Data::new(&model)), commands().expect("good gains"), moved, tracked];
        assert_eq!(got, HASHES, "{got:#018X?}");
    }
}
