//! Positions measured besides those that determine the motion: passive joints, second sensors on the link's side, motion capture, and of
//! more drives than freedoms those in surplus.
//!
//! They need no effort to say that a length, an encoder or a transmission is wrong, and they are rows of the same regression: what shifts
//! the robot shifts them. Of a pose its position is used.

use core::f64::consts::TAU;

use pkm_dyn::Data;
use pkm_dyn::effects::Robot;
use pkm_dyn::jacobian::{Reference, frame_jacobian};
use pkm_dyn::model::{FrameOnBody, Model, SensorKind};
use pkm_ident::Recording;

/// What a channel measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Position of a joint that no drive moves.
    Passive(usize),
    /// Position of a drive's joint on the link's side.
    Link(usize),
    /// Coordinate of a pose sensor's frame in the root's: sensor, axis.
    Pose(usize, usize),
    /// Position of a drive that the others determine, where there are more drives than freedoms: against what the loops have for all.
    Surplus(usize),
}

impl Kind {
    /// Whether its zero is taken for unknown: a second encoder is zeroed by whoever mounts it, motion capture is calibrated, and
    /// the encoders of drives are what the robot's files are about.
    fn has_free_zero(self) -> bool {
        !matches!(self, Self::Pose(..) | Self::Surplus(_))
    }

    /// Column of a recording.
    pub(crate) fn column(self, model: &Model) -> String {
        match self {
            Self::Passive(j) => format!("q.{}", model.joints[j].name),
            Self::Link(k) => format!("q_link.{}", model.joints[model.actuators[k]].name),
            Self::Surplus(k) => format!("q.{}", model.joints[model.actuators[k]].name),
            Self::Pose(s, axis) => format!("pose.{}.{}", model.sensors[s].name, ["x", "y", "z"][axis]),
        }
    }
}

/// One channel along a segment.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub(crate) kind: Kind,
    /// As measured, `None` where this recording has no such column `[m | rad]`.
    pub(crate) measured: Option<Vec<f64>>,
    /// As the model has it at the drives' positions.
    pub(crate) nominal: Vec<f64>,
    /// Change per unit of position of each drive: [drive][sample].
    pub(crate) by_drive: Vec<Vec<f64>>,
    /// Change per metre of each length: [3·place + axis][sample].
    pub(crate) by_length: Vec<Vec<f64>>,
}

/// Channels that any of the recordings has, at least half of it known.
pub(crate) fn kinds(robot: &Robot, recordings: &[&Recording]) -> Vec<Kind> {
    let model = &robot.model;
    let passive = model.passive().into_iter().map(Kind::Passive);
    let link = (0..model.n_act()).map(Kind::Link);
    let sensors = model.sensors.iter().enumerate().filter(|(_, s)| s.kind == SensorKind::Pose);
    let pose = sensors.flat_map(|(s, _)| (0..3).map(move |axis| Kind::Pose(s, axis)));
    let is_recorded = |kind: &Kind| recordings.iter().any(|r| signal(model, r, *kind).is_some());
    let surplus = (Data::new(model).n_ind()..model.n_act()).map(Kind::Surplus);
    passive.chain(link).chain(pose).chain(surplus).filter(is_recorded).collect()
}

/// The channel's column, if at least half of it is known.
pub(crate) fn signal<'r>(model: &Model, r: &'r Recording, kind: Kind) -> Option<&'r [f64]> {
    let column = r.signal(&kind.column(model))?;
    let known = column.iter().filter(|x| x.is_finite()).count();
    (known > 0 && 2 * known >= column.len()).then_some(column)
}

/// What a channel reads at the pose in `data`, whose drives are at `q`.
pub(crate) fn value(model: &Model, data: &Data, kind: Kind, q: &[f64]) -> f64 {
    match kind {
        Kind::Passive(j) => data.q[j],
        Kind::Link(k) => q[k],
        Kind::Surplus(k) => data.q[model.actuators[k]],
        Kind::Pose(s, axis) => {
            let frame = frame(model, s);
            let pose = frame.body.map_or(frame.pose, |b| data.pose_wb[b].compose(&frame.pose));
            pose.translation[axis]
        }
    }
}

/// Change of a channel per unit of position of each drive, at the pose in `data`.
pub(crate) fn by_drive(model: &Model, data: &mut Data, kind: Kind) -> Vec<f64> {
    let n = model.n_act();
    match kind {
        Kind::Passive(j) => (0..n).map(|k| data.drive_reduction[(j, k)]).collect(),
        // The reading itself moves as well: what is compared is the loops' position with it.
        Kind::Surplus(own) => (0..n).map(|k| data.drive_reduction[(model.actuators[own], k)] - f64::from(u8::from(k == own))).collect(),
        Kind::Link(own) => (0..n).map(|k| f64::from(u8::from(k == own))).collect(),
        Kind::Pose(s, axis) => {
            let frame = frame(model, s);
            let jacobian = frame_jacobian(model, data, &frame, Reference::LocalWorldAligned).clone();
            (0..n).map(|k| (0..model.nv()).map(|j| jacobian[(axis, j)] * data.drive_reduction[(j, k)]).sum()).collect()
        }
    }
}

fn frame(model: &Model, sensor: usize) -> FrameOnBody {
    let sensor = &model.sensors[sensor];
    let link = &model.links[sensor.link];
    FrameOnBody { body: link.body, pose: link.pose.compose(&sensor.pose) }
}

impl Channel {
    /// Brings a turning joint's reading within half a turn of the model's: where its zero lies in turns is nobody's fault.
    pub(crate) fn unwrap_turns(&mut self) {
        let Kind::Passive(_) = self.kind else { return };
        let Some(measured) = &mut self.measured else { return };
        let (Some(first), Some(nominal)) = (measured.first().copied(), self.nominal.first()) else { return };
        let turns = TAU * ((first - nominal) / TAU).round();
        measured.iter_mut().for_each(|x| *x -= turns);
    }

    /// A series of this channel without what its unknown zero would take up.
    pub(crate) fn settled(&self, mut x: Vec<f64>, valid: &[bool]) -> Vec<f64> {
        if !self.kind.has_free_zero() {
            return x;
        }
        let (n, sum) = x.iter().zip(valid).filter(|(_, ok)| **ok).fold((0_usize, 0.0), |(n, sum), (x, _)| (n + 1, sum + x));
        let mean = sum / n.max(1) as f64;
        x.iter_mut().for_each(|x| *x -= mean);
        x
    }

    /// Measured and nominal reading, about the nominal's mean, so that their size is that of the motion; zeros where nothing is measured.
    pub(crate) fn rows(&self, valid: &[bool]) -> [Vec<f64>; 2] {
        let n = self.nominal.len();
        let Some(measured) = &self.measured else { return [vec![0.0; n], vec![0.0; n]] };
        let mean = self.nominal.iter().sum::<f64>() / n.max(1) as f64;
        let about = |x: &[f64]| x.iter().map(|x| x - mean).collect::<Vec<f64>>();
        [self.settled(about(measured), valid), self.settled(about(&self.nominal), valid)]
    }
}
