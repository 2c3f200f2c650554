//! `cargo xtask latency`: how late a loop wakes, what it computes, how long it takes to a robot in another process and back, and what the disk
//! takes, idle and beside work on every core, in one run; the table in benches/README.md written anew.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::peers::{head, publish};
use crate::shell::{cargo, root, run, target};
use crate::viewers::Viewers;

/// Seconds of each measurement.
const SECONDS: &str = "20";

/// Viewers of a live view, every second of whom reads nothing.
const VIEWERS: usize = 20;

/// Measures for as long as the first argument says `[s]`, 20 by itself.
pub(crate) fn latency(rest: &[&str]) -> Result<(), String> {
    let seconds = rest.first().copied().unwrap_or(SECONDS);
    let length: u64 = seconds.parse().map_err(|_| format!("{seconds:?}: not a whole number of seconds"))?;
    run(&mut cargo("build --release --locked -p pkm"))?;
    let pkm = target().join("release/pkm");
    let mut text = head("a daemon at 1 kHz on the 3-PRS, its simulated driver in another process", "as each row says");
    for (name, is_loaded) in [("otherwise idle", false), ("beside one busy loop per core", true)] {
        println!("   {name}: {} s", 7 * length + 34);
        let load = is_loaded.then(Load::start);
        let doctor = output(Command::new(&pkm).args(["doctor", "--seconds", seconds]))?;
        let table = doctor.find("Wake-ups every").map_or(doctor.as_str(), |at| &doctor[at..]);
        let [alone, watched] = [pair(&pkm, length, 0)?, pair(&pkm, length, VIEWERS)?];
        drop(load);
        text += &format!("\n\nThe machine {name}:\n\n```text\n{}\n\n{alone}\n\n{watched}\n```", table.trim_end());
    }
    publish("latency", &text)
}

/// One busy loop per core, with ordinary rights, for as long as it lives.
struct Load {
    is_over: Arc<AtomicBool>,
}

impl Load {
    fn start() -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            let told = Arc::clone(&is_over);
            std::thread::spawn(move || {
                while !told.load(Ordering::Relaxed) {
                    core::hint::spin_loop();
                }
            });
        }
        Self { is_over }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

/// What a command prints, whatever its exit status: a doctor who finds something says 1.
fn output(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|e| format!("{}: {e}", command.get_program().display()))?;
    if output.stdout.is_empty() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_string());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The shipped example with its driver in another process, at 1 kHz, patient where this machine is late.
fn configuration(folder: &Path) -> Result<PathBuf, String> {
    let examples = root().join("docs/examples");
    let text = fs::read_to_string(examples.join("daemon.toml")).map_err(|e| format!("{}: {e}", examples.display()))?;
    let example = |name: &str| format!("\"{}\"", examples.join(name).display());
    let mut text = text
        .replace("\"controllers/computed_torque_200hz.toml\"", &example("controllers/computed_torque.toml"))
        .replace("\"daemon_motion.csv\"", &example("daemon_motion.csv"))
        .replace("\"simulated\"", "\"iceoryx2\"")
        .replace("[loop]\n", "[loop]\nconsecutive_overruns = 1000\noverrun_share = 1.0\n")
        .replace("stall_s      = 0.05", "stall_s      = 5.0")
        // A driver that gets no time for fifty periods lets the robot drift: what is measured here is time.
        .replace("[limits]\n", "[limits]\nfollowing = 0.1\n");
    for key in ["valid_for_s = 0.05", "stale_s     = 0.05"] {
        let name = key.split_whitespace().next().unwrap_or_default();
        text = text.replace(key, &format!("{name} = 1.0"));
    }
    let path = folder.join("daemon.toml");
    let text = format!("directory = \"{}\"\n{text}", folder.join("meet").display());
    fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(path)
}

/// A process that does not outlive this one's interest in it.
struct Side(Child);

impl Drop for Side {
    fn drop(&mut self) {
        // It has ended by itself where all went well.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What is there as soon as it is, for ten seconds at most.
fn patiently<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    (0..500).find_map(|_| {
        std::thread::sleep(Duration::from_millis(20));
        look()
    })
}

/// The port that a daemon's log says its live view has, as soon as it says so.
fn live_port(log: &Path) -> Result<u16, String> {
    let port = patiently(|| {
        let told = fs::read_to_string(log).unwrap_or_default();
        told.lines().find_map(|line| line.strip_prefix("live view at ws://127.0.0.1:")?.trim().parse().ok())
    });
    port.ok_or_else(|| format!("no live view within 10 s; see {}", log.display()))
}

/// A daemon and its driver for `length` `[s]` of motion, looked at by so many: what both measured.
fn pair(pkm: &Path, length: u64, viewers: usize) -> Result<String, String> {
    let folder = target().join("latency");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let config = configuration(&folder)?;
    let start = |verb: &str, more: &[&str]| -> Result<Side, String> {
        let log = File::create(folder.join(format!("{verb}.log"))).map_err(|e| e.to_string())?;
        let errors = log.try_clone().map_err(|e| e.to_string())?;
        let mut command = Command::new(pkm);
        command.arg(verb).arg(&config).args(more).stdin(Stdio::null()).stdout(log).stderr(errors);
        command.spawn().map(Side).map_err(|e| format!("{verb}: {e}"))
    };
    let ask = |arguments: &[&str]| output(Command::new(pkm).args(arguments).arg("--config").arg(&config));
    let runs = folder.join("runs").display().to_string();
    let mut driver = start("driver-sim", &["--seconds", &(length + 25).to_string()])?;
    let mut daemon = start("daemon", &["--record", &runs, "--live", "0", "--seconds", &(length + 20).to_string()])?;
    let crowd = Viewers::connect(live_port(&folder.join("daemon.log"))?, viewers)?;
    for (phase, order) in [("ready", "arm"), ("holding", "start")] {
        let is_there = |status: String| status.lines().next()?.contains(&format!(": {phase} ")).then_some(());
        patiently(|| ask(&["status"]).ok().and_then(is_there))
            .ok_or_else(|| format!("the daemon is not {phase} within 10 s; see {}", folder.display()))?;
        ask(&["order", order])?;
    }
    std::thread::sleep(Duration::from_secs(length));
    let status = ask(&["status"])?;
    let seen = format!("{viewers} viewers, {} of whom read nothing, the others {:.1} MB", viewers / 2, crowd.read() as f64 * 1e-6);
    drop(crowd);
    for side in [&mut daemon, &mut driver] {
        side.0.wait().map_err(|e| e.to_string())?;
    }
    let of = |verb: &str, mark: &str| {
        let log = fs::read_to_string(folder.join(format!("{verb}.log"))).unwrap_or_default();
        log.lines().find(|line| line.contains(mark)).unwrap_or("not told").to_string()
    };
    let is_wanted = |line: &&str| ["Hz,", "µs", "wake-up", "compute", "end to end"].iter().any(|word| line.contains(word));
    let rows: Vec<&str> = status.lines().filter(is_wanted).collect();
    Ok(format!(
        "The daemon, {seen}, µs (end to end: age of a state when its answer is handed over):\n{}\nThe driver: {}\nThe recording: {}",
        rows.join("\n"),
        of("driver-sim", "from a state to its answer"),
        of("daemon", "recorded")
    )
    .trim_end()
    .to_string())
}
