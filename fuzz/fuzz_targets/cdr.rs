//! The reader `cdr` under libFuzzer; seeds: `tests/corpora/cdr`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::cdr(bytes));
