//! What a daemon recorded is done again to the bit: two laws, frames that were lost on the way, a safe stop and what came after it.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use std::path::{Path, PathBuf};

use pkm_ctrl::{Running, Signals};
use pkm_daemon::{Order, OrderKind};
use pkm_hal::{CycleRecord, Fault, Injection, ManualClock, Phase, Signal};
use pkm_record::ReadOptions;
use pkm_record::cycles::{Folder, Layout, Options, Recorder};
use rig::{CONTROLLER, controller, rig};

/// A law that answers otherwise.
fn softer() -> String {
    CONTROLLER.replace("bandwidth = 20.0", "bandwidth = 12.0")
}

/// Written as the daemon's own thread does.
fn write(records: &[CycleRecord], folder: &Path) -> PathBuf {
    let names = ["q1", "q6", "q8"].map(str::to_string).to_vec();
    let layout = Layout { joints: names, ..Layout::default() };
    let options = Options { stem: "loop".to_string(), ..Options::default() };
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder)), layout, options, 0).unwrap();
    records.iter().for_each(|record| recorder.push(record, record.done_ns));
    let (tally, outcome) = recorder.finish(0);
    outcome.unwrap();
    assert_eq!((tally.written, tally.lost), (records.len() as u64, 0));
    folder.join("loop_0001.mcap")
}

/// Does every step again with controllers at rest: number, whether it is one of the other law, and whether any bit differs.
fn again(path: &Path, laws: &mut [Box<dyn Running>; 2]) -> Vec<(u64, bool, bool)> {
    let mut out = Vec::new();
    pkm_record::read_controls(path, &ReadOptions::default(), &mut |step| {
        let given = step.as_control();
        let law = &mut laws[usize::from(given.is_other_law)];
        if given.is_first {
            law.reset();
        }
        let mut tau = vec![0.0; given.command.len()];
        let signals = Signals {
            dt: given.dt,
            q_dt: given.q_dt,
            q_meas: given.q_meas,
            tau_meas: given.tau_meas,
            wrench_meas: given.wrench_meas,
            q_ref: given.q_ref,
            v_ref: given.v_ref,
            a_ref: given.a_ref,
            wrench_ref: given.wrench_ref,
            tau_ff: given.tau_ff,
        };
        law.step(&signals, &mut tau);
        let differs = tau.iter().zip(given.command).any(|(a, b)| a.to_bits() != b.to_bits());
        out.push((step.number, given.is_other_law, differs));
    })
    .unwrap();
    out
}

#[test]
fn every_step_of_a_session_with_faults_comes_back_to_the_bit() {
    let clock = ManualClock::new(0);
    // Reads are periods here. Positions that are carried on over a gap are not those of any frame.
    let q = Signal::Position;
    let gap = |from: u64, to: u64, fault: Fault| Injection { from, to, fault };
    let script = [
        gap(700, 702, Fault::Drop),
        gap(720, 722, Fault::NotANumber { signal: q, axis: 1 }),
        gap(740, 741, Fault::Offset { signal: q, axis: 0, by: 0.02 }),
        gap(1100, 1300, Fault::Drop),
    ];
    let mut rig = rig(&script, &clock);
    rig.playing();
    rig.periods(400);
    // Late periods are told to the controller.
    rig.period_of(12_000_000, 0);
    rig.plain(OrderKind::Stop).unwrap();
    rig.until(Phase::Holding, 400);
    let other = pkm_ctrl::config::parse(&softer(), "softer", &rig.robot).unwrap();
    let hold = Some(controller(&rig.robot));
    rig.order(Order { controller: Some(other), hold, phase: Phase::Force, ..Order::plain(OrderKind::Start, 0) }).unwrap();
    rig.until(Phase::SafeStop, 2000);
    rig.periods(250);
    rig.plain(OrderKind::ClearFault).unwrap();
    rig.arm().unwrap();
    rig.until(Phase::Holding, 2000);
    rig.periods(50);

    let folder = tempfile::tempdir().unwrap();
    let path = write(&rig.records, folder.path());
    let laws = || [controller(&rig.robot), pkm_ctrl::config::parse(&softer(), "softer", &rig.robot).unwrap()];
    let steps = again(&path, &mut laws());
    let wrong = steps.iter().find(|(.., differs)| *differs);
    assert_eq!(wrong, None, "of {} steps", steps.len());
    let moving = rig.records.iter().filter(|r| Phase::of(r.phase).is_some_and(Phase::is_moving)).count();
    let of_other = steps.iter().filter(|(_, is_other, _)| *is_other).count();
    // One for every period that ended moving; the one that ended a stop did one as well, or was stopped before it.
    assert!((moving..=moving + 2).contains(&steps.len()), "{} steps in {moving} periods", steps.len());
    assert!(of_other > 50 && of_other < steps.len() / 2, "{of_other} of {}", steps.len());

    // A command that is off by its last bit, and a position that the controller did not see.
    let at = rig.records.iter().position(|r| r.phase == Phase::Position.code()).unwrap() + 100;
    let mut forged = rig.records.clone();
    forged[at].tau_answer[1] = f64::from_bits(forged[at].tau_answer[1].to_bits() ^ 1);
    let folder = tempfile::tempdir().unwrap();
    let differing: Vec<u64> =
        again(&write(&forged, folder.path()), &mut laws()).iter().filter(|(.., differs)| *differs).map(|(number, ..)| *number).collect();
    assert_eq!(differing, [forged[at].cycle]);
    let mut moved = rig.records.clone();
    moved[at].q_given[0] += 1e-6;
    let folder = tempfile::tempdir().unwrap();
    let first = again(&write(&moved, folder.path()), &mut laws()).iter().find(|(.., differs)| *differs).map(|(number, ..)| *number);
    assert_eq!(first, Some(moved[at].cycle));
}
