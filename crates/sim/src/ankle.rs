//! Exercises of an ankle, for robots that move one: gait and an isokinetic exercise \[Arceo2021, Table 3 and eq. 12\].
//!
//! The angle of the foot is a function of time; a robot's single drive follows by inverse kinematics, which here is closing its loops with
//! the ankle as the drive.

use nalgebra::{SMatrix, SVector};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::Model;

use crate::error::SimError;
use crate::plant::check;
use crate::reference::Sample;
use crate::trajectory::Trajectory;

use core::f64::consts::PI;

/// Times of the events of gait, initial contact to initial contact, 9, 49, 62 and 89 % of four seconds `[s]` \[Arceo2021, Table 3\].
const EVENTS_S: [f64; 6] = [0.0, 0.36, 1.96, 2.48, 3.56, 4.0];

/// Angles of the ankle there `[rad]` \[Arceo2021, Table 3\].
const EVENTS: [f64; 6] = [1.6179, 1.5874, 1.863, 1.45, 1.6895, 1.6179];

/// Coefficients of the printed polynomial, of t⁰ to t¹¹.
const POLYNOMIAL: [f64; 12] = [1.6123, 0.7538, -9.8969, 41.7027, -83.9365, 95.2514, -65.7025, 28.5069, -7.8109, 1.3103, -0.1227, 0.0049];

/// Until here four decimals of its coefficients fix the polynomial to 0.055 rad `[s]`; at 4 s it is at −11 rad.
const POLYNOMIAL_S: f64 = 1.75;

/// Number of parts of the table from the ankle to the drive: its quintic pieces are then exact to rounding.
const PARTS: usize = 400;

/// Times per period at which the range of an exercise is looked for.
const LOOKS: usize = 2000;

/// The table reaches so far beyond the exercise `[rad]`: more than the angle can pass between two looks at its range.
const BEYOND: f64 = 2e-3;

/// What the foot does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnkleExercise {
    /// A cycle of gait of four seconds: the periodic cubic spline through the events of Table 3.
    Gait,
    /// The polynomial that the paper prints for gait, as far as its rounded coefficients reach; the foot stands afterwards.
    GaitPolynomial,
    /// Turns at constant speeds and rests between them, 7.5 s per cycle (12).
    Isokinetic,
}

impl AnkleExercise {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Gait, Self::GaitPolynomial, Self::Isokinetic];

    /// Name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Gait => "gait",
            Self::GaitPolynomial => "gait-polynomial",
            Self::Isokinetic => "isokinetic",
        }
    }

    /// Length of a cycle, or of the whole where there is only one `[s]`.
    #[must_use]
    pub fn length_s(self) -> f64 {
        match self {
            Self::Gait => EVENTS_S[5],
            Self::GaitPolynomial => POLYNOMIAL_S,
            Self::Isokinetic => 7.5,
        }
    }

    /// Whether it begins anew after its length.
    #[must_use]
    pub fn repeats(self) -> bool {
        self != Self::GaitPolynomial
    }
}

/// The angle of the foot over time.
#[derive(Debug, Clone, PartialEq)]
pub struct AnkleAngle {
    exercise: AnkleExercise,
    /// Second derivatives of the spline at the events `[rad/s²]`.
    bend: [f64; 6],
}

impl AnkleAngle {
    /// Of an exercise.
    #[must_use]
    pub fn new(exercise: AnkleExercise) -> Self {
        Self { exercise, bend: periodic_bends() }
    }

