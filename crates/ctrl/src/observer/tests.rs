//! Noise gains, decay of errors and finite convergence of every velocity observer.

use alloc::string::ToString;
use alloc::vec::Vec;

use pkm_dyn::math;

use super::*;
use crate::controller::Input;

fn sample(q: f64, a_cmd: f64, dt: f64) -> Sample<1> {
    Sample { q_meas: [q], a_cmd: [a_cmd], tau: [0.0], dt }
}

/// Standard deviation of the velocity per unit of white position noise, from the response to a unit pulse: exact for a linear observer.
fn noise_gain<O: VelocityObserver<1>>(observer: &O, dt: f64) -> f64 {
    let mut state = observer.at_rest();
    observer.reset_to(&mut state, &[0.0], &[0.0]);
    let pulse = |k: i32| if k == 0 { 1.0 } else { 0.0 };
    let energy: f64 = (0..20_000).map(|k| observer.step(&mut state, &sample(pulse(k), 0.0, dt))[0]).map(|v| v * v).sum();
    math::sqrt(energy)
}

#[test]
fn noise_gains_of_difference_and_model_based_observer_are_those_of_the_table() {
    assert!((noise_gain(&FirstDifference, 0.01) - 141.4).abs() < 0.05);
    for (bandwidth, want) in [(15.0, 32.0), (20.0, 43.6), (25.0, 55.9), (40.0, 96.5), (60.0, 163.0)] {
        let observer = CommandedAcceleration::try_new([bandwidth], Discretisation::Euler).expect("positive");
        let got = noise_gain(&observer, 0.01);
        assert!((got - want).abs() < 0.006 * want, "{bandwidth}: {got}");
    }
}

#[test]
fn the_filtered_derivative_has_the_noise_gain_of_its_closed_form() {
    let (time_s, dt) = (0.03, 0.01);
    let share = 1.0 - math::exp(-dt / time_s);
    // Pulse response share·(1, −1·share, …)/dt: sum of squares 2·share²/(2 − share)/dt².
    let want = share / dt * math::sqrt(2.0 / (2.0 - share));
    let got = noise_gain(&FilteredDerivative::try_new([time_s]).expect("positive"), dt);
    assert!((got - want).abs() < 1e-9 * want, "{got} {want}");
}

/// Errors of the velocity along `q'' = a` with `a` held over periods, after a start `q`, `v` that the observer does not know.
fn errors<O: VelocityObserver<1>>(observer: &O, start: [f64; 2], a_known: f64, periods: usize) -> Vec<f64> {
    let dt = 0.01;
    let (mut q, mut v, mut a) = (start[0], start[1], 0.0);
    let mut state = observer.at_rest();
    observer.reset_to(&mut state, &[0.0], &[0.0]);
    let mut out = Vec::new();
    for k in 0..periods {
        out.push(observer.step(&mut state, &sample(q, a_known * a, dt))[0] - v);
        a = 3.0 * math::sin(0.37 * k as f64);
        q += dt * v + 0.5 * dt * dt * a;
        v += dt * a;
    }
    out
}

/// Largest violation of the recursion with characteristic polynomial `(z − pole)^order` from the sample `order` on.
fn recursion_gap(errors: &[f64], pole: f64, order: usize) -> f64 {
    let apply = |x: &[f64]| -> Vec<f64> { x.windows(2).map(|w| w[1] - pole * w[0]).collect() };
    let left = (0..order).fold(errors.to_vec(), |x, _| apply(&x));
    left[1..].iter().fold(0.0, |top, x| x.abs().max(top))
}

#[test]
fn with_the_acceleration_known_errors_decay_as_the_characteristic_polynomial_says() {
    let (bandwidth, dt) = (20.0, 0.01);
    let pole = math::exp(-bandwidth * dt);
    let linear = CommandedAcceleration::try_new([bandwidth], Discretisation::ZeroOrderHold).expect("positive");
    let of_linear = errors(&linear, [0.02, -0.7], 1.0, 300);
    assert!(recursion_gap(&of_linear, pole, 2) < 1e-13 && of_linear[0].abs() > 0.5);
    assert!(of_linear[299].abs() < 1e-12, "{}", of_linear[299]);
    let of_eso = errors(&ExtendedState::try_new([bandwidth]).expect("positive"), [0.02, -0.7], 1.0, 300);
    assert!(recursion_gap(&of_eso, pole, 3) < 1e-13);
    assert!(of_eso[299].abs() < 1e-12, "{}", of_eso[299]);
    // And a wrong pole is noticed.
    assert!(recursion_gap(&of_linear, 0.99 * pole, 2) > 1e-3);
}

