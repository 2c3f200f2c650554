//! A daemon.toml: read whole and checked whole before anything is opened; layout in docs/FORMATS.md.

mod buildable;
mod contact;
mod layout;
#[cfg(test)]
mod tests;

use alloc::sync::Arc;
use std::io::Read;
use std::path::{Path, PathBuf};

use pkm_ctrl::Numbers;
use pkm_dyn::model::Model;
use pkm_hal::{AxisLimits, MAX_AXES, SafeAction, SafeKind};

use crate::gate::GateLimits;
use crate::machine::Limits;
use crate::realtime::Policy;
use crate::weigher::reflected;
use layout::{File, PerDrive};

/// Largest file read `[bytes]`.
const MAX_BYTES: u64 = 1 << 20;

/// Largest usual `velocity_gain`, in moved masses over the period: far below 1, where a state one period old makes braking unstable.
const FIRMEST: f64 = 0.2;

/// Slowest and fastest loop `[Hz]`.
pub const RATES_HZ: [f64; 2] = [100.0, crate::grid::FASTEST_HZ as f64];

/// Why a file is no daemon's: one line that names file, line, key, value and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}{}: {problem}", .line.map_or(String::new(), |line| format!(":{line}")))]
pub struct ConfigError {
    /// The file, as given.
    pub file: String,
    /// Its line, from one; 1 for what concerns the whole, none where there is no text.
    pub line: Option<usize>,
    /// Key, value, limit.
    pub problem: String,
}

/// Where the robot is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HalKind {
    /// In this process, simulated, no faster than time passes.
    Simulated,
    /// In another process, over shared memory.
    Iceoryx2,
}

/// What the file says before a robot is known.
#[derive(Debug)]
pub struct DaemonConfig {
    file: String,
    text: String,
    layout: File,
}

/// What it says for a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Numbers of the loop.
    pub limits: Arc<Limits>,
    /// Limits between loop and device, one per drive.
    pub axes: Arc<[AxisLimits]>,
    /// Rights that are asked for.
    pub realtime: Policy,
    /// Core that the loop stays on.
    pub cpu: Option<usize>,
    /// Priority in the class `SCHED_FIFO`.
    pub priority: u8,
    /// Seconds that the black box keeps `[s]`.
    pub black_box_s: f64,
    /// Number of the model's wrench sensor that the robot's first six sensors are.
    pub wrench: Option<usize>,
    /// How long the law of contact or the exercise runs before it holds by itself `[s]`; none: until it is stopped.
    pub length_s: Option<f64>,
}

impl Settings {
    /// The limits, for who looks from outside the loop whether they are still what the file says.
    #[must_use]
    pub fn numbers(&self) -> Numbers {
        Numbers::new(Arc::new((Arc::clone(&self.limits), Arc::clone(&self.axes))))
    }
}

/// Name and text of a daemon.toml.
///
/// # Errors
/// A file that cannot be read, is larger than a megabyte, or no UTF-8.
pub fn read(path: &Path) -> Result<(String, String), ConfigError> {
    let file = path.display().to_string();
    let bad = |problem: String| ConfigError { file: file.clone(), line: None, problem };
    let mut bytes = Vec::new();
    let opened = std::fs::File::open(path).map_err(|e| bad(e.to_string()))?;
    opened.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|e| bad(e.to_string()))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(bad(format!("more than {MAX_BYTES} bytes (the limit)")));
    }
    let text = String::from_utf8(bytes).map_err(|e| bad(format!("byte {} is not UTF-8", e.utf8_error().valid_up_to())))?;
    Ok((file, text))
}

impl DaemonConfig {
    /// What `text` says; errors call it `file`.
    ///
    /// # Errors
    /// Bad syntax, unknown keys, wrong types.
    pub fn parse(text: &str, file: &str) -> Result<Self, ConfigError> {
        let layout = toml::from_str(text).map_err(|e| {
            let problem = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
            ConfigError { file: file.to_string(), line: Some(line_of(text, e.span().map_or(0, |s| s.start))), problem }
        })?;
        Ok(Self { file: file.to_string(), text: text.to_string(), layout })
    }

