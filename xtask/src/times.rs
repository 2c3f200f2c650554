//! How long a diagnosis takes and how much memory, over the length of the recording.

use core::time::Duration;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::shell::{cargo, run, target, timed};

/// Lengths that are measured when none is named `[s]`.
const LENGTHS: [&str; 3] = ["60", "120", "240"];

/// Memory and processor time are looked at so often.
const LOOK: Duration = Duration::from_millis(10);

/// Ticks of the processor time in /proc per second: the same on every Linux that runs this.
const TICKS: f64 = 100.0;

/// What a run took.
#[derive(Debug, Clone, Copy, Default)]
struct Taken {
    wall_s: f64,
    processor_s: f64,
    peak_mb: f64,
}

/// Diagnoses a six-axis arm, recorded at 1 kHz for as many seconds as named, and prints wall time, processor time and peak memory of each.
pub(crate) fn diagnosis(lengths: &[&str]) -> Result<(), String> {
    let lengths = if lengths.is_empty() { &LENGTHS[..] } else { lengths };
    if let Some(bad) = lengths.iter().find(|l| !l.parse::<f64>().is_ok_and(|s| (1.0..=3600.0).contains(&s))) {
        return Err(format!("{bad:?} is no length (must be 1 to 3600 s)"));
    }
    run(&mut cargo("build --release --locked -p pkm --bin pkm"))?;
    let program = target().join("release/pkm");
    let folder = target().join("tmp/diagnosis");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    println!("| recording, serial_arm at 1 kHz | wall | processor | peak memory |\n|---|---|---|---|");
    for length in lengths {
        let recording = folder.join(format!("{length}.csv"));
        let mut simulate = Command::new(&program);
        simulate.args(["simulate", "serial_arm", "--hide", "friction_coulomb@j2:coulomb=8", "--rate", "1000", "--duration", length]);
        let made = simulate.args(["--force", "--quiet", "--out"]).arg(&recording).status();
        if !made.as_ref().is_ok_and(|s| s.success()) {
            return Err(format!("pkm simulate did not make {}: {made:?}", recording.display()));
        }
        let t = watched(Command::new(&program).args(["diagnose", "serial_arm", "--no-replay", "--quiet", "--recording"]).arg(&recording))?;
        println!("| {length} s | {:.1} s | {:.1} s | {:.0} MB |", t.wall_s, t.processor_s, t.peak_mb);
    }
    Ok(())
}

/// Runs a command and watches it: on systems without /proc only the wall time is known.
fn watched(command: &mut Command) -> Result<Taken, String> {
    let mut child = command.stdout(Stdio::null()).spawn().map_err(|e| format!("pkm could not be started: {e}"))?;
    let of = Path::new("/proc").join(child.id().to_string());
    let mut out = Taken::default();
    let (ended, wall) = timed(|| {
        loop {
            out.peak_mb = out.peak_mb.max(peak_mb(&of).unwrap_or(0.0));
            out.processor_s = out.processor_s.max(processor_s(&of).unwrap_or(0.0));
            match child.try_wait() {
                Ok(None) => std::thread::sleep(LOOK),
                ended => return ended,
            }
        }
    });
    out.wall_s = wall.as_secs_f64();
    match ended {
        Ok(Some(status)) if status.success() => Ok(out),
        other => Err(format!("pkm diagnose ended with {other:?}")),
    }
}

fn peak_mb(process: &Path) -> Option<f64> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1024.0)
}

/// User and system time: the fourteenth and fifteenth entry, counted behind the name in brackets, which may hold blanks.
fn processor_s(process: &Path) -> Option<f64> {
    let stat = fs::read_to_string(process.join("stat")).ok()?;
    let entries: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| entries.get(i).and_then(|x| x.parse::<f64>().ok());
    Some((ticks(11)? + ticks(12)?) / TICKS)
}
