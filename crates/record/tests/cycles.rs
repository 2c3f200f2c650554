//! What a loop leaves: layout of the files, rotation, disks that refuse, the black box, a kill in the middle.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

extern crate alloc;

mod made_up;

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::io::{self, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;

use pkm_hal::cycle::{Cause, CycleRecord, CycleSink, Phase, flags, ring::ring};
use pkm_hal::frame::first_bits;
use pkm_hal::{Clock, MonotonicClock, StateFrame};
use pkm_record::cycles::{Folder, Layout, Options, Recorder, Store, Stored, spawn};
use pkm_record::{Attachments, ReadOptions};

const MS: u64 = 1_000_000;
const JOINTS: [&str; 3] = ["q1", "long name of a joint", "q3"];
/// 2023-11-14, in the middle of a second.
const EPOCH: u64 = 1_700_000_000_250_000_000;

fn layout() -> Layout {
    let sensors = ["wrench.foot.fz", "q_link.q1", "current.q3", "wrench.foot.fx", "tau.q1"];
    Layout {
        joints: JOINTS.map(String::from).to_vec(),
        sensors: sensors.map(String::from).to_vec(),
        epoch_ns: EPOCH,
        carried: Attachments { keys: BTreeMap::from([("configuration".into(), "abc".into())]), ..made_up::attachments() },
    }
}

/// Any number there is, from two numbers: the same in every run, its every bit used.
fn number(cycle: u64, place: u64) -> f64 {
    let x = (cycle + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (place + 1).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    f64::from_bits(x >> 12 | 0x3ff0_0000_0000_0000) - 1.5
}

/// Period `cycle` at 1 kHz.
fn record(cycle: u64) -> CycleRecord {
    let mut out = CycleRecord::new(3, 5);
    out.cycle = cycle;
    out.planned_ns = cycle * MS;
    (out.woken_ns, out.read_ns, out.computed_ns, out.done_ns) =
        (out.planned_ns + 7_000, out.planned_ns + 9_000, out.planned_ns + 29_000, out.planned_ns + 31_000);
    (out.dt, out.flags, out.phase) = ([1e-3], flags::NEW_STATE | flags::COMMANDED, Phase::Position.code());
    let mut state = StateFrame::new(3, 5);
    (state.sequence, state.stamp_ns) = (cycle, cycle * MS);
    (state.valid_q, state.valid_v, state.valid_tau, state.valid_sensor) = (first_bits(3), first_bits(2), first_bits(3), first_bits(5));
    for i in 0..3 {
        let place = i as u64;
        (state.q[i], state.v[i], state.tau[i]) = (number(cycle, place), number(cycle, 10 + place), number(cycle, 20 + place));
        (out.q_ref[i], out.v_ref[i], out.a_ref[i]) = (number(cycle, 30 + place), number(cycle, 40 + place), number(cycle, 50 + place));
        (out.tau_ff[i], out.tau_sent[i]) = (number(cycle, 60 + place), number(cycle, 70 + place));
    }
    (0..5).for_each(|i| state.sensor[i] = number(cycle, 80 + i as u64));
    out.state = state.sealed();
    out
}

/// Files of a store that takes so many bytes, as long as it may.
#[derive(Clone, Default)]
struct Disk {
    files: Arc<Mutex<BTreeMap<String, Vec<u8>>>>,
    room: Arc<AtomicU64>,
    is_gone: Arc<AtomicBool>,
}

struct Handle(Disk, String);

impl Write for Handle {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let room = usize::try_from(self.0.room.load(Ordering::SeqCst)).unwrap();
        let n = buffer.len().min(room);
        if n == 0 && !buffer.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.0.room.fetch_sub(n as u64, Ordering::SeqCst);
        self.0.files.lock().unwrap().get_mut(&self.1).unwrap().extend(&buffer[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Stored for Handle {
    fn sync(&mut self) -> io::Result<()> {
        if self.0.is_gone.load(Ordering::SeqCst) { Err(io::Error::other("the disk is gone")) } else { Ok(()) }
    }
}

impl Store for Disk {
    fn create(&mut self, name: &str) -> io::Result<Box<dyn Stored>> {
        let mut files = self.files.lock().unwrap();
        if files.contains_key(name) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        files.insert(name.to_string(), Vec::new());
        Ok(Box::new(Handle(self.clone(), name.to_string())))
    }

    fn discard(&mut self, name: &str) {
        let bytes = self.files.lock().unwrap().remove(name).map_or(0, |b| b.len());
        self.room.fetch_add(bytes as u64, Ordering::SeqCst);
    }

    fn display(&self, name: &str) -> String {
        name.to_string()
    }
}

impl Disk {
    fn with(room: u64) -> Self {
        let disk = Self::default();
        disk.room.store(room, Ordering::SeqCst);
        disk
    }

    fn names(&self) -> Vec<String> {
        self.files.lock().unwrap().keys().cloned().collect()
    }

    /// The cycles in a file, recovered where that is needed.
    fn cycles(&self, name: &str) -> Vec<u64> {
        let bytes = self.files.lock().unwrap()[name].clone();
        let (_guard, path) = made_up::file(name, &bytes);
        cycles(&path)
    }
}

/// Numbers of the cycles in a file, by their commands' bits.
fn cycles(path: &Path) -> Vec<u64> {
    let recording = pkm_record::read(path, &made_up::recover()).unwrap();
    let sent = recording.signal("tau_cmd.q3").unwrap();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of milliseconds since the epoch of the file")]
    let numbers: Vec<u64> = recording.time.iter().map(|t| ((t - EPOCH as f64 * 1e-9) * 1000.0).round() as u64).collect();
    for (cycle, value) in numbers.iter().zip(sent) {
        assert_eq!(value.to_bits(), number(*cycle, 72).to_bits(), "{cycle}");
    }
    numbers
}

fn recorder(disk: &Disk, options: Options) -> Recorder {
    Recorder::begin(Box::new(disk.clone()), layout(), options, 0).unwrap()
}

fn names_of(prefix: &str, disk: &Disk) -> Vec<String> {
    disk.names().into_iter().filter(|name| name.starts_with(prefix)).collect()
}

#[test]
fn every_number_of_a_loop_is_in_its_file_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), Options::default(), 0).unwrap();
    for cycle in 0..300 {
        let mut record = record(cycle);
        if cycle == 7 {
            // Nothing came in this period, and nothing was asked.
            record.flags = 0;
        }
        recorder.push(&record, cycle * MS);
        recorder.tick(cycle * MS);
    }
    let (tally, outcome) = recorder.finish(300 * MS);
    outcome.unwrap();
    assert_eq!((tally.written, tally.lost, tally.files), (300, 0, 1));
    let path = folder.path().join("cycles_0001.mcap");
    let recording = pkm_record::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(recording.len(), 299);
    let cycle = |k: usize| if k < 7 { k as u64 } else { k as u64 + 1 };
    for (prefix, place) in [("q", 0), ("dq", 10), ("tau", 20), ("q_ref", 30), ("dq_ref", 40), ("ddq_ref", 50), ("tau_cmd", 70)] {
        for (i, joint) in JOINTS.iter().enumerate() {
            let signal = recording.signal(&format!("{prefix}.{joint}"));
            if prefix == "dq" && i == 2 {
                assert!(signal.is_none(), "nobody measured it");
                continue;
            }
            let signal = signal.unwrap_or_else(|| panic!("{prefix}.{joint}"));
            for (k, value) in signal.iter().enumerate() {
                assert_eq!(value.to_bits(), number(cycle(k), place + i as u64).to_bits(), "{prefix}.{joint} of {k}");
            }
        }
    }
    // A sensor that calls itself a state of a joint is a signal, not a second truth about the joint.
    for (i, column) in ["wrench.foot.fz", "q_link.q1", "current.q3", "wrench.foot.fx"].iter().enumerate() {
        assert_eq!(recording.signal(column).unwrap()[100].to_bits(), number(101, 80 + i as u64).to_bits(), "{column}");
    }
    assert_eq!(recording.meta.other["configuration"], "abc");
    assert_eq!(recording.meta.other["clock_offset_ns"], EPOCH.to_string());
    let files = pkm_record::read_attachments(&path, &ReadOptions::default()).unwrap().files;
    assert_eq!(files, made_up::attachments().files);
}

#[test]
fn chunks_are_lz4_and_none_holds_more_than_half_a_second() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), Options::default(), 0).unwrap();
    for cycle in 0..3000 {
        recorder.push(&record(cycle), cycle * MS);
        recorder.tick(cycle * MS);
    }
    recorder.finish(3000 * MS).1.unwrap();
    let bytes = std::fs::read(folder.path().join("cycles_0001.mcap")).unwrap();
    let records = mcap::read::LinearReader::new(&bytes).unwrap().map(Result::unwrap);
    let header = |record| if let mcap::records::Record::Chunk { header, .. } = record { Some(header) } else { None };
    let chunks: Vec<mcap::records::ChunkHeader> = records.filter_map(header).collect();
    assert!(chunks.len() >= 6, "{} chunks in three seconds", chunks.len());
    for header in chunks {
        assert_eq!(header.compression, "lz4");
        assert!(header.message_end_time - header.message_start_time <= 500 * MS, "{header:?}");
    }
}

