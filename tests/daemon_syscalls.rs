//! The kernel is asked for nothing in the daemon's loop but the time and to be woken: a filter in the kernel ends the process at anything else.
//! The robot is another thread's, over shared memory; the loop arms it, goes home, plays, stops and holds.
#![cfg(target_os = "linux")]
#![expect(unsafe_code, reason = "a filter of system calls cannot be set without it, nor a handler that says which call it was")]

extern crate alloc;

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use alloc::sync::Arc;
use core::ffi::{c_int, c_long, c_ulong, c_void};
use core::mem;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::path::Path;
use std::process::Command;
use std::thread;

use pkm_daemon::config::{DaemonConfig, Settings};
use pkm_daemon::machine::{Machine, Parts};
use pkm_daemon::supervisor::{Lines, LoopEnds, lines};
use pkm_daemon::weigher::Weigher;
use pkm_daemon::{Order, OrderKind, runner};
use pkm_dyn::effects::Robot;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver, SharedRobot};
use pkm_hal::cycle::ring::{RingSource, ring};
use pkm_hal::{Clock, CycleSource, Limiter, MAX_AXES, Phase, SystemClock};
use rig::{CONFIG, Wave, controller, robot};

/// Variables that make this test's program the one that runs the loop.
const MODE: &str = "PKM_SYSCALLS";
const FOLDER: &str = "PKM_SYSCALLS_FOLDER";

/// Calls that a loop may make: what time is it, wake me; and the end of the process.
const ALLOWED: [c_long; 3] = [libc::SYS_clock_gettime, libc::SYS_clock_nanosleep, libc::SYS_exit_group];

/// Where the handler of a forbidden call may write, and the status with which it ends the process.
const REPORT: c_int = 199;
const CAUGHT: c_int = 70;

/// Periods before the filter is set, and after which the loop makes a call of its own where it is told to.
const FREE: u64 = 20;
const SINS_AT: u64 = 40;

/// Everything must be over by then `[ns]`: these tests share their machine.
const PATIENCE_NS: u64 = 120_000_000_000;

#[test]
fn the_loop_asks_the_kernel_for_nothing_but_the_time() {
    if let Ok(mode) = std::env::var(MODE) {
        child(&mode, Path::new(&std::env::var(FOLDER).expect("a folder")));
    }
    let run = |mode: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command.args(["--exact", "the_loop_asks_the_kernel_for_nothing_but_the_time", "--nocapture"]);
        let output = command.env(MODE, mode).env(FOLDER, folder.path()).output().expect("a child");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, told) = run("honest");
    assert_eq!(code, Some(0), "{told}");
    // The filter filters: one call that only asks who the parent is.
    let (code, told) = run("sinner");
    assert_eq!(code, Some(CAUGHT), "{told}");
    assert!(told.contains(&format!("system call {:03}", libc::SYS_getppid)), "{told}");
}

/// Numbers of the example, patient where this machine is late.
fn settings(robot: &Robot) -> Settings {
    let text = CONFIG
        .replace("valid_for_s = 0.05", "valid_for_s = 1.0")
        .replace("stale_s     = 0.05", "stale_s = 0.9")
        .replace("stall_s      = 0.05", "stall_s = 30.0\nsupervisor_s = 30.0\nconsecutive_overruns = 100000\noverrun_share = 1.0")
        .replace("[limits]", "[limits]\nfollowing = 0.2\njump = 0.2");
    DaemonConfig::parse(&text, "daemon.toml").expect("the example").settings(&robot.model, 200.0).expect("the example fits")
}

fn child(mode: &str, folder: &Path) -> ! {
    let robot = robot("prs3");
    let settings = settings(&robot);
    let place = Place::try_new(&folder.join("meet")).expect("a place");
    let (of_driver, at, numbers) = (robot.clone(), place.clone(), settings.clone());
    thread::spawn(move || driver(&of_driver, &at, &numbers));
    let (sink, source) = ring(8192);
    let (lines, ends) = lines(source);
    let is_over = Arc::new(AtomicBool::new(false));
    let (told, is_sinner, of_loop) = (Arc::clone(&is_over), mode == "sinner", robot.clone());
    thread::spawn(move || {
        let shared = SharedRobot::try_new(&place, place.lock(Role::Daemon).expect("the lock"), 3, 0).expect("shared memory");
        let hal = Limiter::try_new(shared, &settings.axes).expect("limits");
        let LoopEnds { orders, answers, transitions, heartbeat } = ends;
        let (weigher, limits) = (Weigher::new(of_loop.model.clone()), Arc::clone(&settings.limits));
        let mut machine = Machine::new(Parts { hal, sink, weigher, wrench: None, limits, orders, answers, transitions, heartbeat });
        let mut periods = 0;
        let mut each = |_| {
            periods += 1;
            if periods == FREE {
                confine();
            }
            if periods == SINS_AT && is_sinner {
                // SAFETY: it has no arguments and cannot fail.
                unsafe { libc::getppid() };
            }
            if told.load(Ordering::Relaxed) {
                // SAFETY: it ends the process; nothing is to be cleaned up.
                unsafe { libc::_exit(0) }
            }
        };
        let _ = runner::run(&mut machine, &SystemClock, settings.limits.period_ns, &AtomicBool::new(false), &mut each);
    });
    supervise(lines, &robot, &is_over)
}

