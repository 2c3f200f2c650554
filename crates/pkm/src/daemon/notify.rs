//! What a service manager is told: that the daemon is ready, that it lives, that it ends (the protocol of `sd_notify(3)`).

use std::ffi::OsString;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

/// The socket of a service manager, if there is one.
pub(super) struct Notify {
    socket: Option<UnixDatagram>,
    /// Time between two signs of life `[ns]`; none: nobody watches.
    every_ns: Option<u64>,
    last_ns: u64,
}

impl Notify {
    /// The manager that this process's environment names.
    pub(super) fn from_environment() -> Self {
        let of = |name: &str| std::env::var(name).ok();
        let is_for_us = of("WATCHDOG_PID").is_none_or(|pid| pid == std::process::id().to_string());
        Self::new(std::env::var_os("NOTIFY_SOCKET"), of("WATCHDOG_USEC").filter(|_| is_for_us).as_deref())
    }

    fn new(path: Option<OsString>, watchdog_us: Option<&str>) -> Self {
        // Half of the time, as its manual asks for.
        let every_ns = watchdog_us.and_then(|us| us.parse::<u64>().ok()).filter(|us| *us > 0).map(|us| us.saturating_mul(500));
        Self { socket: path.filter(|path| !path.is_empty()).and_then(|path| connect(&path)), every_ns, last_ns: 0 }
    }

    /// The daemon runs, and takes orders.
    pub(super) fn ready(&self, status: &str) {
        self.send(&format!("READY=1\nSTATUS={status}"));
    }

    /// A sign of life, where one is due at `now_ns` `[ns]`. Only who has seen the loop alive may give it.
    pub(super) fn alive(&mut self, now_ns: u64) {
        if self.every_ns.is_some_and(|every_ns| now_ns.saturating_sub(self.last_ns) >= every_ns) {
            self.last_ns = now_ns;
            self.send("WATCHDOG=1");
        }
    }

    /// The daemon ends.
    pub(super) fn stopping(&self) {
        self.send("STOPPING=1");
    }

    fn send(&self, text: &str) {
        if let Some(socket) = &self.socket {
            // A manager who does not listen is no reason to let go of a robot, and none to wait.
            let _ = socket.send(text.as_bytes());
        }
    }
}

/// A path, or a name in the abstract namespace after an `@`.
fn connect(path: &OsString) -> Option<UnixDatagram> {
    let socket = UnixDatagram::unbound().ok()?;
    socket.set_nonblocking(true).ok()?;
    match path.as_encoded_bytes().strip_prefix(b"@") {
        #[cfg(target_os = "linux")]
        Some(name) => {
            use std::os::linux::net::SocketAddrExt;
            let address = std::os::unix::net::SocketAddr::from_abstract_name(name).ok()?;
            socket.connect_addr(&address).ok()?;
        }
        #[cfg(not(target_os = "linux"))]
        Some(_) => return None,
        None => socket.connect(Path::new(path)).ok()?,
    }
    Some(socket)
}
