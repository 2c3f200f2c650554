//! The reader `frames` under libFuzzer; seeds: `tests/corpora/frames`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::frames(bytes));