#[test]
fn files_are_rotated_by_time_and_by_size_and_no_cycle_is_lost_in_between() {
    for (rotate_ns, rotate_bytes, files) in [(250 * MS, u64::MAX, 4..=4), (u64::MAX, 200_000, 5..=12)] {
        let disk = Disk::with(u64::MAX / 2);
        let options = Options { rotate_ns, rotate_bytes, flush_ns: 50 * MS, ..Options::default() };
        let mut recorder = recorder(&disk, options);
        for cycle in 0..1000 {
            recorder.push(&record(cycle), cycle * MS);
            recorder.tick(cycle * MS);
        }
        let (tally, outcome) = recorder.finish(1000 * MS);
        outcome.unwrap();
        assert_eq!((tally.written, tally.lost), (1000, 0));
        assert!(files.contains(&disk.names().len()), "{:?}", disk.names());
        let all: Vec<u64> = disk.names().iter().flat_map(|name| disk.cycles(name)).collect();
        assert_eq!(all, (0..1000).collect::<Vec<_>>());
        for name in disk.names() {
            let bytes = disk.files.lock().unwrap()[&name].clone();
            let (_guard, path) = made_up::file(&name, &bytes);
            assert!(made_up::read(&path).is_ok(), "{name} is whole");
        }
    }
}

