//! Values that friction laws are not linear in (a Stribeck velocity, an exponent), by variable projection \[Golub1973\]: for every trial
//! of the shapes the linear parameters are solved for, so that the search runs over the shapes alone.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;

use crate::Recording;
use crate::columns::{is_friction_law, is_linear};
use crate::error::InputError;
use crate::estimate::least_squares;
use crate::estimate::weighted::{drive_noise, scatter};
use crate::factor::Factors;
use crate::minimise::nelder_mead::{Options, nelder_mead};
use crate::minimise::{Bounds, Ending};
use crate::motion::Use;
use crate::observation::{Observation, RowOptions, Rows};
use crate::statistics::{Residual, critical_95, residual_series};

/// Factor that the first step of the search changes a shape by, and the range about the stated value that it stays in.
const FIRST: f64 = 2.0;
const RANGE: f64 = 1000.0;

/// Factors of the stated value at which each shape is tried before the search, in ascending order: the profile has several valleys, since a
/// friction peak as wide as the motion is fast stands for a drag that grows with speed. A valley is the narrower the less the noise, so
/// that trials say where valleys are and not which is the deepest.
const TRIED: [f64; 13] = [1.0 / 27.0, 0.0642, 1.0 / 9.0, 0.1925, 1.0 / 3.0, 0.5774, 1.0, 1.732, 3.0, 5.196, 9.0, 15.59, 27.0];

/// Walks over the recordings to the bottom of a valley, at most, and the first step there: half of that between trials.
const DESCENT: usize = 16;
const STRIDE: f64 = 1.316;

/// Walks over the recordings per shape, at most, those trials apart.
const WALKS: usize = 60;

/// Relative step of the second differences.
const BEND: f64 = 0.1;

/// Pivots below this share of the largest count as zero.
const TOLERANCE: f64 = 1e-6;

/// A shape that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Shape {
    /// `<joint>.<effect>.<parameter>`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// As the robot file states it: the start.
    pub stated: f64,
    /// As found.
    pub value: f64,
    /// 95 % interval, from the curvature of the profile; to an end of the range or to another valley where the shape there does as well as
    /// the one found.
    pub ci95: [f64; 2],
    /// Whether the motion shows this shape: the search ended inside its range, with curvature, and neither an end of it nor another valley
    /// does as well.
    pub is_shown: bool,
}

/// A shape of the robot's file: effect, value, name, unit, lower bound.
struct Place {
    effect: usize,
    value: usize,
    name: String,
    unit: &'static str,
    lower: f64,
}

fn places(robot: &Robot) -> Vec<Place> {
    let mut out = Vec::new();
    for (effect, e) in robot.effects.iter().enumerate().filter(|(_, e)| is_friction_law(e)) {
        let joint = &robot.model.joints[e.place];
        for (value, p) in e.entry.parameters.iter().enumerate().filter(|(k, _)| !is_linear(e, *k)) {
            let name = format!("{}.{}.{}", joint.name, e.entry.name, p.name);
            out.push(Place { effect, value, name, unit: p.unit.text(joint.kind), lower: p.lower });
        }
    }
    out
}

/// The robot with the shapes of its friction laws as the recordings have them, and what was found of each. A robot whose file states no
/// such shape comes back as it is.
///
/// # Errors
/// Recordings that do not fit the robot, a shape that is stated as zero or less.
pub fn projected(robot: &Robot, fit: &[Recording], kind: Use, rows: RowOptions) -> Result<(Robot, Vec<Shape>), InputError> {
    let places = places(robot);
    if places.is_empty() {
        return Ok((robot.clone(), Vec::new()));
    }
    let stated: Vec<f64> = places.iter().map(|p| robot.effects[p.effect].values[p.value]).collect();
    if let Some((p, &value)) = places.iter().zip(&stated).find(|(_, x)| !(x.is_finite() && **x > 0.0)) {
        return Err(InputError::Shape { shape: p.name.clone(), value, robot: robot.model.name.clone() });
    }
    let pairs: Vec<(&Recording, Use)> = fit.iter().map(|r| (r, kind)).collect();
    // The band is that of the motion, whatever the shapes.
    let band = Observation::try_new(robot, &pairs, rows)?.band();
    let rows = RowOptions { band_hz: Some(band), ..rows };
    let mut search = Search { robot: robot.clone(), places: &places, pairs: &pairs, rows, noise: Vec::new(), error: None };
    let start: Vec<f64> = stated.iter().map(|x| math::ln(*x)).collect();
    let bounds: Vec<Bounds> = start
        .iter()
        .zip(&places)
        .map(|(x, p)| Bounds { lower: (x - math::ln(RANGE)).max(math::ln(p.lower.max(f64::MIN_POSITIVE))), upper: x + math::ln(RANGE) })
        .collect();
    let (start, valleys) = search.best_valley(&start, &bounds);
    let steps = vec![math::ln(FIRST); places.len()];
    let options = Options { evaluations: WALKS * places.len(), step: 5e-3, cost: 1e-6 };
    let found = nelder_mead(&mut |x| search.cost(x), &start, &steps, &bounds, &options);
    let values = if found.ending == Ending::NoStart { start } else { found.x };
    let spread = search.spread(&values, &bounds, &valleys)?;
    if let Some(error) = search.error {
        return Err(error);
    }
    let robot = search.with(&values);
    let shape = |(k, p): (usize, &Place)| {
        let at_edge = (values[k] - bounds[k].lower).min(bounds[k].upper - values[k]) < 0.01;
        let Spread { half, alike: [low, high] } = spread[k];
        Shape {
            name: p.name.clone(),
            unit: p.unit,
            stated: stated[k],
            value: math::exp(values[k]),
            ci95: [
                math::exp((values[k] - half).min(low).max(bounds[k].lower)),
                math::exp((values[k] + half).max(high).min(bounds[k].upper)),
            ],
            is_shown: !at_edge && half < math::ln(RANGE) && low >= values[k] && high <= values[k],
        }
    };
    Ok((robot, places.iter().enumerate().map(shape).collect()))
}

