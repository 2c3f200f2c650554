//! The reduced model identified from a simulated recording and verified on another motion.

use nalgebra::{DMatrix, DVector};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_ident::Recording;
use pkm_ident::columns::Columns;
use pkm_ident::motion::Use;
use pkm_ident::observation::{Block, Observation, RowOptions, Rows};
use pkm_sim::{ConstrainedOptions, PlantKind, Scenario, Trajectory, run_along};

use crate::error::PaperError;
use crate::refused::refused;
use crate::row::{Gate, Line, Plot, Row};

const WHAT: &str = "identification";

/// Rate of the recordings `[Hz]`: the laboratory's.
const RATE_HZ: f64 = 100.0;

/// Friction of the universal joints and of leg 4's hinge, which the shipped robot has none of `[N·m·s/rad]`, `[N·m]`.
const PASSIVE: [f64; 2] = [0.5, 0.3];

/// Joints of the legs that no drive moves.
const UNIVERSAL: [&str; 7] = ["q11", "q12", "q21", "q22", "q31", "q32", "q41"];

/// The robot that is recorded: friction in all eleven joints of the legs, no rotors, as the paper has it.
pub(super) fn truth(mut model: pkm_dyn::Model) -> Robot {
    for joint in &mut model.joints {
        joint.armature = 0.0;
        if UNIVERSAL.contains(&joint.name.as_str()) {
            [joint.viscous, joint.coulomb] = PASSIVE;
        }
    }
    Robot::new(model, Vec::new())
}

/// A recording of the robot along a motion, moved by the plant in all its coordinates.
pub(super) fn recorded(
    truth: &Robot,
    motion: &dyn Trajectory,
    seconds: f64,
    progress: &mut dyn FnMut(f64),
) -> Result<Recording, PaperError> {
    let plant = PlantKind::Constrained(ConstrainedOptions::default());
    let scenario = Scenario { duration_s: seconds, rate_hz: RATE_HZ, plant, ..Scenario::default() };
    Ok(run_along([truth, truth], &scenario, motion, &mut |t| progress(t / seconds))?)
}

/// Forces of one leg in one recording.
#[derive(Default, Clone)]
struct Forces {
    time: Vec<f64>,
    measured: Vec<f64>,
    /// By each model.
    predicted: [Vec<f64>; MODELS],
    /// Squared errors of each model while the drive moves, and their number: friction of one that stands may be anything between its
    /// limits.
    moving: ([f64; MODELS], f64),
}

/// Models that are compared: the reduced one, the same without friction, all base parameters.
const MODELS: usize = 3;

/// Which samples count.
#[derive(Clone, Copy, PartialEq)]
enum Samples {
    Moving,
    All,
}

impl Forces {
    /// Root mean square error of model `m` over the range of what was measured.
    fn nrmse(&self, m: usize, samples: Samples) -> f64 {
        let (low, high) = self.measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let all = || self.measured.iter().zip(&self.predicted[m]).map(|(a, b)| (a - b) * (a - b)).sum();
        let (sum, count): (f64, f64) = match samples {
            Samples::Moving => (self.moving.0[m], self.moving.1),
            Samples::All => (all(), self.measured.len() as f64),
        };
        math::sqrt(sum / count.max(1.0)) / (high - low)
    }
}

/// The largest error of model `m` over the legs `[%]`.
fn largest(forces: &[Forces], m: usize, samples: Samples) -> f64 {
    forces.iter().map(|f| 100.0 * f.nrmse(m, samples)).fold(0.0, f64::max)
}

