//! A daemon that is looked at while it runs: what a viewer asks and is answered, by RFC 6455 and the protocol of Foxglove.

use core::time::Duration;
use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

use rustix::process::Signal;

use crate::site::{CONFIG, PATIENCE_S, Site, within};

/// What the server says to a viewer, in whatever order and in however many pieces.
const WORDS: [&str; 5] = ["serverInfo", "advertise", "sensor_msgs/msg/JointState", "/joint_states", "/pkm/cycle"];

/// The example of RFC 6455, section 1.3: this key must be answered by that hash.
const KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";
const HASH: &str = "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=";

/// Connects a viewer; what the server says until all of the words are among it.
fn looked(port: u16) -> String {
    let mut stream = within(PATIENCE_S, || TcpStream::connect(("127.0.0.1", port)).ok()).expect("the port of the live view");
    stream.set_read_timeout(Some(Duration::from_secs(PATIENCE_S))).unwrap();
    let ask = format!(
        "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {KEY}\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    stream.write_all(ask.as_bytes()).unwrap();
    let (mut told, mut buffer) = (String::new(), [0; 4096]);
    while !WORDS.iter().all(|word| told.contains(word)) {
        let length = stream.read(&mut buffer).unwrap_or_else(|e| panic!("{e} after {told:?}"));
        assert!(length > 0, "the server hangs up after {told:?}");
        told += &String::from_utf8_lossy(&buffer[..length]);
    }
    told
}

#[test]
fn a_viewer_sees_what_is_recorded_and_a_port_that_is_taken_is_told() {
    let site = Site::new();
    fs::write(site.config(), CONFIG.replace("\"iceoryx2\"", "\"simulated\"")).unwrap();
    // The daemon takes a port that is free and says which: one that was free a moment ago may be somebody's now.
    let mut daemon = site.start_with("daemon", &["--record", "runs", "--live", "0"], &[]);
    site.until(&["ready"]);
    let place = "live view at ws://127.0.0.1:";
    let line = within(PATIENCE_S, || daemon.told().lines().find_map(|line| line.strip_prefix(place).map(str::to_string)));
    let port: u16 = line.unwrap_or_else(|| panic!("{}", daemon.told())).parse().unwrap();
    let told = looked(port);
    assert!(told.starts_with("HTTP/1.1 101 "), "{told}");
    let head = told.to_lowercase();
    assert!(told.contains(HASH) && head.contains("sec-websocket-protocol: foxglove.sdk.v1"), "{told}");
    // The viewer is gone; the loop goes on, and a port that is somebody's is told.
    assert_eq!(site.phase(), "ready");
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0, "{}", daemon.told());
    let taken = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let mut daemon = site.start_with("daemon", &["--record", "runs", "--live", &port.to_string()], &[]);
    site.until(&["ready"]);
    assert!(daemon.told().contains(&format!("live view at 127.0.0.1:{port}")), "{}", daemon.told());
    drop(taken);
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0);
}
