//! Sections 4 and 5: computed torque against active disturbance rejection on gait and on the isokinetic exercise.

use pkm_ctrl::adrc::{Extended, Feedback};
use pkm_ctrl::observer::{CommandedVelocity, NonlinearEso};
use pkm_ctrl::tracking_differentiator::{fal, fhan};
use pkm_ctrl::{Adrc, AdrcConfig, ComputedTorqueDae, ComputedTorqueDaeConfig, Controller, ErrorGains, Input};
use pkm_dyn::effects::Robot;
use pkm_dyn::model::{JointKind, ModelBuilder};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::spatial::Pose;
use pkm_sim::{AnkleExercise, Sample, Trajectory};

use crate::arceo2021::equations::{B0, B1};
use crate::arceo2021::gains::{POLES, TS};
use crate::arceo2021::references::motion;
use crate::error::PaperError;
use crate::row::{Gate, Line, Plot, Row};
use crate::series::rms;

/// Limit of the voltage `[V]`.
const LIMIT: f64 = 10.0;

/// Lag of the drive `[s]`: not in the paper, but no drive is without one.
const LAG_S: f64 = 0.03;

/// Periods of a run, and those left out of its numbers.
const PERIODS: usize = 1600;
const LEFT_OUT: usize = 400;

/// Printed acceleration limit of the law and input coefficient of Nelder and Mead's tuning.
const R: f64 = 0.388_43;
const B2: f64 = 0.1088;

/// What a run shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Root mean square of the position's error from 4 s to 16 s `[m]`.
    pub error: f64,
    /// Root mean square of the voltage's increments meanwhile `[V]`.
    pub increment: f64,
    /// Largest voltage `[V]`.
    pub volts: f64,
    /// Time `[s]`, wanted and actual position `[m]`, voltage `[V]`.
    pub rows: Vec<[f64; 4]>,
}

/// What the paper says the robot is to its computer: `d' = b1·u`, through a lag.
struct Servo {
    d: f64,
    v: f64,
}

impl Servo {
    fn advance(&mut self, u: f64) {
        let h = 0.1 * TS;
        for _ in 0..10 {
            self.v += h * (B1 * u - self.v) / LAG_S;
            self.d += h * self.v;
        }
    }
}

/// Positions of the piston at 100 Hz `[m]`, for as long as a run takes.
///
/// # Errors
/// A robot that cannot do the exercise.
pub fn positions(exercise: AnkleExercise) -> Result<Vec<f64>, PaperError> {
    let motion = motion(exercise)?;
    let mut sample = Sample::default();
    let at = |k: usize| {
        motion.at(TS * k as f64, &mut sample);
        sample.q[0]
    };
    Ok((0..PERIODS + 2).map(at).collect())
}

/// A single slider of the mass that makes `b0·u'` what a drive of `d' = b1·u` does.
fn as_a_slider() -> Result<Robot, PaperError> {
    let bad = |reason: String| PaperError::Robot { name: "slider", reason };
    let mut builder = ModelBuilder::new("servo", [0.0; 3]);
    builder.link("base", InertialParameters::default());
    builder.link("piston", InertialParameters { mass: B0 / B1, ..InertialParameters::default() });
    builder.moving_joint("d", JointKind::Prismatic, ("base", "piston"), Pose::identity(), nalgebra::Vector3::x());
    let mut model = builder.build().map_err(|e| bad(e.to_string()))?;
    model.add_actuator("d", 0.0).map_err(|e| bad(e.to_string()))?;
    Ok(Robot::new(model, Vec::new()))
}

/// Computed torque as section 5.2 samples it, with the gains placed rightly.
///
/// # Errors
/// Never on the numbers of this file.
pub fn computed_torque() -> Result<ComputedTorqueDae<1, CommandedVelocity>, PaperError> {
    let config = ComputedTorqueDaeConfig { gains: [ErrorGains::placed_sampled(POLES, TS)], b0: [B0], u_limit: [LIMIT], creep: 0.0 };
    Ok(ComputedTorqueDae::try_new(as_a_slider()?, CommandedVelocity, config)?)
}

/// Active disturbance rejection with the printed r and b, and the observer `eso`; `c` and `h` `[s]` are those of the law.
///
/// # Errors
/// Gains that are not positive.
pub fn adrc(eso: NonlinearEso, [c, h]: [f64; 2]) -> Result<Adrc<1>, PaperError> {
    Ok(Adrc::try_new(AdrcConfig {
        b: [[B2]],
        extended: Extended::Nonlinear(eso),
        feedback: Feedback::TimeOptimal { r: R, c, h },
        reference_acceleration: f64::INFINITY,
        limit: [LIMIT],
    })?)
}

