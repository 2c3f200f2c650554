//! The reduced model identified from a simulated recording and verified on another motion.

use nalgebra::{DMatrix, DVector};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_ident::Recording;
use pkm_ident::columns::Columns;
use pkm_ident::motion::Use;
use pkm_ident::observation::{Observation, RowOptions, Rows};
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
pub(super) fn recorded(truth: &Robot, motion: &dyn Trajectory, seconds: f64, progress: &mut dyn FnMut(f64)) -> Result<Recording, PaperError> {
    let plant = PlantKind::Constrained(ConstrainedOptions::default());
    let scenario = Scenario { duration_s: seconds, rate_hz: RATE_HZ, plant, ..Scenario::default() };
    Ok(run_along([truth, truth], &scenario, motion, &mut |t| progress(t / seconds))?)
}

/// Forces of one leg in one recording.
#[derive(Default, Clone)]
pub(super) struct Forces {
    time: Vec<f64>,
    measured: Vec<f64>,
    /// By each model.
    predicted: [Vec<f64>; 2],
}

impl Forces {
    /// Root mean square error over the range of what was measured, of model `m`.
    fn nrmse(&self, m: usize) -> f64 {
        let (low, high) = self.measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        self.rmse(m) / (high - low)
    }

    fn rmse(&self, m: usize) -> f64 {
        let sum: f64 = self.measured.iter().zip(&self.predicted[m]).map(|(a, b)| (a - b) * (a - b)).sum();
        math::sqrt(sum / self.measured.len().max(1) as f64)
    }
}

/// Least squares on chosen columns of a recording.
fn fit(robot: &Robot, train: &Recording, columns: &[usize]) -> Result<(Vec<f64>, f64), PaperError> {
    let observation = Observation::try_new(robot, &[(train, Use::Fit)], RowOptions::default()).map_err(refused(WHAT))?;
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    let n_act = robot.model.n_act();
    let mut visit = |block: &pkm_ident::observation::Block<'_>| {
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

/// Forces of every leg by two models, per recording.
fn judge(robot: &Robot, recordings: [&Recording; 2], models: [&[f64]; 2], band: f64) -> Result<[Vec<Forces>; 2], PaperError> {
    let n_act = robot.model.n_act();
    let mut out = [vec![Forces::default(); n_act], vec![Forces::default(); n_act]];
    let options = RowOptions { band_hz: Some(band), ..RowOptions::default() };
    let all = recordings.map(|r| (r, Use::Holdout));
    let observation = Observation::try_new(robot, &all, options).map_err(refused(WHAT))?;
    let mut visit = |block: &pkm_ident::observation::Block<'_>| {
        for (drive, forces) in out[block.recording].iter_mut().enumerate() {
            for i in 0..block.len() {
                let (row, measured) = (block.row(drive, i), block.effort(drive, i));
                forces.time.push(block.time[i]);
                forces.measured.push(measured);
                for (predicted, theta) in forces.predicted.iter_mut().zip(models) {
                    let rest = block.target(drive, i) - row.iter().zip(theta).map(|(w, x)| w * x).sum::<f64>();
                    predicted.push(measured - rest);
                }
            }
        }
    };
    observation.each(Rows::HeldOut, &mut visit, &mut |_| {}).map_err(refused(WHAT))?;
    Ok(out)
}

/// Errors of the paper by leg, identification and verification `[%]`.
const IDENTIFIED: [f64; 4] = [1.869, 0.696, 1.457, 0.847];
const VERIFIED: [f64; 4] = [3.458, 4.492, 14.537, 15.806];

/// The largest error of the paper's model without friction `[%]`.
const SMOOTH: f64 = 19.84;

/// What the percentages are.
const NORMALISED: &str = "root mean square over the range of the measured force; the paper's normalisers differ from leg to leg and are not stated";

fn table(place: &'static str, name: &str, forces: &[Forces], paper: [f64; 4], limit: f64) -> Vec<Row> {
    let row = |(leg, (f, paper)): (usize, (&Forces, f64))| {
        let row = Row::new(place, format!("{name} error of leg {leg}, %"), 100.0 * f.nrmse(0), Some(paper), Gate::AtMost(limit));
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

/// Identifies with the columns of `reduced` and with those of them that are no friction, `inertial`; compares on both recordings.
pub(super) fn rows(robot: &Robot, recordings: [&Recording; 2], reduced: &[usize], inertial: &[usize]) -> Result<(Vec<Row>, Vec<Plot>), PaperError> {
    let [train, test] = recordings;
    let (with, band) = fit(robot, train, reduced)?;
    let (without, _) = fit(robot, train, inertial)?;
    let [on_train, on_test] = judge(robot, [train, test], [&with, &without], band)?;
    let mut rows = table("Table 3", "identification", &on_train, IDENTIFIED, 2.0);
    rows.extend(table("Table 4", "verification", &on_test, VERIFIED, 16.0));
    let largest = |m: usize| on_test.iter().map(|f| 100.0 * f.nrmse(m)).fold(0.0, f64::max);
    let [ours, smooth] = [0, 1].map(largest);
    rows.push(
        Row::new("section 3.2", "largest verification error without friction, %", smooth, Some(SMOOTH), Gate::AtLeast(ours))
            .conclusion_only("friction in the model makes its error smaller; how much depends on the plant"),
    );
    rows.push(Row::new("section 3.2", "the same over that with friction", smooth / ours, Some(SMOOTH / VERIFIED[3]), Gate::AtLeast(1.0)).conclusion_only(
        "printed as 19.84 % for another model of the same robot and 15.80 % for the reduced one",
    ));
    let columns = Columns::new(robot);
    for name in ["q13", "q23", "q33", "q42"] {
        let missing = || PaperError::Other { what: WHAT, reason: format!("no column of {name}") };
        let i = columns.index(&format!("{name}.coulomb")).ok_or_else(missing)?;
        let true_value = columns.list[i].nominal;
        let row = Row::held_against("eq. 24", format!("Coulomb friction of {name}, N"), with[i], None, (Gate::Within(0.05 * true_value), true_value));
        rows.push(row.because("against the plant's own"));
    }
    Ok((rows, (1..).zip(&on_test).map(|(leg, f)| plot(leg, f)).collect()))
}
