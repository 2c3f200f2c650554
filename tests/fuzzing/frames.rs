//! Frames as they lie in shared memory, one behind the other, whoever wrote them: what comes of them is bounded, and moves nothing unasked.

use alloc::sync::Arc;

use pkm_daemon::gate::{Gate, GateLimits};
use pkm_hal::backends::Loopback;
use pkm_hal::frame::first_bits;
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, HalError, Limiter, MAX_AXES, ManualClock, Mode, SafeAction, SafeKind, StateFrame, Watchdog,
    WatchdogLimits,
};

const AXES: usize = 3;
const START_NS: u64 = 1_000_000_000;
const PERIOD_NS: u64 = 1_000_000;

/// Largest effort of the robot `[N]`.
const MOST: f64 = 100.0;

/// Commands to a guarded robot and states to a loop: as the bytes are, then with layout and checksum made good, or nothing behind them would
/// be reached.
pub fn frames(bytes: &[u8]) {
    for is_mended in [false, true] {
        commands(bytes, is_mended);
        states(bytes, is_mended);
    }
}

/// The bytes in frames; the last filled up with zeros.
fn whole<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.chunks(N).map(|chunk| {
        let mut out = [0; N];
        out[..chunk.len()].copy_from_slice(chunk);
        out
    })
}

fn commands(bytes: &[u8], is_mended: bool) {
    let clock = ManualClock::new(START_NS);
    let limits = WatchdogLimits::of_period(PERIOD_NS);
    let limited = Limiter::try_new(Loopback::new(AXES, &clock), &[AxisLimits::of_effort(MOST); AXES]).expect("limits");
    let mut robot = Watchdog::try_new(limited, &clock, limits, SafeAction::new(SafeKind::Ramp)).expect("a safe action");
    for given in whole::<{ CommandFrame::BYTES }>(bytes) {
        let read = CommandFrame::from_bytes(&given);
        assert_eq!(read.to_bytes(), given, "nothing is lost or made up");
        let frame = if is_mended { CommandFrame { layout: CommandFrame::LAYOUT, ..read }.sealed() } else { read };
        let was_armed = robot.is_armed();
        if robot.write(&frame).is_ok() {
            // Of another implementation.
            let crc = crc32fast::hash(&frame.to_bytes()[..CommandFrame::BYTES - 8]);
            assert_eq!((frame.layout, frame.checksum), (CommandFrame::LAYOUT, u64::from(crc)));
            assert!(was_armed || frame.mode != Mode::Effort.code(), "efforts of somebody who did not arm");
            assert!(frame.valid_until_ns <= clock.now_ns().saturating_add(limits.horizon_ns), "a command that outlives its commander");
        }
        clock.advance(PERIOD_NS);
        if let Ok(state) = robot.read() {
            state.check().expect("a state of a robot that is whole");
            assert!(state.tau[..AXES].iter().all(|tau| tau.abs() <= MOST), "{:?}", state.tau);
        }
    }
    // Whoever it was: nothing acts for longer than it was valid.
    clock.advance(limits.horizon_ns.max(SafeAction::new(SafeKind::Ramp).ramp_ns) + PERIOD_NS);
    let state = (0..3).map(|_| robot.read()).last().expect("three").expect("a state");
    assert!(!robot.is_armed() && state.tau.iter().all(|tau| *tau == 0.0), "{:?}", state.tau);
}

/// A driver that sends what it likes.
struct Sender(Result<StateFrame, HalError>);

impl Backend for Sender {
    fn n_axes(&self) -> usize {
        AXES
    }

    fn n_sensors(&self) -> usize {
        0
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.0
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        command.check(AXES).map(|_| ())
    }
}

