//! MCAP files that are whole but say impossible things.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

extern crate alloc;

mod made_up;

use alloc::collections::BTreeMap;
use std::io::Cursor;

use made_up::{file, read, recover};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use pkm_record::ReadError;

/// A `JointState` in CDR at `k` ms with that joint alone.
fn message(k: u32, joint: &str, position: f64) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let text = |bytes: &mut Vec<u8>, text: &str| {
        bytes.resize((bytes.len() - 4).next_multiple_of(4) + 4, 0);
        bytes.extend((u32::try_from(text.len()).unwrap() + 1).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.push(0);
    };
    bytes.extend((k / 1000).to_le_bytes());
    bytes.extend((k % 1000 * 1_000_000).to_le_bytes());
    text(&mut bytes, "");
    bytes.resize((bytes.len() - 4).next_multiple_of(4) + 4, 0);
    bytes.extend(1u32.to_le_bytes());
    text(&mut bytes, joint);
    bytes.resize((bytes.len() - 4).next_multiple_of(4) + 4, 0);
    bytes.extend(1u32.to_le_bytes());
    bytes.resize((bytes.len() - 4).next_multiple_of(8) + 4, 0);
    bytes.extend(position.to_le_bytes());
    bytes.extend([0; 8]);
    bytes
}

fn bag(options: WriteOptions, messages: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut writer = options.compression_threads(0).create(&mut out).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/joint_states", "cdr", &BTreeMap::new()).unwrap();
    for message in messages {
        let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
        writer.write_to_known_channel(&header, message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    out.into_inner()
}

fn three() -> Vec<Vec<u8>> {
    (0..3).map(|k| message(k, "a", f64::from(k))).collect()
}

#[test]
fn an_unreadable_message_is_named_and_left_out_on_recovery() {
    let mut messages = three();
    messages[1].truncate(30);
    let (_guard, path) = file("A.mcap", &bag(WriteOptions::new(), &messages));
    let text = read(&path).unwrap_err().to_string();
    assert!(text.contains("message 2 of topic /joint_states cannot be read: the message ends too early"), "{text}");
    let rest = pkm_record::read(&path, &recover()).unwrap();
    assert_eq!(rest.time, [0.0, 0.002]);
    assert!(rest.meta.other.contains_key("recovered"));
}

#[test]
fn an_infinite_value_is_named() {
    let mut messages = three();
    messages[2] = message(2, "a", f64::NEG_INFINITY);
    let (_guard, path) = file("A.mcap", &bag(WriteOptions::new(), &messages));
    let text = read(&path).unwrap_err().to_string();
    assert!(text.ends_with("A.mcap at t = 0.002 s, column q.a: -inf is not finite"), "{text}");
}

#[test]
fn files_without_chunks_or_compression_are_read() {
    for options in [WriteOptions::new().use_chunks(false), WriteOptions::new().compression(None)] {
        let (_guard, path) = file("A.mcap", &bag(options, &three()));
        assert_eq!(read(&path).unwrap().signal("q.a").unwrap(), [0.0, 1.0, 2.0]);
    }
}

#[test]
fn a_changed_value_outside_of_chunks_is_found_by_the_sum_of_the_file() {
    let mut bytes = bag(WriteOptions::new().use_chunks(false), &three());
    let value = 2f64.to_le_bytes();
    let at = bytes.windows(8).position(|w| w == value).unwrap();
    bytes[at + 7] ^= 1;
    let (_guard, path) = file("A.mcap", &bytes);
    let text = read(&path).unwrap_err().to_string();
    assert!(text.contains("check sum of the data"), "{text}");
}

/// Five megabytes that would make 20 000 columns of 20 000 samples.
#[test]
fn columns_for_every_message_are_refused() {
    let messages: Vec<Vec<u8>> = (0..20_000).map(|k| message(k, &format!("j{k}"), 1.0)).collect();
    let bytes = bag(WriteOptions::new().compression(Some(Compression::Lz4)), &messages);
    let (_guard, path) = file("A.mcap", &bytes);
    let error = read(&path).unwrap_err();
    assert!(matches!(error, ReadError::TooSparse { .. } | ReadError::Message { .. }), "{error}");
}

/// The claim is in the chunk header: nothing of that size may be allocated before the claim is checked.
#[test]
fn a_chunk_that_claims_too_much_is_refused() {
    let whole = bag(WriteOptions::new().compression(Some(Compression::Lz4)), &three());
    // Magic, header record, then the chunk: its size claim is 16 bytes into the record.
    let header = u64::from_le_bytes(whole[9..17].try_into().unwrap());
    let chunk = 17 + usize::try_from(header).unwrap();
    assert_eq!(whole[chunk], 6, "the chunk is where it is looked for");
    for claim in [(256 << 20) + 1, 1 << 40, u64::MAX] {
        let mut bytes = whole.clone();
        bytes[chunk + 25..chunk + 33].copy_from_slice(&u64::to_le_bytes(claim));
        let (_guard, path) = file("A.mcap", &bytes);
        let text = read(&path).unwrap_err().to_string();
        assert!(text.contains(&format!("byte {chunk}: a chunk claims {claim} bytes")), "{text}");
    }
}

/// What a killed writer leaves: an open chunk whose length is still all ones.
#[test]
fn an_open_chunk_is_an_error_that_says_what_is_left() {
    let whole = bag(WriteOptions::new(), &three());
    let at = whole.windows(9).position(|w| w[0] == 15 && w[1..] == 4u64.to_le_bytes()).unwrap();
    let mut bytes = whole[..at].to_vec();
    bytes.push(6);
    bytes.extend(u64::MAX.to_le_bytes());
    bytes.extend([0; 40]);
    let (_guard, path) = file("A.mcap", &bytes);
    let text = read(&path).unwrap_err().to_string();
    let wanted = format!(
        "A.mcap byte {at}: a record (opcode 0x06) of 18446744073709551615 bytes, but 40 are left in the file; 3 messages are readable, \
         `pkm convert --recover` mends the file"
    );
    assert!(text.ends_with(&wanted), "{text}");
    assert_eq!(pkm_record::read(&path, &recover()).unwrap().len(), 3);
}
