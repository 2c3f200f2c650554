//! Problems of the literature whose structured singular value is known; every number was published or can be derived on paper.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

#[path = "mu/systems.rs"]
mod systems;

use nalgebra::{Complex, DMatrix};
use pkm_ctrl::design::mu::{
    Block, CMatrix, Guarantee, Performance, Response, Settings, StateSpace, Structure, Sweep, Value, lower_bound, sweep, upper_bound,
    worst_case_gain,
};
use pkm_dyn::math::{cos, sin};
use systems::{Draw, Sys, matrix};

const R: Block = Block::Real { repeats: 1 };
const C: Block = Block::Complex { repeats: 1 };

fn full(n: usize) -> Block {
    Block::Full { rows: n, cols: n }
}

fn structure(blocks: &[Block]) -> Structure {
    Structure::try_new(blocks.to_vec()).expect("blocks")
}

/// Both bounds; the upper one is checked again, the lower one shown by its perturbation.
fn bounds(M: &CMatrix, blocks: &[Block]) -> [f64; 2] {
    let structure = structure(blocks);
    let upper = upper_bound(M, &structure).expect("a matrix that fits");
    assert!(upper.certificate.holds(M, &structure), "a proof of {}", upper.certificate.beta);
    assert!(upper.certificate.residual(M, &structure) <= 0.0);
    let lower = lower_bound(M, &structure, &upper).expect("a matrix that fits");
    if let Some(p) = &lower.perturbation {
        assert!(p.singularity < 1e-9 && (p.size * lower.beta - 1.0).abs() < 1e-12, "{p:?}");
        let loop_ = CMatrix::identity(M.nrows(), M.nrows()) - M * p.delta(&structure);
        assert!(loop_.singular_values().min() < 1e-8 * (1.0 + M.norm() * p.size));
    }
    assert!(lower.beta <= upper.certificate.beta * (1.0 + 1e-12), "bounds cross: {lower:?} {}", upper.certificate.beta);
    [lower.beta, upper.certificate.beta]
}

fn both_near(bounds: [f64; 2], value: f64, tolerance: f64) {
    for b in bounds {
        assert!((b - value).abs() <= tolerance * value, "{bounds:?}, known {value}");
    }
}

fn swept(system: &StateSpace, blocks: &[Block], range: [f64; 2], slack: f64) -> Sweep {
    let settings = Settings { slack, ..Settings::default() };
    let out = sweep(system, &structure(blocks), range, &settings).expect("a system that can be analysed");
    assert_eq!(out.guarantee, Guarantee::Interval(range));
    assert!(out.worst.beta <= out.upper);
    out
}

// ---- matrices

#[test]
fn skogestad_postlethwaite_example_8_5() {
    let M = matrix(2, &[(2.0, 0.0), (2.0, 0.0), (-1.0, 0.0), (-1.0, 0.0)]);
    both_near(bounds(&M, &[full(2)]), 10.0_f64.sqrt(), 1e-7);
    both_near(bounds(&M, &[C, C]), 3.0, 1e-7);
    // The worst diagonal perturbation is real: (1, -1)/3.
    both_near(bounds(&M, &[R, R]), 3.0, 1e-7);
}

#[test]
fn the_example_of_slicot_ab13md() {
    let rows = [
        [(-1.0, 6.0), (2.0, -3.0), (3.0, 8.0), (3.0, 8.0), (-5.0, -9.0), (-6.0, 2.0)],
        [(4.0, 2.0), (-2.0, 5.0), (-6.0, -7.0), (-4.0, 11.0), (8.0, -7.0), (12.0, -1.0)],
        [(5.0, -4.0), (-4.0, -8.0), (1.0, -3.0), (-6.0, 14.0), (2.0, -5.0), (4.0, 16.0)],
    ];
    let M = CMatrix::from_fn(6, 6, |i, j| Complex::new(rows[i % 3][j].0, rows[i % 3][j].1));
    let [lower, upper] = bounds(&M, &[R, R, full(2), C, C]);
    assert!((upper - 41.747_534_08).abs() < 1e-5, "{upper}");
    assert!(lower > 0.999 * upper, "{lower} {upper}");
}

