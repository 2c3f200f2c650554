//! The linear model of drives and ankle: its size, the gains it bears, the four controllers of the paper's experiment.

use nalgebra::{DMatrix, DVector};
use pkm_ctrl::design::force_loop::{Direction, DriveTrain, ForceLoop};

use super::ankle::{DT, K_D, PROPOSED, PROPOSED_14, force_loop};
use crate::error::PaperError;
use crate::refused::refused;
use crate::row::{Gate, Line, Plot, Row};

const WHAT: &str = "stability of the force loop";

/// What the chapter leaves open.
const ASSUMED: &str = "the chapter gives no parameter of the actuator but pitch and ratio: a set chosen so that uniform gains become \
                       unstable about where the paper's do";

/// Gains of the uniform controller that the paper compares with.
const UNIFORM: [f64; 4] = [5.0; 4];

/// Samples of a step response.
const SAMPLES: u32 = 100;

/// Directions by the gains' names.
const NAMES: [&str; 4] = ["k1", "k2", "k3", "k0"];

fn checked(place: &'static str, what: impl Into<String>, ours: f64, (width, checked): (f64, f64)) -> Row {
    Row::held_against(place, what, ours, None, (Gate::Within(width), checked)).because(ASSUMED)
}

/// Sizes and numbers of the model.
fn model_rows(model: &ForceLoop) -> Result<Vec<Row>, PaperError> {
    let plant = model.plant().map_err(refused(WHAT))?;
    let lagged = model.lagged().map_err(refused(WHAT))?;
    let open = model.open_loop().map_err(refused(WHAT))?;
    let states = [
        ("eq. 8.22", "three masses", &plant, 22.0),
        ("eq. 8.31", "three masses and currents", &lagged, 26.0),
        ("eq. 8.35", "masses, currents and filters", &open, 30.0),
    ];
    let mut rows: Vec<Row> = states
        .map(|(place, what, system, count)| {
            let what = format!("states of the model with {what}");
            Row::new(place, what, system.matrices()[0].nrows() as f64, Some(count), Gate::Within(0.0))
        })
        .into();
    let trace: f64 = (0..26).map(|i| open.matrices()[0][(i, i)]).sum();
    let slowest = lagged.stability().map_or(f64::NAN, |(_, distance)| -distance);
    let train = DriveTrain::ANKLE;
    let gear = train.force_constant() / train.torque_constant;
    rows.push(Row::held_against("section 8.3.2", "turns of the motor over travel, rad/m", gear, None, (Gate::Within(0.1), 9894.8)));
    rows.push(checked("eq. 8.5", "mass that a rotor seems to have, kg", train.apparent_mass(), (0.5, 1958.0)));
    rows.push(checked("eq. 8.35", "trace of the sampled model without filters", trace, (1e-9, 11.636_549_336_756)));
    rows.push(checked("eq. 8.31", "slowest pole of the model, 1/s", slowest, (5e-4, -0.035)));
    for (k, (mass, known)) in model.effective_masses().iter().zip([93.919, 20.152, 2.413]).enumerate() {
        rows.push(checked("eq. 8.48", format!("effective mass in direction {}, kg", k + 1), *mass, (6e-4, known)));
    }
    Ok(rows)
}