    /// A robot.toml, or the name of a shipped robot.
    #[must_use]
    pub fn robot(&self) -> &str {
        self.layout.robot.get_ref()
    }

    /// The controller.toml of the position loop; its rate is the loop's.
    #[must_use]
    pub fn controller(&self) -> &str {
        self.layout.controller.get_ref()
    }

    /// The controller.toml that runs, where it is another one.
    #[must_use]
    pub fn run_controller(&self) -> Option<&str> {
        self.layout.run.controller.as_ref().map(|c| c.get_ref().as_str())
    }

    /// The recording that is played.
    #[must_use]
    pub fn motion(&self) -> Option<&str> {
        self.layout.run.motion.as_ref().map(|m| m.get_ref().as_str())
    }

    /// The private directory.
    #[must_use]
    pub fn directory(&self) -> Option<PathBuf> {
        self.layout.directory.as_ref().map(|d| PathBuf::from(d.get_ref()))
    }

    /// Whose processes may be sides: a user and a group, names or numbers.
    #[must_use]
    pub fn owners(&self) -> [Option<&str>; 2] {
        [&self.layout.user, &self.layout.group].map(|key| key.as_ref().map(|name| name.get_ref().as_str()))
    }

    /// Where the robot is.
    #[must_use]
    pub fn hal(&self) -> HalKind {
        self.layout.hal.kind
    }

    /// An error about the value of a top-level key: `robot`, `controller`, `directory`, `motion`.
    #[must_use]
    pub fn about(&self, key: &str, problem: &str) -> ConfigError {
        let span = match key {
            "robot" => Some(self.layout.robot.span()),
            "controller" => Some(self.layout.controller.span()),
            "directory" => self.layout.directory.as_ref().map(toml::Spanned::span),
            "user" => self.layout.user.as_ref().map(toml::Spanned::span),
            "group" => self.layout.group.as_ref().map(toml::Spanned::span),
            "motion" => self.layout.run.motion.as_ref().map(toml::Spanned::span),
            "run.controller" => self.layout.run.controller.as_ref().map(toml::Spanned::span),
            _ => None,
        };
        self.error(span.map_or(0, |s| s.start), format!("{key}: {problem}"))
    }

    fn error(&self, at: usize, problem: String) -> ConfigError {
        ConfigError { file: self.file.clone(), line: Some(line_of(&self.text, at)), problem }
    }

    /// What the file says for a robot with this model, whose controller steps `rate_hz` times a second `[Hz]`.
    ///
    /// # Errors
    /// A number out of range, a list of another length than the robot has drives, limits beyond the robot's own.
    pub fn settings(&self, model: &Model, rate_hz: f64) -> Result<Settings, ConfigError> {
        let n = model.n_act();
        if n == 0 || n > MAX_AXES {
            return Err(self.about("robot", &format!("it has {n} drives (must be 1 to {MAX_AXES})")));
        }
        if !(RATES_HZ[0]..=RATES_HZ[1]).contains(&rate_hz) {
            let (name, [low, high]) = (self.controller(), RATES_HZ);
            return Err(self.about("controller", &format!("{name:?} has rate_hz = {rate_hz} (must be {low} to {high} Hz)")));
        }
        let at = Reader { config: self, model, period: 1.0 / rate_hz };
        let axes = at.axes()?;
        let limits = at.limits(&axes)?;
        at.buildable(&axes, limits.safe)?;
        let timing = &self.layout.timing;
        let whole = |x: f64| x.fract() == 0.0;
        let priority = at.number("loop.priority", timing.priority.as_ref(), 80.0, [1.0, 98.0], "")?;
        let cpu = timing.cpu.as_ref().map(|cpu| at.number("loop.cpu", Some(cpu), 0.0, [0.0, 1023.0], "")).transpose()?;
        for (key, value, span) in [("loop.priority", Some(priority), &timing.priority), ("loop.cpu", cpu, &timing.cpu)] {
            if value.is_some_and(|x| !whole(x)) {
                return Err(self.error(span.as_ref().map_or(0, |s| s.span().start), format!("{key}: must be a whole number")));
            }
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: whole and in range")]
        let (priority, cpu) = (priority as u8, cpu.map(|cpu| cpu as usize));
        let black_box_s = at.number("black_box_s", self.layout.black_box_s.as_ref(), 5.0, [0.1, 600.0], "s")?;
        let (wrench, length_s) = (at.wrench()?, at.length_s()?);
        Ok(Settings {
            limits: Arc::new(limits),
            axes: axes.into(),
            realtime: self.layout.realtime,
            cpu,
            priority,
            black_box_s,
            wrench,
            length_s,
        })
    }
}

/// Reads numbers for one robot.
struct Reader<'a> {
    config: &'a DaemonConfig,
    model: &'a Model,
    period: f64,
}

