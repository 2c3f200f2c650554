//! A progress bar on standard error, for those who wait more than a moment.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};
use pkm_hal::{Clock, MonotonicClock};

/// Nothing is shown before this time `[s]`: a bar that flashes up tells nothing.
const PATIENCE: f64 = 2.0;

/// Parts of the bar's length.
const PARTS: f64 = 1000.0;

/// Progress of one computation; it vanishes when dropped.
pub(crate) struct Progress {
    label: &'static str,
    clock: MonotonicClock,
    is_wanted: bool,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Begins now. With `quiet`, or without a terminal, nothing is ever shown.
    pub(crate) fn new(label: &'static str, quiet: bool) -> Self {
        Self { label, clock: MonotonicClock::start(), is_wanted: !quiet && std::io::stderr().is_terminal(), bar: None }
    }

    /// Time since the beginning `[s]`.
    pub(crate) fn seconds(&self) -> f64 {
        self.clock.now_ns() as f64 * 1e-9
    }

    /// Shows a line above the bar, at once.
    pub(crate) fn say(&self, line: &str) {
        if !self.is_wanted {
            return;
        }
        let write = || crate::out::line_on_stderr(line);
        self.bar.as_ref().map_or_else(write, |bar| bar.suspend(write));
    }

    /// Takes note of the share done, 0 to 1.
    pub(crate) fn update(&mut self, share: f64) {
        let seconds = self.seconds();
        if !self.is_wanted || seconds < PATIENCE {
            return;
        }
        let label = self.label;
        let bar = self.bar.get_or_insert_with(|| new_bar(label));
        let share = share.clamp(0.0, 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and PARTS")]
        bar.set_position((PARTS * share) as u64);
        if share > 0.01 {
            bar.set_message(format!("about {} left", duration(seconds * (1.0 - share) / share)));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn new_bar(label: &'static str) -> ProgressBar {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small whole number")]
    let bar = ProgressBar::new(PARTS as u64);
    if let Ok(style) = ProgressStyle::with_template("{prefix:<12} [{bar:32}] {percent:>3} %  {msg}") {
        bar.set_style(style);
    }
    bar.set_prefix(label);
    bar
}

fn duration(seconds: f64) -> String {
    if seconds >= 90.0 { format!("{:.0} min", seconds / 60.0) } else { format!("{seconds:.0} s") }
}
