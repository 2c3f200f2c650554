//! Every shipped robot loads, assembles, and states what a recording of it needs. Numbers of the papers: `tests/against_papers.rs`.

use pkm_dyn::Data;
use pkm_dyn::loops::{assemble, mid_pose, mobility, walk_to};
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;

fn bare(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").bare
}

#[test]
fn every_robot_assembles_at_home_and_in_the_middle_of_its_travel() {
    for robot in pkm_robots::ALL {
        let model = bare(robot.name);
        assert_eq!(model.name, robot.name);
        assert!(robot.readme.contains("assumed"), "{}", robot.name);
        // One robot has a drive more than freedoms.
        let freedoms = if robot.name == "ups4" { 3 } else { model.n_act() };
        let mut data = Data::new(&model);
        let home = assemble(&model, &mut data);
        assert!(home.is_closed && home.gap < 1e-10, "{} at home: {home:?}", robot.name);
        let q = data.q.clone();
        for j in model.passive() {
            assert!(q[j].abs() < 1e-3, "{}: {} reads {} at home", robot.name, model.joints[j].name, q[j]);
        }
        assert_eq!(mobility(&model, &mut data, &q), freedoms, "{}", robot.name);
        data.q.copy_from_slice(&q);
        let middle = walk_to(&model, &mut data, &mid_pose(&model));
        assert!(middle.is_closed && middle.gap < 1e-10, "{} in the middle: {middle:?}", robot.name);
        let q = data.q.clone();
        assert_eq!(mobility(&model, &mut data, &q), freedoms, "{}", robot.name);
    }
}

#[test]
fn every_drive_has_friction_and_finite_limits_that_contain_home() {
    for robot in pkm_robots::ALL {
        let model = bare(robot.name);
        for &j in &model.actuators {
            let joint = &model.joints[j];
            let l = joint.limits;
            assert!(joint.viscous > 0.0 && joint.coulomb > 0.0, "{}", joint.name);
            // A paper's equations may have no rotor; then the README must say so.
            assert!(joint.armature > 0.0 || robot.readme.contains("| rotor inertia | 0 |"), "{}", joint.name);
            assert!(l.lower.is_finite() && l.upper.is_finite() && l.velocity > 0.0 && l.effort > 0.0, "{}", joint.name);
            assert!(l.lower <= model.assembly[j] && model.assembly[j] <= l.upper, "{}", joint.name);
        }
    }
}

#[test]
fn lengths_left_out_of_the_assembly_do_not_cost_a_drive() {
    let mut model = bare("ups3_rpu1");
    model.assembly.fill(0.0);
    let mut data = Data::new(&model);
    assert_eq!(data.independent, model.actuators);
    let closure = assemble(&model, &mut data);
    assert!(closure.is_closed, "{closure:?}");
}