/// Interval of a shape's logarithm.
#[derive(Clone, Copy)]
struct Spread {
    /// Half width of the 95 % interval by the curvature; infinite without.
    half: f64,
    /// The lowest and the highest of the shape found, the ends of its range and other valleys, as far as they do as well.
    alike: [f64; 2],
}

struct Search<'s> {
    robot: Robot,
    places: &'s [Place],
    pairs: &'s [(&'s Recording, Use)],
    rows: RowOptions,
    /// Noise of the drives at the first shapes: the unit of the cost.
    noise: Vec<f64>,
    error: Option<InputError>,
}

impl Search<'_> {
    /// The robot with shapes at the exponentials of `x`.
    fn with(&self, x: &[f64]) -> Robot {
        let mut robot = self.robot.clone();
        for (p, x) in self.places.iter().zip(x) {
            robot.effects[p.effect].values[p.value] = math::exp(*x);
        }
        robot
    }

    /// The deepest valley of one shape after the other, and the bottoms of all valleys of each.
    fn best_valley(&mut self, start: &[f64], bounds: &[Bounds]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (mut best, mut valleys) = (start.to_vec(), Vec::new());
        for (k, bound) in bounds.iter().enumerate() {
            let mut at = |x: f64| {
                let mut there = best.clone();
                there[k] = x;
                self.cost(&there)
            };
            let places = TRIED.iter().map(|factor| start[k] + math::ln(*factor)).filter(|x| (bound.lower..=bound.upper).contains(x));
            let tried: Vec<(f64, f64)> = places.map(|x| (at(x), x)).collect();
            let options = Options { evaluations: DESCENT, step: 0.02, cost: 1e-4 };
            let bottom = |(_, x): &(f64, f64)| {
                let found = nelder_mead(&mut |x| at(x[0]), &[*x], &[math::ln(STRIDE)], core::slice::from_ref(bound), &options);
                (found.cost, found.x[0])
            };
            let mut bottoms: Vec<(f64, f64)> = lows(&tried).map(bottom).collect();
            bottoms.sort_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, x)) = bottoms.first().filter(|b| b.0.is_finite()) {
                best[k] = *x;
            }
            valleys.push(bottoms.into_iter().map(|b| b.1).collect());
        }
        (best, valleys)
    }

    /// Weighted squared error of the best linear parameters.
    fn cost(&mut self, x: &[f64]) -> f64 {
        match self.solved(x) {
            Ok((cost, _)) => cost,
            Err(error) => {
                self.error.get_or_insert(error);
                f64::INFINITY
            }
        }
    }

    fn solved(&mut self, x: &[f64]) -> Result<(f64, Vec<f64>), InputError> {
        let robot = self.with(x);
        let observation = Observation::try_new(&robot, self.pairs, self.rows)?;
        let factors = Factors::of(&observation, Rows::Fitted, &mut |_| {})?;
        let usable: Vec<bool> = (0..factors.n_drives()).map(|k| factors.drive(k).count() > 0).collect();
        let size = |k: usize| {
            let d = factors.drive(k);
            if usable[k] { 1.0 / (d.effort_square() / d.count().max(1) as f64).sqrt().max(f64::MIN_POSITIVE) } else { 0.0 }
        };
        let even: Vec<f64> = (0..usable.len()).map(size).collect();
        let kept = independent(&factors.weighted(&even).triangle());
        let noise = drive_noise(&factors, &kept, &usable);
        let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
        let triangle = factors.weighted(&weights).triangle();
        let theta = scatter(&least_squares::ordinary(&triangle, &kept), &kept, factors.n_columns());
        if self.noise.is_empty() {
            self.noise.clone_from(&noise);
        }
        // The likelihood with every drive's noise as these shapes leave it: a yardstick from wrong shapes would not listen to the drive that
        // they spoil. As a power of it, so that it is a squared error about the first shapes.
        let of = |k: usize| factors.drive(k).count() as f64 * 2.0 * math::ln(noise[k] / self.noise[k]);
        let rows: usize = (0..usable.len()).filter(|&k| usable[k]).map(|k| factors.drive(k).count()).sum();
        let rows = rows.max(1) as f64;
        let log: f64 = (0..usable.len()).filter(|&k| usable[k]).map(of).sum();
        Ok((rows * math::exp(log / rows), theta))
    }

    /// Intervals of the logarithms; `valleys` are other places at which each could be.
    fn spread(&mut self, x: &[f64], bounds: &[Bounds], valleys: &[Vec<f64>]) -> Result<Vec<Spread>, InputError> {
        let n = x.len();
        // Errors in units of the noise that the shapes found leave.
        self.noise.clear();
        let (middle, theta) = self.solved(x)?;
        let mut at = |i: usize, k: usize, si: f64, sk: f64| {
            let mut there = x.to_vec();
            there[i] += si * BEND;
            there[k] += sk * BEND;
            self.cost(&there)
        };
        let bend = Mat::from_fn(n, n, |i, k| {
            let second = if i == k {
                at(i, i, 0.5, 0.5) - 2.0 * middle + at(i, i, -0.5, -0.5)
            } else {
                0.25 * (at(i, k, 1.0, 1.0) - at(i, k, 1.0, -1.0) - at(i, k, -1.0, 1.0) + at(i, k, -1.0, -1.0))
            };
            0.5 * second / (BEND * BEND)
        });
        let robot = self.with(x);
        let observation = Observation::try_new(&robot, self.pairs, self.rows)?;
        let residuals: Vec<Residual> = residual_series(&observation, Rows::Fitted, &theta)?
            .iter()
            .map(|s| Residual::of(s, 1.0).shared(observation.drives_per_freedom()))
            .collect();
        let colour = residuals.iter().map(Residual::colour).fold(1.0, f64::max);
        let critical = critical_95(residuals.iter().map(Residual::bandwidth).fold(0.0, f64::max));
        let inverse = bend.llt(Side::Lower).ok().map(|llt| llt.solve(Mat::<f64>::identity(n, n)));
        let mut out = Vec::new();
        for (k, bound) in bounds.iter().enumerate() {
            let half = inverse.as_ref().map_or(f64::INFINITY, |c| critical * (colour * c[(k, k)].max(0.0)).sqrt());
            // A law that is hardly there has a bent profile all the same, between ends at which it is another law's, and a profile has several
            // valleys: the interval of the likelihood ratio goes wherever the error does not grow by more than chance brings.
            let mut alike = [x[k]; 2];
            let others = valleys[k].iter().filter(|place| (**place - x[k]).abs() > half.max(BEND));
            for place in [bound.lower, bound.upper].iter().chain(others) {
                let mut there = x.to_vec();
                there[k] = *place;
                if self.cost(&there) - middle < critical * critical * colour {
                    alike = [alike[0].min(*place), alike[1].max(*place)];
                }
            }
            out.push(Spread { half, alike });
        }
        Ok(out)
    }
}