#[test]
fn euler_errors_decay_with_poles_at_one_minus_bandwidth_times_period() {
    let observer = CommandedAcceleration::try_new([20.0], Discretisation::Euler).expect("positive");
    let mut state = observer.at_rest();
    observer.reset_to(&mut state, &[0.0], &[0.0]);
    // A robot of forward differences, for which the observer's model is exact.
    let (mut q, mut v, mut a, dt) = (0.02, -0.7, 0.0, 0.01);
    let mut errors = Vec::new();
    for k in 0..300 {
        errors.push(observer.step(&mut state, &sample(q, a, dt))[0] - v);
        a = 3.0 * math::sin(0.37 * f64::from(k));
        q += dt * v;
        v += dt * a;
    }
    assert!(recursion_gap(&errors, 0.8, 2) < 1e-13);
}

#[test]
fn the_alpha_beta_filter_forgets_with_both_poles_at_its_bandwidth() {
    let observer = AlphaBeta::try_new([20.0]).expect("positive");
    let mut state = observer.at_rest();
    observer.reset_to(&mut state, &[0.0], &[0.0]);
    let errors: Vec<f64> = (0..300).map(|k| observer.step(&mut state, &sample(0.02 - 0.007 * f64::from(k), 0.0, 0.01))[0] + 0.7).collect();
    assert!(recursion_gap(&errors, math::exp(-0.2), 2) < 1e-13 && errors[299].abs() < 1e-12);
}

#[test]
fn kalman_gains_are_the_fixed_point_of_the_riccati_recursion() {
    for (sigma_q, sigma_a, t) in [(1e-4, 2.0, 0.01), (1e-5, 50.0, 1e-3), (1e-3, 0.5, 0.02)] {
        let observer = Kalman::try_new([sigma_q], [sigma_a]).expect("positive");
        let [alpha, beta] = observer.gains(0, t);
        let (mut p, r) = ([sigma_q * sigma_q, 0.0, 1.0], sigma_q * sigma_q);
        let mut gain = [0.0; 2];
        for _ in 0..20_000 {
            // Predict with F = [1 t; 0 1] and noise sigma_a² of g = (t²/2, t), then correct.
            let (g, s2) = ([0.5 * t * t, t], sigma_a * sigma_a);
            let m = [p[0] + 2.0 * t * p[1] + t * t * p[2] + s2 * g[0] * g[0], p[1] + t * p[2] + s2 * g[0] * g[1], p[2] + s2 * g[1] * g[1]];
            gain = [m[0] / (m[0] + r), m[1] / (m[0] + r)];
            p = [(1.0 - gain[0]) * m[0], (1.0 - gain[0]) * m[1], m[2] - gain[1] * m[1]];
        }
        assert!((gain[0] - alpha).abs() < 1e-9 && (gain[1] * t - beta).abs() < 1e-9, "{gain:?} {alpha} {beta}");
    }
}

#[test]
fn the_extended_state_observer_finds_a_constant_missing_acceleration() {
    let observer = ExtendedState::try_new([30.0]).expect("positive");
    let mut state = observer.at_rest();
    let (mut q, mut v, dt) = (0.1, 0.0, 0.002);
    for _ in 0..1000 {
        let _ = observer.step(&mut state, &sample(q, 1.5, dt));
        let a = 1.5 - 4.0;
        q += dt * v + 0.5 * dt * dt * a;
        v += dt * a;
    }
    assert!((state.drives[0].z[2] + 4.0).abs() < 1e-9, "{:?}", state.drives);
}

#[test]
fn super_twisting_is_exact_after_finite_time_up_to_its_own_ripple() {
    let (bound, dt) = (10.0, 1e-3);
    let observer = SuperTwisting::try_new([bound]).expect("positive");
    let mut state = observer.at_rest();
    let mut worst = 0.0_f64;
    for k in 0..4000 {
        let t = dt * f64::from(k);
        let got = observer.step(&mut state, &sample(0.8 * math::sin(3.0 * t), 0.0, dt))[0];
        if t > 1.0 {
            worst = worst.max((got - 2.4 * math::cos(3.0 * t)).abs());
        }
    }
    assert!(worst < 4.0 * bound * dt, "{worst}");
}

#[test]
fn every_observer_starts_standing_and_takes_over_motion() {
    fn check<O: VelocityObserver<1>>(observer: &O, tolerance: f64) {
        let mut state = observer.at_rest();
        assert!(observer.step(&mut state, &sample(0.3, 0.0, 0.01))[0].abs() < 1e-15);
        observer.reset_to(&mut state, &[0.3], &[0.5]);
        let got = observer.step(&mut state, &sample(0.305, 0.0, 0.01))[0];
        assert!((got - 0.5).abs() < tolerance, "{got}");
    }
    check(&FirstDifference, 1e-12);
    check(&FilteredDerivative::try_new([0.02]).expect("positive"), 1e-12);
    check(&AlphaBeta::try_new([20.0]).expect("positive"), 1e-12);
    check(&Kalman::try_new([1e-4], [1.0]).expect("positive"), 1e-12);
    check(&SuperTwisting::try_new([1.0]).expect("positive"), 0.012);
    check(&CommandedAcceleration::try_new([20.0], Discretisation::ZeroOrderHold).expect("positive"), 1e-12);
    check(&ExtendedState::try_new([20.0]).expect("positive"), 1e-12);
}

