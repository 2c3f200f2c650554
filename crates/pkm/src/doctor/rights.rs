//! What a control loop asks of the kernel, and whether it is granted: the one file of the command that calls the C library.

use std::fs::{File, OpenOptions};
use std::io::Write;

use rustix::mm::{MlockAllFlags, mlockall, munlockall};
use rustix::process::{Resource, getrlimit};

use super::facts::{Finding, State};

/// Whether scheduling rights and locked memory are granted.
pub(super) fn look(priority: i32) -> Vec<Finding> {
    vec![scheduling(priority), memory(), wakefulness()]
}

fn scheduling(priority: i32) -> Finding {
    let what = "scheduling";
    // On a thread of its own: the right ends with it.
    let granted = std::thread::spawn(move || set_fifo(priority)).join().unwrap_or(Err(std::io::ErrorKind::Other.into()));
    match granted {
        Ok(()) => Finding::new(what, &format!("SCHED_FIFO {priority} is granted"), State::Good, ""),
        Err(e) => {
            let limit = getrlimit(Resource::Rtprio).current.unwrap_or(u64::MAX);
            let found = format!("SCHED_FIFO {priority} is refused: {e} (limit rtprio {limit})");
            Finding::new(what, &found, State::Bad, "@pkm - rtprio 95 in /etc/security/limits.d/, or LimitRTPRIO=95 in the service")
        }
    }
}

fn memory() -> Finding {
    let what = "locked memory";
    let limit = getrlimit(Resource::Memlock).current;
    let told = limit.map_or("unlimited".to_string(), |bytes| format!("{} KiB", bytes / 1024));
    let advice = "@pkm - memlock unlimited in /etc/security/limits.d/, or LimitMEMLOCK=infinity in the service";
    match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        Ok(()) => {
            let _ = munlockall();
            let state = if limit.is_none() { State::Good } else { State::Note };
            let advice = if limit.is_none() { "" } else { advice };
            Finding::new(what, &format!("granted, limit {told}"), state, advice)
        }
        Err(e) => Finding::new(what, &format!("refused: {e} (limit {told})"), State::Bad, advice),
    }
}

fn wakefulness() -> Finding {
    let what = "processor sleep";
    match stay_awake() {
        Ok(_) => Finding::new(what, "can be forbidden (/dev/cpu_dma_latency)", State::Good, ""),
        Err(e) => {
            let advice = "let the loop's user write /dev/cpu_dma_latency, or forbid deep sleep by processor.max_cstate=1";
            Finding::new(what, &format!("cannot be forbidden: /dev/cpu_dma_latency: {e}"), State::Note, advice)
        }
    }
}

/// Forbids the processors to sleep so deeply that waking takes time, as long as the file is open.
fn stay_awake() -> std::io::Result<File> {
    let mut file = OpenOptions::new().write(true).open("/dev/cpu_dma_latency")?;
    file.write_all(&0_i32.to_ne_bytes())?;
    Ok(file)
}

/// Rights of a control loop as far as they are granted; they end when this is dropped, those of threads with their thread.
pub(super) struct Rights {
    _awake: Option<File>,
    is_locked: bool,
}

impl Rights {
    /// Asks for what holds for the whole process.
    pub(super) fn of_process() -> Self {
        Self { _awake: stay_awake().ok(), is_locked: mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).is_ok() }
    }
}

impl Drop for Rights {
    fn drop(&mut self) {
        if self.is_locked {
            let _ = munlockall();
        }
    }
}

/// Puts the calling thread under `SCHED_FIFO`.
#[cfg(target_os = "linux")]
#[expect(unsafe_code, reason = "neither std nor rustix has this call")]
pub(super) fn set_fifo(priority: i32) -> std::io::Result<()> {
    let parameter = libc::sched_param { sched_priority: priority };
    // SAFETY: the pointer is to a live struct that the call only reads; 0 means the calling thread.
    let result = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) };
    if result == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

/// Elsewhere nobody is asked.
#[cfg(not(target_os = "linux"))]
pub(super) fn set_fifo(_: i32) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}
