//! The door of a daemon: a Unix socket of its user alone, one request and one line of answer per connection.

use core::time::Duration;
use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use pkm_hal::{Clock, SystemClock};

/// Longest request read `[bytes]`.
const MAX_REQUEST: u64 = 64;

/// Longest answer read `[bytes]`.
const MAX_ANSWER: u64 = 1 << 20;

/// How long a client may take to say what it wants.
const PATIENCE: Duration = Duration::from_millis(100);

/// How long a daemon may take to answer.
const ANSWER: Duration = Duration::from_secs(3);

/// Name of the socket in the daemon's directory.
pub const SOCKET: &str = "control.sock";

/// The daemon's side.
#[derive(Debug)]
pub struct Door {
    listener: UnixListener,
    path: PathBuf,
}

/// A request with who waits for the answer.
#[derive(Debug)]
pub struct Request {
    /// What is asked.
    pub text: String,
    stream: UnixStream,
}

impl Door {
    /// A socket in `directory`, which must be private and whose lock must be held: one that a killed daemon has left is replaced.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn open(directory: &Path) -> io::Result<Self> {
        let path = directory.join(SOCKET);
        match fs::remove_file(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
            _ => {}
        }
        let listener = UnixListener::bind(&path)?;
        // The directory keeps others out already.
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, path })
    }

    /// The next request, if somebody stands there; a client that has not said all of it in time is sent away.
    pub fn request(&self) -> Option<Request> {
        let (stream, _) = self.listener.accept().ok()?;
        stream.set_nonblocking(false).ok()?;
        stream.set_write_timeout(Some(PATIENCE)).ok()?;
        let end_ns = SystemClock.now_ns().saturating_add(u64::try_from(PATIENCE.as_nanos()).unwrap_or(u64::MAX));
        let mut bytes = Vec::new();
        let mut byte = [0];
        let mut reader = (&stream).take(MAX_REQUEST);
        loop {
            // The time is for the whole request: a byte now and then buys no more of it.
            let left = Duration::from_nanos(end_ns.saturating_sub(SystemClock.now_ns()));
            if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
                bytes.clear();
                break;
            }
            match reader.read(&mut byte) {
                Ok(1) if byte[0] != b'\n' => bytes.push(byte[0]),
                Ok(_) => break,
                // Half a request is none.
                Err(_) => {
                    bytes.clear();
                    break;
                }
            }
        }
        Some(Request { text: String::from_utf8_lossy(&bytes).trim().to_string(), stream })
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        // What is left is replaced by the next daemon.
        let _ = fs::remove_file(&self.path);
    }
}

impl Request {
    /// Answers with one line.
    pub fn answer(mut self, line: &str) {
        // A client that has left needs no answer.
        let _ = writeln!(self.stream, "{line}");
    }
}

/// Asks the daemon whose directory this is; its answer, without the end of the line.
///
/// # Errors
/// No daemon is there, or it does not answer in time.
pub fn ask(directory: &Path, request: &str) -> io::Result<String> {
    let mut stream = UnixStream::connect(directory.join(SOCKET))?;
    stream.set_read_timeout(Some(ANSWER))?;
    stream.set_write_timeout(Some(ANSWER))?;
    writeln!(stream, "{request}")?;
    let mut answer = String::new();
    stream.take(MAX_ANSWER).read_to_string(&mut answer)?;
    if answer.ends_with('\n') { Ok(answer.trim_end().to_string()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_answered_and_strangers_cannot_come_in() {
        let dir = tempfile::tempdir().unwrap();
        // As after a kill.
        fs::write(dir.path().join(SOCKET), "").unwrap();
        let door = Door::open(dir.path()).unwrap();
        assert_eq!(fs::metadata(dir.path().join(SOCKET)).unwrap().permissions().mode() & 0o777, 0o600);
        let path = dir.path().to_path_buf();
        let client = std::thread::spawn(move || ask(&path, "status"));
        let request = loop {
            if let Some(request) = door.request() {
                break request;
            }
            std::thread::yield_now();
        };
        assert_eq!(request.text, "status");
        request.answer("{}");
        assert_eq!(client.join().unwrap().unwrap(), "{}");
        drop(door);
        assert!(ask(dir.path(), "status").is_err());
    }

    #[test]
    fn a_client_that_says_nothing_or_too_much_is_sent_away() {
        let dir = tempfile::tempdir().unwrap();
        let door = Door::open(dir.path()).unwrap();
        let _silent = UnixStream::connect(dir.path().join(SOCKET)).unwrap();
        assert_eq!(door.request().expect("it is there").text, "");
        let mut talker = UnixStream::connect(dir.path().join(SOCKET)).unwrap();
        talker.write_all(&[b'x'; 1000]).unwrap();
        assert_eq!(door.request().expect("it is there").text.len(), 64);
        assert!(door.request().is_none());
    }

    #[test]
    fn a_client_that_drips_gets_no_more_time_than_any_other() {
        let dir = tempfile::tempdir().unwrap();
        let door = Door::open(dir.path()).unwrap();
        let mut dripper = UnixStream::connect(dir.path().join(SOCKET)).unwrap();
        let client = std::thread::spawn(move || {
            // A byte each 50 ms, within the time of a read: all of it takes 3 s.
            for _ in 0..60 {
                std::thread::sleep(Duration::from_millis(50));
                if dripper.write_all(b"x").is_err() {
                    return;
                }
            }
        });
        let begin_ns = SystemClock.now_ns();
        assert_eq!(door.request().expect("it is there").text, "");
        let took_ns = SystemClock.now_ns() - begin_ns;
        assert!(took_ns < 2_000_000_000, "{took_ns} ns");
        client.join().unwrap();
    }
}
