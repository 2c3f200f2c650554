//! A folder with everything a daemon needs, the processes that run there, and what they say.

use core::time::Duration;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use pkm_hal::{Clock, SystemClock};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// One rig at a time: four of them on two cores are late by each other.
static RIG: Mutex<()> = Mutex::new(());

/// Longest wait for anything that must come `[s]`: these tests share their machine, and a wait ends when it comes.
pub(crate) const PATIENCE_S: u64 = 60;

/// Slow and patient: what is late here is judged elsewhere.
pub(crate) const CONFIG: &str = r#"
robot = "prs3"
controller = "controller.toml"
directory = "meet"
realtime = "off"
black_box_s = 2.0
[hal]
kind = "iceoryx2"
valid_for_s = 1.0
stale_s = 0.8
[loop]
stall_s = 10.0
supervisor_s = 10.0
consecutive_overruns = 1000
overrun_share = 1.0
soft_start_s = 0.2
stop_s = 0.2
[limits]
following = 0.1
[safe]
kind = "hold"
stiffness = 20000.0
damping = 2000.0
effort = 1400.0
[home]
q = 0.15
[run]
motion = "motion.csv"
"#;

pub(crate) const CONTROLLER: &str = "\
law = \"computed_torque\"
rate_hz = 100.0
bandwidth = 10.0
[observer]
kind = \"commanded_acceleration\"
bandwidth = 30.0
[limits]
dt_limit = inf
";

/// A folder with everything a daemon needs.
pub(crate) struct Site {
    pub(crate) dir: tempfile::TempDir,
    _alone: MutexGuard<'static, ()>,
}

impl Site {
    pub(crate) fn new() -> Self {
        // Another test's failure is not this one's.
        let alone = RIG.lock().unwrap_or_else(PoisonError::into_inner);
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("daemon.toml"), CONFIG).unwrap();
        fs::write(dir.path().join("controller.toml"), CONTROLLER).unwrap();
        let mut motion = "t,q_ref.q1,q_ref.q6,q_ref.q8\n".to_string();
        for i in 0..=3000 {
            // It outlasts every test, and while a state grows stale it moves by less than a drive may be off.
            let t = 0.1 * f64::from(i);
            let q = 0.15 + 0.02 * (1.0 - pkm_dyn::math::cos(0.25 * t));
            motion += &format!("{t},{q},{q},{q}\n");
        }
        fs::write(dir.path().join("motion.csv"), motion).unwrap();
        Self { dir, _alone: alone }
    }

    pub(crate) fn config(&self) -> PathBuf {
        self.dir.path().join("daemon.toml")
    }

    pub(crate) fn start(&self, verb: &str) -> Side {
        self.start_with(verb, &[], &[])
    }

    /// A process with further arguments, and with these in its environment.
    pub(crate) fn start_with(&self, verb: &str, more: &[&str], environment: &[(&str, &str)]) -> Side {
        let log = self.dir.path().join(format!("{verb}-{}.log", SystemClock.now_ns()));
        let out = fs::File::create(&log).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
        command.arg(verb).arg(self.config()).args(more).current_dir(self.dir.path()).envs(environment.iter().copied()).stdin(Stdio::null());
        command.stdout(out.try_clone().unwrap()).stderr(out);
        Side { child: command.spawn().unwrap(), log }
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> (i32, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
        let out = command.args(arguments).arg("--config").arg(self.config()).output().unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
        (out.status.code().unwrap_or(-1), text)
    }

    pub(crate) fn status(&self) -> Option<Value> {
        let (code, text) = self.run(&["status", "--json"]);
        (code == 0).then(|| serde_json::from_str(&text).expect("status is JSON"))
    }

    pub(crate) fn phase(&self) -> String {
        self.status().map_or_else(String::new, |status| status["phase"].as_str().unwrap_or_default().to_string())
    }

    /// Waits until the phase is one of these.
    pub(crate) fn until(&self, phases: &[&str]) -> Value {
        within(PATIENCE_S, || self.status().filter(|status| phases.contains(&status["phase"].as_str().unwrap_or_default())))
            .unwrap_or_else(|| panic!("none of {phases:?}: {:?}\n{}", self.status(), self.logs()))
    }

    /// What every process of this site has said.
    pub(crate) fn logs(&self) -> String {
        let files = fs::read_dir(self.dir.path()).unwrap().flatten().map(|entry| entry.path());
        let logs = files.filter(|path| path.extension().is_some_and(|e| e == "log"));
        logs.map(|path| format!("{}:\n{}", path.display(), fs::read_to_string(&path).unwrap_or_default())).collect()
    }

    /// Removes what processes have said so far.
    pub(crate) fn forget(&self) {
        let files = fs::read_dir(self.dir.path()).unwrap().flatten().map(|entry| entry.path());
        files.filter(|path| path.extension().is_some_and(|e| e == "log")).for_each(|path| fs::remove_file(path).unwrap());
    }

    pub(crate) fn order(&self, order: &str) {
        let (code, text) = self.run(&["order", order]);
        assert_eq!(code, 0, "{order}: {text}");
    }

    /// Armed, at home, playing.
    pub(crate) fn play(&self) {
        self.until(&["ready"]);
        self.order("arm");
        self.until(&["holding"]);
        self.order("start");
        self.until(&["running-position"]);
        std::thread::sleep(Duration::from_millis(300));
    }
}

