//! What is asked of a loop from outside: prepared where allocating is allowed, taken in the loop where it is not.

use core::fmt;

use pkm_ctrl::Running;
use pkm_hal::{Cause, Phase};

use crate::motion::Motion;

/// What is asked, in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderKind {
    /// Enable: from ready to homing or holding.
    Arm,
    /// Play: from holding to one of the running phases.
    Start,
    /// Slow down along the path and hold.
    Stop,
    /// The safe action, now.
    SafeStop,
    /// Reset after a safe stop or a fault.
    ClearFault,
    /// Power off; not while it plays.
    Off,
}

impl OrderKind {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Arm, Self::Start, Self::Stop, Self::SafeStop, Self::ClearFault, Self::Off];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Start => "start",
            Self::Stop => "stop",
            Self::SafeStop => "safe-stop",
            Self::ClearFault => "clear-fault",
            Self::Off => "off",
        }
    }

    /// The one of that name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// An order with everything the loop needs for it.
pub struct Order {
    /// What is asked.
    pub kind: OrderKind,
    /// Counts orders, for the answer.
    pub id: u64,
    /// Why, where it is not a person who asks.
    pub cause: Cause,
    /// A number that no session had before, for [`OrderKind::Arm`].
    pub nonce: u64,
    /// A controller at rest: for [`OrderKind::Arm`], and for a [`OrderKind::Start`] under another law.
    pub controller: Option<Box<dyn Running>>,
    /// The controller to return to after another law, at rest.
    pub hold: Option<Box<dyn Running>>,
    /// What is played, for [`OrderKind::Start`].
    pub motion: Option<Box<dyn Motion>>,
    /// Phase in which it is played.
    pub phase: Phase,
    /// How long a law of contact or an exercise runs that is played without a motion `[s]`; none: until it is stopped.
    pub length_s: Option<f64>,
}

impl Order {
    /// An order that needs nothing.
    #[must_use]
    pub fn plain(kind: OrderKind, id: u64) -> Self {
        let (controller, hold, motion, phase, length_s) = (None, None, None, Phase::Position, None);
        Self { kind, id, cause: Cause::Order, nonce: 0, controller, hold, motion, phase, length_s }
    }
}

impl fmt::Debug for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Order").field("kind", &self.kind).field("id", &self.id).field("cause", &self.cause).finish_non_exhaustive()
    }
}

/// Why an order was not followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Not from this phase.
    #[error("not while {}", .0.name())]
    Phase(Phase),
    /// The robot's state is not good.
    #[error("the robot's state is not good: {}", .0.name())]
    State(Cause),
    /// A session is being opened.
    #[error("arming already")]
    Arming,
    /// Something that it needs was not given with it: no motion and no law of contact to start, no controller to arm with.
    #[error("there is nothing to do it with: neither a motion nor a law of contact is configured")]
    Incomplete,
}

/// Controllers and motions that the loop has no use for any more.
#[derive(Default)]
pub struct Waste {
    controllers: [Option<Box<dyn Running>>; 4],
    motions: [Option<Box<dyn Motion>>; 4],
}

impl Waste {
    /// Room for what one order and what came of it can leave behind.
    pub(crate) fn controller(&mut self, controller: Option<Box<dyn Running>>) {
        put(&mut self.controllers, controller);
    }

    /// Likewise.
    pub(crate) fn motion(&mut self, motion: Option<Box<dyn Motion>>) {
        put(&mut self.motions, motion);
    }
}

fn put<T>(slots: &mut [Option<T>], thing: Option<T>) {
    if let Some(slot) = slots.iter_mut().find(|slot| slot.is_none()) {
        *slot = thing;
    } else {
        debug_assert!(thing.is_none(), "more waste than between two orders");
    }
}

/// What comes back: whether the order was followed, and what is to be dropped.
pub struct Answer {
    /// Of which order.
    pub id: u64,
    /// Whether it was followed.
    pub outcome: Result<(), Refusal>,
    /// What is to be dropped where freeing memory is allowed.
    pub waste: Waste,
}

impl fmt::Debug for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Answer").field("id", &self.id).field("outcome", &self.outcome).finish_non_exhaustive()
    }
}
