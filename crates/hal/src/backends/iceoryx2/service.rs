//! Making the service one owns, and opening the one the other side owns.

extern crate alloc;

use alloc::format;
use alloc::string::{String, ToString};
use core::fmt::Debug;
use core::time::Duration;

use ::iceoryx2::port::publisher::Publisher;
use ::iceoryx2::port::subscriber::Subscriber;
use ::iceoryx2::prelude::{
    BackpressureStrategy, Config, FileName, MessagingPattern, Node, NodeBuilder, Path, SemanticString, ServiceName, SignalHandlingMode,
    ZeroCopySend, ipc,
};
use ::iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::BUFFER;
use super::place::{Lock, Place, Role, SharedError};

/// Longest wait for somebody else who cleans up, for each dead node.
const CLEANUP: Duration = Duration::from_millis(50);

/// How long a service that somebody else is just making is waited for.
const CREATION: Duration = Duration::from_millis(200);

/// A service with a port to it; the port goes first when both are dropped.
pub(super) struct Opened<P, T: ZeroCopySend + Debug> {
    pub(super) port: P,
    _service: PortFactory<ipc::Service, T, ()>,
}

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
fn failed(place: &Place, service: &str, problem: &dyn Debug) -> SharedError {
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
    let builder = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create::<ipc::Service>().map_err(|e| bad(&e))
}

/// A node for `role`, whose lock is held. Where files of an earlier node are broken, every file of the place is removed, unless somebody plays
/// the other role.
///
/// # Errors
/// As [`node`].
pub(super) fn begin(place: &Place, role: Role) -> Result<Node<ipc::Service>, SharedError> {
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

type Ours<T> = Opened<Publisher<ipc::Service, T, ()>, T>;
type Theirs<T> = Opened<Subscriber<ipc::Service, T, ()>, T>;

/// Opens or makes service `number` of `role` and takes its one publisher.
fn publish<T: ZeroCopySend + Debug>(node: &Node<ipc::Service>, role: Role, number: u32) -> Result<Ours<T>, String> {
    let name = ServiceName::new(&name_of(role, number)).map_err(|e| format!("{e:?}"))?;
    let service = node
        .service_builder(&name)
        .publish_subscribe::<T>()
        .max_publishers(1)
        .max_subscribers(4)
        .max_nodes(16)
        .history_size(1)
        .subscriber_max_buffer_size(BUFFER)
        .enable_safe_overflow(true)
        .open_or_create()
        .map_err(|e| format!("{e:?}"))?;
    // The loop never waits for a reader: what does not fit is lost, and the sequence numbers tell.
    let port = service.publisher_builder().max_loaned_samples(2).backpressure_strategy(BackpressureStrategy::DiscardData);
    let port = port.create().map_err(|e| format!("{e:?}"))?;
    Ok(Opened { port, _service: service })
}

/// The service of `role`, whose lock is `_lock`, mended where processes that were killed have left it locked.
///
/// Steps, each tried once: as it is; dead nodes cleaned away; removed by force, then every file of the place, both only while nobody plays
/// the other role; under a new number.
///
/// # Errors
/// None of it helped.
pub(super) fn own<T: ZeroCopySend + Debug>(
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
        match publish(node, role, number) {
            Ok(service) => return Ok((service, mended)),
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

/// What the service of `role` sends, if it is there.
pub(super) fn listen<T: ZeroCopySend + Debug>(node: &Node<ipc::Service>, role: Role, number: u32) -> Option<Theirs<T>> {
    let name = ServiceName::new(&name_of(role, number)).ok()?;
    let service = node.service_builder(&name).publish_subscribe::<T>().open().ok()?;
    let port = service.subscriber_builder().buffer_size(BUFFER).create().ok()?;
    Some(Opened { port, _service: service })
}
