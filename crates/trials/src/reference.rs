//! Reference motions: sums of sines with random phases, kept inside the limits of a robot, and the effort its nominal model asks for.

use core::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};

use crate::math::{cos, sin};
use crate::plant::{Moving, Plant};
use crate::random::Stream;
use crate::robot::RobotError;

/// Step of simulations and of references `[s]`.
pub const STEP: f64 = 1e-3;

/// A recording begins when the robot has moved for this long `[s]`.
pub const LEAD: f64 = 1.0;

/// A periodic motion of the free coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Middle of the motion `[m | rad]`.
    pub centre: Vec<f64>,
    /// Per coordinate and harmonic: amplitude `[m | rad]` and phase `[rad]`.
    pub sines: Vec<Vec<[f64; 2]>>,
    /// Period `[s]`.
    pub period: f64,
}

impl Path {
    /// Random phases; `harmonics` sines per coordinate whose amplitudes fall like 1/k, with the largest excursion about `reach`.
    #[must_use]
    pub fn random(centre: &[f64], reach: &[f64], (period, harmonics): (f64, usize), random: &mut Stream) -> Self {
        let mut sines: Vec<Vec<[f64; 2]>> = Vec::new();
        for &reach in reach {
            let one: Vec<[f64; 2]> = (1..=harmonics).map(|k| [random.uniform(0.6, 1.0) / k as f64, random.uniform(0.0, TAU)]).collect();
            let value = |u: f64| one.iter().enumerate().map(|(k, [a, p])| a * sin(TAU * (k + 1) as f64 * u + p)).sum::<f64>().abs();
            let peak = (0..400).map(|i| value(f64::from(i) / 400.0)).fold(1e-9, f64::max);
            sines.push(one.iter().map(|[a, p]| [a * reach / peak, *p]).collect());
        }
        Self { centre: centre.to_vec(), sines, period }
    }

    /// Position, velocity and acceleration of the free coordinates at `t` `[s]`.
    #[must_use]
    pub fn at(&self, t: f64) -> [DVector<f64>; 3] {
        let n = self.centre.len();
        let mut out = [DVector::from_column_slice(&self.centre), DVector::zeros(n), DVector::zeros(n)];
        for (i, sines) in self.sines.iter().enumerate() {
            for (k, [a, p]) in sines.iter().enumerate() {
                let w = TAU * (k + 1) as f64 / self.period;
                let (s, c) = (sin(w * t + p), cos(w * t + p));
                out[0][i] += a * s;
                out[1][i] += a * w * c;
                out[2][i] -= a * w * w * s;
            }
        }
        out
    }

    /// The same path with smaller excursions.
    #[must_use]
    pub fn shrunk(&self, factor: f64) -> Self {
        let sines = self.sines.iter().map(|s| s.iter().map(|[a, p]| [a * factor, *p]).collect()).collect();
        Self { sines, ..self.clone() }
    }
}

/// What the controller is given at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// Positions of the drives `[m | rad]`.
    pub q: DVector<f64>,
    /// Their velocities.
    pub v: DVector<f64>,
    /// Their accelerations.
    pub a: DVector<f64>,
    /// Effort of the nominal rigid robot `[N | N·m]`.
    pub feedforward: DVector<f64>,
}

/// A reference on the grid of [`STEP`], beginning [`LEAD`] before the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// One entry per step.
    pub rows: Vec<Wanted>,
    /// Coordinates of all joints of the nominal robot at the first row.
    pub start: Vec<f64>,
    /// The same in the middle of the path, the same of every path of a robot.
    pub middle: Vec<f64>,
    /// Velocities of the free coordinates at the first row.
    pub start_velocity: DVector<f64>,
    /// Length of the recording `[s]`.
    pub duration: f64,
}

/// Rows of the joints' ratios that belong to the drives.
#[must_use]
pub fn drive_ratio(plant: &Plant, m: &Moving) -> DMatrix<f64> {
    let rows: Vec<usize> = plant.robot.drives.iter().map(|d| d.joint).collect();
    m.ratio.select_rows(&rows)
}

