//! The output of a robot: a frame on one of its bodies, the six coordinates of its pose, and their rates.

use alloc::string::{String, ToString};

use nalgebra::{DMatrix, Vector3};

use crate::data::Data;
use crate::math;
use crate::model::{FrameOnBody, Model, SensorKind};
use crate::spatial::Pose;

/// A named frame on a body, whose motion is what the robot is for.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Name of the link, sensor or loop that has the frame.
    pub name: String,
    /// The frame.
    pub frame: FrameOnBody,
}

impl Output {
    /// The frame of the link, else of the sensor, else of the loop (its frame a, or b where a is fixed to the root) of that name.
    #[must_use]
    pub fn named(model: &Model, name: &str) -> Option<Self> {
        let of = |frame| Some(Self { name: name.to_string(), frame });
        if let Some(l) = model.link_index(name) {
            return of(FrameOnBody { body: model.links[l].body, pose: model.links[l].pose });
        }
        if let Some(s) = model.sensors.iter().find(|s| s.name == name) {
            let link = &model.links[s.link];
            return of(FrameOnBody { body: link.body, pose: link.pose.compose(&s.pose) });
        }
        let l = model.loops.iter().find(|l| l.name == name)?;
        of(if l.a.body.is_some() { l.a } else { l.b })
    }

    /// The frame that is meant when none is named; none where nothing stands out.
    ///
    /// In this order: the only pose sensor; the link that more loops end on than on any other; the only loop, where it joins two moving
    /// bodies; without loops, the only link at the end of a chain.
    #[must_use]
    pub fn evident(model: &Model) -> Option<Self> {
        let mut poses = model.sensors.iter().filter(|s| s.kind == SensorKind::Pose);
        if let (Some(one), None) = (poses.next(), poses.next()) {
            return Self::named(model, &one.name);
        }
        let ends = |body: usize| model.loops.iter().flat_map(|l| [l.a.body, l.b.body]).filter(|b| *b == Some(body)).count();
        let most = (0..model.nv()).map(ends).max().unwrap_or(0);
        let mut best = (0..model.nv()).filter(|&b| ends(b) == most);
        let body = match (model.loops.as_slice(), best.next(), best.next()) {
            ([], ..) => {
                let mut last = (0..model.nv()).filter(|&b| model.joints.iter().all(|j| j.parent != Some(b)));
                last.next().filter(|_| last.next().is_none())?
            }
            (_, Some(body), None) => body,
            ([only], ..) if only.a.body.is_some() && only.b.body.is_some() => return Self::named(model, &only.name),
            _ => return None,
        };
        // Of a body's links the last one: a flange is fixed to its wrist, not the wrist to the flange.
        let link = model.links.iter().rfind(|l| l.body == Some(body))?;
        Self::named(model, &link.name)
    }

    /// The frame's pose in the root frame, from the poses of the bodies in `data`.
    #[must_use]
    pub fn pose(&self, data: &Data) -> Pose {
        self.frame.body.map_or(self.frame.pose, |b| data.pose_wb[b].compose(&self.frame.pose))
    }
}

/// Coordinates of a pose: x y z `[m]`, then rx ry rz `[rad]` with rotation `Rx(rx)·Ry(ry)·Rz(rz)`.
///
/// At ry = ±90 degrees rx and rz turn about one axis and are not determined.
#[must_use]
pub fn coordinates(pose: &Pose) -> [f64; 6] {
    let (p, r) = (pose.translation, pose.rotation);
    let rx = math::atan2(-r[(1, 2)], r[(2, 2)]);
    let ry = math::atan2(r[(0, 2)], math::hypot(r[(0, 0)], r[(0, 1)]));
    let rz = math::atan2(-r[(0, 1)], r[(0, 0)]);
    [p.x, p.y, p.z, rx, ry, rz]
}

/// Rates of [`coordinates`] per rate of each tree coordinate, 6 × nv, from the poses in `data` (last [`crate::loops::loop_gap`]).
pub fn output_jacobian(model: &Model, data: &Data, output: &Output, jacobian: &mut DMatrix<f64>) {
    jacobian.fill(0.0);
    let pose = output.pose(data);
    let [_, _, _, rx, ry, _] = coordinates(&pose);
    let ((sa, ca), (sb, cb)) = (math::sin_cos(rx), math::sin_cos(ry));
    let mut at = output.frame.body;
    while let Some(j) = at {
        let w = data.axis_w[j].angular;
        let p: Vector3<f64> = data.axis_w[j].linear + w.cross(&pose.translation);
        // w = rx'·x + ry'·Rx·y + rz'·Rx·Ry·z, solved for the rates.
        let rz = (w.z * ca - w.y * sa) / cb;
        let rates = [p.x, p.y, p.z, w.x - rz * sb, w.y * ca + w.z * sa, rz];
        for (i, rate) in rates.into_iter().enumerate() {
            jacobian[(i, j)] = rate;
        }
        at = model.joints[j].parent;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_those_of_the_rotation_they_make() {
        let (a, b, c) = (0.4, -0.7, 1.9);
        let about = |xyz: [f64; 3]| Pose::from_xyz_rpy([0.0; 3], xyz);
        let mut pose = about([a, 0.0, 0.0]).compose(&about([0.0, b, 0.0])).compose(&about([0.0, 0.0, c]));
        pose.translation = Vector3::new(1.0, 2.0, 3.0);
        let got = coordinates(&pose);
        for (g, w) in got.iter().zip([1.0, 2.0, 3.0, a, b, c]) {
            assert!((g - w).abs() < 1e-15, "{got:?}");
        }
    }
}