#[test]
fn numbers_that_cannot_be_used_are_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(AlphaBeta::try_new([bad]).is_err() && SuperTwisting::try_new([bad]).is_err() && ExtendedState::try_new([bad]).is_err());
        assert!(Kalman::try_new([bad], [1.0]).is_err() && Kalman::try_new([1.0], [bad]).is_err());
        assert!(CommandedAcceleration::try_new([bad], Discretisation::Euler).is_err());
    }
    assert!(FilteredDerivative::try_new([-1.0]).is_err());
    let error = AlphaBeta::try_new([20.0, f64::NAN]).expect_err("not a number");
    assert_eq!(error.to_string(), "drive 1: bandwidth = NaN (must be finite and > 0)");
}

/// Largest errors of the velocity along a sine whose acceleration the observer hears of, before and after positions were missing for so
/// many periods, carried on meanwhile at the speed of the last two; `way` is one period of the observer.
fn errors_about_a_gap<O: VelocityObserver<1>>(
    observer: &O,
    missing: u32,
    mut way: impl FnMut(&mut O::State, &Input<1>, [f64; 1]) -> [f64; 1],
) -> [f64; 2] {
    let dt = 1e-3;
    let at = |k: u32| math::sin_cos(3.0 * dt * f64::from(k));
    let (mut state, mut worst) = (observer.at_rest(), [0.0_f64; 2]);
    observer.reset_to(&mut state, &[at(0).0], &[3.0]);
    for k in 1..3000_u32 {
        // To where the acceleration is largest, and carrying on is worst.
        let lost = k.saturating_sub(2600);
        let is_lost = (1..=missing).contains(&lost);
        let q = if is_lost { at(2600).0 + f64::from(lost) * (at(2600).0 - at(2599).0) } else { at(k).0 };
        let q_dt = if is_lost { 0.0 } else { dt * f64::from(if lost == missing + 1 { lost } else { 1 }) };
        let v = way(&mut state, &Input { q_dt, ..Input::standing([q], dt) }, [-9.0 * at(k - 1).0])[0];
        let after = usize::from(lost > missing);
        if k > 500 && !is_lost {
            worst[after] = worst[after].max((v - 3.0 * at(k).1).abs());
        }
    }
    worst
}

#[test]
fn velocities_do_not_leap_at_the_end_of_a_gap() {
    fn check<O: VelocityObserver<1>>(name: &str, observer: &O) -> [f64; 2] {
        [5, 50].map(|missing| {
            let mut gap = Gap::default();
            let way = |state: &mut O::State, input: &Input<1>, a_cmd| gap.observe(observer, state, input, [a_cmd, [0.0]]);
            let [before, after] = errors_about_a_gap(observer, missing, way);
            // What the drive, at up to 9 m/s², has changed its velocity by within the gap.
            let most = before + 9.0 * 1e-3 * f64::from(missing + 1);
            assert!(after < most, "{name}, {missing} missing: {after}, {most} allowed");
            most
        })
    }
    check("filtered derivative", &FilteredDerivative::try_new([0.01]).expect("positive"));
    check("alpha-beta", &AlphaBeta::try_new([100.0]).expect("positive"));
    check("Kalman", &Kalman::try_new([1e-4], [20.0]).expect("positive"));
    check("super-twisting", &SuperTwisting::try_new([20.0]).expect("positive"));
    check("commanded acceleration", &CommandedAcceleration::try_new([100.0], Discretisation::ZeroOrderHold).expect("positive"));
    check("commanded velocity", &CommandedVelocity);
    check("extended state", &ExtendedState::try_new([100.0]).expect("positive"));
    // Taken for the way of one period, the way of a gap is a leap of many times that.
    let most = check("first difference", &FirstDifference)[1];
    let one = |state: &mut Estimate<1>, input: &Input<1>, a_cmd: [f64; 1]| {
        FirstDifference.step(state, &sample(input.q_meas[0], a_cmd[0], input.dt))
    };
    let leap = errors_about_a_gap(&FirstDifference, 50, one)[1];
    assert!(leap > 10.0 * most, "{leap} without, {most} with");
}

#[test]
fn a_stall_of_the_loop_is_no_leap_either() {
    let (mut gap, mut state) = (Gap::default(), Estimate::<1>::default());
    let mut observe = |q, dt, q_dt| gap.observe(&FirstDifference, &mut state, &Input { q_dt, ..Input::standing([q], dt) }, [[0.0]; 2])[0];
    for k in 0..4 {
        let _ = observe(0.7e-3 * f64::from(k), 1e-3, 1e-3);
    }
    // Eleven periods passed, of which no more than five are told: the way took eleven.
    assert!((observe(0.7e-3 * 14.0, 5e-3, 11e-3) - 0.7).abs() < 1e-9);
    // A way that took as long as was told is left to the observer.
    assert!((observe(0.7e-3 * 14.0 + 1e-3, 1e-3, 1.2e-3) - 1.0).abs() < 1e-9);
}
