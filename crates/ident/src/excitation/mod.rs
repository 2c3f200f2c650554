//! Excitation: periodic motions that show as much of a robot's parameters as its limits allow, or tell two effects apart.
//!
//! A motion is a sum of fixed functions ([`Basis`]) that begins every period at rest: velocity and acceleration vanish there, so the robot
//! starts without a ramp and the first period is like all others. Random admissible motions are drawn, the best of each lot is improved by
//! descent with a barrier at every limit ([`Criterion`] says what is improved), and the results are verified on a grid ten times as dense:
//! positions, velocities, accelerations and efforts of drives, positions and velocities of passive joints, leans of ball joints, distance
//! from singularities. Restarts run in parallel; the same settings give the same bits whatever the number of threads.
//!
//! How much better the results are than the best of the random motions with the same limits is part of every answer
//! ([`Excitation::gain`]); `cargo test -p pkm-ident --test excitation -- --nocapture` prints it for several robots.
//!
//! What a motion of the right kind cannot show is no question of optimisation: the number of base parameters is structural, the number of
//! those that a motion shows well is not, so both are reported.

mod basis;
mod criterion;
mod descent;
mod draw;
mod effects;
mod limits;
mod mechanism;
mod problem;
mod search;
mod verify;

pub use basis::{Basis, DriveState, Periodic};
pub use criterion::{Criterion, Separation};
pub use limits::{Bounded, Limits};
pub use verify::{Margin, Quality, conditions};

use faer::Mat;
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::{Model, math};

use crate::Recording;
use crate::answer::Term;
use crate::base::{BaseError, RANK_TOLERANCE};
use crate::columns::{Columns, Quantity};
use crate::factor::Factor;
use crate::grouping::{BaseSet, Choice, structural_factor, well_conditioned};
use draw::Draw;
use effects::{Effect, is_of};
use limits::{Bound, Bounds};
use mechanism::{Direction, Mechanism, leading, of_drives};
use problem::Problem;
use search::{DENSER, INSIDE, Run, Search};

/// Random states behind the number of base parameters.
const STATES: usize = 300;

/// Condition number below which identification of parallel robots is taken to be sound \[Armas, sec. 2.1.5\].
pub const CONDITION_LIMIT: f64 = 300.0;

/// What motion to look for.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What is improved.
    pub criterion: Criterion,
    /// Functions that the motion is the sum of.
    pub basis: Basis,
    /// Period `[s]`.
    pub period_s: f64,
    /// Limits.
    pub limits: Limits,
    /// Terms that are not to be identified.
    pub held: Vec<Term>,
    /// Columns that count, by index; all base parameters where `None`.
    pub columns: Option<Vec<usize>>,
    /// Two effects to be told apart, or none.
    pub effects: Vec<Applied>,
    /// Improved motions, of which the best is taken.
    pub restarts: usize,
    /// Random motions drawn for each restart.
    pub draws: usize,
    /// Steps of each restart.
    pub iterations: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            criterion: Criterion::Condition,
            basis: Basis::Fourier { harmonics: 5 },
            period_s: 10.0,
            limits: Limits::default(),
            held: Vec::new(),
            columns: None,
            effects: Vec::new(),
            restarts: 4,
            draws: 25,
            iterations: 150,
            seed: 1,
        }
    }
}

