//! Recording a loop of twelve axes: what a period costs the loop (ring), what it costs the recorder (MCAP), and what is dropped at 4 kHz.
#![expect(clippy::print_stdout, reason = "a bench tells what it counted")]

use core::hint::black_box;
use core::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pkm_hal::cycle::ring::ring;
use pkm_hal::cycle::{CycleRecord, CycleSink, CycleSource, flags};
use pkm_hal::frame::first_bits;
use pkm_hal::{Clock, MonotonicClock};
use pkm_record::cycles::{Folder, Layout, Options, Recorder, spawn};

const AXES: usize = 12;
const PERIOD_NS: u64 = 250_000;

fn layout() -> Layout {
    Layout { joints: (0..AXES).map(|i| format!("leg_{i}")).collect(), ..Layout::default() }
}

/// A period whose numbers change as those of a robot do: no two alike, so that nothing packs too well.
fn record(cycle: u64) -> CycleRecord {
    let mut out = CycleRecord::new(AXES, 0);
    (out.cycle, out.planned_ns, out.flags) = (cycle, cycle * PERIOD_NS, flags::NEW_STATE | flags::COMMANDED);
    (out.state.stamp_ns, out.state.valid_q) = (out.planned_ns, first_bits(AXES));
    (out.state.valid_v, out.state.valid_tau) = (first_bits(AXES), first_bits(AXES));
    for i in 0..AXES {
        let x = (cycle as f64 + i as f64 * 0.37) * 1e-3;
        let wave = x - x.floor();
        (out.state.q[i], out.state.v[i], out.state.tau[i]) = (wave * wave, wave / 3.0, wave * 7.1);
        (out.q_ref[i], out.v_ref[i], out.a_ref[i], out.tau_sent[i]) = (wave, wave / 7.0, wave / 11.0, wave * 13.0);
    }
    out
}

fn cost_to_the_loop(c: &mut Criterion) {
    let (mut sink, mut source) = ring(8192);
    let record = record(1);
    c.bench_function("a period into the ring", |b| {
        b.iter(|| {
            sink.put(black_box(&record));
            // Taken out again, or the ring fills; the recorder's half of it is in this number too.
            source.take()
        });
    });
}

fn cost_to_the_recorder(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let options = Options { rotate_bytes: 256 << 20, ..Options::default() };
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), options, 0).expect("a recording");
    let mut cycle = 0;
    let mut group = c.benchmark_group("recorder");
    group.throughput(Throughput::Elements(1));
    group.bench_function("a period of twelve axes into MCAP", |b| {
        b.iter(|| {
            recorder.push(&record(cycle), cycle * PERIOD_NS);
            recorder.tick(cycle * PERIOD_NS);
            cycle += 1;
        });
    });
    group.finish();
}

/// Ten seconds at 4 kHz in real time: counted, not timed.
fn drops_at_4_khz(_: &mut Criterion) {
    const CYCLES: u64 = 40_000;
    let folder = tempfile::tempdir().expect("a folder");
    let (mut sink, source) = ring(8192);
    let store = Box::new(Folder::new(folder.path()));
    let handle = spawn(source, store, layout(), Options::default(), MonotonicClock::start(), Vec::new()).expect("a recording");
    let clock = MonotonicClock::start();
    for cycle in 0..CYCLES {
        sink.put(&record(cycle));
        while clock.now_ns() < cycle * PERIOD_NS {
            std::thread::sleep(Duration::from_micros(50));
        }
    }
    let took = clock.now_ns() as f64 * 1e-9;
    drop(sink);
    let (progress, outcome) = handle.finish();
    outcome.expect("a disk that takes it");
    let bytes: u64 =
        std::fs::read_dir(folder.path()).expect("the folder").flatten().filter_map(|e| e.metadata().ok()).map(|m| m.len()).sum();
    println!(
        "4 kHz x {AXES} axes: {CYCLES} periods in {took:.2} s, {} dropped, {} lost, {} written, {:.1} MB",
        progress.dropped,
        progress.lost,
        progress.written,
        bytes as f64 * 1e-6
    );
    assert_eq!((progress.dropped, progress.lost, progress.written), (0, 0, CYCLES));
}

criterion_group!(benches, cost_to_the_loop, cost_to_the_recorder, drops_at_4_khz);
criterion_main!(benches);
