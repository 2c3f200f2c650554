//! McDaid's ankle robot under force control, as far as its robustness analysis goes: 30 states, discrete, 9 uncertainty channels.
//!
//! Geometry and equations from [McDaid] (8.14-8.46), with the corrections of `docs/REFERENCES.md`; parameters that the chapter does not
//! give are chosen so that the uniform gains become unstable where the paper's do (10 for P, 16 for PD).

use nalgebra::{DMatrix, Matrix3, Vector3};
use pkm_ctrl::design::mu::{Block, StateSpace};
use pkm_dyn::math::sin_cos;

/// Sample time `[s]`.
pub(crate) const DT: f64 = 0.002;
/// Gains of the proposed controller in the directions of the effective mass, and of the internal force.
pub(crate) const PROPOSED: [f64; 4] = [5.0, 18.0, 60.0, 10.0];

const K_T: f64 = 0.05;
const ROTOR: f64 = 2.0e-5;
const SCREW: f64 = 2.0e-6;
const BELT_RADIUS: f64 = 0.030;
const RATIO: f64 = 5.0;
const PITCH: f64 = 0.003_175;
const MOTOR_DAMPING: f64 = 4.0e-4;
const SCREW_DAMPING: f64 = 1.0e-5;
const BELT: [f64; 2] = [6.0e4, 6.0];
const ROD: [f64; 2] = [0.6, 200.0];
const SENSOR_MASS: f64 = 0.3;
const SENSOR: [f64; 2] = [2.0e6, 300.0];
const LAG: f64 = 0.001;
const K_D: f64 = 7.98e-4;

/// Blocks: three distinct inertias, then damping and stiffness of the ankle as full matrices.
pub(crate) fn blocks() -> Vec<Block> {
    let real = Block::Real { repeats: 1 };
    let full = Block::Full { rows: 3, cols: 3 };
    vec![real, real, real, full, full]
}

fn rotations(t: [f64; 3]) -> [Matrix3<f64>; 3] {
    let [(sa, ca), (sb, cb), (sc, cc)] = t.map(sin_cos);
    [
        Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca),
        Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb),
        Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0),
    ]
}

/// Four points: front pair and rear pair at an angle from the axis of the foot.
fn points(front: f64, rear: f64, angle_deg: f64, z: f64) -> [Vector3<f64>; 4] {
    let (s, c) = sin_cos(angle_deg.to_radians());
    [
        Vector3::new(front * s, front * c, z),
        Vector3::new(-front * s, front * c, z),
        Vector3::new(-rear * s, -rear * c, z),
        Vector3::new(rear * s, -rear * c, z),
    ]
}

/// Rates of the four legs over rates of the Euler angles, 4 × 3 `[m/rad]`.
pub(crate) fn jacobian(t: [f64; 3]) -> DMatrix<f64> {
    let [x, y, z] = rotations(t);
    let R = x * y * z;
    let axes = Matrix3::from_columns(&[Vector3::x(), x * Vector3::y(), x * y * Vector3::z()]);
    let (base, platform) = (points(0.18, 0.20, 45.0, 0.0), points(0.08, 0.09, 60.0, -0.05));
    let mut J = DMatrix::zeros(4, 3);
    for i in 0..4 {
        let arm = R * platform[i];
        let leg = Vector3::new(0.0, 0.0, 0.36) + arm - base[i];
        J.row_mut(i).copy_from(&(arm.cross(&leg.normalize()).transpose() * axes));
    }
    J
}

fn diagonal(values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(values))
}

/// Matrix exponential: Taylor series of a small enough share, then squared back.
fn exponential(A: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut small, mut halvings) = (A.clone(), 0);
    while small.norm() > 0.1 {
        small /= 2.0;
        halvings += 1;
    }
    let one = DMatrix::identity(A.nrows(), A.nrows());
    let series = (1..=18).rev().fold(one.clone(), |sum, k| &one + &small * sum / f64::from(k));
    (0..halvings).fold(series, |E, _| &E * &E)
}

fn inertia() -> DMatrix<f64> {
    diagonal(&[0.055, 0.035, 0.06])
}

fn stiffness() -> DMatrix<f64> {
    diagonal(&[30.0, 20.0, 20.0])
}

fn damping() -> DMatrix<f64> {
    DMatrix::identity(3, 3) * 0.5 + stiffness() * 0.002
}

fn put(target: &mut DMatrix<f64>, at: (usize, usize), block: &DMatrix<f64>) {
    target.view_mut(at, block.shape()).copy_from(block);
}

