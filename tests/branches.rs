//! One bad sample of the drives, and exact ones after it: the model inside a controller is where the robot is, on the branch it was on.

use pkm_ctrl::force::{Impedance, ImpedanceConfig, PlatformTask, Task, TaskMap};
use pkm_ctrl::observer::{FirstDifference, MomentumObserver, MomentumObserverConfig};
use pkm_ctrl::{Controller, FaultCode, Input, Limit, PdModel, PdModelConfig};
use pkm_dyn::effects::Robot;
use pkm_dyn::loops::{Output, assemble};
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, Model};

const DT: f64 = 0.01;

fn robot(name: &str) -> Robot {
    let shipped = pkm_robots::find(name).expect("a shipped robot");
    parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("a shipped robot reads").robot
}

/// Positions of the drives at the assembly.
fn assembled<const N: usize>(model: &Model) -> [f64; N] {
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed);
    core::array::from_fn(|k| data.q[model.actuators[k]])
}

/// The task at `q` before one sample with drive `drive` off by `spike`, what that sample says, and the task for ten samples after it.
fn through<const N: usize, const M: usize>(
    map: &PlatformTask<M>,
    q: &[f64; N],
    drive: usize,
    spike: f64,
) -> (bool, Task<N, M>, [Task<N, M>; 10]) {
    let mut state = TaskMap::<N, M>::at_rest(map);
    let before = map.at(&mut state, q).expect("the loops close");
    let mut off = *q;
    off[drive] += spike;
    let is_seen = TaskMap::<N, M>::at(map, &mut state, &off).is_none();
    (is_seen, before, [(); 10].map(|()| map.at(&mut state, q).expect("the loops close again")))
}

fn far<const N: usize, const M: usize>(a: &Task<N, M>, b: &Task<N, M>) -> f64 {
    a.x.iter().zip(b.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn stays<const N: usize, const M: usize>(name: &str, components: [usize; M], spikes: &[f64]) -> usize {
    let model = robot(name).model;
    let home: [f64; N] = assembled(&model);
    let platform = Output::named(&model, "platform").expect("the platform");
    let map = PlatformTask::try_new(model, platform, components, 0.3).expect("a task");
    let mut lost = 0;
    for drive in 0..N {
        for &spike in spikes {
            let (is_lost, before, after) = through(&map, &home, drive, spike);
            lost += usize::from(is_lost);
            let worst = after.iter().map(|task| far(task, &before)).fold(0.0, f64::max);
            assert!(worst < 1e-9, "{name}, drive {drive} off by {spike}: {worst} after it, {:?} {:?}", before.x, after[9].x);
        }
    }
    lost
}

#[test]
fn a_task_is_where_it_was_after_one_bad_sample() {
    assert!(stays::<3, 3>("prs3", [2, 3, 4], &[0.5, -0.5, 0.1]) > 0, "no spike opened a loop");
    let _ = stays::<4, 3>("ups4", [3, 4, 5], &[-0.03, 0.03, -0.2, 0.2]);
}

#[test]
fn a_momentum_observer_goes_on_where_it_was_after_one_bad_sample() {
    let robot = robot("prs3");
    let q: [f64; 3] = assembled(&robot.model);
    let observer = MomentumObserver::try_new(robot, MomentumObserverConfig { rate: [20.0; 3], threshold: [10.0; 3] }).expect("an observer");
    let zero = [0.0; 3];
    let mut state = observer.at_rest();
    // The efforts that carry it are what the observer misses when none are given.
    for _ in 0..300 {
        let _ = observer.step(&mut state, [&q, &zero, &zero], DT);
    }
    let weight = observer.step(&mut state, [&q, &zero, &zero], DT).tau_ext;
    for drive in 0..3 {
        let mut off = q;
        off[drive] += 0.5;
        let spoilt = observer.step(&mut state, [&off, &zero, &zero], DT);
        assert!(spoilt.is_held, "drive {drive}: its loops cannot close");
        for _ in 0..300 {
            let after = observer.step(&mut state, [&q, &zero, &zero], DT);
            assert!((0..3).all(|k| (after.tau_ext[k] - weight[k]).abs() < 1e-6), "{after:?} {weight:?}");
        }
    }
}

#[test]
fn a_controller_says_that_loops_do_not_close_and_one_without_a_fault_that_its_task_is_lost() {
    let model = robot("prs3").model;
    let q: [f64; 3] = assembled(&model);
    let good = Input::standing(q, DT);
    let mut bad = good;
    bad.q_meas[0] += 0.5;
    let gains = PdModelConfig { kp: [1e3; 3], kd: [10.0; 3], tau_limit: [1e3; 3] };
    let law = PdModel::try_new(robot("prs3"), FirstDifference, gains).expect("numbers in range");
    let mut state = law.at_rest();
    let weight = law.step(&mut state, &good).tau;
    let fault = law.step(&mut state, &bad).health.fault.expect("a fault");
    assert!(fault.code == FaultCode::LoopGap && fault.value > 1e-6, "{fault}");
    assert!(law.step(&mut state, &good).tau.iter().zip(weight).all(|(tau, want)| (tau - want).abs() < 1e-9));
    let platform = Output::named(&model, "platform").expect("the platform");
    let map = PlatformTask::try_new(model, platform, [2, 3, 4], 0.3).expect("a task");
    let three = [1e3; 3];
    let soft = ImpedanceConfig { stiffness: three, damping: [10.0; 3], force_limit: three, tau_limit: three, filter_s: 0.0, dt: DT };
    let law = Impedance::try_new(map, soft).expect("numbers in range");
    let mut state = law.at_rest();
    let lost = [good, bad, good].map(|input| law.step(&mut state, &input).health);
    assert_eq!(lost.map(|h| h.acted.any(Limit::Singularity)), [false, true, false]);
    assert!(lost.iter().all(|h| !h.is_faulted));
}
