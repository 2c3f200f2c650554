use super::*;
use crate::random::{Random, Stream};

fn ankle() -> Limb {
    let mut limb = Limb::free(Pose::from_xyz_rpy([0.1, -0.2, 0.3], [0.2, -0.4, 0.5]));
    for (i, axis) in limb.axes.iter_mut().enumerate() {
        let i = i as f64;
        let stops = EndStops { lower: -0.3, upper: 0.4, stiffness: 900.0, exponent: 2.0, damping: 0.8 };
        *axis = Impedance { stiffness: 20.0 + 7.0 * i, damping: 0.4 + 0.1 * i, rest: 0.03 * i, stops };
    }
    limb
}

fn undamped() -> Limb {
    let mut limb = ankle();
    for axis in &mut limb.axes {
        (axis.damping, axis.stops.damping) = (0.0, 0.0);
    }
    limb
}

/// A pose and the velocity, in the frame itself, along a closed path of period 1, by central differences of the pose.
fn on_path(t: f64) -> (Pose, Motion) {
    let pose = |t: f64| {
        let wave = |k: f64, phase: f64| math::sin(2.0 * core::f64::consts::PI * k * t + phase);
        let xyz = [0.1 + 0.5 * wave(1.0, 0.0), -0.2 + 0.4 * wave(2.0, 1.0), 0.3 + 0.5 * wave(1.0, 2.0)];
        Pose::from_xyz_rpy(xyz, [0.9 * wave(1.0, 0.3), 0.8 * wave(2.0, 0.7), 1.1 * wave(1.0, 1.9)])
    };
    let h = 1e-5;
    let (before, now, after) = (pose(t - h), pose(t), pose(t + h));
    let linear = now.rotation.tr_mul(&((after.translation - before.translation) / (2.0 * h)));
    let turn = Pose { rotation: before.rotation.tr_mul(&after.rotation), ..Pose::identity() }.rotation_vector();
    (now, Motion { linear, angular: turn / (2.0 * h) })
}

/// Work done by the limb on the robot once round the path.
fn work_round(limb: &Limb) -> f64 {
    let n = 4000;
    // The trapezium rule on a period converges as fast as the integrand is smooth; end stops are, to the first derivative.
    (0..n).map(|k| on_path(f64::from(k) / f64::from(n))).map(|(x, v)| v.dot(&limb.wrench(&x, &v, &[0.0; 6]))).sum::<f64>() / f64::from(n)
}

#[test]
fn without_damping_a_closed_path_yields_nothing_and_with_it_the_robot_pays() {
    let (free, paid) = (work_round(&undamped()), work_round(&ankle()));
    assert!(paid < -1.0 && free.abs() < 1e-9 * paid.abs(), "{free} J, {paid} J");
}

#[test]
fn power_is_the_energy_that_is_lost_and_what_the_dampers_take() {
    let limb = ankle();
    for k in 0..200 {
        let t = 0.005 * f64::from(k);
        let (pose, velocity) = on_path(t);
        let h = 1e-5;
        let stored = (limb.energy(&on_path(t + h).0) - limb.energy(&on_path(t - h).0)) / (2.0 * h);
        let power = velocity.dot(&undamped().wrench(&pose, &velocity, &[0.0; 6]));
        let scale = 1.0 + stored.abs();
        assert!((power + stored).abs() < 1e-5 * scale, "t = {t}: {power} W, stored {stored} W");
        let damped = velocity.dot(&limb.wrench(&pose, &velocity, &[0.0; 6]));
        assert!(damped <= power + 1e-9 * scale, "dampers take");
    }
}

#[test]
fn a_mass_thrown_into_the_end_stops_never_gains_energy() {
    let axis = ankle().axes[3];
    let (mass, h) = (0.02, 1e-5);
    let (mut q, mut v, mut last) = (0.0, 12.0, f64::INFINITY);
    for step in 0..200_000 {
        // Runge-Kutta 4: its own error per step is far below what is taken.
        let a = |q: f64, v: f64| axis.effort(q, v) / mass;
        let (k1, l1) = (v, a(q, v));
        let (k2, l2) = (v + 0.5 * h * l1, a(q + 0.5 * h * k1, v + 0.5 * h * l1));
        let (k3, l3) = (v + 0.5 * h * l2, a(q + 0.5 * h * k2, v + 0.5 * h * l2));
        let (k4, l4) = (v + h * l3, a(q + h * k3, v + h * l3));
        q += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        v += h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4);
        let energy = 0.5 * mass * v * v + axis.energy(q);
        assert!(energy <= last + 1e-12, "step {step}: {energy} J after {last} J");
        last = energy;
    }
    assert!(last < 1e-6 && (q - axis.rest).abs() < 1e-3, "at rest: {last} J at {q}");
}

