//! Long calls: the interpreter is free, Ctrl-C ends them, and progress is told in the caller's thread.
//!
//! The work runs in a thread of its own. When Ctrl-C or the progress callback ends the call, the caller is free at once; the thread
//! stops when it next tells progress. It stops by unwinding without a panic's message, and shares nothing with the caller.

use alloc::sync::Arc;
use core::panic::AssertUnwindSafe;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::panic::{catch_unwind, resume_unwind};
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyBool;

use crate::error;

/// How often signals are looked at: what a user takes for at once.
const LOOK: Duration = Duration::from_millis(50);

/// Stack of the thread: that of a process's first one, for which the crates below are written.
const STACK: usize = 8 << 20;

/// Steps of progress that are worth a call into Python.
const STEP: f64 = 0.002;

/// What unwinds a thread whose caller has left.
struct Stopped;

/// What a thread tells its caller.
enum Message<T> {
    Share(f64),
    Done(T),
}

/// The `progress` argument of a call: nothing, a callable that takes the share done, or True for a bar.
pub(crate) struct Progress<'py> {
    callback: Option<Bound<'py, PyAny>>,
    /// A bar of our own, which is closed at the end.
    is_bar: bool,
}

impl<'py> Progress<'py> {
    /// From the argument; `words` stand before the bar.
    pub(crate) fn of(py: Python<'py>, given: Option<&Bound<'py, PyAny>>, words: &str) -> PyResult<Self> {
        let Some(given) = given else { return Ok(Self { callback: None, is_bar: false }) };
        if let Ok(wanted) = given.cast::<PyBool>() {
            let is_bar = wanted.is_true();
            let bar = || py.import("pkm.progress")?.call_method1("Bar", (words,));
            return Ok(Self { callback: is_bar.then(bar).transpose()?, is_bar });
        }
        if !given.is_callable() {
            let kind = given.get_type().name()?;
            return Err(PyTypeError::new_err(format!("progress is {kind} (must be a callable, True, False or None)")));
        }
        Ok(Self { callback: Some(given.clone()), is_bar: false })
    }

    fn tell(&self, share: f64) -> PyResult<()> {
        self.callback.as_ref().map_or(Ok(()), |callback| callback.call1((share,)).map(drop))
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        if let (true, Some(bar)) = (self.is_bar, &self.callback) {
            // A bar that cannot be closed is no reason to lose the result.
            let _closed = bar.call_method0("close");
        }
    }
}

/// Runs `work` in a thread of its own and returns what it returns; `work` is handed a function that tells the share done, 0 to 1.
///
/// What the progress callback or a signal's handler raises is raised at once.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: &Progress<'_>,
    work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T + Send + 'static,
) -> PyResult<T> {
    let stop = Arc::new(AtomicBool::new(false));
    let (send, receive) = channel();
    let (is_told, theirs) = (progress.callback.is_some(), Arc::clone(&stop));
    let started = thread::Builder::new().stack_size(STACK).spawn(move || {
        let last = AtomicU64::new(f64::NEG_INFINITY.to_bits());
        let tell = |share: f64| {
            if theirs.load(Ordering::Relaxed) {
                resume_unwind(Box::new(Stopped));
            }
            let before = f64::from_bits(last.load(Ordering::Relaxed));
            if is_told && (share >= before + STEP || (share >= 1.0 && before < 1.0)) {
                last.store(share.to_bits(), Ordering::Relaxed);
                // Nobody listens: the flag is seen next time.
                let _sent = send.send(Message::Share(share));
            }
        };
        let out = work(&tell);
        let _sent = send.send(Message::Done(out));
    });
    let thread = started.map_err(|e| error::value(format!("no thread: {e}")))?;
    let receive = Mutex::new(receive);
    let next = || receive.lock().map_or(Err(RecvTimeoutError::Disconnected), |r| r.recv_timeout(LOOK));
    loop {
        let told = match py.detach(next) {
            Ok(Message::Done(out)) => return Ok(out),
            Ok(Message::Share(share)) => progress.tell(share),
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panic) => resume_unwind(panic),
                Ok(()) => return Err(error::value("the calculation ended without a result")),
            },
        };
        if let Err(raised) = told.and_then(|()| py.check_signals()) {
            stop.store(true, Ordering::Relaxed);
            return Err(raised);
        }
    }
}

/// Ticks between looks at signals: a tick is a pose or a sample, far less than a millisecond.
const TICKS: u32 = 256;

/// Runs `work` where it is, the interpreter free; `work` is handed a function to call once per sample, `n_samples` times in all, which does
/// not return when a signal's handler or the progress callback raises.
pub(crate) fn here<T: Send>(
    py: Python<'_>,
    progress: &Progress<'_>,
    n_samples: usize,
    work: impl FnOnce(&mut dyn FnMut()) -> T + Send,
) -> PyResult<T> {
    let mut raised = None;
    let callback = progress.callback.as_ref().map(|callback| callback.clone().unbind());
    let outcome = py.detach(|| {
        let (mut ticks, mut done, mut told) = (0_u32, 0_usize, 0.0);
        let mut look = |done: usize| {
            let share = if done < n_samples { done as f64 / n_samples as f64 } else { 1.0 };
            let is_news = share >= told + STEP;
            Python::attach(|py| {
                if let (Some(callback), true) = (&callback, is_news) {
                    told = share;
                    callback.call1(py, (share,))?;
                }
                py.check_signals()
            })
        };
        let mut tick = || {
            (ticks, done) = ((ticks + 1) % TICKS, done + 1);
            if (ticks == 0 || done == n_samples)
                && let Err(e) = look(done)
            {
                raised = Some(e);
                resume_unwind(Box::new(Stopped));
            }
        };
        catch_unwind(AssertUnwindSafe(|| work(&mut tick)))
    });
    match (outcome, raised) {
        (Ok(out), _) => Ok(out),
        (Err(_), Some(raised)) => Err(raised),
        (Err(panic), None) => resume_unwind(panic),
    }
}

/// Runs `work`, which tells no progress, as a long call. When the caller leaves it goes on to its end, unheard.
pub(crate) fn apart<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    run(py, &Progress { callback: None, is_bar: false }, move |_| work())
}

/// Samples that are worth a thread: fewer are done before anyone could stop them.
const MANY: usize = 4096;

/// Runs `work` over so many samples, as a long call when they are many.
pub(crate) fn over<T: Send + 'static>(py: Python<'_>, n_samples: usize, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    if n_samples < MANY { Ok(py.detach(work)) } else { apart(py, work) }
}
