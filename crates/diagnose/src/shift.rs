//! Efforts that a shift of a drive or of the ground takes, to first order: what sensors, transmissions and mountings have in common.

use pkm_dyn::math;
use pkm_ident::filter::derivative;

use crate::channels::Channel;
use crate::motion::{Motion, soft_sign};

/// Change of the effort of every drive, and of every channel after them, when drive `j` is at `q + e(t)` where its reading is `q`:
/// [drive or channel][sample].
pub(crate) fn of_reading(m: &Motion, j: usize, e: &[f64]) -> Vec<Vec<f64>> {
    let rate = derivative(e, m.segment.dt);
    let acceleration = derivative(&rate, m.segment.dt);
    let s = &m.sensitivity;
    let effort = |k: usize| {
        let [offset, by_rate, mass] = [&s.offset, &s.rate, &s.mass].map(|table| s.at_samples(&table[j][k]));
        (0..e.len()).map(|i| offset[i] * e[i] + by_rate[i] * rate[i] + mass[i] * acceleration[i]).collect()
    };
    let channel = |c: &Channel| of_channel(m, c, |i| c.by_drive[j][i] * e[i]);
    (0..m.rigid.len()).map(effort).chain(m.channels.iter().map(channel)).collect()
}

/// A channel's part of a column; zero where this recording does not measure it.
fn of_channel(m: &Motion, c: &Channel, x: impl Fn(usize) -> f64) -> Vec<f64> {
    let n = m.segment.valid.len();
    if c.measured.is_none() { vec![0.0; n] } else { c.settled((0..n).map(x).collect(), &m.segment.valid) }
}

/// Change of every drive's effort and of every channel per metre of a length: [drive or channel][sample].
pub(crate) fn of_length(m: &Motion, length: usize) -> Vec<Vec<f64>> {
    let channel = |c: &Channel| of_channel(m, c, |i| c.by_length[length][i]);
    m.sensitivity.length[length].iter().map(|knots| m.sensitivity.at_samples(knots)).chain(m.channels.iter().map(channel)).collect()
}

/// The same when only the load is shifted: the rotor turns as its sensor says.
pub(crate) fn of_load(m: &Motion, j: usize, e: &[f64]) -> Vec<Vec<f64>> {
    let mut out = of_reading(m, j, e);
    let acceleration = derivative(&derivative(e, m.segment.dt), m.segment.dt);
    out[j].iter_mut().zip(acceleration).for_each(|(out, a)| *out -= m.rotor[j] * a);
    out
}

/// On which side of its transmission a drive's friction acts: in the bearings and guides of the load, or in motor and gearing, where it never
/// passes through what gives way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FrictionOf {
    Load,
    Motor,
}

/// Both sides.
pub(crate) const EITHER_SIDE: [FrictionOf; 2] = [FrictionOf::Load, FrictionOf::Motor];

/// Effort that passes through drive `j`'s transmission, the rotor's own inertia left out: [sample].
pub(crate) fn passing(m: &Motion, j: usize, friction: FrictionOf) -> Vec<f64> {
    match friction {
        FrictionOf::Load => m.transmitted[j].clone(),
        FrictionOf::Motor => m.rigid[j].iter().zip(&m.segment.a[j]).map(|(t, a)| t - m.rotor[j] * a).collect(),
    }
}

/// Per unit of compliance of drive `j`'s transmission: the load stays behind by the effort that passes.
pub(crate) fn of_compliance(m: &Motion, j: usize, friction: FrictionOf) -> Vec<Vec<f64>> {
    let behind: Vec<f64> = passing(m, j, friction).iter().map(|t| -t).collect();
    of_load(m, j, &behind)
}

/// Per unit of gap of drive `j`'s transmission: the load rests on one end of the play, on the side that passes the effort.
pub(crate) fn of_play(m: &Motion, j: usize, friction: FrictionOf) -> Vec<Vec<f64>> {
    let behind: Vec<f64> = side(&passing(m, j, friction)).iter().map(|s| -0.5 * s).collect();
    of_load(m, j, &behind)
}