#[test]
fn end_stops_begin_softly_harden_and_never_pull() {
    let stops = EndStops { lower: -0.3, upper: 0.4, stiffness: 900.0, exponent: 2.0, damping: 0.8 };
    assert!(stops.effort(0.4, 5.0).abs() <= 0.0 && stops.effort(0.0, 5.0).abs() <= 0.0);
    assert!((stops.effort(0.5, 0.0) + 900.0 * 0.01).abs() < 1e-12);
    assert!((stops.effort(0.6, 0.0) + 900.0 * 0.04).abs() < 1e-12);
    assert!((stops.effort(-0.5, -1.0) - 900.0 * 0.04 * 1.8).abs() < 1e-12);
    assert!(stops.effort(0.6, -100.0).abs() <= 0.0);
    let bad = EndStops { exponent: 0.5, ..stops };
    assert!(bad.check().is_err() && EndStops { upper: -0.5, ..stops }.check().is_err() && stops.check().is_ok());
    assert!(Limb { axes: [Impedance { damping: -1.0, ..Impedance::FREE }; 6], ..ankle() }.check().is_err());
}

#[test]
fn small_displacements_are_plain_springs_and_a_limb_at_rest_does_nothing() {
    let limb = Limb { axes: ankle().axes.map(|axis| Impedance { rest: 0.0, ..axis }), ..ankle() };
    let force = limb.wrench(&limb.rest, &Motion::zero(), &[0.0; 6]);
    assert!(force.linear.norm() + force.angular.norm() < 1e-12);
    let dx = 1e-6;
    let moved = limb.rest.compose(&Pose::from_xyz_rpy([dx, 0.0, 0.0], [0.0, 0.0, 2.0 * dx]));
    let force = limb.wrench(&moved, &Motion::zero(), &[0.0; 6]);
    assert!((force.linear.x + 20.0 * dx).abs() < 1e-10 && (force.angular.z + 55.0 * 2.0 * dx).abs() < 1e-10);
    let pushed = limb.wrench(&limb.rest, &Motion::zero(), &[1.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    assert!((pushed.linear.x - 1.0).abs() < 1e-12 && (pushed.angular.y - 2.0).abs() < 1e-12);
}

#[test]
fn the_limbs_inertia_is_that_of_a_body() {
    let inertia = Inertia { mass: 2.0, first_moment: Vector3::new(0.0, 0.2, 0.0), rotational: Matrix3::from_diagonal_element(0.3) };
    let limb = Limb { inertia, ..Limb::free(Pose::identity()) };
    let fall = Motion { linear: Vector3::new(0.0, 0.0, 3.0), angular: Vector3::zeros() };
    let force = limb.inertia_wrench(&Motion::zero(), &fall);
    // Against a push along z: −m·a, and about x −h·a.
    assert!((force.linear.z + 6.0).abs() < 1e-12 && (force.angular.x + 0.6).abs() < 1e-12);
    let spin = Motion { linear: Vector3::zeros(), angular: Vector3::new(0.0, 0.0, 4.0) };
    // Turning evenly about z with the mass at y: it pulls outward, along y, with m·r·ω² = 0.2·16.
    assert!((limb.inertia_wrench(&spin, &Motion::zero()).linear.y - 3.2).abs() < 1e-12);
}

fn person(config: PatientConfig, seed: u64) -> Patient {
    Patient::try_new(config, seed).unwrap()
}

/// Tremor alone, `n` samples `h` apart.
fn tremor(config: PatientConfig, seed: u64, n: usize, h: f64) -> Vec<f64> {
    let mut patient = person(config, seed);
    (0..n)
        .map(|_| {
            patient.advance(h);
            patient.efforts(&[0.0; 6], &[0.0; 6])[2]
        })
        .collect()
}

#[test]
fn tremor_has_its_strength_and_nearly_all_of_it_between_four_and_eight_hertz() {
    let config = PatientConfig { tremor: [0.0, 0.0, 3.0, 0.0, 0.0, 0.0], tremor_width: 0.25, ..PatientConfig::default() };
    let (h, n, runs) = (0.02, 512_u32, 100);
    let pi = core::f64::consts::PI;
    let (mut total, mut inside) = (0.0, 0.0);
    let circle: Vec<[f64; 2]> =
        (0..n).map(|i| 2.0 * pi * f64::from(i) / f64::from(n)).map(|angle| [math::cos(angle), math::sin(angle)]).collect();
    for seed in 0..runs {
        let x = tremor(config, seed, n as usize, h);
        // Hann's window keeps the skirts of a line from filling the spectrum.
        let window = |i: u32| 0.5 * (1.0 - math::cos(2.0 * pi * f64::from(i) / f64::from(n)));
        let x: Vec<f64> = (0..n).zip(x).map(|(i, x)| window(i) * x).collect();
        for k in 1..n / 2 {
            let frequency = f64::from(k) / (f64::from(n) * h);
            let (mut re, mut im) = (0.0, 0.0);
            for (i, x) in (0_u32..).zip(&x) {
                let [c, s] = circle[usize::try_from(k * i % n).unwrap()];
                (re, im) = (re + x * c, im + x * s);
            }
            let power = (re * re + im * im) * 2.0 / (f64::from(n) * f64::from(n) * 0.375);
            total += power;
            inside += if (4.0..=8.0).contains(&frequency) { power } else { 0.0 };
        }
    }
    // Variance 9; independent for about 1/(2π·width) each: 100 runs of 10 s are 1600 of them.
    let variance = total / f64::from(u32::try_from(runs).unwrap());
    assert!((variance / 9.0 - 1.0).abs() < 5.0 * f64::sqrt(2.0 / 1600.0), "{variance}");
    // A Lorentz line of half width w about f₀ has (2/π)·atan(2/w) of its power within f₀ ± 2 Hz.
    let want = 2.0 / pi * math::atan2(2.0, 0.25);
    assert!((inside / total - want).abs() < 0.02, "{} within, not {want}", inside / total);
}

#[test]
fn tremor_remembers_as_its_closed_form_says_in_steps_of_any_length() {
    let config = PatientConfig { tremor: [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], ..PatientConfig::default() };
    for (h, lag) in [(0.01, 5_usize), (0.05, 1)] {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..400 {
            let x = tremor(config, seed, lag + 1, h);
            let mut patient = person(config, seed + 1000);
            patient.advance(h);
            (sum, count) = (sum + x[0] * x[lag], count + 1.0);
        }
        // exp(−2π·0.5·0.05)·cos(2π·6·0.05); the standard error of a mean of products of unit normals is below sqrt(2/n).
        let want = math::exp(-core::f64::consts::PI * 0.05) * math::cos(2.0 * core::f64::consts::PI * 0.3);
        assert!((sum / count - want).abs() < 4.0 * f64::sqrt(2.0 / count), "h = {h}: {} not {want}", sum / count);
    }
}

#[test]
fn a_person_who_resists_takes_and_one_who_assists_gives() {
    let config = PatientConfig { strength: [5.0; 6], ..PatientConfig::default() };
    let mut random = Random::new(1, Stream::Hidden);
    let [mut resists, mut assists] = [Will::Resists, Will::Assists].map(|will| person(PatientConfig { will, variation: 0.8, ..config }, 3));
    let (mut given, mut taken) = (0.0, 0.0);
    for _ in 0..20_000 {
        resists.advance(1e-2);
        assists.advance(1e-2);
        let v = [random.uniform(-1.0, 1.0); 6];
        let power = |efforts: [f64; 6]| efforts[0] * v[0];
        let (take, give) = (power(resists.efforts(&v, &[0.0; 6])), power(assists.efforts(&v, &v)));
        assert!(take <= 0.0 && give >= 0.0);
        (taken, given) = (taken - take, given + give);
    }
    assert!(taken > 1000.0 && given > 1000.0);
    let passive = person(config, 3);
    assert!(passive.efforts(&[1.0; 6], &[1.0; 6]).iter().all(|x| x.abs() <= 0.0));
    // At the stated speed 71 % of the mean strength, when it does not vary.
    let steady = person(PatientConfig { will: Will::Resists, variation: 0.0, ..config }, 3);
    assert!((steady.efforts(&[0.05; 6], &[0.0; 6])[0] + 5.0 * core::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
}

#[test]
fn one_seed_is_one_person_and_nonsense_is_none() {
    let config = PatientConfig { tremor: [1.0; 6], ..PatientConfig::default() };
    assert_eq!(tremor(config, 5, 100, 1e-3), tremor(config, 5, 100, 1e-3));
    assert!(tremor(config, 5, 100, 1e-3) != tremor(config, 6, 100, 1e-3));
    for bad in [
        PatientConfig { speed: 0.0, ..config },
        PatientConfig { tremor_width: -1.0, ..config },
        PatientConfig { strength: [f64::NAN; 6], ..config },
        PatientConfig { variation_time: 0.0, ..config },
    ] {
        assert!(Patient::try_new(bad, 1).is_err());
    }
}
