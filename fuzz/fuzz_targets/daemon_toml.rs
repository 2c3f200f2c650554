//! The reader `daemon_toml` under libFuzzer; seeds: `tests/corpora/daemon_toml`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::daemon_toml(bytes));