impl Reader<'_> {
    fn n(&self) -> usize {
        self.model.n_act()
    }

    fn number(&self, key: &str, stated: Option<&toml::Spanned<f64>>, usual: f64, range: [f64; 2], unit: &str) -> Result<f64, ConfigError> {
        let Some(stated) = stated else { return Ok(usual) };
        let (x, [low, high]) = (*stated.get_ref(), range);
        if (low..=high).contains(&x) {
            return Ok(x);
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        Err(self.config.error(stated.span().start, format!("{key} = {x} (must be {low} to {high}{unit})")))
    }

    /// One number for each drive, within `range`.
    fn each(
        &self,
        key: &str,
        stated: Option<&toml::Spanned<PerDrive>>,
        usual: impl Fn(usize) -> f64,
        range: [f64; 2],
    ) -> Result<[f64; MAX_AXES], ConfigError> {
        let Some(stated) = stated else { return Ok(core::array::from_fn(|k| if k < self.n() { usual(k) } else { 0.0 })) };
        let bad = |problem: String| self.config.error(stated.span().start, problem);
        let value = |k: usize| match stated.get_ref() {
            PerDrive::One(x) => *x,
            PerDrive::Each(list) => list.get(k).copied().unwrap_or(f64::NAN),
        };
        if let PerDrive::Each(list) = stated.get_ref()
            && list.len() != self.n()
        {
            return Err(bad(format!("{key} has {} numbers (the robot has {} drives)", list.len(), self.n())));
        }
        let [low, high] = range;
        for k in 0..self.n() {
            if !(low..=high).contains(&value(k)) {
                let joint = &self.model.joints[self.model.actuators[k]].name;
                return Err(bad(format!("{key} = {} at joint {joint:?} (must be {low} to {high})", value(k))));
            }
        }
        Ok(core::array::from_fn(|k| if k < self.n() { value(k) } else { 0.0 }))
    }

    fn own(&self, k: usize) -> pkm_dyn::model::Limits {
        self.model.joints[self.model.actuators[k]].limits
    }

    /// Travel of a drive `[m | rad]`, 1 where it has no ends.
    fn travel(&self, k: usize) -> f64 {
        let travel = self.own(k).upper - self.own(k).lower;
        if travel.is_finite() { travel } else { 1.0 }
    }

    fn axes(&self) -> Result<Vec<AxisLimits>, ConfigError> {
        let l = &self.config.layout.limits;
        let stated = |x: f64| if x > 0.0 { x } else { f64::INFINITY };
        let effort = self.each("limits.effort", l.effort.as_ref(), |k| stated(self.own(k).effort), [0.0, f64::MAX])?;
        let velocity = self.each("limits.velocity", l.velocity.as_ref(), |k| stated(self.own(k).velocity), [0.0, f64::INFINITY])?;
        let rate = self.each("limits.effort_rate", l.effort_rate.as_ref(), |_| f64::INFINITY, [f64::MIN_POSITIVE, f64::INFINITY])?;
        let every = [f64::NEG_INFINITY, f64::INFINITY];
        let lower = self.each("limits.lower", l.lower.as_ref(), |k| self.own(k).lower, every)?;
        let upper = self.each("limits.upper", l.upper.as_ref(), |k| self.own(k).upper, every)?;
        let (position_gain, velocity_gain) = (l.position_gain.as_ref(), l.velocity_gain.as_ref());
        let positive = [0.0, f64::MAX];
        let fast = self.each("limits.position_gain", position_gain, |_| 0.25 / (5.0 * self.period), positive)?;
        let mass = reflected(self.model);
        // Braked within some periods, whatever is moved: a gain beyond its mass over the period overshoots, and flips between both efforts.
        let firm = |k: usize| {
            let most = if mass[k] > 0.0 { FIRMEST * mass[k] / self.period } else { f64::INFINITY };
            (10.0 * effort[k] / velocity[k].min(10.0)).min(most)
        };
        let firm = self.each("limits.velocity_gain", velocity_gain, firm, positive)?;
        for k in 0..self.n() {
            self.within_own(k, [effort[k], velocity[k], lower[k], upper[k]])?;
        }
        let axis = |k: usize| AxisLimits {
            lower: lower[k],
            upper: upper[k],
            velocity: velocity[k],
            effort: effort[k],
            effort_rate: rate[k],
            position_gain: fast[k],
            velocity_gain: firm[k],
        };
        Ok((0..self.n()).map(axis).collect())
    }

    /// Limits of the file only narrow those of the robot.
    fn within_own(&self, k: usize, [effort, velocity, lower, upper]: [f64; 4]) -> Result<(), ConfigError> {
        let (l, own) = (&self.config.layout.limits, self.own(k));
        let joint = &self.model.joints[self.model.actuators[k]].name;
        let wide = |own: f64| if own > 0.0 { own } else { f64::INFINITY };
        let keys = [
            ("effort", l.effort.as_ref(), effort, effort > wide(own.effort), wide(own.effort)),
            ("velocity", l.velocity.as_ref(), velocity, velocity > wide(own.velocity), wide(own.velocity)),
            ("lower", l.lower.as_ref(), lower, lower < own.lower, own.lower),
            ("upper", l.upper.as_ref(), upper, upper > own.upper, own.upper),
            ("upper", l.upper.as_ref().or(l.lower.as_ref()), upper, upper <= lower, lower),
        ];
        let Some((key, stated, value, _, limit)) = keys.into_iter().find(|(.., is_bad, _)| *is_bad) else {
            let is_bounded = effort.is_finite();
            let problem = format!("limits.effort: joint {joint:?} has no largest effort (neither here nor in the robot's files)");
            return if is_bounded { Ok(()) } else { Err(self.config.error(0, problem)) };
        };
        let problem = format!("limits.{key} = {value} at joint {joint:?} (the robot's own limit is {limit})");
        Err(self.config.error(stated.map_or(0, |s| s.span().start), problem))
    }

    fn limits(&self, axes: &[AxisLimits]) -> Result<Limits, ConfigError> {
        let (l, t, hal) = (&self.config.layout.limits, &self.config.layout.timing, &self.config.layout.hal);
        let (period, minute) = (self.period, 60.0);
        let late = self.number("hal.late_s", hal.late_s.as_ref(), 3.0 * period, [period, minute], "s")?;
        let stale = self.number("hal.stale_s", hal.stale_s.as_ref(), 5.0 * period, [period, minute], "s")?;
        let valid_for =
            self.number("hal.valid_for_s", hal.valid_for_s.as_ref(), 5.0 * period, [period, 1.0_f64.max(20.0 * period)], "s")?;
        let speed = |k: usize| axes[k].velocity;
        let own_speed = |k: usize| if speed(k).is_finite() { 0.25 * speed(k) } else { 0.1 };
        let wide = [f64::MIN_POSITIVE, f64::INFINITY];
        let all: [f64; MAX_AXES] = core::array::from_fn(|k| axes.get(k).map_or(0.0, |axis| axis.velocity));
        let gate = Arc::new(GateLimits {
            late_ns: nanoseconds(late),
            stale_ns: nanoseconds(stale),
            ahead_ns: nanoseconds(period),
            speed: all,
            jump: self.each("limits.jump", l.jump.as_ref(), |k| 0.01 * self.travel(k), wide)?,
            stuck: self.each("limits.stuck", l.stuck.as_ref(), |k| 0.01 * self.travel(k), wide)?,
        });
        let home = self.config.layout.home.as_ref();
        let home = home.map(|home| self.each("home.q", Some(&home.q), |_| 0.0, [f64::MIN, f64::MAX])).transpose()?;
        self.reachable(home.as_ref(), axes)?;
        let stall = self.number("loop.stall_s", t.stall_s.as_ref(), valid_for, [period, minute], "s")?;
        let supervisor = self.number("loop.supervisor_s", t.supervisor_s.as_ref(), 1.0, [0.1, minute], "s")?;
        let overruns = self.number("loop.consecutive_overruns", t.consecutive_overruns.as_ref(), 5.0, [0.0, 1e6], "")?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: 0 to 1e6; parts of one count as none")]
        let overruns = overruns as u64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 1200")]
        let patience = (valid_for / period).ceil() as u64 + 5;
        Ok(Limits {
            period_ns: nanoseconds(period),
            gate,
            contact: self.contact()?,
            following: self.each("limits.following", l.following.as_ref(), |k| 0.05 * self.travel(k), wide)?,
            speed: self.each("limits.move_speed", l.move_speed.as_ref(), own_speed, [f64::MIN_POSITIVE, 1e6])?,
            home,
            soft_start_s: self.number("loop.soft_start_s", t.soft_start_s.as_ref(), 0.5, [0.0, minute], "s")?,
            stop_s: self.number("loop.stop_s", t.stop_s.as_ref(), 0.5, [0.0, 10.0], "s")?,
            valid_for_ns: nanoseconds(valid_for),
            patience,
            overruns,
            overrun_share: self.number("loop.overrun_share", t.overrun_share.as_ref(), 0.1, [0.0, 1.0], "")?,
            stall_ns: nanoseconds(stall),
            supervisor_ns: nanoseconds(supervisor),
            safe: self.safe(axes)?,
        })
    }

    fn reachable(&self, home: Option<&[f64; MAX_AXES]>, axes: &[AxisLimits]) -> Result<(), ConfigError> {
        let (Some(home), Some(stated)) = (home, self.config.layout.home.as_ref()) else { return Ok(()) };
        for (k, axis) in axes.iter().enumerate() {
            if home[k] < axis.lower || home[k] > axis.upper {
                let joint = &self.model.joints[self.model.actuators[k]].name;
                let problem = format!("home.q = {} at joint {joint:?} (its range is {} to {})", home[k], axis.lower, axis.upper);
                return Err(self.config.error(stated.q.span().start, problem));
            }
        }
        Ok(())
    }

    fn safe(&self, axes: &[AxisLimits]) -> Result<SafeAction, ConfigError> {
        let s = &self.config.layout.safe;
        let many = [0.0, f64::MAX];
        let mut action = SafeAction::new(s.kind.kind());
        action.ramp_ns = nanoseconds(self.number("safe.ramp_s", s.ramp_s.as_ref(), 0.5, [0.0, 60.0], "s")?);
        action.stiffness = self.each("safe.stiffness", s.stiffness.as_ref(), |_| 0.0, many)?;
        action.damping = self.each("safe.damping", s.damping.as_ref(), |_| 0.0, many)?;
        action.effort = self.each("safe.effort", s.effort.as_ref(), |k| axes[k].effort, many)?;
        let needs = match action.kind {
            SafeKind::Damp | SafeKind::Hold => Some(("safe.damping", s.damping.is_none())),
            SafeKind::Off | SafeKind::Ramp | SafeKind::Brake => None,
        };
        if let Some((key, true)) = needs {
            return Err(self.config.error(0, format!("{key} is missing (safe.kind damps with it)")));
        }
        Ok(action)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: 0 to 60 s")]
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|b| *b == b'\n').count()
}