/// Why there is no motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExciteError {
    /// A number out of range.
    #[error("{what} = {value} ({limit})")]
    Setting {
        /// Which.
        what: &'static str,
        /// As given.
        value: f64,
        /// What it must be.
        limit: &'static str,
    },
    /// The loops do not close at the start.
    #[error("loops do not close in the stated assembly: gap {gap:.3e} m or rad in row {row} (limit 1e-9)")]
    Open {
        /// Largest gap `[m | rad]`.
        gap: f64,
        /// Its constraint row.
        row: usize,
    },
    /// Not even 1 % of the travel is admissible.
    #[error("no motion of {robot:?} keeps the limits: even the smallest one drawn does not: {reason}")]
    NoMotion {
        /// Robot name.
        robot: String,
        /// What the last one drawn did.
        reason: String,
    },
    /// Effects that the base parameters explain, or columns that are zero.
    #[error(
        "no motion of {robot:?} shows what is asked for: the base parameters explain an effect wholly, two effects are one, or a column is zero"
    )]
    Blind {
        /// Robot name.
        robot: String,
    },
    /// Effects that cannot be told apart in this way.
    #[error("effect {effect}: {problem}")]
    Effect {
        /// Its name.
        effect: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// A file that would not show the motion.
    #[error("rate = {rate_hz} Hz (must be at least {least:.3} Hz, ten samples per cycle of the fastest oscillation)")]
    Rate {
        /// As given `[Hz]`.
        rate_hz: f64,
        /// Least rate `[Hz]`.
        least: f64,
    },
    /// A file that would be too long.
    #[error("{samples:.0} samples (limit {limit:.0}): lower the rate, the period or the number of periods")]
    Samples {
        /// As asked for.
        samples: f64,
        /// Limit.
        limit: f64,
    },
    /// Base parameters cannot be counted.
    #[error(transparent)]
    Base(#[from] BaseError),
}

/// Random admissible motions with the same limits.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Baseline {
    /// Motions drawn.
    pub motions: usize,
    /// The best of them, verified like the answer; none where it leaves the limits between the samples that it was drawn on.
    pub best: Option<Quality>,
    /// The middle one's criterion, as in [`Excitation::traces`].
    pub median: f64,
}

/// A restart that found a motion.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Trace {
    /// Criterion of its best drawn motion.
    pub start: f64,
    /// Criterion after every step; condition numbers as their logarithms.
    pub steps: Vec<f64>,
    /// Quality of the verified result.
    pub quality: Quality,
}

/// A motion, and what is to be said of it.
#[derive(Debug, Clone)]
pub struct Excitation {
    /// Robot name.
    pub robot: String,
    /// The motion.
    pub motion: Periodic,
    /// How good it is, on a grid ten times as dense as that of the search.
    pub quality: Quality,
    /// What drawing at random would have given.
    pub random: Baseline,
    /// Where the motion comes nearest to each limit.
    pub margins: Vec<Margin>,
    /// Restarts that found a motion, in their order.
    pub traces: Vec<Trace>,
    /// Restarts that found none.
    pub failed: usize,
    /// Names of the columns that count.
    pub columns: Vec<String>,
    /// Independent combinations of all columns that some motion of the robot would show.
    pub structural: usize,
    /// Of all columns, the most that stay below [`CONDITION_LIMIT`] together along this motion: the truncated rank.
    pub well_conditioned: usize,
    /// Share of the largest pivot below which one counts as zero in [`Excitation::structural`].
    pub tolerance: f64,
    /// Settings.
    pub settings: Settings,
    dense: Factor,
    among: Vec<usize>,
}

impl Excitation {
    /// Triangle of all columns' observation matrix along the motion ([`Factor::triangle`]), in the order of [`Columns::list`].
    #[must_use]
    pub fn triangle(&self) -> Mat<f64> {
        self.dense.triangle()
    }

    /// Columns that may be identified: those not held.
    #[must_use]
    pub fn among(&self) -> &[usize] {
        &self.among
    }

    /// By how much the best random motion is worse: the ratio of condition numbers, of volumes per parameter, of sines, or of efforts. It
    /// is at least 1, for a random motion that no descent makes better is the answer itself; none without a verified random motion.
    #[must_use]
    pub fn gain(&self) -> Option<f64> {
        let (found, random) = (&self.quality, self.random.best.as_ref()?);
        let n = self.columns.len().max(1) as f64;
        let alone = |q: &Quality| q.separation.map_or(f64::NAN, |s| math::sqrt(s.alone[0] * s.alone[1]));
        let sine = |q: &Quality| q.separation.map_or(f64::NAN, |s| math::sqrt(1.0 - s.cosine * s.cosine));
        Some(match self.settings.criterion {
            Criterion::Condition => random.condition / found.condition,
            Criterion::Determinant => math::exp(0.5 * (found.log_determinant - random.log_determinant) / n),
            Criterion::Angle => sine(found) / sine(random),
            Criterion::Power => alone(found) / alone(random),
        })
    }

