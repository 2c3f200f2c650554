//! The reader `mcap` under libFuzzer; seeds: `tests/corpora/mcap`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::mcap(bytes));
