//! The plant alone: energy is kept, sticking is exact, sliding follows its closed form.

use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::loops::mid_pose;
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Integrator, Plant, ReducedPlant};

/// A block of 2 kg on a horizontal rail.
const BLOCK: &str = r#"<robot name="block"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="100" velocity="10"/><dynamics damping="0" friction="0"/></joint>
</robot>"#;

fn block() -> Model {
    parse("name = \"block\"\nurdf = \"block.urdf\"\n[[actuator]]\njoint = \"x\"\n", BLOCK, ["robot.toml", "block.urdf"])
        .expect("the block loads")
        .bare
}

/// Effect, place, parameters.
type Stated<'s> = (&'s str, &'s str, &'s [(&'s str, f64)]);

fn with(model: &Model, effects: &[Stated]) -> Robot {
    let apply = |(name, place, parameters): &Stated| {
        let parameters: Vec<(String, f64)> = parameters.iter().map(|(k, v)| (k.to_string(), *v)).collect();
        Applied::try_new(model, name, place, &parameters).expect("a valid effect")
    };
    Robot::new(model.clone(), effects.iter().map(apply).collect())
}

fn frictionless(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    let mut model = parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").bare;
    for joint in &mut model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    model
}

#[test]
fn below_the_coulomb_level_a_block_does_not_move_at_all() {
    let model = block();
    let robot = with(&model, &[("friction_coulomb", "x", &[("coulomb", 5.0)])]);
    let mut plant = ReducedPlant::try_new(robot, &[0.25]).unwrap();
    for k in 0..4000 {
        let push = 4.999 * f64::from(k % 7 - 3) / 3.0;
        plant.step(&[push], 5e-4).unwrap();
        assert_eq!((plant.position()[0].to_bits(), plant.velocity()[0].to_bits()), (0.25_f64.to_bits(), 0.0_f64.to_bits()), "step {k}");
    }
}

#[test]
fn numbers_beyond_all_bounds_are_an_error_not_a_panic() {
    let robot = pkm_robots::find("serial_arm").expect("a shipped robot");
    let model = parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").bare;
    let joints: Vec<&str> = model.actuators.iter().map(|&j| model.joints[j].name.as_str()).collect();
    let loads: Vec<Stated> = joints.iter().map(|&joint| ("friction_load", joint, &[("mu", 0.1)][..])).collect();
    let robot = with(&model, &loads);
    let start = mid_pose(&model);
    let push = vec![1e300; start.len()];
    let two_steps = |plant: &mut dyn Plant| plant.step(&push, 1e-3).and_then(|()| plant.step(&push, 1e-3));
    assert!(two_steps(&mut ReducedPlant::try_new(robot.clone(), &start).unwrap()).is_err());
    for integrator in [Integrator::Auto, Integrator::RungeKutta] {
        let options = ConstrainedOptions { integrator, ..ConstrainedOptions::default() };
        assert!(two_steps(&mut ConstrainedPlant::try_new(robot.clone(), &start, options).unwrap()).is_err());
    }
}

#[test]
fn a_constant_push_above_the_level_accelerates_by_the_rest_and_releasing_it_stops_the_block_for_good() {
    let model = block();
    let robot = with(&model, &[("friction_coulomb", "x", &[("coulomb", 5.0)])]);
    let mut plant = ReducedPlant::try_new(robot, &[0.0]).unwrap();
    let h = 5e-4;
    for _ in 0..400 {
        plant.step(&[9.0], h).unwrap();
    }
    // (9 − 5) N on 2 kg for 0.2 s.
    assert!((plant.velocity()[0] - 0.4).abs() < 1e-12 && (plant.position()[0] - 0.04).abs() < 1e-12);
    for _ in 0..1000 {
        plant.step(&[1.0], h).unwrap();
    }
    // Slowed by (1 − 5) N it stops after 0.2 s and another 0.04 m, and stays.
    let stopped = plant.position()[0];
    assert!(plant.velocity()[0] == 0.0 && (stopped - 0.08).abs() < 1e-6, "{stopped}");
    plant.step(&[-4.0], h).unwrap();
    assert_eq!(plant.position()[0].to_bits(), stopped.to_bits());
}

#[test]
fn stiction_holds_to_its_own_level_and_then_lets_go() {
    let model = block();
    let stribeck: &[(&str, f64)] = &[("coulomb", 2.0), ("stiction", 6.0), ("stribeck_velocity", 0.01)];
    let mut plant = ReducedPlant::try_new(with(&model, &[("friction_stribeck", "x", stribeck)]), &[0.0]).unwrap();
    for _ in 0..100 {
        plant.step(&[5.9], 5e-4).unwrap();
    }
    assert!(plant.velocity()[0] == 0.0);
    for _ in 0..400 {
        plant.step(&[6.1], 5e-4).unwrap();
    }
    assert!(plant.velocity()[0] > 0.1, "{}", plant.velocity()[0]);
}

/// Energy of the robot, its springs and the constant drive efforts stays within `tolerance` of the largest kinetic energy for 5 s.
fn assert_energy_is_kept(name: &str, stiffness: f64, push: f64, tolerance: f64) {
    let model = frictionless(name);
    let middle = mid_pose(&model);
    let joints: Vec<String> = model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect();
    let springs: Vec<[(&str, f64); 2]> = middle.iter().map(|m| [("stiffness", stiffness), ("rest", *m)]).collect();
    let effects: Vec<_> = joints.iter().zip(&springs).map(|(j, s)| ("spring", j.as_str(), s.as_slice())).collect();
    let mut plant = ReducedPlant::try_new(with(&model, &effects), &middle).expect("the loops stay closed");
    let tau = vec![push; middle.len()];
    let total = |plant: &mut ReducedPlant| {
        let stored: f64 = plant.position().iter().zip(&middle).map(|(q, m)| 0.5 * stiffness * (q - m) * (q - m) - push * (q - m)).sum();
        plant.energy().expect("the loops stay closed") + stored
    };
    let at_rest = total(&mut plant);
    let (mut largest_drift, mut largest_motion) = (0.0_f64, 0.0_f64);
    for _ in 0..10_000 {
        plant.step(&tau, 5e-4).expect("the loops stay closed");
        let travel = plant.position().iter().zip(&middle).map(|(q, m)| (q - m).abs()).fold(0.0, f64::max);
        largest_motion = largest_motion.max(0.5 * stiffness * travel * travel);
        largest_drift = largest_drift.max((total(&mut plant) - at_rest).abs());
    }
    assert!(largest_motion > 0.05, "{name}: hardly moved, {largest_motion} J");
    assert!(largest_drift < tolerance * largest_motion, "{name}: drift {largest_drift:e} J of {largest_motion:e} J");
}

#[test]
fn energy_is_kept_over_five_seconds_without_friction() {
    // Leapfrog at 0.5 ms: the error oscillates with (ω·h)²/8 and does not grow.
    assert_energy_is_kept("prs3", 3000.0, 10.0, 2e-4);
    assert_energy_is_kept("five_bar", 40.0, 3.0, 2e-4);
    assert_energy_is_kept("serial_arm", 300.0, 5.0, 2e-4);
}

#[test]
fn a_passive_joint_that_sticks_holds_the_loop() {
    let model = frictionless("five_bar");
    let robot = with(
        &model,
        &[("friction_passive", "elbow_left", &[("coulomb", 50.0)]), ("friction_passive", "elbow_right", &[("coulomb", 50.0)])],
    );
    let start = mid_pose(&model);
    let mut plant = ReducedPlant::try_new(robot, &start).unwrap();
    for _ in 0..500 {
        plant.step(&[2.0, -1.0], 5e-4).unwrap();
    }
    for (q, s) in plant.position().iter().zip(&start) {
        assert!((q - s).abs() < 1e-9, "crept by {:e}", q - s);
    }
}
