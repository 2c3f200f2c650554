//! A daemon under a service manager: what it tells, by the protocol of `sd_notify(3)`, and that it ends when it is told to.

use core::time::Duration;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

use rustix::process::Signal;

use crate::site::{PATIENCE_S, Site};

fn next(socket: &UnixDatagram) -> Option<String> {
    let mut buffer = [0; 512];
    let length = socket.recv(&mut buffer).ok()?;
    Some(String::from_utf8_lossy(&buffer[..length]).into_owned())
}

#[test]
fn a_service_manager_hears_that_the_daemon_is_ready_that_it_lives_and_that_it_ends() {
    let site = Site::new();
    let path = site.dir.path().join("notify");
    let name = format!("pkm-test-{}", std::process::id());
    let abstract_name = SocketAddr::from_abstract_name(&name).unwrap();
    let managers = [
        (path.display().to_string(), UnixDatagram::bind(&path).unwrap(), true),
        (format!("@{name}"), UnixDatagram::bind_addr(&abstract_name).unwrap(), false),
    ];
    for (address, socket, is_watched) in managers {
        socket.set_read_timeout(Some(Duration::from_secs(PATIENCE_S))).unwrap();
        // Somebody else's watchdog is none of ours.
        let pid = if is_watched { Vec::new() } else { vec![("WATCHDOG_PID", "1")] };
        let told = [("NOTIFY_SOCKET", address.as_str()), ("WATCHDOG_USEC", "100000")];
        let mut daemon = site.start_with("daemon", &[], &[&told[..], &pid[..]].concat());
        let ready = next(&socket).unwrap_or_else(|| panic!("{}", daemon.told()));
        assert!(ready.starts_with("READY=1\nSTATUS="), "{ready:?}");
        // Ready means that orders are heard.
        assert!(site.status().is_some(), "{}", daemon.told());
        if is_watched {
            (0..5).for_each(|_| assert_eq!(next(&socket).as_deref(), Some("WATCHDOG=1")));
        }
        daemon.signal(Signal::TERM);
        let last = core::iter::from_fn(|| next(&socket)).find(|told| told != "WATCHDOG=1");
        assert_eq!(last.as_deref(), Some("STOPPING=1"), "{}", daemon.told());
        assert_eq!(daemon.end(PATIENCE_S), 0);
    }
    // A manager that does not answer is no reason not to run.
    let mut daemon = site.start_with("daemon", &[], &[("NOTIFY_SOCKET", "/nonexistent/notify")]);
    site.until(&["off"]);
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0);
}
