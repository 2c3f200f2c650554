//! The loop's side: a robot in another process, as a backend.

use core::fmt;

use ::iceoryx2::prelude::{Node, ipc};

use super::place::{Lock, Place, Role, SharedError};
use super::service::{Deaf, Mended, Ours, Theirs, begin, listen, own};
use super::{CommandSlot, StateSlot};
use crate::backend::{Backend, HalError};
use crate::frame::{CommandFrame, StateFrame};

/// What came from the other side so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Received {
    /// Samples that were taken.
    pub taken: u64,
    /// Samples whose contents were refused.
    pub rejected: u64,
    /// Times its service was opened.
    pub opened: u64,
}

/// A robot whose driver runs in another process.
pub struct SharedRobot {
    // In this order when dropped: ports before the node, everything before the lock.
    states: Option<Theirs<StateSlot>>,
    commands: Ours<CommandSlot>,
    node: Node<ipc::Service>,
    place: Place,
    _lock: Lock,
    /// Which of the driver's services is listened to.
    number: Option<u32>,
    layout: Result<(), HalError>,
    state: Option<StateFrame>,
    counts: (usize, usize),
    received: Received,
    mended: Mended,
}

impl fmt::Debug for SharedRobot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, number, received, mended, .. } = self;
        let mut out = f.debug_struct("SharedRobot");
        out.field("place", place).field("number", number).field("received", received).field("mended", mended);
        out.field("is_heard", &self.commands.is_heard()).finish_non_exhaustive()
    }
}

impl SharedRobot {
    /// The robot whose driver meets this side in `place`, where this side holds the `lock` of [`Role::Daemon`], with `n_axes` axes and
    /// `n_sensors` further sensors. It need not run yet.
    ///
    /// # Errors
    /// The service for commands cannot be made.
    pub fn try_new(place: &Place, lock: Lock, n_axes: usize, n_sensors: usize) -> Result<Self, SharedError> {
        let mut node = begin(place, Role::Daemon)?;
        let (commands, mended) = own(&mut node, place, Role::Daemon, &lock, CommandFrame::LAYOUT)?;
        let mut robot = Self {
            states: None,
            commands,
            node,
            place: place.clone(),
            _lock: lock,
            number: None,
            layout: Ok(()),
            state: None,
            counts: (n_axes, n_sensors),
            received: Received::default(),
            mended,
        };
        robot.reconnect();
        Ok(robot)
    }

    /// What came so far.
    #[must_use]
    pub const fn received(&self) -> Received {
        self.received
    }

    /// What had to be mended at the start.
    #[must_use]
    pub const fn mended(&self) -> Mended {
        self.mended
    }

    /// Takes what came; the newest good state stays.
    fn drain(&mut self) {
        while let Some(slot) = self.next() {
            let state = StateFrame::from_bytes(&slot.bytes);
            self.received.taken += 1;
            match state.check() {
                Ok(()) => self.state = Some(state),
                Err(HalError::Layout { found, expected }) => self.layout = Err(HalError::Layout { found, expected }),
                Err(_) => self.received.rejected += 1,
            }
        }
    }

    /// The oldest state that was not taken yet.
    fn next(&mut self) -> Option<StateSlot> {
        match self.states.as_ref()?.next() {
            Ok(next) => next,
            // Looked for anew when nobody moves; until then the age of the last state tells.
            Err(Deaf) => {
                self.states = None;
                None
            }
        }
    }
}

/// Nobody takes commands.
const DEAF: HalError = HalError::Gone { code: 1 };

/// A command could not be handed over.
const LOST: HalError = HalError::Gone { code: 2 };

impl Backend for SharedRobot {
    fn n_axes(&self) -> usize {
        self.counts.0
    }

    fn n_sensors(&self) -> usize {
        self.counts.1
    }

    /// # Errors
    /// Also while nobody takes commands: a driver may send states before it has found this side, and would not hear that it is armed.
    fn read(&mut self) -> Result<StateFrame, HalError> {
        // Looked at every time: a driver that comes later is connected before the first command, not by it.
        let is_heard = self.commands.is_heard();
        self.drain();
        self.layout?;
        let state = self.state.ok_or(HalError::NoState)?;
        for (found, expected) in [(state.n_axes, self.counts.0), (state.n_sensors, self.counts.1)] {
            if found as usize != expected {
                return Err(HalError::Axes { found, expected: u32::try_from(expected).unwrap_or(u32::MAX) });
            }
        }
        if is_heard { Ok(state) } else { Err(DEAF) }
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        command.check(self.n_axes())?;
        if self.commands.send(CommandSlot { bytes: command.to_bytes() }) { Ok(()) } else { Err(LOST) }
    }

    /// Opens the driver's service where that is not the one listened to, and makes anew what could not be connected.
    fn reconnect(&mut self) {
        self.commands.mend();
        let Some((number, layout)) = self.place.number(Role::Driver) else { return };
        if layout != StateFrame::LAYOUT {
            self.layout = Err(HalError::Layout { found: layout, expected: StateFrame::LAYOUT });
            return;
        }
        if self.layout.is_err() {
            // Another driver since: what the old one sent is forgotten.
            (self.layout, self.state, self.states, self.number) = (Ok(()), None, None, None);
        }
        if self.number == Some(number) && self.states.is_some() {
            return;
        }
        if let Some(states) = listen(&self.node, &self.place, Role::Driver, number) {
            (self.states, self.number) = (Some(states), Some(number));
            self.received.opened += 1;
        }
    }
}
