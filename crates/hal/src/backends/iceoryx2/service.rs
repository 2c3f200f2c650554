//! Making the service one owns, and opening the one the other side owns.

extern crate alloc;

use alloc::format;
use alloc::string::{String, ToString};
use alloc::sync::Arc;
use core::fmt::Debug;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use ::iceoryx2::port::publisher::Publisher;
use ::iceoryx2::port::subscriber::Subscriber;
use ::iceoryx2::port::update_connections::UpdateConnections;
use ::iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo};
use ::iceoryx2::prelude::{
    BackpressureStrategy, Config, FileName, MessagingPattern, Node, NodeBuilder, Path, SemanticString, ServiceName, SignalHandlingMode,
    ZeroCopySend, ipc,
};
use ::iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use ::iceoryx2::service::port_factory::PortFactory as _;
use ::iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::BUFFER;
use super::place::{Lock, Place, Role, SharedError};

/// Longest wait for somebody else who cleans up, for each dead node.
const CLEANUP: Duration = Duration::from_millis(50);

/// How long a service that somebody else is just making is waited for.
const CREATION: Duration = Duration::from_millis(200);

/// Whether a connection could not be made. The library tries each of them once, says so to nobody but its log, and then goes on without.
#[derive(Debug, Clone, Default)]
struct Broken(Arc<AtomicBool>);

impl Broken {
    /// What the library is to call.
    fn handler(&self, action: DegradationAction) -> impl Fn(DegradationCause, &DegradationInfo) -> DegradationAction + 'static {
        let told = Arc::clone(&self.0);
        move |_, _| {
            told.store(true, Ordering::Relaxed);
            action
        }
    }

    fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// The service one owns, with its one publisher.
pub(super) struct Ours<T: ZeroCopySend + Debug + 'static> {
    // In this order when dropped; none only while it could not be made anew.
    port: Option<Publisher<ipc::Service, T, ()>>,
    service: PortFactory<ipc::Service, T, ()>,
    broken: Broken,
}

impl<T: ZeroCopySend + Debug + 'static> Ours<T> {
    /// Opens or makes service `number` of `role` and takes its one publisher.
    pub(super) fn make(node: &Node<ipc::Service>, role: Role, number: u32) -> Result<Self, String> {
        let name = ServiceName::new(&name_of(role, number)).map_err(|e| format!("{e:?}"))?;
        let service = node
            .service_builder(&name)
            .publish_subscribe::<T>()
            .max_publishers(1)
            // One listens; the others are places of those that were killed and not cleaned away yet.
            .max_subscribers(8)
            .max_nodes(32)
            .history_size(1)
            .subscriber_max_buffer_size(BUFFER)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|e| format!("{e:?}"))?;
        let mut ours = Self { port: None, service, broken: Broken::default() };
        ours.publish()?;
        Ok(ours)
    }

    fn publish(&mut self) -> Result<(), String> {
        // There is room for one: the old one goes first.
        self.port = None;
        self.broken = Broken::default();
        // The loop never waits for a reader: what does not fit is lost, and the sequence numbers tell.
        let builder = self.service.publisher_builder().max_loaned_samples(2).backpressure_strategy(BackpressureStrategy::DiscardData);
        // A reader who cannot be reached keeps nothing from the others.
        let builder = builder.set_degradation_handler(self.broken.handler(DegradationAction::Ignore));
        self.port = Some(builder.create().map_err(|e| format!("{e:?}"))?);
        Ok(())
    }

    /// Hands a sample to everybody who listens; whether it could be handed over.
    pub(super) fn send(&self, sample: T) -> bool {
        let Some(port) = &self.port else { return false };
        port.loan_uninit().is_ok_and(|loan| loan.write_payload(sample).send().is_ok())
    }

    /// Whether somebody listens and can be reached.
    ///
    /// A publisher learns of a new reader only when it sends or is told to look: what was sent before that comes too late or never, so this looks.
    pub(super) fn is_heard(&self) -> bool {
        let Some(port) = &self.port else { return false };
        let is_connected = port.update_connections().is_ok() && !self.broken.is_set();
        is_connected && self.service.dynamic_config().number_of_subscribers() > 0
    }

    /// Makes the publisher anew where a reader could not be reached: both sides connect once more then.
    pub(super) fn mend(&mut self) {
        if self.port.is_none() || self.broken.is_set() {
            // What cannot be made now is made at the next look.
            let _ = self.publish();
        }
    }
}

/// The other side's service, listened to.
pub(super) struct Theirs<T: ZeroCopySend + Debug + 'static> {
    // In this order when dropped.
    port: Subscriber<ipc::Service, T, ()>,
    _service: PortFactory<ipc::Service, T, ()>,
    broken: Broken,
}

impl<T: ZeroCopySend + Debug + Copy + 'static> Theirs<T> {
    /// The oldest sample that was not taken yet.
    ///
    /// # Errors
    /// The other side cannot be reached this way: to be listened to anew.
    pub(super) fn next(&self) -> Result<Option<T>, Deaf> {
        let next = self.port.receive().map_err(|_| Deaf)?.map(|sample| *sample.payload());
        if self.broken.is_set() { Err(Deaf) } else { Ok(next) }
    }
}

/// A connection to the other side could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Deaf;

