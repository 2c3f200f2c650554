//! How long a diagnosis takes and how much memory, over the length of the recording, and how soon it says where to look.

use core::time::Duration;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::peers::{head, publish};
use crate::shell::{cargo, run, stopwatch, target};

/// Lengths that are measured when none is named `[s]`.
const LENGTHS: [&str; 3] = ["60", "240", "960"];

/// What `pkm diagnose -v` says on standard error as soon as it knows where the model is furthest from the recording.
const LOCATED: &str = "largest mismatch";

/// What `pkm diagnose -vv` says of its temporary file.
const ON_FILE: &str = "megabytes=";

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
    located_s: Option<f64>,
    on_file_mb: f64,
}

/// Diagnoses a six-axis arm, recorded at 1 kHz for as many seconds as named, and writes wall time, processor time, peak memory and the time to
/// the first located mismatch of each into benches/README.md.
pub(crate) fn diagnosis(lengths: &[&str]) -> Result<(), String> {
    let lengths = if lengths.is_empty() { &LENGTHS[..] } else { lengths };
    if let Some(bad) = lengths.iter().find(|l| !l.parse::<f64>().is_ok_and(|s| (1.0..=3600.0).contains(&s))) {
        return Err(format!("{bad:?} is no length (must be 1 to 3600 s)"));
    }
    run(&mut cargo("build --release --locked -p pkm --bin pkm"))?;
    let program = target().join("release/pkm");
    let folder = target().join("tmp/diagnosis");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let load = fs::read_to_string("/proc/loadavg").ok().and_then(|t| t.split(' ').next().map(str::to_string));
    let cores = std::thread::available_parallelism().map_or(0, core::num::NonZero::get);
    let how = format!("{cores} cores, not pinned, load {} when it began", load.as_deref().unwrap_or("unknown"));
    let mut table = format!(
        "{}\n\n| recording | wall | processor | processor per second recorded | first located mismatch after | peak memory | temporary file |\n\
         |---|---|---|---|---|---|---|\n",
        head("serial_arm, six axes at 1 kHz, dry friction of j2 concealed", &how)
    );
    for length in lengths {
        let recording = folder.join(format!("{length}.csv"));
        let mut simulate = Command::new(&program);
        simulate.args(["simulate", "serial_arm", "--hide", "friction_coulomb@j2:coulomb=8", "--rate", "1000", "--duration", length]);
        let made = simulate.args(["--force", "--quiet", "--out"]).arg(&recording).status();
        if !made.as_ref().is_ok_and(|s| s.success()) {
            return Err(format!("pkm simulate did not make {}: {made:?}", recording.display()));
        }
        let t = watched(Command::new(&program).args(["diagnose", "serial_arm", "--no-replay", "-vv", "--recording"]).arg(&recording))?;
        let recorded = length.parse::<f64>().unwrap_or(f64::NAN);
        let located = t.located_s.map_or("not told".to_string(), |s| format!("{s:.1} s"));
        let row = format!(
            "| {length} s | {:.1} s | {:.1} s | {:.0} ms | {located} | {:.0} MB | {:.0} MB |\n",
            t.wall_s,
            t.processor_s,
            1e3 * t.processor_s / recorded,
            t.peak_mb,
            t.on_file_mb
        );
        print!("{row}");
        table += &row;
    }
    publish("diagnose-times", &table)
}

/// Runs a command and watches it: on systems without /proc only the times are known.
fn watched(command: &mut Command) -> Result<Taken, String> {
    let elapsed = stopwatch();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().map_err(|e| format!("pkm could not be started: {e}"))?;
    let of = Path::new("/proc").join(child.id().to_string());
    let said = child.stderr.take().map(|pipe| std::thread::spawn(move || listened(pipe, elapsed)));
    let mut out = Taken::default();
    let ended = loop {
        out.peak_mb = out.peak_mb.max(peak_mb(&of).unwrap_or(0.0));
        out.processor_s = out.processor_s.max(processor_s(&of).unwrap_or(0.0));
        match child.try_wait() {
            Ok(None) => std::thread::sleep(LOOK),
            ended => break ended,
        }
    };
    out.wall_s = elapsed().as_secs_f64();
    (out.located_s, out.on_file_mb) = said.and_then(|s| s.join().ok()).unwrap_or_default();
    match ended {
        Ok(Some(status)) if status.success() => Ok(out),
        other => Err(format!("pkm diagnose ended with {other:?}")),
    }
}

/// When the mismatch was located, and the size of the temporary file, from what a diagnosis says while it runs.
fn listened(pipe: impl Read, elapsed: impl Fn() -> Duration) -> (Option<f64>, f64) {
    let (mut located, mut on_file) = (None, 0.0);
    for line in BufReader::new(pipe).lines().map_while(Result::ok) {
        if line.contains(LOCATED) {
            located.get_or_insert_with(|| elapsed().as_secs_f64());
        }
        let size = line.split_once(ON_FILE).and_then(|(_, rest)| rest.split_whitespace().next()?.parse().ok());
        on_file = size.unwrap_or(on_file);
    }
    (located, on_file)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_diagnosis_says_is_heard() {
        let said = "INFO recording x\nINFO largest mismatch at j2: 7.9\nINFO largest mismatch again\nDEBUG series in a file megabytes=41\n";
        let count = core::cell::Cell::new(0);
        let elapsed = || {
            count.set(count.get() + 3);
            Duration::from_secs(count.get())
        };
        assert_eq!(listened(said.as_bytes(), elapsed), (Some(3.0), 41.0));
        assert_eq!(listened("nothing\n".as_bytes(), || Duration::ZERO), (None, 0.0));
    }
}
