//! The reader `csv` under libFuzzer; seeds: `tests/corpora/csv`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pkm_tests::fuzzing::csv(bytes));
