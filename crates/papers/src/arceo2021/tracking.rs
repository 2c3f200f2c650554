//! Section 3: computed torque along the beating sines (11), on the three plants, and what the voltage does.

use pkm_ctrl::observer::{CommandedAcceleration, Discretisation};
use pkm_ctrl::{ComputedTorqueDae, ComputedTorqueDaeConfig, Controller, ErrorGains, Input};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Integrator, Plant as _, ReducedPlant};

use crate::arceo2021::equations::{B0, B1, FRICTION, MASSES, Plant};
use crate::arceo2021::gains::{POLES, PRINTED};
use crate::arceo2021::geometry::FITTED;
use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::{Gate, Line, Plot, Row};
use crate::series::rms;

/// Step of simulation and law `[s]`.
const DT: f64 = 1e-3;

/// Printed start of the piston `[m]`: 41 mm from the reference.
const START: f64 = 0.0906;

/// Foot angle there, from the printed T1 and T2 by (3) `[rad]`.
const START_PHI: f64 = 0.0369 + 1.9944 + core::f64::consts::FRAC_PI_2 - 2.0952;

/// Errors count from here on `[s]`.
const SETTLED_S: f64 = 5.0;

/// Beyond this position a run is given up `[m]`.
const LOST: f64 = 1.0;

/// Reference (11): position, velocity, acceleration.
pub(super) fn beat(t: f64) -> [f64; 3] {
    let (a, w1, w2) = (0.025, 0.45 * core::f64::consts::PI, 0.55 * core::f64::consts::PI);
    let ((s1, c1), (s2, c2)) = (math::sin_cos(w1 * t), math::sin_cos(w2 * t));
    [0.05 + a * s1 - a * s2, a * w1 * c1 - a * w2 * c2, -a * w1 * w1 * s1 + a * w2 * w2 * s2]
}

/// What the law inverts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Law {
    /// (8) with its bracket mended: `b0·u' = M11·a + C1 + F1`.
    Row,
    /// (8) with the bracket where it is printed: `u' = M11·a/b0 + C1 + F1`.
    Bracket,
    /// The projected inertia and force.
    Projected,
}

/// One run: plant, law, gains, limit of the voltage `[V]`.
type Case = (Plant, Law, ErrorGains, f64);

/// What a run shows.
struct Run {
    /// Root mean square of the error from 5 s to 20 s `[m]`; not a number where the run was given up.
    error: f64,
    /// Largest voltage before 5 s and the last one `[V]`.
    volts: [f64; 2],
    /// Length of the run `[s]`.
    seconds: f64,
    /// Time and position, every hundredth step.
    path: Vec<(f64, f64)>,
}

/// Position and rates of (d, T1, T2).
type State = [[f64; 3]; 2];

/// One step of the classical Runge-Kutta method.
fn advance(plant: Plant, [q, v]: State, u_dot: f64, friction: &[[f64; 2]; 3]) -> State {
    let rate = |q: [f64; 3], v: [f64; 3]| [v, FITTED.accelerations(plant, q, v, u_dot, friction)];
    let moved =
        |k: &State, h: f64| -> State { [core::array::from_fn(|i| q[i] + h * k[0][i]), core::array::from_fn(|i| v[i] + h * k[1][i])] };
    let k1 = rate(q, v);
    let [qa, va] = moved(&k1, 0.5 * DT);
    let k2 = rate(qa, va);
    let [qb, vb] = moved(&k2, 0.5 * DT);
    let k3 = rate(qb, vb);
    let [qc, vc] = moved(&k3, DT);
    let k4 = rate(qc, vc);
    let sum = |x: f64, row: usize, i: usize| x + DT / 6.0 * (k1[row][i] + 2.0 * k2[row][i] + 2.0 * k3[row][i] + k4[row][i]);
    [core::array::from_fn(|i| sum(q[i], 0, i)), core::array::from_fn(|i| sum(v[i], 1, i))]
}

/// Rate of the voltage that the law asks for `[V/s]`.
fn wanted(law: Law, [q, v]: State, a: f64) -> f64 {
    let friction = FRICTION[0][0] * v[0] * v[0] + FRICTION[0][1] * v[0];
    let rest = FITTED.coriolis(q, v)[0] + friction;
    let mass: f64 = MASSES.iter().sum();
    match law {
        Law::Row => (mass * a + rest) / B0,
        Law::Bracket => mass * a / B0 + rest,
        Law::Projected => {
            let [mass, force] = FITTED.projected(q, v[0], &FRICTION);
            (mass * a + force) / B0
        }
    }
}

