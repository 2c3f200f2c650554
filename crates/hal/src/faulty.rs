//! A backend with faults: what sensors, wires and drives do when they fail, from a script, the same every time.

use crate::backend::{Backend, HalError};
use crate::frame::{CommandFrame, MAX_AXES, Mode, Signal, StateFrame};

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// A measured value is not a number.
    NotANumber {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
    },
    /// A measured value is infinite.
    Infinite {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
    },
    /// One value stays what it was while stamp and sequence go on.
    Stuck {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
    },
    /// The value is not measured any more: zero, and its bit is off.
    Unplugged {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
    },
    /// The frame never arrives and the one before stays the newest: over several reads, frozen state.
    Drop,
    /// The frame before comes once more and the new one later: nothing is lost.
    Duplicate,
    /// The device is gone: neither states nor commands pass.
    Vanish,
    /// A frame from so many reads ago (up to 7) comes in place of the new one: out of order for one read, a delay for many.
    Older {
        /// How many reads ago.
        by: usize,
    },
    /// A value is off by this much, in its own unit: a jump at its begin and back at its end.
    Offset {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
        /// By how much.
        by: f64,
    },
    /// A value drifts, so much per second.
    Drift {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
        /// Per second, in the signal's own unit.
        per_s: f64,
        /// Stamp at which it is right `[ns]`.
        since_ns: u64,
    },
    /// A value has the wrong sign.
    Flip {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
    },
    /// A sensor shows no more than so much either way.
    Ceiling {
        /// Of which signal.
        signal: Signal,
        /// Which axis or sensor.
        axis: usize,
        /// The most it shows.
        most: f64,
    },
    /// One bit of the frame is flipped after it was sealed.
    Corrupt {
        /// Which, from the first byte's lowest on.
        bit: usize,
    },
    /// The frame is that of a program with another layout.
    OtherLayout,
    /// The frame says somebody else's command was accepted.
    OtherNonce {
        /// Whose.
        nonce: u64,
    },
    /// The device's clock was set: stamps are off by so much.
    ClockStep {
        /// Ahead, or negative, back `[ns]`.
        by_ns: i64,
    },
    /// The device's clock stands: stamps stay what they were while sequence and values go on.
    ClockStands,
    /// The drive does nothing.
    DeadDrive {
        /// Which axis.
        axis: usize,
    },
    /// The drive gives no more than so much either way `[N | N·m]`.
    WeakDrive {
        /// Which axis.
        axis: usize,
        /// The most it gives.
        most: f64,
    },
    /// The drive pushes the other way.
    ReversedDrive {
        /// Which axis.
        axis: usize,
    },
    /// Commands are lost on their way, and nobody says so.
    LostCommand,
}

/// A fault and when it acts: from read (drives: write) number `from`, the first being 0, until before number `to`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Injection {
    /// First.
    pub from: u64,
    /// First that is well again.
    pub to: u64,
    /// What goes wrong.
    pub fault: Fault,
}

/// Frames that are remembered: [`Fault::Older`] reaches this far back.
const REMEMBERED: usize = 8;

/// A backend with the faults of a script. Faults that act at once are applied in the script's order.
#[derive(Debug, Clone)]
pub struct FaultyHal<'s, B> {
    inner: B,
    script: &'s [Injection],
    reads: u64,
    writes: u64,
    /// True frames by read, a ring.
    history: [Option<StateFrame>; REMEMBERED],
    /// What was returned last.
    shown: Option<StateFrame>,
}

impl<'s, B: Backend> FaultyHal<'s, B> {
    /// Does to `inner` what `script` says.
    #[must_use]
    pub fn new(inner: B, script: &'s [Injection]) -> Self {
        Self { inner, script, reads: 0, writes: 0, history: [None; REMEMBERED], shown: None }
    }

    /// The backend inside, without faults.
    pub const fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    /// A frame of `by` reads before read number `read`, at most as old as is remembered.
    fn older(&self, read: u64, by: usize) -> Option<StateFrame> {
        let back = u64::try_from(by.min(REMEMBERED - 1)).unwrap_or(0);
        read.checked_sub(back).and_then(|read| self.history[slot(read)])
    }
}

fn slot(read: u64) -> usize {
    usize::try_from(read % REMEMBERED as u64).unwrap_or(0)
}

