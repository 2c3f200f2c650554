//! A viewer of Foxglove's protocol, written from its specification, looks at a loop.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

extern crate alloc;

use alloc::collections::BTreeMap;
use core::time::Duration;
use std::net::TcpStream;

use pkm_hal::cycle::{CycleRecord, Phase, flags};
use pkm_hal::frame::first_bits;
use pkm_live::{Live, Options};
use pkm_record::cycles::Layout;
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// Longest wait for anything that must come: a wait ends when it comes, and machines that run tests have other work.
const PATIENCE: Duration = Duration::from_secs(120);

/// How long nothing may come until more periods are shown.
const GLANCE: Duration = Duration::from_millis(50);

const MS: u64 = 1_000_000;
const EPOCH: u64 = 1_700_000_000_000_000_000;

fn layout() -> Layout {
    Layout { joints: vec!["q1".into(), "q2".into()], sensors: vec!["wrench.foot.fz".into()], epoch_ns: EPOCH, ..Layout::default() }
}

fn record(cycle: u64) -> CycleRecord {
    let mut out = CycleRecord::new(2, 1);
    (out.cycle, out.planned_ns, out.flags) = (cycle, cycle * MS, flags::NEW_STATE | flags::COMMANDED);
    out.phase = Phase::Position.code();
    (out.state.sequence, out.state.stamp_ns) = (cycle, cycle * MS);
    (out.state.valid_q, out.state.valid_tau, out.state.valid_sensor) = (first_bits(2), first_bits(2), 1);
    (out.state.q[0], out.state.q[1]) = (cycle as f64 / 3.0, -(cycle as f64));
    out
}

struct Viewer(WebSocket<TcpStream>);

impl Viewer {
    fn connect(port: u16) -> Self {
        let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://127.0.0.1:{port}").into_client_request().unwrap();
        request.headers_mut().insert("Sec-WebSocket-Protocol", "foxglove.sdk.v1".parse().unwrap());
        let (socket, response) = tungstenite::client(request, stream).unwrap();
        assert_eq!(response.headers()["Sec-WebSocket-Protocol"], "foxglove.sdk.v1");
        Self(socket)
    }

