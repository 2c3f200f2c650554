//! How long the library alone takes there and back: the measure for what is built on it here.

use core::sync::atomic::{AtomicBool, Ordering};

use ::iceoryx2::prelude::{Node, ipc};

use super::CommandSlot;
use super::place::{Place, Role, SharedError};
use super::service::{Ours, Theirs, begin, failed, listen};
use crate::clock::Clock;
use crate::frame::CommandFrame;

/// Number of a probe's services: no side ever owns such a one.
const NUMBER: u32 = u32::MAX;

/// Longest wait for the other end `[ns]`.
const PATIENCE_NS: u64 = 2_000_000_000;

/// Sends a sample of a command's size there and back for `for_ns` `[ns]`, between two threads that never sleep; `note` is told how long each
/// took by `clock` `[ns]`. Nobody else may be in the place.
///
/// # Errors
/// Somebody plays a role in the place; a service cannot be made; an answer stays away.
pub fn ping_pong<C: Clock + Sync>(place: &Place, for_ns: u64, clock: &C, note: &mut dyn FnMut(u64)) -> Result<(), SharedError> {
    let _locks = (place.lock(Role::Daemon)?, place.lock(Role::Driver)?);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Ports belong to the thread that makes them.
        let far = scope.spawn(|| End::meet(place, Role::Driver, clock).map(|end| end.answer(&is_over)));
        let near = End::meet(place, Role::Daemon, clock).and_then(|end| {
            let (start_ns, mut round) = (clock.now_ns(), 0);
            loop {
                let begin_ns = clock.now_ns();
                if begin_ns.saturating_sub(start_ns) >= for_ns {
                    return Ok(());
                }
                round += 1;
                end.there_and_back(round, clock)?;
                note(clock.now_ns().saturating_sub(begin_ns));
            }
        });
        is_over.store(true, Ordering::Relaxed);
        let far = far.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        near.and(far)
    })
}

/// One end of a probe.
struct End<'p> {
    // In this order when dropped.
    theirs: Theirs<CommandSlot>,
    ours: Ours<CommandSlot>,
    _node: Node<ipc::Service>,
    place: &'p Place,
}

impl<'p> End<'p> {
    /// Makes its ports and waits until both ends are connected.
    fn meet<C: Clock>(place: &'p Place, role: Role, clock: &C) -> Result<Self, SharedError> {
        let node = begin(place, role)?;
        let ours = Ours::<CommandSlot>::make(&node, role, NUMBER).map_err(|e| failed(place, "probe", &e))?;
        let end_ns = clock.now_ns().saturating_add(PATIENCE_NS);
        let mut theirs = None;
        while clock.now_ns() < end_ns {
            theirs = theirs.or_else(|| listen(&node, place, role.other(), NUMBER));
            if let Some(theirs) = theirs.take_if(|_| ours.is_heard()) {
                return Ok(Self { theirs, ours, _node: node, place });
            }
            std::thread::yield_now();
        }
        Err(failed(place, "probe", &"the other end stays away"))
    }

    /// Sends back what comes, until it is over.
    fn answer(&self, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) {
            if let Ok(Some(slot)) = self.theirs.next() {
                // What cannot be sent is missed at the other end.
                let _ = self.ours.send(slot);
            }
        }
    }

    fn there_and_back<C: Clock>(&self, round: u64, clock: &C) -> Result<(), SharedError> {
        let mut slot = CommandSlot { bytes: [0; CommandFrame::BYTES] };
        slot.bytes[..8].copy_from_slice(&round.to_le_bytes());
        let begin_ns = clock.now_ns();
        if !self.ours.send(slot) {
            return Err(failed(self.place, "probe", &"not sent"));
        }
        loop {
            match self.theirs.next() {
                Ok(Some(back)) if back.bytes == slot.bytes => return Ok(()),
                Ok(_) => {}
                Err(_) => return Err(failed(self.place, "probe", &"the connection is broken")),
            }
            if clock.now_ns().saturating_sub(begin_ns) > PATIENCE_NS {
                return Err(failed(self.place, "probe", &"no answer"));
            }
        }
    }
}