fn follow((plant, law, gains, limit): Case) -> Run {
    let mut state: State = [FITTED.inverse_kinematics(START_PHI), [0.0; 3]];
    let (mut u, mut integral) = (0.0_f64, 0.0);
    let mut run = Run { error: f64::NAN, volts: [0.0; 2], seconds: 20.0, path: Vec::new() };
    let mut errors = Vec::new();
    for k in 0..20_000 {
        let t = DT * f64::from(k);
        let [d, v, a] = beat(t);
        let (e, rate) = (d - state[0][0], v - state[1][0]);
        let acceleration = a - (gains.ki * integral + gains.kp * e + gains.kv * rate);
        let next = (u + DT * wanted(law, state, acceleration)).clamp(-limit, limit);
        integral += DT * e;
        state = advance(plant, state, (next - u) / DT, &FRICTION);
        u = next;
        if k % 100 == 0 {
            run.path.push((t, state[0][0]));
        }
        if t < SETTLED_S {
            run.volts[0] = run.volts[0].max(u.abs());
        } else {
            errors.push(e);
        }
        run.volts[1] = u;
        if !state[0][0].is_finite() || state[0][0].abs() > LOST {
            run.seconds = t;
            return run;
        }
    }
    run.error = rms(&errors);
    run
}

/// The library's law on the library's plant, without friction: root mean square of the error from 5 s on `[m]`.
///
/// The mass of the controller's slider is changed by `extra` `[kg]`.
///
/// # Errors
/// A plant that does not start, a law that faults.
pub fn on_the_whole_robot(extra: f64) -> Result<f64, PaperError> {
    let observer = CommandedAcceleration::try_new([300.0], Discretisation::ZeroOrderHold)?;
    let config = ComputedTorqueDaeConfig { gains: [ErrorGains::placed(POLES)], b0: [B0], u_limit: [1e9], creep: 0.0 };
    let law = ComputedTorqueDae::try_new(smooth(extra)?, observer, config)?;
    let mut plant = ReducedPlant::try_new(smooth(0.0)?, &[START])?;
    let (mut state, mut u, mut errors) = (law.in_motion([&[START], &[0.0], &[0.0]]), 0.0, Vec::new());
    for k in 0..20_000 {
        let t = DT * f64::from(k);
        let [q_ref, v_ref, a_ref] = beat(t);
        let q = plant.position()[0];
        if t >= SETTLED_S {
            errors.push(q_ref - q);
        }
        let input = Input { q_ref: [q_ref], v_ref: [v_ref], a_ref: [a_ref], ..Input::standing([q], DT) };
        let command = law.step(&mut state, &input);
        if command.health.is_faulted || command.health.is_saturated {
            return Err(PaperError::Other { what: "section 3", reason: format!("faulted or saturated at {t} s") });
        }
        let tau = B0 * (command.tau[0] - u) / DT;
        u = command.tau[0];
        for _ in 0..2 {
            plant.step(&[tau], 0.5 * DT)?;
        }
    }
    Ok(rms(&errors))
}

/// The shipped robot without friction, its slider heavier by `extra` `[kg]`.
fn smooth(extra: f64) -> Result<Robot, PaperError> {
    let mut model = shipped(FITTED.robot)?.robot.model;
    for joint in &mut model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    model.bodies[0].mass += extra;
    Ok(Robot::new(model, Vec::new()))
}

/// Largest difference between the work of the drive and the robot's energy over five seconds without friction `[J]`.
fn energy_gap() -> Result<f64, PaperError> {
    let options = ConstrainedOptions { integrator: Integrator::RungeKutta, step_s: Some(DT), ..ConstrainedOptions::default() };
    let mut plant = ConstrainedPlant::try_new(smooth(0.0)?, &[0.03], options)?;
    let none = || PaperError::Other { what: "energy", reason: "the plant tells none".to_string() };
    let start = plant.stored_energy().ok_or_else(none)?;
    let (mut work, mut gap) = (0.0, 0.0_f64);
    for k in 0..5000 {
        // The force of a voltage of 4 V at 0.25 Hz.
        let w = core::f64::consts::FRAC_PI_2;
        let tau = B0 * 4.0 * w * math::cos(w * DT * f64::from(k));
        let before = plant.position()[0];
        plant.step(&[tau], DT)?;
        work += tau * (plant.position()[0] - before);
        gap = gap.max((plant.stored_energy().ok_or_else(none)? - start - work).abs());
    }
    Ok(gap)
}

