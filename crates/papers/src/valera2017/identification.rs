//! Section 3: identification with friction, physical feasibility (9), and the reduction to relevant parameters, from simulated recordings.

use core::slice::from_ref;

use pkm_dyn::Model;
use pkm_dyn::effects::Robot;
use pkm_dyn::parameters::InertialParameters;
use pkm_ident::columns::{Columns, Quantity};
use pkm_ident::estimate::Method;
use pkm_ident::{Identification, Recording, Settings, Term, identify};
use pkm_sim::{Scenario, run};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::{Gate, Line, Plot, Row};

/// Length of a recording `[s]`.
const SECONDS: f64 = 10.0;

/// The robot with other masses, rotors and friction, as a machine differs from its drawings.
fn another(model: &Model) -> Model {
    let mut chance = Chance::new(5);
    let mut out = model.clone();
    for link in model.massive_links() {
        let scale = chance.between(0.7, 1.3);
        out.set_link_parameters(link, InertialParameters::from_vector(&(model.links[link].parameters.to_vector() * scale)));
    }
    for &j in &model.actuators {
        let joint = &mut out.joints[j];
        joint.viscous *= chance.between(0.6, 1.6);
        joint.coulomb *= chance.between(0.6, 1.6);
        joint.armature *= chance.between(0.8, 1.2);
    }
    out
}

fn go(robot: &Robot, [train, test]: [&Recording; 2], settings: &Settings) -> Result<Identification, PaperError> {
    let other = |e: pkm_ident::IdentifyError| PaperError::Other { what: "identification", reason: e.to_string() };
    identify(robot, from_ref(train), from_ref(test), settings, &mut |_| {}).map_err(other)
}

fn lowest_eigenvalue(answer: &Identification) -> f64 {
    let of = |l: usize| Columns::inertial(&answer.theta, l).pseudo_inertia().symmetric_eigenvalues().min();
    (0..answer.columns.links.len()).map(of).fold(f64::INFINITY, f64::min)
}

/// Rows of the identification, and held-out errors by drive.
pub(super) fn rows(progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let description = shipped("prs3")?;
    let truth = Robot::new(another(&description.bare), Vec::new());
    let record = |seed: u64| -> Result<Recording, PaperError> {
        let scenario = Scenario { seed, duration_s: SECONDS, ..Scenario::default() };
        Ok(run(&truth, &description.robot, &scenario, &mut |_| {})?)
    };
    let (train, test) = (record(1)?, record(2)?);
    progress(0.4);
    let settings = |method: Method| Settings { method, ..Settings::default() };
    let answer = go(&description.robot, [&train, &test], &settings(Method::Relevant))?;
    progress(0.7);
    let mut smooth = description.robot.clone();
    for joint in &mut smooth.model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    let held = Settings { held: vec![Term::Friction, Term::PassiveFriction], ..settings(Method::Sdp) };
    let without = go(&smooth, [&train, &test], &held)?;
    progress(1.0);
    let friction = |p: &Quantity| matches!(p, Quantity::Viscous { .. } | Quantity::Coulomb { .. } | Quantity::Rotor { .. });
    let bounded = answer.columns.list.iter().zip(&answer.theta).filter(|(p, _)| friction(&p.quantity));
    let least = bounded.map(|(_, value)| *value).fold(f64::INFINITY, f64::min);
    let mut rows = vec![
        Row::new("eq. 9", "lowest eigenvalue of any link's pseudo-inertia", lowest_eigenvalue(&answer), None, Gate::AtLeast(0.0))
            .because("as linear matrix inequalities, which include the triangle inequality; the paper scans values of m1 and m2"),
        Row::new("eq. 8", "lowest friction parameter or rotor inertia", least, None, Gate::AtLeast(0.0)),
        Row::new(
            "eq. 8",
            "error without friction over error with it",
            without.pooled(|j| j.fitted) / answer.pooled(|j| j.fitted),
            None,
            Gate::AtLeast(2.0),
        )
        .because("\"that friction component cannot be ignored\""),
    ];
    rows.extend(reduction(&answer));
    rows.extend(recovered(&answer, &truth.model));
    let joints = answer.joints.iter();
    let points = |f: &dyn Fn(usize) -> f64| (0..answer.joints.len()).map(|k| ((k + 1) as f64, f(k))).collect();
    let [nominal, identified]: [Vec<f64>; 2] = [joints.clone().map(|j| j.nominal).collect(), joints.map(|j| j.identified).collect()];
    let plot = Plot {
        title: "Held-out error of the efforts".to_string(),
        x_label: "drive".to_string(),
        y_label: "rms of the error over rms of the effort".to_string(),
        lines: vec![
            Line { label: "nominal".to_string(), points: points(&|k| nominal[k]) },
            Line { label: "identified".to_string(), points: points(&|k| identified[k]) },
        ],
    };
    Ok((rows, plot))
}

/// The reduction: parameters that are not determined go until the rest is feasible.
fn reduction(answer: &Identification) -> Vec<Row> {
    let (Some(first), Some(last)) = (answer.steps.first(), answer.steps.last()) else { return Vec::new() };
    let what = "reduction: what is left is feasible by itself (1 yes, 0 no)";
    let feasible = if last.is_feasible {
        Row::new("section 3", what, 1.0, None, Gate::AtLeast(1.0))
    } else {
        Row::new("section 3", what, 0.0, Some(1.0), Gate::Told).not_reproducible(
            "dropping further significant parameters would raise the error of the fit: the reduction stops, and the semidefinite program \
             makes the robot feasible (the eigenvalue above); the paper drops until a scan over m1 and m2 finds a feasible set",
        )
    };
    vec![
        Row::new("section 3", "reduction: parameters before", first.parameters as f64, None, Gate::Told),
        Row::new("section 3", "reduction: relevant parameters left", last.parameters as f64, None, Gate::AtMost(first.parameters as f64)),
        feasible,
        Row::new("section 3", "reduction: held-out error after over before", last.heldout / first.heldout, None, Gate::AtMost(1.05))
            .because("the limit is the library's own: dropping what is not determined costs nothing"),
    ]
}

/// Friction of the drives against the simulated truth.
fn recovered(answer: &Identification, truth: &Model) -> Vec<Row> {
    let mut rows = Vec::new();
    for (what, of) in [("coulomb", 0), ("viscous", 1)] {
        let worst = truth.actuators.iter().map(|&j| {
            let joint = &truth.joints[j];
            let value = answer.columns.index(&format!("{}.{what}", joint.name)).map_or(f64::NAN, |i| answer.theta[i]);
            (value / [joint.coulomb, joint.viscous][of] - 1.0).abs()
        });
        let worst = worst.fold(0.0, f64::max);
        let row = Row::new("eq. 8", format!("{what} friction of the drives: largest error over truth"), worst, None, Gate::AtMost(0.03));
        rows.push(row.because("simulated recordings with counts of 1 um and 1 % of noise on the efforts"));
    }
    rows
}