    /// The motion as a file has it; see [`references`].
    #[must_use]
    pub fn recording(&self, model: &Model, samples: usize, rate_hz: f64) -> Recording {
        references(&self.motion, model, (self.settings.criterion, self.settings.seed), samples, rate_hz)
    }
}

impl Periodic {
    /// The motion of all drives of `model` (the robot that it was found for) at times `[s]`, the first of which is where it is walked to;
    /// surplus drives go where the loops take them, and have no numbers where these do not close.
    #[must_use]
    pub fn states(&self, model: &Model, time: &[f64]) -> Vec<DriveState> {
        let led = time.iter().map(|&t| self.at(t));
        let Some(leading) = leading(model) else { return led.collect() };
        let mut data = pkm_dyn::Data::new(&leading);
        let none = || vec![f64::NAN; model.n_act()];
        let mut is_placed = assemble(&leading, &mut data).is_closed;
        let mut whole = |(i, s): (usize, DriveState)| {
            is_placed &= i > 0 || walk_to(&leading, &mut data, &s.q).is_closed;
            if is_placed && closed_loop_motion(&leading, &mut data, &s.q, &s.v, &s.a).is_closed {
                of_drives(model, &data)
            } else {
                DriveState { q: none(), v: none(), a: none() }
            }
        };
        led.enumerate().map(&mut whole).collect()
    }
}

/// A motion as a file has it: references of position, velocity and acceleration of every drive of `model` (the robot that it was found
/// for), `samples` of them at `rate_hz` `[Hz]`; see [`samples`]. The file states what was improved, and the seed.
#[must_use]
pub fn references(motion: &Periodic, model: &Model, (criterion, seed): (Criterion, u64), samples: usize, rate_hz: f64) -> Recording {
    let mut out = Recording { name: format!("{}, excitation", model.name), ..Recording::default() };
    out.time = (0..samples).map(|i| i as f64 / rate_hz).collect();
    let states = motion.states(model, &out.time);
    for (k, &j) in model.actuators.iter().enumerate() {
        let name = &model.joints[j].name;
        out.signals.insert(format!("q_ref.{name}"), states.iter().map(|s| s.q[k]).collect());
        out.signals.insert(format!("dq_ref.{name}"), states.iter().map(|s| s.v[k]).collect());
        out.signals.insert(format!("ddq_ref.{name}"), states.iter().map(|s| s.a[k]).collect());
    }
    for (key, value) in [
        ("excitation_period", motion.period_s.to_string()),
        ("excitation_criterion", criterion.name().to_string()),
        ("excitation_seed", seed.to_string()),
    ] {
        out.meta.other.insert(key.to_string(), value);
    }
    out
}

