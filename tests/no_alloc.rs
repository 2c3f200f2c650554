//! Nothing is allocated in the loop: every algorithm works in the room that `Data::new` made. Holds in debug and release builds.
#![expect(unsafe_code, reason = "a global allocator cannot be written without it; it only counts and hands on to the system's")]

#[path = "contact/no_alloc.rs"]
mod contact;
#[allow(dead_code, reason = "shared: one test counts what is taken, another every call")]
mod counting;

use core::hint::black_box;

use pkm_dyn::aba::aba;
use pkm_dyn::configuration::{difference, integrate};
use pkm_dyn::constrained::{forward_dynamics, project, reduced_mass_matrix};
use pkm_dyn::crba::crba;
use pkm_dyn::energy::{center_of_mass, kinetic_energy, potential_energy};
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, friction_regressor, inverse_dynamics, loop_efforts, rigid_effort};
use pkm_dyn::jacobian::{Reference, frame_jacobian, frame_jacobian_time_variation, joint_jacobians, motion_of};
use pkm_dyn::loops::{
    Coordinate, Guide, Output, Singularities, assemble, internal_efforts, joint_wrenches, loop_drift, loop_gap, loop_wrench,
};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::regressor::{joint_torque_regressor, kinetic_energy_regressor, potential_energy_regressor};
use pkm_dyn::rnea::{generalized_gravity, nle, rnea};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};
use pkm_tests::{Draw, Motion, SHAPES, drawn_loops, drawn_mixed_tree, drawn_tree};

fn allocations(work: impl FnOnce()) -> usize {
    let before = counting::taken();
    work();
    counting::taken() - before
}

#[test]
fn the_counter_counts() {
    // `black_box`, or the release build removes the allocation.
    assert_eq!(allocations(|| drop(black_box(vec![1.0_f64; black_box(8)]))), 1);
    assert_eq!(allocations(|| drop(black_box(nalgebra::DMatrix::<f64>::zeros(black_box(3), 3)))), 1);
}

#[test]
fn tree_algorithms_allocate_nothing() {
    let mut draw = Draw::new(3);
    let model = drawn_tree(7, &mut draw);
    let (q, v, a) = (draw.vector(7, -1.0..1.0), draw.vector(7, -1.0..1.0), draw.vector(7, -1.0..1.0));
    let mut data = Data::new(&model);
    let count = allocations(|| {
        black_box(rnea(&model, &mut data, &q, &v, &a));
        black_box(joint_torque_regressor(&model, &mut data, &q, &v, &a));
        let _ = black_box(inverse_dynamics(&model, &mut data, &q, &v, &a));
        black_box(actuated_regressor(&model, &mut data));
    });
    assert_eq!(count, 0);
}

#[test]
fn dynamics_of_trees_with_joints_of_every_kind_allocate_nothing() {
    let mut draw = Draw::new(5);
    let model = drawn_mixed_tree(6, &mut draw);
    let n = model.nv();
    let (mut q, v, a) = (draw.vector(n, -1.0..1.0), draw.vector(n, -1.0..1.0), draw.vector(n, -1.0..1.0));
    let mut data = Data::new(&model);
    let (mut row, mut step) = (vec![0.0; 10 * n], vec![0.0; n]);
    let frame = FrameOnBody { body: Some(n - 1), pose: Pose::identity() };
    let count = allocations(|| {
        black_box(aba(&model, &mut data, &q, &v, &a));
        black_box(crba(&model, &mut data, &q));
        black_box(nle(&model, &mut data, &q, &v));
        black_box(generalized_gravity(&model, &mut data, &q));
        black_box(joint_jacobians(&model, &mut data, &q));
        motion_of(&model, &mut data, &q, &v);
        for reference in [Reference::World, Reference::Local, Reference::LocalWorldAligned] {
            black_box(frame_jacobian(&model, &mut data, &frame, reference));
            black_box(frame_jacobian_time_variation(&model, &mut data, &frame, reference));
        }
        black_box(kinetic_energy(&model, &mut data, &q, &v) + potential_energy(&model, &mut data, &q));
        black_box(center_of_mass(&model, &mut data, &q));
        kinetic_energy_regressor(&model, &mut data, &q, &v, &mut row);
        potential_energy_regressor(&model, &mut data, &q, &mut row);
        let before = data.v.as_slice();
        difference(&model, &q, before, &mut step);
        integrate(&model, &mut q, &step);
    });
    assert_eq!(count, 0);
}

