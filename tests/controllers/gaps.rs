//! Gaps in the measurements, as a loop hands them over: positions are carried on meanwhile, and then all of the way is there at once.

use pkm_ctrl::catalogue::{Drives, Entry, Tuning, Visit, every};
use pkm_ctrl::{Controller, Input};
use pkm_dyn::effects::Robot;
use pkm_tests::closed_loop::{Sines, World, shipped_robot, tuning};

const DT: f64 = 1e-3;

/// Measured for the last time before the gap, while the drives are at their fastest.
const BEFORE: u32 = 1480;

/// What a gap of so many periods changes in the efforts of every controller.
struct Gaps<'r> {
    robot: &'r Robot,
    motion: &'r Sines<3>,
    tuning: Tuning<3>,
    missing: u32,
    /// Controller, and the largest difference of an effort from that without a gap `[N]`.
    out: Vec<(&'static str, f64)>,
}

impl Gaps<'_> {
    /// Efforts of every period until some time after the gap; a voltage counts by what it makes of the drive.
    fn efforts<C: Controller<3>>(&self, entry: &'static Entry, controller: &C, missing: u32) -> Vec<[f64; 3]> {
        let mut world = World::new(self.robot, self.motion, &self.tuning);
        let (mut state, mut past, mut u) = (controller.at_rest(), [[0.0; 3]; 2], [0.0; 3]);
        let mut out = Vec::new();
        for k in 0..BEFORE + 300 {
            let mut input = world.input(DT * f64::from(k), self.motion, entry);
            let lost = k.saturating_sub(BEFORE);
            if (1..=missing).contains(&lost) {
                let carried = |i: usize| past[1][i] + f64::from(lost) * (past[1][i] - past[0][i]);
                input = Input { q_meas: core::array::from_fn(carried), q_dt: 0.0, ..input };
            } else {
                input.q_dt = if lost == missing + 1 { f64::from(lost) * DT } else { DT };
                past = [past[1], input.q_meas];
            }
            let command = controller.step(&mut state, &input);
            assert!(!command.health.is_faulted, "{}: {k}", entry.name);
            let rate = |i: usize| self.tuning.b0[i] * (command.tau[i] - u[i]) / DT;
            out.push(if entry.drives == Drives::Voltage { core::array::from_fn(rate) } else { command.tau });
            u = command.tau;
            world.advance(&command, entry);
        }
        out
    }
}

impl Visit<3> for Gaps<'_> {
    fn visit<C: Controller<3>>(&mut self, entry: &'static Entry, controller: &C) {
        let [with, without] = [self.missing, 0].map(|missing| self.efforts(entry, controller, missing));
        let apart = with.iter().zip(&without).flat_map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).abs()));
        self.out.push((entry.name, apart.fold(0.0, f64::max)));
    }
}

#[test]
fn a_gap_in_the_measurements_changes_efforts_by_no_more_than_what_nobody_saw() {
    let robot = shipped_robot("prs3");
    let motion = Sines::about_the_middle(&robot, 0.04);
    let (tuning, w) = (tuning::<3>(&robot, 25.0, DT), 25.0);
    for missing in [1, 3, 5, 50] {
        let mut gaps = Gaps { robot: &robot, motion: &motion, tuning, missing, out: Vec::new() };
        every(&robot, &tuning, &mut gaps).expect("all can be built");
        // The drives accelerate by 0.31 m/s² at most, some 40 kg each: stiffness and damping times how far position and velocity can be
        // off, twice that for the law with an integral and three poles.
        let time = DT * f64::from(missing + 1);
        let most = 2.0 * 40.0 * 0.31 * (0.5 * w * w * time * time + 2.0 * w * time);
        for (name, apart) in gaps.out {
            // A law that switches answers the least error with all it has.
            assert!(apart < most || name == "adrc_nonlinear", "{name}, {missing} missing: {apart} N, {most} to be expected");
        }
    }
}