/// Smallest efforts of the drives that make the force `force` on the free coordinates; none where the drives cannot.
#[must_use]
pub fn efforts(ratio: &DMatrix<f64>, force: &DVector<f64>) -> Option<DVector<f64>> {
    (ratio.tr_mul(ratio)).cholesky().map(|c| ratio * c.solve(force))
}

impl Reference {
    /// Follows `path` with the nominal robot for `duration` `[s]`.
    ///
    /// # Errors
    /// Where it leaves the limits of a joint, or its loops open.
    pub fn along(plant: &Plant, path: &Path, duration: f64) -> Result<Self, RobotError> {
        let [first, first_velocity, _] = path.at(-LEAD);
        let middle = from_home(plant, &path.centre)?;
        let start = from_home(plant, first.as_slice())?;
        let mut q = start.clone();
        let count = steps(duration + LEAD) + 2;
        let mut rows = Vec::with_capacity(count);
        for i in 0..count {
            let [x, v, a] = path.at(i as f64 * STEP - LEAD);
            plant.free.iter().enumerate().for_each(|(k, &j)| q[j] = x[k]);
            let m = plant.moving(&mut q, v.as_slice())?;
            check(plant, &q, &m.velocity)?;
            let ratio = drive_ratio(plant, &m);
            let force = &m.mass * &a + &m.bias;
            let feedforward = efforts(&ratio, &force).ok_or_else(|| RobotError::Unknown("drives that cannot move it".to_string()))?;
            let all = &m.ratio * &a + &m.ratio_bias;
            let of_drives =
                |x: &dyn Fn(usize) -> f64| DVector::from_iterator(plant.robot.drives.len(), plant.robot.drives.iter().map(|d| x(d.joint)));
            rows.push(Wanted { q: of_drives(&|j| q[j]), v: of_drives(&|j| m.velocity[j]), a: of_drives(&|j| all[j]), feedforward });
        }
        Ok(Self { rows, start, middle, start_velocity: first_velocity, duration })
    }

    /// Shrinks `path` until the robot can follow it.
    ///
    /// # Errors
    /// When it cannot follow even a hundredth of it.
    pub fn inside_limits(plant: &Plant, path: &Path, duration: f64) -> Result<Self, RobotError> {
        let mut path = path.clone();
        let mut outcome = Self::along(plant, &path, duration);
        for _ in 0..20 {
            if outcome.is_ok() {
                break;
            }
            path = path.shrunk(0.8);
            outcome = Self::along(plant, &path, duration);
        }
        outcome
    }
}

/// Coordinates of all joints where the free ones are `free`, which may be far from home: in small steps, so that the loops stay on their branch.
fn from_home(plant: &Plant, free: &[f64]) -> Result<Vec<f64>, RobotError> {
    let mut q = plant.home.clone();
    for i in 1..=40 {
        let share = f64::from(i) / 40.0;
        plant.free.iter().zip(free).for_each(|(&j, x)| q[j] = plant.home[j] + share * (x - plant.home[j]));
        plant.close(&mut q)?;
    }
    Ok(q)
}

/// Number of steps in `duration` `[s]`.
#[must_use]
pub fn steps(duration: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "seconds to minutes of steps")]
    let n = (duration / STEP).round().max(0.0) as usize;
    n
}

fn check(plant: &Plant, q: &[f64], velocity: &DVector<f64>) -> Result<(), RobotError> {
    for (i, j) in plant.robot.joints.iter().enumerate() {
        let margin = 0.02 * (j.limits[1] - j.limits[0]);
        let is_inside = q[i] >= j.limits[0] + margin && q[i] <= j.limits[1] - margin;
        if !is_inside || velocity[i].abs() > j.speed {
            return Err(RobotError::Unknown(format!("joint {} leaves its limits", j.name)));
        }
    }
    Ok(())
}
