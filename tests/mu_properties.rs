//! Structured singular value: what holds for every matrix, SLICOT's numbers, and that every call ends.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

#[path = "mu/systems.rs"]
mod systems;

use std::time::Instant;

use nalgebra::Complex;
use pkm_ctrl::design::mu::{Block, CMatrix, Structure, UpperStatus, Value, lower_bound, scalings_for, upper_bound};
use pkm_dyn::math::powf;
use serde::Deserialize;
use systems::Draw;

const R: Block = Block::Real { repeats: 1 };
const C: Block = Block::Complex { repeats: 1 };

fn full(n: usize) -> Block {
    Block::Full { rows: n, cols: n }
}

fn structure(blocks: &[Block]) -> Structure {
    Structure::try_new(blocks.to_vec()).expect("blocks")
}

fn upper(M: &CMatrix, structure: &Structure) -> f64 {
    let bound = upper_bound(M, structure).expect("a matrix that fits");
    assert!(bound.certificate.holds(M, structure));
    bound.certificate.beta
}

fn both(M: &CMatrix, structure: &Structure) -> [f64; 2] {
    let bound = upper_bound(M, structure).expect("a matrix that fits");
    assert!(bound.certificate.holds(M, structure));
    let lower = lower_bound(M, structure, &bound).expect("a matrix that fits");
    assert!(lower.beta <= bound.certificate.beta * (1.0 + 1e-12), "{} {}", lower.beta, bound.certificate.beta);
    [lower.beta, bound.certificate.beta]
}

fn near(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance * b.abs().max(1e-300), "{a} {b}");
}

/// A structure of every kind of block, repeated and non-square ones included.
fn any_blocks(draw: &mut Draw) -> Vec<Block> {
    (0..1 + draw.below(4))
        .map(|_| match draw.below(5) {
            0 => R,
            1 => Block::Real { repeats: 2 },
            2 => Block::Complex { repeats: 1 + draw.below(3) },
            3 => full(1 + draw.below(3)),
            _ => Block::Full { rows: 1 + draw.below(3), cols: 1 + draw.below(3) },
        })
        .collect()
}

#[test]
fn bounds_lie_between_the_real_spectral_radius_and_the_largest_singular_value() {
    let mut draw = Draw(1);
    for _ in 0..60 {
        let s = structure(&any_blocks(&mut draw));
        let M = draw.complex(s.n_z(), s.n_w());
        let [_, upper] = both(&M, &s);
        assert!(upper <= M.singular_values().max() * (1.0 + 1e-6));
        if s.blocks().iter().all(|b| b.rows() == b.cols()) {
            // Δ = I/λ is admissible for every real positive eigenvalue λ.
            let all = M.clone().complex_eigenvalues_of();
            let real = all.iter().filter(|l| l.im.abs() < 1e-12).map(|l| l.re.abs()).fold(0.0, f64::max);
            assert!(upper >= real * (1.0 - 1e-9));
        }
    }
}

/// Eigenvalues through the Schur form.
trait Eigenvalues {
    fn complex_eigenvalues_of(self) -> Vec<Complex<f64>>;
}

impl Eigenvalues for CMatrix {
    fn complex_eigenvalues_of(self) -> Vec<Complex<f64>> {
        let (_, T) = self.schur().unpack();
        T.diagonal().iter().copied().collect()
    }
}

#[test]
fn single_blocks_have_their_closed_forms() {
    let mut draw = Draw(2);
    for n in 1..5 {
        let M = draw.complex(n, n);
        let eigenvalues = M.clone().complex_eigenvalues_of();
        let radius = eigenvalues.iter().map(|l| l.norm_sqr().sqrt()).fold(0.0, f64::max);
        let [lower, upper_c] = both(&M, &structure(&[Block::Complex { repeats: n }]));
        near(lower, radius, 1e-6);
        near(upper_c, radius, 1e-6);
        let [lower, upper_f] = both(&M, &structure(&[full(n)]));
        near(lower, M.singular_values().max(), 1e-6);
        near(upper_f, M.singular_values().max(), 1e-6);
        // A real matrix with a real repeated scalar: its largest real eigenvalue, in modulus.
        let N = M.map(|x| Complex::new(x.re, 0.0));
        let real = N.clone().complex_eigenvalues_of();
        let largest = real.iter().filter(|l| l.im.abs() < 1e-9).map(|l| l.re.abs()).fold(0.0, f64::max);
        let [lower, upper_r] = both(&N, &structure(&[Block::Real { repeats: n }]));
        near(lower + 1.0, largest + 1.0, 1e-6);
        assert!(upper_r >= largest * (1.0 - 1e-9));
    }
    // Not square: the largest singular value as well.
    let M = draw.complex(2, 4);
    let [lower, upper_f] = both(&M, &structure(&[Block::Full { rows: 4, cols: 2 }]));
    near(lower, M.singular_values().max(), 1e-6);
    near(upper_f, M.singular_values().max(), 1e-6);
}