/// Least squares on chosen columns of a recording.
fn fit(robot: &Robot, train: &Recording, columns: &[usize]) -> Result<(Vec<f64>, f64), PaperError> {
    let observation = Observation::try_new(robot, &[(train, Use::Fit)], RowOptions::default()).map_err(refused(WHAT))?;
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    let n_act = robot.model.n_act();
    let mut visit = |block: &Block<'_>| {
        for drive in 0..n_act {
            for i in (0..block.len()).filter(|&i| block.is_active(drive, i)) {
                let row = block.row(drive, i);
                rows.extend(columns.iter().map(|&c| row[c]));
                targets.push(block.target(drive, i));
            }
        }
    };
    observation.each(Rows::Fitted, &mut visit, &mut |_| {}).map_err(refused(WHAT))?;
    let mut w = DMatrix::from_row_slice(targets.len(), columns.len(), &rows);
    let lengths: Vec<f64> = w.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    w.column_iter_mut().zip(&lengths).for_each(|(mut c, l)| c.scale_mut(1.0 / l));
    let qr = w.qr();
    let right = qr.q().transpose() * DVector::from_vec(targets);
    let singular = || PaperError::Other { what: WHAT, reason: "columns that depend on each other".to_string() };
    let found = qr.r().solve_upper_triangular(&right).ok_or_else(singular)?;
    let mut theta = vec![0.0; observation.columns().len()];
    columns.iter().zip(found.iter().zip(&lengths)).for_each(|(&c, (x, l))| theta[c] = x / l);
    Ok((theta, observation.band()))
}

/// Forces of every leg by all models, per recording.
fn judge(robot: &Robot, recordings: [&Recording; 2], models: [&[f64]; MODELS], band: f64) -> Result<[Vec<Forces>; 2], PaperError> {
    let n_act = robot.model.n_act();
    let mut out = [vec![Forces::default(); n_act], vec![Forces::default(); n_act]];
    let options = RowOptions { band_hz: Some(band), ..RowOptions::default() };
    let all = recordings.map(|r| (r, Use::Holdout));
    let observation = Observation::try_new(robot, &all, options).map_err(refused(WHAT))?;
    let mut visit = |block: &Block<'_>| {
        for (drive, forces) in out[block.recording].iter_mut().enumerate() {
            for i in 0..block.len() {
                let measured = block.effort(drive, i);
                forces.time.push(block.time[i]);
                forces.measured.push(measured);
                for (predicted, theta) in forces.predicted.iter_mut().zip(models) {
                    predicted.push(measured - rest(block, (drive, i), theta));
                }
            }
        }
    };
    observation.each(Rows::HeldOut, &mut visit, &mut |_| {}).map_err(refused(WHAT))?;
    // The same rows without what was recorded at standstill.
    let observation = Observation::try_new(robot, &recordings.map(|r| (r, Use::Fit)), options).map_err(refused(WHAT))?;
    let mut visit = |block: &Block<'_>| {
        for (drive, forces) in out[block.recording].iter_mut().enumerate() {
            for i in (0..block.len()).filter(|&i| block.is_active(drive, i)) {
                let (squares, count) = &mut forces.moving;
                *count += 1.0;
                for (square, theta) in squares.iter_mut().zip(models) {
                    let error = rest(block, (drive, i), theta);
                    *square += error * error;
                }
            }
        }
    };
    observation.each(Rows::Fitted, &mut visit, &mut |_| {}).map_err(refused(WHAT))?;
    Ok(out)
}

/// What the parameters leave of a row.
fn rest(block: &Block<'_>, (drive, i): (usize, usize), theta: &[f64]) -> f64 {
    block.target(drive, i) - block.row(drive, i).iter().zip(theta).map(|(w, x)| w * x).sum::<f64>()
}

/// Errors of the paper by leg, identification and verification `[%]`.
const IDENTIFIED: [f64; 4] = [1.869, 0.696, 1.457, 0.847];
const VERIFIED: [f64; 4] = [3.458, 4.492, 14.537, 15.806];

/// The largest error of the paper's model without friction `[%]`.
const SMOOTH: f64 = 19.84;

/// What the percentages are.
const NORMALISED: &str = "root mean square over the range of the measured force, while the drive moves; the paper's normalisers differ from leg to leg \
                          and are not stated";

fn table(place: &'static str, name: &str, forces: &[Forces], paper: [f64; 4], limit: f64) -> Vec<Row> {
    let row = |(leg, (f, paper)): (usize, (&Forces, f64))| {
        let row =
            Row::new(place, format!("{name} error of leg {leg}, %"), 100.0 * f.nrmse(0, Samples::Moving), Some(paper), Gate::AtMost(limit));
        row.conclusion_only(format!("{NORMALISED}; forces and friction of another plant, bound by the same limit"))
    };
    (1..).zip(forces.iter().zip(paper)).map(row).collect()
}

