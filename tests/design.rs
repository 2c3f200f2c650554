//! Work on the desk against scipy: sampled systems, regulators, poles, Lyapunov equations.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use nalgebra::{Complex, DMatrix};
use pkm_ctrl::design::DesignError;
use pkm_ctrl::design::discretise::{Hold, discretise};
use pkm_ctrl::design::lyapunov::discrete_lyapunov;
use pkm_ctrl::design::mu::StateSpace;
use pkm_ctrl::design::place::place;
use pkm_ctrl::design::riccati::{Regulator, continuous_regulator, discrete_regulator};
use serde::Deserialize;

type Rows = Vec<Vec<f64>>;

#[derive(Deserialize)]
struct Golden {
    sampled: Vec<Sampled>,
    regulators: Vec<Linear>,
    placed: Vec<Placed>,
    lyapunov: Vec<Lyapunov>,
}

#[derive(Deserialize)]
struct Sampled {
    dt: f64,
    a: Rows,
    b: Rows,
    c: Rows,
    d: Rows,
    zoh: [Rows; 4],
    tustin: [Rows; 4],
}

#[derive(Deserialize)]
struct Answer {
    cost: Rows,
    gain: Rows,
}

#[derive(Deserialize)]
struct Linear {
    a: Rows,
    b: Rows,
    q: Rows,
    r: Rows,
    discrete: Answer,
    continuous: Answer,
}

#[derive(Deserialize)]
struct Placed {
    a: Rows,
    b: Rows,
    poles: Vec<[f64; 2]>,
    gain: Rows,
    gain_norm: f64,
}

#[derive(Deserialize)]
struct Lyapunov {
    a: Rows,
    q: Rows,
    x: Rows,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("golden/scipy/design.json")).expect("golden file")
}

fn matrix(rows: &Rows) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

#[track_caller]
fn assert_close(found: &DMatrix<f64>, want: &Rows, relative: f64) {
    let want = matrix(want);
    let error = (found - &want).norm() / (1.0 + want.norm());
    assert!(error < relative, "{error:e}\n{found}{want}");
}

#[test]
fn sampled_systems_are_those_of_cont2discrete() {
    for case in golden().sampled {
        let parts = [&case.a, &case.b, &case.c, &case.d].map(matrix);
        let system = StateSpace::try_new(parts, None).expect("a system");
        for (hold, want) in [(Hold::ZeroOrder, &case.zoh), (Hold::Tustin, &case.tustin)] {
            let found = discretise(&system, case.dt, hold).expect("sampled");
            for (found, want) in found.matrices().into_iter().zip(want) {
                assert_close(found, want, 1e-12);
            }
        }
    }
}

#[test]
fn regulators_are_those_of_the_riccati_solvers() {
    for case in golden().regulators {
        let [A, B, Q, R] = [&case.a, &case.b, &case.q, &case.r].map(matrix);
        let system = [&A, &B, &Q, &R];
        for (found, want) in [(discrete_regulator(system), &case.discrete), (continuous_regulator(system), &case.continuous)] {
            let Regulator { gain, cost, residual } = found.expect("a regulator");
            assert!(residual < 1e-12, "{residual:e}");
            assert_close(&gain, &want.gain, 1e-9);
            assert_close(&cost, &want.cost, 1e-9);
        }
    }
}

#[test]
fn poles_come_where_they_are_wanted_with_gains_hardly_larger_than_those_of_place_poles() {
    for case in golden().placed {
        let (A, B) = (matrix(&case.a), matrix(&case.b));
        let poles: Vec<Complex<f64>> = case.poles.iter().map(|p| Complex::new(p[0], p[1])).collect();
        let found = place(&A, &B, &poles).expect("placed");
        // A pole wanted twice is seen to the square root of rounding only when its eigenvectors come close.
        assert!(found.error < 1e-8, "{:e} {:?}", found.error, found.poles);
        if B.ncols() == 1 {
            assert_close(&found.gain, &case.gain, 1e-9);
        }
        println!("{} inputs: |K| {:.4} ({:.4}), error {:.1e}", B.ncols(), found.gain.norm(), case.gain_norm, found.error);
        assert!(found.gain.norm() < 1.2 * case.gain_norm, "{} against {}", found.gain.norm(), case.gain_norm);
    }
}

#[test]
fn lyapunov_equations_are_those_of_scipy() {
    for case in golden().lyapunov {
        assert_close(&discrete_lyapunov(&matrix(&case.a), &matrix(&case.q)).expect("a solution"), &case.x, 1e-9);
    }
}

#[test]
fn what_cannot_be_designed_is_refused_in_one_line() {
    let text = |e: DesignError| e.to_string();
    let A = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 2.0]);
    let B = DMatrix::from_row_slice(2, 1, &[1.0, 0.0]);
    let pole = |re, im| Complex::new(re, im);
    let lone = place(&A, &B, &[pole(0.0, 1.0), pole(0.0, 2.0)]).expect_err("no pairs");
    assert_eq!(text(lone), "0 poles for 2 states (one each is needed, complex ones in conjugate pairs)");
    assert_eq!(text(place(&A, &B, &[pole(0.1, 0.0), pole(0.2, 0.0)]).expect_err("out of reach")), "the controllability matrix is singular");
    assert!(text(place(&A, &DMatrix::identity(2, 2), &[pole(f64::NAN, 0.0); 2]).expect_err("no number")).starts_with("0 poles"));
    let one = DMatrix::identity(1, 1);
    let wrong = text(discrete_regulator([&A, &B, &one, &one]).expect_err("wrong size"));
    assert_eq!(wrong, "Q: 1 x 1 (must be 2 x 2)");
    // Two inputs that are one: the second mode stays where it is.
    let twice = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 0.0, 0.0]);
    assert!(place(&A, &twice, &[pole(0.1, 0.0), pole(0.2, 0.0)]).is_err());
}
