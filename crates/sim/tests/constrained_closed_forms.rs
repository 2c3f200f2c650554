//! The constrained plant against equations that fit on a line.

mod fixture;

use core::f64::consts::PI;

use fixture::{blocks, coulomb, double_pendulum, entry, frictionless, plant, run, stated};
use pkm_dyn::effects::{Applied, Entry, JointState, Law, LinkState, Memory, PlaceKind, Robot, Transmission};
use pkm_dyn::loops::mid_pose;
use pkm_dyn::math;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Integrator, Plant};

const WEIGHTLESS: [f64; 3] = [0.0; 3];
const SMOOTH: [Integrator; 3] = [Integrator::RungeKutta, Integrator::Radau, Integrator::Gauss];

static PLAY: Entry = entry("play", PlaceKind::Joint, Law::Transmission(Transmission::Play));
static ELASTIC: Entry = entry("elastic", PlaceKind::Joint, Law::Transmission(Transmission::Spring));
static STRUCTURE: Entry = entry("structure", PlaceKind::Link, Law::Structure);
static PULLED: Entry = entry("pulled", PlaceKind::Joint, Law::JointEffort(pulled));
static TWO_LEVELS: Entry = entry("two levels", PlaceKind::Joint, Law::JointEffort(two_levels));
static GEARED: Entry = entry("geared", PlaceKind::JointPair, Law::PairEffort(geared));
static STEP: Entry = entry("step", PlaceKind::Link, Law::Wrench(step_along_x));
static DAHL: Entry = entry("dahl", PlaceKind::Joint, Law::Memory(Memory { rate: dahl_rate, effort: dahl_effort }));

/// A spring `a` whose far end moves with `b` m/s.
fn pulled(p: &[f64], s: &JointState) -> f64 {
    p[0] * (s.q - p[1] * s.time)
}

/// Level `a` at rest, `b` in motion.
fn two_levels(p: &[f64], s: &JointState) -> f64 {
    if s.v.abs() < 1e-7 { p[0] * s.sign } else { p[1] * s.sign }
}

/// Inertia `a`, viscous `b`, Coulomb `c` of something that turns with both.
fn geared(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.a + p[1] * s.v + p[2] * s.sign
}

/// A force `a` of the environment along x as soon as the motion has begun.
fn step_along_x(p: &[f64], s: &LinkState) -> [f64; 6] {
    [if s.time > 0.0 { -p[0] } else { 0.0 }, 0.0, 0.0, 0.0, 0.0, 0.0]
}

fn dahl_rate(p: &[f64], z: f64, v: f64) -> f64 {
    v - p[0] * z * v.abs() / p[1]
}

fn dahl_effort(p: &[f64], z: f64, _: f64) -> f64 {
    p[0] * z
}

#[test]
fn a_pendulum_swings_with_the_period_of_the_elliptic_integral_whatever_the_rule() {
    let mut model = double_pendulum();
    // One pendulum: the lower link weighs next to nothing and hangs straight.
    model.bodies[1] =
        pkm_dyn::InertialParameters::from_centre_of_mass(1e-12, nalgebra::Vector3::zeros(), nalgebra::Matrix3::identity() * 1e-12);
    let (inertia, weight) = (0.01 + 0.16, 9.81 * 0.4);
    for (integrator, tolerance) in
        [(Integrator::RungeKutta, 1e-9), (Integrator::Gauss, 1e-9), (Integrator::Radau, 1e-7), (Integrator::Moreau, 1e-5)]
    {
        let start = 1.5;
        let mut plant = plant(&model, Vec::new(), &[start, 0.0], integrator);
        let (h, mut crossings) = (1e-3, Vec::new());
        for step in 0..10_000 {
            let before = plant.position()[0];
            plant.step(&[0.0, 0.0], h).unwrap();
            let now = plant.position()[0];
            if before < 0.0 && now >= 0.0 {
                crossings.push(h * (f64::from(step) + before / (before - now)));
            }
        }
        let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
        let (mut a, mut g) = (1.0_f64, math::cos(0.5 * start));
        for _ in 0..6 {
            (a, g) = (0.5 * (a + g), f64::sqrt(a * g));
        }
        let want = 2.0 * PI * f64::sqrt(inertia / weight) / a;
        assert!((period / want - 1.0).abs() < tolerance, "{integrator:?}: {period} s, not {want} s, {:e}", period / want - 1.0);
    }
}

