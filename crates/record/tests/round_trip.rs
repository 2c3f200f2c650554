//! What goes out comes back.
mod made_up;

use made_up::{attachments, bits, read, recording};
use pkm_record::{Attachments, ReadOptions, WriteError, read_attachments, write};

#[test]
fn csv_to_mcap_to_recording_keeps_every_bit() {
    let directory = tempfile::tempdir().unwrap();
    for start in [0.0, -3.25, 12.34, 1_614_759_000.0] {
        let original = recording(300, start);
        let (csv, mcap) = (directory.path().join("A.csv"), directory.path().join("A.mcap"));
        write(&csv, &original, &Attachments::default()).unwrap();
        let from_csv = read(&csv).unwrap();
        write(&mcap, &from_csv, &Attachments::default()).unwrap();
        let from_mcap = read(&mcap).unwrap();
        for back in [&from_csv, &from_mcap] {
            assert_eq!(bits(back), bits(&original), "from {start} s");
            assert_eq!(back.meta, original.meta);
        }
        assert_eq!(from_csv.time, original.time);
        assert_eq!(from_mcap.time.len(), original.time.len());
        // Whole nanoseconds in the file, and an f64 from 1970 on has no more than a quarter microsecond.
        let resolution = if start > 1e9 { 0.0 } else { 1e-9 };
        for (a, b) in from_mcap.time.iter().zip(&original.time) {
            assert!((a - b).abs() <= resolution, "{a} {b}");
        }
        assert_eq!(from_mcap.name, mcap.display().to_string());
    }
}

#[test]
fn attachments_and_keys_travel_with_mcap() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.MCAP");
    write(&path, &recording(5, 0.0), &attachments()).unwrap();
    assert_eq!(read_attachments(&path, &ReadOptions::default()).unwrap().files, attachments().files);
    let meta = read(&path).unwrap().meta;
    assert_eq!(meta.other.get("config_hash").map(String::as_str), Some("abc"));
}

#[test]
fn the_same_recording_gives_the_same_bytes() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["A.mcap", "A.csv"] {
        let path = directory.path().join(name);
        let content = [(); 2].map(|()| {
            write(&path, &recording(50, 0.0), &attachments()).unwrap();
            std::fs::read(&path).unwrap()
        });
        assert_eq!(content[0], content[1]);
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2, "temporary files are left");
}

#[test]
fn a_refused_recording_leaves_the_old_file() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["A.mcap", "A.csv"] {
        let path = directory.path().join(name);
        write(&path, &recording(5, 0.0), &Attachments::default()).unwrap();
        let before = std::fs::read(&path).unwrap();
        let mut refused = recording(5, 0.0);
        refused.signals.insert("x".into(), vec![0.0; 4]);
        let error = write(&path, &refused, &Attachments::default()).unwrap_err();
        assert!(error.to_string().ends_with(": column x has 4 samples, the time axis 5"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2, "temporary files are left");
}

#[test]
fn what_no_file_can_hold_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let refuse = |change: &dyn Fn(&mut pkm_ident::Recording)| {
        let mut changed = recording(5, 0.0);
        change(&mut changed);
        write(&path, &changed, &Attachments::default()).unwrap_err()
    };
    assert!(matches!(refuse(&|r| r.time[3] = r.time[2]), WriteError::Time { sample: 3, .. }));
    assert!(matches!(refuse(&|r| r.time[4] = f64::NAN), WriteError::Time { sample: 4, .. }));
    assert!(matches!(refuse(&|r| r.time[4] = 3e9), WriteError::Stamp { sample: 4, .. }));
    assert!(matches!(refuse(&|r| r.time[1] = 1e-10), WriteError::Stamp { sample: 1, .. }));
    assert!(matches!(refuse(&|r| r.signals.get_mut("q.a").unwrap()[1] = f64::INFINITY), WriteError::NotFinite { sample: 1, .. }));
    assert!(matches!(refuse(&|r| drop(r.signals.insert("t".into(), vec![0.0; 5]))), WriteError::ColumnName { .. }));
    assert!(matches!(refuse(&|r| drop(r.meta.other.insert("two words".into(), String::new()))), WriteError::Key { .. }));
    assert!(matches!(refuse(&|r| *r = pkm_ident::Recording::default()), WriteError::NoSamples { .. }));
    let odd = write(&directory.path().join("A.txt"), &recording(5, 0.0), &Attachments::default());
    assert!(matches!(odd, Err(WriteError::UnknownFormat { .. })));
    let nowhere = write(&directory.path().join("none/A.csv"), &recording(5, 0.0), &Attachments::default());
    assert!(matches!(nowhere, Err(WriteError::Io { .. })));
    assert!(!path.exists());
}

#[test]
fn a_recording_without_joints_keeps_its_time() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let mut bare = recording(4, 0.5);
    bare.signals.retain(|name, _| name.starts_with("wrench"));
    write(&path, &bare, &Attachments::default()).unwrap();
    let back = read(&path).unwrap();
    assert_eq!((back.len(), bits(&back)), (4, bits(&bare)));
}

#[test]
fn commanded_efforts_stand_in_for_measured_ones() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    let mut commanded = recording(40, 0.0);
    commanded.meta.tau = None;
    commanded.signals.retain(|name, _| !name.starts_with("tau."));
    write(&path, &commanded, &Attachments::default()).unwrap();
    let back = read(&path).unwrap();
    assert_eq!(back.meta.tau, Some(pkm_ident::EffortKind::Commanded));
    assert!(back.signal("tau.a").is_some() && back.signal("tau_cmd.a").is_none());
}

/// 25 000 samples of 6 columns are to take less than 30 ms in a release build; here the limit only catches a blunder.
#[test]
fn a_long_csv_file_is_read_at_once() {
    let mut text = String::from("t,q.a,q.b,q.c,tau.a,tau.b,tau.c\n");
    let mut noise = made_up::Noise(7);
    for k in 0..25_000 {
        text.push_str(&format!("{}", f64::from(k) / 1000.0));
        for _ in 0..6 {
            text.push_str(&format!(",{}", noise.below(1_000_000_000) as f64 / 1e9 - 0.5));
        }
        text.push('\n');
    }
    let (_guard, path) = made_up::file("A.csv", text.as_bytes());
    #[expect(clippy::disallowed_methods, reason = "the test measures real time")]
    let start = std::time::Instant::now();
    assert_eq!(read(&path).unwrap().len(), 25_000);
    println!("25 000 x 6 CSV samples: {:.1} ms", start.elapsed().as_secs_f64() * 1e3);
    assert!(start.elapsed().as_secs_f64() < 1.0);
}
