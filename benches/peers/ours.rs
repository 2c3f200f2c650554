//! pkm-dyn's side: the algorithms that both sides have, one call each, and where their numbers lie.

use core::hint::black_box;
use std::time::Instant;

use pkm_dyn::Data;
use pkm_dyn::aba::aba;
use pkm_dyn::constrained::forward_dynamics;
use pkm_dyn::crba::crba;
use pkm_dyn::inverse_dynamics::{closed_loop_motion, inverse_dynamics, inverse_dynamics_at};
use pkm_dyn::jacobian::joint_jacobians;
use pkm_dyn::kinematics::{forward_accelerations, forward_kinematics, forward_velocities};
use pkm_dyn::loops::{solve_accelerations, solve_positions, solve_velocities};
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::rnea::{nle, rnea};

use crate::case::{Case, State};

/// An algorithm both sides have.
pub(crate) struct Algorithm {
    /// As it is called in the table.
    pub(crate) name: &'static str,
    /// What the other side calls it; of several ways it has, the fastest counts.
    pub(crate) theirs: &'static [&'static str],
    /// Whether it is about closed loops.
    pub(crate) is_closed_loop: bool,
    /// One call.
    pub(crate) call: fn(&Case, &mut Data, &State),
    /// Appends the result of the last call, in the order of the other side.
    pub(crate) result: fn(&Case, &Data, &mut Vec<f64>),
}

/// Every algorithm, in the order of the table.
pub(crate) const ALGORITHMS: &[Algorithm] = &[
    Algorithm {
        name: "rnea",
        theirs: &["rnea"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(rnea(&c.model, d, &s.q, &s.v, &s.a));
        },
        result: |_, d, out| out.extend(&d.tau),
    },
    Algorithm {
        name: "joint_torque_regressor",
        theirs: &["joint_torque_regressor"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(joint_torque_regressor(&c.model, d, &s.q, &s.v, &s.a));
        },
        result: |_, d, out| out.extend(d.joint_torque_regressor.iter()),
    },
    Algorithm {
        name: "forward kinematics, second order",
        theirs: &["kinematics"],
        is_closed_loop: false,
        call: |c, d, s| {
            forward_kinematics(&c.model, d, &s.q);
            forward_velocities(&c.model, d, &s.v);
            forward_accelerations(&c.model, d, &s.a);
            black_box(&d.acceleration);
        },
        result: motion,
    },
    Algorithm {
        name: "nle",
        theirs: &["nle"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(nle(&c.model, d, &s.q, &s.v));
        },
        result: |_, d, out| out.extend(&d.tau),
    },
    Algorithm {
        name: "crba",
        theirs: &["crba_local", "crba_world"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(crba(&c.model, d, &s.q));
        },
        result: |_, d, out| out.extend(d.mass_matrix.iter()),
    },
    Algorithm {
        name: "aba",
        theirs: &["aba_local", "aba_world"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(aba(&c.model, d, &s.q, &s.v, &s.tau));
        },
        result: |_, d, out| out.extend(&d.a),
    },
    Algorithm {
        name: "joint_jacobians",
        theirs: &["joint_jacobians"],
        is_closed_loop: false,
        call: |c, d, s| {
            black_box(joint_jacobians(&c.model, d, &s.q));
        },
        result: |_, d, out| out.extend(d.jacobian.iter()),
    },
    Algorithm {
        name: "forward_dynamics, loops closed",
        theirs: &["forward_dynamics"],
        is_closed_loop: true,
        call: |c, d, s| {
            let _ = black_box(forward_dynamics(&c.model, d, &s.q, &s.v, &s.tau));
        },
        result: |_, d, out| out.extend(&d.a),
    },
    Algorithm {
        name: "inverse_dynamics_at, loops closed",
        theirs: &["effort"],
        is_closed_loop: true,
        call: |c, d, s| {
            let _ = black_box(inverse_dynamics_at(&c.model, d, &s.q, &s.v, &s.a));
        },
        result: efforts,
    },
    Algorithm {
        name: "inverse_dynamics, following at 1 kHz",
        theirs: &["step_1ms"],
        is_closed_loop: true,
        call: |c, d, s| step(c, d, s, 0),
        result: efforts,
    },
    Algorithm {
        name: "inverse_dynamics, from a pose 10 ms before",
        theirs: &["step_10ms"],
        is_closed_loop: true,
        call: |c, d, s| step(c, d, s, 1),
        result: efforts,
    },
];