#[test]
fn a_full_disk_stops_the_recording_and_a_new_file_begins_when_there_is_room() {
    let disk = Disk::with(400_000);
    let mut recorder = recorder(&disk, Options { flush_ns: 100 * MS, ..Options::default() });
    let mut paused = 0;
    for cycle in 0..8000 {
        recorder.push(&record(cycle), cycle * MS);
        recorder.tick(cycle * MS);
        if cycle == 4000 {
            assert!(!recorder.tally().is_recording);
            let told = recorder.tally().error.clone().unwrap();
            assert!(told.contains("no storage space") || told.contains("torage"), "{told}");
            paused = recorder.tally().lost;
            disk.room.store(u64::MAX / 2, Ordering::SeqCst);
        }
    }
    let (tally, outcome) = recorder.finish(8000 * MS);
    outcome.unwrap();
    assert!(paused > 0 && tally.error.is_none());
    assert_eq!((tally.written + tally.lost, tally.files), (8000, 2), "{tally:?}");
    let files = names_of("cycles_0", &disk);
    assert_eq!(files.len(), 2, "attempts leave nothing: {files:?}");
    let all: Vec<u64> = files.iter().flat_map(|name| disk.cycles(name)).collect();
    assert_eq!(all.len() as u64, tally.written, "what is said to be written can be read");
    assert_eq!((all[0], *all.last().unwrap()), (0, 7999));
    // Room came at 4 s; the tries were 1, 2 and 4 s apart.
    let again = disk.cycles(&files[1])[0];
    assert!((4001..7990).contains(&again), "{again}");
}

