//! Changes to seeds that are the same in every run.

use crate::Draw;

/// Numbers and words that readers stumble over.
const WORDS: [&[u8]; 24] = [
    b"nan",
    b"-inf",
    b"1e999",
    b"-0",
    b"1e-320",
    b"99999999999999999999",
    b"-1",
    b"0",
    b"\0",
    b"\r\n",
    b"\"",
    b"'''",
    b"[[",
    b"<!--",
    b"]]>",
    b"&#x0;",
    b"&lol;",
    b"=",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"\0\0\0\x80",
    b"\0\0\0\0\0\0\0\0",
    b"\xef\xbb\xbf",
    b"\xed\xa0\x80",
];

/// Longest input that is made `[bytes]`.
const LONGEST: usize = 1 << 20;

/// One of `seeds`, changed in one to eight places.
#[must_use]
pub fn mutated(seeds: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let Some(seed) = seeds.get(draw.choice(seeds.len().max(1))) else { return Vec::new() };
    let mut bytes = seed.clone();
    for _ in 0..=draw.choice(8) {
        change(&mut bytes, seeds, draw);
        bytes.truncate(LONGEST);
    }
    bytes
}

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Draw) {
    let at = draw.choice(bytes.len() + 1);
    let length = draw.choice(64).min(bytes.len() - at);
    match draw.choice(9) {
        0 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << draw.choice(8);
            }
        }
        1 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte = draw.bits().to_le_bytes()[0];
            }
        }
        2 => {
            bytes.drain(at..at + length);
        }
        3 => bytes.truncate(at),
        4 => {
            // Many times over: what nests, nests deeply.
            let piece = bytes[at..at + length].to_vec();
            let times = [1, 2, 10, 1000][draw.choice(4)];
            bytes.splice(at..at, piece.repeat(times));
        }
        5 => {
            let word = WORDS[draw.choice(WORDS.len())];
            bytes.splice(at..at, word.iter().copied());
        }
        6 => {
            let word = WORDS[draw.choice(WORDS.len())];
            let end = (at + word.len()).min(bytes.len());
            bytes.splice(at..end, word.iter().copied());
        }
        7 => {
            // A number of a text becomes another one.
            let is_digit = |byte: &u8| byte.is_ascii_digit();
            if let Some(start) = bytes[at..].iter().position(is_digit).map(|k| at + k) {
                let end = bytes[start..].iter().position(|byte| !is_digit(byte)).map_or(bytes.len(), |k| start + k);
                bytes.splice(start..end, WORDS[draw.choice(8)].iter().copied());
            }
        }
        _ => {
            let other = &seeds[draw.choice(seeds.len())];
            let from = draw.choice(other.len() + 1);
            bytes.truncate(at);
            bytes.extend_from_slice(&other[from..]);
        }
    }
}
