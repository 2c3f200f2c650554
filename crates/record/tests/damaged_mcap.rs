//! Damaged MCAP files: a message or what is complete, never a panic, and no memory taken on the word of a length.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]
mod made_up;

use std::path::Path;

use made_up::{Noise, attachments, bits, read, recording, recover};
use pkm_record::{ReadError, read_attachments, write};

fn content(samples: u32) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let mut small = recording(samples, 0.0);
    if samples < 100 {
        small.signals.retain(|name, _| name.ends_with(".a"));
    }
    write(&path, &small, &attachments()).unwrap();
    std::fs::read(&path).unwrap()
}

fn put(path: &Path, content: &[u8]) {
    std::fs::write(path, content).unwrap();
}

#[test]
fn a_cut_at_every_byte_is_an_error_and_never_a_panic() {
    let whole = content(6);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let mut recovered = 0;
    for end in 0..whole.len() {
        put(&path, &whole[..end]);
        let error = read(&path).unwrap_err();
        if let ReadError::Damaged { byte, .. } = &error {
            assert!(*byte <= end as u64, "{error}");
        }
        if let Ok(part) = pkm_record::read(&path, &recover()) {
            assert_eq!(part.len(), 6, "one chunk: all of it or nothing");
            assert!(part.meta.other.contains_key("recovered"));
            recovered += 1;
        }
        let _ = read_attachments(&path, &recover());
    }
    assert!(recovered > 100, "{recovered}");
    put(&path, &whole);
    read(&path).unwrap();
}

#[test]
fn complete_chunks_of_a_cut_file_are_recovered() {
    let whole = content(1500);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    put(&path, &whole);
    let full = read(&path).unwrap();
    let mut last = 0;
    for part in 1..=20 {
        put(&path, &whole[..whole.len() * part / 21]);
        let error = read(&path).unwrap_err();
        let ReadError::Damaged { messages, .. } = error else { panic!("{error}") };
        assert!(error.to_string().contains("messages are readable, `pkm convert --recover` mends the file"), "{error}");
        let Ok(recovered) = pkm_record::read(&path, &recover()) else {
            assert_eq!(messages, 0);
            continue;
        };
        assert_eq!(recovered.meta.load, full.meta.load);
        assert_eq!(recovered.time, full.time[..recovered.len()]);
        // The last sample may have lost topics to the next chunk; all before are whole.
        let sure = recovered.len() - 1;
        for (name, values) in &bits(&full) {
            let back: Vec<u64> = recovered.signal(name).unwrap()[..sure].iter().map(|v| v.to_bits()).collect();
            assert_eq!(back, values[..sure], "{name}");
        }
        assert!(recovered.len() >= last);
        last = recovered.len();
    }
    assert!((1000..1500).contains(&last), "{last}");
}

#[test]
fn a_broken_chunk_in_the_middle_costs_that_chunk() {
    let mut whole = content(1500);
    let middle = whole.len() / 2;
    whole[middle] ^= 0x10;
    let (_guard, path) = made_up::file("A.mcap", &whole);
    let error = read(&path).unwrap_err();
    assert!(matches!(error, ReadError::Damaged { .. }), "{error}");
    let rest = pkm_record::read(&path, &recover()).unwrap();
    assert!((900..1500).contains(&rest.len()), "{}", rest.len());
    assert_eq!(rest.time.last(), Some(&1.499));
}

#[test]
fn random_flips_never_panic_and_never_pass_for_data() {
    let whole = content(6);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    put(&path, &whole);
    let truth = read(&path).unwrap();
    let mut noise = Noise(3);
    let mut passed = 0;
    for _ in 0..4000 {
        let mut bytes = whole.clone();
        for _ in 0..=noise.below(3) {
            let at = noise.below(bytes.len());
            bytes[at] ^= 1 << noise.below(8);
        }
        put(&path, &bytes);
        if let Ok(same) = read(&path) {
            // Only the index at the end of the file has no say in what is read.
            assert_eq!(bits(&same), bits(&truth));
            assert_eq!(same.meta, truth.meta);
            passed += 1;
        }
        let _ = pkm_record::read(&path, &recover());
    }
    assert!(passed < 3000, "{passed}");
}

#[test]
fn hostile_lengths_are_refused_at_once() {
    let whole = content(6);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let mut noise = Noise(5);
    for _ in 0..2000 {
        let mut bytes = whole.clone();
        let at = noise.below(bytes.len() - 8);
        let length = [u64::MAX, u64::MAX >> 1, 1 << 40, 1 << 32, (1 << 28) + 1, u64::from(u32::MAX)][noise.below(6)];
        bytes[at..at + 8].copy_from_slice(&length.to_le_bytes());
        put(&path, &bytes);
        let _ = read(&path);
        let _ = pkm_record::read(&path, &recover());
    }
}

#[test]
fn bytes_behind_the_end_are_told() {
    let mut two = content(6);
    two.extend(two.clone());
    let (_guard, path) = made_up::file("A.mcap", &two);
    let text = read(&path).unwrap_err().to_string();
    assert!(text.contains("bytes follow the end of the recording"), "{text}");
}

#[test]
fn an_mcap_file_under_another_name_is_read() {
    let (_guard, path) = made_up::file("A.csv", &content(6));
    assert_eq!(read(&path).unwrap().len(), 6);
}