/// Han's gains of the observer, and the printed ones.
#[must_use]
pub fn observers() -> [NonlinearEso; 2] {
    let han = NonlinearEso::for_period(TS, TS);
    [han, NonlinearEso { beta: [1.0, 1.0 / (3.0 * TS), han.beta[2]], ..han }]
}

/// Follows `positions` `[m]`, differentiated as the laboratory's program would.
///
/// # Errors
/// A law that faults, or a command beyond the limit.
pub fn follow<C: Controller<1>>(law: &C, positions: &[f64]) -> Result<Run, PaperError> {
    let at = |k: usize| positions[k % positions.len()];
    let mut servo = Servo { d: at(0), v: 0.0 };
    let (mut state, mut u, mut rows) = (law.at_rest(), 0.0, Vec::new());
    let (mut errors, mut increments, mut volts) = (Vec::new(), Vec::new(), 0.0_f64);
    for k in 0..PERIODS {
        let (before, here, after) = (at(k.saturating_sub(1)), at(k), at(k + 1));
        let is_first = k == 0;
        let v = if is_first { 0.0 } else { (after - before) / (2.0 * TS) };
        let a = if is_first { 0.0 } else { (after - 2.0 * here + before) / (TS * TS) };
        let input = Input { q_ref: [here], v_ref: [v], a_ref: [a], ..Input::standing([servo.d], TS) };
        let command = law.step(&mut state, &input);
        if command.health.is_faulted || command.tau[0].abs() > LIMIT {
            return Err(PaperError::Other { what: "section 5", reason: format!("faulted in period {k}") });
        }
        servo.advance(command.tau[0]);
        rows.push([TS * k as f64, here, servo.d, command.tau[0]]);
        if k >= LEFT_OUT {
            errors.push(servo.d - here);
            increments.push(command.tau[0] - u);
            volts = volts.max(command.tau[0].abs());
        }
        u = command.tau[0];
    }
    Ok(Run { error: rms(&errors), increment: rms(&increments), volts, rows })
}

/// Rows and pictures of sections 4 and 5.
pub(super) fn rows() -> Result<(Vec<Row>, Vec<Plot>), PaperError> {
    let [han, printed] = observers();
    let (torque, rejection) = (computed_torque()?, adrc(han, [0.5, TS])?);
    let [gait, exercise] = [positions(AnkleExercise::Gait)?, positions(AnkleExercise::Isokinetic)?];
    let on_gait = [follow(&torque, &gait)?, follow(&rejection, &gait)?];
    let on_exercise = [follow(&torque, &exercise)?, follow(&rejection, &exercise)?];
    let mut rows = functions();
    rows.extend(comparison(&on_gait, &on_exercise));
    // Nelder and Mead's tuning, with the printed step of the law as the width of its straight part.
    let tuned = NonlinearEso { beta: [0.977_77, 2.3586, 0.0044], delta: 0.005_835_5 };
    let as_printed = follow(&adrc(printed, [0.5, TS])?, &gait)?;
    let as_tuned = follow(&adrc(tuned, [7.5321, 0.005_835_5])?, &gait)?;
    rows.extend(misprints(&on_gait[1], &as_printed, &as_tuned));
    let plots = [
        ("gait", ["Figures 9a and 11a", "Figures 9b and 11b"], &on_gait),
        ("isokinetic exercise", ["Figures 10a and 12a", "Figures 10b and 12b"], &on_exercise),
    ];
    Ok((rows, plots.into_iter().flat_map(|(name, figures, runs)| pictures(name, figures, runs)).collect()))
}

/// The two functions of Figure 6, against Han's published values.
fn functions() -> Vec<Row> {
    let row = |what: &str, ours: f64, width: f64, checked: f64| {
        let row = Row::held_against("section 4", what, ours, None, (Gate::Within(width), checked));
        row.because("the sampled form; the paper's −r sign(..) is its continuous case and chatters")
    };
    vec![
        row("fhan(0.1, 0, 0.38843, 0.0058355)", fhan(0.1, 0.0, R, 0.005_835_5), 1e-9, -0.38843),
        // The checked value belongs to an h of more digits than are printed.
        row("fhan(1e-6, 1e-5, 0.38843, 0.0058355)", fhan(1e-6, 1e-5, R, 0.005_835_5), 1e-7, -0.032_793_278_5),
        row("fal(0.002, 0.5, 0.01)", fal(0.002, 0.5, 0.01), 1e-9, 0.02),
        row("fal(0.5, 0.25, 0.01)", fal(0.5, 0.25, 0.01), 1e-9, 0.840_896_415_3),
    ]
}