#[test]
fn morton_doyle_has_a_gap_that_neither_bound_crosses() {
    let (g, b) = (3.0 + 3.0_f64.sqrt(), 3.0_f64.sqrt() - 1.0);
    let real = |x: f64| Complex::new(x, 0.0);
    let j = Complex::new(0.0, 1.0);
    let (a, p, d) = (real((2.0 / g).sqrt()), real(1.0 / g.sqrt()), real(-(b / g).sqrt()));
    let f = Complex::new(1.0, 1.0) * (1.0 / (g * b)).sqrt();
    let zero = real(0.0);
    let U = CMatrix::from_row_slice(4, 2, &[a, zero, p, p, p, j * p, d, f]);
    // exp(-j pi/2) = -j, exp(j pi) = -1.
    let V = CMatrix::from_row_slice(4, 2, &[zero, a, p, -p, p, -j * p, -j * f, -d]);
    let [lower, upper] = bounds(&(U * V.adjoint()), &[C; 4]);
    assert!((upper - 1.0).abs() < 1e-6, "{upper}");
    assert!((lower - 0.872_359_239_402).abs() < 1e-8, "{lower}");
}

#[test]
fn rank_one_is_exact() {
    let mut draw = Draw(4);
    for _ in 0..20 {
        let (u, v) = (draw.complex(5, 1), draw.complex(5, 1));
        let M = &u * v.adjoint();
        let abs = |x: Complex<f64>| x.norm_sqr().sqrt();
        let scalars: f64 = (0..5).map(|i| abs(u[i]) * abs(v[i])).sum();
        both_near(bounds(&M, &[C; 5]), scalars, 1e-6);
        let blocks = u.rows(0, 2).norm() * v.rows(0, 2).norm() + u.rows(2, 3).norm() * v.rows(2, 3).norm();
        both_near(bounds(&M, &[full(2), full(3)]), blocks, 1e-6);
    }
}

/// μ of rank one with real and complex scalars: the largest real number in a zonotope plus a disc, `c_i = conj(v_i)·u_i`.
fn mixed_rank_one(c: &[Complex<f64>], n_real: usize) -> f64 {
    let disc: f64 = c[n_real..].iter().map(|x| x.norm_sqr().sqrt()).sum();
    let reach = |theta: f64| {
        let along: f64 = c[..n_real].iter().map(|x| (x.re * cos(theta) + x.im * sin(theta)).abs()).sum();
        (along + disc) / cos(theta)
    };
    let best = |low: f64, high: f64| {
        (0..=20_000).map(|i| low + (high - low) * f64::from(i) / 20_000.0).min_by(|a, b| reach(*a).total_cmp(&reach(*b))).expect("angles")
    };
    let coarse = best(-1.57, 1.57);
    reach(best(coarse - 2e-4, coarse + 2e-4))
}

#[test]
fn rank_one_with_real_and_complex_scalars_is_exact() {
    let mut draw = Draw(5);
    for _ in 0..20 {
        let (u, v) = (draw.complex(5, 1), draw.complex(5, 1));
        let c: Vec<Complex<f64>> = (0..5).map(|i| v[i].conj() * u[i]).collect();
        both_near(bounds(&(&u * v.adjoint()), &[R, R, R, C, C]), mixed_rank_one(&c, 3), 2e-6);
    }
}

#[test]
fn of_a_matrix_without_negative_entries_it_is_the_spectral_radius() {
    let mut draw = Draw(6);
    for n in 2..7 {
        let M = DMatrix::from_fn(n, n, |_, _| draw.unit().abs());
        let radius = M.complex_eigenvalues().iter().map(|l| l.norm_sqr().sqrt()).fold(0.0, f64::max);
        let M = M.map(|x| Complex::new(x, 0.0));
        both_near(bounds(&M, &vec![C; n]), radius, 1e-6);
        // The worst perturbation is positive: real scalars are no better off.
        both_near(bounds(&M, &vec![R; n]), radius, 1e-6);
    }
}

