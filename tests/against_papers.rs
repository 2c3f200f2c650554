//! The four papers the robots come from: every table and equation that says something about mechanics, as numbers.
//!
//! One module per paper; a test is named by equation or table. Numbers with more digits than a paper prints were computed from its
//! equations by programs that share no code with this workspace; where it is short, a second formula stands in the test. Where a paper misprints, a comment
//! that begins with DIFFERENCE says what is printed and how one sees that it is wrong.
//!
//! Not in here: control, identification from data, recordings (`recorded_robots.rs`).

#[path = "against_papers/arceo2021.rs"]
mod arceo2021;
#[path = "against_papers/armas.rs"]
mod armas;
#[path = "against_papers/mcdaid.rs"]
mod mcdaid;
#[path = "against_papers/stack.rs"]
mod stack;
#[path = "against_papers/valera2017.rs"]
mod valera2017;

use pkm_dyn::loops::{assemble, solve_positions, walk_to};
use pkm_dyn::spatial::Pose;
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, Model};

/// A shipped robot without rotors, which the papers' equations do not have.
fn shipped(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    let mut model = parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads").bare;
    for joint in &mut model.joints {
        joint.armature = 0.0;
    }
    model
}

/// The same robot with other joints as drives: closing its loops then is inverse kinematics.
fn driven_by(model: &Model, joints: &[&str]) -> Model {
    let mut other = model.clone();
    other.actuators.clear();
    for joint in joints {
        other.add_actuator(joint, 0.0).expect("the joint is there");
    }
    other
}

/// Closed tree coordinates at the drives' `q_act`, reached from the assembly without leaving its branch.
fn closed_at(model: &Model, data: &mut Data, q_act: &[f64]) {
    assert!(assemble(model, data).is_closed, "{} at home", model.name);
    let closure = walk_to(model, data, q_act);
    assert!(closure.is_closed, "{} at {q_act:?}: {closure:?}", model.name);
    // Newton stops at gaps of 1e-12; one more step from nearby leaves rounding.
    for j in model.passive() {
        data.q[j] += 1e-8;
    }
    assert!(solve_positions(model, data, q_act).is_closed);
}

/// Coordinate of a joint by name.
fn coordinate(model: &Model, data: &Data, joint: &str) -> f64 {
    data.q[model.joint_index(joint).expect("joint by name")]
}

/// Pose of a link in the root frame.
fn pose_of(model: &Model, data: &Data, link: &str) -> Pose {
    let link = &model.links[model.link_index(link).expect("link by name")];
    link.body.map_or(link.pose, |b| data.pose_wb[b].compose(&link.pose))
}

fn assert_near(got: &[f64], want: &[f64], tolerance: f64) {
    assert_eq!(got.len(), want.len(), "{got:?} and {want:?}");
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        assert!((g - w).abs() <= tolerance, "entry {k}: {g} instead of {w} (limit {tolerance:e})");
    }
}
