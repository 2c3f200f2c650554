//! The other side: a program that answers one line to each line it is sent.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A running program of the other side.
pub(crate) struct Peer {
    /// As its column in the table is called.
    pub(crate) name: String,
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts it.
    pub(crate) fn start(name: &str, program: &str) -> Result<Self, String> {
        let started = Command::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child = started.map_err(|e| format!("{program}: {e}"))?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(format!("{program}: no pipes"));
        };
        Ok(Self { name: name.to_string(), child, to, from: BufReader::new(from) })
    }

    fn ask(&mut self, request: &str) -> Result<String, String> {
        let failed = |e: std::io::Error| format!("{}, {request:?}: {e}", self.name);
        writeln!(self.to, "{request}").and_then(|()| self.to.flush()).map_err(failed)?;
        let mut line = String::new();
        self.from.read_line(&mut line).map_err(failed)?;
        let answer = line.trim();
        if answer.is_empty() || answer.starts_with("error") {
            return Err(format!("{}, {request:?}: {}", self.name, if answer.is_empty() { "it ended" } else { answer }));
        }
        Ok(answer.to_string())
    }

    fn number(&mut self, request: &str) -> Result<f64, String> {
        let answer = self.ask(request)?;
        answer.parse().map_err(|e| format!("{}, {request:?}: {answer:?}: {e}", self.name))
    }

    /// Reads a robot and its states.
    pub(crate) fn load(&mut self, folder: &Path) -> Result<(), String> {
        self.ask(&format!("load {}", folder.display())).map(|_| ())
    }

    /// Nanoseconds per call, over one pass through all states.
    pub(crate) fn time(&mut self, algorithm: &str) -> Result<f64, String> {
        self.number(&format!("time {algorithm}"))
    }

    /// Mean number of Newton steps of a loop closure.
    pub(crate) fn mean_steps(&mut self, algorithm: &str) -> Result<f64, String> {
        self.number(&format!("count {algorithm}"))
    }

    /// Results of all states, one after the other.
    pub(crate) fn results(&mut self, algorithm: &str, folder: &Path) -> Result<Vec<f64>, String> {
        let path = folder.join("results.bin");
        self.ask(&format!("write {algorithm} {}", path.display()))?;
        let bytes = fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let word = |b: &[u8]| b.try_into().map(f64::from_le_bytes).map_err(|_| format!("{}: cut off", path.display()));
        bytes.chunks(8).map(word).collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