#[test]
fn closed_loop_dynamics_allocate_nothing_with_as_many_drives_as_freedoms_or_more() {
    for (seed, shape) in SHAPES.into_iter().enumerate() {
        let mut draw = Draw::new(60 + seed as u64);
        let mut model = drawn_loops(shape, &mut draw);
        for round in 0..2 {
            let mut data = Data::new(&model);
            assert!(assemble(&model, &mut data).is_closed);
            let (mut q, mut v, tau) = (data.q.clone(), vec![0.1; model.nv()], vec![1.0; model.nv()]);
            let count = allocations(|| {
                black_box(reduced_mass_matrix(&model, &mut data));
                let _ = black_box(project(&model, &mut data, &mut q, &mut v));
                let _ = black_box(forward_dynamics(&model, &mut data, &q, &v, &tau));
                rigid_effort(&model, &mut data);
                black_box(loop_efforts(&model, &mut data));
                black_box(loop_wrench(&model, &data, 0));
                black_box(joint_wrenches(&model, &mut data));
                black_box(friction_regressor(&model, &mut data));
                black_box(internal_efforts(&model, &mut data));
            });
            assert_eq!(count, 0, "{shape:?} {round}");
            // Once more with a drive too many.
            let passive = model.joints[model.passive()[0]].name.clone();
            model.add_actuator(&passive, 0.0).expect("it is passive");
        }
    }
}

fn along_a_motion(model: &Model, draw: &mut Draw) -> usize {
    let motion = Motion::about_assembly(model, 0.05, draw);
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed);
    let q_tree = data.q.clone();
    let samples: Vec<[Vec<f64>; 3]> = (0..20).map(|k| motion.at(0.02 * f64::from(k))).collect();
    allocations(|| {
        for [q, v, a] in &samples {
            let _ = black_box(closed_loop_motion(model, &mut data, q, v, a));
            rigid_effort(model, &mut data);
            black_box(actuated_regressor(model, &mut data));
            let _ = black_box(inverse_dynamics(model, &mut data, q, v, a));
        }
        loop_gap(model, &mut data, &q_tree);
        loop_drift(model, &mut data);
    })
}

#[test]
fn distances_from_singularities_and_guided_motion_allocate_nothing() {
    let mut draw = Draw::new(41);
    let model = drawn_loops(SHAPES[2], &mut draw);
    let mut data = Data::new(&model);
    let home = model.assembly.clone();
    let last = model.links.iter().rfind(|l| l.body.is_some()).map(|l| l.name.clone()).expect("a moving link");
    let output = Output::named(&model, &last).expect("the link is there");
    let mut singularities = Singularities::new(&model, &mut data, &home, output.clone(), &[0, 1, 2, 3, 4, 5], 1.0);
    let mut guide = Guide::new(&model, output, model.actuators.iter().map(|&j| Coordinate::Joint(j)).collect());
    let ahead: Vec<f64> = model.actuators.iter().map(|&j| home[j] + 0.01).collect();
    data.q.copy_from_slice(&home);
    let mut motion = vec![0.0; model.nv()];
    let count = allocations(|| {
        let _ = black_box(singularities.at(&model, &mut data, &home));
        singularities.loosest_motion(&mut motion);
        black_box(guide.move_to(&model, &mut data, &ahead));
    });
    assert_eq!(count, 0);
}

#[test]
fn loop_mechanisms_of_every_shape_allocate_nothing() {
    for (seed, shape) in SHAPES.into_iter().enumerate() {
        let mut draw = Draw::new(20 + seed as u64);
        let model = drawn_loops(shape, &mut draw);
        assert_eq!(along_a_motion(&model, &mut draw), 0, "{shape:?}");
    }
}

