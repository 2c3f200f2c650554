//! One sample of a closed-loop robot: close the loops, find the drives' efforts, and the regressor in drive coordinates.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pkm_benches::{motion, shipped};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, rigid_effort};
use pkm_dyn::loops::{assemble, walk_to};

fn closed_loop(c: &mut Criterion) {
    for name in ["five_bar", "prs3", "ups3_rpu1"] {
        let model = shipped(name).bare;
        let mut data = Data::new(&model);
        let rows = motion(&model, 256);
        assert!(assemble(&model, &mut data).is_closed && walk_to(&model, &mut data, &rows[0][0]).is_closed);
        // There and back: every step is small, also the one that begins anew.
        let mut k = 0_usize;
        let mut next = || {
            k = (k + 1) % (2 * rows.len() - 2);
            black_box(&rows[k.min(2 * rows.len() - 2 - k)])
        };
        c.bench_function(&format!("closed_loop_motion/{name}"), |b| {
            b.iter(|| {
                let [q, v, a] = next();
                assert!(closed_loop_motion(&model, &mut data, q, v, a).is_closed);
            });
        });
        c.bench_function(&format!("closed_loop_motion + rigid_effort/{name}"), |b| {
            b.iter(|| {
                let [q, v, a] = next();
                assert!(closed_loop_motion(&model, &mut data, q, v, a).is_closed);
                rigid_effort(&model, &mut data);
                black_box(data.tau_act[0])
            });
        });
        c.bench_function(&format!("closed_loop_motion + rigid_effort + actuated_regressor/{name}"), |b| {
            b.iter(|| {
                let [q, v, a] = next();
                assert!(closed_loop_motion(&model, &mut data, q, v, a).is_closed);
                rigid_effort(&model, &mut data);
                black_box(actuated_regressor(&model, &mut data)[(0, 0)])
            });
        });
    }
}

criterion_group!(benches, closed_loop);
criterion_main!(benches);