#[test]
fn a_disk_that_is_gone_is_tried_again() {
    let disk = Disk::with(u64::MAX / 2);
    let mut recorder = recorder(&disk, Options { sync_ns: 100 * MS, flush_ns: 50 * MS, ..Options::default() });
    for cycle in 0..3000 {
        disk.is_gone.store((500..700).contains(&cycle), Ordering::SeqCst);
        recorder.push(&record(cycle), cycle * MS);
        recorder.tick(cycle * MS);
    }
    let (tally, outcome) = recorder.finish(3000 * MS);
    outcome.unwrap();
    assert_eq!((tally.files, tally.written + tally.lost), (2, 3000));
    assert!((900..1200).contains(&tally.lost), "{tally:?}");
}

#[test]
fn what_cannot_be_recorded_from_the_start_is_told_at_the_start() {
    let begin = |layout| Recorder::begin(Box::new(Disk::with(50)), layout, Options::default(), 0).map(|_| ()).unwrap_err().to_string();
    assert!(begin(layout()).starts_with("cycles_0001.mcap: "));
    let twice = Layout { joints: vec!["a".into(), "a".into()], ..layout() };
    assert!(begin(twice).contains("\"q.a\" cannot be a column name"));
    let file = tempfile::NamedTempFile::new().unwrap();
    let told = Recorder::begin(Box::new(Folder::new(file.path())), layout(), Options::default(), 0).map(|_| ()).unwrap_err().to_string();
    assert!(told.contains("cycles_0001.mcap"), "{told}");
}

#[test]
fn files_that_are_there_are_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cycles_0001.mcap"), b"mine").unwrap();
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), Options::default(), 0).unwrap();
    recorder.push(&record(0), 0);
    recorder.finish(1).1.unwrap();
    assert_eq!(std::fs::read(folder.path().join("cycles_0001.mcap")).unwrap(), b"mine");
    assert_eq!(cycles(&folder.path().join("cycles_0002.mcap")), [0]);
}

#[test]
fn a_fault_leaves_a_black_box_of_the_seconds_around_it() {
    let disk = Disk::with(u64::MAX / 2);
    let mut recorder = recorder(&disk, Options { keep_cycles: 300, after_cycles: 50, ..Options::default() });
    for cycle in 0..2000 {
        let mut record = record(cycle);
        if cycle >= 1000 {
            (record.phase, record.cause, record.place) = (Phase::SafeStop.code(), Cause::Jump.code(), 2);
            (record.value, record.limit) = ([0.5], [0.25]);
        }
        recorder.push(&record, cycle * MS);
        recorder.tick(cycle * MS);
    }
    let (tally, outcome) = recorder.finish(2000 * MS);
    outcome.unwrap();
    assert_eq!(tally.black_boxes, 1, "one fault, one box");
    let boxes = names_of("cycles_blackbox", &disk);
    assert_eq!(boxes, ["cycles_blackbox_0001.mcap"]);
    assert_eq!(disk.cycles(&boxes[0]), (701..=1050).collect::<Vec<_>>());
    let bytes = disk.files.lock().unwrap()[&boxes[0]].clone();
    let (_guard, path) = made_up::file("box.mcap", &bytes);
    let reason = made_up::read(&path).unwrap().meta.other["reason"].clone();
    assert_eq!(reason, "jump in cycle 1000: place 2, value 0.5, limit 0.25");
}

/// Twelve axes at 4 kHz for a second, as a loop would: nothing finds the ring full, and everything is in the file.
#[test]
fn twelve_axes_at_4_khz_lose_nothing() {
    const CYCLES: u64 = 4000;
    let folder = tempfile::tempdir().unwrap();
    let (mut sink, source) = ring(8192);
    let names = (0..12).map(|i| format!("leg_{i}")).collect();
    let layout = Layout { joints: names, sensors: Vec::new(), ..layout() };
    let seen = Arc::new(AtomicU64::new(0));
    let in_tap = Arc::clone(&seen);
    let tap = Box::new(move |_: &CycleRecord| {
        in_tap.fetch_add(1, Ordering::Relaxed);
    });
    let store = Box::new(Folder::new(folder.path()));
    let handle = spawn(source, store, layout, Options::default(), MonotonicClock::start(), vec![tap]).unwrap();
    let clock = MonotonicClock::start();
    for cycle in 0..CYCLES {
        let mut record = CycleRecord { ..record(cycle) };
        (record.state.n_axes, record.state.valid_q, record.state.valid_tau) = (12, first_bits(12), first_bits(12));
        record.state.stamp_ns = cycle * MS / 4;
        sink.put(&record);
        while clock.now_ns() < cycle * MS / 4 {
            std::thread::sleep(Duration::from_micros(100));
        }
    }
    drop(sink);
    let (progress, outcome) = handle.finish();
    outcome.unwrap();
    assert_eq!((progress.dropped, progress.lost, progress.written, progress.taken), (0, 0, CYCLES, CYCLES));
    assert_eq!(seen.load(Ordering::Relaxed), CYCLES);
    let recording = made_up::read(&folder.path().join("cycles_0001.mcap")).unwrap();
    assert_eq!((recording.len() as u64, recording.signals.len()), (CYCLES, 12 * 7 - 12 + 2));
}

