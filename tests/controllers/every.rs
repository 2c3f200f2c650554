//! What holds for every controller of the catalogue, on every kind of robot.

use pkm_ctrl::catalogue::{ALL, Drives, Entry, Tuning, Visit, every, find};
use pkm_ctrl::{Command, Controller, Input};
use pkm_dyn::math;
use pkm_tests::closed_loop::{Runs, Sines, World, shipped_robot, tuning};

/// Largest position error after the first second of a run, over the amplitude, controller by controller.
fn errors<const N: usize>(name: &str, amplitude: f64) -> Vec<(&'static str, f64)> {
    let robot = shipped_robot(name);
    let motion = Sines::<N>::about_the_middle(&robot, amplitude);
    let tuning = tuning::<N>(&robot, 25.0, 1e-3);
    let mut out: Vec<(&'static str, f64)> = Vec::new();
    let each = |entry: &'static Entry, k: u32, input: &Input<N>, command: &Command<N>| {
        assert!(!command.health.is_faulted, "{name} {}: {k}", entry.name);
        if out.last().is_none_or(|last| last.0 != entry.name) {
            out.push((entry.name, 0.0));
        }
        if k > 1000 {
            let error = (0..N).fold(0.0_f64, |top, i| top.max((input.q_ref[i] - input.q_meas[i]).abs()));
            let last = out.last_mut().expect("just pushed");
            last.1 = last.1.max(error / amplitude);
        }
    };
    every(&robot, &tuning, &mut Runs { robot: &robot, motion: &motion, tuning, periods: 2500, each }).expect("all can be built");
    out
}

#[test]
fn every_controller_follows_on_trees_and_closed_loops() {
    let all = [errors::<2>("five_bar", 0.15), errors::<3>("prs3", 0.04), errors::<4>("ups3_rpu1", 0.02), errors::<6>("serial_arm", 0.2)];
    for errors in &all {
        let names: Vec<&str> = errors.iter().map(|e| e.0).collect();
        assert_eq!(names, ALL.iter().map(|e| e.name).collect::<Vec<_>>());
        for (name, error) in errors {
            assert!(*error < 0.25, "{name}: {error} of {all:?}");
        }
        // With the model, friction and all, hardly anything is left.
        let of = |name: &str| errors.iter().find(|e| e.0 == name).expect("visited").1;
        assert!(of("computed_torque") < 0.01 && of("computed_torque_dae") < 0.01, "{errors:?}");
    }
}

#[test]
fn names_are_unique_and_found() {
    for (k, entry) in ALL.iter().enumerate() {
        assert_eq!(find(entry.name), Some(entry));
        assert!(ALL[k + 1..].iter().all(|other| other.name != entry.name) && !entry.sentence.is_empty());
    }
    assert_eq!(find("bang_bang"), None);
}

/// Breaks one number after another and looks at the commands.
struct Breaks<'r> {
    robot: &'r pkm_dyn::effects::Robot,
    motion: &'r Sines<3>,
    tuning: Tuning<3>,
}

impl Visit<3> for Breaks<'_> {
    fn visit<C: Controller<3>>(&mut self, entry: &'static Entry, controller: &C) {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308] {
            for place in 0..4 {
                let mut world = World::new(self.robot, self.motion, &self.tuning);
                let mut state = controller.at_rest();
                for k in 0..40 {
                    let good = world.input(1e-3 * f64::from(k), self.motion, entry);
                    let mut input = good;
                    if k == 30 {
                        [&mut input.q_meas, &mut input.q_ref, &mut input.v_ref, &mut input.a_ref][place][1] = bad;
                    }
                    let command = controller.step(&mut state, &input);
                    let limit = if entry.drives == Drives::Voltage { self.tuning.u_limit } else { self.tuning.tau_limit };
                    assert!((0..3).all(|i| command.tau[i].abs() <= limit[i]), "{} {place} {bad}: {command:?}", entry.name);
                    // PD and ADRC with nonlinear law do not read every signal.
                    let is_read = place < 2 || entry.name.starts_with("computed_torque");
                    if k >= 30 && is_read && !bad.is_finite() {
                        assert!(command.health.is_faulted, "{} {place} {bad}: {k}", entry.name);
                    }
                    if k < 30 {
                        assert!(!command.health.is_faulted);
                    }
                    world.advance(&command, entry);
                    if command.health.is_faulted && k > 30 {
                        break;
                    }
                }
            }
        }
    }
}

#[test]
fn numbers_that_are_none_latch_a_fault_and_every_command_is_finite_and_within_limits() {
    let robot = shipped_robot("prs3");
    let motion = Sines::about_the_middle(&robot, 0.04);
    let tuning = tuning::<3>(&robot, 25.0, 1e-3);
    every(&robot, &tuning, &mut Breaks { robot: &robot, motion: &motion, tuning }).expect("all can be built");
}

#[test]
fn small_limits_are_reported_and_kept() {
    let robot = shipped_robot("five_bar");
    let motion = Sines::<2>::about_the_middle(&robot, 0.2);
    let tight = Tuning { tau_limit: [1.5; 2], u_limit: [0.02; 2], ..tuning::<2>(&robot, 25.0, 1e-3) };
    let mut saturated = [0_u32; ALL.len()];
    let each = |entry: &'static Entry, _: u32, _: &Input<2>, command: &Command<2>| {
        let limit = if entry.drives == Drives::Voltage { 0.02 } else { 1.5 };
        assert!(command.tau.iter().all(|tau| tau.abs() <= limit) && !command.health.is_faulted, "{}: {command:?}", entry.name);
        let k = ALL.iter().position(|e| e == entry).expect("of the catalogue");
        saturated[k] += u32::from(command.health.is_saturated);
    };
    every(&robot, &tight, &mut Runs { robot: &robot, motion: &motion, tuning: tight, periods: 150, each }).expect("all can be built");
    assert!(saturated.iter().all(|&n| n > 0), "{saturated:?}");
}

#[test]
fn surplus_drives_are_moved_together_and_one_that_contradicts_the_others_is_a_fault() {
    use pkm_ctrl::observer::FirstDifference;
    use pkm_ctrl::{ComputedTorque, ComputedTorqueConfig};
    let robot = shipped_robot("ups4");
    let start: [f64; 4] = core::array::from_fn(|k| robot.model.assembly[robot.model.actuators[k]]);
    // The foot turns until four lengths almost agree again: 20 mm on one leg leave 0.5 mm.
    let config = ComputedTorqueConfig { misfit_limit: 1e-4, ..ComputedTorqueConfig::with_bandwidth(20.0, [2000.0; 4]) };
    let law = ComputedTorque::try_new(robot, FirstDifference, config).expect("four drives");
    let mut state = law.at_rest();
    let at_rest = law.step(&mut state, &Input::standing(start, 1e-3));
    assert!(!at_rest.health.is_faulted && at_rest.tau.iter().any(|tau| tau.abs() > 1.0), "{at_rest:?}");
    let mut slipped = start;
    slipped[2] += 0.02;
    let fault = law.step(&mut state, &Input::standing(slipped, 1e-3));
    assert!(fault.health.is_faulted, "{fault:?}");
    let same = (0..4).all(|k| math::abs(fault.tau[k] - at_rest.tau[k]) < 1e-9);
    assert!(same, "the weight stays carried: {fault:?} {at_rest:?}");
}
