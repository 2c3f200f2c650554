//! What the nominal robot does along a usual motion: the yardstick for the size of a hidden effect.

use pkm_dyn::Data;
use pkm_dyn::effects::{JointState, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, drive_reduction, walk_to};
use pkm_dyn::math;

use crate::consistent::{Consistent, has_surplus_drives};
use crate::error::SimError;
use crate::plant::check;
use crate::reference::{Reference, Sample};
use crate::scenario::Scenario;
use crate::trajectory::Trajectory;
use pkm_ident::size::rms;

/// Poses along one period.
const POSES: usize = 200;

/// Efforts and motion along one period; outer index drive (or joint), inner index pose.
#[derive(Debug, Clone)]
pub(crate) struct NominalMotion {
    pub(crate) samples: Vec<Sample>,
    /// Effort of each drive, friction included `[N | N·m]`.
    pub(crate) effort: Vec<Vec<f64>>,
    /// Effort of each drive without friction `[N | N·m]`.
    pub(crate) rigid: Vec<Vec<f64>>,
    /// Velocity of each tree joint `[m/s | rad/s]`.
    pub(crate) tree_velocity: Vec<Vec<f64>>,
    /// Motion of each joint per motion of each drive: `reduction[joint][drive]`.
    pub(crate) reduction: Vec<Vec<Vec<f64>>>,
}

impl NominalMotion {
    /// Along the motion of the default scenario with the given seed.
    pub(crate) fn new(robot: &Robot, seed: u64) -> Result<Self, SimError> {
        let options = Scenario { seed, ..Scenario::default() }.reference_options();
        let drawn = Reference::draw(&robot.model, &options)?;
        let samples = if has_surplus_drives(&robot.model) {
            let step = drawn.period_s() / POSES as f64;
            let whole = Consistent::try_new(&robot.model, Box::new(drawn))?;
            let at = |i: usize| {
                let mut sample = Sample::default();
                whole.at(step * i as f64, &mut sample);
                sample
            };
            (0..POSES).map(at).collect()
        } else {
            drawn.one_period(POSES)
        };
        let offsets = vec![0.0; robot.model.n_act()];
        Self::along(robot, samples, &offsets)
    }

    /// Along given samples, every position shifted by `offsets` `[m | rad]`.
    pub(crate) fn along(robot: &Robot, samples: Vec<Sample>, offsets: &[f64]) -> Result<Self, SimError> {
        let model = &robot.model;
        let (n, nv) = (model.n_act(), model.nv());
        let mut data = Data::new(model);
        let mut out = Self {
            effort: vec![Vec::new(); n],
            rigid: vec![Vec::new(); n],
            tree_velocity: vec![Vec::new(); nv],
            reduction: vec![vec![Vec::new(); n]; nv],
            samples,
        };
        let shifted = |s: &Sample| -> Vec<f64> { s.q.iter().zip(offsets).map(|(q, o)| q + o).collect() };
        let start = out.samples.first().map(shifted).unwrap_or_default();
        for closure in [assemble(model, &mut data), walk_to(model, &mut data, &start)] {
            check(&closure, 0.0)?;
        }
        for i in 0..out.samples.len() {
            let closure = inverse_dynamics(model, &mut data, &shifted(&out.samples[i]), &out.samples[i].v, &out.samples[i].a);
            check(&closure, 0.0)?;
            drive_reduction(model, &mut data);
            out.append(robot, &data);
        }
        Ok(out)
    }

    fn append(&mut self, robot: &Robot, data: &Data) {
        let n = self.rigid.len();
        for j in 0..self.tree_velocity.len() {
            self.tree_velocity[j].push(data.v[j]);
            for k in 0..n {
                self.reduction[j][k].push(data.drive_reduction[(j, k)]);
            }
        }
        for k in 0..n {
            let beyond: f64 = (0..self.tree_velocity.len())
                .map(|j| {
                    let load = if robot.model.actuators[k] == j { data.tau_act[k] } else { 0.0 };
                    let viscous = robot.model.joints[j].viscous;
                    let [q, v, a] = [data.q[j], data.v[j], data.a[j]];
                    let state = JointState { q, v, a, sign: math::sign(v), load, viscous, ..JointState::default() };
                    data.drive_reduction[(j, k)] * robot.joint_effort(j, &state)
                })
                .sum();
            self.rigid[k].push(data.tau_act[k]);
            self.effort[k].push(data.tau_act[k] + beyond);
        }
    }

    /// Root mean square of a drive's effort `[N | N·m]`.
    pub(crate) fn effort_rms(&self, k: usize) -> f64 {
        rms(self.effort[k].iter().copied())
    }

    /// Largest change of any drive's effort against `other`, as a share of that drive's rms.
    pub(crate) fn change(&self, other: &Self) -> f64 {
        (0..self.effort.len())
            .map(|k| {
                let difference = self.effort[k].iter().zip(&other.effort[k]).map(|(a, b)| a - b);
                rms(difference) / self.effort_rms(k).max(f64::MIN_POSITIVE)
            })
            .fold(0.0, f64::max)
    }

    /// Where the origin of a link goes along the motion.
    pub(crate) fn path(&self, robot: &Robot, link: usize) -> Result<Path, SimError> {
        let model = &robot.model;
        let mut data = Data::new(model);
        let start = self.samples.first().map(|s| s.q.clone()).unwrap_or_default();
        for closure in [assemble(model, &mut data), walk_to(model, &mut data, &start)] {
            check(&closure, 0.0)?;
        }
        let mut points = Vec::new();
        for s in &self.samples {
            check(&inverse_dynamics(model, &mut data, &s.q, &s.v, &s.a), 0.0)?;
            let l = &model.links[link];
            let point = l.body.map_or(l.pose.translation, |b| data.pose_wb[b].transform_point(&l.pose.translation));
            points.push(point.into());
        }
        Ok(Path { points })
    }
}

/// Points along one period, in the root frame `[m]`.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    points: Vec<[f64; 3]>,
}

impl Path {
    fn distances(&self, of: impl Fn(usize) -> [[f64; 3]; 2]) -> f64 {
        let square = |[a, b]: [[f64; 3]; 2]| (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>();
        rms((0..self.points.len()).map(|i| math::sqrt(square(of(i)))))
    }

    /// Root mean square of the distance from the first point `[m]`.
    pub(crate) fn displacement(&self) -> f64 {
        self.distances(|i| [self.points[i], self.points[0]])
    }

    /// Root mean square of the speed when the period takes `period_s` `[m/s]`.
    pub(crate) fn speed(&self, period_s: f64) -> f64 {
        let n = self.points.len();
        self.distances(|i| [self.points[i], self.points[(i + 1) % n]]) * n as f64 / period_s
    }
}
