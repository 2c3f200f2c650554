//! What the operating system gives a loop that must be in time: a real-time class, a core, memory that stays, a processor that does not doze.

use std::fs::{File, OpenOptions};
use std::io::Write;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_setaffinity};
use serde::{Deserialize, Serialize};

/// What to do where it is not given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// Do not run.
    Require,
    /// Run, and say what is missing.
    #[default]
    Prefer,
    /// Do not ask.
    Off,
}

/// What was given, and what was not.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Grants {
    /// Priority in the class `SCHED_FIFO`; 0 without.
    pub fifo_priority: u8,
    /// Core that the loop stays on.
    pub cpu: Option<usize>,
    /// Whether memory stays in memory.
    pub is_locked: bool,
    /// Whether the processor is kept from dozing.
    pub is_awake: bool,
    /// Whether the kernel is a real-time one.
    pub is_rt_kernel: bool,
    /// What is missing, each with what gives it.
    pub missing: Vec<String>,
}

/// What keeps the processor awake: for as long as it lives.
#[derive(Debug)]
pub struct Awake {
    _file: Option<File>,
}

/// Stack that the loop may use without a page fault `[bytes]`.
const STACK: usize = 512 * 1024;

/// Claims for the calling thread what `policy` asks for: a core, a priority (1 to 99), memory, a processor that stays awake.
///
/// # Errors
/// Everything that is missing, where it is required.
pub fn claim(policy: Policy, cpu: Option<usize>, priority: u8) -> Result<(Grants, Awake), Grants> {
    let mut grants = Grants { is_rt_kernel: is_rt_kernel(), ..Grants::default() };
    let mut awake = Awake { _file: None };
    if policy == Policy::Off {
        return Ok((grants, awake));
    }
    if let Some(cpu) = cpu {
        match pin(cpu) {
            Ok(()) => grants.cpu = Some(cpu),
            Err(e) => grants.missing.push(format!("core {cpu}: {e} (timing.cpu must be a core of this machine that the process may use)")),
        }
    }
    match lock_memory() {
        Ok(()) => grants.is_locked = true,
        Err(e) => grants.missing.push(format!("locked memory: {e} (`ulimit -l unlimited`, or LimitMEMLOCK=infinity in the unit)")),
    }
    prefault();
    match keep_awake() {
        Ok(file) => (awake._file, grants.is_awake) = (Some(file), true),
        Err(e) => grants.missing.push(format!("a processor that stays awake: /dev/cpu_dma_latency: {e} (a udev rule for its group)")),
    }
    match fifo(priority) {
        Ok(()) => grants.fifo_priority = priority,
        Err(e) => grants.missing.push(format!("SCHED_FIFO {priority}: {e} (`ulimit -r 95`, or LimitRTPRIO=95 in the unit)")),
    }
    if !grants.is_rt_kernel {
        grants.missing.push("a real-time kernel: this one has no PREEMPT_RT (install one; latencies are not bounded without)".to_string());
    }
    // The kernel is told of, but a program that may not choose it runs all the same.
    let lacks = grants.fifo_priority == 0 || !grants.is_locked || (cpu.is_some() && grants.cpu.is_none());
    if policy == Policy::Require && lacks { Err(grants) } else { Ok((grants, awake)) }
}

fn pin(cpu: usize) -> Result<(), String> {
    if cpu >= CpuSet::MAX_CPU {
        return Err("no such core".to_string());
    }
    let mut set = CpuSet::new();
    set.set(cpu);
    sched_setaffinity(None, &set).map_err(|e| e.to_string())
}

fn lock_memory() -> Result<(), String> {
    // With a bound, memory that is asked for later would be refused, threads among it; root has one where a container took the right.
    let is_unbounded = capabilities(None).is_ok_and(|own| own.effective.contains(CapabilitySet::IPC_LOCK));
    if let (Some(most), false) = (getrlimit(Resource::Memlock).current, is_unbounded) {
        return Err(format!("the limit is {most} bytes"));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|e| e.to_string())?;
    keep_heap();
    Ok(())
}

/// Memory that was freed stays with the process, so that it need not be asked for again.
#[cfg(target_env = "gnu")]
fn keep_heap() {
    // SAFETY: mallopt changes numbers of the allocator, which locks them itself.
    #[expect(unsafe_code, reason = "no safe wrapper of mallopt exists")]
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
    }
}

#[cfg(not(target_env = "gnu"))]
fn keep_heap() {}

/// Touches the stack that the loop will use.
#[inline(never)]
fn prefault() {
    let mut stack = [0_u8; STACK];
    for page in stack.chunks_mut(4096) {
        page[0] = 1;
    }
    core::hint::black_box(&stack);
}

fn keep_awake() -> std::io::Result<File> {
    let mut file = OpenOptions::new().write(true).open("/dev/cpu_dma_latency")?;
    file.write_all(&0_i32.to_ne_bytes())?;
    Ok(file)
}

fn fifo(priority: u8) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority: i32::from(priority) };
    // SAFETY: the pointer is to a live struct of the type that the call reads; 0 is the calling thread.
    #[expect(unsafe_code, reason = "rustix has no sched_setscheduler")]
    let outcome = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if outcome == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

/// A newer real-time kernel has no `/sys/kernel/realtime`, so its version says so as well.
fn is_rt_kernel() -> bool {
    let read = |path| std::fs::read_to_string(path).unwrap_or_default();
    read("/sys/kernel/realtime").trim() == "1" || read("/proc/version").contains("PREEMPT_RT")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_claimed_where_it_is_off_and_a_core_that_is_not_there_is_told() {
        let (grants, _) = claim(Policy::Off, Some(1 << 20), 80).unwrap();
        assert!(grants.missing.is_empty() && grants.cpu.is_none());
        let outcome = std::thread::spawn(|| claim(Policy::Require, Some(1 << 20), 80)).join().unwrap();
        let missing = outcome.expect_err("no machine has so many cores").missing;
        assert!(missing.iter().any(|line| line.starts_with("core 1048576: no such core")), "{missing:?}");
    }

    #[test]
    fn a_core_that_is_granted_is_the_only_one() {
        let allowed = rustix::thread::sched_getaffinity(None).unwrap();
        let last = (0..CpuSet::MAX_CPU).rfind(|&cpu| allowed.is_set(cpu)).unwrap();
        let pinned = std::thread::spawn(move || {
            let granted = pin(last);
            (granted, rustix::thread::sched_getaffinity(None))
        });
        let (granted, set) = pinned.join().unwrap();
        let set = set.unwrap();
        assert_eq!((granted, set.count(), set.is_set(last)), (Ok(()), 1, true));
    }
}
