//! The mass properties of something that rides on a link of a robot that is known: what is in the hand, or on the platform.

use faer::Mat;
use pkm_dyn::effects::Robot;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};

use crate::Recording;
use crate::answer::Estimated;
use crate::columns::{Columns, Quantity};
use crate::error::InputError;
use crate::estimate::feasible::{Outcome, Prior, Space, feasible};
use crate::estimate::least_squares;
use crate::estimate::weighted::{drive_noise, scatter};
use crate::factor::{Factor, Factors};
use crate::grouping::{BaseSet, Choice};
use crate::motion::Use;
use crate::note::{Note, Status};
use crate::observation::{Observation, RowOptions, Rows};
use crate::statistics::{Residual, Sandwich, critical_95, residual_series};

/// Pivots below this share of the largest count as zero.
const TOLERANCE: f64 = 1e-6;

/// Weight of the prior per row: it decides what the motion leaves open.
const WEIGHT: f64 = 1e-6;

/// Gyration radius that the search starts from `[m]`.
const EXTENT: f64 = 0.05;

/// Coefficient of another parameter, beside the mass, below which it has no part in it `[1/m]` or `[1/m²]`.
const ALONE: f64 = 1e-6;

/// Relative half width of the interval of the mass above which the payload is not seen.
const WIDE: f64 = 0.5;

/// A payload.
#[derive(Debug, Clone, PartialEq)]
pub struct Payload {
    /// The link it rides on.
    pub link: String,
    /// Whether it may be used.
    pub status: Status,
    /// What speaks against it.
    pub notes: Vec<Note>,
    /// A body that can exist, about the link's frame.
    pub body: InertialParameters,
    /// What the motion shows of it: combinations of the ten parameters with their intervals, before anything physical is asked.
    pub shown: Vec<Estimated>,
}