// ---- frequency responses

/// Skogestad and Postlethwaite's distillation column with the inverse-based controller; blocks 1, 1 (inputs) and a 2 x 2 (performance).
fn distillation() -> StateSpace {
    let G = DMatrix::from_row_slice(2, 2, &[87.8, -86.4, 108.2, -109.6]);
    let inverse = G.clone().try_inverse().expect("G is regular");
    // w_I = (s + 0.2)/(0.5 s + 1), w_P = (s/2 + 0.05)/s, S = s/(s + 0.7), K·G = 0.7/s.
    let w_t = Sys::tf(&[-0.7, -0.14], &[0.5, 1.35, 0.7]);
    let w_ks = Sys::tf(&[-0.7 * 75.0, -0.7 * (75.0 * 0.2 + 1.0), -0.14], &[0.5, 1.35, 0.7]);
    let w_sg = Sys::tf(&[0.5, 0.05], &[75.0, 1.0 + 0.7 * 75.0, 0.7]);
    let w_s = Sys::tf(&[0.5, 0.05], &[1.0, 0.7]);
    let blocks = w_t.times(2).beside(&w_ks.times(2)).beside(&w_sg.times(2)).beside(&w_s.times(2));
    let mut right = DMatrix::zeros(8, 4);
    right.view_mut((0, 0), (2, 2)).fill_with_identity();
    right.view_mut((2, 2), (2, 2)).copy_from(&inverse);
    right.view_mut((4, 0), (2, 2)).copy_from(&G);
    right.view_mut((6, 2), (2, 2)).fill_with_identity();
    let mut left = DMatrix::zeros(4, 8);
    for (row, col) in [(0, 0), (0, 2), (2, 4), (2, 6)] {
        left.view_mut((row, col), (2, 2)).fill_with_identity();
    }
    Sys::gain(left).after(&blocks).after(&Sys::gain(right)).space()
}

#[test]
fn the_distillation_column_has_nominal_performance_and_robust_stability_but_not_robust_performance() {
    let system = distillation();
    let part = |rows: core::ops::Range<usize>| {
        let [a, b, c, d] = system.matrices().map(Clone::clone);
        let (n, at) = (rows.len(), rows.start);
        let b = b.columns(at, n).into_owned();
        let c = c.rows(at, n).into_owned();
        StateSpace::try_new([a, b, c, d.view((at, at), (n, n)).into_owned()], None).expect("a part")
    };
    let all = [0.0, f64::INFINITY];
    let nominal = swept(&part(2..4), &[full(2)], all, 1e-5);
    assert!((nominal.upper - 0.5).abs() < 1e-4 && nominal.worst.beta > 0.4999, "{nominal:?}");
    let stability = swept(&part(0..2), &[C, C], all, 1e-5);
    assert!((stability.upper - 0.5262).abs() < 1e-4 && stability.worst.beta > 0.5261, "{}", stability.upper);
    let performance = swept(&system, &[C, C, full(2)], all, 1e-4);
    // The published 5.7816 is that of a grid point, w = 1.48; the peak is a little higher beside it.
    both_near(bounds(&system.at(1.48).expect("no pole"), &[C, C, full(2)]), 5.7816, 1e-5);
    assert!(performance.upper > 5.7818 && performance.upper < 5.783, "{}", performance.upper);
    assert!(performance.worst.beta > 5.7816 && (performance.worst.w - 1.4635).abs() < 1e-3, "{:?}", performance.worst);
}

