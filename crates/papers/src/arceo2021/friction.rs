//! The friction polynomial of Table 2: what its even part does, and how well it can be told from motions.

use nalgebra::DMatrix;

use crate::arceo2021::equations::{B0, FRICTION, polynomial};
use crate::arceo2021::geometry::FITTED;
use crate::arceo2021::tracking::beat;
use crate::chance::Chance;
use crate::row::{Gate, Row};
use crate::series::mean;

use nalgebra::Vector3;
use pkm_dyn::math;

/// Samples along (11).
const SAMPLES: usize = 4000;

/// Length of (11) that is looked at `[s]`.
const SECONDS: f64 = 20.0;

const EVEN: &str = "v11 d'^2 has no sign of the speed: it feeds power in one direction and takes it in the other; a friction law is odd";

/// The paper's coordinates and their rates.
type State = ([f64; 3], [f64; 3]);

/// Rows of friction.
pub(super) fn rows() -> Vec<Row> {
    let states: Vec<State> = (0..=SAMPLES)
        .map(|i| {
            let [d, v, _] = beat(SECONDS * i as f64 / SAMPLES as f64);
            let q = FITTED.inverse_kinematics(FITTED.phi_at(d));
            (q, FITTED.rates(q, v))
        })
        .collect();
    let average = |f: &dyn Fn(&State) -> f64| mean(&states.iter().map(f).collect::<Vec<_>>());
    // A constant force F drives the voltage by F·t/b0.
    let drift = |f: &dyn Fn(&State) -> f64| average(f) * SECONDS / B0;
    let even = drift(&|(_, v)| FRICTION[0][0] * v[0] * v[0]);
    let centrifugal = drift(&|(q, v)| FITTED.coriolis(*q, *v)[0]);
    let projected = drift(&|(q, v)| Vector3::from(FITTED.rates(*q, 1.0)).dot(&polynomial(&FRICTION, *v)));
    let power = average(&|(_, v)| polynomial(&FRICTION, *v)[0] * v[0]);
    let row = |what: &str, ours: f64, (width, checked): (f64, f64)| {
        Row::held_against("Table 2", what, ours, None, (Gate::Within(width), checked)).because(EVEN)
    };
    let mut rows = vec![
        row("drift of the voltage by v11 d'^2 over 20 s of (11), V", even, (0.1, 28.0)),
        row("drift of the voltage by C1 over 20 s of (11), V", centrifugal, (0.1, 12.9)),
        row("drift of the voltage by the projected friction over 20 s of (11), V", projected, (0.1, 4.2)),
        row("mean power of F1 along (11), W (below zero: it drives)", power, (5e-5, -4.4e-3)),
    ];
    let linear = |degrees: f64| {
        let [_, r1, r2] = FITTED.rates(FITTED.inverse_kinematics(degrees.to_radians()), 1.0);
        FRICTION[0][1] + FRICTION[1][1] * r1 * r1 + FRICTION[2][1] * r2 * r2
    };
    let middle: Vec<f64> = [95.0, 105.0, 115.0, 125.0].into_iter().map(linear).collect();
    let why = "viscous friction that the drive feels: v12 = −2.82 and v22 are negative damping, and nothing is left in the middle";
    let [low, high] = [middle.iter().copied().fold(f64::MAX, f64::min), middle.iter().copied().fold(f64::MIN, f64::max)];
    rows.push(
        Row::held_against(
            "Table 2",
            "lowest projected viscous coefficient at 95, 105, 115, 125 deg, N·s/m",
            low,
            None,
            (Gate::Within(6e-3), -0.08),
        )
        .because(why),
    );
    rows.push(
        Row::held_against(
            "Table 2",
            "highest projected viscous coefficient at 95, 105, 115, 125 deg, N·s/m",
            high,
            None,
            (Gate::Within(6e-3), 0.11),
        )
        .because(why),
    );
    rows.extend(identifiability());
    rows
}

/// Singular values of the friction regressor, columns at length one: of row 1 alone, and projected.
fn identifiability() -> Vec<Row> {
    let mut chance = Chance::new(0);
    let waves: Vec<[f64; 3]> = [(0.02, 0.1), (0.012, 0.27), (0.006, 0.43), (0.004, 0.71)]
        .into_iter()
        .map(|(a, f)| [a, core::f64::consts::TAU * f, chance.between(0.0, core::f64::consts::TAU)])
        .collect();
    let samples = 1000;
    let (mut row_1, mut projected) = (DMatrix::zeros(samples, 6), DMatrix::zeros(samples, 6));
    for i in 0..samples {
        let t = 0.04 * i as f64;
        let d = 0.05 + waves.iter().map(|[a, w, p]| a * math::sin(w * t + p)).sum::<f64>();
        let v = waves.iter().map(|[a, w, p]| a * w * math::cos(w * t + p)).sum::<f64>();
        let along = FITTED.rates(FITTED.inverse_kinematics(FITTED.phi_at(d)), 1.0);
        for (k, r) in along.into_iter().enumerate() {
            let rate = r * v;
            projected[(i, 2 * k)] = r * rate * rate;
            projected[(i, 2 * k + 1)] = r * rate;
        }
        (row_1[(i, 0)], row_1[(i, 1)]) = (v * v, v);
    }
    let values = |m: &DMatrix<f64>| {
        let mut m = m.clone();
        for mut column in m.column_iter_mut() {
            let length = column.norm();
            column.scale_mut(if length > 0.0 { 1.0 / length } else { 0.0 });
        }
        m.singular_values()
    };
    let (of_row, of_all) = (values(&row_1), values(&projected));
    let rank = of_row.iter().filter(|s| **s > 1e-9 * of_row.max()).count();
    let why = "in row 1 alone, and in what (8) inverts, v21 to v32 multiply nothing: no record can tell them";
    vec![
        Row::held_against("Table 2", "friction parameters that row 1 shows, of six", rank as f64, Some(6.0), (Gate::Within(0.0), 2.0))
            .not_reproducible(why),
        Row::new("Table 2", "condition of the projected friction regressor", of_all.max() / of_all.min(), None, Gate::AtLeast(100.0))
            .because("an independent program has 217 on another motion: six parameters of one force are hardly told apart"),
    ]
}
