//! The reader `controller_toml` under libFuzzer; seeds: `tests/corpora/controller_toml`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::controller_toml(bytes));