/// Looks for a motion. `progress` is told the share done, 0 to 1, from several threads.
///
/// # Errors
/// Settings out of range, a robot or limits that leave no room, effects that no motion shows.
pub fn excite(robot: &Robot, settings: &Settings, progress: &(dyn Fn(f64) + Sync)) -> Result<Excitation, ExciteError> {
    check(settings)?;
    let model = &robot.model;
    let columns = Columns::new(robot);
    let among = among(robot, &columns, settings);
    let effects = settings.effects.iter().map(|e| Effect::try_new(robot, &columns, e)).collect::<Result<Vec<_>, _>>()?;
    let bounds = Bounds::try_new(model, &settings.limits)?;
    let mut draw = Draw::new(settings.seed, 0);
    let structure = structural_factor(robot, &columns, STATES, &mut || draw.unit())?.triangle();
    let set = BaseSet::new(&structure, &among, RANK_TOLERANCE, Choice::BestConditioned);
    let set = set.ok_or_else(|| ExciteError::Blind { robot: model.name.clone() })?;
    let kept = settings.columns.clone().unwrap_or_else(|| set.kept.clone());
    let inside = bounds.narrowed(INSIDE);
    let problem = Problem::new(settings.criterion, settings.basis, settings.period_s, inside);
    let mechanism = Mechanism::new(robot, &columns, (&kept, &effects), &bounds, &problem.speed());
    let name = |b: &Bound| b.name(model, &bounds.cones);
    let search = Search { problem: &problem, bounds: &bounds, mechanism: &mechanism, settings, name: &name };
    let results = search.all(progress);
    let failed = results.iter().filter(|r| r.is_err()).count();
    let runs: Vec<&Run> = results.iter().flatten().collect();
    let Some((_, best)) = runs.iter().enumerate().min_by(|(i, a), (j, b)| {
        let of = |r: &Run| worth(settings.criterion, &r.verified.quality);
        of(a).total_cmp(&of(b)).then(i.cmp(j))
    }) else {
        let why = results.iter().find_map(|r| r.as_ref().err());
        return Err(why.map_or_else(|| ExciteError::Blind { robot: model.name.clone() }, |why| search.told(why, &model.name)));
    };
    let motion = problem.motion(&best.x);
    let dense = all_columns(&search, robot, &columns, &motion)?;
    let trace = |r: &&Run| Trace {
        start: r.drawn.iter().copied().fold(f64::INFINITY, f64::min),
        steps: r.trace.clone(),
        quality: r.verified.quality.clone(),
    };
    Ok(Excitation {
        robot: model.name.clone(),
        quality: best.verified.quality.clone(),
        random: baseline(settings.criterion, &runs),
        margins: best.verified.margins.clone(),
        traces: runs.iter().map(trace).collect(),
        failed,
        columns: kept.iter().map(|&c| columns.list[c].name.clone()).collect(),
        structural: set.rank(),
        well_conditioned: well_conditioned(&dense.triangle(), &among, CONDITION_LIMIT).len(),
        tolerance: set.tolerance,
        settings: settings.clone(),
        motion,
        dense,
        among,
    })
}

/// A quality as a number to be made small.
fn worth(criterion: Criterion, q: &Quality) -> f64 {
    match (criterion, q.separation) {
        (Criterion::Condition, _) => q.condition,
        (Criterion::Determinant, _) => -q.log_determinant,
        (Criterion::Angle, Some(s)) => s.cosine.abs(),
        (Criterion::Power, Some(s)) => -s.alone[0] * s.alone[1],
        (Criterion::Angle | Criterion::Power, None) => f64::INFINITY,
    }
}

/// The best motion that was drawn, verified like any other, and the middle one.
fn baseline(criterion: Criterion, runs: &[&Run]) -> Baseline {
    let mut all: Vec<f64> = runs.iter().flat_map(|r| r.drawn.iter().copied()).collect();
    all.sort_by(f64::total_cmp);
    let verified = runs.iter().filter_map(|r| r.random.as_ref()).map(|v| &v.quality);
    let best = verified.min_by(|a, b| worth(criterion, a).total_cmp(&worth(criterion, b))).cloned();
    Baseline { motions: all.len(), best, median: all[all.len() / 2] }
}

/// Samples that a file may have.
const SAMPLES_MAX: f64 = 2e7;

/// Samples per cycle of the fastest oscillation that a file must have.
const PER_CYCLE: f64 = 10.0;