/// Efforts at the coordinates that were independent at the start, and are so on the other side: with more drives than freedoms they
/// change with the pose.
fn efforts(case: &Case, data: &Data, out: &mut Vec<f64>) {
    let now = nalgebra::DVector::from_column_slice(&data.tau_ind);
    let speeds = nalgebra::DMatrix::from_fn(data.n_ind(), data.n_ind(), |i, k| data.reduction[(case.independent[i], k)]);
    match speeds.transpose().lu().solve(&now) {
        Some(then) => out.extend(then.iter()),
        None => out.extend(now.iter().map(|_| f64::NAN)),
    }
}

/// The sample a millisecond before is the state before: what `data` knows of it serves, as it does in a loop. Ten milliseconds before
/// there is only the pose.
fn begin(data: &mut Data, s: &State, before: usize) {
    if before > 0 || s.is_first {
        data.q.copy_from_slice(&s.before[before]);
    }
}

fn step(case: &Case, data: &mut Data, s: &State, before: usize) {
    begin(data, s, before);
    let [q, v, a] = &s.drives;
    let _ = black_box(inverse_dynamics(&case.model, data, q, v, a));
}

/// Pose, velocity and acceleration of every body; ours has the base accelerated against gravity, theirs has not.
fn motion(case: &Case, data: &Data, out: &mut Vec<f64>) {
    for i in 0..case.model.nv() {
        let pose = &data.pose_wb[i];
        let weight = pose.rotation.transpose() * case.model.gravity;
        out.extend(pose.rotation.transpose().iter());
        out.extend(pose.translation.iter());
        out.extend(data.velocity[i].linear.iter().chain(data.velocity[i].angular.iter()));
        out.extend((data.acceleration[i].linear + weight).iter());
        out.extend(data.acceleration[i].angular.iter());
    }
}

/// Nanoseconds per call, over one pass through all states.
pub(crate) fn time(case: &Case, data: &mut Data, call: impl Fn(&Case, &mut Data, &State)) -> f64 {
    // The other side has just had the processor: fill the caches again first.
    for state in &case.states[..case.states.len() / 8] {
        call(case, data, state);
    }
    #[expect(clippy::disallowed_methods, reason = "this is what a bench is for")]
    let start = Instant::now();
    for state in &case.states {
        call(case, data, state);
    }
    start.elapsed().as_secs_f64() * 1e9 / case.states.len() as f64
}

/// Results of all states, one after the other.
pub(crate) fn results(case: &Case, data: &mut Data, algorithm: &Algorithm) -> Vec<f64> {
    let mut out = Vec::new();
    for state in &case.states {
        (algorithm.call)(case, data, state);
        (algorithm.result)(case, data, &mut out);
    }
    out
}

/// A call that starts from one of the previous samples.
type Part = fn(&Case, &mut Data, &State, usize);

/// Parts of one step of a computed-torque controller, each with those before it.
pub(crate) const PARTS: [(&str, Part); 3] = [
    ("passive q, v, a and reduction", |c, d, s, before| {
        begin(d, s, before);
        let _ = black_box(solve_positions(&c.model, d, &s.drives[0]));
        solve_velocities(&c.model, d, &s.drives[1]);
        solve_accelerations(&c.model, d, &s.drives[2]);
    }),
    ("… + motion of the bodies", |c, d, s, before| {
        begin(d, s, before);
        let [q, v, a] = &s.drives;
        let _ = black_box(closed_loop_motion(&c.model, d, q, v, a));
    }),
    ("… + drives' efforts", step),
];

/// Mean number of Newton steps from a previous sample.
pub(crate) fn mean_steps(case: &Case, data: &mut Data, before: usize) -> f64 {
    let mut steps = 0;
    for s in &case.states {
        begin(data, s, before);
        steps += solve_positions(&case.model, data, &s.drives[0]).iterations;
    }
    steps as f64 / case.states.len() as f64
}