#[test]
fn a_step_of_the_constrained_plant_allocates_nothing_even_where_joints_stick_and_stops_are_struck() {
    use pkm_sim::{ConstrainedOptions, ConstrainedPlant, Integrator, Plant};
    let robot = pkm_robots::find("five_bar").expect("a shipped robot");
    let description = pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("it loads");
    let start = pkm_dyn::loops::mid_pose(&description.robot.model);
    for integrator in [Integrator::Auto, Integrator::Radau, Integrator::Moreau] {
        let options = ConstrainedOptions { integrator, end_stops: Some(0.3), ..ConstrainedOptions::default() };
        let mut plant = ConstrainedPlant::try_new(description.robot.clone(), &start, options).expect("it starts");
        let work = || {
            for k in 0..500 {
                let push = if k / 50 % 2 == 0 { 8.0 } else { -8.0 };
                plant.step(&[push, 0.6 * push], 1e-3).expect("it moves on");
            }
        };
        assert_eq!(allocations(work), 0, "{integrator:?}");
    }
}

// ---- tracking controllers and observers

mod tracking {
    use core::hint::black_box;

    use pkm_ctrl::catalogue::{Entry, Visit, every};
    use pkm_ctrl::observer::{
        AlphaBeta, CommandedAcceleration, CommandedVelocity, Discretisation, ExtendedState, FilteredDerivative, FirstDifference, Kalman,
        ModelBased, MomentumObserver, MomentumObserverConfig, SuperTwisting, VelocityObserver,
    };
    use pkm_ctrl::{ComputedTorque, ComputedTorqueConfig, Controller, Input};
    use pkm_tests::closed_loop::{Sines, shipped_robot, tuning};

    use super::allocations;

    /// Steps from the first one on, saturated ones and the fault at the end among them.
    fn steps<const N: usize, C: Controller<N>>(controller: &C, motion: &Sines<N>) -> usize {
        let mut state = controller.at_rest();
        allocations(|| {
            for k in 0..200 {
                let [q_ref, v_ref, mut a_ref] = motion.at(0.01 * f64::from(k));
                if k > 150 {
                    a_ref[0] = 1e6;
                }
                let q_meas = if k == 199 { [f64::NAN; N] } else { q_ref };
                let input = Input { q_ref, v_ref, a_ref, ..Input::standing(q_meas, 0.01) };
                black_box(controller.step(&mut state, &input).tau);
            }
        })
    }