fn comparison([torque, rejection]: &[Run; 2], [torque_2, rejection_2]: &[Run; 2]) -> Vec<Row> {
    let plant = "d' = b1·u through a lag of 30 ms, 10 V, 100 Hz; Han's beta02 and c = 0.5, r and b as printed; the paper prints curves alone. An \
                 independent program: 0.57 and 0.27 mm, 0.12 and 4.2 V on gait, 0.80 and 7.9 mm on the isokinetic exercise";
    let told = |place: &'static str, what: &str, ours: f64, (width, checked): (f64, f64)| {
        Row::held_against(place, what, ours, None, (Gate::Within(width), checked)).conclusion_only(plant)
    };
    vec![
        told("Figure 9a", "gait, computed torque: rms of the error, mm", 1e3 * torque.error, (0.05, 0.57)),
        told("Figure 11a", "gait, disturbance rejection: rms of the error, mm", 1e3 * rejection.error, (0.05, 0.27)),
        Row::new(
            "section 6",
            "gait: error of disturbance rejection over computed torque",
            rejection.error / torque.error,
            None,
            Gate::AtMost(1.0),
        )
        .conclusion_only("\"almost identical in both schemes, though the model-free ADRC proposal is slightly better\""),
        told("Figure 9b", "gait, computed torque: rms of the voltage's increments, V", torque.increment, (0.02, 0.12)),
        told("Figure 11b", "gait, disturbance rejection: rms of the voltage's increments, V", rejection.increment, (0.5, 4.2)),
        Row::new(
            "section 6",
            "gait: increments of disturbance rejection over computed torque",
            rejection.increment / torque.increment,
            None,
            Gate::AtLeast(10.0),
        )
        .conclusion_only("\"clearly more noisy\""),
        Row::new("Figure 10a", "isokinetic, computed torque: rms of the error, mm", 1e3 * torque_2.error, None, Gate::AtMost(0.80))
            .conclusion_only("0.80 mm by the independent program; here the integral waits while the voltage is at its limit"),
        told("Figure 12a", "isokinetic, disturbance rejection: rms of the error, mm", 1e3 * rejection_2.error, (0.5, 7.9)),
        Row::new(
            "section 6",
            "isokinetic: error of disturbance rejection over computed torque",
            rejection_2.error / torque_2.error,
            None,
            Gate::AtLeast(5.0),
        )
        .conclusion_only("\"the first one tracks the isokinetic routine better\""),
    ]
}

fn misprints(good: &Run, as_printed: &Run, as_tuned: &Run) -> Vec<Row> {
    let rate = "beta02 = 1/(3h) is printed; Han's is 1/(2 sqrt h). As printed the voltage runs from limit to limit";
    let slow =
        "the command is at most (r + |z3|)/b2 = 3.6 V and gait needs 8.8 V: this tuning cannot track the robot in any unit of length";
    vec![
        Row::new(
            "section 4",
            "gait, beta02 as printed: error over that of Han's",
            as_printed.error / good.error,
            None,
            Gate::AtLeast(10.0),
        )
        .not_reproducible(rate),
        Row::held_against(
            "section 4",
            "gait, beta02 as printed: rms of the error, mm",
            1e3 * as_printed.error,
            None,
            (Gate::Within(0.5), 13.4),
        )
        .not_reproducible(rate),
        Row::held_against(
            "section 5.2",
            "gait, tuning as printed: rms of the error, mm",
            1e3 * as_tuned.error,
            None,
            (Gate::Within(0.5), 6.5),
        )
        .not_reproducible(slow),
        Row::held_against("section 5.2", "gait, tuning as printed: largest voltage, V", as_tuned.volts, None, (Gate::Within(0.1), 3.6))
            .not_reproducible(slow),
    ]
}

fn pictures(name: &str, [tracking, control]: [&str; 2], [torque, rejection]: &[Run; 2]) -> [Plot; 2] {
    // One cycle after the beginning.
    let shown = |run: &Run, column: usize| run.rows.iter().skip(LEFT_OUT).take(760).map(|r| (r[0], r[column])).collect::<Vec<_>>();
    let line = |label: &str, points: Vec<(f64, f64)>| Line { label: label.to_string(), points };
    let plot = |title: String, y_label: &str, lines: Vec<Line>| Plot {
        title,
        x_label: "time, s".to_string(),
        y_label: y_label.to_string(),
        lines,
    };
    [
        plot(
            format!("Piston on the {name} ({tracking})"),
            "position of the piston, m",
            vec![
                line("reference", shown(torque, 1)),
                line("computed torque", shown(torque, 2)),
                line("disturbance rejection", shown(rejection, 2)),
            ],
        ),
        plot(
            format!("Voltage on the {name} ({control})"),
            "V",
            vec![line("computed torque", shown(torque, 3)), line("disturbance rejection", shown(rejection, 3))],
        ),
    ]
}
