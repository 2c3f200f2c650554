//! The page of `pkm excite`: the motion between its limits, and how the search went.

use pkm_dyn::math;
use pkm_dyn::model::Model;
use pkm_ident::excitation::{Bounded, Criterion, DriveState, Excitation};
use pkm_report::{Curve, Figure, Ink, Scale, Sheet, Table, Tone, sheet};

use super::text::{gained, outcome, row, tightest};
use crate::out::number;

/// Points of a drawn curve.
const POINTS: u32 = 800;

/// The page as HTML.
pub(super) fn html(found: &Excitation, model: &Model) -> String {
    let mut figures = vec![search(found)];
    let states: Vec<(f64, DriveState)> =
        (0..=POINTS).map(|i| found.motion.period_s * f64::from(i) / f64::from(POINTS)).map(|t| (t, found.motion.at(t))).collect();
    for (k, &j) in model.actuators.iter().enumerate() {
        let joint = &model.joints[j];
        let unit = joint.kind.unit_position();
        for (what, name, unit, of) in [
            (Bounded::Position, "Position", unit.to_string(), (|s: &DriveState| &s.q) as fn(&DriveState) -> &Vec<f64>),
            (Bounded::Velocity, "Velocity", format!("{unit}/s"), |s: &DriveState| &s.v),
        ] {
            let points = states.iter().map(|(t, s)| (*t, of(s)[k])).collect();
            figures.push(Figure {
                title: format!("{name} of {}", joint.name),
                x_label: "time, s".to_string(),
                y_label: unit,
                scales: [Scale::Linear; 2],
                curves: [limits(found, what, &joint.name), vec![Curve { label: "motion".to_string(), ink: Ink::First, points }]].concat(),
                shaded: (String::new(), Vec::new()),
            });
        }
    }
    sheet(&Sheet {
        eyebrow: "Excitation".to_string(),
        title: found.robot.clone(),
        outcome: (outcome(found), Tone::Good),
        answer: format!(
            "{}. {} of {} columns that act independently stay below the condition number {} together.",
            gained(found),
            found.well_conditioned,
            found.structural,
            number(pkm_ident::excitation::CONDITION_LIMIT)
        ),
        figures,
        tables: tables(found),
        footer:
            "One period; velocity and acceleration are zero where it begins. Verified on a grid ten times as dense as that of the search."
                .to_string(),
    })
}

/// The two limits of a drive as lines; none where it has none.
fn limits(found: &Excitation, what: Bounded, joint: &str) -> Vec<Curve> {
    let Some(m) = found.margins.iter().find(|m| m.what == what && m.place == joint) else { return Vec::new() };
    let line = |y: f64| Curve { label: "limit".to_string(), ink: Ink::Plain, points: vec![(0.0, y), (found.motion.period_s, y)] };
    vec![line(m.lower), line(m.upper)]
}

/// The criterion over the steps of all restarts.
fn search(found: &Excitation) -> Figure {
    let is_condition = found.settings.criterion == Criterion::Condition;
    let shown = |x: f64| if is_condition { math::exp(x) } else { x };
    let best = found.traces.iter().position(|t| t.quality == found.quality);
    let curve = |(i, t): (usize, &pkm_ident::excitation::Trace)| Curve {
        label: (if Some(i) == best { "the best restart" } else { "other restarts" }).to_string(),
        ink: if Some(i) == best { Ink::First } else { Ink::Second },
        points: core::iter::once(&t.start).chain(&t.steps).enumerate().map(|(step, x)| (step as f64, shown(*x))).collect(),
    };
    Figure {
        title: "The search".to_string(),
        x_label: "step".to_string(),
        y_label: if is_condition { "condition number".to_string() } else { format!("criterion {}", found.settings.criterion.name()) },
        scales: [Scale::Linear, if is_condition { Scale::Log } else { Scale::Linear }],
        curves: found.traces.iter().enumerate().map(curve).collect(),
        shaded: (String::new(), Vec::new()),
    }
}

fn tables(found: &Excitation) -> Vec<Table> {
    let head = |cells: &[&str]| cells.iter().map(|c| (*c).to_string()).collect::<Vec<_>>();
    let numbers = |name: &str, of: &dyn Fn(&pkm_ident::excitation::Quality) -> f64| {
        let random = found.random.best.as_ref().map_or_else(|| "not known".to_string(), |q| number(of(q)));
        vec![name.to_string(), number(of(&found.quality)), random]
    };
    let mut rows = vec![
        numbers("condition number, columns at length one", &|q| q.condition),
        numbers("condition number, SI units", &|q| q.condition_raw),
        numbers("log-determinant", &|q| q.log_determinant),
    ];
    if found.quality.separation.is_some() {
        rows.push(numbers("angle between the effects, degrees", &|q| q.separation.map_or(f64::NAN, |s| s.angle_deg())));
        rows.push(numbers("effort of the first effect alone, rms", &|q| q.separation.map_or(f64::NAN, |s| s.alone[0])));
        rows.push(numbers("effort of the second effect alone, rms", &|q| q.separation.map_or(f64::NAN, |s| s.alone[1])));
    }
    let columns = found.columns.iter().map(|c| vec![c.clone()]).collect();
    vec![
        Table { title: "How good it is".to_string(), head: head(&["what", "this motion", "best random one"]), rows },
        Table {
            title: "Nearest to their limits".to_string(),
            head: head(&["what", "where", "value", "from", "to", "room", "at"]),
            rows: tightest(found).into_iter().map(row).collect(),
        },
        Table { title: "Columns that count".to_string(), head: head(&["parameter"]), rows: columns },
    ]
}