/// The robot, until the process ends.
fn driver(robot: &Robot, place: &Place, settings: &Settings) -> ! {
    let mut driver = SharedDriver::try_new(place, place.lock(Role::Driver).expect("the lock")).expect("shared memory");
    let mut hal = rig::guarded(robot, settings, &[0.14, 0.15, 0.16], SystemClock);
    loop {
        // A robot without a state, or whose commander is late: the loop sees it.
        let _ = driver.serve(&mut hal);
        thread::sleep(Duration::from_millis(1));
    }
}

/// Orders, each when it can be given, and the end when the last has been carried out.
fn supervise(mut lines: Lines<RingSource>, robot: &Robot, is_over: &AtomicBool) -> ! {
    let begin_ns = SystemClock.now_ns();
    let (mut given, mut played, mut phase) = (0, 0, None);
    while SystemClock.now_ns() - begin_ns < PATIENCE_NS {
        lines.heartbeat.store(SystemClock.now_ns(), Ordering::Relaxed);
        while let Some(record) = lines.records.take() {
            phase = Phase::of(record.phase);
            played += u64::from(phase == Some(Phase::Position));
        }
        while lines.answers.pop().is_ok() || lines.transitions.pop().is_ok() {}
        let order = match (given, phase) {
            (0, Some(Phase::Ready)) => Some(Order { nonce: 7, controller: Some(controller(robot)), ..Order::plain(OrderKind::Arm, 1) }),
            (1, Some(Phase::Holding)) => {
                let mut centre = [0.0; MAX_AXES];
                centre[..3].fill(0.15);
                Some(Order { motion: Some(Box::new(Wave { centre, height: 0.02, length: None })), ..Order::plain(OrderKind::Start, 2) })
            }
            (2, _) if played > 100 => Some(Order::plain(OrderKind::Stop, 3)),
            (3, Some(Phase::Holding)) => {
                is_over.store(true, Ordering::Relaxed);
                None
            }
            _ => None,
        };
        if let Some(order) = order {
            given += 1;
            // Before it, what came of the one before is forgotten.
            phase = None;
            assert!(lines.orders.push(order).is_ok(), "there is room");
        }
        thread::sleep(Duration::from_millis(5));
    }
    panic!("order {given} is not carried out: {phase:?}, {played} periods played");
}

/// From here on the kernel ends this process where this thread asks it for anything that is not allowed.
fn confine() {
    const LOAD: u16 = 0x20;
    const EQUAL: u16 = 0x15;
    const RETURN: u16 = 0x06;
    // Offsets in what the kernel shows of a call: its number, the low word of its first argument.
    const NUMBER: u32 = 0;
    const ARGUMENT: u32 = 16;
    let op = |code: u16, k: u32, jf: u8| libc::sock_filter { code, jt: 0, jf, k };
    let number = |call: c_long| u32::try_from(call).expect("a number of a call");
    let mut program = vec![op(LOAD, NUMBER, 0)];
    for call in ALLOWED {
        program.extend([op(EQUAL, number(call), 1), op(RETURN, libc::SECCOMP_RET_ALLOW, 0)]);
    }
    let report = u32::try_from(REPORT).expect("a descriptor");
    program.extend([op(EQUAL, number(libc::SYS_write), 3), op(LOAD, ARGUMENT, 0), op(EQUAL, report, 1)]);
    program.extend([op(RETURN, libc::SECCOMP_RET_ALLOW, 0), op(RETURN, libc::SECCOMP_RET_TRAP, 0)]);
    let filter = libc::sock_fprog { len: u16::try_from(program.len()).expect("a short program"), filter: program.as_mut_ptr() };
    let [one, zero]: [c_ulong; 2] = [1, 0];
    // SAFETY: the handler only writes and exits; the program and its length belong together and outlive the calls, which copy it.
    let outcomes = unsafe {
        libc::dup2(2, REPORT);
        let mut action: libc::sigaction = mem::zeroed();
        action.sa_sigaction = caught as *const () as usize;
        action.sa_flags = libc::SA_SIGINFO;
        [
            libc::sigaction(libc::SIGSYS, &raw const action, core::ptr::null_mut()),
            libc::prctl(libc::PR_SET_NO_NEW_PRIVS, one, zero, zero, zero),
            libc::prctl(libc::PR_SET_SECCOMP, c_ulong::from(libc::SECCOMP_MODE_FILTER), &raw const filter),
        ]
    };
    assert_eq!(outcomes, [0; 3], "{}", std::io::Error::last_os_error());
}

/// Says which call it was, and ends the process.
extern "C" fn caught(_: c_int, info: *mut libc::siginfo_t, _: *mut c_void) {
    // SAFETY: of this signal, the kernel's number of the call is behind the address it was made from.
    let number = unsafe { info.cast::<u8>().add(24).cast::<c_int>().read() };
    let mut text = *b"system call 000\n";
    for (digit, power) in text[12..15].iter_mut().zip([100, 10, 1]) {
        *digit = b'0' + u8::try_from(number / power % 10).unwrap_or(0);
    }
    // SAFETY: bytes of this array; then the process ends.
    unsafe {
        libc::write(REPORT, text.as_ptr().cast(), text.len());
        libc::_exit(CAUGHT);
    }
}