/// Trials of `(cost, place)` whose neighbours cost no less.
fn lows(tried: &[(f64, f64)]) -> impl Iterator<Item = &(f64, f64)> {
    let cost = move |i: Option<usize>| i.and_then(|i| tried.get(i)).map_or(f64::INFINITY, |t| t.0);
    tried.iter().enumerate().filter(move |(i, t)| t.0 <= cost(i.checked_sub(1)) && t.0 < cost(Some(i + 1))).map(|(_, t)| t)
}

/// Independent columns of a triangle by pivoted QR, ascending.
pub(crate) fn independent(triangle: &Mat<f64>) -> Vec<usize> {
    let p = triangle.ncols() - 1;
    let lengths: Vec<f64> = (0..p).map(|j| triangle.col(j).norm_l2()).collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let acting: Vec<usize> = (0..p).filter(|&j| lengths[j] > 1e-10 * longest).collect();
    let scaled = Mat::from_fn(triangle.nrows(), acting.len(), |i, j| triangle[(i, acting[j])] / lengths[acting[j]]);
    let pivoted = scaled.col_piv_qr();
    let r = pivoted.R();
    let rank = (0..r.nrows().min(r.ncols())).take_while(|&i| r[(i, i)].abs() > TOLERANCE * r[(0, 0)].abs()).count();
    let mut kept: Vec<usize> = pivoted.P().arrays().0[..rank].iter().map(|&j| acting[j]).collect();
    kept.sort_unstable();
    kept
}
