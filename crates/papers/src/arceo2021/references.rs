//! Section 5.1: gait and the isokinetic exercise.

use pkm_dyn::Model;
use pkm_sim::ankle::printed_gait;
use pkm_sim::{Ankle, AnkleAngle, AnkleExercise, AnkleMotion, Sample, Trajectory};

use crate::arceo2021::equations::B1;
use crate::arceo2021::geometry::FITTED;
use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::{Gate, Row};

/// Events of Table 3: time of a cycle of four seconds `[s]`, printed angle, and what the printed polynomial has there `[rad]` with the
/// half of its last digit.
const EVENTS: [(f64, f64, f64, f64); 6] = [
    (0.0, 1.6179, 1.6123, 5e-5),
    (0.36, 1.5874, 1.5901, 5e-5),
    (1.96, 1.863, 1.8304, 5e-5),
    (2.48, 1.45, 1.5356, 5e-5),
    (3.56, 1.6895, -0.79, 5e-3),
    (4.0, 1.6179, -11.5, 5e-2),
];

/// Times per cycle at which motions are looked at.
const LOOKS: usize = 4000;

/// The exercise of the foot as a motion of the fitted robot's piston.
pub(super) fn motion(exercise: AnkleExercise) -> Result<AnkleMotion, PaperError> {
    let model: Model = shipped(FITTED.robot)?.robot.model;
    let reason = "moves no ankle".to_string();
    let ankle = Ankle::of(FITTED.robot).ok_or(PaperError::Robot { name: FITTED.robot, reason })?;
    Ok(AnkleMotion::try_new(&model, ankle, exercise)?)
}

/// Rows of the references.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let rounding = "four decimals leave 0.055 rad open at 1.75 s and 81 rad at 3.56 s, and no rounding of the coefficients passes the table \
                    better than 0.04 rad; the reference is a periodic cubic spline through the table, the polynomial until 1.75 s only";
    let mut rows: Vec<Row> = EVENTS
        .into_iter()
        .map(|(t, paper, checked, width)| {
            let what = format!("printed polynomial of gait at {t} s, rad");
            Row::held_against("Table 3", what, printed_gait(t)[0], Some(paper), (Gate::Within(width), checked)).not_reproducible(rounding)
        })
        .collect();
    rows.extend(gait()?);
    rows.extend(isokinetic()?);
    Ok(rows)
}

fn looks(exercise: AnkleExercise) -> impl Iterator<Item = f64> {
    let step = exercise.length_s() / LOOKS as f64;
    (0..=LOOKS).map(move |i| step * i as f64)
}

fn gait() -> Result<Vec<Row>, PaperError> {
    let (angle, motion) = (AnkleAngle::new(AnkleExercise::Gait), motion(AnkleExercise::Gait)?);
    let gap = EVENTS.iter().map(|(t, paper, ..)| (angle.at(*t)[0] - paper).abs()).fold(0.0, f64::max);
    let fastest = looks(AnkleExercise::Gait).map(|t| angle.at(t)[1].abs()).fold(0.0, f64::max);
    let mut sample = Sample::default();
    let (mut low, mut high, mut speed) = (f64::MAX, f64::MIN, 0.0_f64);
    for t in looks(AnkleExercise::Gait) {
        motion.at(t, &mut sample);
        (low, high, speed) = (low.min(sample.q[0]), high.max(sample.q[0]), speed.max(sample.v[0].abs()));
    }
    let spline = "the periodic cubic spline through Table 3, by an independent program";
    let row = |what: &str, ours: f64, (width, checked): (f64, f64)| {
        Row::held_against("Table 3", what, ours, None, (Gate::Within(width), checked)).because(spline)
    };
    Ok(vec![
        Row::new("Table 3", "largest gap of the spline at the events, rad", gap, Some(0.0), Gate::Within(1e-12)),
        row("gait: fastest turn of the foot, deg/s", fastest.to_degrees(), (0.5, 52.0)),
        row("gait: lowest position of the piston, m", low, (5e-5, 0.0558)),
        row("gait: highest position of the piston, m", high, (5e-5, 0.0962)),
        row("gait: voltage that its speed needs, V", speed / B1, (5e-3, 8.84)),
    ])
}

fn isokinetic() -> Result<Vec<Row>, PaperError> {
    let (angle, motion) = (AnkleAngle::new(AnkleExercise::Isokinetic), motion(AnkleExercise::Isokinetic)?);
    let mut rows = Vec::new();
    let speed = "\"an ankle speed of 40 degrees per second\" is that of the first segment alone";
    for (t, checked) in [(0.4, -40.0), (1.5, 0.0), (3.0, -20.0), (4.0, 0.0), (6.0, 20.0)] {
        let what = format!("isokinetic exercise: speed of the foot at {t} s, deg/s");
        let ours = angle.at(t)[1].to_degrees();
        // Half a thousandth of a degree per second: slopes are exact.
        let row = Row::held_against("eq. 12", what, ours, Some(40.0), (Gate::Within(5e-4), checked));
        let is_right = (checked.abs() - 40.0).abs() < 1e-9;
        rows.push(if is_right { Row { paper: Some(-40.0), ..row }.because(speed) } else { row.not_reproducible(speed) });
    }
    let jumps = [0.75, 2.25, 3.75, 4.5, 7.5].map(|t| (angle.at(t)[0] - angle.at(t - 1e-12)[0]).abs());
    let ends = jumps.into_iter().fold(0.0, f64::max);
    rows.push(
        Row::new("eq. 12", "largest jump between the segments, rad", ends, Some(3.8e-5), Gate::AtMost(3.8e-5))
            .because("with 11 pi/18 and 4 pi/9 for the rounded 1.9199 and 1.3963, which leave jumps of 3.8e-5 rad"),
    );
    let mut sample = Sample::default();
    let mut fastest = 0.0_f64;
    for t in looks(AnkleExercise::Isokinetic) {
        motion.at(t, &mut sample);
        fastest = fastest.max(sample.v[0].abs());
    }
    rows.push(
        Row::held_against(
            "eq. 12",
            "isokinetic exercise: voltage that its speed needs, of 10 V",
            fastest / B1,
            None,
            (Gate::Within(0.06), 9.65),
        )
        .because("9.6 to 9.7 V over the first segment: hardly anything is left for control"),
    );
    Ok(rows)
}
