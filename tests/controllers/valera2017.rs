//! Valera et al. 2017: the velocity observer against the difference of positions on the 3-PRS robot, with friction and inertia that the
//! controller has wrong. The paper gives 7.29 % (0.016 m/s) and 1.98 % (0.004 m/s).

use pkm_ctrl::observer::{CommandedAcceleration, Discretisation, FirstDifference, VelocityObserver};
use pkm_ctrl::{ComputedTorque, ComputedTorqueConfig, Controller, Input};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_dyn::{InertialParameters, Model};
use pkm_sim::{Plant, ReducedPlant};
use pkm_tests::Draw;
use pkm_tests::closed_loop::shipped_robot;

const TS: f64 = 0.01;
const PERIODS: u32 = 1200;

/// Coulomb and viscous friction of the sliders, from a recording of the real robot.
const COULOMB: [f64; 3] = [105.0, 160.0, 127.0];
const VISCOUS: [f64; 3] = [2242.0, 2170.0, 1873.0];

/// The robot with friction times `friction` and masses times `mass`; rotors as they are.
fn robot(friction: f64, mass: f64) -> Robot {
    let mut model: Model = shipped_robot("prs3").model;
    for (k, j) in model.actuators.clone().into_iter().enumerate() {
        model.joints[j].coulomb = friction * COULOMB[k];
        model.joints[j].viscous = friction * VISCOUS[k];
    }
    for body in &mut model.bodies {
        *body = InertialParameters::from_vector(&(body.to_vector() * mass));
    }
    Robot::new(model, Vec::new())
}

/// Four seconds per period, each slider with a third harmonic.
fn reference(t: f64) -> [[f64; 3]; 3] {
    let w = core::f64::consts::PI / 2.0;
    let part = |k: usize| (0.05, [0.012, -0.006, -0.006][k], [0.0, 0.4, -0.4][k]);
    let row = |f: &dyn Fn(f64, f64, f64) -> f64| core::array::from_fn(|k| f(part(k).0, part(k).1, part(k).2));
    [
        row(&|a, b, p| 0.1 + a * math::sin(w * t + p) - a * math::sin(p) + b * math::sin(3.0 * w * t)),
        row(&|a, b, p| a * w * math::cos(w * t + p) + 3.0 * w * b * math::cos(3.0 * w * t)),
        row(&|a, b, p| -a * w * w * math::sin(w * t + p) - 9.0 * w * w * b * math::sin(3.0 * w * t)),
    ]
}

/// How positions are measured.
#[derive(Clone, Copy)]
struct Sensor {
    noise: f64,
    quantum: f64,
}

/// Of slider 1 from 4 s to 12 s.
#[derive(Debug, Clone, Copy)]
struct Result {
    /// Standard deviation of the velocity estimate against the reference, over the reference's range.
    velocity: f64,
    /// Lag of the estimate's fundamental behind the reference `[rad]`.
    lag: f64,
    /// Standard deviation of the position against the reference `[m]`.
    position: f64,
    /// Root mean square of the command's increments `[N]`.
    increment: f64,
}

fn run<O: VelocityObserver<3>>(observer: O, [kp, kd]: [f64; 2], sensor: Sensor) -> Result {
    let config = ComputedTorqueConfig { kp: [kp; 3], kd: [kd; 3], creep: 0.002, ..ComputedTorqueConfig::with_bandwidth(1.0, [5000.0; 3]) };
    let law = ComputedTorque::try_new(robot(0.97, 1.05), observer, config).expect("good numbers");
    let [start, moving, _] = reference(0.0);
    let mut plant = ReducedPlant::try_new(robot(1.0, 1.0), &start).expect("the loops close");
    plant.set_velocity(&moving);
    let mut state = law.in_motion(&start, &moving);
    let (mut draw, mut rows) = (Draw::new(17), Vec::new());
    for k in 0..PERIODS {
        let t = TS * f64::from(k);
        let [q_ref, v_ref, a_ref] = reference(t);
        let q_meas = core::array::from_fn(|i| {
            let q = plant.position()[i] + sensor.noise * normal(&mut draw);
            if sensor.quantum > 0.0 { math::round(q / sensor.quantum) * sensor.quantum } else { q }
        });
        let command = law.step(&mut state, &Input { q_ref, v_ref, a_ref, ..Input::standing(q_meas, TS) });
        assert!(!command.health.is_faulted && !command.health.is_saturated, "{t}: {command:?}");
        if t >= 4.0 {
            rows.push([t, plant.position()[0], state.v_hat[0], command.tau[0], q_ref[0], v_ref[0]]);
        }
        for _ in 0..4 {
            plant.step(&command.tau, 0.25 * TS).expect("moves");
        }
    }
    evaluate(&rows)
}

