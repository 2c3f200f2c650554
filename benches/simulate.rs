//! One millisecond of a robot with friction in its joints, in each plant and with each rule.

use core::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pkm_benches::shipped;
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::loops::mid_pose;
use pkm_dyn::math;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Integrator, Plant, ReducedPlant};

/// Length of a step `[s]`: a control period.
const STEP_S: f64 = 1e-3;

/// Robots that move about the middle of their travel, on springs of this stiffness `[N/m | N·m/rad]`, under efforts of this share of their
/// limits.
const CASES: [(&str, f64, f64); 4] =
    [("serial_arm", 400.0, 0.4), ("five_bar", 400.0, 0.3), ("prs3", 4000.0, 0.3), ("ups3_rpu1", 20_000.0, 0.1)];

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("1 ms of motion");
    for (name, stiffness, share) in CASES {
        let model = shipped(name).bare;
        let start = mid_pose(&model);
        let spring = |(&j, rest): (&usize, &f64)| {
            let stated = [("stiffness".to_string(), stiffness), ("rest".to_string(), *rest)];
            Applied::try_new(&model, "spring", &model.joints[j].name, &stated).expect("a spring at a drive")
        };
        let robot = || Robot::new(model.clone(), model.actuators.iter().zip(&start).map(spring).collect());
        let mut bench = |rule: &str, mut plant: Box<dyn Plant>| {
            let (mut tau, mut t) = (vec![0.0; start.len()], 0.0);
            group.bench_function(format!("{name}/{rule}"), |b| {
                b.iter(|| {
                    t += STEP_S;
                    for (k, (tau, &j)) in tau.iter_mut().zip(&model.actuators).enumerate() {
                        let frequency = core::f64::consts::TAU * (1.0 + 0.3 * k as f64);
                        *tau = share * model.joints[j].limits.effort.min(200.0) * math::sin(frequency * t);
                    }
                    plant.step(&tau, STEP_S).expect("the robot moves on");
                    black_box(plant.position()[0])
                });
            });
        };
        for integrator in [Integrator::RungeKutta, Integrator::Moreau, Integrator::Radau] {
            let options = ConstrainedOptions { integrator, ..ConstrainedOptions::default() };
            let plant = ConstrainedPlant::try_new(robot(), &start, options).expect("the robot assembles");
            bench(&format!("{integrator:?}"), Box::new(plant));
        }
        bench("reduced", Box::new(ReducedPlant::try_new(robot(), &start).expect("the robot assembles")));
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
