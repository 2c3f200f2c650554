//! Structured singular value of one random matrix: three real scalars and two full 3 × 3 blocks.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Complex;
use pkm_ctrl::design::mu::{Block, CMatrix, Structure, lower_bound, upper_bound};

/// Random matrices with entries in the unit square.
fn matrices(n: usize, count: usize) -> Vec<CMatrix> {
    let mut state = 1_u64;
    let mut unit = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    (0..count).map(|_| CMatrix::from_fn(n, n, |_, _| Complex::new(unit(), unit()))).collect()
}

fn mu(c: &mut Criterion) {
    let real = Block::Real { repeats: 1 };
    let full = Block::Full { rows: 3, cols: 3 };
    let structure = Structure::try_new(vec![real, real, real, full, full]).expect("blocks");
    let all = matrices(9, 64);
    let mut k = 0_usize;
    let mut next = || {
        k = (k + 1) % all.len();
        black_box(&all[k])
    };
    c.bench_function("mu_upper/3R+2C3", |b| b.iter(|| black_box(upper_bound(next(), &structure).expect("a bound").certificate.beta)));
    c.bench_function("mu_both/3R+2C3", |b| {
        b.iter(|| {
            let matrix = next();
            let upper = upper_bound(matrix, &structure).expect("a bound");
            black_box(lower_bound(matrix, &structure, &upper).expect("a bound").beta)
        });
    });
}

criterion_group!(benches, mu);
criterion_main!(benches);