/// Per unit of compliance of the mounting: the ground is pushed away by the robot's reaction, and its acceleration is felt.
pub(crate) fn of_mounting(m: &Motion) -> Vec<Vec<f64>> {
    let dt = m.segment.dt;
    let away: Vec<Vec<f64>> = m.reaction.iter().map(|force| derivative(&derivative(force, dt), dt).iter().map(|a| -a).collect()).collect();
    (0..m.rigid.len())
        .map(|k| {
            let shaken = m.shaken.each_ref().map(|axis| axis[k].read());
            (0..m.segment.valid.len()).map(|i| (0..3).map(|axis| shaken[axis][i] * away[axis][i]).sum()).collect()
        })
        .chain(m.channels.iter().map(|_| vec![0.0; m.segment.valid.len()]))
        .collect()
}

/// Sign of an effort, passing through zero over a twentieth of its rms: a gap is crossed, not jumped over.
pub(crate) fn side(effort: &[f64]) -> Vec<f64> {
    let width = 0.05 * math::sqrt(effort.iter().map(|t| t * t).sum::<f64>() / effort.len().max(1) as f64);
    effort.iter().map(|t| soft_sign(*t, width)).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};
    use pkm_dyn::effects::Robot;
    use pkm_dyn::model::{JointKind, Model, ModelBuilder};
    use pkm_dyn::parameters::InertialParameters;
    use pkm_dyn::spatial::Pose;

    use super::*;
    use crate::segment::Segment;
    use crate::shelf::Shelf;
    use crate::verdict::Use;

    const DT: f64 = 0.005;
    const N: usize = 600;
    const MASS: f64 = 2.0;
    const LENGTH: f64 = 0.3;
    const ROTOR: f64 = 0.05;
    const G: f64 = 9.81;

    /// Series of a function of time.
    fn series(f: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..N).map(|i| f(DT * i as f64)).collect()
    }

    /// Point masses at the end of arms of one length, one behind the other, turning about y or sliding along x.
    fn arms(kinds: &[JointKind]) -> Model {
        let mut builder = ModelBuilder::new("arms", [0.0, 0.0, -G]);
        builder.link("base", InertialParameters::default());
        for (i, &kind) in kinds.iter().enumerate() {
            let parent = if i == 0 { "base".to_string() } else { format!("l{}", i - 1) };
            let point = InertialParameters::from_centre_of_mass(MASS, Vector3::new(LENGTH, 0.0, 0.0), Matrix3::zeros());
            builder.link(&format!("l{i}"), point);
            let axis = if kind == JointKind::Revolute { Vector3::y() } else { Vector3::x() };
            let x = if i == 0 { 0.0 } else { LENGTH };
            builder.moving_joint(&format!("j{i}"), kind, (&parent, &format!("l{i}")), Pose::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]), axis);
        }
        let mut model = builder.build().expect("a chain is a tree");
        for i in 0..kinds.len() {
            model.add_actuator(&format!("j{i}"), ROTOR).expect("joint is there");
        }
        model
    }

    fn motion_of(model: Model, q: Vec<Vec<f64>>, v: Vec<Vec<f64>>, a: Vec<Vec<f64>>) -> Motion {
        let n = q.len();
        let segment = Segment {
            name: "A".to_string(),
            samples: N,
            duration: DT * N as f64,
            used: Use::Train,
            start: 0.0,
            dt: DT,
            band: 5.0,
            q,
            v,
            a,
            tau: vec![vec![0.0; N]; n],
            warmth: vec![Vec::new(); n],
            extra: alloc::collections::BTreeMap::default(),
            valid: vec![true; N],
            gravity: None,
            load: None,
            shelf: Shelf::default(),
            wrenches: Vec::new(),
            channels: Vec::new(),
        };
        crate::motion::motion(&Robot::new(model, Vec::new()), segment).unwrap_or_else(|e| panic!("{e}"))
    }

    /// One arm that swings by 0.6·sin(2t).
    fn pendulum() -> Motion {
        let (q, v, a) = (series(|t| 0.6 * math::sin(2.0 * t)), series(|t| 1.2 * math::cos(2.0 * t)), series(|t| -2.4 * math::sin(2.0 * t)));
        motion_of(arms(&[JointKind::Revolute]), vec![q], vec![v], vec![a])
    }

    fn assert_close(what: &str, got: &[f64], want: &[f64], share: f64) {
        let top = want.iter().fold(0.0_f64, |t, x| t.max(x.abs()));
        // One-sided differences at the ends are not what is tested.
        for i in 5..N - 5 {
            assert!((got[i] - want[i]).abs() < share * top, "{what}, sample {i}: {} instead of {}", got[i], want[i]);
        }
    }

    #[test]
    fn a_shifted_pendulum_feels_weight_and_inertia_of_the_shift() {
        let m = pendulum();
        let e = series(|t| math::sin(3.0 * t));
        // tau = (m·l² + J)·a − m·g·l·cos(q); its change along q and a.
        let inertia = MASS * LENGTH * LENGTH + ROTOR;
        let slope = |t: f64| MASS * G * LENGTH * math::sin(0.6 * math::sin(2.0 * t));
        let want = series(|t| slope(t) * math::sin(3.0 * t) - 9.0 * inertia * math::sin(3.0 * t));
        assert_close("reading", &of_reading(&m, 0, &e)[0], &want, 2e-3);
        let want = series(|t| slope(t) * math::sin(3.0 * t) - 9.0 * (inertia - ROTOR) * math::sin(3.0 * t));
        assert_close("load", &of_load(&m, 0, &e)[0], &want, 2e-3);
    }

    #[test]
    fn a_soft_transmission_leaves_the_load_behind_by_the_effort_that_passes() {
        let m = pendulum();
        let passes = series(|t| {
            let (q, a) = (0.6 * math::sin(2.0 * t), -2.4 * math::sin(2.0 * t));
            MASS * LENGTH * LENGTH * a - MASS * G * LENGTH * math::cos(q)
        });
        assert_close("transmitted", &m.transmitted[0], &passes, 1e-9);
        let second = derivative(&derivative(&passes, DT), DT);
        let want: Vec<f64> = (0..N)
            .map(|i| {
                let slope = MASS * G * LENGTH * math::sin(m.segment.q[0][i]);
                -slope * passes[i] - MASS * LENGTH * LENGTH * second[i]
            })
            .collect();
        assert_close("compliance", &of_compliance(&m, 0, FrictionOf::Load)[0], &want, 2e-3);
        // Play of one unit: half of it, to the side that the effort pushes; here the weight always pushes one way.
        let sides = side(&m.transmitted[0]);
        assert!(sides.iter().all(|s| *s < -0.9), "{sides:?}");
    }

    #[test]
    fn friction_of_the_motor_does_not_pass_through_the_transmission() {
        let mut model = arms(&[JointKind::Prismatic]);
        let joint = model.actuators[0];
        model.joints[joint].viscous = 7.0;
        let (q, v, a) = (series(|t| t * t), series(|t| 2.0 * t), series(|_| 2.0));
        let m = motion_of(model, vec![q], vec![v], vec![a]);
        assert_close("of the motor", &passing(&m, 0, FrictionOf::Motor), &[2.0 * MASS; N], 1e-9);
        assert_close("of the load", &passing(&m, 0, FrictionOf::Load), &series(|t| 2.0 * MASS + 14.0 * t), 1e-9);
    }

    #[test]
    fn ground_that_gives_way_to_a_slider_takes_its_acceleration_with_it() {
        let w = 4.0;
        let (q, v, a) = (series(|t| math::sin(w * t)), series(|t| w * math::cos(w * t)), series(|t| -w * w * math::sin(w * t)));
        let m = motion_of(arms(&[JointKind::Prismatic]), vec![q], vec![v], vec![a]);
        // u = −m·a/k, so the drive feels m·ü = −m²·a''/k.
        let want = series(|t| -MASS * MASS * w * w * w * w * math::sin(w * t));
        assert_close("mounting", &of_mounting(&m)[0], &want, 2e-3);
        assert_close("reaction", &m.reaction[2], &vec![MASS * G; N], 1e-9);
    }

    #[test]
    fn a_longer_arm_carries_the_next_ones_weight_further_out() {
        let q = vec![series(|t| 0.5 * t), series(|t| 0.2 - 0.3 * t)];
        let still = || vec![vec![0.0; N]; 2];
        let m = motion_of(arms(&[JointKind::Revolute; 2]), q.clone(), still(), still());
        // Places are links that a joint moves: l0, l1; of the second, x is along the first arm.
        let want: Vec<f64> = q[0].iter().map(|q| -MASS * G * math::cos(*q)).collect();
        assert_close("length", &of_length(&m, 3)[0], &want, 1e-4);
        assert!(of_length(&m, 3)[1].iter().all(|x| x.abs() < 1e-4), "the second arm's own effort does not change");
    }
}