/// Energy stays within 1e-8 of what moves to and fro (at least `least` `[J]`), loops within 1e-9, for a minute at 0.5 ms.
fn keeps_energy(mut plant: ConstrainedPlant, least: f64, stored: &dyn Fn(&ConstrainedPlant) -> f64) {
    let total = |plant: &mut ConstrainedPlant| plant.stored_energy().expect("it knows") + stored(plant);
    let at_rest = total(&mut plant);
    let still = plant.stored_energy().expect("it knows");
    let n = plant.position().len();
    let (mut drift, mut motion, mut gap) = (0.0_f64, 0.0_f64, 0.0_f64);
    for step in 0..120_000 {
        plant.step(&vec![0.0; n], 5e-4).expect("it moves on");
        if step % 100 == 0 {
            drift = drift.max((total(&mut plant) - at_rest).abs());
            motion = motion.max((plant.stored_energy().expect("it knows") - still).abs());
            gap = gap.max(plant.gap());
        }
    }
    let motion = motion.max(least);
    assert!(drift < 1e-8 * motion && gap < 1e-9, "{}: {drift:e} J of {motion} J, gap {gap:e}", plant.robot().model.name);
}

#[test]
fn energy_is_kept_for_a_minute() {
    let start = [2.0, -0.5];
    // Weight times height of both masses above their lowest place, at the start.
    let fall = 9.81 * (0.4 * (1.0 - math::cos(2.0)) + 0.5 * (1.0 - math::cos(2.0)) + 0.4 * (1.0 - math::cos(1.5)));
    keeps_energy(plant(&double_pendulum(), Vec::new(), &start, Integrator::RungeKutta), fall, &|_| 0.0);
    for (name, stiffness) in [("five_bar", 40.0), ("prs3", 3000.0)] {
        let model = frictionless(name);
        let middle = mid_pose(&model);
        let joints: Vec<String> = model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect();
        let spring = |(joint, rest): (&String, &f64)| stated(&model, "spring", joint, &[("stiffness", stiffness), ("rest", *rest)]);
        let springs = joints.iter().zip(&middle).map(spring).collect();
        let energy = |plant: &ConstrainedPlant| -> f64 {
            plant.position().iter().zip(&middle).map(|(q, m)| 0.5 * stiffness * (q - m) * (q - m)).sum()
        };
        keeps_energy(plant(&model, springs, &middle, Integrator::RungeKutta), 0.1, &energy);
    }
}

#[test]
fn coulomb_and_viscous_friction_stop_a_block_where_and_when_the_closed_form_says() {
    let (mass, level, viscous, v0) = (2.0, 3.0, 4.0, 0.7);
    let mut model = blocks(1, WEIGHTLESS);
    model.joints[0].viscous = viscous;
    let stops_after = mass / viscous * math::ln(1.0 + viscous * v0 / level);
    let way = mass / viscous * (v0 - level / viscous * math::ln(1.0 + viscous * v0 / level));
    for (integrator, tolerance) in SMOOTH.into_iter().zip([1e-9, 1e-8, 1e-9]) {
        let mut plant = plant(&model, vec![coulomb(&model, "x1", level)], &[0.1], integrator);
        plant.set_velocity(&[v0]);
        let h = 4e-3;
        while plant.velocity()[0] > 0.0 {
            plant.step(&[0.0], h).unwrap();
            let t = plant.time().unwrap();
            let want = (v0 + level / viscous) * math::exp(-viscous * t / mass) - level / viscous;
            assert!((plant.velocity()[0] - want.max(0.0)).abs() < tolerance, "{integrator:?} at {t}");
        }
        assert!(plant.time().unwrap() - stops_after < h && (plant.position()[0] - 0.1 - way).abs() < tolerance, "{integrator:?}");
        let stopped = plant.position()[0];
        // Held exactly, and let go again above the level only.
        run(&mut plant, &[2.99], h, 200);
        assert_eq!(plant.position()[0].to_bits(), stopped.to_bits());
        run(&mut plant, &[3.5], h, 10);
        assert!(plant.position()[0] > stopped);
    }
}

#[test]
fn a_pulled_block_sticks_and_slips_with_the_period_and_the_distance_of_the_closed_form() {
    let golden: serde_json::Value = serde_json::from_str(include_str!("golden/belt.json")).unwrap();
    let number = |name: &str| golden[name].as_f64().unwrap();
    let model = blocks(1, WEIGHTLESS);
    let pull = Applied::at(&PULLED, 0, vec![number("stiffness"), number("pull"), 0.0, 0.0]);
    let friction = Applied::at(&TWO_LEVELS, 0, vec![number("static"), number("kinetic"), 0.0, 0.0]);
    let mut plant = plant(&model, vec![pull, friction], &[0.0], Integrator::RungeKutta);
    let h = 2e-4;
    let (mut starts, mut places, mut moves) = (Vec::new(), Vec::new(), false);
    for step in 0..15_000 {
        plant.step(&[0.0], h).unwrap();
        let is_moving = plant.velocity()[0] > 0.0;
        if is_moving && !moves {
            starts.push(h * f64::from(step));
            places.push(plant.position()[0]);
        }
        moves = is_moving;
    }
    assert!(starts.len() > 4, "{starts:?}");
    let n = (starts.len() - 1) as f64;
    let period = (starts[starts.len() - 1] - starts[0]) / n;
    let distance = (places[places.len() - 1] - places[0]) / n;
    assert!((period / number("period_s") - 1.0).abs() < 2e-3, "{period} {}", number("period_s"));
    assert!((distance / number("slip_m") - 1.0).abs() < 2e-3, "{distance} {}", number("slip_m"));
}

