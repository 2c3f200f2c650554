//! Section 2.3: input gains from records of a drive that controls its speed, and what a model without the right physics leaves.

use nalgebra::{DMatrix, DVector, Vector3};
use pkm_dyn::math;
use pkm_ident::minimise::Bounds;
use pkm_ident::output_error::{Strategy, Trial, Unknown, output_error};

use crate::arceo2021::equations::{B0, B1, MASSES, SMOOTH};
use crate::arceo2021::geometry::{FITTED, Geometry};
use crate::arceo2021::tracking::beat;
use crate::error::PaperError;
use crate::row::{Gate, Row};
use crate::series::rms;

/// Period of the records `[s]`, and samples of one.
const DT: f64 = 0.02;
const SAMPLES: usize = 101;

/// Amplitude `[V]` and frequency `[rad/s]` of the recorded sine: small and short, for a force without friction makes the piston drift where
/// the inertia changes along the stroke, and a speed does not.
const VOLTS: f64 = 0.1;
const W: f64 = core::f64::consts::PI;

/// Foot angles at which it is recorded `[deg]`, with the inertia that the drive feels there `[kg]`.
const PLACES: [(f64, f64); 4] = [(80.0, 12.1), (92.7, 9.7), (110.0, 8.416), (140.0, 7.95)];

/// Rows of section 2.3.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = Vec::new();
    for (degrees, felt) in PLACES {
        let [b0, b1] = input_gains(degrees)?;
        let paper = ((degrees - 110.0).abs() < 0.5).then_some(B0 / B1);
        // One and two per cent: the inertia changes along the stroke.
        let width = if paper.is_some() { 0.01 } else { 0.02 } * felt;
        let what = format!("identified b0 over b1 at {degrees} deg, kg");
        rows.push(Row::held_against("section 2.3", what, b0 / b1, paper, (Gate::Within(width), felt)).because(
            "from records of a drive d' = b1·u by output error: whoever fits b0·u' to them finds b1 times the inertia that the drive feels",
        ));
    }
    rows.extend(concealed());
    Ok(rows)
}

/// b0 and b1 from a record of the foot's angle about `degrees`.
fn input_gains(degrees: f64) -> Result<[f64; 2], PaperError> {
    let middle = FITTED.inverse_kinematics(degrees.to_radians())[0];
    // A sine from rest moves to one side only: it starts half a stroke below.
    let start = middle - B1 * VOLTS / W;
    let angles = |d: &[f64]| d.iter().map(|d| FITTED.phi_at(*d)).collect::<Vec<f64>>();
    let with_speed = |gain: f64| -> Vec<f64> {
        angles(&(0..SAMPLES).map(|i| start + gain * VOLTS / W * (1.0 - math::cos(W * DT * i as f64))).collect::<Vec<_>>())
    };
    let trial = [Trial { name: format!("{degrees} deg"), outputs: vec![with_speed(B1)] }];
    let mut force = |x: &[f64], _: usize| Some(vec![angles(&under_force(&FITTED, start, x[0]))]);
    let mut speed = |x: &[f64], _: usize| Some(vec![with_speed(x[0])]);
    let unknown = |name: &str, unit: &'static str, start: f64, scale: f64| {
        [Unknown { name: name.to_string(), unit, start, scale, bounds: Bounds { lower: 1e-5, upper: 10.0 } }]
    };
    let none = || PaperError::Other { what: "section 2.3", reason: "no fit".to_string() };
    let b0 = output_error(&unknown("b0", "N·s/V", 0.05, 0.01), &trial, &[], &mut force, Strategy::Squares).ok_or_else(none)?;
    let b1 = output_error(&unknown("b1", "m/(s·V)", 0.005, 0.001), &trial, &[], &mut speed, Strategy::Squares).ok_or_else(none)?;
    Ok([b0.found[0].value, b1.found[0].value])
}

