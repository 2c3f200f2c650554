//! Joints with several coordinates, as Pinocchio reads them from a URDF.
//!
//! A flying body is read as it is. The normal of a plane is taken for z, whatever the file says, so that a plane gets frames of its own. A
//! ball is not read; it is hinges about x, y and z through massless links, which the toolbox makes a ball again.

use nalgebra::{Matrix3, Vector3};
use urdf_rs::JointType;

use super::{Writing, origin, turning};
use crate::configuration::quaternion;
use crate::math;
use crate::model::Model;
use crate::spatial::{Pose, rotation_exp};

impl Writing {
    /// Rewrites joints with several coordinates and notes where they are in the closed assembly `q` `[m | rad]`.
    pub(super) fn several(&mut self, model: &Model, q: &[f64]) {
        // Joints that come in addition are not of several coordinates; none of the others changes its index.
        for at in 0..self.urdf.joints.len() {
            let (name, kind) = (self.urdf.joints[at].name.clone(), self.urdf.joints[at].joint_type.clone());
            let coordinate = |last: &str| model.joint_index(&format!("{name}.{last}"));
            match (kind, coordinate("x"), coordinate("rx")) {
                (JointType::Spherical, _, Some(j)) => self.ball(at, &rotation_exp(&Vector3::new(q[j], q[j + 1], q[j + 2]))),
                (JointType::Planar, Some(j), _) => {
                    self.plane(at);
                    let (s, c) = math::sin_cos(q[j + 2]);
                    self.home.push((name, format!("{:?}", [q[j], q[j + 1], c, s])));
                }
                (JointType::Floating, Some(j), _) => {
                    let turn = quaternion([q[j + 3], q[j + 4], q[j + 5]]);
                    self.home.push((name, format!("{:?}", [&q[j..j + 3], &turn].concat())));
                }
                _ => {}
            }
        }
    }

    fn ball(&mut self, at: usize, turned: &Matrix3<f64>) {
        let old = self.urdf.joints[at].clone();
        let crosses = [self.link(&format!("{}_x", old.name)), self.link(&format!("{}_y", old.name))];
        let ends = [[old.parent.link.as_str(), &crosses[0]], [&crosses[0], &crosses[1]], [&crosses[1], old.child.link.as_str()]];
        for (k, angle) in xyz_angles(turned).into_iter().enumerate() {
            let wanted = format!("{}_r{}", old.name, ["x", "y", "z"][k]);
            let joint = self.joint(&wanted, JointType::Revolute, ends[k], &Pose::identity());
            joint.axis.xyz.0 = Vector3::ith(k, 1.0).into();
            joint.dynamics.clone_from(&old.dynamics);
            if k == 0 {
                joint.origin = old.origin.clone();
            }
            let name = joint.name.clone();
            self.home.push((name, format!("{angle:?}")));
        }
        // The last hinge takes the ball's place, so that the others keep theirs.
        self.urdf.joints.swap_remove(at);
    }

    fn plane(&mut self, at: usize) {
        let old = self.urdf.joints[at].clone();
        let axis = Vector3::from(old.axis.xyz.0);
        let rotation = turning(&Vector3::z(), &(axis / math::sqrt(axis.dot(&axis))));
        if rotation == Matrix3::identity() {
            return;
        }
        let turn = Pose { rotation, translation: Vector3::zeros() };
        let before = self.link(&format!("{}_plane", old.name));
        let after = self.link(&format!("{}_body", old.name));
        self.joint(&format!("{before}_joint"), JointType::Fixed, [&old.parent.link, &before], &Pose::identity()).origin =
            old.origin.clone();
        let frame = self.link(&format!("{}_normal", old.name));
        self.joint(&format!("{frame}_joint"), JointType::Fixed, [&before, &frame], &turn);
        self.joint(&format!("{after}_joint"), JointType::Fixed, [&after, &old.child.link], &turn.inverse());
        let joint = &mut self.urdf.joints[at];
        (joint.origin, joint.axis.xyz.0) = (origin(&Pose::identity()), [0.0, 0.0, 1.0]);
        (joint.parent.link, joint.child.link) = (frame, after);
    }
}

/// Angles `[rad]` of `Rx(a)·Ry(b)·Rz(c)`.
fn xyz_angles(r: &Matrix3<f64>) -> [f64; 3] {
    let cosine = math::hypot(r[(0, 0)], r[(0, 1)]);
    let b = math::atan2(r[(0, 2)], cosine);
    // Where the first and the last axis are one, the first angle says it all.
    if cosine < 1e-12 {
        return [math::atan2(r[(2, 1)], r[(1, 1)]), b, 0.0];
    }
    [math::atan2(-r[(1, 2)], r[(2, 2)]), b, math::atan2(-r[(0, 1)], r[(0, 0)])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::rotation_about;

    #[test]
    fn angles_of_hinges_in_a_row_come_back() {
        let of = |a: [f64; 3]| {
            let turn = |k: usize| rotation_about(&Vector3::ith(k, 1.0), a[k]);
            turn(0) * turn(1) * turn(2)
        };
        for angles in [[0.3, -0.7, 2.0], [-3.0, 1.5, 0.1], [0.4, core::f64::consts::FRAC_PI_2, -0.2]] {
            let back = of(xyz_angles(&of(angles)));
            assert!((back - of(angles)).amax() < 1e-15, "{angles:?}");
        }
    }
}