#[test]
fn l3_of_robust_and_optimal_control_jl_beats_the_default_upper_bound_of_matlab() {
    let a = [
        [1.0, 0.0, 9.84, 0.0, 0.0],
        [0.0, 1.0, 0.01, 2.146_34e-6, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, -1.739_839_598_87],
        [0.0, 0.0, 0.0, 0.0, 0.565_976_848_05],
    ];
    let b = [
        [0.0, 4.901_416e-5, 1.988_387_8e-4],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 4.041_439e-5],
        [0.0, -0.020_046_493_71, 0.0],
        [0.0, -0.004_901_416_31, 0.0],
    ];
    let c = [
        [0.0, -0.835_164_884_04, 0.0, 0.0, 0.0],
        [186.747_254_116_61, 0.0, 0.0, 0.0, 0.0],
        [-7.442_990_574_98, 0.0, 7_035.084_108_141_26, 0.0, 0.0],
    ];
    let d = [[0.0, 0.0, 0.0], [34_875.364_442_839_88, 0.0, 0.0], [48_304.019_401_225_44, 0.0, 0.0]];
    let a = DMatrix::from_fn(5, 5, |i, j| a[i][j]);
    let b = DMatrix::from_fn(5, 3, |i, j| b[i][j]);
    let c = DMatrix::from_fn(3, 5, |i, j| c[i][j]);
    let d = DMatrix::from_fn(3, 3, |i, j| d[i][j]);
    let system = StateSpace::try_new([a, b, c, d], Some(0.01)).expect("dimensions");
    let known = [
        (0.01, 296_101.756_494, 296_106.140),
        (0.1, 2_988.092_129_73, 2_988.461_49),
        (1.0, 45.268_436_832_2, 45.311_1),
        (10.0, 3.371_218_684_69, 3.381_16),
        (100.0, 0.348_828_620_760, 0.348_983),
    ];
    for (w, mu, matlab) in known {
        let b = bounds(&system.at(w).expect("no pole"), &[C; 3]);
        both_near(b, mu, 1e-6);
        assert!(b[1] < matlab);
    }
    // Between those frequencies, too.
    let range = [1.0, 100.0];
    let all = swept(&system, &[C; 3], range, 1e-4);
    assert!(all.upper >= 45.268_436 && all.worst.beta > 0.9998 * all.upper);
}

