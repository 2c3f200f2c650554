//! The loop's side: a robot in another process, as a backend.

use core::fmt;

use ::iceoryx2::port::publisher::Publisher;
use ::iceoryx2::port::subscriber::Subscriber;
use ::iceoryx2::prelude::{Node, ipc};

use super::place::{Lock, Place, Role, SharedError};
use super::service::{Mended, Opened, begin, listen, own};
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
    states: Option<Opened<Subscriber<ipc::Service, StateSlot, ()>, StateSlot>>,
    commands: Opened<Publisher<ipc::Service, CommandSlot, ()>, CommandSlot>,
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
        out.field("place", place).field("number", number).field("received", received).field("mended", mended).finish_non_exhaustive()
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
    fn drain(&mut self) -> Result<(), HalError> {
        let Some(states) = &self.states else { return Ok(()) };
        // An error is a connection that cannot be made: the age of the last state tells soon enough.
        while let Ok(Some(sample)) = states.port.receive() {
            let state = StateFrame::from_bytes(&sample.payload().bytes);
            self.received.taken += 1;
            match state.check() {
                Ok(()) => self.state = Some(state),
                Err(HalError::Layout { found, expected }) => self.layout = Err(HalError::Layout { found, expected }),
                Err(_) => self.received.rejected += 1,
            }
        }
        Ok(())
    }
}

impl Backend for SharedRobot {
    fn n_axes(&self) -> usize {
        self.counts.0
    }

    fn n_sensors(&self) -> usize {
        self.counts.1
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.drain()?;
        self.layout?;
        let state = self.state.ok_or(HalError::NoState)?;
        for (found, expected) in [(state.n_axes, self.counts.0), (state.n_sensors, self.counts.1)] {
            if found as usize != expected {
                return Err(HalError::Axes { found, expected: u32::try_from(expected).unwrap_or(u32::MAX) });
            }
        }
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        command.check(self.n_axes())?;
        let gone = HalError::Gone { code: 2 };
        let loan = self.commands.port.loan_uninit().map_err(|_| gone)?;
        let sample = loan.write_payload(CommandSlot { bytes: command.to_bytes() });
        sample.send().map(|_| ()).map_err(|_| gone)
    }

    /// Opens the driver's service where that is not the one listened to.
    fn reconnect(&mut self) {
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
        if let Some(states) = listen(&self.node, Role::Driver, number) {
            (self.states, self.number) = (Some(states), Some(number));
            self.received.opened += 1;
        }
    }
}
