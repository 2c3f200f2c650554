//! From recordings and a nominal robot to parameters, with everything needed to judge them.

mod instrumental;
pub(crate) mod preparation;
mod spread;
pub(crate) mod units;

use faer::Mat;
use pkm_dyn::effects::Robot;

use self::preparation::Prepared;
use self::spread::Spread;
use crate::Recording;
use crate::answer::{BaseSummary, Identification, IdentifyError, Instruments, JointError, Settings, Shapes, Simulate, Term, UsedRecording};
use crate::columns::{Columns, Quantity};
use crate::degrees::other_positions;
use crate::error::InputError;
use crate::estimate::feasible::{Feasible, Outcome, Space, choose_weight, feasible, solid};
use crate::estimate::robust::{Loss, outlier_share, reweighted};
use crate::estimate::weighted::{drive_noise, scatter, weighted_theta};
use crate::estimate::{Method, least_squares};
use crate::factor::{Factors, squared_error};
use crate::grouping::{BaseSet, Choice, structural_factor, well_conditioned};
use crate::motion::Use;
use crate::note::{Note, Status};
use crate::observation::{Observation, Rows};
use crate::preprocess::Done;
use crate::relevant::{Reduction, Step};
use crate::seconds::other_time;
use crate::shapes::{Shape, projected};
use crate::statistics::{Residual, Sandwich, residual_series};

/// Pivots of a recording's columns below this share of the largest count as zero: noise of the positions makes some of nothing.
pub const RANK_TOLERANCE: f64 = 1e-6;

/// The same for random states, where there is no noise.
const STRUCTURAL_TOLERANCE: f64 = 1e-9;

/// States over which the structural rank is taken.
const STATES: usize = 200;

/// Condition number (columns at length one) above which a note is made: what is left of six digits of effort is then one.
const CONDITION_LIMIT: f64 = 1e5;

/// Condition number that published identifications keep to [Armas]: how many base parameters would pass it is reported.
const WELL_CONDITIONED: f64 = 300.0;

/// Rows per parameter, at least.
const ROWS_PER_PARAMETER: usize = 5;

/// Smallest travel, as a share of the stated one, and where none is stated `[m | rad]`.
const TRAVEL_SHARE: f64 = 0.003;
const UNSTATED_TRAVEL: f64 = 1e-3;

/// Outliers above this share make a note.
const OUTLIER_LIMIT: f64 = 0.02;

/// Single samples of effort that had to be replaced: above this share they make a note.
const SPIKE_LIMIT: f64 = 0.005;

/// Squared error of the physical robot over that of the estimate without bounds, above which the two contradict each other.
const CONTRADICTION: f64 = 1.5;

/// Weights of the ridge to choose from, columns at length one.
const RIDGE_WEIGHTS: [f64; 9] = [0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1];

/// Prior that completes base parameters to a physical robot: it decides what the estimate leaves open, and nothing else.
const COMPLETION_WEIGHT: f64 = 1e-7;

/// A drive whose held-out error grows by more than this factor is worse off.
const WORSE: f64 = 1.05;

/// Identifies the parameters of `robot` from recordings.
///
/// Without `holdout` every second of ten blocks of each recording is held out. `progress` is told the share done, 0 to 1.
///
/// # Errors
/// Recordings that do not fit the robot, a robot that cannot move, a method that needs a simulation: one line. Motion that shows too
/// little is no error but a [`Status`].
pub fn identify(
    robot: &Robot,
    fit: &[Recording],
    holdout: &[Recording],
    settings: &Settings,
    progress: &mut dyn FnMut(f64),
) -> Result<Identification, IdentifyError> {
    if settings.method == Method::Iv {
        return Err(IdentifyError::NoSimulation);
    }
    all_of_it(robot, [fit, holdout], settings, None, progress)
}