/// Number of samples of `periods` periods of a motion at `rate_hz` `[Hz]`, the last one at the end of the last period `[s]`.
///
/// # Errors
/// No period, a rate that does not show the fastest oscillation, more samples than a file may have.
pub fn samples(basis: Basis, period_s: f64, periods: usize, rate_hz: f64) -> Result<usize, ExciteError> {
    if periods == 0 {
        return Err(ExciteError::Setting { what: "periods", value: 0.0, limit: "must be at least 1" });
    }
    let least = PER_CYCLE * basis.cycles() as f64 / period_s;
    if rate_hz < least || !rate_hz.is_finite() {
        return Err(ExciteError::Rate { rate_hz, least });
    }
    let steps = (period_s * periods as f64 * rate_hz).round();
    if steps.is_nan() || steps >= SAMPLES_MAX {
        return Err(ExciteError::Samples { samples: steps, limit: SAMPLES_MAX });
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and SAMPLES_MAX")]
    let n = steps as usize + 1;
    Ok(n)
}

/// All columns along one period.
fn all_columns(search: &Search<'_, '_>, robot: &Robot, columns: &Columns, motion: &Periodic) -> Result<Factor, ExciteError> {
    let every: Vec<usize> = (0..columns.len()).collect();
    let mut mechanism = Mechanism::new(robot, columns, (&every, &[]), search.bounds, &search.problem.speed());
    let n = DENSER * search.problem.n_samples();
    let mut out = Factor::new(columns.len());
    for i in 0..n {
        let state = motion.at(motion.period_s * i as f64 / n as f64);
        if (i == 0 && !mechanism.go(&state.q)) || !mechanism.look(&state, search.bounds, Direction::Sharp) {
            return Err(search.told(&problem::Refused::Open, &robot.model.name));
        }
        mechanism.rows.chunks(columns.len()).for_each(|row| out.push(row, 0.0, 0.0));
    }
    Ok(out)
}

/// Columns that may be identified: those not held and not those of the effects in question.
fn among(robot: &Robot, columns: &Columns, settings: &Settings) -> Vec<usize> {
    let is_driven = |joint: usize| robot.model.actuators.contains(&joint);
    let is_held = |quantity: Quantity| match quantity {
        Quantity::Inertial { .. } => false,
        Quantity::Rotor { .. } => settings.held.contains(&Term::Rotor),
        Quantity::Viscous { joint } | Quantity::Coulomb { joint } | Quantity::Law { joint, .. } => {
            settings.held.contains(if is_driven(joint) { &Term::Friction } else { &Term::PassiveFriction })
        }
        Quantity::Offset { .. } => settings.held.contains(&Term::Offset),
        Quantity::Stiffness { .. } | Quantity::Wave { .. } => settings.held.contains(&Term::Stiffness),
    };
    let is_effect = |c: usize| settings.effects.iter().any(|e| is_of(columns, c, e));
    (0..columns.len()).filter(|&c| !is_held(columns.list[c].quantity) && !is_effect(c)).collect()
}

fn check(s: &Settings) -> Result<(), ExciteError> {
    let functions = match s.basis {
        Basis::Fourier { harmonics } => ("harmonics", harmonics, 3, 50, "must be 3 to 50"),
        Basis::Spline { pieces } => ("pieces", pieces, 8, 100, "must be 8 to 100"),
    };
    // Beyond the upper ends a mistyped number would compute for days.
    for (what, value, least, most, limit) in [
        functions,
        ("restarts", s.restarts, 1, 1000, "must be 1 to 1000"),
        ("draws", s.draws, 1, 100_000, "must be 1 to 100000"),
        ("iterations", s.iterations, 0, 100_000, "must be at most 100000"),
    ] {
        if !(least..=most).contains(&value) {
            return Err(ExciteError::Setting { what, value: value as f64, limit });
        }
    }
    if !(s.period_s.is_finite() && s.period_s > 0.0) {
        return Err(ExciteError::Setting { what: "period", value: s.period_s, limit: "must be finite and > 0" });
    }
    let wanted = if s.criterion.separates() { 2 } else { s.effects.len().min(2) };
    if s.effects.len() != wanted || s.effects.len() == 1 {
        return Err(ExciteError::Setting { what: "effects to tell apart", value: s.effects.len() as f64, limit: "must be two" });
    }
    Ok(())
}
