//! The robot's side: a backend of this process, for a loop in another one.

use core::fmt;

use ::iceoryx2::prelude::{Node, ipc};

use super::place::{Lock, Place, Role, SharedError};
use super::service::{Deaf, Mended, Ours, Theirs, begin, listen, own};
use super::{CommandSlot, StateSlot};
use crate::backend::{Backend, HalError};
use crate::frame::{CommandFrame, StateFrame};

/// Turns without a command after which the loop is looked for in another place.
const SILENT: u32 = 50;

/// What a driver did so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Served {
    /// Commands that the robot took.
    pub taken: u64,
    /// Commands that it refused.
    pub refused: u64,
    /// Why it refused the last of them.
    pub last: Option<HalError>,
    /// States that were sent.
    pub sent: u64,
    /// Times the loop's service was opened.
    pub opened: u64,
}

/// A robot in this process, offered to a loop in another one.
pub struct SharedDriver {
    // In this order when dropped: ports before the node, everything before the lock.
    commands: Option<Theirs<CommandSlot>>,
    states: Ours<StateSlot>,
    node: Node<ipc::Service>,
    place: Place,
    _lock: Lock,
    /// Which of the loop's services is listened to.
    number: Option<u32>,
    silent: u32,
    served: Served,
    mended: Mended,
}

impl fmt::Debug for SharedDriver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, number, served, mended, .. } = self;
        let mut out = f.debug_struct("SharedDriver");
        out.field("place", place).field("number", number).field("served", served).field("mended", mended).finish_non_exhaustive()
    }
}

impl SharedDriver {
    /// A driver that meets its loop in `place`, where it holds the `lock` of [`Role::Driver`]. The loop need not run yet.
    ///
    /// # Errors
    /// The service for states cannot be made.
    pub fn try_new(place: &Place, lock: Lock) -> Result<Self, SharedError> {
        let mut node = begin(place, Role::Driver)?;
        let (states, mended) = own(&mut node, place, Role::Driver, &lock, StateFrame::LAYOUT)?;
        let mut driver = Self {
            commands: None,
            states,
            node,
            place: place.clone(),
            _lock: lock,
            number: None,
            silent: 0,
            served: Served::default(),
            mended,
        };
        driver.reconnect();
        Ok(driver)
    }

    /// What was done so far.
    #[must_use]
    pub const fn served(&self) -> &Served {
        &self.served
    }

    /// What had to be mended at the start.
    #[must_use]
    pub const fn mended(&self) -> Mended {
        self.mended
    }

    /// One turn: every command that came goes to `hal`, in order, and its state to the loop.
    ///
    /// `hal` must end a session whose commands stay away, as [`crate::Watchdog`] does: nothing here will.
    ///
    /// # Errors
    /// The robot has no state.
    pub fn serve<B: Backend + ?Sized>(&mut self, hal: &mut B) -> Result<StateFrame, HalError> {
        let mut came = false;
        while let Some(slot) = self.next() {
            came = true;
            match hal.write(&CommandFrame::from_bytes(&slot.bytes)) {
                Ok(()) => self.served.taken += 1,
                Err(error) => {
                    self.served.refused += 1;
                    self.served.last = Some(error);
                }
            }
        }
        self.silent = if came { 0 } else { self.silent.saturating_add(1) };
        if self.silent >= SILENT {
            self.silent = 0;
            self.reconnect();
        }
        let state = hal.read()?;
        self.publish(&state);
        Ok(state)
    }

    /// Sends a state as it is.
    pub fn publish(&mut self, state: &StateFrame) {
        // Without memory for it the state is lost, which its age will tell.
        self.served.sent += u64::from(self.states.send(StateSlot { bytes: state.to_bytes() }));
    }

    /// The oldest command that was not taken yet.
    fn next(&mut self) -> Option<CommandSlot> {
        match self.commands.as_ref()?.next() {
            Ok(next) => next,
            Err(Deaf) => {
                self.commands = None;
                None
            }
        }
    }

    /// Opens the loop's service where that is not the one listened to, and makes anew what could not be connected.
    fn reconnect(&mut self) {
        self.states.mend();
        let Some((number, layout)) = self.place.number(Role::Daemon) else { return };
        if layout != CommandFrame::LAYOUT || (self.number == Some(number) && self.commands.is_some()) {
            return;
        }
        if let Some(commands) = listen(&self.node, &self.place, Role::Daemon, number) {
            (self.commands, self.number) = (Some(commands), Some(number));
            self.served.opened += 1;
        }
    }
}