/// How many trials: many in the long tier (`PKM_LONG`), some in every run.
pub(crate) fn trials(some: u64, many: u64) -> u64 {
    if is_long() { many } else { some }
}

/// Whether this is the long tier, whose measurements are kept.
pub(crate) fn is_long() -> bool {
    std::env::var_os("PKM_LONG").is_some()
}

/// A table of the long tier: `PKM_RESULTS/<name>.md` with the commit it was run on; printed where no folder is given.
#[expect(clippy::print_stdout, reason = "a table that cannot be written must not pass for one that was")]
pub(crate) fn publish(name: &str, says: &str, rows: &[(&str, String)]) {
    let commit = std::env::var("PKM_COMMIT").unwrap_or_else(|_| "not stated".to_string());
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load: Vec<&str> = load.split_whitespace().take(3).collect();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let about = [
        ("build", if cfg!(debug_assertions) { "for development, with debug assertions" } else { "for release" }.to_string()),
        ("cores, and threads that wanted one in the last 1, 5, 15 minutes", format!("{cores}; {}", load.join(", "))),
    ];
    let table: String = rows.iter().chain(&about).map(|(what, value)| format!("| {what} | {value} |\n")).collect();
    let text = format!("# {name}\n\nCommit: {commit}\n\n{says}\n\n| what | measured |\n|---|---|\n{table}");
    match std::env::var_os("PKM_RESULTS") {
        Some(folder) => fs::write(PathBuf::from(folder).join(format!("{name}.md")), text).expect("a folder of results"),
        None => println!("{text}"),
    }
}

/// A process of this test.
pub(crate) struct Side {
    pub(crate) child: Child,
    pub(crate) log: PathBuf,
}

impl Side {
    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    pub(crate) fn told(&self) -> String {
        fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Its exit code, within a while.
    pub(crate) fn end(&mut self, seconds: u64) -> i32 {
        let code = within(seconds, || self.child.try_wait().unwrap());
        code.unwrap_or_else(|| panic!("it does not end: {}", fs::read_to_string(&self.log).unwrap_or_default())).code().unwrap_or(-1)
    }
}

impl Drop for Side {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Exit code of a process that ends in time; one that does not is killed.
pub(crate) fn end_of(child: &mut Child) -> Option<i32> {
    let status = within(PATIENCE_S, || child.try_wait().unwrap());
    if status.is_none() {
        child.kill().unwrap();
    }
    status.and_then(|status| status.code())
}

/// What `look` finds, within so many seconds.
pub(crate) fn within<T>(seconds: u64, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let end = SystemClock.now_ns() + seconds * 1_000_000_000;
    loop {
        let found = look();
        if found.is_some() || SystemClock.now_ns() > end {
            return found;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