/// Standard normal, by Box and Muller.
fn normal(draw: &mut Draw) -> f64 {
    let radius = math::sqrt(-2.0 * math::ln(1.0 - draw.uniform(0.0..1.0)));
    radius * math::cos(core::f64::consts::TAU * draw.uniform(0.0..1.0))
}

fn evaluate(rows: &[[f64; 6]]) -> Result {
    let column = |i: usize| rows.iter().map(|r| r[i]).collect::<Vec<f64>>();
    let (v_hat, tau, v_ref) = (column(2), column(3), column(5));
    let of = |a: &[f64], b: &[f64]| deviation(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>());
    let range = v_ref.iter().fold(f64::MIN, |top, x| top.max(*x)) - v_ref.iter().fold(f64::MAX, |low, x| low.min(*x));
    let steps: Vec<f64> = tau.windows(2).map(|w| w[1] - w[0]).collect();
    let phase = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let sum =
            |f: &dyn Fn(f64) -> f64| -> f64 { rows.iter().zip(x).map(|(r, x)| (x - mean) * f(r[0] * core::f64::consts::PI / 2.0)).sum() };
        math::atan2(-sum(&math::sin), sum(&math::cos))
    };
    Result {
        velocity: of(&v_hat, &v_ref) / range,
        lag: phase(&v_ref) - phase(&v_hat),
        position: of(&column(1), &column(4)),
        increment: crate::rms(&steps),
    }
}

fn deviation(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    crate::rms(&x.iter().map(|x| x - mean).collect::<Vec<f64>>())
}

fn observer(bandwidth: f64) -> CommandedAcceleration<3> {
    CommandedAcceleration::try_new([bandwidth; 3], Discretisation::Euler).expect("positive")
}

// DIFFERENCE The paper's lags (16.8 and 4.9 degrees) and its gain in position (2.0 to 0.93 mm) belong to a filter it does not state and
// to friction it does not give; the ratio of the velocity errors, 3.7 there, is what a simulation of its equations reproduces.
#[test]
fn the_observer_is_three_times_quieter_than_the_difference_and_lags_a_third_as_much() {
    let sensor = Sensor { noise: 1.1e-4, quantum: 2e-5 };
    let (difference, observed) = (run(FirstDifference, [100.0, 20.0], sensor), run(observer(15.0), [100.0, 20.0], sensor));
    assert!(difference.velocity / observed.velocity >= 3.0, "{difference:?} {observed:?}");
    assert!(difference.lag.abs() / observed.lag.abs() >= 3.0, "{difference:?} {observed:?}");
    assert!(observed.increment < difference.increment, "{difference:?} {observed:?}");
    assert!(observed.position <= 1.2 * difference.position, "{difference:?} {observed:?}");
    // Sizes of an independent simulation (numpy, other random numbers): 6.11 % and 1.49 %.
    assert!((0.05..0.075).contains(&difference.velocity) && (0.011..0.02).contains(&observed.velocity), "{difference:?} {observed:?}");
}

#[test]
fn quantisation_alone_does_not_explain_the_published_error_of_the_difference() {
    let sensor = Sensor { noise: 0.0, quantum: 2e-5 };
    let (difference, observed) = (run(FirstDifference, [400.0, 40.0], sensor), run(observer(60.0), [400.0, 40.0], sensor));
    // An independent simulation (numpy) has 0.93 % and 0.60 %; the paper 7.29 % and 1.98 %.
    assert!((0.008..0.011).contains(&difference.velocity) && (0.005..0.007).contains(&observed.velocity), "{difference:?} {observed:?}");
}