    /// The next message of text, as JSON.
    fn told(&mut self) -> Value {
        loop {
            if let Message::Text(text) = self.0.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Topics that are advertised: name to the whole entry.
    fn advertised(&mut self, how_many: usize) -> BTreeMap<String, Value> {
        let mut out = BTreeMap::new();
        while out.len() < how_many {
            let told = self.told();
            if told["op"] == "advertise" {
                for channel in told["channels"].as_array().unwrap() {
                    out.insert(channel["topic"].as_str().unwrap().to_string(), channel.clone());
                }
            }
        }
        out
    }

    fn subscribe(&mut self, id: u32, channel: &Value) {
        let text = json!({"op": "subscribe", "subscriptions": [{"id": id, "channelId": channel["id"]}]}).to_string();
        self.0.send(Message::Text(text.into())).unwrap();
    }

    /// The next message data within a glance.
    fn glance(&mut self) -> Option<Vec<u8>> {
        self.0.get_mut().set_read_timeout(Some(GLANCE)).unwrap();
        let seen = match self.0.read() {
            Ok(Message::Binary(bytes)) if bytes[0] == 1 => Some(bytes.to_vec()),
            Ok(_) | Err(tungstenite::Error::Io(_)) => None,
            Err(e) => panic!("{e}"),
        };
        self.0.get_mut().set_read_timeout(Some(PATIENCE)).unwrap();
        seen
    }

    /// The next message data: subscription, time [ns], payload.
    fn data(&mut self) -> (u32, u64, Vec<u8>) {
        loop {
            if let Message::Binary(bytes) = self.0.read().unwrap()
                && bytes[0] == 1
            {
                let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                return (id, u64::from_le_bytes(bytes[5..13].try_into().unwrap()), bytes[13..].to_vec());
            }
        }
    }
}

fn any_port() -> Options {
    Options { port: 0, ..Options::default() }
}

#[test]
fn a_viewer_sees_what_is_recorded_thinned_out() {
    let live = Live::start(&layout(), &any_port()).unwrap();
    let mut viewer = Viewer::connect(live.port());
    let info = viewer.told();
    assert_eq!((&info["op"], info["name"].as_str().unwrap().starts_with("pkm ")), (&"serverInfo".into(), true), "{info}");
    let topics = viewer.advertised(7);
    let names: Vec<&str> = topics.keys().map(String::as_str).collect();
    let joints = ["/joint_commands", "/joint_reference_accelerations", "/joint_references", "/joint_states"];
    let wanted = [&joints[..], &["/pkm/control", "/pkm/cycle", "/wrench/foot"]].concat();
    assert_eq!(names, wanted);
    let states = &topics["/joint_states"];
    assert_eq!((&states["encoding"], &states["schemaEncoding"]), (&"cdr".into(), &"ros2msg".into()));
    assert_eq!(states["schemaName"], "sensor_msgs/msg/JointState");
    assert!(topics["/pkm/cycle"]["schema"].as_str().unwrap().contains("uint32 PHASE_RUNNING_POSITION=4"));
    viewer.subscribe(7, states);
    let mut tap = live.tap();
    // The subscription is on its way: periods come until one is seen.
    // From ten on: the position of period zero is zero, as much else is, and one in ten is shown.
    let mut cycle = 10;
    let mut seen = Vec::new();
    while seen.len() < 20 && cycle < 60_000 {
        for _ in 0..10 {
            tap(&record(cycle));
            cycle += 1;
        }
        seen.extend(viewer.glance());
    }
    assert_eq!(seen.len(), 20, "after {cycle} periods");
    let mut last = None;
    for bytes in seen {
        let (id, time) = (u32::from_le_bytes(bytes[1..5].try_into().unwrap()), u64::from_le_bytes(bytes[5..13].try_into().unwrap()));
        let cycle = (time - EPOCH) / MS;
        assert_eq!(id, 7);
        assert!(last.is_none_or(|last| cycle >= last + 10), "a hundred a second: {last:?}, {cycle}");
        last = Some(cycle);
        // The position of the first joint, behind stamp, frame, names and padding: 4 + 8 + 8 + 4 + 8 + 8 + 4, aligned to eight.
        let data = &bytes[13..];
        let at = data.windows(8).position(|w| w == (cycle as f64 / 3.0).to_le_bytes());
        assert!(at.is_some_and(|at| (at - 4) % 8 == 0), "{data:?}");
    }
}

#[test]
fn nobody_waits_for_a_viewer_and_the_oldest_are_dropped() {
    let live = Live::start(&layout(), &Options { every_ns: 1, queue: 10, ..any_port() }).unwrap();
    let mut viewer = Viewer::connect(live.port());
    let topics = viewer.advertised(7);
    viewer.subscribe(1, &topics["/pkm/cycle"]);
    // A subscription is on its way for as long as the server has other work: what is shown before it has arrived is for nobody.
    let mut tap = live.tap();
    let first = (1..6000).find(|&cycle| {
        tap(&record(cycle));
        viewer.glance().is_some()
    });
    let mut last = first.expect("the subscription arrives");
    // The viewer reads nothing while a minute of a fast loop passes.
    (10_000..250_000).for_each(|cycle| tap(&record(cycle)));
    assert!(live.dropped() > 0);
    // What it sees then is the end, as soon as the queues have passed.
    tap(&record(1_000_000));
    let mut before = 0;
    while last < 1_000_000 {
        let (id, time, _) = viewer.data();
        assert_eq!(id, 1);
        last = (time - EPOCH) / MS;
        assert!(last > before, "in order: {before}, {last}");
        before = last;
    }
}

#[test]
fn a_port_in_use_is_told_and_viewers_may_come_and_go() {
    let live = Live::start(&layout(), &any_port()).unwrap();
    let taken = Live::start(&layout(), &Options { port: live.port(), ..Options::default() }).map(|_| ()).unwrap_err().to_string();
    assert!(taken.starts_with(&format!("live view at 127.0.0.1:{}: ", live.port())), "{taken}");
    for _ in 0..20 {
        let mut viewer = Viewer::connect(live.port());
        assert_eq!(viewer.told()["op"], "serverInfo");
    }
    let mut rude = Viewer::connect(live.port());
    for bytes in [vec![], vec![1], vec![0xff; 100], vec![1; 4]] {
        rude.0.send(Message::Binary(bytes.into())).unwrap();
    }
    for text in ["", "{", "{\"op\":\"subscribe\"}", "{\"op\":\"subscribe\",\"subscriptions\":[{\"id\":-1,\"channelId\":1e9}]}", "[[[[[["] {
        rude.0.send(Message::Text(text.into())).unwrap();
    }
    let mut polite = Viewer::connect(live.port());
    assert_eq!(polite.told()["op"], "serverInfo");
    assert_eq!(polite.advertised(7).len(), 7);
}

/// Memory of this process that is in use `[bytes]`.
fn memory() -> u64 {
    let about = std::fs::read_to_string("/proc/self/statm").unwrap();
    let pages: u64 = about.split_whitespace().nth(1).unwrap().parse().unwrap();
    pages * 4096
}

#[test]
fn a_hundred_viewers_that_read_nothing_cost_a_bounded_memory_and_keep_nothing_from_one_who_reads() {
    let live = Live::start(&layout(), &Options { every_ns: 1, queue: 10, backlog: 32, ..any_port() }).unwrap();
    let mut crowd: Vec<Viewer> = (0..100).map(|_| Viewer::connect(live.port())).collect();
    for viewer in &mut crowd {
        let topics = viewer.advertised(7);
        (0..).zip(topics.values()).for_each(|(id, topic)| viewer.subscribe(id, topic));
    }
    assert_eq!(live.viewers(), 100);
    let mut reader = Viewer::connect(live.port());
    let topics = reader.advertised(7);
    reader.subscribe(1, &topics["/pkm/cycle"]);
    let mut tap = live.tap();
    // Until what may wait for a viewer waits, in the server and in the sockets.
    let mut cycle = 1;
    let mut pass = |periods: u64, reader: &mut Viewer| {
        let mut seen = 0;
        for _ in 0..periods {
            tap(&record(cycle));
            cycle += 1;
            if cycle % 200 == 0 {
                seen += u64::from(reader.glance().is_some());
            }
        }
        seen
    };
    assert!(pass(20_000, &mut reader) > 0, "one who reads sees something beside a hundred who do not");
    let before = memory();
    assert!(pass(20_000, &mut reader) > 0);
    let grown = memory().saturating_sub(before);
    assert!(grown < 32 << 20, "{grown} bytes more after twice as many periods");
    // A loop's thread is never among those who wait: what it hands over goes into a queue of its own length, the oldest first to go.
    assert!(live.dropped() > 0);
    drop(crowd);
    assert!(pass(5000, &mut reader) > 0, "and goes on when they leave");
}
