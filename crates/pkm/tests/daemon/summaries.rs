//! `--json` of the daemon and of its driver: one object on standard output when they have ended, and nothing else there.

use std::fs;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::site::{CONFIG, CONTROLLER, Site};
use crate::soak::on_the_grid;

/// A process to its end, its outputs apart.
fn ended(site: &Site, verb: &str, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
    command.arg(verb).arg(site.config()).args(more).current_dir(site.dir.path()).stdin(Stdio::null());
    command.output().unwrap()
}

/// The one object.
fn object(out: &Output) -> Value {
    let text = String::from_utf8_lossy(&out.stdout);
    assert_eq!(text.lines().count(), 1, "{text}");
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Every rate that is taken, at its ends: what is recorded is every period that ran, on the grid of that rate.
#[test]
fn a_daemon_sums_up_what_it_did_at_the_slowest_and_at_the_fastest_rate() {
    for (rate, period_ns) in [("100.0", 10_000_000), ("4000.0", 250_000)] {
        let site = Site::new();
        fs::write(site.config(), CONFIG.replace("\"iceoryx2\"", "\"simulated\"")).unwrap();
        fs::write(site.dir.path().join("controller.toml"), CONTROLLER.replace("100.0", rate)).unwrap();
        let out = ended(&site, "daemon", &["--start", "--seconds", "5", "--record", "runs", "--json"]);
        assert_eq!(out.status.code(), Some(0), "{}", said(&out));
        let told = object(&out);
        assert_eq!((&told["schema"], &told["error"]), (&"pkm.daemon/1".into(), &Value::Null), "{told}");
        let version = Command::new(env!("CARGO_BIN_EXE_pkm")).arg("--version").output().unwrap();
        assert_eq!(format!("pkm {}\n", told["pkm"].as_str().unwrap()), String::from_utf8_lossy(&version.stdout));
        let status = &told["status"];
        assert!((status["period_s"].as_f64().unwrap() - 1e-9 * period_ns as f64).abs() < 1e-12, "{status}");
        assert_eq!((&status["robot"], &status["law"]), (&"prs3".into(), &"computed_torque".into()));
        // It may have been on its way home for all of that time; it has been armed.
        let transitions = status["transitions"].as_array().unwrap();
        assert!(transitions.iter().any(|t| t["from"] == "ready" && t["to"] == "homing"), "{status}");
        let recorded = &told["recording"];
        assert_eq!((&recorded["lost"], &recorded["files"], &recorded["error"]), (&0.into(), &1.into(), &Value::Null), "{told}");
        assert_eq!(recorded["periods"], status["periods"]);
        let files: Vec<_> = fs::read_dir(site.dir.path().join("runs")).unwrap().map(|f| f.unwrap().path()).collect();
        assert_eq!(on_the_grid(&files, period_ns), status["periods"].as_u64().unwrap());
        // What a person reads is on standard error then.
        assert!(said(&out).contains("ready -> homing, order") && said(&out).contains("recorded "), "{}", said(&out));
        let out = ended(&site, "daemon", &["--seconds", "0.2", "--json", "--quiet"]);
        assert_eq!((object(&out)["recording"].clone(), said(&out).as_str()), (Value::Null, ""));
    }
}

#[test]
fn a_driver_sums_up_what_it_did() {
    let site = Site::new();
    let _daemon = site.start("daemon");
    site.until(&["off"]);
    let out = ended(&site, "driver-sim", &["--seconds", "3", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let told = object(&out);
    assert_eq!((&told["schema"], &told["error"], &told["robot"]), (&"pkm.driver_sim/1".into(), &Value::Null, &"prs3".into()), "{told}");
    // Nobody has armed it, so nobody was lost and nothing was asked for.
    for key in ["commands_taken", "commands_refused", "times_lost"] {
        assert_eq!(told[key], 0, "{key}: {told}\n{}", site.logs());
    }
    assert!(told["daemons_heard"].as_u64().unwrap() > 0, "{told}\n{}", site.logs());
    assert!(told["states_sent"].as_u64().unwrap() > 0 && told["last_refusal"].is_null(), "{told}");
    assert_eq!(told["round_trip"]["count"], 0);
    assert!(said(&out).contains("driver of process ") && said(&out).contains(" states sent, "), "{}", said(&out));
}

#[test]
fn a_configuration_is_told_for_programs_and_a_rate_out_of_range_is_refused() {
    let site = Site::new();
    let out = ended(&site, "daemon", &["--check", "--json"]);
    let told = object(&out);
    assert_eq!((&told["schema"], &told["rate_hz"], &told["drives"]), (&"pkm.daemon_check/1".into(), &100.0.into(), &3.into()), "{told}");
    for rate in ["99.0", "4001.0"] {
        fs::write(site.dir.path().join("controller.toml"), CONTROLLER.replace("100.0", rate)).unwrap();
        for verb in ["daemon", "driver-sim"] {
            let out = ended(&site, verb, &["--json"]);
            assert_eq!((out.status.code(), out.stdout.len()), (Some(78), 0));
            let rate = rate.trim_end_matches(".0");
            let want = format!("daemon.toml:3: controller: \"controller.toml\" has rate_hz = {rate} (must be 100 to 4000 Hz)\n");
            assert!(said(&out).ends_with(&want) && said(&out).lines().count() == 1, "{}", said(&out));
        }
    }
    assert!(!site.dir.path().join("meet").exists());
}
