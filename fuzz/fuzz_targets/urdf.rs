//! The reader `urdf` under libFuzzer; seeds: `tests/corpora/urdf`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::urdf(bytes));
