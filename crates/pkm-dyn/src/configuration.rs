//! Positions of the tree as a space of their own: moving along a velocity, the way from one position to another.
//!
//! For a joint with one coordinate that is addition and subtraction. Joints with several ([`Compound`]) turn, and turns do not add: their
//! coordinates are a rotation vector, their velocities are the child's in its own frame.

use nalgebra::{Matrix3, Vector3};

use crate::math;
use crate::model::{Compound, Model, Part};
use crate::spatial::{log3, rotation_exp, skew};

/// Moves tree coordinates `q` `[m | rad]` by a velocity held for unit time, `dv = v·dt` `[m | rad]`, nv each, in place.
pub fn integrate(model: &Model, q: &mut [f64], dv: &[f64]) {
    for (i, joint) in model.joints.iter().enumerate() {
        match joint.part {
            Part::Whole => q[i] += dv[i],
            Part::First(compound) => advance(compound, &mut q[i..i + compound.n()], &dv[i..i + compound.n()]),
            Part::Inner | Part::Last => {}
        }
    }
}

/// The velocity that, held for unit time, leads from `from` to `to` `[m | rad]`, nv each: written to `dv`.
pub fn difference(model: &Model, from: &[f64], to: &[f64], dv: &mut [f64]) {
    for (i, joint) in model.joints.iter().enumerate() {
        match joint.part {
            Part::Whole => dv[i] = to[i] - from[i],
            Part::First(compound) => {
                let n = compound.n();
                way(compound, &from[i..i + n], &to[i..i + n], &mut dv[i..i + n]);
            }
            Part::Inner | Part::Last => {}
        }
    }
}

/// Quaternion `[x, y, z, w]` of a rotation vector `[rad]`: how Pinocchio and ROS write the coordinates of balls and flying bodies.
#[must_use]
pub fn quaternion(turn: [f64; 3]) -> [f64; 4] {
    let angle = math::sqrt(turn.iter().map(|t| t * t).sum());
    let (s, c) = math::sin_cos(0.5 * angle);
    let k = if angle > 1e-12 { s / angle } else { 0.5 };
    [turn[0] * k, turn[1] * k, turn[2] * k, c]
}

fn advance(compound: Compound, q: &mut [f64], dv: &[f64]) {
    match compound {
        Compound::Spherical => {
            let turned = rotation_exp(&vector(q, 0)) * rotation_exp(&vector(dv, 0));
            q.copy_from_slice(log3(&turned).as_slice());
        }
        Compound::Planar => {
            let (v, w) = (Vector3::new(dv[0], dv[1], 0.0), Vector3::new(0.0, 0.0, dv[2]));
            let step = rotation_exp(&Vector3::new(0.0, 0.0, q[2])) * (left_jacobian(&w) * v);
            (q[0], q[1], q[2]) = (q[0] + step.x, q[1] + step.y, q[2] + dv[2]);
        }
        Compound::Free => {
            let (turn, w) = (rotation_exp(&vector(q, 3)), vector(dv, 3));
            let step = turn * (left_jacobian(&w) * vector(dv, 0));
            let turned = log3(&(turn * rotation_exp(&w)));
            for k in 0..3 {
                q[k] += step[k];
                q[3 + k] = turned[k];
            }
        }
    }
}