    /// Angle `[rad]`, velocity `[rad/s]` and acceleration `[rad/s²]` at time `t` `[s]`; before time 0 as at time 0.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
        let (t, length) = (t.max(0.0), self.exercise.length_s());
        match self.exercise {
            AnkleExercise::Gait => self.spline(t % length),
            AnkleExercise::GaitPolynomial if t > length => [printed_gait(length)[0], 0.0, 0.0],
            AnkleExercise::GaitPolynomial => printed_gait(t),
            AnkleExercise::Isokinetic => isokinetic(t % length),
        }
    }

    fn spline(&self, t: f64) -> [f64; 3] {
        let i = EVENTS_S.partition_point(|&x| x <= t).clamp(1, 5) - 1;
        let h = EVENTS_S[i + 1] - EVENTS_S[i];
        let (x, y) = ((EVENTS_S[i + 1] - t) / h, (t - EVENTS_S[i]) / h);
        let (q0, q1, b0, b1) = (EVENTS[i], EVENTS[i + 1], self.bend[i], self.bend[i + 1]);
        [
            x * q0 + y * q1 + h * h / 6.0 * ((x * x * x - x) * b0 + (y * y * y - y) * b1),
            (q1 - q0) / h + h / 6.0 * ((3.0 * y * y - 1.0) * b1 - (3.0 * x * x - 1.0) * b0),
            x * b0 + y * b1,
        ]
    }
}

/// The printed polynomial of gait with its derivatives, at any time `t` `[s]`, also where it means nothing.
#[must_use]
pub fn printed_gait(t: f64) -> [f64; 3] {
    // Horner's scheme for value and derivatives at once.
    POLYNOMIAL.iter().rev().fold([0.0; 3], |[p, v, a], c| [p * t + c, v * t + p, a * t + 2.0 * v])
}

/// Equation (12) with 110 and 80 degrees where it rounds them.
fn isokinetic(t: f64) -> [f64; 3] {
    let [angle, speed] = match t {
        t if t < 0.75 => [PI * (7.0 - 2.0 * t) / 9.0, -2.0 * PI / 9.0],
        t if t < 2.25 => [11.0 * PI / 18.0, 0.0],
        t if t < 3.75 => [PI * (31.0 - 4.0 * t) / 36.0, -PI / 9.0],
        t if t < 4.5 => [4.0 * PI / 9.0, 0.0],
        t => [PI * (2.0 * t - 1.0) / 18.0, PI / 9.0],
    };
    [angle, speed, 0.0]
}

/// Second derivatives of the periodic cubic spline through the events: continuity of the slope at each of them.
fn periodic_bends() -> [f64; 6] {
    let h = |i: usize| EVENTS_S[i + 1] - EVENTS_S[i];
    let slope = |i: usize| (EVENTS[i + 1] - EVENTS[i]) / h(i);
    let (mut a, mut b) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
    for i in 0..5 {
        let before = (i + 4) % 5;
        a[(i, before)] += h(before);
        a[(i, i)] += 2.0 * (h(before) + h(i));
        a[(i, (i + 1) % 5)] += h(i);
        b[i] = 6.0 * (slope(i) - slope(before));
    }
    // Diagonally dominant: there is always a solution.
    let m = a.lu().solve(&b).unwrap_or_default();
    [m[0], m[1], m[2], m[3], m[4], m[0]]
}

/// Which joint of a robot is an ankle, and which angle it calls zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ankle {
    /// Name of the robot.
    pub robot: &'static str,
    /// The joint.
    pub joint: &'static str,
    /// Angle of the foot where the joint reads zero `[rad]`.
    pub zero: f64,
}

/// The shipped robots that move an ankle. Their joints read zero in the middle of the piston's travel; the angle there is equation (4),
/// mended, solved for it.
pub const ANKLES: [Ankle; 2] = [
    Ankle { robot: "motobotte", joint: "phi", zero: 2.026_134_139_999_739_2 },
    Ankle { robot: "motobotte_table", joint: "phi", zero: 1.944_962_555_797_94 },
];

impl Ankle {
    /// Of the robot of that name.
    #[must_use]
    pub fn of(robot: &str) -> Option<Self> {
        ANKLES.into_iter().find(|ankle| ankle.robot == robot)
    }
}

/// An exercise of the foot as a motion of the robot's single drive.
#[derive(Debug, Clone, PartialEq)]
pub struct AnkleMotion {
    angle: AnkleAngle,
    low: f64,
    width: f64,
    /// Position of the drive with its first two derivatives by the angle, at the ends of the table's parts.
    nodes: Vec<[f64; 3]>,
}