/// Positions of the piston under the force `gain·u'` from rest, no friction; the classical Runge-Kutta method.
fn under_force(g: &Geometry, start: f64, gain: f64) -> Vec<f64> {
    let rate = |d: f64, v: f64, t: f64| {
        let [mass, force] = g.projected(g.inverse_kinematics(g.phi_at(d)), v, &SMOOTH);
        [v, (gain * VOLTS * W * math::cos(W * t) - force) / mass]
    };
    let (mut d, mut v, mut out) = (start, 0.0, Vec::new());
    for i in 0..SAMPLES {
        out.push(d);
        let t = DT * i as f64;
        let k1 = rate(d, v, t);
        let k2 = rate(d + 0.5 * DT * k1[0], v + 0.5 * DT * k1[1], t + 0.5 * DT);
        let k3 = rate(d + 0.5 * DT * k2[0], v + 0.5 * DT * k2[1], t + 0.5 * DT);
        let k4 = rate(d + DT * k3[0], v + DT * k3[1], t + DT);
        d += DT / 6.0 * (k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0]);
        v += DT / 6.0 * (k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1]);
    }
    out
}

/// The paper's coordinates; position, velocity and acceleration of the piston.
type State = ([f64; 3], [f64; 3]);

/// Forces of the robot with Coulomb friction, or with weight, along (11), and what fits of other physics leave of them.
fn concealed() -> Vec<Row> {
    const COULOMB: f64 = 0.4;
    const GRAVITY: f64 = 9.806;
    let states: Vec<State> = (0..2000)
        .map(|i| {
            let [d, v, a] = beat(0.01 * f64::from(i));
            (FITTED.inverse_kinematics(FITTED.phi_at(d)), [d, v, a])
        })
        .collect();
    let column = |f: &dyn Fn(&State) -> f64| states.iter().map(f).collect::<Vec<f64>>();
    let rigid = column(&|(q, [_, v, a])| {
        let [mass, force] = FITTED.projected(*q, *v, &SMOOTH);
        mass * a + force
    });
    let row_1 = column(&|(q, [_, v, a])| MASSES.iter().sum::<f64>() * a + FITTED.coriolis(*q, FITTED.rates(*q, *v))[0]);
    let [square, linear, sign] = [column(&|(_, [_, v, _])| v * v), column(&|(_, [_, v, _])| *v), column(&|(_, [_, v, _])| math::sign(*v))];
    let weight = column(&|(q, _)| {
        let [z1, z2, ..] = FITTED.z(*q);
        let [m1, m2, m3] = MASSES;
        GRAVITY * Vector3::new(m1 + m2 + m3, (m2 + m3) * z1, m3 * z2).dot(&Vector3::from(FITTED.rates(*q, 1.0)))
    });
    let plus = |a: &[f64], b: &[f64], factor: f64| a.iter().zip(b).map(|(a, b)| a + factor * b).collect::<Vec<f64>>();
    let rubbed = plus(&rigid, &sign, COULOMB);
    let heavy = plus(&rubbed, &weight, 1.0);
    let whole = left(&rubbed, &rigid, &[&sign, &linear]);
    let even = left(&rubbed, &rigid, &[&square, &linear]);
    let opened = left(&rubbed, &row_1, &[&sign, &linear]);
    let weightless = left(&heavy, &rigid, &[&sign, &linear]);
    let weighed = left(&heavy, &rigid, &[&sign, &linear, &weight]);
    let all_of_it = |what: &str, ours: f64| Row::new("section 2.3", what, ours, None, Gate::AtMost(1e-9));
    let why =
        "plant with multipliers and 0.4 N of Coulomb friction along (11), then with weight; share of the force's rms that a fit leaves";
    let rows = [
        all_of_it("left by loops and odd friction", whole),
        Row::new("section 2.3", "left by the even polynomial", even, None, Gate::AtLeast(0.1)),
        Row::new("section 2.3", "left without multipliers, odd friction", opened, None, Gate::AtLeast(0.1)),
        Row::new("section 2.3", "left without weight, robot with weight", weightless, None, Gate::AtLeast(0.1)),
        all_of_it("left with weight, robot with weight", weighed),
    ];
    rows.into_iter().map(|row| row.because(why)).collect()
}

/// Share of `force` that `known` and the best multiples of `columns` leave.
fn left(force: &[f64], known: &[f64], columns: &[&Vec<f64>]) -> f64 {
    let w = DMatrix::from_fn(force.len(), columns.len(), |i, j| columns[j][i]);
    let target = DVector::from_fn(force.len(), |i, _| force[i] - known[i]);
    let qr = w.clone().qr();
    let found = qr.r().solve_upper_triangular(&(qr.q().transpose() * &target));
    let rest = found.map_or(target.clone(), |x| target - w * x);
    rms(rest.as_slice()) / rms(force)
}
