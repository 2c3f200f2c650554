//! Bodies as MuJoCo has them: several joints in series may move one body, and every moving body has mass.
//!
//! Links without mass between joints (a cross of a universal joint, say) vanish into the body that follows. This changes nothing: the
//! joints turn about the same axes in the same order, axes being given in the body's frame with all coordinates at zero.

use nalgebra::Vector3;

use super::super::Names;
use super::super::joints::physics;
use crate::effects::Robot;
use crate::model::{Compound, Model, Part};
use crate::parameters::InertialParameters;
use crate::spatial::Pose;

/// More joints than this in one body are refused by MuJoCo.
const MOST_JOINTS: usize = 6;

/// A joint in the frame of the MuJoCo body that it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JointInBody {
    /// Which joint of the model.
    pub(super) joint: usize,
    /// A point of its axis `[m]`.
    pub(super) pos: Vector3<f64>,
    /// Unit axis.
    pub(super) axis: Vector3<f64>,
}

/// One body of MuJoCo.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Body {
    /// Name of the link that has its frame.
    pub(super) name: String,
    /// The model's body whose frame and mass it has.
    pub(super) body: usize,
    /// Index of the parent among the bodies; `None` is the world.
    pub(super) parent: Option<usize>,
    /// Frame in the parent's frame, all coordinates at zero.
    pub(super) pose: Pose,
    /// Its joints, outermost first.
    pub(super) joints: Vec<JointInBody>,
}

/// Bodies in the order in which MuJoCo numbers them, and so its joints: depth first.
pub(super) fn bodies(model: &Model) -> Vec<Body> {
    let merged = merged(model);
    let (mut out, mut place) = (Vec::new(), vec![None; model.nv()]);
    // The world is a body of that name.
    let mut names = Names::new(["world"]);
    let mut open: Vec<usize> = heads(model, &merged, None);
    while let Some(body) = open.pop() {
        let made = Body { name: names.fresh(name(model, body)), ..chain(model, &merged, body, &place) };
        place[body] = Some(out.len());
        out.push(made);
        open.extend(heads(model, &merged, Some(body)));
    }
    out
}

/// Whether a body without mass can vanish into the one that follows: nothing but one joint is fixed to it.
///
/// Coordinates of one joint stay together. A ball ends its body: MuJoCo lets no turn follow it there.
fn merged(model: &Model) -> Vec<bool> {
    let mut run = vec![0; model.nv()];
    for j in 0..model.nv() {
        let joint = &model.joints[j];
        if let (Part::First(compound), Some(p)) = (joint.part, joint.parent)
            && run[p] + compound.n() > MOST_JOINTS
        {
            run[p] = 0;
        }
        let before = joint.parent.map_or(0, |p| run[p]);
        let can_vanish = match (joint.part, compound(model, j)) {
            (Part::First(_) | Part::Inner, _) => true,
            (Part::Last, Some((_, Compound::Spherical | Compound::Free))) => false,
            _ => model.bodies[j] == InertialParameters::default() && is_bare(model, j) && before + 1 < MOST_JOINTS,
        };
        if can_vanish {
            run[j] = before + 1;
        }
    }
    run.iter().map(|&r| r > 0).collect()
}

/// Whether one joint and no frame of a loop is fixed to a body.
fn is_bare(model: &Model, body: usize) -> bool {
    let children = model.joints.iter().filter(|c| c.parent == Some(body)).count();
    children == 1 && !model.loops.iter().any(|l| l.a.body == Some(body) || l.b.body == Some(body))
}

/// The joint with several coordinates that coordinate `j` is one of: its first coordinate, and what it is.
pub(super) fn compound(model: &Model, j: usize) -> Option<(usize, Compound)> {
    if model.joints[j].is_whole() {
        return None;
    }
    (0..=j).rev().find_map(|first| match model.joints[first].part {
        Part::First(compound) => Some((first, compound)),
        _ => None,
    })
}

/// Bodies whose nearest kept ancestor is `parent`, last first: a stack gives them back in order.
fn heads(model: &Model, merged: &[bool], parent: Option<usize>) -> Vec<usize> {
    let is_head = |&i: &usize| !merged[i] && kept_parent(model, merged, i) == parent;
    (0..model.nv()).rev().filter(is_head).collect()
}

fn kept_parent(model: &Model, merged: &[bool], body: usize) -> Option<usize> {
    let mut at = model.joints[body].parent;
    while let Some(p) = at.filter(|&p| merged[p]) {
        at = model.joints[p].parent;
    }
    at
}

fn chain(model: &Model, merged: &[bool], body: usize, place: &[Option<usize>]) -> Body {
    // Frame of the joint at hand in the body's frame, all coordinates at zero.
    let (mut frame, mut at) = (Pose::identity(), body);
    let mut joints = Vec::new();
    let parent = loop {
        let joint = &model.joints[at];
        joints.push(JointInBody { joint: at, pos: frame.translation, axis: frame.rotation * joint.axis });
        frame = frame.compose(&joint.placement.inverse());
        match joint.parent {
            Some(p) if merged[p] => at = p,
            parent => break parent,
        }
    };
    joints.reverse();
    Body { name: String::new(), body, parent: parent.and_then(|p| place[p]), pose: frame.inverse(), joints }
}

/// What is said of bodies without mass that could not vanish.
pub(super) fn notes(robot: &Robot, bodies: &[Body], tiny: f64) -> Vec<String> {
    let model = &robot.model;
    let is_massless = |b: &&Body| model.bodies[b.body].mass <= 0.0;
    let line = |b: &Body| {
        let is_leaf = !model.joints.iter().any(|j| j.parent == Some(b.body));
        let rotors = b.joints.iter().all(|j| physics(robot, j.joint).armature > 0.0);
        let warning = if is_leaf && !rotors { "; MuJoCo calls the mass matrix singular unless it is given mass" } else { "" };
        format!("link {:?} has no mass and gets {tiny:e} kg{warning}", b.name)
    };
    bodies.iter().filter(is_massless).map(line).collect()
}

/// Name of the link that gives a body of the model its frame.
fn name(model: &Model, body: usize) -> &str {
    let own = model.links.iter().find(|l| l.body == Some(body) && l.pose == Pose::identity());
    own.map_or(model.joints[body].name.as_str(), |l| l.name.as_str())
}
