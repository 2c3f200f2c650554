//! Robust stability of McDaid's ankle robot: a 30-state discrete loop with lightly damped modes, three real parameters, two full blocks.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use std::time::Instant;

use pkm_ctrl::design::mu::{Block, Guarantee, Response, Settings, StateSpace, Structure, sweep, upper_bound};
use pkm_dyn::math::powf;
use pkm_papers::mcdaid::ankle::{self, DT, PROPOSED, PROPOSED_14};

/// Blocks: three distinct inertias, then damping and stiffness of the ankle as full matrices.
fn blocks() -> Vec<Block> {
    let real = Block::Real { repeats: 1 };
    let full = Block::Full { rows: 3, cols: 3 };
    vec![real, real, real, full, full]
}

/// The closed loop with its uncertainty pulled out, weighted as in [McDaid] Table 8.4.
fn closed_loop(t: [f64; 3], k: [f64; 4]) -> StateSpace {
    ankle::uncertain_loop(t, k).expect("a system")
}

fn structure() -> Structure {
    ankle::structure().expect("blocks")
}

fn radius(system: &StateSpace) -> f64 {
    1.0 - system.stability().expect("states").1
}

#[test]
fn the_proposed_gains_are_stable_and_the_uniform_ones_are_not() {
    let J = ankle::jacobian([0.0; 3]);
    assert!((J[(0, 0)] - 0.024_557_56).abs() < 1e-8 && (J[(3, 1)] + 0.063_447_23).abs() < 1e-8, "{J}");
    for (k, known) in [([16.0; 4], 1.000_476), (PROPOSED, 0.995_433), (PROPOSED_14, 0.998_571)] {
        let found = radius(&closed_loop([0.0; 3], k));
        assert!((found - known).abs() < 2e-6, "{k:?}: {found}, known {known}");
    }
}

#[test]
fn single_frequencies_agree_with_slicot_and_low_ones_with_the_weight_of_the_stiffness() {
    let system = closed_loop([0.0; 3], PROPOSED);
    let upper = |w: f64, blocks: Vec<Block>| {
        let M = system.at(w).expect("no pole");
        upper_bound(&M, &Structure::try_new(blocks).expect("blocks")).expect("a bound").certificate.beta
    };
    assert!((upper(1e-3, blocks()) - 0.1).abs() < 1e-4, "{}", upper(1e-3, blocks()));
    let complex = || {
        let c = Block::Complex { repeats: 1 };
        let full = Block::Full { rows: 3, cols: 3 };
        vec![c, c, c, full, full]
    };
    // AB13MD of the same model built with numpy: real parameters as complex, and real (where it is looser by up to 1e-3).
    let known = [
        (1.0, 0.101_294_014_1, 0.101_278_580_1),
        (10.0, 0.060_425_159_0, 0.057_000_101_9),
        (100.0, 0.012_255_001_2, 0.004_551_620_1),
        (348.152, 0.781_188_833_1, 0.735_997_190_3),
        (1000.0, 0.169_467_876_6, 0.035_079_268_0),
    ];
    for (w, as_complex, mixed) in known {
        let found = [upper(w, complex()), upper(w, blocks())];
        assert!((found[0] - as_complex).abs() < 1e-5 * as_complex, "{w}: {found:?}");
        assert!(found[1] < mixed * 1.0001 && found[1] > mixed * 0.999, "{w}: {found:?}");
    }
}

#[test]
fn the_loop_is_robust_on_every_frequency_up_to_half_the_sample_rate() {
    let system = closed_loop([0.0; 3], PROPOSED);
    let range = [0.0, core::f64::consts::PI / DT];
    #[expect(clippy::disallowed_methods, reason = "a test that looks at the wall clock")]
    let start = Instant::now();
    let settings = Settings { slack: 1e-3, ..Settings::default() };
    let out = sweep(&system, &structure(), range, &settings).expect("a system that can be analysed");
    println!(
        "mu {:.6} .. {:.6} at {:.3} rad/s, {:?}, {} intervals, {:.1} s",
        out.worst.beta,
        out.upper,
        out.worst.w,
        out.guarantee,
        out.segments.len(),
        start.elapsed().as_secs_f64()
    );
    assert_eq!(out.guarantee, Guarantee::Interval(range));
    // A grid of 82 points said 0.458 at 353 rad/s: the mode at 348 rad/s stands between its points.
    assert!(out.upper > 0.736 && out.upper < 0.738, "{}", out.upper);
    assert!(out.worst.beta > 0.7359 && (out.worst.w - 348.15).abs() < 0.1, "{:?}", out.worst);
}

/// The figure of the chapter: orientations of the foot, 200 frequencies each.
#[test]
fn mu_stays_below_one_over_the_orientations_of_the_foot() {
    let is_long = std::env::var_os("PKM_LONG").is_some();
    let (n, frequencies) = if is_long { (21, 200) } else { (3, 12) };
    let at = |i: usize, most: f64| (2.0 * i as f64 / (n - 1) as f64 - 1.0) * f64::to_radians(most);
    let top: f64 = core::f64::consts::PI / DT;
    let w: Vec<f64> = (0..frequencies).map(|i| 1e-2 * powf(top / 1e-2, i as f64 / (frequencies - 1) as f64)).collect();
    let structure = structure();
    #[expect(clippy::disallowed_methods, reason = "a test that looks at the wall clock")]
    let start = Instant::now();
    let row = |i: usize| {
        (0..n).fold(0.0_f64, |most, j| {
            let system = closed_loop([at(i, 20.0), at(j, 15.0), 0.0], PROPOSED);
            let mu = |w: &f64| upper_bound(&system.at(*w).expect("no pole"), &structure).expect("a bound").certificate.beta;
            w.iter().map(mu).fold(most, f64::max)
        })
    };
    let rows: Vec<usize> = (0..n).collect();
    let halves: Vec<f64> = std::thread::scope(|scope| {
        let hands: Vec<_> =
            rows.chunks(n.div_ceil(2)).map(|half| scope.spawn(move || half.iter().map(|&i| row(i)).fold(0.0, f64::max))).collect();
        hands.into_iter().map(|h| h.join().expect("a half of the map")).collect()
    });
    let most = halves.into_iter().fold(0.0, f64::max);
    let count = n * n * frequencies;
    println!("{count} values in {:.1} s on two threads, largest mu {most:.4}", start.elapsed().as_secs_f64());
    assert!(most < 1.0, "{most}");
}