#[test]
fn it_scales_with_the_matrix() {
    let mut draw = Draw(3);
    for _ in 0..20 {
        let s = structure(&any_blocks(&mut draw));
        let M = draw.complex(s.n_z(), s.n_w());
        let [a, b] = [upper(&M, &s), upper(&(&M * Complex::new(-1000.0, 0.0)), &s)];
        assert!((b - 1000.0 * a).abs() <= 1e-5 * b + 1e-4, "{a} {b}");
    }
}

#[test]
fn it_does_not_see_scalings_and_rotations_of_the_structure() {
    let mut draw = Draw(4);
    let s = structure(&[C, C, full(2), full(3)]);
    for _ in 0..10 {
        let M = draw.complex(7, 7);
        let mut D = CMatrix::identity(7, 7);
        for (at, n) in [(0, 1), (1, 1), (2, 2), (4, 3)] {
            let d = Complex::new(powf(100.0, draw.unit()), 0.0);
            D.view_mut((at, at), (n, n)).copy_from(&(CMatrix::identity(n, n) * d));
        }
        let mut U = CMatrix::zeros(7, 7);
        for (at, n) in [(0, 1), (1, 1), (2, 2), (4, 3)] {
            let Q = draw.complex(n, n).qr().q();
            U.view_mut((at, at), (n, n)).copy_from(&Q);
        }
        let [_, plain] = both(&M, &s);
        let inverse = D.clone().try_inverse().expect("a scaling");
        near(both(&(&D * &M * inverse), &s)[1], plain, 1e-6);
        near(both(&(&U * &M), &s)[1], plain, 1e-6);
        near(both(&(&M * &U), &s)[1], plain, 1e-6);
    }
}

#[test]
fn it_grows_when_a_real_block_becomes_complex_and_a_scalar_full() {
    let mut draw = Draw(5);
    for _ in 0..20 {
        let M = draw.complex(4, 4);
        let of = |blocks: &[Block]| upper(&M, &structure(blocks));
        let repeated = |real| if real { Block::Real { repeats: 2 } } else { Block::Complex { repeats: 2 } };
        let chain = [of(&[repeated(true), R, R]), of(&[repeated(false), R, C]), of(&[C, C, C, C]), of(&[full(2), C, C]), of(&[full(4)])];
        assert!(chain.windows(2).all(|w| w[0] <= w[1] * (1.0 + 1e-6) + 1e-5), "{chain:?}");
    }
}

#[test]
fn up_to_three_complex_full_blocks_leave_no_gap() {
    let mut draw = Draw(6);
    let shapes: [&[Block]; 5] =
        [&[C, C, C], &[full(2), C, full(2)], &[full(3), full(2)], &[Block::Complex { repeats: 3 }, full(2)], &[full(2), full(2), full(2)]];
    for blocks in shapes {
        for _ in 0..6 {
            let s = structure(blocks);
            let M = draw.complex(s.n_z(), s.n_w());
            let [lower, upper] = both(&M, &s);
            // 2·(repeated scalars) + (full blocks) <= 3 [Packard1993, theorem 9.1].
            assert!(lower >= upper * (1.0 - 1e-4), "{blocks:?}: {lower} {upper}");
        }
    }
}

#[test]
fn a_proof_of_less_than_the_bound_does_not_hold() {
    let mut draw = Draw(7);
    let s = structure(&[R, R, full(2), Block::Full { rows: 1, cols: 2 }]);
    let M = draw.complex(s.n_z(), s.n_w());
    let mut proof = upper_bound(&M, &s).expect("a bound").certificate;
    assert!(proof.holds(&M, &s));
    proof.beta *= 1.0 - 1e-3;
    assert!(!proof.holds(&M, &s), "a smaller bound is not proved by the same scalings");
    proof.beta *= 2.0;
    assert!(proof.holds(&M, &s));
    // Scalings outside the structure prove nothing.
    proof.g[(2, 2)] = Complex::new(0.1, 0.0);
    assert!(!proof.holds(&M, &s));
    let beta = upper(&M, &s);
    assert!(scalings_for(&M, &s, 1.01 * beta).expect("fits").is_some_and(|p| p.holds(&M, &s)));
    assert!(scalings_for(&M, &s, 0.99 * beta).expect("fits").is_none());
}

