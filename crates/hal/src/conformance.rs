//! What every backend must do, as checks that any test can run on it.
//!
//! A rule that is broken is returned, not panicked on: [`check_device`] for anything that implements [`Backend`], [`check_guarded`] for a
//! whole HAL, a device behind a [`crate::Watchdog`].

use core::fmt;

use crate::backend::{Backend, HalError};
use crate::clock::Clock;
use crate::frame::{CommandFrame, Mode, StateFrame, status};

/// A rule that a backend broke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Breach {
    /// The rule.
    pub rule: &'static str,
    /// The error that was returned where none should have been, or the wrong one.
    pub error: Option<HalError>,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.error {
            Some(error) => write!(f, "{}: {error}", self.rule),
            None => f.write_str(self.rule),
        }
    }
}

impl core::error::Error for Breach {}

fn keep(rule: &'static str, is_kept: bool) -> Result<(), Breach> {
    if is_kept { Ok(()) } else { Err(Breach { rule, error: None }) }
}

fn succeed<T>(rule: &'static str, outcome: Result<T, HalError>) -> Result<T, Breach> {
    outcome.map_err(|error| Breach { rule, error: Some(error) })
}

/// Reads in which a device across a process border may have taken a command or made a state.
const PATIENCE: usize = 100_000;

/// The state, once there is one.
fn state<B: Backend>(hal: &mut B) -> Result<StateFrame, Breach> {
    let mut last = hal.read();
    for _ in 0..PATIENCE {
        if last != Err(HalError::NoState) {
            break;
        }
        last = hal.read();
    }
    succeed("a state comes without any command", last)
}

/// The first state in which command `sequence` was taken.
fn state_after<B: Backend>(hal: &mut B, sequence: u64) -> Result<StateFrame, Breach> {
    let mut last = state(hal)?;
    for _ in 0..PATIENCE {
        if last.command_sequence == sequence {
            break;
        }
        last = state(hal)?;
    }
    keep("the sequence of an accepted command is acknowledged", last.command_sequence == sequence)?;
    Ok(last)
}

fn command<B: Backend>(hal: &B, mode: Mode, nonce: u64, sequence: u64) -> CommandFrame {
    CommandFrame { nonce, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(hal.n_axes(), mode) }
}

/// Whether a device keeps the contract of [`Backend`].
///
/// It must stand in a state in which commands without efforts are harmless. Sequences of commands must be new to it.
///
/// # Errors
/// The first rule it breaks.
pub fn check_device<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    states_can_be_believed(hal)?;
    states_never_go_back(hal)?;
    commands_are_acknowledged(hal)?;
    broken_commands_change_nothing(hal)?;
    garbage_is_survived(hal)
}

fn states_can_be_believed<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    let first = state(hal)?;
    succeed("a state passes its own check", first.check())?;
    keep("a state has the axes of its backend", first.n_axes as usize == hal.n_axes())?;
    keep("a state has the sensors of its backend", first.n_sensors as usize == hal.n_sensors())?;
    keep("something is measured", first.valid_q | first.valid_v | first.valid_tau | first.valid_sensor != 0)
}

fn states_never_go_back<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    let mut last = state(hal)?;
    let first = last;
    for sequence in 1..=50 {
        succeed("a command without efforts is accepted", hal.write(&command(hal, Mode::Effort, 1, sequence).sealed()))?;
        for _ in 0..3 {
            let next = state(hal)?;
            succeed("a state passes its own check", next.check())?;
            keep("sequences of states never fall", next.sequence >= last.sequence)?;
            keep("stamps never fall", next.stamp_ns >= last.stamp_ns)?;
            keep("a state of the same sequence is the same", next.sequence != last.sequence || next == last)?;
            last = next;
        }
    }
    for _ in 0..PATIENCE {
        if last.sequence > first.sequence {
            break;
        }
        last = state(hal)?;
    }
    keep("fifty commands later there is a new state", last.sequence > first.sequence)
}

fn commands_are_acknowledged<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    for (sequence, mode) in (100..).zip([Mode::Off, Mode::Effort, Mode::Effort, Mode::Off]) {
        succeed("power off and efforts are accepted", hal.write(&command(hal, mode, 0xFACE, sequence).sealed()))?;
        let after = state_after(hal, sequence)?;
        keep("the nonce of an accepted command is acknowledged", after.nonce == 0xFACE)?;
        let again = state(hal)?;
        keep("reading commands nothing", again.command_sequence == sequence)?;
    }
    match hal.write(&command(hal, Mode::Brake, 0xFACE, 200).sealed()) {
        Ok(()) => state_after(hal, 200).map(|_| ()),
        Err(HalError::Mode { .. }) => Ok(()),
        Err(error) => Err(Breach { rule: "brakes are applied, or refused as a mode it has not", error: Some(error) }),
    }
}

