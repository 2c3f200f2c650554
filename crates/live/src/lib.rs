//! A loop to look at while it runs: a WebSocket server in Foxglove's protocol, which Foxglove and `PlotJuggler` speak.
//!
//! What is shown are the topics that are recorded, thinned out to what eyes can follow. Periods come from the thread of the recording
//! ([`Live::tap`]) into a short queue that drops the oldest; the loop knows nothing of any of this. A viewer that is slow loses messages,
//! not the others. The server listens on this machine alone unless told otherwise: nobody is asked for a password.

extern crate alloc;

use alloc::collections::VecDeque;
use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle};
use pkm_hal::cycle::CycleRecord;
use pkm_record::cycles::{Layout, Messages, Tap};

/// Where to listen and how much to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Address, by default this machine's own.
    pub host: String,
    /// Port; 0 takes any that is free.
    pub port: u16,
    /// Shortest time between two periods that are shown `[ns]`; those between are left out.
    pub every_ns: u64,
    /// Periods that wait to be shown at most.
    pub queue: usize,
    /// Messages that wait for a viewer at most.
    pub backlog: usize,
}

impl Default for Options {
    /// Foxglove's own port, a hundred periods a second, a second of them waiting.
    fn default() -> Self {
        Self { host: "127.0.0.1".to_string(), port: 8765, every_ns: 10_000_000, queue: 100, backlog: 1024 }
    }
}

/// Why nothing can be shown.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address is taken, or not this machine's.
    #[error("live view at {host}:{port}: {detail}")]
    Listen {
        /// Address.
        host: String,
        /// Port.
        port: u16,
        /// What the system says.
        detail: String,
    },
    /// The system gives no thread, or a topic is refused.
    #[error("live view: {detail}")]
    Start {
        /// What the system says.
        detail: String,
    },
}

/// Periods on their way to the viewers.
#[derive(Debug, Default)]
struct Queue {
    waiting: Mutex<VecDeque<CycleRecord>>,
    more: Condvar,
    dropped: AtomicU64,
    is_over: AtomicBool,
}

/// A server that runs until it is dropped.
#[derive(Debug)]
pub struct Live {
    queue: Arc<Queue>,
    every_ns: u64,
    length: usize,
    server: Option<WebSocketServerHandle>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Listens and advertises the topics of `layout`.
    ///
    /// # Errors
    /// An address that is taken; a recording goes on without viewers then.
    pub fn start(layout: &Layout, options: &Options) -> Result<Self, LiveError> {
        let context = Context::new();
        let messages = Messages::new(layout);
        let start = |e: &dyn core::fmt::Display| LiveError::Start { detail: e.to_string() };
        let mut channels = Vec::new();
        for topic in messages.topics() {
            let schema = Schema::new(topic.schema, "ros2msg", topic.definition.clone().into_bytes());
            let channel = ChannelBuilder::new(&topic.name).context(&context).message_encoding("cdr").schema(schema).build_raw();
            channels.push(channel.map_err(|e| start(&e))?);
        }
        let server = WebSocketServer::new()
            .name(concat!("pkm ", env!("CARGO_PKG_VERSION")))
            .context(&context)
            .message_backlog_size(options.backlog)
            .bind(&options.host, options.port)
            .start_blocking()
            .map_err(|e| LiveError::Listen { host: options.host.clone(), port: options.port, detail: e.to_string() })?;
        let queue = Arc::new(Queue::default());
        let of_thread = Arc::clone(&queue);
        let thread = std::thread::Builder::new().name("pkm-live".to_string()).spawn(move || {
            show(messages, &channels, &of_thread);
            // Channels are open as long as their context lives.
            drop(context);
        });
        let thread = thread.map_err(|e| start(&e))?;
        Ok(Self { queue, every_ns: options.every_ns, length: options.queue.max(1), server: Some(server), thread: Some(thread) })
    }

    /// Port it listens on.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.server.as_ref().map_or(0, WebSocketServerHandle::port)
    }

    /// Viewers there are.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.server.as_ref().map_or(0, WebSocketServerHandle::client_count)
    }

    /// Periods that were to be shown and found the queue full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.queue.dropped.load(Ordering::Relaxed)
    }

    /// For the thread of the recording ([`pkm_record::cycles::spawn`]): takes every period and waits for nobody but the queue's own lock.
    #[must_use]
    pub fn tap(&self) -> Tap {
        let (queue, every_ns, length) = (Arc::clone(&self.queue), self.every_ns, self.length);
        let mut next_ns = 0;
        Box::new(move |record| {
            if record.planned_ns < next_ns {
                return;
            }
            // On a grid of its own, whatever the loop's is; behind a gap it begins again rather than catch up.
            let on_grid = next_ns + every_ns;
            next_ns = if record.planned_ns < on_grid { on_grid } else { record.planned_ns + every_ns };
            let mut waiting = queue.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            while waiting.len() >= length {
                waiting.pop_front();
                queue.dropped.fetch_add(1, Ordering::Relaxed);
            }
            waiting.push_back(*record);
            drop(waiting);
            queue.more.notify_one();
        })
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.queue.is_over.store(true, Ordering::Release);
        self.queue.more.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic there was told there.
            let _ = thread.join();
        }
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }
}

/// Shows what waits, until it is over.
fn show(mut messages: Messages, channels: &[Arc<RawChannel>], queue: &Queue) {
    const LOOK: Duration = Duration::from_millis(100);
    while !queue.is_over.load(Ordering::Acquire) {
        let record = {
            let mut waiting = queue.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            if waiting.is_empty() {
                waiting = queue.more.wait_timeout(waiting, LOOK).unwrap_or_else(PoisonError::into_inner).0;
            }
            waiting.pop_front()
        };
        let Some(record) = record else { continue };
        let sent: Result<(), core::convert::Infallible> = messages.encode(&record, &mut |message| {
            if let Some(channel) = channels.get(message.topic) {
                channel.log_with_meta(message.data, PartialMetadata { log_time: Some(message.time_ns) });
            }
            Ok(())
        });
        match sent {
            Ok(()) => {}
        }
    }
}