#[test]
fn perturbations_have_the_structure_and_make_the_loop_singular() {
    let mut draw = Draw(8);
    let s = structure(&[Block::Real { repeats: 2 }, C, Block::Full { rows: 2, cols: 1 }, R]);
    for _ in 0..10 {
        let M = draw.complex(s.n_z(), s.n_w());
        let bound = upper_bound(&M, &s).expect("a bound");
        let lower = lower_bound(&M, &s, &bound).expect("a bound");
        let Some(p) = lower.perturbation else { continue };
        assert!(matches!(p.blocks[..], [Value::Real(_), Value::Complex(_), Value::Full(_), Value::Real(_)]));
        assert!(p.blocks.iter().all(|b| b.size() <= p.size * (1.0 + 1e-12)));
        let eigenvalues = (&M * p.delta(&s)).complex_eigenvalues_of();
        let nearest = eigenvalues.iter().map(|l| (l - Complex::new(1.0, 0.0)).norm_sqr().sqrt()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-8, "{nearest}");
    }
}

// ---- SLICOT

#[derive(Deserialize)]
struct Golden {
    problems: Vec<Problem>,
}

#[derive(Deserialize)]
struct Problem {
    blocks: Vec<(String, usize)>,
    matrix: Vec<[f64; 2]>,
    ab13md: f64,
}

#[test]
fn the_upper_bound_is_never_worse_than_that_of_slicot_and_the_lower_one_is_close() {
    let golden: Golden = serde_json::from_str(include_str!("golden/slicot/ab13md.json")).expect("golden file");
    assert!(golden.problems.len() >= 90);
    let mut ratios = Vec::new();
    for (i, p) in golden.problems.iter().enumerate() {
        let blocks: Vec<Block> = p.blocks.iter().map(|(kind, n)| if kind == "real" { R } else { full(*n) }).collect();
        let s = structure(&blocks);
        let n = s.n_w();
        let M = CMatrix::from_fn(n, n, |r, c| Complex::new(p.matrix[r * n + c][0], p.matrix[r * n + c][1]));
        let [lower, upper] = both(&M, &s);
        let has_real = blocks.contains(&R);
        // Mixed results of AB13MD are loose by up to 1e-4, complex ones are good to 1e-8.
        let floor = if has_real { 1e-3 } else { 1e-6 };
        assert!(upper <= p.ab13md * (1.0 + floor) + 1e-4, "problem {i}: {upper} {}", p.ab13md);
        assert!(p.ab13md >= lower * (1.0 - floor), "problem {i}: SLICOT's {} below a verified {lower}", p.ab13md);
        if has_real && upper > 1e-3 {
            ratios.push(lower / upper);
        }
    }
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    println!("lower/upper of {} mixed problems: median {median:.6}, lowest {:.4}", ratios.len(), ratios[0]);
    assert!(median >= 0.99, "{median}");
}

// ---- it ends

#[test]
fn every_call_ends_with_a_proof() {
    let n = if std::env::var_os("PKM_LONG").is_some() { 100_000 } else { 300 };
    let mut draw = Draw(9);
    let (mut slowest, mut slowest_blocks, mut stopped, mut steps) = (0.0_f64, Vec::new(), 0, Vec::new());
    for i in 0..n {
        let s = structure(&any_blocks(&mut draw));
        let mut M = draw.complex(s.n_z(), s.n_w());
        match i % 10 {
            // Hard ones: rank one, real, triangular, zero, badly scaled.
            0 => M = draw.complex(s.n_z(), 1) * draw.complex(1, s.n_w()),
            1 => M.iter_mut().for_each(|m| m.im = 0.0),
            2 => (0..M.ncols()).for_each(|c| (c + 1..M.nrows()).for_each(|r| M[(r, c)] = Complex::new(0.0, 0.0))),
            3 if i % 100 == 3 => M.fill(Complex::new(0.0, 0.0)),
            4 => M.row_iter_mut().for_each(|mut r| r *= Complex::new(powf(10.0, 8.0 * draw.unit()), 0.0)),
            _ => {}
        }
        #[expect(clippy::disallowed_methods, reason = "a test that looks at the wall clock")]
        let start = Instant::now();
        let bound = upper_bound(&M, &s).expect("finite numbers");
        let took = start.elapsed().as_secs_f64();
        if took > slowest {
            (slowest, slowest_blocks) = (took, s.blocks().to_vec());
        }
        assert!(bound.certificate.holds(&M, &s), "problem {i}");
        stopped += usize::from(bound.status == UpperStatus::Stopped);
        steps.push(bound.steps);
    }
    steps.sort_unstable();
    println!(
        "{n} calls: slowest {:.1} ms ({slowest_blocks:?}), {stopped} stopped early, steps median {} most {}",
        1e3 * slowest,
        steps[n / 2],
        steps[n - 1]
    );
    assert!(slowest < 60.0);
}
