//! A daemon that is looked at while it runs: what a viewer asks and is answered, by RFC 6455 and the protocol of Foxglove.

use core::time::Duration;
use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

use rustix::process::Signal;

use crate::site::{CONFIG, PATIENCE_S, Site, within};

/// A port that was free a moment ago.
fn free_port() -> u16 {
    TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap().port()
}

/// The example of RFC 6455, section 1.3: this key must be answered by that hash.
const KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";
const HASH: &str = "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=";

/// Connects a viewer; what the server says until `last` is among it.
fn looked(port: u16, last: &str) -> String {
    let mut stream = within(PATIENCE_S, || TcpStream::connect(("127.0.0.1", port)).ok()).expect("the port of the live view");
    stream.set_read_timeout(Some(Duration::from_secs(PATIENCE_S))).unwrap();
    let ask = format!(
        "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {KEY}\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    stream.write_all(ask.as_bytes()).unwrap();
    let (mut told, mut buffer) = (String::new(), [0; 4096]);
    while !told.contains(last) {
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
    let port = free_port();
    let arguments = ["--record", "runs", "--live", &port.to_string()].map(str::to_string);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let mut daemon = site.start_with("daemon", &arguments, &[]);
    site.until(&["ready"]);
    let told = looked(port, "/pkm/cycle");
    assert!(told.starts_with("HTTP/1.1 101 "), "{told}");
    let head = told.to_lowercase();
    assert!(told.contains(HASH) && head.contains("sec-websocket-protocol: foxglove.sdk.v1"), "{told}");
    for word in ["serverInfo", "advertise", "sensor_msgs/msg/JointState", "/joint_states"] {
        assert!(told.contains(word), "{word} is not in {told}");
    }
    // The viewer is gone; the loop goes on, and its port is not another daemon's.
    assert_eq!(site.phase(), "ready");
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0, "{}", daemon.told());
    let taken = TcpListener::bind(("127.0.0.1", port)).unwrap();
    let mut daemon = site.start_with("daemon", &arguments, &[]);
    site.until(&["ready"]);
    assert!(daemon.told().contains(&format!("live view at 127.0.0.1:{port}")), "{}", daemon.told());
    drop(taken);
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0);
}