/// Continuous three-mass model: A (22), input of the motor currents, force output, and the inertia of the task with the sensors.
fn plant(J: &DMatrix<f64>) -> [DMatrix<f64>; 4] {
    let gear = 2.0 * core::f64::consts::PI / PITCH;
    let motor_radius = BELT_RADIUS / RATIO;
    let one = DMatrix::identity(4, 4);
    let task = inertia() + J.transpose() * J * SENSOR_MASS;
    // Stiffness and damping share their pattern: sensor, belt, and what stands against the world.
    let pattern = |sensor: f64, belt: f64, world: [f64; 2], ankle: DMatrix<f64>| {
        let mut K = DMatrix::zeros(11, 11);
        put(&mut K, (0, 0), &(ankle + J.transpose() * J * sensor));
        put(&mut K, (0, 3), &(J.transpose() * -sensor));
        put(&mut K, (3, 0), &(J * -sensor));
        let screw = 2.0 * gear * gear * BELT_RADIUS * BELT_RADIUS * belt + world[0];
        put(&mut K, (3, 3), &(&one * (sensor + screw)));
        let across = &one * (-2.0 * gear * motor_radius * BELT_RADIUS * belt);
        put(&mut K, (3, 7), &across);
        put(&mut K, (7, 3), &across);
        put(&mut K, (7, 7), &(&one * (2.0 * motor_radius * motor_radius * belt + world[1])));
        K
    };
    let K = pattern(SENSOR[0], BELT[0], [0.0, 0.0], stiffness());
    let B = pattern(SENSOR[1], BELT[1], [ROD[1] + gear * gear * SCREW_DAMPING, MOTOR_DAMPING], damping());
    let mut M = DMatrix::zeros(11, 11);
    put(&mut M, (0, 0), &task);
    put(&mut M, (3, 3), &(&one * (ROD[0] + gear * gear * SCREW)));
    put(&mut M, (7, 7), &(&one * ROTOR));
    let inverse = M.try_inverse().expect("masses");
    let mut A = DMatrix::zeros(22, 22);
    A.view_mut((0, 11), (11, 11)).fill_with_identity();
    put(&mut A, (11, 0), &-(&inverse * K));
    put(&mut A, (11, 11), &-(inverse * B));
    let mut current = DMatrix::zeros(22, 4);
    put(&mut current, (18, 0), &(&one * (K_T / ROTOR)));
    let mut force = DMatrix::zeros(4, 22);
    for (at, gain) in [(0, SENSOR[0]), (11, SENSOR[1])] {
        put(&mut force, (0, at), &(J * -gain));
        put(&mut force, (0, at + 3), &(&one * gain));
    }
    [A, current, force, task]
}

/// Gains in the directions of the effective mass seen by the legs, largest first, and along the internal force.
fn gains(J: &DMatrix<f64>, k: [f64; 4]) -> DMatrix<f64> {
    let pinv = J.clone().pseudo_inverse(1e-12).expect("a Jacobian");
    let eigen = (pinv.transpose() * inertia() * pinv).symmetric_eigen();
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let W = DMatrix::from_fn(4, 4, |i, j| eigen.eigenvectors[(i, order[j])]);
    &W * diagonal(&k) * W.transpose()
}

/// The closed loop with its uncertainty pulled out: M of the analysis, at one orientation of the foot `[rad]`.
pub(crate) fn closed_loop(t: [f64; 3], k: [f64; 4]) -> StateSpace {
    let J = jacobian(t);
    let [x, y, z] = rotations(t);
    let rotation = x * y * z;
    let R = DMatrix::from_fn(3, 3, |i, j| rotation[(i, j)]);
    let [A, current, force, task] = plant(&J);
    // Currents follow their commands with a lag; disturbances enter at the task's acceleration.
    let mut A26 = DMatrix::zeros(26, 26);
    put(&mut A26, (0, 0), &A);
    put(&mut A26, (0, 22), &current);
    put(&mut A26, (22, 22), &(DMatrix::identity(4, 4) * (-1.0 / LAG)));
    let mut weights = DMatrix::zeros(3, 9);
    put(&mut weights, (0, 0), &(&R * 0.002));
    put(&mut weights, (0, 3), &(DMatrix::identity(3, 3) * 0.1));
    put(&mut weights, (0, 6), &(DMatrix::identity(3, 3) * 0.1));
    let push = -(task.try_inverse().expect("masses") * weights);
    let mut B26 = DMatrix::zeros(26, 13);
    put(&mut B26, (22, 0), &(DMatrix::identity(4, 4) / LAG));
    put(&mut B26, (11, 4), &push);
    let mut C26 = DMatrix::zeros(4, 26);
    put(&mut C26, (0, 0), &force);
    let mut both = DMatrix::zeros(39, 39);
    put(&mut both, (0, 0), &A26);
    put(&mut both, (0, 26), &B26);
    let held = exponential(&(both * DT));
    let (Az, Bz) = (held.view((0, 0), (26, 26)).into_owned(), held.view((0, 26), (26, 13)).into_owned());
    // Force with its derivative by the backward difference, fed back through the gains.
    let kd = K_D / DT;
    let mut A30 = DMatrix::zeros(30, 30);
    put(&mut A30, (0, 0), &Az);
    put(&mut A30, (26, 0), &(&C26 * &Az * (1.0 + kd) - &C26 * kd));
    let mut B30 = DMatrix::zeros(30, 13);
    put(&mut B30, (0, 0), &Bz);
    put(&mut B30, (26, 0), &(&C26 * &Bz * (1.0 + kd)));
    let motor = K_T * RATIO * 2.0 * core::f64::consts::PI / PITCH;
    let feedback = B30.columns(0, 4) * gains(&J, k) / motor;
    let own = A30.columns(26, 4) - feedback;
    A30.columns_mut(26, 4).copy_from(&own);
    let mut C = DMatrix::zeros(9, 30);
    put(&mut C, (0, 0), &(R.transpose() * A26.rows(11, 3)));
    put(&mut C, (3, 11), &damping());
    put(&mut C, (6, 0), &stiffness());
    let mut D = DMatrix::zeros(9, 9);
    put(&mut D, (0, 0), &(R.transpose() * push));
    StateSpace::try_new([A30, B30.columns(4, 9).into_owned(), C, D], Some(DT)).expect("dimensions")
}
