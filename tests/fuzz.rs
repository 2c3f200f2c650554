//! Readers of files and frames under thousands of changed inputs, each target in a process of its own with little memory and little time: no abort, no
//! panic, no hang. `PKM_LONG` makes it many more.

use core::time::Duration;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use pkm_hal::{Clock, MonotonicClock};
use pkm_tests::Draw;
use pkm_tests::fuzzing::{TARGETS, mutated, seeds, target};

/// Variables that make this test's program the one that reads.
const NAME: &str = "PKM_FUZZ_TARGET";
const INPUTS: &str = "PKM_FUZZ_INPUTS";
const PROGRESS: &str = "PKM_FUZZ_PROGRESS";

/// Memory of a child `[KiB]`.
const MEMORY_KIB: u64 = 4 << 20;

/// How long one input may take at the most `[s]`; builds for tests on a busy machine are slow.
const PATIENCE_S: f64 = 30.0;

fn how_many() -> u64 {
    if std::env::var_os("PKM_LONG").is_some() { 50_000 } else { 400 }
}

/// Input `k` of a target: the seeds as they are, then changes of them.
fn input(seeds: &[Vec<u8>], k: u64) -> Vec<u8> {
    match usize::try_from(k).ok().and_then(|k| seeds.get(k)) {
        Some(seed) => seed.clone(),
        None => mutated(seeds, &mut Draw::new(k)),
    }
}

#[test]
fn readers_end_whatever_they_are_given() {
    if let Ok(name) = std::env::var(NAME) {
        return read(&name);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let children: Vec<(&str, Child)> = TARGETS.iter().map(|t| (t.name, start(t.name, how_many(), folder.path()))).collect();
    for (name, mut child) in children {
        let (mut last, mut told) = (0, MonotonicClock::start());
        let status = loop {
            if let Some(status) = child.try_wait().expect("a child") {
                break status;
            }
            let at = progress(folder.path(), name);
            if at != last {
                (last, told) = (at, MonotonicClock::start());
            }
            let waited = told.now_ns() as f64 * 1e-9;
            if waited > PATIENCE_S {
                child.kill().expect("a child to kill");
                panic!("{name}: input {at} takes more than {PATIENCE_S} s");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        let at = progress(folder.path(), name);
        assert!(status.success(), "{name}: {status} at input {at} ({}={name} {}={at})", NAME, INPUTS);
        assert_eq!(at, how_many(), "{name} read every input");
    }
}

fn start(name: &str, inputs: u64, folder: &Path) -> Child {
    let program = std::env::current_exe().expect("this program");
    let limited = format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &limited])
        .arg(program)
        .args(["--exact", "readers_end_whatever_they_are_given"])
        .env(NAME, name)
        .env(INPUTS, inputs.to_string())
        .env(PROGRESS, folder.join(name))
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .spawn()
        .expect("a shell")
}

fn progress(folder: &Path, name: &str) -> u64 {
    fs::read_to_string(folder.join(name)).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0)
}

/// The child: one input after the other, each told before it is read.
#[expect(clippy::print_stdout, reason = "who starts one target by hand wants to see that it ended")]
fn read(name: &str) {
    let target = target(name).expect("a target");
    let inputs: u64 = std::env::var(INPUTS).expect("a number").parse().expect("a number");
    let told = std::env::var_os(PROGRESS);
    let seeds = seeds(name);
    let mut largest: (f64, u64) = (0.0, 0);
    for k in 0..=inputs {
        if let Some(told) = &told {
            fs::write(told, k.to_string()).expect("a file for the progress");
        }
        if k < inputs {
            let input = input(&seeds, k);
            let clock = MonotonicClock::start();
            (target.run)(&input);
            let took = clock.now_ns() as f64 * 1e-9;
            largest = if took > largest.0 { (took, k) } else { largest };
        }
    }
    println!("{name}: {inputs} inputs, the slowest {} took {:.3} s", largest.1, largest.0);
}

#[test]
fn every_target_has_seeds_that_it_reads_and_changes_that_differ() {
    for target in TARGETS {
        let seeds = seeds(target.name);
        assert!(!seeds.is_empty() && seeds.iter().all(|seed| !seed.is_empty()), "{}", target.name);
        let inputs: Vec<Vec<u8>> = (0..40).map(|k| input(&seeds, k + seeds.len() as u64)).collect();
        let changed = inputs.iter().filter(|input| !seeds.contains(input)).count();
        assert!(changed > 30, "{}: {changed} of 40 differ", target.name);
        assert_eq!(inputs[7], input(&seeds, 7 + seeds.len() as u64), "the same in every run");
    }
}

/// libFuzzer's program is of another workspace, which nothing here compiles: what can be seen of it is that no target is forgotten.
#[test]
fn every_target_has_its_twin_under_libfuzzer() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
    let list = fs::read_to_string(folder.join("Cargo.toml")).expect("the list of programs");
    let named: Vec<&str> = list.lines().filter_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"')).skip(1).collect();
    assert_eq!(named, TARGETS.map(|target| target.name));
    for name in named {
        let text = fs::read_to_string(folder.join(format!("fuzz_targets/{name}.rs"))).expect("the program");
        assert!(text.contains(&format!("pkm_tests::fuzzing::{name}(bytes)")), "{name}");
    }
}

/// The guard guards: a child that aborts, or that wants more memory than there is, is noticed.
#[test]
fn a_child_that_dies_is_noticed() {
    let limited = |what: &str| {
        let status = Command::new("sh").args(["-c", &format!("ulimit -v {MEMORY_KIB}; {what}")]).stderr(Stdio::null()).status();
        status.expect("a shell").success()
    };
    assert!(!limited("kill -ABRT $$"));
    assert!(limited("true"));
}