/// de Gaston and Safonov: s(s+4+.2e2)(s+6+.3e3)(s+10) + 800(1+.1e1)(s+2), three real parameters.
fn de_gaston_safonov() -> StateSpace {
    let a = DMatrix::from_row_slice(4, 4, &[0.0, 0.0, -800.0, 6400.0, 1.0, -4.0, 0.0, 0.0, 0.0, 1.0, -6.0, 0.0, 0.0, 0.0, 1.0, -10.0]);
    let b = DMatrix::from_row_slice(4, 3, &[80.0, 0.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0]);
    let c = DMatrix::from_row_slice(3, 4, &[0.0, 0.0, -1.0, 8.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    StateSpace::try_new([a, b, c, DMatrix::zeros(3, 3)], None).expect("dimensions")
}

#[test]
fn de_gaston_safonov_is_not_fooled_by_a_grid() {
    let out = swept(&de_gaston_safonov(), &[R; 3], [0.0, f64::INFINITY], 1e-6);
    // A grid of 0.01 rad/s says 3.4241: more than there is. The guaranteed margin must not.
    assert!(1.0 / out.upper <= 3.417_395_54 && 1.0 / out.upper > 3.417_38, "{}", 1.0 / out.upper);
    assert!((1.0 / out.worst.beta - 3.417_395_53).abs() < 1e-7, "{}", 1.0 / out.worst.beta);
    assert!((out.worst.w - 8.2282).abs() < 1e-4);
    let perturbation = out.worst.perturbation.as_ref().expect("a perturbation");
    let is_positive: Vec<bool> = perturbation.blocks.iter().map(|v| matches!(v, Value::Real(x) if *x > 0.0)).collect();
    assert_eq!(is_positive, [true, false, false]);
}

/// Two masses and a spring, each 1 with 20 %, under C = 100((s+1)/(0.001s+1))³ from the second mass to a force on the first.
fn two_masses() -> StateSpace {
    let lead = Sys::tf(&[1.0, 1.0], &[0.001, 1.0]);
    let controller = Sys::gain(DMatrix::from_element(1, 1, -100.0)).after(&lead).after(&lead).after(&lead);
    // States x1, v1, x2, v2; inputs w1, w2, w3, u; outputs z1 = a1, z2 = a2, z3 = x1 - x2, y = x2.
    // a1 = u - (x1 - x2) - 0.2 w3 - 0.2 w1, a2 = (x1 - x2) + 0.2 w3 - 0.2 w2.
    let n = 4 + controller.a.nrows();
    let (k, y) = (controller.a.nrows(), 2);
    let mut a = DMatrix::zeros(n, n);
    a[(0, 1)] = 1.0;
    a[(2, 3)] = 1.0;
    for (row, sign) in [(1, -1.0), (3, 1.0)] {
        a[(row, 0)] = sign;
        a[(row, 2)] = -sign;
    }
    a.view_mut((4, 4), (k, k)).copy_from(&controller.a);
    a.view_mut((4, y), (k, 1)).copy_from(&controller.b);
    a.view_mut((1, 4), (1, k)).copy_from(&controller.c);
    a[(1, y)] += controller.d[(0, 0)];
    let mut b = DMatrix::zeros(n, 3);
    (b[(1, 0)], b[(1, 2)], b[(3, 1)], b[(3, 2)]) = (-0.2, -0.2, -0.2, 0.2);
    let mut c = DMatrix::zeros(3, n);
    c.row_mut(0).copy_from(&a.row(1));
    c.row_mut(1).copy_from(&a.row(3));
    (c[(2, 0)], c[(2, 2)]) = (1.0, -1.0);
    let mut d = DMatrix::zeros(3, 3);
    d.row_mut(0).copy_from(&b.row(1));
    d.row_mut(1).copy_from(&b.row(3));
    StateSpace::try_new([a, b, c, d], None).expect("dimensions")
}

#[test]
fn the_two_mass_benchmark_reaches_its_exact_margin() {
    let out = swept(&two_masses(), &[R; 3], [0.0, f64::INFINITY], 1e-4);
    let margin = 1.0 / out.worst.beta;
    assert!((margin - 2.886_359_369_0).abs() < 1e-8, "{margin}");
    assert!((out.worst.w - 575.033_891_0).abs() < 1e-5, "{}", out.worst.w);
    let p = out.worst.perturbation.as_ref().expect("a perturbation");
    let value = |k: usize| if let Value::Real(x) = p.blocks[k] { 1.0 + 0.2 * x } else { f64::NAN };
    for (k, known) in [(0, 0.422_728), (1, 0.422_728), (2, 1.577_272)] {
        assert!((value(k) - known).abs() < 1e-6, "{k}: {}", value(k));
    }
    // MATLAB's guaranteed side is 2.8826.
    assert!(1.0 / out.upper > 2.8826, "{}", 1.0 / out.upper);
}

/// Ackermann's disc: s³+(q1+q2)s²+(q1+q2)s+6q1+6q2+2q1q2 + s²+3s+1+r², r = 0.1; q1 twice.
fn ackermann() -> StateSpace {
    // y: s³y + s²(y + v) + s(3y + v) + 1.01y + 6v + 2v12 = 0 with v = q1 y + q2 y, v12 = q1 q2 y, in observer form.
    let (q1, q2, r1, r2) = (1.4, 0.85, 1.1, 0.85);
    let v = |y: f64, w: [f64; 3]| (q1 + q2) * y + r1 * w[0] + r2 * w[2];
    let second = |y: f64, w: [f64; 3]| q2 * y + r2 * w[2];
    let v12 = |y: f64, w: [f64; 3]| q1 * second(y, w) + r1 * w[1];
    let rate = |x: [f64; 3], w: [f64; 3]| {
        let y = x[2];
        [-(1.01 * y + 6.0 * v(y, w) + 2.0 * v12(y, w)), x[0] - (3.0 * y + v(y, w)), x[1] - (y + v(y, w))]
    };
    let z = |x: [f64; 3], w: [f64; 3]| [x[2], second(x[2], w), x[2]];
    let unit = |k: usize| core::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
    let zero = [0.0; 3];
    let columns = |f: &dyn Fn(usize) -> [f64; 3]| DMatrix::from_fn(3, 3, |i, j| f(j)[i]);
    let a = columns(&|k| rate(unit(k), zero));
    let b = columns(&|k| rate(zero, unit(k)));
    let c = columns(&|k| z(unit(k), zero));
    let d = columns(&|k| z(zero, unit(k)));
    StateSpace::try_new([a, b, c, d], None).expect("dimensions")
}

#[test]
fn ackermanns_isolated_disc_is_found() {
    let out = swept(&ackermann(), &[Block::Real { repeats: 2 }, R], [0.0, f64::INFINITY], 1e-5);
    let margin = 1.0 / out.worst.beta;
    assert!((margin - 3.0 / 11.0).abs() < 1e-7, "{margin}");
    assert!(1.0 / out.upper > 0.2722, "{}", 1.0 / out.upper);
    let p = out.worst.perturbation.as_ref().expect("a perturbation");
    let [Value::Real(d1), Value::Real(d2)] = p.blocks[..] else { panic!("two real numbers: {p:?}") };
    assert!((1.4 + 1.1 * d1 - 1.1).abs() < 1e-5 && (0.85 + 0.85 * d2 - 1.0).abs() < 1e-3, "{d1} {d2}");
}

#[test]
fn the_disk_margin_of_matlabs_uscale_page() {
    // F(δ) = (1 + aδ)/(1 − bδ) spans gains 0.472 … 1.5; L = 3.5/(s³+2s²+3s); M = (b − aL)/(1 + L).
    let b = (1.972 - 2.0) / 1.028;
    let a = 0.5 - 1.5 * b;
    let system = Sys::tf(&[b, 2.0 * b, 3.0 * b, -3.5 * a], &[1.0, 2.0, 3.0, 3.5]).space();
    let out = swept(&system, &[C], [0.0, f64::INFINITY], 1e-6);
    let [low, high] = [1.0 / out.upper, 1.0 / out.worst.beta];
    assert!((low - 0.832_05).abs() < 1e-5 && (high - 0.832_05).abs() < 1e-5, "{low} {high}");
    assert!((out.worst.w - 1.4505).abs() < 1e-3, "{}", out.worst.w);
}

#[test]
fn the_worst_case_gain_of_a_spring_and_mass_is_that_of_its_weakest_damper() {
    // x'' + 2ζ(1 + 0.5δ)x' + x = d, error x: the largest gain is 1/(2ζ'·sqrt(1 − ζ'²)), ζ' = ζ/2 at δ = −1.
    let zeta = 0.1;
    let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, -2.0 * zeta]);
    let b = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, -zeta, 1.0]);
    let c = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0]);
    let system = StateSpace::try_new([a, b, c, DMatrix::zeros(2, 2)], None).expect("dimensions");
    let performance = Performance { inputs: 1, outputs: 1 };
    let gain = worst_case_gain(&system, &structure(&[R]), performance, [0.0, f64::INFINITY], &Settings::default()).expect("a gain");
    let weakest = zeta / 2.0;
    let known = 1.0 / (2.0 * weakest * (1.0 - weakest * weakest).sqrt());
    println!("{} .. {} at {}, known {known}", gain.lower, gain.upper, gain.w);
    assert!(gain.lower <= known * (1.0 + 1e-6) && gain.lower > 0.998 * known, "{} {known}", gain.lower);
    assert!(gain.upper >= known && gain.upper < 1.003 * known, "{} {known}", gain.upper);
    assert_eq!(gain.guarantee, Guarantee::Interval([0.0, f64::INFINITY]));
}