/// Rows and picture of section 3.
pub(super) fn rows(progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let free = 1e9;
    let placed = ErrorGains::placed(POLES);
    let projected = follow((Plant::Constrained, Law::Projected, placed, free));
    let row = follow((Plant::Constrained, Law::Row, placed, free));
    let bracket = follow((Plant::Constrained, Law::Bracket, placed, free));
    let printed = follow((Plant::Constrained, Law::Projected, PRINTED, free));
    progress(0.2);
    let clear = "\"clearly indicate the control technique is able to track\"; a curve, no number";
    let what = |of: &str| format!("reference (11), rms of the error from 5 s, {of}, m");
    let told = |of: &str, ours: f64, width: f64, checked: f64| {
        Row::held_against("Figure 5", what(of), ours, None, (Gate::Within(width), checked)).conclusion_only(clear)
    };
    let mut rows = vec![
        Row::new("Figure 5", what("plant with multipliers, projected inertia"), projected.error, None, Gate::AtMost(1e-6)).because(clear),
        told("plant with multipliers, (8) with M11", row.error, 5e-6, 1.4e-4),
        told("plant with multipliers, (8) with the bracket as printed", bracket.error, 5e-6, 1.5e-4),
        told("plant with multipliers, kp and ki as printed", printed.error, 5e-7, 3.5e-5),
    ];
    rows.push(Row::new("Figure 5", what("the library's law on the library's plant"), on_the_whole_robot(0.0)?, None, Gate::AtMost(1e-6)));
    progress(0.6);
    let gap = energy_gap()?;
    rows.push(Row::new("eq. 2", "work of the drive less the robot's energy over 5 s, no friction, J", gap, None, Gate::AtMost(1e-8)));
    rows.extend(voltages(&row));
    progress(1.0);
    let reference = (0..200).map(|k| 0.1 * f64::from(k)).map(|t| (t, beat(t)[0])).collect();
    let plot = Plot {
        title: "Piston along (11) (Figure 5)".to_string(),
        x_label: "time, s".to_string(),
        y_label: "position of the piston, m".to_string(),
        lines: vec![
            Line { label: "reference".to_string(), points: reference },
            Line { label: "projected inertia".to_string(), points: projected.path },
            Line { label: "gains as printed".to_string(), points: printed.path },
        ],
    };
    Ok((rows, plot))
}

/// "These poles avoid input saturation": what the voltage does.
fn voltages(row: &Run) -> Vec<Row> {
    const LIMIT: f64 = 10.0;
    let (free, placed) = (1e9, ErrorGains::placed(POLES));
    let peak = (0..20_000).map(|k| beat(DT * f64::from(k))[1].abs()).fold(0.0, f64::max);
    let saturation =
        "\"these poles avoid input saturation\": the start is 41 mm from the reference, and the reference itself needs 10.4 V of 10";
    let integral = "u is the integral of every force that the plant leaves out; the even friction and C1 do not average to zero";
    let volts = |place: &'static str, what: &str, ours: f64, (width, checked): (f64, f64), why: &str| {
        Row::held_against(place, what, ours, Some(LIMIT), (Gate::Within(width), checked)).not_reproducible(why)
    };
    let of = |plant: Plant, gains: ErrorGains| follow((plant, Law::Row, gains, free));
    let [a, c] = [Plant::Row, Plant::Inverted].map(|plant| of(plant, placed));
    let printed = of(Plant::Inverted, PRINTED);
    let clipped = [Plant::Row, Plant::Constrained, Plant::Inverted].map(|plant| follow((plant, Law::Row, placed, LIMIT)));
    let mut rows = vec![
        volts("section 3", "voltage that reference (11) itself needs, V", peak / B1, (0.05, 10.4), saturation),
        volts("section 3", "largest voltage before 5 s from the printed start, placed gains, V", row.volts[0], (0.5, 30.0), saturation),
        volts("section 3", "largest voltage before 5 s, gains as printed, V", printed.volts[0], (0.5, 47.0), saturation),
        volts("Remark 1", "voltage after 20 s of (11), row 1 alone, V", a.volts[1], (0.5, 37.55), integral),
        volts("Remark 1", "voltage after 20 s of (11), what (8) inverts, V", c.volts[1], (0.5, 56.15), integral),
    ];
    rows.push(
        Row::held_against(
            "Figure 5",
            "rms of the error from 5 s within 10 V, plant with multipliers, m",
            clipped[1].error,
            None,
            (Gate::Within(5e-4), 8e-3),
        )
        .not_reproducible(saturation),
    );
    for (name, run) in [("row 1 alone", &clipped[0]), ("what (8) inverts", &clipped[2])] {
        let (what, ours) = if run.error.is_finite() {
            (format!("rms of the error from 5 s within 10 V, {name}, m"), run.error)
        } else {
            (format!("time at which the piston is a metre away within 10 V, {name}, s"), run.seconds)
        };
        rows.push(Row::new("Figure 5", what, ours, None, Gate::Told).not_reproducible(saturation));
    }
    let mass: f64 = MASSES.iter().sum();
    let mixed = "(10) takes d' = b1·u and (2) the integral of b0·u': two different robots, unless b0/b1 is the inertia that (8) inverts";
    rows.push(
        Row::held_against("eq. 10", "speed of plant (2) over b1·u", B0 / mass / B1, Some(1.0), (Gate::Within(5e-3), 0.754))
            .not_reproducible(mixed),
    );
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arceo2021::equations::SMOOTH;

    #[test]
    fn a_robot_that_is_not_the_controllers_is_followed_worse() {
        assert!(on_the_whole_robot(2.0).expect("runs") > 10.0 * on_the_whole_robot(0.0).expect("runs"));
    }

    #[test]
    fn without_friction_and_voltage_nothing_moves() {
        let rest: State = [FITTED.inverse_kinematics(START_PHI), [0.0; 3]];
        for plant in [Plant::Row, Plant::Constrained, Plant::Inverted] {
            let [q, v] = advance(plant, rest, 0.0, &SMOOTH);
            assert!((q[0] - rest[0][0]).abs() < 1e-15 && v[0].abs() < 1e-15);
        }
    }
}