#[test]
fn a_motor_crosses_its_play_and_takes_the_load_along() {
    let mut model = blocks(1, WEIGHTLESS);
    model.joints[0].armature = 0.5;
    let (gap, push, motor, mass) = (0.02, 3.0, 0.5, 2.0);
    let mut plant = plant(&model, vec![Applied::at(&PLAY, 0, vec![gap, 0.0, 0.0, 0.0])], &[0.0], Integrator::Auto);
    let (h, steps) = (1e-3, 400);
    run(&mut plant, &[push], h, steps);
    let meets = f64::sqrt(gap * motor / push);
    let common = push / motor * meets * motor / (motor + mass);
    let rest = h * steps as f64 - meets;
    let want = common * rest + 0.5 * push / (motor + mass) * rest * rest;
    assert!((plant.load_position()[0] - want).abs() < 1e-9, "{} {want}", plant.load_position()[0]);
    assert!((plant.position()[0] - want - 0.5 * gap).abs() < 1e-9 && plant.n_touched() == 1);
    assert!((plant.velocity()[0] - common - push / (motor + mass) * rest).abs() < 1e-9);
    // Pulled back, the motor leaves the load, which goes on alone.
    let (place, speed) = (plant.load_position()[0], plant.velocity()[0]);
    run(&mut plant, &[-push], h, 10);
    assert!((plant.load_position()[0] - place - speed * 10.0 * h).abs() < 1e-9 && plant.n_touched() == 0);
}

#[test]
fn motor_and_load_on_a_spring_swing_against_each_other_with_the_frequency_of_both_inertias() {
    let mut model = blocks(1, WEIGHTLESS);
    model.joints[0].armature = 0.5;
    let (stiffness, motor, mass) = (4000.0, 0.5, 2.0);
    for integrator in [Integrator::Auto, Integrator::Gauss] {
        let effect = Applied::at(&ELASTIC, 0, vec![stiffness, 0.0, 0.0, 0.0]);
        let mut plant = plant(&model, vec![effect], &[0.0], integrator);
        let (h, push) = (2e-4, 5.0);
        for k in 1..=2000 {
            plant.step(&[push], h).unwrap();
            // A constant push on the motor: both fall together, the spring swings about its mean stretch.
            let t = h * f64::from(k);
            let w = f64::sqrt(stiffness * (1.0 / motor + 1.0 / mass));
            let stretch = push / motor / (w * w) * (1.0 - math::cos(w * t));
            let centre = 0.5 * push / (motor + mass) * t * t;
            let got = plant.position()[0] - plant.load_position()[0];
            assert!((got - stretch).abs() < 1e-8, "{integrator:?} at {t}: {got} {stretch}");
            let middle = (motor * plant.position()[0] + mass * plant.load_position()[0]) / (motor + mass);
            assert!((middle - centre).abs() < 1e-10, "{integrator:?} at {t}");
        }
    }
}

#[test]
fn a_spring_far_too_stiff_for_the_step_is_as_good_as_none() {
    let mut model = blocks(1, WEIGHTLESS);
    model.joints[0].armature = 0.5;
    let mut plant = plant(&model, vec![Applied::at(&ELASTIC, 0, vec![1e10, 0.0, 0.0, 0.0])], &[0.0], Integrator::Auto);
    run(&mut plant, &[5.0], 1e-3, 500);
    assert!((plant.load_position()[0] - 0.5 * 5.0 / 2.5 * 0.25).abs() < 1e-6, "{}", plant.load_position()[0]);
}

