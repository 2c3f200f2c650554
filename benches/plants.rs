//! A millisecond of both plants under a PD controller along slow sines: the own one in steps of 0.5 ms, as a recorded run takes them, and
//! the engine's in substeps of 0.25 ms, its default.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pkm_benches::shipped;
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::math::sin;
use pkm_dyn::{Data, Model};
use pkm_sim::{Plant, RapierOptions, RapierPlant, ReducedPlant};

/// Period of the controller `[s]`.
const PERIOD: f64 = 1e-3;

/// Inertia that each drive moves at the middle of its travel `[kg | kg·m²]`.
fn inertias(model: &Model) -> Vec<f64> {
    let (mut data, middle) = (Data::new(model), mid_pose(model));
    let zero = vec![0.0; middle.len()];
    assert!(assemble(model, &mut data).is_closed && walk_to(model, &mut data, &middle).is_closed);
    assert!(closed_loop_motion(model, &mut data, &middle, &zero, &zero).is_closed);
    reduced_mass_matrix(model, &mut data).diagonal().as_slice().to_vec()
}

/// A closure that moves a plant on by one period, in `parts` steps.
fn period<'p>(model: &Model, plant: &'p mut dyn Plant, parts: u32) -> impl FnMut() + use<'p> {
    let (mass, middle) = (inertias(model), mid_pose(model));
    let mut t = 0.0;
    move || {
        let tau: Vec<f64> = (0..mass.len())
            .map(|k| {
                let q = middle[k] + 0.02 * sin((2.0 + 0.3 * k as f64) * t);
                mass[k] * (2500.0 * (q - plant.position()[k]) - 90.0 * plant.velocity()[k])
            })
            .collect();
        for _ in 0..parts {
            assert!(plant.step(&tau, PERIOD / f64::from(parts)).is_ok());
        }
        t += PERIOD;
        black_box(plant.position()[0]);
    }
}

fn plants(c: &mut Criterion) {
    for name in ["five_bar", "serial_arm", "prs3", "ups3_rpu1"] {
        let robot = Robot::new(shipped(name).bare, Vec::new());
        let middle = mid_pose(&robot.model);
        if let Ok(mut own) = ReducedPlant::try_new(robot.clone(), &middle) {
            c.bench_function(&format!("1 ms of ReducedPlant/{name}"), |b| b.iter(period(&robot.model, &mut own, 2)));
        }
        if let Ok(mut foreign) = RapierPlant::try_new(robot.clone(), &middle, RapierOptions::default()) {
            c.bench_function(&format!("1 ms of RapierPlant/{name}"), |b| b.iter(period(&robot.model, &mut foreign, 1)));
        }
    }
}

criterion_group!(benches, plants);
criterion_main!(benches);
