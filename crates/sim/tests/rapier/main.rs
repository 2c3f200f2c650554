//! The engine's plant against closed forms, against the own plant, and against itself with finer substeps.

mod pd_run;

use core::f64::consts::PI;

use pd_run::{Loop, REFERENCE_PARTS, apart, foreign, frictionless, loops_open, own, play_back, shipped};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::math::{cos, exp, sin, tanh};
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_sim::{Plant, RapierOptions, RapierPlant, ReducedPlant, SimError};

/// 1.5 kg at 0.4 m from a horizontal pin, 0.02 kg·m² about its own centre; it hangs down at 0.
const PENDULUM: &str = r#"<robot name="r"><link name="base"/>
  <link name="bob"><inertial><origin xyz="0 0 -0.4"/><mass value="1.5"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="q" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="20"/></joint>
</robot>"#;

/// 2 kg on a rail that rises by 30°.
const SLIDER: &str = r#"<robot name="r"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.015"/></inertial></link>
  <joint name="q" type="prismatic"><parent link="base"/><child link="block"/><origin rpy="0 -0.5235987755982988 0"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="100" velocity="5"/></joint>
</robot>"#;

/// A lopsided body in three driven rings without mass.
const GIMBAL: &str = r#"<robot name="r"><link name="base"/><link name="outer"/><link name="inner"/>
  <link name="body"><inertial><origin xyz="0.02 -0.01 0.05" rpy="0.3 0.2 0.1"/><mass value="2.0"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.04"/></inertial></link>
  <joint name="q" type="revolute"><parent link="base"/><child link="outer"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="r" type="revolute"><parent link="outer"/><child link="inner"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="s" type="revolute"><parent link="inner"/><child link="body"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
</robot>"#;

/// A block of 2 kg that turns about and slides along one axis; the carriage between the two joints has no mass.
const SPINDLE: &str = r#"<robot name="r"><link name="base"/><link name="carriage"/>
  <link name="body"><inertial><mass value="2.0"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.05"/></inertial></link>
  <joint name="q" type="revolute"><parent link="base"/><child link="carriage"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="r" type="prismatic"><parent link="carriage"/><child link="body"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
</robot>"#;

fn model(urdf: &str, toml: &str) -> Model {
    let toml = format!("name = \"r\"\nurdf = \"r.urdf\"\n{toml}");
    parse(&toml, urdf, ["robot.toml", "r.urdf"]).expect("the robot loads").bare
}

