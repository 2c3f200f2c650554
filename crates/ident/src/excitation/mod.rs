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
use pkm_dyn::effects::{Applied, Law, Robot};
use pkm_dyn::math;

use crate::answer::Term;
use crate::base::{BaseError, RANK_TOLERANCE};
use crate::columns::{Columns, Quantity};
use crate::factor::Factor;
use crate::grouping::{BaseSet, Choice, structural_factor, well_conditioned};
use draw::Draw;
use limits::{Bound, Bounds};
use mechanism::{Direction, Mechanism};
use problem::Problem;
use search::{DENSER, INSIDE, Run, Search};
use verify::Verified;

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
    /// More drives than freedoms.
    #[error("{robot:?} has {drives} drives for {freedoms} degrees of freedom (they must be equal to identify)")]
    Redundant {
        /// Robot name.
        robot: String,
        /// Drives.
        drives: usize,
        /// Degrees of freedom.
        freedoms: usize,
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
    /// Base parameters cannot be counted.
    #[error(transparent)]
    Base(#[from] BaseError),
}

/// Random admissible motions with the same limits.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Baseline {
    /// Motions drawn.
    pub motions: usize,
    /// The best of them.
    pub best: Quality,
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

    /// By how much the best random motion is worse: the ratio of condition numbers, of volumes per parameter, of sines, or of efforts.
    #[must_use]
    pub fn gain(&self) -> f64 {
        let (found, random) = (&self.quality, &self.random.best);
        let n = self.columns.len().max(1) as f64;
        let alone = |q: &Quality| q.separation.map_or(f64::NAN, |s| math::sqrt(s.alone[0] * s.alone[1]));
        let sine = |q: &Quality| q.separation.map_or(f64::NAN, |s| math::sqrt(1.0 - s.cosine * s.cosine));
        match self.settings.criterion {
            Criterion::Condition => random.condition / found.condition,
            Criterion::Determinant => math::exp(0.5 * (found.log_determinant - random.log_determinant) / n),
            Criterion::Angle => sine(found) / sine(random),
            Criterion::Power => alone(found) / alone(random),
        }
    }
}

/// Looks for a motion. `progress` is told the share done, 0 to 1, from several threads.
///
/// # Errors
/// Settings out of range, a robot or limits that leave no room, effects that no motion shows.
pub fn excite(robot: &Robot, settings: &Settings, progress: &(dyn Fn(f64) + Sync)) -> Result<Excitation, ExciteError> {
    check(settings)?;
    let model = &robot.model;
    let freedoms = pkm_dyn::Data::new(model).n_ind();
    if freedoms != model.n_act() {
        return Err(ExciteError::Redundant { robot: model.name.clone(), drives: model.n_act(), freedoms });
    }
    let columns = Columns::new(robot);
    let among = among(robot, &columns, settings)?;
    let bounds = Bounds::try_new(model, &settings.limits)?;
    let mut draw = Draw::new(settings.seed, 0);
    let structure = structural_factor(robot, &columns, STATES, &mut || draw.unit())?.triangle();
    let set = BaseSet::new(&structure, &among, RANK_TOLERANCE, Choice::BestConditioned);
    let set = set.ok_or_else(|| ExciteError::Blind { robot: model.name.clone() })?;
    let kept = settings.columns.clone().unwrap_or_else(|| set.kept.clone());
    let inside = bounds.narrowed(INSIDE);
    let problem = Problem::new(settings.criterion, settings.basis, settings.period_s, inside);
    let mechanism = Mechanism::new(robot, &columns, (&kept, &settings.effects), &bounds, &problem.speed());
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
        random: baseline(&search, &runs)?,
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
fn baseline(search: &Search<'_, '_>, runs: &[&Run]) -> Result<Baseline, ExciteError> {
    let mut all: Vec<f64> = runs.iter().flat_map(|r| r.drawn.iter().copied()).collect();
    all.sort_by(f64::total_cmp);
    let mut mechanism = search.mechanism.clone();
    let of = |r: &&&Run| r.drawn.iter().copied().fold(f64::INFINITY, f64::min);
    let mut best: Option<Verified> = None;
    let mut sorted: Vec<&&Run> = runs.iter().collect();
    sorted.sort_by(|a, b| of(a).total_cmp(&of(b)));
    for run in sorted {
        let Ok((_, verified)) = search.verified(&mut mechanism, &run.best_drawn) else { continue };
        let is_better = |b: &Verified| worth(search.settings.criterion, &verified.quality) < worth(search.settings.criterion, &b.quality);
        if best.as_ref().is_none_or(is_better) {
            best = Some(verified);
        }
    }
    let robot = || search.mechanism.robot.model.name.clone();
    let best = best.ok_or_else(|| ExciteError::NoMotion {
        robot: robot(),
        reason: "every random motion to compare with leaves the limits".to_string(),
    })?;
    Ok(Baseline { motions: all.len(), best: best.quality, median: all[all.len() / 2] })
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
fn among(robot: &Robot, columns: &Columns, settings: &Settings) -> Result<Vec<usize>, ExciteError> {
    let effect = |e: &Applied, problem| ExciteError::Effect { effect: e.entry.name.to_string(), problem };
    for e in &settings.effects {
        if !matches!(e.entry.law, Law::JointEffort(_)) {
            return Err(effect(e, "is no effort at a joint, so it has no column of its own here"));
        }
    }
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
    let is_effect = |quantity: Quantity| settings.effects.iter().any(|e| is_of(quantity, e));
    let out: Vec<usize> =
        (0..columns.len()).filter(|&c| !is_held(columns.list[c].quantity) && !is_effect(columns.list[c].quantity)).collect();
    Ok(out)
}

/// Whether a column is that of an effect.
fn is_of(quantity: Quantity, e: &Applied) -> bool {
    match (e.entry.name, quantity) {
        ("friction_coulomb", Quantity::Coulomb { joint })
        | ("friction_viscous", Quantity::Viscous { joint })
        | ("friction_passive", Quantity::Coulomb { joint } | Quantity::Viscous { joint })
        | ("torque_offset", Quantity::Offset { joint })
        | ("rotor_inertia", Quantity::Rotor { joint })
        | ("spring", Quantity::Stiffness { joint }) => joint == e.place,
        _ => false,
    }
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
