//! Wrenches between links and their surroundings.

use nalgebra::Vector3;
use pkm_dyn::Data;
use pkm_dyn::effects::LinkState;
use pkm_dyn::model::Model;
use pkm_dyn::spatial::{Force, Pose};

use crate::dae::system::State;

/// A wrench law at a link, or at a joint where `joint` says so.
#[derive(Debug)]
pub(crate) struct Touching {
    pub(crate) law: fn(&[f64], &LinkState) -> [f64; 6],
    pub(crate) values: Vec<f64>,
    pub(crate) link: usize,
    pub(crate) joint: Option<usize>,
    /// Pose of the link when the motion began; of a joint, its coordinate in x.
    pub(crate) start: Pose,
}

impl Touching {
    pub(crate) fn at_joint(&self, state: &State, j: usize) -> f64 {
        let mut s = LinkState { time: state.time, ..LinkState::default() };
        s.position[0] = state.q[j];
        s.displacement[0] = state.q[j] - self.start.translation.x;
        s.velocity[0] = state.v[j];
        (self.law)(&self.values, &s)[0]
    }

    /// Wrench on the robot about the root's origin, from poses and velocities in `data`.
    pub(crate) fn on_robot(&self, model: &Model, data: &Data, time: f64) -> Force {
        let pose = link_pose(model, data, self.link);
        let at = pose.translation;
        let moved = at - self.start.translation;
        let turn = Pose { rotation: pose.rotation * self.start.rotation.transpose(), translation: at }.rotation_vector();
        let velocity = model.links[self.link].body.map(|b| data.velocity_w[b].at(&at)).unwrap_or_default();
        let stacked = |a: &Vector3<f64>, b: &Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
        let s = LinkState {
            position: [at.x, at.y, at.z],
            displacement: stacked(&moved, &turn),
            velocity: stacked(&velocity.linear, &velocity.angular),
            axes: pose.rotation.into(),
            time,
        };
        let w = (self.law)(&self.values, &s);
        let linear = -Vector3::new(w[0], w[1], w[2]);
        Force { linear, angular: at.cross(&linear) - Vector3::new(w[3], w[4], w[5]) }
    }
}

/// Pose of a link in the root frame, from the poses in `data`.
pub(crate) fn link_pose(model: &Model, data: &Data, link: usize) -> Pose {
    let link = &model.links[link];
    link.body.map_or(link.pose, |b| data.pose_wb[b].compose(&link.pose))
}

/// Adds to `tau` what a wrench about the root's origin does at a link.
pub(crate) fn push_link(model: &Model, data: &Data, tau: &mut [f64], link: usize, wrench: &Force) {
    let mut at = model.links[link].body;
    while let Some(j) = at {
        tau[j] += data.axis_w[j].dot(wrench);
        at = model.joints[j].parent;
    }
}