fn way(compound: Compound, from: &[f64], to: &[f64], dv: &mut [f64]) {
    let turn = |a: &[f64], b: &[f64], k: usize| log3(&(rotation_exp(&vector(a, k)).transpose() * rotation_exp(&vector(b, k))));
    let (w, step, r) = match compound {
        Compound::Spherical => {
            dv.copy_from_slice(turn(from, to, 0).as_slice());
            return;
        }
        Compound::Planar => {
            let r = rotation_exp(&Vector3::new(0.0, 0.0, from[2]));
            // Less than half a turn: farther round it is another way to the same place.
            let turns = math::round((to[2] - from[2]) / core::f64::consts::TAU);
            (
                Vector3::new(0.0, 0.0, to[2] - from[2] - turns * core::f64::consts::TAU),
                Vector3::new(to[0] - from[0], to[1] - from[1], 0.0),
                r,
            )
        }
        Compound::Free => (turn(from, to, 3), vector(to, 0) - vector(from, 0), rotation_exp(&vector(from, 3))),
    };
    // The left Jacobian is far from singular below a whole turn; here there is at most half a one.
    let v = left_jacobian(&w).try_inverse().unwrap_or_else(Matrix3::identity) * (r.transpose() * step);
    if compound == Compound::Planar {
        dv.copy_from_slice(&[v.x, v.y, w.z]);
    } else {
        dv[..3].copy_from_slice(v.as_slice());
        dv[3..].copy_from_slice(w.as_slice());
    }
}

fn vector(x: &[f64], from: usize) -> Vector3<f64> {
    Vector3::new(x[from], x[from + 1], x[from + 2])
}

/// `∫₀¹ exp(s·[w]×) ds`: where a body goes that flies along and turns at once.
fn left_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let squared = w.dot(w);
    let angle = math::sqrt(squared);
    let (b, c) = if angle < 1e-2 {
        // Series: the closed form loses its digits here. Truncation below 1e-16.
        (0.5 - squared / 24.0 + squared * squared / 720.0, 1.0 / 6.0 - squared / 120.0 + squared * squared / 5040.0)
    } else {
        let (s, c) = math::sin_cos(angle);
        ((1.0 - c) / squared, (angle - s) / (squared * angle))
    };
    let x = skew(w);
    Matrix3::identity() + x * b + x * x * c
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::InertialParameters;
    use crate::model::ModelBuilder;
    use crate::spatial::Pose;

    fn model(compound: Compound) -> Model {
        let mut b = ModelBuilder::new("one", [0.0, 0.0, -9.81]);
        b.link("base", InertialParameters::default()).link("body", InertialParameters::default());
        b.compound_joint("joint", compound, ("base", "body"), Pose::identity());
        b.build().unwrap()
    }

    #[test]
    fn difference_undoes_integrate() {
        for compound in [Compound::Spherical, Compound::Planar, Compound::Free] {
            let m = model(compound);
            let n = compound.n();
            let from: Vec<f64> = (0..n).map(|k| 0.3 - 0.2 * k as f64).collect();
            let dv: Vec<f64> = (0..n).map(|k| 0.7 * (k as f64 + 1.0) * if k % 2 == 0 { 0.4 } else { -0.3 }).collect();
            for scale in [1.0, 1e-3, 1e-9] {
                let dv: Vec<f64> = dv.iter().map(|x| x * scale).collect();
                let mut to = from.clone();
                integrate(&m, &mut to, &dv);
                let mut back = vec![0.0; n];
                difference(&m, &from, &to, &mut back);
                assert!(back.iter().zip(&dv).all(|(b, d)| (b - d).abs() < 1e-14), "{compound:?} {scale}: {back:?} {dv:?}");
            }
        }
    }

    #[test]
    fn integrate_is_the_pose_moved_by_the_exponential_of_the_twist() {
        // A twist of a quarter turn about z with unit speed along x travels on a circle of radius 2/π.
        let m = model(Compound::Free);
        let quarter = core::f64::consts::FRAC_PI_2;
        let mut q = vec![0.0; 6];
        integrate(&m, &mut q, &[1.0, 0.0, 0.0, 0.0, 0.0, quarter]);
        let want = [1.0 / quarter, 1.0 / quarter, 0.0, 0.0, 0.0, quarter];
        assert!(q.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-15), "{q:?}");
        let turned = quaternion([0.0, 0.0, quarter]);
        let want = [0.0, 0.0, core::f64::consts::FRAC_1_SQRT_2, core::f64::consts::FRAC_1_SQRT_2];
        assert!(turned.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-15), "{turned:?}");
    }
}
