//! Pole placement of the error system (9) and of its sampled form.

use nalgebra::{DMatrix, SMatrix};
use pkm_ctrl::ErrorGains;
use pkm_ctrl::design::margin::eigenvalues;
use pkm_dyn::math;

use crate::row::{Gate, Row};

/// Poles of the error system `[1/s]`.
pub(super) const POLES: [f64; 3] = [-5.0, -6.0, -7.0];

/// Sampling period `[s]`.
pub(super) const TS: f64 = 0.01;

/// Gains as printed, continuous and sampled: kp and ki have each other's place.
pub(super) const PRINTED: ErrorGains = ErrorGains { ki: -107.0, kp: -210.0, kv: -18.0 };
const PRINTED_SAMPLED: ErrorGains = ErrorGains { ki: -98.8243, kp: -192.0135, kv: -16.9623 };

const SWAPPED: &str = "the labels kp and ki are exchanged in print; s^3 − kv s^2 − kp s − ki is what the gains have to match";

/// Closed loop of the state (integral, error, rate).
fn closed(a: [[f64; 3]; 3], b: [f64; 3], gains: &ErrorGains) -> Vec<nalgebra::Complex<f64>> {
    let k = [gains.ki, gains.kp, gains.kv];
    let mut found = eigenvalues(&DMatrix::from_fn(3, 3, |i, j| a[i][j] + b[i] * k[j]));
    found.sort_by(|x, y| y.re.total_cmp(&x.re));
    found
}

/// Rows of the gains.
pub(super) fn rows() -> Vec<Row> {
    let continuous = ErrorGains::placed(POLES);
    let sampled = ErrorGains::placed_sampled(POLES, TS);
    let row = |place: &'static str, what: &str, ours: f64, paper: f64, (width, checked): (f64, f64)| {
        let row = Row::held_against(place, what, ours, Some(paper), (Gate::Within(width), checked));
        if (paper - checked).abs() > width { row.because(SWAPPED) } else { row }
    };
    let mut rows = vec![
        row("section 3", "ki for poles at -5, -6, -7", continuous.ki, PRINTED.ki, (1e-9, -210.0)),
        row("section 3", "kp", continuous.kp, PRINTED.kp, (1e-9, -107.0)),
        row("section 3", "kv", continuous.kv, PRINTED.kv, (1e-9, -18.0)),
        row("section 5.2", "ki, sampled at 10 ms", sampled.ki, PRINTED_SAMPLED.ki, (1e-4, -192.013_532)),
        row("section 5.2", "kp, sampled", sampled.kp, PRINTED_SAMPLED.kp, (1e-4, -98.824_334)),
        row("section 5.2", "kv, sampled", sampled.kv, PRINTED_SAMPLED.kv, (1e-4, -16.962_300)),
    ];
    let (a, b) = ([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]], [0.0, 0.0, 1.0]);
    let found = closed(a, b, &PRINTED);
    let wrong = |place: &'static str, what: &str, ours: f64, paper: f64, checked: (f64, f64)| {
        Row::held_against(place, what, ours, Some(paper), (Gate::Within(checked.0), checked.1)).not_reproducible(SWAPPED)
    };
    rows.push(wrong("section 3", "slowest pole of the gains as printed, 1/s", found[0].re, -5.0, (5e-4, -0.533)));
    rows.push(wrong("section 3", "other poles of the gains as printed, real part, 1/s", found[1].re, -6.0, (5e-3, -8.73)));
    rows.push(wrong("section 3", "other poles of the gains as printed, imaginary part, 1/s", found[1].im.abs(), 0.0, (5e-3, 11.15)));
    let (a, b) = tustin();
    let found = closed(a, b, &PRINTED_SAMPLED);
    rows.push(wrong("section 5.2", "slowest pole of the sampled gains as printed", found[0].re, 0.9512, (1e-4, 0.9946)));
    rows.push(wrong("section 5.2", "other poles of the sampled gains as printed, imaginary part", found[1].im.abs(), 0.0, (1e-4, 0.1040)));
    let placed = closed(a, b, &sampled);
    for (pole, (found, paper)) in POLES.into_iter().zip(placed.iter().zip([0.9512, 0.9418, 0.9324])) {
        let checked = math::exp(pole * TS);
        let what = format!("pole of the placed sampled loop at exp({pole} Ts)");
        rows.push(Row::held_against("section 5.2", what, found.re, Some(paper), (Gate::Within(1e-6), checked)));
    }
    rows
}

/// The error system by Tustin's rule: `(I − A·T/2)⁻¹·(I + A·T/2)` and `(I − A·T/2)⁻¹·B·T`.
fn tustin() -> ([[f64; 3]; 3], [f64; 3]) {
    let a = SMatrix::<f64, 3, 3>::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) * (TS / 2.0);
    let one = SMatrix::<f64, 3, 3>::identity();
    // A is nilpotent, so that the inverse is a polynomial.
    let inverse = one + a + a * a;
    let (step, input) = (inverse * (one + a), inverse.column(2) * TS);
    (core::array::from_fn(|i| core::array::from_fn(|j| step[(i, j)])), core::array::from_fn(|i| input[i]))
}
