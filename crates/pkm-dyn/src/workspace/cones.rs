//! Ball and universal joints, and how far each leans from where it stands at home.

use alloc::string::String;
use alloc::vec::Vec;

use nalgebra::Vector3;

use crate::data::Data;
use crate::loops::loop_gap;
use crate::math;
use crate::model::{FrameOnBody, JointKind, Model};

/// Points nearer than this are one point `[m]`.
const ONE_POINT: f64 = 1e-6;

/// A ball or universal joint: a leg on one side, and the body against which it leans.
#[derive(Debug, Clone, PartialEq)]
pub struct Cone {
    /// Name of the loop, or of the first of the revolute joints in series that make the joint.
    pub name: String,
    leg: Option<usize>,
    /// Axis of the leg in the leg's body.
    axis: Vector3<f64>,
    against: Option<usize>,
    /// The leg's axis at home, in the body it leans against.
    home: Vector3<f64>,
}

impl Cone {
    /// Angle between the leg's axis now and at home, seen from the other body `[rad]`; from the poses in `data`.
    #[must_use]
    pub fn lean(&self, data: &Data) -> f64 {
        let now = seen_from(data, self.against, seen_from_root(data, self.leg, self.axis));
        math::atan2(now.cross(&self.home).norm(), now.dot(&self.home))
    }
}

fn seen_from_root(data: &Data, body: Option<usize>, v: Vector3<f64>) -> Vector3<f64> {
    body.map_or(v, |b| data.pose_wb[b].rotation * v)
}

fn seen_from(data: &Data, body: Option<usize>, v: Vector3<f64>) -> Vector3<f64> {
    body.map_or(v, |b| data.pose_wb[b].rotation.tr_mul(&v))
}

/// Every ball and universal joint of the robot that has a leg, with the lean counted from the closed pose `q`.
///
/// These are loops that hold a point and at most one rotation, and two or three passive revolute joints in series through one point.
/// The leg's axis is that of its travel, or else the line to the only other point where it is held; a joint between two bodies of
/// which neither has such an axis (an ankle, say) has no cone.
#[must_use]
pub fn cones(model: &Model, data: &mut Data, q: &[f64]) -> Vec<Cone> {
    loop_gap(model, data, q);
    let mut out = Vec::new();
    for l in &model.loops {
        let turns = l.constrain[3..].iter().filter(|&&c| c).count();
        if l.constrain[..3] == [true; 3] && turns <= 1 {
            let centre = world_point(data, &l.b);
            out.extend(cone(model, data, &l.name, [l.b.body, l.a.body], centre));
        }
    }
    let mut joint = 0;
    while joint < model.nv() {
        let n = in_series(model, joint);
        if n > 1 {
            let (first, last) = (&model.joints[joint], joint + n - 1);
            let centre = data.pose_wb[joint].translation;
            out.extend(cone(model, data, &first.name, [Some(last), first.parent], centre));
        }
        joint += n;
    }
    out
}

fn world_point(data: &Data, frame: &FrameOnBody) -> Vector3<f64> {
    frame.body.map_or(frame.pose.translation, |b| data.pose_wb[b].transform_point(&frame.pose.translation))
}

/// Number of joints, from `first` on, that turn about one point with nothing between them.
fn in_series(model: &Model, first: usize) -> usize {
    let is_passive_hinge = |j: usize| model.joints[j].kind == JointKind::Revolute && !model.actuators.contains(&j);
    let mut last = first;
    while last - first < 2 && is_passive_hinge(last) {
        let mut children = (last + 1..model.nv()).filter(|&j| model.joints[j].parent == Some(last));
        let (Some(next), None) = (children.next(), children.next()) else { break };
        let is_held = model.loops.iter().any(|l| l.a.body == Some(last) || l.b.body == Some(last));
        let is_point = model.joints[next].placement.translation.norm() < ONE_POINT;
        if next != last + 1 || is_held || !is_point || !is_passive_hinge(next) || model.bodies[last].mass > 0.0 {
            break;
        }
        last = next;
    }
    last - first + 1
}

/// The cone of the joint at `centre` between two bodies: the leg is the first of them that has an axis.
fn cone(model: &Model, data: &Data, name: &str, bodies: [Option<usize>; 2], centre: Vector3<f64>) -> Option<Cone> {
    for [leg, against] in [bodies, [bodies[1], bodies[0]]] {
        if let Some(axis) = leg.and_then(|b| leg_axis(model, data, b, centre)) {
            let home = seen_from(data, against, seen_from_root(data, leg, axis));
            return Some(Cone { name: name.into(), leg, axis, against, home });
        }
    }
    None
}

fn leg_axis(model: &Model, data: &Data, body: usize, centre: Vector3<f64>) -> Option<Vector3<f64>> {
    let own = &model.joints[body];
    if own.kind == JointKind::Prismatic {
        return Some(own.axis);
    }
    let children = || model.joints.iter().filter(|j| j.parent == Some(body));
    if let Some(travel) = children().find(|j| j.kind == JointKind::Prismatic) {
        return Some(travel.placement.rotation * travel.axis);
    }
    let centre = data.pose_wb[body].inverse().transform_point(&centre);
    let ends = model.loops.iter().flat_map(|l| [&l.a, &l.b]).filter(|f| f.body == Some(body)).map(|f| f.pose.translation);
    let held: Vec<Vector3<f64>> =
        core::iter::once(Vector3::zeros()).chain(children().map(|j| j.placement.translation)).chain(ends).collect();
    let mut others = held.iter().filter(|p| (*p - centre).norm() > ONE_POINT);
    let first = others.next()?;
    others.all(|p| (p - first).norm() < ONE_POINT).then(|| (first - centre).normalize())
}