impl AnkleMotion {
    /// Of `exercise` on the robot `model`.
    ///
    /// # Errors
    /// A robot without that joint or with another number of drives than one; an exercise at which its loops do not close.
    pub fn try_new(model: &Model, ankle: Ankle, exercise: AnkleExercise) -> Result<Self, SimError> {
        let angle = AnkleAngle::new(exercise);
        let step = exercise.length_s() / LOOKS as f64;
        let looks = (0..=LOOKS).map(|i| angle.at(step * i as f64)[0]);
        let (low, high) = looks.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
        let (low, high) = (low - BEYOND, high + BEYOND);
        let width = (high - low) / PARTS as f64;
        let nodes = drive_over_angle(model, ankle.joint, (0..=PARTS).map(|i| low + width * i as f64 - ankle.zero))?;
        Ok(Self { angle, low, width, nodes })
    }

    /// Position of the drive with its first two derivatives by the angle `phi` of the foot `[rad]`.
    fn drive(&self, phi: f64) -> [f64; 3] {
        let place = ((phi - self.low) / self.width).clamp(0.0, PARTS as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and PARTS")]
        let i = (place as usize).min(PARTS - 1);
        let (s, h) = (place - i as f64, self.width);
        let ([y0, m0, k0], [y1, m1, k1]) = (self.nodes[i], self.nodes[i + 1]);
        let (rise, m0, m1, k0, k1) = (y1 - y0, h * m0, h * m1, h * h * k0, h * h * k1);
        let c = [
            y0,
            m0,
            0.5 * k0,
            10.0 * rise - 6.0 * m0 - 4.0 * m1 - 1.5 * k0 + 0.5 * k1,
            -15.0 * rise + 8.0 * m0 + 7.0 * m1 + 1.5 * k0 - k1,
            6.0 * rise - 3.0 * (m0 + m1) - 0.5 * (k0 - k1),
        ];
        let [p, v, a] = c.iter().rev().fold([0.0; 3], |[p, v, a], c| [p * s + c, v * s + p, a * s + 2.0 * v]);
        [p, v / h, a / (h * h)]
    }
}

impl Trajectory for AnkleMotion {
    fn at(&self, t: f64, out: &mut Sample) {
        let [phi, rate, bend] = self.angle.at(t);
        let [d, slope, curvature] = self.drive(phi);
        for (x, value) in [(&mut out.q, d), (&mut out.v, slope * rate), (&mut out.a, curvature * rate * rate + slope * bend)] {
            x.clear();
            x.push(value);
        }
    }
}

/// Position, slope and curvature of the drive at angles of `joint`, which ascend in small steps.
fn drive_over_angle(model: &Model, joint: &str, mut angles: impl Iterator<Item = f64>) -> Result<Vec<[f64; 3]>, SimError> {
    let none = || SimError::NoCoordinate { robot: model.name.clone(), joint: joint.to_string() };
    let [drive] = model.actuators[..] else { return Err(none()) };
    let mut turned = model.clone();
    turned.actuators.clear();
    turned.add_actuator(joint, 0.0).map_err(|_| none())?;
    let mut data = Data::new(&turned);
    check(&assemble(&turned, &mut data), 0.0)?;
    let mut at = |angle: f64| -> Result<[f64; 3], SimError> {
        check(&walk_to(&turned, &mut data, &[angle]), 0.0)?;
        // At unit speed and without acceleration of the angle, rates of the drive are derivatives by it.
        check(&closed_loop_motion(&turned, &mut data, &[angle], &[1.0], &[0.0]), 0.0)?;
        Ok([data.q[drive], data.v[drive], data.a[drive]])
    };
    angles.try_fold(Vec::new(), |mut nodes, angle| {
        nodes.push(at(angle)?);
        Ok(nodes)
    })
}
