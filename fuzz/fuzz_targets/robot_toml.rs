//! The reader `robot_toml` under libFuzzer; seeds: `tests/corpora/robot_toml`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::robot_toml(bytes));
