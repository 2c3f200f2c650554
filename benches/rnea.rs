//! One call of inverse dynamics and of the joint-torque regressor on the six-axis arm.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pkm_benches::{motion, shipped};
use pkm_dyn::Data;
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::rnea::rnea;

fn open_chain(c: &mut Criterion) {
    let model = shipped("serial_arm").bare;
    let mut data = Data::new(&model);
    let rows = motion(&model, 256);
    let mut k = 0_usize;
    // Other numbers every time: a branch predictor must not learn one pose.
    let mut next = || {
        k = (k + 1) % rows.len();
        black_box(&rows[k])
    };
    c.bench_function("rnea/serial_arm", |b| {
        b.iter(|| {
            let [q, v, a] = next();
            black_box(rnea(&model, &mut data, q, v, a)[0])
        });
    });
    c.bench_function("joint_torque_regressor/serial_arm", |b| {
        b.iter(|| {
            let [q, v, a] = next();
            black_box(joint_torque_regressor(&model, &mut data, q, v, a)[(0, 0)])
        });
    });
}

criterion_group!(benches, open_chain);
criterion_main!(benches);
