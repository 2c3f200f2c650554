//! Recordings of many minutes: taken at the rate that their band needs they read as they do when taken whole; and where the largest mismatch is
//! is told before its cause is sought, as the verdict has it in the end.

use core::f64::consts::TAU;

use pkm_diagnose::{Diagnosis, Located, Settings, Watch, diagnose, diagnose_watched};
use pkm_dyn::math;
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::Recording;
use pkm_tests::Draw;

const STEP_S: f64 = 1e-3;
/// Of the robot's file `[N]`, `[N·s/m]`, `[kg]`.
const DRY: f64 = 8.0;
const DAMPING: f64 = 5.0;
const MASS: f64 = 10.0;
/// What each recording has more than the file says `[N]`.
const MORE: f64 = 3.0;

/// Two carriages side by side.
fn slides() -> Description {
    let toml = ["x", "y"].map(|name| format!("\n[[actuator]]\njoint = \"{name}\"\nrotor_inertia = 0.0\n")).concat();
    let part = |name: &str| {
        format!(
            r#"<link name="c{name}"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="{MASS}"/><inertia ixx="0.1" ixy="0" ixz="0"
            iyy="0.1" iyz="0" izz="0.1"/></inertial></link><joint name="{name}" type="prismatic"><parent link="base"/><child link="c{name}"/>
            <origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/><limit lower="-5" upper="5" effort="1000" velocity="10"/>
            <dynamics damping="{DAMPING}" friction="{DRY}"/></joint>"#
        )
    };
    let urdf = format!(r#"<robot name="slides"><link name="base"/>{}{}</robot>"#, part("x"), part("y"));
    let toml = format!("name = \"slides\"\nurdf = \"slides.urdf\"\n{toml}");
    parse(&toml, &urdf, ["slides.toml", "slides.urdf"]).expect("a readable robot")
}

/// A recording of `n` samples at 1 kHz; `y` has dry friction beyond its file's.
fn recording(n: usize, noise: f64) -> Recording {
    let mut draw = Draw::new(7);
    let mut out = Recording { name: "long".to_string(), time: (0..n).map(|i| STEP_S * i as f64).collect(), ..Recording::default() };
    for (joint, more, sines) in [("x", 0.0, [(0.15, 0.31), (0.05, 0.83)]), ("y", MORE, [(0.2, 0.23), (0.06, 0.71)])] {
        let (mut q, mut tau) = (Vec::new(), Vec::new());
        for i in 0..n {
            let (mut at, mut v, mut a) = (0.0, 0.0, 0.0);
            for (size, f) in sines {
                let (w, u) = (TAU * f, TAU * f * STEP_S * i as f64);
                (at, v, a) = (at + size * math::sin(u), v + size * w * math::cos(u), a - size * w * w * math::sin(u));
            }
            let drawn = (0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0;
            q.push(at);
            tau.push(MASS * a + DAMPING * v + (DRY + more) * math::sign(v) + noise * drawn);
        }
        out.signals.insert(format!("q.{joint}"), q);
        out.signals.insert(format!("tau.{joint}"), tau);
    }
    out
}

/// The one finding's dry friction and its interval.
fn found(d: &Diagnosis) -> (f64, [f64; 2]) {
    let [f] = &d.verdict.findings[..] else { panic!("{}", d.verdict.says) };
    assert_eq!((f.effect.as_str(), &f.place[..]), ("friction_coulomb", &["y".to_string()][..]), "{}", d.verdict.says);
    (f.parameters["coulomb"].value, f.parameters["coulomb"].ci95)
}

#[test]
fn a_recording_of_many_minutes_reads_as_a_shorter_one_taken_whole() {
    let robot = slides();
    let run = |r: &Recording| diagnose(&robot, core::slice::from_ref(r), &[], &Settings::default(), &mut |_| {}).expect("can be read");
    let long = recording(620_000, 2.0);
    let mut short = long.clone();
    let keep = 300_000;
    short.time.truncate(keep);
    short.signals.values_mut().for_each(|x| x.truncate(keep));
    let (long, short) = (run(&long), run(&short));
    let is_thinned = |d: &Diagnosis| d.verdict.notes.iter().any(|n| n.contains("620000 samples are many for a band"));
    assert!(is_thinned(&long) && !is_thinned(&short), "{:?}", long.verdict.notes);
    let ((a, ci), (b, _)) = (found(&long), found(&short));
    assert!((a - DRY - MORE).abs() < 0.02 && (a - b).abs() < 1e-2, "{a} N thinned, {b} N whole, {} N in truth", DRY + MORE);
    assert!(ci[0] < DRY + MORE && DRY + MORE < ci[1], "{ci:?}");
    let [x, y] = [&long, &short].map(|d| &d.verdict.heldout);
    assert!((x.rms_nominal / y.rms_nominal - 1.0).abs() < 0.02, "{} thinned, {} whole", x.rms_nominal, y.rms_nominal);
    // A direction that changes up to half a sample early or late is a pulse of 2·F·δ in the effort, δ even over one sample of 1/(50·band): behind
    // the filter, whose impulse response has a square of 1.8·band, it adds n·(2·F)²/(12·(50·band)²)·1.8·band at n reversals a second,
    // no more than two per period of the fastest sine.
    let (reversals, dry) = (2.0 * 0.83, DRY + MORE);
    let added = 4.0 * dry * dry * reversals * 1.8 / (12.0 * 50.0 * 50.0 * x.band_hz);
    let effort = x.joints.iter().map(|j| j.rms_tau).fold(f64::INFINITY, f64::min);
    for (thinned, whole) in [(x.rms_final, y.rms_final), (x.noise_floor, y.noise_floor)] {
        let excess = thinned * thinned - whole * whole;
        assert!(excess.abs() < added / (effort * effort), "{thinned} thinned, {whole} whole, {added} N² expected at most");
    }
}

/// What was told, in order.
#[derive(Default)]
struct Told {
    shares: Vec<f64>,
    located: Option<(Located, usize)>,
}

impl Watch for Told {
    fn progress(&mut self, share: f64) {
        self.shares.push(share);
    }

    fn located(&mut self, first: Option<&Located>) {
        assert!(self.located.is_none(), "told twice");
        self.located = first.map(|f| (f.clone(), self.shares.len()));
    }
}

#[test]
fn the_largest_mismatch_is_told_before_any_cause_and_as_the_verdict_has_it() {
    let (robot, r) = (slides(), recording(30_000, 1.0));
    let mut told = Told::default();
    let d = diagnose_watched(&robot, (core::slice::from_ref(&r), &[]), &Settings::default(), None, &mut told).expect("can be read");
    let (first, when) = told.located.expect("something is told");
    assert!(told.shares[..when].iter().all(|s| *s < 0.3) && told.shares[when..].iter().any(|s| *s < 0.5), "{:?}", told.shares);
    assert_eq!(first.joint, "y", "{first}");
    let joint = d.verdict.heldout.joints.iter().find(|j| j.joint == "y").expect("a drive");
    assert!((first.rms / joint.rms_nominal - 1.0).abs() < 0.02, "{} told, {} in the verdict", first.rms, joint.rms_nominal);
    assert!((first.share_of_effort / (joint.rms_nominal / joint.rms_tau) - 1.0).abs() < 0.02);
    // The missing force is the same at every speed, so its rms is what was concealed and more nowhere than where it changes sign.
    assert!((first.rms - MORE).abs() < 0.2 * MORE, "{first}");
    let cells: Vec<_> = d.evidence.regimes.iter().filter(|c| c.joint == "y" && c.share >= 0.05).collect();
    let there = cells.iter().find(|c| c.regime == first.regime).expect("a regime of the verdict's map");
    assert!((first.share_in_regime / there.before - 1.0).abs() < 0.02, "{first}: {} in the map", there.before);
    assert!(cells.iter().all(|c| c.before <= 1.02 * there.before), "{first}: {cells:?}");
    assert!(first.share_of_error > 0.9 && first.share_of_error <= 1.0);
}

/// Nameless files of a folder that this process has open, where the system tells.
fn open_in(folder: &std::path::Path) -> usize {
    let Ok(all) = std::fs::read_dir("/proc/self/fd") else { return 0 };
    let targets = all.flatten().filter_map(|fd| std::fs::read_link(fd.path()).ok());
    targets.filter(|target| target.starts_with(folder) && target.to_string_lossy().contains("(deleted)")).count()
}

#[test]
fn what_waits_in_a_file_is_diagnosed_as_what_stays_in_memory() {
    let (robot, r) = (slides(), recording(30_000, 1.0));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut most = 0;
    let filed = Settings { scratch: Some(folder.path().to_path_buf()), room: 0, ..Settings::default() };
    let filed = diagnose(&robot, core::slice::from_ref(&r), &[], &filed, &mut |_| most = most.max(open_in(folder.path())));
    let filed = filed.expect("can be read");
    let kept = diagnose(&robot, core::slice::from_ref(&r), &[], &Settings::default(), &mut |_| {}).expect("can be read");
    assert_eq!((&filed.verdict, &filed.evidence), (&kept.verdict, &kept.evidence));
    assert_eq!(most, usize::from(cfg!(target_os = "linux")), "files open in the folder at a time");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0, "and none is left behind");
}
