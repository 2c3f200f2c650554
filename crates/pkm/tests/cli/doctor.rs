//! `pkm doctor`: what it says, what it measured, and what its exit status means.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

use serde_json::Value;

use crate::fixture::{pkm, refused, rig};

/// Somebody who owns nothing and may nothing, if this is somebody who can become him.
const NOBODY: &str = "exec setpriv --reuid 65534 --regid 65534 --clear-groups";

/// The same with two of root's rights, as a unit with `AmbientCapabilities=` gives them.
const WITH_RIGHTS: &str = "--inh-caps +sys_nice,+ipc_lock --ambient-caps +sys_nice,+ipc_lock";

/// `pkm doctor` as started by this line of a shell: what it found of scheduling and memory (state, words, advice), after a look at whether
/// its exit status, what programs are told and what people are told agree.
fn examined(program: &str, before: &str) -> [[String; 3]; 2] {
    let run = |flags: &str| {
        let script = format!("{before} {program} doctor --seconds 0 --priority 80 {flags}");
        let output = Command::new("sh").args(["-c", &script]).current_dir("/").output().unwrap();
        let told = String::from_utf8(output.stdout).unwrap();
        assert!(output.stderr.is_empty(), "{script}: {}", String::from_utf8_lossy(&output.stderr));
        (output.status.code(), told)
    };
    let ((code, told), (text_code, text)) = (run("--json"), run(""));
    let told: Value = serde_json::from_str(&told).unwrap();
    let findings = told["findings"].as_array().unwrap();
    let is_bad = findings.iter().any(|finding| finding["state"] == "bad");
    assert_eq!((code, &told["fit"]), (Some(i32::from(is_bad)), &(!is_bad).into()), "{told}");
    assert_eq!((text_code, text.lines().any(|line| line.starts_with("BAD "))), (code, is_bad), "{text}");
    ["scheduling", "memory"].map(|what| {
        let finding = findings.iter().find(|finding| finding["what"] == what).unwrap();
        let [state, found, advice] = ["state", "found", "advice"].map(|key| finding[key].as_str().unwrap().to_string());
        assert!(text.contains(&found) && text.contains(&advice), "{text}");
        [state, found, advice]
    })
}

/// The first command of an advice.
fn command(advice: &str) -> &str {
    advice.split('`').nth(1).unwrap_or_else(|| panic!("no command in {advice:?}"))
}

#[test]
fn rights_that_are_taken_are_missed_and_those_that_are_given_are_found() {
    let folder = rig();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let program = folder.path().join("pkm");
    fs::copy(env!("CARGO_BIN_EXE_pkm"), &program).unwrap();
    let program = program.to_str().unwrap();
    let shell = |script: &str| Command::new("sh").args(["-c", script]).output().is_ok_and(|output| output.status.success());
    // Root's rights are above limits: they are tried as somebody else.
    let is_root = rustix::process::geteuid().is_root();
    let nobody = if is_root { NOBODY } else { "exec" };
    let none = "ulimit -l 64; ulimit -r 0;";
    let [scheduling, memory] = examined(program, &format!("{none} {nobody}"));
    assert_eq!([&scheduling[0], &memory[0]], ["bad"; 2]);
    assert!(scheduling[1].starts_with("SCHED_FIFO 80: Operation not permitted"), "{scheduling:?}");
    assert_eq!(memory[1], "locked memory: the limit is 65536 bytes: not granted");
    // Other limits, other numbers; still too little.
    let less = examined(program, &format!("ulimit -l 16; ulimit -r 0; {nobody}"));
    assert_eq!(less[1][1], "locked memory: the limit is 16384 bytes: not granted");
    if is_root && shell(&format!("{NOBODY} {WITH_RIGHTS} true")) {
        let given = examined(program, &format!("{none} {nobody} {WITH_RIGHTS}"));
        assert_eq!(given, granted(), "rights are above limits");
        let half = examined(program, &format!("{none} {nobody} --inh-caps +sys_nice --ambient-caps +sys_nice"));
        assert_eq!(half, [granted()[0].clone(), memory.clone()], "each by itself");
    }
    // What is advised, word for word: where limits can be raised at all.
    let [fifo, lock] = [&scheduling, &memory].map(|finding| command(&finding[2]));
    if shell(&format!("{fifo} && {lock}")) {
        assert_eq!(examined(program, &format!("{fifo}; {lock}; {nobody}")), granted(), "with both advices followed");
        let half = examined(program, &format!("ulimit -l 64; {fifo}; {nobody}"));
        assert_eq!(half, [granted()[0].clone(), memory], "with the first followed");
    } else {
        println!("advice not followed: nobody here may raise limits (CAP_SYS_RESOURCE)");
    }
}