fn broken_commands_change_nothing<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    succeed("efforts are accepted", hal.write(&command(hal, Mode::Effort, 1, 300).sealed()))?;
    state_after(hal, 300)?;
    let good = command(hal, Mode::Effort, 1, 301);
    let mut nan = good;
    nan.tau[0] = f64::NAN;
    let mut infinite = good;
    infinite.tau[hal.n_axes().saturating_sub(1)] = f64::NEG_INFINITY;
    let broken = [
        ("an effort that is not a number is refused", nan.sealed()),
        ("an infinite effort is refused", infinite.sealed()),
        ("a wrong checksum is refused", CommandFrame { checksum: 1, ..good }),
        ("another layout is refused", CommandFrame { layout: !CommandFrame::LAYOUT, ..good }.sealed()),
        ("an axis too many is refused", CommandFrame { n_axes: good.n_axes + 1, ..good }.sealed()),
        ("no axes are refused", CommandFrame { n_axes: 0, ..good }.sealed()),
        ("a mode that is none is refused", CommandFrame { mode: 77, ..good }.sealed()),
    ];
    for (rule, frame) in broken {
        keep(rule, hal.write(&frame).is_err())?;
        keep("a refused command changes nothing", state(hal)?.command_sequence == 300)?;
    }
    Ok(())
}

fn garbage_is_survived<B: Backend>(hal: &mut B) -> Result<(), Breach> {
    let mut bits = 0x9E37_79B9_7F4A_7C15_u64;
    for _ in 0..200 {
        let mut bytes = [0; CommandFrame::BYTES];
        for byte in &mut bytes {
            // Xorshift (Marsaglia): any period longer than the test does.
            bits ^= bits << 13;
            bits ^= bits >> 7;
            bits ^= bits << 17;
            *byte = bits.to_le_bytes()[3];
        }
        let garbage = CommandFrame::from_bytes(&bytes);
        keep("garbage is refused", hal.write(&garbage).is_err())?;
        let sealed = CommandFrame { layout: CommandFrame::LAYOUT, ..garbage }.sealed();
        keep("sealed garbage is refused", hal.write(&sealed).is_err() || sealed.check(hal.n_axes()).is_ok())?;
    }
    succeed("the state after garbage passes its check", state(hal)?.check())
}

/// Whether a whole HAL keeps robots from strangers, replays and dead commanders.
///
/// `pass` lets time pass on its clock, in nanoseconds. The HAL must not be armed, and must not have known the nonces 11 to 13.
/// Commands are valid for `horizon_ns`, which must be within its limits and long against the time between calls.
///
/// # Errors
/// The first rule it breaks.
pub fn check_guarded<B: Backend, C: Clock>(
    hal: &mut B,
    clock: &C,
    horizon_ns: u64,
    pass: &mut dyn FnMut(&mut B, u64),
) -> Result<(), Breach> {
    let until = |mode, nonce, sequence, hal: &B| {
        let now_ns = clock.now_ns();
        CommandFrame { stamp_ns: now_ns, valid_until_ns: now_ns + horizon_ns, ..command(hal, mode, nonce, sequence) }.sealed()
    };
    let refused = |hal: &mut B, rule, frame: &CommandFrame| keep(rule, hal.write(frame).is_err());
    state(hal)?;
    let early = until(Mode::Effort, 11, 1, hal);
    refused(hal, "nothing moves before it is armed", &early)?;
    let nameless = until(Mode::Arm, 0, 1, hal);
    refused(hal, "a session needs a nonce", &nameless)?;
    let arm = until(Mode::Arm, 11, 1, hal);
    succeed("a fresh nonce arms", hal.write(&arm))?;
    let effort = until(Mode::Effort, 11, 2, hal);
    succeed("an armed session commands", hal.write(&effort))?;
    state_after(hal, 2)?;
    refused(hal, "a command is not taken twice", &effort)?;
    let stranger = until(Mode::Effort, 12, 3, hal);
    refused(hal, "a stranger does not command", &stranger)?;
    let usurper = until(Mode::Arm, 12, 1, hal);
    refused(hal, "a stranger does not arm while a session is open", &usurper)?;
    let endless = CommandFrame { valid_until_ns: u64::MAX, ..until(Mode::Effort, 11, 3, hal) }.sealed();
    refused(hal, "a command that never expires is refused", &endless)?;
    pass(hal, horizon_ns + 1);
    let state_after_silence = state(hal)?;
    keep("a commander that falls silent loses the robot", state_after_silence.status & status::SAFE != 0)?;
    let late = until(Mode::Effort, 11, 4, hal);
    refused(hal, "a session that ended does not come back", &late)?;
    let again = until(Mode::Arm, 11, 5, hal);
    refused(hal, "nor does its nonce", &again)?;
    refused(hal, "nor a recorded command", &arm)?;
    let fresh = until(Mode::Arm, 13, 1, hal);
    succeed("a fresh nonce arms again", hal.write(&fresh))?;
    keep("arming alone does not end the safe action", state(hal)?.status & status::SAFE != 0)?;
    let effort = until(Mode::Effort, 13, 2, hal);
    succeed("and commands", hal.write(&effort))?;
    let after = state_after(hal, 2)?;
    keep("efforts end the safe action", after.status & status::SAFE == 0)?;
    let off = until(Mode::Off, 13, 3, hal);
    succeed("a session can be ended", hal.write(&off))?;
    let after_off = until(Mode::Effort, 13, 4, hal);
    refused(hal, "and is over then", &after_off)
}