fn states(bytes: &[u8], is_mended: bool) {
    let clock = ManualClock::new(START_NS);
    let limited = Limiter::try_new(Sender(Err(HalError::NoState)), &[AxisLimits::of_effort(MOST); AXES]).expect("limits");
    let action = SafeAction::new(SafeKind::Off);
    let mut robot = Watchdog::try_new(limited, &clock, WatchdogLimits::of_period(PERIOD_NS), action).expect("a safe action");
    let (late_ns, stale_ns, ahead_ns) = (3 * PERIOD_NS, 5 * PERIOD_NS, PERIOD_NS);
    let [speed, jump, stuck] = [[1.0; MAX_AXES], [0.01; MAX_AXES], [0.01; MAX_AXES]];
    let limits = GateLimits { late_ns, stale_ns, ahead_ns, speed, jump, stuck };
    let mut gates = [limits; 2].map(|limits| Gate::new(AXES, Arc::new(limits)));
    for given in whole::<{ StateFrame::BYTES }>(bytes) {
        let read = StateFrame::from_bytes(&given);
        assert_eq!(read.to_bytes(), given, "nothing is lost or made up");
        let frame = if is_mended { StateFrame { layout: StateFrame::LAYOUT, ..read }.sealed() } else { read };
        clock.advance(PERIOD_NS);
        let now_ns = clock.now_ns();
        robot.inner_mut().inner_mut().0 = Ok(frame);
        // Behind a watchdog of this process, and straight from shared memory.
        for (gate, read) in gates.iter_mut().zip([robot.read(), Ok(frame)]) {
            let is_new = gate.take(read, now_ns, 1e-3).is_new;
            gate.stuck(&[0.0; MAX_AXES]);
            if let (true, Some(state)) = (is_new, gate.state()) {
                state.check().expect("a believed state is whole");
                assert!(state.n_axes as usize == AXES && state.valid_q & first_bits(AXES) == first_bits(AXES));
                assert!(state.stamp_ns <= now_ns + ahead_ns, "from the future");
            }
            if gate.offence(now_ns).is_none() {
                assert!(gate.q().iter().all(|q| q.is_finite()), "{:?}", gate.q());
            }
        }
    }
}

/// A session as a daemon has it: arm, efforts, off.
pub(super) fn session() -> Vec<u8> {
    let modes = [Mode::Arm, Mode::Effort, Mode::Effort, Mode::Effort, Mode::Off];
    let frame = |(k, mode): (u64, Mode)| {
        let stamp_ns = START_NS + k * PERIOD_NS;
        let valid_until_ns = stamp_ns + 5 * PERIOD_NS;
        let mut frame =
            CommandFrame { nonce: 7, sequence: k + 1, stamp_ns, valid_until_ns, state_sequence: k, ..CommandFrame::new(AXES, mode) };
        frame.tau[..AXES].fill(if mode == Mode::Effort { 50.0 } else { 0.0 });
        frame.sealed().to_bytes()
    };
    (0..).zip(modes).flat_map(frame).collect()
}

/// States of a robot that moves slowly.
pub(super) fn motion() -> Vec<u8> {
    let frame = |k: u64| {
        let mut frame = StateFrame::new(AXES, 0);
        (frame.sequence, frame.stamp_ns, frame.valid_q, frame.valid_v) = (k, START_NS + k * PERIOD_NS, first_bits(AXES), first_bits(AXES));
        frame.q[..AXES].fill(0.15 + 1e-4 * k as f64);
        frame.v[..AXES].fill(0.1);
        frame.sealed().to_bytes()
    };
    (1..=8).flat_map(frame).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seeds that reach what they are for: a robot that is armed and moved, states that are believed.
    #[test]
    fn seeds_arm_move_and_are_believed() {
        let clock = ManualClock::new(START_NS);
        let limits = WatchdogLimits::of_period(PERIOD_NS);
        let mut robot = Watchdog::try_new(Loopback::new(AXES, &clock), &clock, limits, SafeAction::new(SafeKind::Off)).expect("a robot");
        // A command answers a state.
        robot.read().expect("a first state");
        let mut moved = 0.0_f64;
        for bytes in whole::<{ CommandFrame::BYTES }>(&session()) {
            robot.write(&CommandFrame::from_bytes(&bytes)).expect("a session of its own");
            clock.advance(PERIOD_NS);
            moved = moved.max(robot.read().expect("a state").tau[0]);
        }
        assert!((moved - 50.0).abs() < 1e-12, "{moved}");
        let ok = |bytes: [u8; StateFrame::BYTES]| StateFrame::from_bytes(&bytes).check().is_ok();
        assert!(whole::<{ StateFrame::BYTES }>(&motion()).all(ok));
    }
}