/// What a fault does to the contents of a frame before it is sealed.
fn distort(fault: &Fault, state: &mut StateFrame, shown: Option<&StateFrame>) {
    let stamp_ns = state.stamp_ns;
    let mut set = |signal: Signal, axis: usize, change: &dyn Fn(f64) -> f64| {
        if let Some(x) = state.values_mut(signal).get_mut(axis) {
            *x = change(*x);
        }
    };
    match *fault {
        Fault::NotANumber { signal, axis } => set(signal, axis, &|_| f64::NAN),
        Fault::Infinite { signal, axis } => set(signal, axis, &|_| f64::INFINITY),
        Fault::Stuck { signal, axis } => {
            let last = shown.and_then(|shown| shown.values(signal).get(axis).copied());
            set(signal, axis, &|x| last.unwrap_or(x));
        }
        Fault::Offset { signal, axis, by } => set(signal, axis, &|x| x + by),
        Fault::Drift { signal, axis, per_s, since_ns } => {
            let passed_s = stamp_ns.saturating_sub(since_ns) as f64 * 1e-9;
            set(signal, axis, &|x| x + per_s * passed_s);
        }
        Fault::Flip { signal, axis } => set(signal, axis, &|x| -x),
        Fault::Ceiling { signal, axis, most } => set(signal, axis, &|x| x.max(-most).min(most)),
        Fault::Unplugged { signal, axis } => {
            set(signal, axis, &|_| 0.0);
            let valid = match signal {
                Signal::Position => &mut state.valid_q,
                Signal::Velocity => &mut state.valid_v,
                Signal::Effort => &mut state.valid_tau,
                Signal::Sensor => &mut state.valid_sensor,
            };
            *valid &= !(1_u32.checked_shl(u32::try_from(axis).unwrap_or(32)).unwrap_or(0));
        }
        Fault::OtherLayout => state.layout = !StateFrame::LAYOUT,
        Fault::OtherNonce { nonce } => state.nonce = nonce,
        Fault::ClockStep { by_ns } => state.stamp_ns = stamp_ns.saturating_add_signed(by_ns),
        Fault::ClockStands => state.stamp_ns = shown.map_or(stamp_ns, |shown| shown.stamp_ns),
        Fault::Drop
        | Fault::Duplicate
        | Fault::Vanish
        | Fault::Older { .. }
        | Fault::Corrupt { .. }
        | Fault::DeadDrive { .. }
        | Fault::WeakDrive { .. }
        | Fault::ReversedDrive { .. }
        | Fault::LostCommand => {}
    }
}

/// What a fault makes of the efforts.
fn weaken(fault: &Fault, tau: &mut [f64; MAX_AXES]) {
    let mut set = |axis: usize, change: &dyn Fn(f64) -> f64| {
        if let Some(x) = tau.get_mut(axis) {
            *x = change(*x);
        }
    };
    match *fault {
        Fault::DeadDrive { axis } => set(axis, &|_| 0.0),
        Fault::WeakDrive { axis, most } => set(axis, &|x| x.max(-most).min(most)),
        Fault::ReversedDrive { axis } => set(axis, &|x| -x),
        _ => {}
    }
}

fn acting(script: &[Injection], at: u64) -> impl Iterator<Item = &Injection> {
    script.iter().filter(move |injection| (injection.from..injection.to).contains(&at))
}

impl<B: Backend> Backend for FaultyHal<'_, B> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let read = self.reads;
        self.reads += 1;
        for injection in acting(self.script, read) {
            match injection.fault {
                Fault::Vanish => return Err(HalError::Gone { code: 0 }),
                Fault::Duplicate => return self.shown.ok_or(HalError::NoState),
                _ => {}
            }
        }
        let truth = self.inner.read()?;
        self.history[slot(read)] = Some(truth);
        let mut state = truth;
        for injection in acting(self.script, read) {
            match injection.fault {
                Fault::Drop => return self.shown.ok_or(HalError::NoState),
                Fault::Older { by } => state = self.older(read, by).unwrap_or(state),
                ref fault => distort(fault, &mut state, self.shown.as_ref()),
            }
        }
        state = state.sealed();
        for injection in acting(self.script, read) {
            if let Fault::Corrupt { bit } = injection.fault {
                let mut bytes = state.to_bytes();
                let bit = bit % (8 * StateFrame::BYTES);
                bytes[bit / 8] ^= 1 << (bit % 8);
                state = StateFrame::from_bytes(&bytes);
            }
        }
        self.shown = Some(state);
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        let write = self.writes;
        self.writes += 1;
        let mut command = *command;
        for injection in acting(self.script, write) {
            match injection.fault {
                Fault::LostCommand => return Ok(()),
                Fault::Vanish => return Err(HalError::Gone { code: 0 }),
                _ => {}
            }
            if mode == Mode::Effort {
                weaken(&injection.fault, &mut command.tau);
            }
        }
        self.inner.write(&command.sealed())
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }

    fn reconnect(&mut self) {
        self.inner.reconnect();
    }
}

#[cfg(test)]
mod tests;
