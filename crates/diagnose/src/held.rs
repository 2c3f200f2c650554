//! Links that something outside may hold or push: where they go, and how a wrench on them is felt at the drives.

use pkm_dyn::effects::{Law, LinkState, Robot, Site};
use pkm_dyn::jacobian::{Reference, frame_jacobian};
use pkm_dyn::kinematics::frame_pose;
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};

use crate::shelf::{Shelf, Tape};

/// Where on a link something holds it. Nobody knows where a hand lies: it is looked for at both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Spot {
    /// The link's origin, which may be a joint at its rim.
    Origin,
    /// Its centre of mass.
    Centre,
}

/// Centres of mass nearer to the link's origin than this are no other spot `[m]`.
const APART: f64 = 1e-3;

/// A spot on a link along a segment, in the root frame. Components are force or translation first; innermost index: raw sample.
#[derive(Debug, Clone)]
pub(crate) struct Held {
    pub(crate) link: usize,
    pub(crate) spot: Spot,
    /// The spot in the link's frame `[m]`.
    pub(crate) at: [f64; 3],
    /// Position of the spot `[m]`.
    pub(crate) position: [Vec<f64>; 3],
    /// Displacement since the first sample `[m]`, then the rotation vector since then `[rad]`.
    pub(crate) displacement: [Vec<f64>; 6],
    /// Velocity of the spot `[m/s]`, then the link's angular velocity `[rad/s]`.
    pub(crate) velocity: [Vec<f64>; 6],
    /// Effort of each drive per unit of each component of a wrench of the robot on its environment: [component][drive].
    pub(crate) push: [Vec<Tape>; 6],
    start: Pose,
}

/// Links with mass that carry no other: what a person holds or an obstacle meets first.
pub(crate) fn ends(model: &Model) -> Vec<usize> {
    let massive = model.massive_links();
    let body = |l: usize| model.links[l].body;
    let carries =
        |l: usize| massive.iter().any(|&m| m != l && body(m).is_some_and(|b| body(l).is_some_and(|own| is_behind(model, b, own))));
    massive.iter().copied().filter(|&l| !carries(l)).collect()
}

/// Whether body `b` hangs on body `own` through one joint or more.
fn is_behind(model: &Model, b: usize, own: usize) -> bool {
    let mut at = model.joints[b].parent;
    while let Some(p) = at {
        if p == own {
            return true;
        }
        at = model.joints[p].parent;
    }
    false
}

/// Spots to follow: origins of the ends and of links that the robot's files put a wrench on, and centres of mass of the ends.
fn followed(robot: &Robot) -> Vec<(usize, Spot, [f64; 3])> {
    let mut links = ends(&robot.model);
    let n_ends = links.len();
    let stated = robot.effects.iter().filter(|e| e.site == Site::Link && matches!(e.entry.law, Law::Wrench(_))).map(|e| e.place);
    for link in stated {
        if !links.contains(&link) {
            links.push(link);
        }
    }
    let centre = |&link: &usize| {
        let (at, _) = robot.model.links[link].parameters.centre_of_mass();
        (at.norm() > APART).then(|| (link, Spot::Centre, at.into()))
    };
    let centres: Vec<(usize, Spot, [f64; 3])> = links[..n_ends].iter().filter_map(centre).collect();
    links.into_iter().map(|link| (link, Spot::Origin, [0.0; 3])).chain(centres).collect()
}

impl Held {
    /// Every spot that is followed, with room for `n` samples and `drives` drives, on `shelf`.
    pub(crate) fn all(robot: &Robot, size: (usize, usize), shelf: &Shelf) -> Vec<Self> {
        followed(robot).into_iter().map(|spot| Self::new(spot, size, shelf)).collect()
    }

    /// The spot of that link.
    pub(crate) fn find(all: &[Self], link: usize, spot: Spot) -> Option<&Self> {
        all.iter().find(|h| h.link == link && h.spot == spot)
    }

    fn new((link, spot, at): (usize, Spot, [f64; 3]), (drives, n): (usize, usize), shelf: &Shelf) -> Self {
        let zero = || vec![0.0; n];
        Self {
            link,
            spot,
            at,
            position: core::array::from_fn(|_| zero()),
            displacement: core::array::from_fn(|_| zero()),
            velocity: core::array::from_fn(|_| zero()),
            push: core::array::from_fn(|_| vec![Tape::new(shelf); drives]),
            start: Pose::identity(),
        }
    }

    /// Stores sample `i` from the poses, velocities and the drives' reduction in `data`.
    pub(crate) fn store(&mut self, model: &Model, data: &mut Data, i: usize) {
        let link = &model.links[self.link];
        let spot = Pose { translation: self.at.into(), ..Pose::identity() };
        let frame = FrameOnBody { body: link.body, pose: link.pose.compose(&spot) };
        let pose = frame_pose(data, &frame);
        if i == 0 {
            self.start = pose;
        }
        let turn = Pose { rotation: pose.rotation * self.start.rotation.transpose(), translation: pose.translation }.rotation_vector();
        for c in 0..3 {
            self.position[c][i] = pose.translation[c];
            self.displacement[c][i] = pose.translation[c] - self.start.translation[c];
            self.displacement[3 + c][i] = turn[c];
        }
        frame_jacobian(model, data, &frame, Reference::LocalWorldAligned);
        let (jacobian, reduction) = (&data.jacobian, &data.drive_reduction);
        for c in 0..6 {
            let row = jacobian.row(c);
            self.velocity[c][i] = row.iter().zip(&data.v).map(|(j, v)| j * v).sum();
            for (k, push) in self.push[c].iter_mut().enumerate() {
                push.push(row.iter().zip(reduction.column(k).iter()).map(|(j, g)| j * g).sum());
            }
        }
    }

    /// The state a law sees at sample `i`, of a link's origin.
    pub(crate) fn state(&self, i: usize, time: f64) -> LinkState {
        let turn = nalgebra::Vector3::from_fn(|c, _| self.displacement[3 + c][i]);
        LinkState {
            position: core::array::from_fn(|c| self.position[c][i]),
            displacement: core::array::from_fn(|c| self.displacement[c][i]),
            velocity: core::array::from_fn(|c| self.velocity[c][i]),
            axes: (Pose::from_rotation_vector(&turn).rotation * self.start.rotation).into(),
            time,
        }
    }

    /// Effort of drive `k` under a wrench of the robot on its environment, given by some of its components: [component][sample].
    pub(crate) fn felt(&self, wrench: &[Vec<f64>], components: core::ops::Range<usize>, k: usize) -> Vec<f64> {
        let mut out = vec![0.0; self.position[0].len()];
        for (w, push) in wrench.iter().zip(&self.push[components]) {
            out.iter_mut().zip(w).zip(push[k].read()).for_each(|((sum, w), p)| *sum += w * p);
        }
        out
    }
}