/// As [`identify`], with a closed loop that can be simulated: what [`Method::Iv`] needs.
///
/// # Errors
/// As [`identify`]. A simulation that fails is no error but a note.
pub fn identify_in_closed_loop(
    robot: &Robot,
    recordings: [&[Recording]; 2],
    settings: &Settings,
    simulate: &mut Simulate<'_>,
    progress: &mut dyn FnMut(f64),
) -> Result<Identification, IdentifyError> {
    all_of_it(robot, recordings, settings, Some(simulate), progress)
}

fn all_of_it<'s>(
    robot: &Robot,
    [fit, holdout]: [&[Recording]; 2],
    settings: &Settings,
    simulate: Option<&'s mut Simulate<'s>>,
    progress: &mut dyn FnMut(f64),
) -> Result<Identification, IdentifyError> {
    let kind = if holdout.is_empty() { Use::Both } else { Use::Fit };
    if fit.is_empty() {
        return Err(InputError::NoRecording.into());
    }
    let times: Vec<Note> = fit.iter().chain(holdout).filter_map(|r| other_time(robot, r)).map(Note::OtherTime).collect();
    let Prepared { fit, holdout, mut done, notes } = Prepared::of(robot, [fit, holdout], settings)?;
    let (robot, shapes) = match settings.shapes {
        Shapes::Stated => (robot.clone(), Vec::new()),
        Shapes::Estimated => projected(robot, &fit, kind, settings.rows)?,
    };
    let all: Vec<(&Recording, Use)> = fit.iter().map(|r| (r, kind)).chain(holdout.iter().map(|r| (r, Use::Holdout))).collect();
    let observation = Observation::try_new(&robot, &all, settings.rows)?;
    let factors = Factors::of(&observation, Rows::Fitted, &mut |x| progress(0.35 * x))?;
    let judged = Factors::of(&observation, Rows::HeldOut, &mut |x| progress(0.35 + 0.35 * x))?;
    let structure = structure(&robot, observation.columns())?;
    done.extend(all.iter().zip(observation.motions()).map(|((r, _), m)| {
        let [cutoff, number] = m.derivative;
        Done::new(r, settings.rows.derivative.name(), "q", &[("cutoff_hz", cutoff), ("size", number)])
    }));
    let positions = all.iter().flat_map(|(r, _)| other_positions(&robot.model, r)).map(Note::OtherPositions);
    let mut work = Work {
        observation: &observation,
        factors,
        judged,
        structure,
        settings,
        notes: times.into_iter().chain(notes).chain(shapes.iter().filter(|s| !s.is_shown).map(not_shown)).chain(positions).collect(),
        usable: Vec::new(),
        recordings: &fit,
        simulate,
        foretold: Vec::new(),
        instruments: None,
        before: (done, shapes),
    };
    let out = work.run(&mut |x| progress(0.7 + 0.3 * x))?;
    progress(1.0);
    Ok(out)
}

fn not_shown(s: &Shape) -> Note {
    Note::ShapeNotShown { shape: s.name.clone(), value: s.value, stated: s.stated }
}

/// The regressor over random states, as a triangle.
fn structure(robot: &Robot, columns: &Columns) -> Result<Mat<f64>, IdentifyError> {
    let mut x = 0.1;
    // Multiples of the golden ratio fill [0, 1) evenly, and are the same every time.
    let mut even = || {
        x = (x * 997.0 + 0.618_033_988_749_895) % 1.0;
        x
    };
    let factor = structural_factor(robot, columns, STATES, &mut even)
        .map_err(|source| IdentifyError::Robot { robot: robot.model.name.clone(), source })?;
    Ok(factor.triangle())
}

struct Work<'w, 'r, 's> {
    observation: &'w Observation<'r>,
    factors: Factors,
    judged: Factors,
    structure: Mat<f64>,
    settings: &'w Settings,
    notes: Vec<Note>,
    /// Drives whose rows take part.
    usable: Vec<bool>,
    /// Recordings that are fitted.
    recordings: &'w [Recording],
    simulate: Option<&'s mut Simulate<'s>>,
    /// The same as the last estimate by instruments foretells them.
    foretold: Vec<Recording>,
    instruments: Option<Instruments>,
    /// What was done and found before the fit.
    before: (Vec<Done>, Vec<Shape>),
}

