//! Recordings made up for the tests.
#![allow(dead_code, reason = "every test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "only tests call this")]

extern crate alloc;

use self::alloc::collections::BTreeMap;

use std::path::{Path, PathBuf};

use pkm_ident::{EffortKind, KnownLoad, Meta, Recording};
use pkm_record::{Attachment, Attachments, ReadOptions};

/// Numbers without a pattern, the same in every run.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() % n as u64).unwrap()
    }

    /// Any finite f64, or now and then a missing sample.
    pub(crate) fn sample(&mut self) -> f64 {
        let value = f64::from_bits(self.next());
        if !value.is_finite() || self.next().is_multiple_of(17) { f64::NAN } else { value }
    }
}

/// A recording with a column of every kind.
pub(crate) fn recording(samples: u32, start: f64) -> Recording {
    let columns = [
        "q.a",
        "q.leg 2",
        "dq.a",
        "tau.a",
        "tau.leg 2",
        "q_ref.a",
        "dq_ref.a",
        "ddq_ref.a",
        "q_link.a",
        "temp.a",
        "wrench.hand.fx",
        "wrench.hand.mz",
        "pose.marker.x",
        "pose.marker.qw",
        "current.a",
        "battery, left",
        "tau_cmd.a",
    ];
    let mut noise = Noise(0x9E37_79B9_7F4A_7C15);
    let signals: BTreeMap<String, Vec<f64>> =
        columns.iter().map(|c| (c.to_string(), (0..samples).map(|_| noise.sample()).collect())).collect();
    let mut meta = Meta {
        tau: Some(EffortKind::Measured),
        load: Some(KnownLoad { link: "platform".into(), mass: 2.0, xyz: [0.0, 0.0, 0.1] }),
        gravity: Some([0.1, 0.0, -9.8]),
        session: Some("2021-03-03".into()),
        controller: Some("controller.toml".into()),
        other: BTreeMap::new(),
    };
    meta.other.insert("operator".into(), "Jane \"J\" Doe".into());
    let time = (0..samples).map(|k| start + f64::from(k) / 1000.0).collect();
    Recording { name: String::new(), time, signals, meta }
}

pub(crate) fn attachments() -> Attachments {
    let file = Attachment { name: "robot.toml".into(), media_type: "application/toml".into(), bytes: b"name = \"x\"".to_vec() };
    Attachments { files: vec![file], keys: BTreeMap::from([("config_hash".to_string(), "abc".to_string())]), ..Attachments::default() }
}

/// Signals compared by their bits: NaN equals NaN, 0 does not equal -0.
pub(crate) fn bits(recording: &Recording) -> BTreeMap<&str, Vec<u64>> {
    recording.signals.iter().map(|(name, values)| (name.as_str(), values.iter().map(|v| v.to_bits()).collect())).collect()
}

pub(crate) fn read(path: &Path) -> Result<Recording, pkm_record::ReadError> {
    pkm_record::read(path, &ReadOptions::default())
}

pub(crate) fn recover() -> ReadOptions {
    ReadOptions { topic: None, recover: true }
}

/// A file with that content in a directory that goes with the returned guard.
pub(crate) fn file(name: &str, content: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, content).unwrap();
    (directory, path)
}
