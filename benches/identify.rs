//! Identification of the six-axis arm from a minute at 1 kHz: assembly of the observation matrix and the semidefinite program.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pkm_benches::shipped;
use pkm_ident::factor::Factors;
use pkm_ident::motion::Use;
use pkm_ident::observation::{Observation, Rows};
use pkm_ident::{Settings, identify};
use pkm_sim::{Scenario, run};

fn six_axes(c: &mut Criterion) {
    let robot = shipped("serial_arm").robot;
    let scenario = Scenario { duration_s: 60.0, rate_hz: 1000.0, ..Scenario::default() };
    let recording = run(&robot, &robot, &scenario, &mut |_| {}).expect("the arm moves");
    let settings = Settings::default();
    let observation = Observation::try_new(&robot, &[(&recording, Use::Fit)], settings.rows).expect("its recording");
    let mut group = c.benchmark_group("identify");
    group.sample_size(10);
    group.bench_function("observation, serial_arm, 60 s at 1 kHz", |b| {
        b.iter(|| black_box(Factors::of(&observation, Rows::Fitted, &mut |_| {}).expect("it moves").used_folds().len()));
    });
    group.bench_function("all of it, serial_arm, 60 s at 1 kHz", |b| {
        b.iter(|| black_box(identify(&robot, core::slice::from_ref(&recording), &[], &settings, &mut |_| {}).expect("it moves").n_rows));
    });
    group.finish();
}

criterion_group!(benches, six_axes);
criterion_main!(benches);