fn granted() -> [[String; 3]; 2] {
    ["SCHED_FIFO 80: granted", "locked memory: granted"].map(|found| ["good", found, ""].map(str::to_string))
}

#[test]
fn a_machine_is_looked_at_and_measured() {
    let folder = rig();
    let output = pkm(folder.path(), &["doctor", "--seconds", "1", "--rate", "500", "--json"]);
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&told["schema"], &told["period_us"]), (&"pkm.doctor/1".into(), &2000.0.into()));
    let findings = told["findings"].as_array().unwrap();
    let of = |what: &str| findings.iter().find(|f| f["what"] == what).unwrap_or_else(|| panic!("no {what} in {told}"));
    for what in ["kernel", "preemption", "scheduling", "memory", "frequency governor", "isolated cores", "clock source", "wake-ups"] {
        of(what);
    }
    // What the kernel itself says.
    let release = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap();
    assert_eq!(of("kernel")["found"], release.trim());
    for finding in findings {
        let is_good = finding["state"] == "good";
        assert!(is_good || !finding["found"].as_str().unwrap().is_empty(), "{finding}");
    }
    let runs = told["jitter"].as_array().unwrap();
    assert_eq!((runs.len(), &runs[0]["granted"]), (2, &false.into()));
    assert_eq!(runs[1]["granted"], of("scheduling")["state"] == "good", "what is granted to the look is granted to the loop");
    for run in runs {
        for kind in ["bare", "loop"] {
            let number = |key: &str| run[kind][key].as_f64().unwrap();
            // A second at 500 Hz; a machine that is busy elsewhere skips some.
            assert!((50.0..=500.0).contains(&number("wakes")), "{run}");
            assert!(number("p50_us") <= number("p99_us") && number("p999_us") <= number("max_us") && number("max_us") > 0.0, "{run}");
        }
    }
    for kind in ["bare", "own"] {
        let number = |key: &str| told["shared_memory"][kind][key].as_f64().unwrap();
        // Two threads that share a core take turns of milliseconds.
        assert!(number("count") >= 3.0, "{told}");
        assert!(number("p50_us") <= number("p99_us") && number("p999_us") <= number("max_us"), "{told}");
        // A sample through two shared caches takes no less than a tenth of a microsecond.
        assert!(number("p50_us") > 0.1, "{told}");
    }
    let number = |key: &str| told["logging"][key].as_f64().unwrap();
    // A disk that could not take the fastest loop would be a finding; twelve axes are more than half a kilobyte, packed or not.
    assert!(number("periods_per_s") > 1000.0 && number("bytes_per_s") > 500.0 * number("periods_per_s"), "{told}");
    assert!((1000.0..=4001.0).contains(&number("periods_at_4_khz")) && number("lost_at_4_khz") == 0.0, "{told}");
    let is_bad = findings.iter().any(|f| f["state"] == "bad");
    assert_eq!(output.status.code(), Some(i32::from(is_bad)));
    assert_eq!(told["fit"], !is_bad);
}

#[test]
fn words_for_people_and_refusals() {
    let folder = rig();
    let output = pkm(folder.path(), &["doctor", "--seconds", "0"]);
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.contains("clock source") && !told.contains("Wake-ups every"), "{told}");
    for arguments in [["--rate", "0"], ["--rate", "100000"], ["--seconds", "x"], ["--priority", "99"]] {
        refused(folder.path(), &[&["doctor"][..], &arguments].concat(), &[arguments[0]]);
    }
}
