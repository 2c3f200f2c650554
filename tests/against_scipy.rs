//! Numbers of scipy (`golden/identification/make_scipy.py` writes them): the zero-phase filter, differentiation, minimisers, tails.

use pkm_dyn::math;
use pkm_ident::distributions::{chi_square_tail, f_tail, ln_gamma, normal_two_sided};
use pkm_ident::filter::LowPass;
use pkm_ident::minimise::levenberg_marquardt::{self, levenberg_marquardt};
use pkm_ident::minimise::nelder_mead::{self, nelder_mead};
use pkm_ident::minimise::{Bounds, Ending};
use pkm_ident::preprocess::b_spline::Spline;
use pkm_ident::preprocess::savitzky_golay::SavitzkyGolay;
use pkm_tests::relative_error;
use serde::Deserialize;

#[derive(Deserialize)]
struct Squares {
    #[serde(default)]
    y: Vec<f64>,
    x: Vec<f64>,
    square: f64,
}

#[derive(Deserialize)]
struct Lowest {
    x: Vec<f64>,
}

#[derive(Deserialize)]
struct Golden {
    dt: f64,
    x: Vec<f64>,
    cutoff_hz: f64,
    filtered: Vec<f64>,
    savgol_half: usize,
    savgol_order: usize,
    savgol: Vec<Vec<f64>>,
    spline_spacing: f64,
    spline: Vec<Vec<f64>>,
    bard: Squares,
    bard_bounded: Squares,
    osborne: Squares,
    wood: Lowest,
    ln_gamma: Vec<[f64; 2]>,
    chi_square: Vec<[f64; 3]>,
    f: Vec<[f64; 4]>,
    normal: Vec<[f64; 2]>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("golden/identification/scipy.json")).expect("the golden file")
}

#[test]
fn the_zero_phase_filter_is_sosfiltfilt() {
    let g = golden();
    let error = relative_error(&LowPass::new(g.cutoff_hz, g.dt).apply(&g.x), &g.filtered, 0.0);
    assert!(error < 1e-12, "{error:e}");
}

#[test]
fn sliding_polynomials_are_savgol_filter() {
    let g = golden();
    let f = SavitzkyGolay::new(g.savgol_half, g.savgol_order);
    for (d, want) in g.savgol.iter().enumerate() {
        let error = relative_error(&f.apply(&g.x, d, g.dt), want, 0.0);
        assert!(error < 1e-10, "derivative {d}: {error:e}");
    }
}

#[test]
fn the_spline_is_make_lsq_spline() {
    let g = golden();
    let spline = Spline::fit(&g.x, g.dt, g.spline_spacing).expect("enough samples");
    for (d, want) in g.spline.iter().enumerate() {
        let error = relative_error(&spline.sample(g.x.len(), g.dt, d), want, 0.0);
        assert!(error < 1e-8, "derivative {d}: {error:e}");
    }
}

fn bard(y: &[f64], x: &[f64]) -> Option<Vec<f64>> {
    let row = |i: usize| {
        let u = (i + 1) as f64;
        let v = 16.0 - u;
        y[i] - (x[0] + u / (v * x[1] + u.min(v) * x[2]))
    };
    Some((0..15).map(row).collect())
}

fn osborne(y: &[f64], x: &[f64]) -> Option<Vec<f64>> {
    let row = |i: usize| {
        let t = 10.0 * i as f64;
        y[i] - (x[0] + x[1] * math::exp(-t * x[3]) + x[2] * math::exp(-t * x[4]))
    };
    Some((0..33).map(row).collect())
}

#[test]
fn least_squares_end_where_minpack_ends() {
    let g = golden();
    let options = levenberg_marquardt::Options::default();
    let out = levenberg_marquardt(&mut |x| bard(&g.bard.y, x), &[1.0; 3], &[1.0; 3], &[], &options);
    assert!(out.ending == Ending::Settled && relative_error(&out.x, &g.bard.x, 0.0) < 1e-6, "{:?} {:?}", out.x, g.bard.x);
    assert!((2.0 * out.cost / g.bard.square - 1.0).abs() < 1e-9);
    let start = [0.5, 1.5, -1.0, 0.01, 0.02];
    let out = levenberg_marquardt(&mut |x| osborne(&g.osborne.y, x), &start, &start.map(f64::abs), &[], &options);
    assert!(relative_error(&out.x, &g.osborne.x, 0.0) < 1e-4, "{:?} {:?}", out.x, g.osborne.x);
    assert!((2.0 * out.cost / g.osborne.square - 1.0).abs() < 1e-6, "{} {}", 2.0 * out.cost, g.osborne.square);
    // scipy's bounded solver stays a little inside of the bound, ours ends on it.
    let bounds = [Bounds { lower: -1.0, upper: 0.05 }, Bounds::NONE, Bounds::NONE];
    let out = levenberg_marquardt(&mut |x| bard(&g.bard.y, x), &[0.0, 1.0, 1.0], &[1.0; 3], &bounds, &options);
    assert!(2.0 * out.cost < g.bard_bounded.square * (1.0 + 1e-6) && out.x[0] <= 0.05, "{:?} {:?}", out.x, g.bard_bounded.x);
}

#[test]
fn the_simplex_ends_where_scipys_ends() {
    let g = golden();
    let mut wood = |p: &[f64]| {
        let square = |x: f64| x * x;
        let [a, b, c, d] = [p[0], p[1], p[2], p[3]];
        100.0 * square(b - a * a)
            + square(1.0 - a)
            + 90.0 * square(d - c * c)
            + square(1.0 - c)
            + 10.1 * (square(b - 1.0) + square(d - 1.0))
            + 19.8 * (b - 1.0) * (d - 1.0)
    };
    let options = nelder_mead::Options { evaluations: 20_000, ..nelder_mead::Options::default() };
    let out = nelder_mead(&mut wood, &[-3.0, -1.0, -3.0, -1.0], &[0.5; 4], &[], &options);
    assert!(out.ending == Ending::Settled && relative_error(&out.x, &g.wood.x, 0.0) < 1e-4, "{out:?} {:?}", g.wood.x);
}

#[test]
fn tails_are_those_of_scipy() {
    let g = golden();
    let near = |got: f64, want: f64| assert!((got - want).abs() <= 1e-11 * want.abs(), "{got} {want}");
    g.ln_gamma.iter().for_each(|[x, want]| near(ln_gamma(*x), *want));
    g.chi_square.iter().for_each(|[x, m, want]| near(chi_square_tail(*x, *m), *want));
    g.f.iter().for_each(|[x, m, n, want]| near(f_tail(*x, *m, *n), *want));
    g.normal.iter().for_each(|[z, want]| near(normal_two_sided(*z), *want));
}