#[test]
fn a_black_box_can_be_asked_for_and_a_full_ring_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (mut sink, source) = ring(16);
    (0..20).for_each(|cycle| sink.put(&record(cycle)));
    let options = Options { after_cycles: 0, ..Options::default() };
    let handle = spawn(source, Box::new(Folder::new(folder.path())), layout(), options, MonotonicClock::start(), Vec::new()).unwrap();
    while handle.progress().taken < 16 {
        std::thread::sleep(Duration::from_millis(1));
    }
    handle.black_box("somebody wants it");
    while handle.progress().black_boxes == 0 {
        assert!(handle.is_alive());
        std::thread::sleep(Duration::from_millis(1));
    }
    let (progress, outcome) = handle.finish();
    outcome.unwrap();
    assert_eq!((progress.dropped, progress.written), (4, 16));
    assert_eq!(cycles(&folder.path().join("cycles_blackbox_0001.mcap")), (0..16).collect::<Vec<_>>());
}

/// Name of the variable that makes this test's program the one that is killed.
const CHILD: &str = "PKM_TEST_RECORDS_INTO";

#[test]
fn a_kill_loses_half_a_second_at_most() {
    if let Some(folder) = std::env::var_os(CHILD) {
        return record_until_killed(Path::new(&folder));
    }
    for run in 0..3 {
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "a_kill_loses_half_a_second_at_most", "--nocapture"])
            .env(CHILD, folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut told = io::BufReader::new(child.stdout.take().unwrap());
        // Numbers of cycles as they are handed to the ring; the last that is told before the kill was pushed for sure.
        let mut last = 0;
        let wanted = 1500 + 170 * run;
        let mut line = String::new();
        while last < wanted && io::BufRead::read_line(&mut told, &mut line).unwrap() > 0 {
            last = line.trim().strip_prefix("cycle ").and_then(|n| n.parse().ok()).unwrap_or(last);
            line.clear();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let path = folder.path().join("cycles_0001.mcap");
        let error = made_up::read(&path).unwrap_err().to_string();
        assert!(error.contains("pkm convert --recover"), "{error}");
        let found = cycles(&path);
        assert_eq!(found, (0..found.len() as u64).collect::<Vec<_>>(), "nothing is missing in between");
        let lost = last - found.last().unwrap().min(&last);
        println!("killed after cycle {last}: {lost} ms lost");
        assert!(lost <= 500, "{lost} ms");
        let files = pkm_record::read_attachments(&path, &made_up::recover()).unwrap().files;
        assert_eq!(files, made_up::attachments().files);
    }
}

/// 1 kHz until the end, telling every tenth cycle.
fn record_until_killed(folder: &Path) {
    let (mut sink, source) = ring(8192);
    let store = Box::new(Folder::new(folder));
    let _handle = spawn(source, store, layout(), Options::default(), MonotonicClock::start(), Vec::new()).unwrap();
    let clock = MonotonicClock::start();
    // A minute at the most: a parent that is gone must not leave this running.
    for cycle in 0..60_000 {
        sink.put(&record(cycle));
        if cycle % 10 == 0 {
            println!("\ncycle {cycle}");
            io::stdout().flush().unwrap();
        }
        while clock.now_ns() < cycle * MS {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
}