/// Effect, place, parameters.
type Stated<'s> = (&'s str, &'s str, &'s [(&'s str, f64)]);

fn driven(joints: &[&str], rotor_inertia: f64) -> String {
    joints.iter().map(|j| format!("[[actuator]]\njoint = \"{j}\"\nrotor_inertia = {rotor_inertia:?}\n")).collect()
}

fn with(model: &Model, effects: &[Stated]) -> Robot {
    let apply = |(name, place, parameters): &Stated| {
        let parameters: Vec<(String, f64)> = parameters.iter().map(|(k, v)| (k.to_string(), *v)).collect();
        Applied::try_new(model, name, place, &parameters).expect("a valid effect")
    };
    Robot::new(model.clone(), effects.iter().map(apply).collect())
}

fn at(robot: &Robot, q: &[f64], substep: f64) -> RapierPlant {
    RapierPlant::try_new(robot.clone(), q, RapierOptions { substep, ..RapierOptions::default() }).expect("the engine can represent it")
}

/// How far a coarse run is from a fine one, over how far one of half its substeps is: 4 at second order.
fn gain_of_halving(errors: [f64; 2]) -> f64 {
    errors[0] / errors[1]
}

#[test]
fn a_pendulum_swings_with_the_period_of_the_elliptic_integral_to_second_order() {
    let robot = Robot::new(model(PENDULUM, &driven(&["q"], 0.0)), Vec::new());
    let (inertia, weight) = (0.02 + 1.5 * 0.4 * 0.4, 1.5 * 9.81 * 0.4);
    let error = |h: f64| {
        let (mut plant, mut crossings, mut t) = (at(&robot, &[1.0], h), Vec::new(), 0.0);
        while t < 10.0 {
            let before = plant.position()[0];
            plant.step(&[0.0], h).unwrap();
            let now = plant.position()[0];
            if before < 0.0 && now >= 0.0 {
                crossings.push(t + h * before / (before - now));
            }
            t += h;
        }
        let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
        let (mut a, mut g) = (1.0_f64, cos(0.5));
        for _ in 0..6 {
            (a, g) = (0.5 * (a + g), f64::sqrt(a * g));
        }
        (period / (2.0 * PI * f64::sqrt(inertia / weight) / a) - 1.0).abs()
    };
    let errors = [error(4e-3), error(2e-3)];
    assert!(errors[1] < 2e-5, "{errors:?}");
    assert!((gain_of_halving(errors) - 4.0).abs() < 0.6, "{errors:?}");
}

#[test]
fn a_slider_with_a_rotor_ten_times_its_mass_and_viscous_friction_follows_its_closed_form() {
    let bare = model(SLIDER, &driven(&["q"], 15.0));
    let robot = with(&bare, &[("rotor_inertia", "q", &[("inertia", 5.0)]), ("friction_viscous", "q", &[("viscous", 40.0)])]);
    let (mass, net): (f64, f64) = (2.0 + 15.0 + 5.0, 30.0 - 2.0 * 9.81 * 0.5);
    let mut plant = at(&robot, &[0.2], 2.5e-4);
    let mut worst = 0.0_f64;
    for k in 1..=2000 {
        plant.step(&[30.0], 1e-3).unwrap();
        let (t, lag) = (1e-3 * f64::from(k), mass / 40.0);
        let want = 0.2 + net / 40.0 * (t - lag * (1.0 - exp(-t / lag)));
        worst = worst.max((plant.position()[0] - want).abs());
        assert!((plant.velocity()[0] - net / 40.0 * (1.0 - exp(-t / lag))).abs() < 1e-6);
    }
    assert!(worst < 1e-7, "{worst:e} m");
}

#[test]
fn a_push_below_the_dry_friction_creeps_as_the_smoothed_law_says_and_one_above_slides() {
    let bare = model(SLIDER, &driven(&["q"], 0.0));
    let robot = with(&bare, &[("friction_coulomb", "q", &[("coulomb", 8.0)])]);
    let weight = 2.0 * 9.81 * 0.5;
    let mut plant = at(&robot, &[0.0], 2.5e-4);
    for _ in 0..400 {
        plant.step(&[weight + 12.0], 1e-3).unwrap();
    }
    // (12 − 8) N on 2 kg for 0.4 s; while it leaves the smoothing speed it gains about 0.7 ms.
    assert!((plant.velocity()[0] - 0.8).abs() < 2e-3, "{}", plant.velocity()[0]);
    for _ in 0..1000 {
        plant.step(&[weight + 4.0], 1e-3).unwrap();
    }
    let creep = plant.velocity()[0];
    assert!((tanh(creep / 1e-3) - 0.5).abs() < 1e-6, "creeps at {creep} m/s");
}

#[test]
fn a_lopsided_body_in_massless_rings_turns_as_in_the_own_plant_to_second_order() {
    let robot = Robot::new(model(GIMBAL, &driven(&["q", "r", "s"], 0.0)), Vec::new());
    let start = [0.2, -0.3, 0.4];
    let tau = |t: f64| [0.3 * sin(3.0 * t), -0.2 * cos(2.0 * t), 0.25 * sin(4.0 * t)];
    let end = |plant: &mut dyn Plant, parts: u32| {
        for k in 0..500 {
            for _ in 0..parts {
                plant.step(&tau(2e-3 * f64::from(k)), 2e-3 / f64::from(parts)).unwrap();
            }
        }
        plant.position().to_vec()
    };
    let fine = end(&mut ReducedPlant::try_new(robot.clone(), &start).unwrap(), 20);
    let errors = [2e-3, 1e-3].map(|substep| {
        let q = end(&mut at(&robot, &start, substep), 1);
        q.iter().zip(&fine).fold(0.0_f64, |top, (a, b)| top.max((a - b).abs()))
    });
    assert!(errors[1] < 2e-4, "{errors:?}");
    assert!((gain_of_halving(errors) - 4.0).abs() < 0.8, "{errors:?}");
}

#[test]
fn a_spindle_turns_and_slides_independently() {
    let robot = Robot::new(model(SPINDLE, &driven(&["q", "r"], 0.0)), Vec::new());
    let mut plant = at(&robot, &[0.0, 0.1], 1e-3);
    for _ in 0..500 {
        plant.step(&[0.02, 2.0 * 9.81 - 0.4], 1e-3).unwrap();
    }
    let (q, r) = (0.5 * 0.02 / 0.05 * 0.25, 0.1 - 0.5 * 0.2 * 0.25);
    assert!((plant.position()[0] - q).abs() < 1e-9 && (plant.position()[1] - r).abs() < 1e-9, "{:?}", plant.position());
}

/// Largest difference of the engine's plant from the own one over 10 s under PD, of drives `[m | rad]`, and its widest gap `[m | rad]`.
fn error_and_gap(robot: &Robot, substep: f64) -> [f64; 2] {
    let at = Loop::new(&robot.model);
    let reference = at.run(&mut own(robot, &at), 10, REFERENCE_PARTS);
    let mut plant = foreign(robot, &at, RapierOptions { substep, ..RapierOptions::default() });
    let run = at.run(&mut plant, 10, 1);
    [apart(&run, &reference), plant.widest_gap().max(loops_open(&robot.model, plant.tree_position()))]
}

#[test]
fn without_friction_both_plants_follow_the_same_path_for_ten_seconds() {
    for (name, limit, gap) in [("five_bar", 1e-6, 1e-7), ("serial_arm", 1e-5, 1e-6), ("prs3", 1e-7, 1e-7), ("ups3_rpu1", 5e-6, 5e-5)] {
        let found = error_and_gap(&Robot::new(frictionless(name), Vec::new()), 2.5e-4);
        assert!(found[0] < limit && found[1] < gap, "{name}: {found:?}");
    }
}

#[test]
fn halving_the_substeps_of_a_closed_loop_robot_quarters_the_difference() {
    let robot = Robot::new(frictionless("prs3"), Vec::new());
    let errors = [1e-3, 5e-4].map(|substep| error_and_gap(&robot, substep)[0]);
    assert!(gain_of_halving(errors) > 3.5, "{errors:?}");
}

#[test]
fn efforts_of_the_own_plant_lead_the_engine_along_the_same_path_without_a_controller() {
    for (name, limit) in [("five_bar", 5e-4), ("prs3", 1e-4), ("ups3_rpu1", 5e-4)] {
        let robot = Robot::new(frictionless(name), Vec::new());
        let at = Loop::new(&robot.model);
        let reference = at.run(&mut own(&robot, &at), 1, REFERENCE_PARTS);
        let played = play_back(&mut foreign(&robot, &at, RapierOptions::default()), &reference, 1);
        assert!(apart(&played, &reference) < limit, "{name}: {:e}", apart(&played, &reference));
    }
}

#[test]
fn with_friction_they_differ_by_what_smoothing_makes_of_standstill() {
    for (name, error) in [("five_bar", 1e-4), ("serial_arm", 2e-4), ("prs3", 1e-4), ("ups3_rpu1", 3e-4)] {
        let [found, _] = error_and_gap(&Robot::new(shipped(name), Vec::new()), 2.5e-4);
        assert!(found < error, "{name}: {found:e}");
    }
}

#[test]
fn every_kind_of_joint_effect_acts_as_in_the_own_plant() {
    let bare = frictionless("five_bar");
    let (left, right, elbow) = ("shoulder_left", "shoulder_right", "elbow_left");
    let cases: [(Stated, f64); 9] = [
        (("friction_coulomb", left, &[("coulomb", 0.8)]), 1e-4),
        (("friction_viscous", right, &[("viscous", 0.5)]), 1e-5),
        (("torque_offset", left, &[("offset", -1.5)]), 1e-5),
        (("friction_stribeck", left, &[("coulomb", 0.5), ("stiction", 1.0), ("stribeck_velocity", 0.05)]), 1e-4),
        (("friction_load", right, &[("mu", 0.1)]), 1e-4),
        (("friction_passive", elbow, &[("coulomb", 0.2), ("viscous", 0.1)]), 1e-4),
        (("rotor_inertia", left, &[("inertia", 0.3)]), 1e-5),
        (("spring", right, &[("stiffness", 30.0), ("rest", 0.1)]), 1e-5),
        (("torque_ripple", left, &[("amplitude", 1.0), ("order", 20.0)]), 1e-5),
    ];
    let plain = Robot::new(bare.clone(), Vec::new());
    let at = Loop::new(&bare);
    let without = at.run(&mut foreign(&plain, &at, RapierOptions::default()), 4, 1);
    for ((name, place, values), limit) in cases {
        let robot = with(&bare, &[(name, place, values)]);
        let run = at.run(&mut foreign(&robot, &at, RapierOptions::default()), 4, 1);
        let difference = apart(&run, &at.run(&mut own(&robot, &at), 4, REFERENCE_PARTS));
        assert!(difference < limit, "{name}: {difference:e} rad");
        let change = apart(&run, &without);
        assert!(change > 10.0 * difference, "{name} changes {change:e} rad, of which {difference:e} rad differ");
    }
}

#[test]
fn energy_is_kept_over_ten_seconds_without_friction() {
    // What is lost or gained is what the sweeps leave over: a hundred instead of 32 take most of it from the arm.
    for (name, stiffness, push, limit) in
        [("prs3", 3000.0, 10.0, 1e-4), ("five_bar", 40.0, 3.0, 1e-3), ("serial_arm", 300.0, 5.0, 1e-2), ("ups3_rpu1", 4000.0, 20.0, 1e-2)]
    {
        let model = frictionless(name);
        let middle = Loop::new(&model).middle;
        let joints: Vec<String> = model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect();
        let springs: Vec<[(&str, f64); 2]> = middle.iter().map(|m| [("stiffness", stiffness), ("rest", *m)]).collect();
        let effects: Vec<Stated> = joints.iter().zip(&springs).map(|(j, s)| ("spring", j.as_str(), s.as_slice())).collect();
        let mut plant = at(&with(&model, &effects), &middle, 2.5e-4);
        let total = |plant: &RapierPlant| {
            let stored: f64 = plant.position().iter().zip(&middle).map(|(q, m)| (q - m) * (0.5 * stiffness * (q - m) - push)).sum();
            plant.energy() + stored
        };
        let (at_rest, mut drift, mut moved) = (total(&plant), 0.0_f64, 0.0_f64);
        for _ in 0..10_000 {
            plant.step(&vec![push; middle.len()], 1e-3).unwrap();
            let travel = plant.position().iter().zip(&middle).map(|(q, m)| (q - m).abs()).fold(0.0, f64::max);
            moved = moved.max(0.5 * stiffness * travel * travel);
            drift = drift.max((total(&plant) - at_rest).abs());
        }
        assert!(moved > 0.05 && drift < limit * moved, "{name}: drift {drift:e} J of {moved:e} J");
    }
}

#[test]
fn a_start_in_motion_goes_on_as_in_the_own_plant() {
    let robot = Robot::new(frictionless("prs3"), Vec::new());
    let at = Loop::new(&robot.model);
    let (mut plant, mut reference) = (foreign(&robot, &at, RapierOptions::default()), own(&robot, &at));
    let tau = vec![70.0; 3];
    plant.set_velocity(&[0.1, -0.05, 0.02]).unwrap();
    reference.set_velocity(&[0.1, -0.05, 0.02]);
    for _ in 0..200 {
        plant.step(&tau, 1e-3).unwrap();
        (0..10).for_each(|_| reference.step(&tau, 1e-4).unwrap());
    }
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |top, (a, b)| top.max((a - b).abs()));
    assert!(apart(plant.position(), reference.position()) < 1e-6, "{:?} {:?}", plant.position(), reference.position());
    assert!(apart(plant.velocity(), reference.velocity()) < 1e-5, "{:?} {:?}", plant.velocity(), reference.velocity());
}

#[test]
fn the_same_run_twice_gives_the_same_bits() {
    let robot = Robot::new(shipped("ups3_rpu1"), Vec::new());
    let at = Loop::new(&robot.model);
    let bits = || {
        let run = at.run(&mut foreign(&robot, &at, RapierOptions::default()), 1, 1);
        run.positions.into_iter().flatten().map(f64::to_bits).collect::<Vec<u64>>()
    };
    assert_eq!(bits(), bits());
}

fn refusal(model: Model) -> String {
    let start = vec![0.1; model.n_act()];
    match RapierPlant::try_new(Robot::new(model, Vec::new()), &start, RapierOptions::default()) {
        Err(e @ SimError::NotRepresentable { .. }) => e.to_string(),
        Err(e) => panic!("another error: {e}"),
        Ok(_) => panic!("not refused"),
    }
}

#[test]
fn what_the_engine_has_no_means_for_is_refused_by_name() {
    let rotor = refusal(model(GIMBAL, &driven(&["q", "r", "s"], 0.1)));
    assert!(rotor.contains("rotor inertia of joint \"q\"") && rotor.contains("no mass"), "{rotor}");
    let thin = refusal(model(&PENDULUM.replace("izz=\"0.02\"", "izz=\"0\""), &driven(&["q"], 0.0)));
    assert!(thin.contains("body of joint \"q\"") && thin.contains("inertia above zero"), "{thin}");
    let coupled = "[[coupling]]\njoint = \"r\"\nof = { q = 0.01 }\n";
    let geared = refusal(model(SPINDLE, &format!("{}{coupled}", driven(&["q"], 0.0))));
    assert!(geared.contains("coupling of joint \"r\"") && geared.contains("gears"), "{geared}");
    let crossed = refusal(model(
        &GIMBAL
            .replace("<origin xyz=\"0 0 0\"/>", "")
            .replace("<child link=\"inner\"/>", "<child link=\"inner\"/><origin xyz=\"0 0 0.1\"/>"),
        &driven(&["q", "r", "s"], 0.0),
    ));
    assert!(crossed.contains("body of joint \"q\"") && crossed.contains("universal"), "{crossed}");
}

#[test]
fn options_out_of_range_are_refused() {
    let robot = Robot::new(model(PENDULUM, &driven(&["q"], 0.0)), Vec::new());
    let usual = RapierOptions::default();
    for options in [
        RapierOptions { substep: 0.0, ..usual },
        RapierOptions { substep: f64::NAN, ..usual },
        RapierOptions { sweeps: 0, ..usual },
        RapierOptions { smoothing: -1.0, ..usual },
    ] {
        let refused = RapierPlant::try_new(robot.clone(), &[0.0], options);
        assert!(matches!(refused, Err(SimError::Scenario { .. })), "{options:?}");
    }
}
