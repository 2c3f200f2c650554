//! `pkm doctor`: what it says, what it measured, and what its exit status means.

use serde_json::Value;

use crate::fixture::{pkm, refused, rig};

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
    let release = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap();
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