/// Base parameters and what is known of their spread.
struct Found {
    set: BaseSet,
    sandwich: Sandwich,
    /// Places of the set's kept columns that are estimated.
    places: Vec<usize>,
    steps: Vec<Step>,
}

/// A fit of the free columns.
#[derive(Clone)]
struct Fit {
    /// All parameters, those of a physical robot.
    theta: Vec<f64>,
    /// Parameters that the method itself gave: they predict, but need not be physical.
    direct: Vec<f64>,
    noise: Vec<f64>,
    prior_weight: f64,
    spread: Spread,
}

impl Work<'_, '_, '_> {
    fn run(&mut self, progress: &mut dyn FnMut(f64)) -> Result<Identification, IdentifyError> {
        self.look_at_motion();
        self.notes.extend(units::notes(self.observation)?);
        let free = self.free();
        let set = self.base_set(&free);
        if let Some(set) = &set {
            self.look_at_rows(set);
        }
        let Some(set) = set.filter(|_| Note::worst(&self.notes) != Status::NotIdentified) else {
            return Ok(self.report(&free, None, &Fit::none(self.columns()), &[]));
        };
        let fit = self.fit(&set, &free)?;
        progress(0.3);
        let series = residual_series(self.observation, Rows::Fitted, &fit.direct)?;
        let shared = self.observation.drives_per_freedom();
        let freedom = 1.0 - shared * set.rank() as f64 / self.row_count().max(1) as f64;
        let residuals: Vec<Residual> = series.iter().map(|s| Residual::of(s, freedom).shared(shared)).collect();
        self.look_at_outliers(&series);
        progress(0.6);
        let sandwich = self.sandwich(&set, &fit, &residuals, freedom)?;
        progress(0.9);
        let mut found = Found { places: (0..set.rank()).collect(), set, sandwich, steps: Vec::new() };
        let fit = if self.settings.method == Method::Relevant { self.reduce(&mut found, &free, fit) } else { fit };
        Ok(self.report(&free, Some(&found), &fit, &residuals))
    }

    /// Drops what the recordings do not determine, and completes the rest to a physical robot.
    fn reduce(&mut self, found: &mut Found, free: &[usize], fit: Fit) -> Fit {
        let fixed = self.fixed(free);
        let factors = self.factors.less(&fixed);
        let Some(space) = Space::new(self.columns(), free, &fixed, &self.units(&factors, free)) else { return fit };
        let reduction = Reduction {
            columns: self.columns(),
            factors: &factors,
            judged: &self.judged,
            set: &found.set,
            sandwich: &found.sandwich,
            space: &space,
            fixed: &fixed,
            noise: &fit.noise,
        };
        let (steps, places, direct) = reduction.run();
        (found.steps, found.places) = (steps, places);
        self.notes.retain(|n| !matches!(n, Note::Infeasible { .. } | Note::Solver { .. }));
        self.physical(&factors, free, Fit { theta: fixed, direct, ..fit })
    }

    fn columns(&self) -> &Columns {
        self.observation.columns()
    }

    /// Rows of all drives that take part.
    fn row_count(&self) -> usize {
        (0..self.usable.len()).filter(|&k| self.usable[k]).map(|k| self.factors.drive(k).count()).sum()
    }

    /// Marks drives that stand still.
    fn look_at_motion(&mut self) {
        let model = &self.observation.robot().model;
        for (k, &j) in model.actuators.iter().enumerate() {
            let fitted = self.observation.motions().iter().filter(|m| m.used != Use::Holdout);
            let travel = fitted
                .map(|m| {
                    let known = || m.q[k].iter().copied();
                    known().fold(f64::NEG_INFINITY, f64::max) - known().fold(f64::INFINITY, f64::min)
                })
                .fold(0.0, f64::max);
            let joint = &model.joints[j];
            let stated = joint.limits.upper - joint.limits.lower;
            let limit = if stated.is_finite() && stated > 0.0 { TRAVEL_SHARE * stated } else { UNSTATED_TRAVEL };
            let spikes = self.observation.motions().iter().map(|m| m.spikes[k]).fold(0.0, f64::max);
            if spikes > SPIKE_LIMIT {
                self.notes.push(Note::Spikes { joint: joint.name.clone(), share: spikes, limit: SPIKE_LIMIT });
            }
            self.usable.push(travel > limit);
            if travel <= limit {
                self.notes.push(Note::StandsStill { joint: joint.name.clone(), travel, limit });
            }
        }
        if !self.usable.contains(&true) {
            self.notes.push(Note::NoMotion);
        }
        let nominal = self.columns().nominal();
        for (l, &link) in self.columns().links.clone().iter().enumerate() {
            let added = solid(&Columns::inertial(&nominal, l)).map_or(0.0, |(_, added)| added);
            if added > 0.0 {
                self.notes.push(Note::NominalNotABody { link: model.links[link].name.clone(), added });
            }
        }
    }

    /// Columns that are estimated.
    fn free(&self) -> Vec<usize> {
        let model = &self.observation.robot().model;
        let drive = |joint: usize| model.actuators.iter().position(|&j| j == joint);
        let moves = |joint: usize| drive(joint).is_none_or(|k| self.usable[k]);
        let is_free = |quantity: Quantity| match quantity {
            Quantity::Inertial { .. } => true,
            Quantity::Rotor { joint } => moves(joint) && !self.settings.held.contains(&Term::Rotor),
            Quantity::Viscous { joint } | Quantity::Coulomb { joint } | Quantity::Law { joint, .. } => {
                let term = if drive(joint).is_some() { Term::Friction } else { Term::PassiveFriction };
                moves(joint) && !self.settings.held.contains(&term)
            }
            Quantity::Offset { joint } => moves(joint) && !self.settings.held.contains(&Term::Offset),
            Quantity::Stiffness { joint } | Quantity::Wave { joint, .. } => moves(joint) && !self.settings.held.contains(&Term::Stiffness),
        };
        (0..self.columns().len()).filter(|&j| is_free(self.columns().list[j].quantity)).collect()
    }

    /// Weights that bring every drive's effort to size one.
    fn effort_weights(&self) -> Vec<f64> {
        let weight = |k: usize| {
            let drive = self.factors.drive(k);
            let mean = drive.effort_square() / drive.count().max(1) as f64;
            if self.usable[k] && mean > 0.0 { 1.0 / mean.sqrt() } else { 0.0 }
        };
        (0..self.usable.len()).map(weight).collect()
    }

    /// The base parameters that the recordings show, grouped as the structure of the robot says.
    fn base_set(&mut self, free: &[usize]) -> Option<BaseSet> {
        let triangle = self.factors.weighted(&self.effort_weights()).triangle();
        let shown = BaseSet::new(&triangle, free, RANK_TOLERANCE, Choice::BestConditioned)?;
        let structural = BaseSet::new(&self.structure, free, STRUCTURAL_TOLERANCE, Choice::BestConditioned)?;
        if shown.rank() < structural.rank() {
            let (structural, shown, tolerance) = (structural.rank(), shown.rank(), RANK_TOLERANCE);
            self.notes.push(Note::RankDeficient { structural, shown, tolerance });
            return BaseSet::new(&triangle, free, RANK_TOLERANCE, Choice::BestConditioned);
        }
        if shown.condition > CONDITION_LIMIT {
            let well_conditioned = well_conditioned(&triangle, free, WELL_CONDITIONED).len();
            self.notes.push(Note::IllConditioned { condition: shown.condition, limit: CONDITION_LIMIT, well_conditioned });
        }
        // The recordings choose what is kept; the grouping comes from random states, where it is exact.
        let exact = BaseSet::new(&self.structure, free, STRUCTURAL_TOLERANCE, Choice::Without(&shown.eliminated));
        let Some(mut exact) = exact else { return Some(shown) };
        (exact.condition, exact.condition_raw, exact.gap) = (shown.condition, shown.condition_raw, shown.gap);
        Some(exact)
    }

    fn look_at_rows(&mut self, set: &BaseSet) {
        let (rows, limit) = (self.row_count(), ROWS_PER_PARAMETER * set.rank());
        if rows < limit {
            self.notes.push(Note::FewRows { rows, parameters: set.rank(), limit });
        }
    }

    fn look_at_outliers(&mut self, series: &[Vec<Vec<f64>>]) {
        let active = |k: &usize| self.usable[*k];
        let flat: Vec<Vec<f64>> =
            (0..series.len()).filter(active).map(|k| series[k].iter().flatten().copied().filter(|e| e.abs() > 0.0).collect()).collect();
        let share = outlier_share(&flat);
        if share > OUTLIER_LIMIT {
            self.notes.push(Note::Outliers { share, limit: OUTLIER_LIMIT });
        }
    }

    /// Nominal values of the columns that are not free, zero for the others.
    fn fixed(&self, free: &[usize]) -> Vec<f64> {
        let mut fixed = self.columns().nominal();
        free.iter().for_each(|&j| fixed[j] = 0.0);
        fixed
    }

    fn fit(&mut self, set: &BaseSet, free: &[usize]) -> Result<Fit, IdentifyError> {
        let fixed = self.fixed(free);
        let factors = self.factors.less(&fixed);
        let (kept, p) = (&set.kept, self.columns().len());
        let mut noise = drive_noise(&factors, kept, &self.usable);
        let with_fixed = |mut theta: Vec<f64>| {
            theta.iter_mut().zip(&fixed).for_each(|(x, f)| *x += f);
            theta
        };
        let weighted = with_fixed(weighted_theta(&factors, kept, &noise));
        let rms: Vec<f64> = (0..noise.len()).map(|k| if self.usable[k] { 1.0 } else { f64::INFINITY }).collect();
        let mut spread = Spread::Weighted;
        let direct = match self.settings.method {
            Method::Sdp | Method::Wls | Method::Relevant | Method::Iv => weighted.clone(),
            Method::Ols => {
                spread = Spread::Ordinary;
                with_fixed(weighted_theta(&factors, kept, &rms))
            }
            Method::Tls => {
                if let Some(total) = least_squares::total(&triangle_of(&factors, &noise), kept) {
                    spread = Spread::Total(total.noise);
                    with_fixed(scatter(&total.values, kept, p))
                } else {
                    self.notes.push(Note::NoTotal { parameters: kept.len() });
                    weighted.clone()
                }
            }
            Method::Ridge => {
                let (values, precision) = self.ridge(&factors, set, &noise);
                // A weight that predicts best may hold the nominal robot for nearer than it is; its size is then that of the deviations.
                let off = set.project(&weighted).into_iter().zip(set.project(&self.columns().nominal())).map(|(x, n)| x - n);
                let square: f64 = off.zip(&precision).map(|(d, p)| p * d * d).sum();
                spread = Spread::Drawn(precision, (square / kept.len().max(1) as f64).max(1.0));
                with_fixed(scatter(&values, kept, p))
            }
            Method::Huber | Method::Bisquare => {
                let loss = if self.settings.method == Method::Huber { Loss::Huber } else { Loss::Bisquare };
                let robust = reweighted(self.observation, kept, [&weighted, &fixed], &self.usable, loss)?;
                if !robust.is_settled {
                    self.notes.push(Note::NotSettled { iterations: robust.iterations });
                }
                (0..noise.len()).filter(|&k| self.usable[k]).for_each(|k| noise[k] = robust.noise[k]);
                spread = Spread::Cut(loss);
                robust.theta
            }
        };
        let mut fit = Fit { theta: fixed.clone(), direct, noise, prior_weight: 0.0, spread };
        if self.settings.method == Method::Iv {
            fit = self.instrumented(set, free, fit)?;
        }
        Ok(self.physical(&factors, free, Fit { theta: fixed, ..fit }))
    }

    /// Ridge towards the nominal base parameters, its weight by cross-validation: values, and the precision they are drawn with.
    fn ridge(&self, factors: &Factors, set: &BaseSet, noise: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let prior = set.project(&self.columns().nominal());
        let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
        let p = self.columns().len();
        let error = |weight: f64| -> f64 {
            let left_out = |fold: usize| {
                let rest = factors.weighted_where(&weights, &|f| f != fold).triangle();
                let theta = scatter(&least_squares::ridge(&rest, &set.kept, &prior, weight), &set.kept, p);
                factors.weighted_where(&weights, &|f| f == fold).error_square(&theta)
            };
            factors.used_folds().into_iter().map(left_out).sum()
        };
        let best = RIDGE_WEIGHTS.iter().map(|&w| (error(w), w)).min_by(|a, b| a.0.total_cmp(&b.0));
        let (triangle, weight) = (triangle_of(factors, noise), best.map_or(0.0, |(_, w)| w));
        (least_squares::ridge(&triangle, &set.kept, &prior, weight), least_squares::ridge_precision(&triangle, &set.kept, weight))
    }

    /// Completes a fit to a physical robot. `fit.theta` holds the fixed parameters.
    fn physical(&mut self, factors: &Factors, free: &[usize], mut fit: Fit) -> Fit {
        let fixed = fit.theta.clone();
        let space = Space::new(self.columns(), free, &fixed, &self.units(factors, free));
        let Some(space) = space else {
            self.notes.push(Note::Solver { outcome: "failed", iterations: 0 });
            fit.theta = self.columns().nominal();
            return fit;
        };
        let rows = self.row_count();
        let mut triangle = triangle_of(&self.factors, &fit.noise);
        let unbounded = squared_error(&triangle, &fit.direct) / rows as f64;
        let is_direct = self.settings.method == Method::Sdp;
        let weight = if is_direct {
            self.settings.prior_weight.unwrap_or_else(|| choose_weight(&self.factors, &fit.noise, &space))
        } else {
            COMPLETION_WEIGHT
        };
        if !is_direct {
            // The physical robot whose efforts are nearest to those of the estimate.
            let p = fit.direct.len();
            for i in 0..=p {
                triangle[(i, p)] = (i..p).map(|c| triangle[(i, c)] * fit.direct[c]).sum();
            }
        }
        let Feasible { theta, outcome, iterations, tangent, .. } = feasible(&triangle, rows, &space, self.settings.prior, weight);
        match outcome {
            Outcome::Solved => {}
            Outcome::Almost => self.notes.push(Note::Solver { outcome: "at reduced accuracy", iterations }),
            Outcome::Failed => self.notes.push(Note::Solver { outcome: "failed", iterations }),
        }
        let physical = squared_error(&triangle_of(&self.factors, &fit.noise), &theta) / rows as f64;
        if physical > CONTRADICTION * unbounded && outcome != Outcome::Failed {
            self.notes.push(Note::Infeasible { unbounded, physical, limit: CONTRADICTION });
        }
        if is_direct {
            if !tangent.at_bound.is_empty() {
                let parameters = tangent.at_bound.iter().map(|&j| self.columns().list[j].name.clone()).collect();
                self.notes.push(Note::AtBound { parameters });
            }
            fit.spread = Spread::Physical(Box::new(tangent), fit.direct.clone());
            fit.direct.clone_from(&theta);
            fit.prior_weight = weight;
        }
        fit.theta = theta;
        fit
    }

    /// Steps of the parameters that would move the drives by their whole effort.
    fn units(&self, factors: &Factors, free: &[usize]) -> Vec<f64> {
        let triangle = factors.weighted(&self.effort_weights()).triangle();
        let rows = (self.row_count().max(1) as f64).sqrt();
        let nominal = self.columns().nominal();
        let unit = |j: usize| {
            let length = triangle.col(j).norm_l2() / rows;
            if length > 0.0 { 1.0 / length } else { nominal[j].abs().max(1.0) }
        };
        (0..nominal.len()).map(|j| if free.contains(&j) { unit(j) } else { 1.0 }).collect()
    }

    fn report(&mut self, free: &[usize], found: Option<&Found>, fit: &Fit, residuals: &[Residual]) -> Identification {
        let model = &self.observation.robot().model;
        let nominal = self.columns().nominal();
        let mut joints = Vec::new();
        for (k, &j) in model.actuators.iter().enumerate() {
            let (judged, fitted) = (self.judged.drive(k), self.factors.drive(k));
            let share = |factor: &crate::factor::Factor, theta: &[f64]| {
                if factor.effort_square() > 0.0 { (factor.error_square(theta) / factor.effort_square()).sqrt() } else { 0.0 }
            };
            joints.push(JointError {
                joint: model.joints[j].name.clone(),
                unit: model.joints[j].kind.unit_effort(),
                effort_rms: (judged.effort_square() / judged.count().max(1) as f64).sqrt(),
                nominal: share(judged, &nominal),
                identified: share(judged, &fit.theta),
                fitted: share(fitted, &fit.theta),
                lag_one: residuals.get(k).map_or(0.0, |r| r.lag_one),
                is_white: residuals.get(k).is_some_and(Residual::is_white),
                normality: residuals.get(k).map_or(1.0, Residual::normality),
            });
        }
        for j in joints.iter().filter(|j| j.identified > WORSE * j.nominal) {
            let (joint, nominal, identified) = (j.joint.clone(), j.nominal, j.identified);
            self.notes.push(Note::Worse { joint, nominal, identified });
        }
        let (parameters, covariance) = self.parameters(found, fit, residuals);
        let set = found.map(|f| f.set.clone());
        Identification {
            robot: model.name.clone(),
            status: Note::worst(&self.notes),
            notes: self.notes.clone(),
            method: self.settings.method,
            band_hz: self.observation.band(),
            prior_weight: fit.prior_weight,
            n_rows: self.row_count(),
            recordings: self
                .observation
                .motions()
                .iter()
                .map(|m| UsedRecording { path: m.name.clone(), samples: m.len(), used: used(m.used) })
                .collect(),
            base: self.summary(free, set.as_ref()),
            parameters,
            intervals: fit.spread.intervals(),
            joints,
            columns: self.columns().clone(),
            theta: fit.theta.clone(),
            set,
            covariance,
            steps: found.map_or_else(Vec::new, |f| f.steps.clone()),
            preprocessing: self.before.0.clone(),
            shapes: self.before.1.clone(),
            instruments: self.instruments.clone(),
        }
    }

    fn summary(&self, free: &[usize], set: Option<&BaseSet>) -> BaseSummary {
        let structural = BaseSet::new(&self.structure, free, STRUCTURAL_TOLERANCE, Choice::BestConditioned);
        let triangle = self.factors.weighted(&self.effort_weights()).triangle();
        BaseSummary {
            acting: structural.as_ref().map_or(0, |s| s.kept.len() + s.eliminated.len()),
            structural: structural.as_ref().map_or(0, BaseSet::rank),
            shown: set.map_or(0, BaseSet::rank),
            tolerance: RANK_TOLERANCE,
            gap: set.map_or(0.0, |s| if s.gap.is_finite() { s.gap } else { 0.0 }),
            condition: set.map_or(0.0, |s| s.condition),
            condition_raw: set.map_or(0.0, |s| s.condition_raw),
            well_conditioned: well_conditioned(&triangle, free, WELL_CONDITIONED).len(),
            well_conditioned_limit: WELL_CONDITIONED,
        }
    }
}

impl Fit {
    /// The nominal robot.
    fn none(columns: &Columns) -> Self {
        Self { theta: columns.nominal(), direct: columns.nominal(), noise: Vec::new(), prior_weight: 0.0, spread: Spread::Weighted }
    }
}

fn used(u: Use) -> &'static str {
    match u {
        Use::Fit => "fit",
        Use::Holdout => "holdout",
        Use::Both => "both",
    }
}

fn triangle_of(factors: &Factors, noise: &[f64]) -> Mat<f64> {
    let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
    factors.weighted(&weights).triangle()
}