/// What rides on the link of that name while `recordings` were made of `robot`, whose own parameters are taken to be right.
///
/// # Errors
/// Recordings that do not fit the robot; a link that it does not have.
pub fn payload(robot: &Robot, recordings: &[Recording], link: &str, rows: RowOptions) -> Result<Payload, InputError> {
    let pairs: Vec<(&Recording, Use)> = recordings.iter().map(|r| (r, Use::Fit)).collect();
    let observation = Observation::try_new(robot, &pairs, rows)?;
    let columns = observation.columns();
    let names = || columns.links.iter().map(|&l| robot.model.links[l].name.as_str()).collect::<Vec<_>>().join(", ");
    let bad = || InputError::Carrier { link: link.to_string(), robot: robot.model.name.clone(), known: names() };
    let of_link = |q: Quantity| matches!(q, Quantity::Inertial { link: l, .. } if robot.model.links[l].name == link);
    let own: Vec<usize> = (0..columns.len()).filter(|&j| of_link(columns.list[j].quantity)).collect();
    if own.len() != N_INERTIAL {
        return Err(bad());
    }
    let nominal = columns.nominal();
    let factors = Factors::of(&observation, Rows::Fitted, &mut |_| {})?.less(&nominal);
    let usable: Vec<bool> = (0..factors.n_drives()).map(|k| factors.drive(k).count() > 0).collect();
    let size = |k: usize| 1.0 / (factors.drive(k).effort_square() / factors.drive(k).count().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let even: Vec<f64> = (0..usable.len()).map(|k| if usable[k] { size(k) } else { 0.0 }).collect();
    let Some(set) = BaseSet::new(&factors.weighted(&even).triangle(), &own, TOLERANCE, Choice::BestConditioned) else {
        let body = InertialParameters::default();
        let link = link.to_string();
        return Ok(Payload { link, status: Status::NotIdentified, notes: vec![Note::NoMotion], body, shown: Vec::new() });
    };
    let noise = drive_noise(&factors, &set.kept, &usable);
    let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
    let all: Factor = factors.weighted(&weights);
    let triangle = all.triangle();
    let values = least_squares::ordinary(&triangle, &set.kept);
    let shown = shown(&observation, &set, &values, &noise)?;
    let mut notes = Vec::new();
    // A combination of the mass with first moments is no mass.
    let is_alone = |i: usize| set.kept[i] == own[0] && (0..set.eliminated.len()).all(|j| set.grouping[(i, j)].abs() < ALONE);
    let weighed = (0..set.rank()).find(|&i| is_alone(i)).map(|i| &shown[i]);
    let mass = weighed.map_or(0.0, |e| e.value);
    let is_seen = weighed.is_some_and(|e| e.ci95[0] > 0.0 && e.ci95[1] - e.ci95[0] < 2.0 * WIDE * e.value);
    if !is_seen {
        let interval = weighed.map_or([0.0, 0.0], |e| e.ci95);
        notes.push(Note::PayloadNotSeen { link: link.to_string(), mass, interval });
    }
    let (body, outcome, iterations) = physical(&triangle, all.count(), &own, mass);
    if outcome == Outcome::Failed {
        notes.push(Note::Solver { outcome: "failed", iterations });
    }
    Ok(Payload { link: link.to_string(), status: Note::worst(&notes), notes, body, shown })
}

/// The combinations that the motion shows, with intervals.
fn shown(observation: &Observation<'_>, set: &BaseSet, values: &[f64], noise: &[f64]) -> Result<Vec<Estimated>, InputError> {
    let columns = observation.columns();
    let mut theta = columns.nominal();
    theta.iter_mut().zip(scatter(values, &set.kept, columns.len())).for_each(|(x, d)| *x += d);
    let residuals: Vec<Residual> = residual_series(observation, Rows::Fitted, &theta)?
        .iter()
        .map(|s| Residual::of(s, 1.0).shared(observation.drives_per_freedom()))
        .collect();
    let places: Vec<usize> = (0..set.rank()).collect();
    let n = places.len();
    let covariance =
        Sandwich::of(observation, &set.kept, noise, &residuals)?.covariance(&places).unwrap_or_else(|| Mat::from_fn(n, n, |_, _| f64::MAX));
    let critical = critical_95(residuals.iter().map(Residual::bandwidth).fold(0.0, f64::max));
    let each = |i: usize| {
        let sd = covariance[(i, i)].max(0.0).sqrt();
        Estimated {
            name: set.text(i, columns),
            unit: columns.list[set.kept[i]].unit,
            nominal: 0.0,
            value: values[i],
            ci95: [values[i] - critical * sd, values[i] + critical * sd],
            relative_sd: (sd / values[i].abs().max(f64::MIN_POSITIVE)).min(f64::MAX),
        }
    };
    Ok((0..n).map(each).collect())
}

/// The body nearest to the rows among those that can exist; a ball of the estimated mass where the rows say nothing.
fn physical(triangle: &Mat<f64>, count: usize, own: &[usize], mass: f64) -> (InertialParameters, Outcome, u32) {
    let inertia = nalgebra::Matrix3::identity() * (mass.max(1e-3) * EXTENT * EXTENT);
    let ball = InertialParameters::from_centre_of_mass(mass.max(1e-3), nalgebra::Vector3::zeros(), inertia);
    let columns = Columns::of_body("payload", &ball);
    let target = triangle.ncols() - 1;
    let mut factor = Factor::new(N_INERTIAL);
    for i in 0..triangle.nrows() {
        let row: Vec<f64> = own.iter().map(|&j| triangle[(i, j)]).collect();
        factor.push(&row, triangle[(i, target)], 0.0);
    }
    let free: Vec<usize> = (0..N_INERTIAL).collect();
    let Some(space) = Space::new(&columns, &free, &[0.0; N_INERTIAL], &[1.0; N_INERTIAL]) else { return (ball, Outcome::Failed, 0) };
    let answer = feasible(&factor.triangle(), count, &space, Prior::Entropic, WEIGHT);
    (Columns::inertial(&answer.theta, 0), answer.outcome, answer.iterations)
}
