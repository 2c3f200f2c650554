//! A simulated run with one concealed effect, and its diagnosis from the nominal robot and the recording alone.

use core::hint::black_box;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use pkm_benches::shipped;
use pkm_diagnose::{Settings, diagnose};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_sim::{Scenario, draw, run};

/// Robot, length of the recording `[s]`, its rate `[Hz]`.
const CASES: [(&str, f64, f64); 2] = [("five_bar", 25.0, 1000.0), ("ups3_rpu1", 85.0, 100.0)];

fn whole_runs(c: &mut Criterion) {
    let mut group = c.benchmark_group("whole runs");
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    for (name, duration_s, rate_hz) in CASES {
        let nominal = shipped(name);
        let hidden = draw(7, &nominal, Some("friction_stribeck"), &[]).expect("an effect for this robot");
        let truth = concealed(&nominal, hidden);
        let scenario = Scenario { duration_s, rate_hz, ..Scenario::default() };
        let record = || run(&truth, &nominal.robot, &scenario, &mut |_| ()).expect("a run inside the limits");
        group.bench_function(format!("simulate {duration_s} s/{name}"), |b| b.iter(|| black_box(record().len())));
        let recording: [Recording; 1] = [record()];
        group.bench_function(format!("diagnose {duration_s} s at {rate_hz} Hz/{name}"), |b| {
            b.iter(|| black_box(diagnose(&nominal, &recording, &[], &Settings::default(), &mut |_| ()).expect("usable").verdict));
        });
    }
    group.finish();
}

fn concealed(nominal: &Description, hidden: Vec<Applied>) -> Robot {
    // From the bare model: effects of the robot file that change inertias are in `nominal.robot.model` already.
    Robot::new(nominal.bare.clone(), nominal.robot.effects.iter().cloned().chain(hidden).collect())
}

criterion_group!(benches, whole_runs);
criterion_main!(benches);