fn plot(leg: usize, forces: &Forces) -> Plot {
    let line = |label: &str, values: &[f64]| Line {
        label: label.to_string(),
        points: forces.time.iter().copied().zip(values.iter().copied()).collect(),
    };
    Plot {
        title: format!("Force of leg {leg} along the verification motion (Figure 13)"),
        x_label: "time, s".to_string(),
        y_label: "force, N".to_string(),
        lines: vec![
            line("measured", &forces.measured),
            line("identified", &forces.predicted[0]),
            line("identified without friction", &forces.predicted[1]),
        ],
    }
}

/// Columns to identify with.
pub(super) struct Sets<'s> {
    /// The paper's reduced model.
    pub(super) reduced: &'s [usize],
    /// The same without friction.
    pub(super) smooth: &'s [usize],
    /// All base parameters.
    pub(super) all: &'s [usize],
}

/// Identifies with all sets on the first recording; compares on both.
pub(super) fn rows(robot: &Robot, recordings: [&Recording; 2], sets: &Sets<'_>) -> Result<(Vec<Row>, Vec<Plot>), PaperError> {
    let (with, band) = fit(robot, recordings[0], sets.reduced)?;
    let (without, _) = fit(robot, recordings[0], sets.smooth)?;
    let (all, _) = fit(robot, recordings[0], sets.all)?;
    let [on_train, on_test] = judge(robot, recordings, [&with, &without, &all], band)?;
    let mut rows = table("Table 3", "identification", &on_train, IDENTIFIED, 2.0);
    rows.extend(table("Table 4", "verification", &on_test, VERIFIED, 16.0));
    let standing = "friction of a drive that stands may be anything between its limits: no linear model says what it is";
    for (place, name, forces) in [("Table 3", "identification", &on_train), ("Table 4", "verification", &on_test)] {
        let what = format!("largest {name} error, samples at standstill counted, %");
        rows.push(Row::new(place, what, largest(forces, 0, Samples::All), None, Gate::Told).because(standing));
    }
    let [ours, smooth, whole] = [0, 1, 2].map(|m| largest(&on_test, m, Samples::Moving));
    rows.push(
        Row::new("section 3.2", "largest verification error without friction, %", smooth, Some(SMOOTH), Gate::AtLeast(ours))
            .conclusion_only("friction in the model makes its error smaller; how much depends on the plant"),
    );
    let row = Row::new("section 3.2", "the same over that with friction", smooth / ours, Some(SMOOTH / VERIFIED[3]), Gate::AtLeast(1.0));
    rows.push(row.conclusion_only("printed as 19.84 % for another model of the same robot and 15.80 % for the reduced one"));
    rows.push(
        Row::new("section 3.1", "largest verification error with all 73 base parameters, %", whole, None, Gate::AtMost(16.0))
            .because("17 more columns that the motion hardly shows change little"),
    );
    rows.extend(friction_rows(robot, &with)?);
    Ok((rows, (1..).zip(&on_test).map(|(leg, f)| plot(leg, f)).collect()))
}

/// Coulomb friction of the drives against the plant's own.
fn friction_rows(robot: &Robot, theta: &[f64]) -> Result<Vec<Row>, PaperError> {
    let mut rows = Vec::new();
    let columns = Columns::new(robot);
    for name in ["q13", "q23", "q33", "q42"] {
        let missing = || PaperError::Other { what: WHAT, reason: format!("no column of {name}") };
        let i = columns.index(&format!("{name}.coulomb")).ok_or_else(missing)?;
        let true_value = columns.list[i].nominal;
        let row = Row::held_against(
            "eq. 24",
            format!("Coulomb friction of {name}, N"),
            theta[i],
            None,
            (Gate::Within(0.05 * true_value), true_value),
        );
        rows.push(row.because("against the plant's own"));
    }
    Ok(rows)
}