    struct Count<'m, const N: usize>(&'m Sines<N>, usize);

    impl<const N: usize> Visit<N> for Count<'_, N> {
        fn visit<C: Controller<N>>(&mut self, entry: &'static Entry, controller: &C) {
            assert_eq!(steps(controller, self.0), 0, "{}", entry.name);
            self.1 += 1;
        }
    }

    fn on<const N: usize>(name: &str) {
        let robot = shipped_robot(name);
        let motion = Sines::<N>::about_the_middle(&robot, 0.02);
        let mut count = Count(&motion, 0);
        every(&robot, &tuning::<N>(&robot, 20.0, 0.01), &mut count).expect("all can be built");
        assert_eq!(count.1, pkm_ctrl::catalogue::ALL.len());
    }

    #[test]
    fn controllers_from_files_step_without_allocating() {
        let robot = shipped_robot("prs3");
        let motion = Sines::<3>::about_the_middle(&robot, 0.02);
        let examples = pkm_tests::examples("controllers");
        assert!(examples.len() > 14);
        for (name, text) in examples {
            let mut controller = pkm_ctrl::config::parse(&text, &name, &robot).expect("an example of the documentation");
            let mut tau = [0.0; 3];
            let count = allocations(|| {
                for k in 0..200 {
                    let [q, v, a] = motion.at(0.001 * f64::from(k));
                    let q_meas = if k == 199 { [f64::NAN; 3] } else { q };
                    let zero = [0.0; 6];
                    let signals = pkm_ctrl::Signals {
                        dt: 0.001,
                        q_dt: 0.001,
                        q_meas: &q_meas,
                        tau_meas: &[1.0; 3],
                        wrench_meas: [2.0; 6],
                        q_ref: &q,
                        v_ref: &v,
                        a_ref: &a,
                        wrench_ref: zero,
                        tau_ff: &[300.0; 3],
                    };
                    black_box(controller.step(&signals, &mut tau));
                }
                // Slices of other lengths are a fault, no panic.
                let signals = pkm_ctrl::Signals {
                    dt: 0.001,
                    q_dt: 0.001,
                    q_meas: &[],
                    tau_meas: &[],
                    wrench_meas: [0.0; 6],
                    q_ref: &[],
                    v_ref: &[],
                    a_ref: &[],
                    wrench_ref: [0.0; 6],
                    tau_ff: &[],
                };
                assert!(controller.step(&signals, &mut tau).is_faulted);
            });
            assert_eq!(count, 0, "{name}");
        }
    }

    #[test]
    fn steps_of_every_controller_allocate_nothing() {
        on::<1>("motobotte");
        on::<2>("five_bar");
        on::<3>("prs3");
        on::<4>("ups3_rpu1");
        on::<4>("ups4");
        on::<6>("serial_arm");
    }

    fn observed<const N: usize, O: VelocityObserver<N>>(observer: O, motion: &Sines<N>) -> usize {
        let robot = shipped_robot("prs3");
        let config = ComputedTorqueConfig::with_bandwidth(20.0, [1e4; N]);
        let law = ComputedTorque::try_new(robot, observer, config).expect("the robot's drives");
        steps(&law, motion)
    }

    #[test]
    fn every_observer_allocates_nothing() {
        let robot = shipped_robot("prs3");
        let motion = Sines::<3>::about_the_middle(&robot, 0.02);
        let (w, zoh) = ([40.0; 3], Discretisation::ZeroOrderHold);
        let counts = [
            observed(FirstDifference, &motion),
            observed(FilteredDerivative::try_new([0.02; 3]).expect("good"), &motion),
            observed(AlphaBeta::try_new(w).expect("good"), &motion),
            observed(Kalman::try_new([1e-4; 3], w).expect("good"), &motion),
            observed(SuperTwisting::try_new(w).expect("good"), &motion),
            observed(CommandedAcceleration::try_new(w, zoh).expect("good"), &motion),
            observed(CommandedVelocity, &motion),
            observed(ExtendedState::try_new(w).expect("good"), &motion),
            observed(ModelBased::try_new(robot.clone(), w, zoh).expect("good"), &motion),
        ];
        assert_eq!(counts, [0; 9]);
        let config = MomentumObserverConfig { rate: w, threshold: [10.0; 3] };
        let momentum = MomentumObserver::try_new(robot, config).expect("good");
        let mut state = momentum.at_rest();
        let count = allocations(|| {
            for k in 0..100 {
                let [q, v, _] = motion.at(0.01 * f64::from(k));
                black_box(momentum.step(&mut state, [&q, &v, &[1.0; 3]], 0.01).tau_ext);
            }
        });
        assert_eq!(count, 0);
    }
}

#[test]
fn controllers_of_contact_allocate_nothing() {
    let counts = contact::contact_allocations(|work| allocations(work));
    assert!(counts.len() >= 10 && counts.iter().all(|(_, n)| *n == 0), "{counts:?}");
}

/// The task of a model with loops, forwards and backwards.
#[test]
fn a_task_of_a_model_allocates_nothing() {
    use pkm_ctrl::force::{PlatformTask, TaskMap};
    let shipped = pkm_robots::find("ups4").expect("a shipped robot");
    let model = pkm_dyn::urdf::parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("it reads").bare;
    let output = Output::evident(&model).expect("a platform");
    let map: PlatformTask<3> = PlatformTask::try_new(model, output, [3, 4, 5], 1.0).expect("three freedoms");
    let mut state = TaskMap::<4, 3>::at_rest(&map);
    let q: [f64; 4] = map.drives(&mut state, &[0.0; 3]).expect("the home pose");
    let count = allocations(|| {
        let here: pkm_ctrl::force::Task<4, 3> = map.at(&mut state, &q).expect("the loops close");
        let there: Option<[f64; 4]> = map.drives(&mut state, &[here.x[0] + 0.05, here.x[1] - 0.03, here.x[2]]);
        assert!(there.is_some());
    });
    assert_eq!(count, 0);
}