#[test]
fn a_link_on_springs_hangs_by_its_weight_and_swings_with_its_own_frequency() {
    let (stiffness, push, mass) = (5000.0, 20.0, 2.0);
    let model = blocks(1, [0.0, 0.0, -9.81]);
    for link in ["block1", "base"] {
        let at = model.link_index(link).unwrap();
        let effects = vec![
            Applied::at(&STRUCTURE, at, vec![stiffness, 0.0, 0.0, 0.0]),
            Applied::at(&STEP, 1, vec![push, 0.0, 0.0, 0.0]),
            // The drive holds still.
            coulomb(&model, "x1", 1e6),
        ];
        let mut plant = plant(&model, effects, &[0.3], Integrator::Auto);
        let sag = -mass * 9.81 / stiffness;
        for k in 0..300 {
            let t = 2e-4 * f64::from(k);
            let (pose, _) = plant.link_motion(1).unwrap();
            let want = 0.3 + push / stiffness * (1.0 - math::cos(f64::sqrt(stiffness / mass) * t));
            assert!((pose.translation.x - want).abs() < 1e-5, "{link} at {t}: {} {want}", pose.translation.x);
            assert!((pose.translation.z - sag).abs() < 1e-9, "{}", pose.translation.z);
            plant.step(&[0.0], 2e-4).unwrap();
        }
        assert!((plant.position()[0] - 0.3).abs() < 1e-12, "the drive stands");
    }
}

#[test]
fn what_turns_with_two_joints_slows_both() {
    let model = blocks(2, WEIGHTLESS);
    let mut pair = Applied::at(&GEARED, 0, vec![1.5, 0.8, 0.0, 0.0]);
    pair.other = Some(1);
    let mut plant = plant(&model, vec![pair], &[0.0, 0.0], Integrator::RungeKutta);
    let (f1, f2, t) = (4.0, 1.0, 0.5);
    run(&mut plant, &[f1, f2], 1e-3, 500);
    // Sum of both speeds: (m/2 + I)·(s'/1) + b·s = (f1 + f2)/2; difference: m·d' = f1 − f2.
    let (inertia, viscous) = (1.0 + 1.5, 0.8);
    let sum = 0.5 * (f1 + f2) / viscous * (1.0 - math::exp(-viscous * t / inertia));
    let difference = (f1 - f2) * t / 2.0;
    let v = plant.velocity();
    assert!((v[0] + v[1] - sum).abs() < 1e-10 && (v[0] - v[1] - difference).abs() < 1e-10, "{v:?} {sum} {difference}");
}

#[test]
fn a_memory_yields_like_its_spring_and_holds_what_it_was_pushed_with() {
    let model = blocks(1, WEIGHTLESS);
    let (stiffness, level) = (2e4, 8.0);
    let mut plant = plant(&model, vec![Applied::at(&DAHL, 0, vec![stiffness, level, 0.0, 0.0])], &[0.0], Integrator::Auto);
    // A small push: z = x but for second order, so the block swings like one on a spring.
    let (push, w) = (1e-3, f64::sqrt(stiffness / 2.0));
    for k in 1..=500 {
        plant.step(&[push], 1e-4).unwrap();
        let want = push / stiffness * (1.0 - math::cos(w * 1e-4 * f64::from(k)));
        assert!((plant.position()[0] - want).abs() < 1e-3 * push / stiffness, "step {k}");
    }
    // Far above the level it slides with the rest.
    let mut plant = self::plant(&model, vec![Applied::at(&DAHL, 0, vec![stiffness, level, 0.0, 0.0])], &[0.0], Integrator::Auto);
    run(&mut plant, &[20.0], 1e-3, 100);
    let speed = plant.velocity()[0];
    run(&mut plant, &[20.0], 1e-3, 200);
    assert!((plant.velocity()[0] - speed - 0.2 * (20.0 - level) / 2.0).abs() < 1e-6, "{}", plant.velocity()[0]);
}

#[test]
fn end_stops_send_back_what_they_are_told_to_and_hold_what_leans_on_them() {
    let model = blocks(1, WEIGHTLESS);
    let options = ConstrainedOptions { end_stops: Some(0.5), ..ConstrainedOptions::default() };
    let mut plant = ConstrainedPlant::try_new(Robot::new(model.clone(), Vec::new()), &[0.9], options).unwrap();
    plant.set_velocity(&[2.0]);
    run(&mut plant, &[0.0], 1e-3, 100);
    // 0.1 m there at 2 m/s, then back at 1 m/s.
    assert!((plant.position()[0] - 0.95).abs() < 1e-9 && (plant.velocity()[0] + 1.0).abs() < 1e-12, "{:?}", plant.position());
    let options = ConstrainedOptions { end_stops: Some(0.0), ..ConstrainedOptions::default() };
    let mut plant = ConstrainedPlant::try_new(Robot::new(model, Vec::new()), &[0.9], options).unwrap();
    run(&mut plant, &[5.0], 1e-3, 1000);
    assert!((plant.position()[0] - 1.0).abs() < 1e-12 && plant.velocity()[0].abs() < 1e-12 && plant.n_touched() == 1);
    run(&mut plant, &[-5.0], 1e-3, 100);
    assert!((plant.position()[0] - (1.0 - 0.5 * 2.5 * 0.01)).abs() < 1e-9 && plant.n_touched() == 0);
}