/// What mended a service that could not be made at first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mended {
    /// Nothing had to be.
    Nothing,
    /// Dead nodes were cleaned away.
    DeadNodes,
    /// The service was removed by force.
    Removed,
    /// Every file of the place was removed.
    Swept,
    /// The service got a new number.
    Renumbered,
}

/// Words of the library, and the place, as an error.
pub(super) fn failed(place: &Place, service: &str, problem: &dyn Debug) -> SharedError {
    let (root, prefix) = (place.root().display().to_string(), place.prefix());
    SharedError::Service { service: service.to_string(), problem: format!("{problem:?}"), root, prefix }
}

/// A node in `place`, which sees nothing of other places.
pub(super) fn node(place: &Place) -> Result<Node<ipc::Service>, SharedError> {
    super::silence();
    let bad = |problem: &dyn Debug| failed(place, "node", problem);
    let mut config = Config::default();
    config.global.prefix = FileName::new(place.prefix().as_bytes()).map_err(|e| bad(&e))?;
    let root = place.root().display().to_string();
    config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|e| bad(&e))?);
    config.global.creation_timeout = CREATION;
    place.shut()?;
    let builder = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    let node = builder.create::<ipc::Service>().map_err(|e| bad(&e))?;
    // Once more: what it has just made, or what somebody made for it just before.
    place.shut()?;
    Ok(node)
}

/// A node for `role`, whose lock is held. Where files of an earlier node are broken, every file of the place is removed, unless somebody plays
/// the other role.
///
/// # Errors
/// As [`node`], and where shared memory is full.
pub(super) fn begin(place: &Place, role: Role) -> Result<Node<ipc::Service>, SharedError> {
    place.has_room()?;
    let problem = match node(place) {
        Ok(node) => return Ok(node),
        Err(e) => e,
    };
    let Ok(_other) = place.lock(role.other()) else { return Err(problem) };
    place.sweep();
    node(place)
}

fn name_of(role: Role, number: u32) -> String {
    format!("pkm/{role}/{number}")
}

/// The service of `role`, whose lock is `_lock`, mended where processes that were killed have left it locked.
///
/// Steps, each tried once: as it is; dead nodes cleaned away; removed by force, then every file of the place, both only while nobody plays
/// the other role; under a new number.
///
/// # Errors
/// None of it helped.
pub(super) fn own<T: ZeroCopySend + Debug + 'static>(
    node: &mut Node<ipc::Service>,
    place: &Place,
    role: Role,
    _lock: &Lock,
    layout: u64,
) -> Result<(Ours<T>, Mended), SharedError> {
    let mut number = place.number(role).map_or(1, |(number, _)| number);
    let mut problem = String::new();
    for mended in [Mended::Nothing, Mended::DeadNodes, Mended::Removed, Mended::Swept, Mended::Renumbered] {
        match mended {
            Mended::Nothing => {}
            Mended::DeadNodes => {
                node.blocking_cleanup_dead_nodes(CLEANUP);
            }
            Mended::Removed | Mended::Swept => {
                // Held until the step is done: the other side cannot begin meanwhile.
                let Ok(_other) = place.lock(role.other()) else { continue };
                remove(node, place, &name_of(role, number), mended)?;
            }
            Mended::Renumbered => number = number.wrapping_add(1),
        }
        // Before the service is there: a reader that comes too early finds none and tries again.
        place.set_number(role, number, layout)?;
        match Ours::make(node, role, number) {
            Ok(service) => return place.keep_pages().map(|()| (service, mended)),
            Err(e) => problem = e,
        }
    }
    Err(failed(place, &name_of(role, number), &problem))
}

fn remove(node: &mut Node<ipc::Service>, place: &Place, name: &str, how: Mended) -> Result<(), SharedError> {
    if how == Mended::Swept {
        place.sweep();
        *node = self::node(place)?;
    } else if let Ok(name) = ServiceName::new(name) {
        // SAFETY: both roles' locks are held, so no other process uses the service; what cannot be removed shows in the next step.
        #[expect(unsafe_code, reason = "the library's own way out of a service that a killed process has left behind")]
        let _ = unsafe { node.force_remove_service(&name, MessagingPattern::PublishSubscribe) };
    }
    Ok(())
}

/// What the service of `role` sends, if it is there and can be reached. Where sides that were killed hold every place for readers, they are
/// cleaned away for the next time. Where shared memory is full nobody is listened to until it is not.
pub(super) fn listen<T: ZeroCopySend + Debug + Copy + 'static>(
    node: &Node<ipc::Service>,
    place: &Place,
    role: Role,
    number: u32,
) -> Option<Theirs<T>> {
    place.has_room().ok()?;
    let name = ServiceName::new(&name_of(role, number)).ok()?;
    let clean = || {
        node.blocking_cleanup_dead_nodes(CLEANUP);
    };
    let service = match node.service_builder(&name).publish_subscribe::<T>().open() {
        Ok(service) => service,
        Err(e) => {
            if e == PublishSubscribeOpenError::ExceedsMaxNumberOfNodes {
                clean();
            }
            return None;
        }
    };
    let broken = Broken::default();
    let builder = service.subscriber_builder().buffer_size(BUFFER);
    let port = builder.set_degradation_handler(broken.handler(DegradationAction::DegradeAndFail)).create();
    let port = port.inspect_err(|_| clean()).ok()?;
    place.keep_pages().ok()?;
    (!broken.is_set()).then_some(Theirs { port, _service: service, broken })
}