/// Gains at the limit of stability: all at once, then one direction at a time; `[k1, k2, k3, k0]` with P and PD.
fn critical_rows(models: [(&'static str, &ForceLoop); 2]) -> Result<Vec<Row>, PaperError> {
    let known = [(8.80, 10.0, [8.8, 16.2, 158.0, 11.0]), (15.50, 16.0, [15.5, 22.6, 113.0, 18.5])];
    let mut rows = Vec::new();
    for ((filter, model), (uniform, paper, known)) in models.into_iter().zip(known) {
        let critical = |direction| model.critical_gain(direction).map_err(refused(WHAT));
        let what = format!("uniform gain at the limit of stability, {filter}");
        let row = Row::held_against("Table 8.5", what, critical(Direction::Uniform)?, Some(paper), (Gate::Within(5e-3), uniform));
        rows.push(row.conclusion_only(ASSUMED));
        let mut found = [0.0; 4];
        for (k, known) in known.into_iter().enumerate() {
            found[k] = critical(Direction::Along(k))?;
            let what = format!("gain {} at the limit of stability, {filter}", NAMES[k]);
            rows.push(checked("Figure 8.14", what, found[k], (0.006 * known, known)));
        }
        let order = (found[2] - found[1]).min(found[1] - found[0].max(found[3]));
        let what = format!("least distance in k3 > k2 > max(k1, k0) at the limit, {filter}");
        rows.push(Row::new("Figure 8.14", what, order, None, Gate::AtLeast(0.0)).because("the order of the paper's three directions"));
    }
    Ok(rows)
}

/// The four controllers of the experiment: largest modulus of a pole.
fn controller_rows([p, pd]: [&ForceLoop; 2]) -> Result<Vec<Row>, PaperError> {
    let table = [
        ("P, uniform gain of 10: unstable", p, [10.0; 4], 1.001_813),
        ("PD, uniform gain of 16: unstable", pd, [16.0; 4], 1.000_476),
        ("proposed: stable", pd, PROPOSED, 0.995_433),
        ("proposed, smallest gain 14: stable", pd, PROPOSED_14, 0.998_571),
    ];
    let mut rows = Vec::new();
    for (what, model, k, known) in table {
        let radius = model.spectral_radius(&model.gain(|i| k[i])).map_err(refused(WHAT))?;
        let what = format!("largest modulus of a pole, {what}");
        let row = Row::held_against("Table 8.5", what, radius, None, (Gate::Within(1e-6), known));
        rows.push(
            row.conclusion_only("which two oscillate and which two do not is the paper's; it prints neither poles nor the proposed gains"),
        );
    }
    let above = PROPOSED[1].min(PROPOSED[2]);
    let row = Row::new("Table 8.5", "smaller one of k2 and k3 of the proposed, against 16", above, Some(16.0), Gate::AtLeast(16.0));
    rows.push(row.because("stable with gains above the uniform one that is not"));
    Ok(rows)
}

/// Forces along the second direction after a step of 10 N there.
fn step(model: &ForceLoop, k: [f64; 4]) -> Result<Vec<(f64, f64)>, PaperError> {
    let one = |wanted: usize| model.gain(|i| if i == wanted { 1.0 } else { 0.0 });
    let along = one(1).symmetric_eigen();
    let (at, _) = along.eigenvalues.argmax();
    let u: DVector<f64> = along.eigenvectors.column(at).into_owned();
    let closed = model.closed_loop(&model.gain(|i| k[i])).map_err(refused(WHAT))?;
    let [a, b, c, _] = closed.matrices();
    let push = b.columns(0, 4) * &u * 10.0;
    let mut x = DMatrix::zeros(a.nrows(), 1).column(0).into_owned();
    let mut points = Vec::new();
    for i in 0..SAMPLES {
        points.push((DT * f64::from(i), u.dot(&(c * &x))));
        x = a * &x + &push;
    }
    Ok(points)
}

/// Step responses of three controllers.
fn plot(model: &ForceLoop) -> Result<Plot, PaperError> {
    let line = |label: &str, k| Ok::<_, PaperError>(Line { label: label.to_string(), points: step(model, k)? });
    Ok(Plot {
        title: "Force along the second direction after a step of 10 N (Table 8.5)".to_string(),
        x_label: "time, s".to_string(),
        y_label: "force, N".to_string(),
        lines: vec![line("proposed", PROPOSED)?, line("uniform 5", UNIFORM)?, line("uniform 16", [16.0; 4])?],
    })
}

/// Model, critical gains, controllers.
pub(super) fn rows() -> Result<(Vec<Row>, Plot), PaperError> {
    let (p, pd) = (force_loop([0.0; 3], 0.0)?, force_loop([0.0; 3], K_D)?);
    let mut rows = model_rows(&pd)?;
    rows.extend(critical_rows([("P", &p), ("PD", &pd)])?);
    rows.extend(controller_rows([&p, &pd])?);
    Ok((rows, plot(&pd)?))
}
