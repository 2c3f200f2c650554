//! Everything a daemon.toml names, read and checked before anything is opened or moves.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use pkm_ctrl::catalogue::Drives;
use pkm_ctrl::{Running, config as controllers};
use pkm_daemon::config::{DaemonConfig, HalKind, Settings};
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::Description;
use pkm_hal::Phase;
use pkm_ident::Recording;
use pkm_record::ReadOptions;
use pkm_sim::{Playback, check_limits};

use super::{CONFIGURATION, Stopped};
use crate::robot_file;

/// The example that runs where no file is given, with the files it names.
const SHIPPED: [(&str, &str); 3] = [
    ("daemon.toml", include_str!("../../shipped/daemon.toml")),
    ("controllers/computed_torque_200hz.toml", include_str!("../../shipped/controllers/computed_torque_200hz.toml")),
    ("daemon_motion.csv", include_str!("../../shipped/daemon_motion.csv")),
];

/// What one file says, and everything it names.
pub(crate) struct Setup {
    pub(crate) config: DaemonConfig,
    pub(crate) settings: Settings,
    pub(crate) robot: Description,
    /// Name and text of the daemon's own file.
    pub(crate) own: (String, String),
    /// The position loop's controller.
    pub(crate) hold: ControllerText,
    /// The one that runs, where it is another.
    pub(crate) run: Option<ControllerText>,
    pub(crate) motion: Option<Playback>,
    /// Where files are that the file names relatively; none for the shipped example.
    base: Option<PathBuf>,
}

/// A controller.toml.
pub(crate) struct ControllerText {
    name: String,
    pub(crate) text: String,
    pub(crate) law: String,
    pub(crate) rate_hz: f64,
}

impl ControllerText {
    /// A controller at rest.
    pub(crate) fn build(&self, robot: &Robot) -> Option<Box<dyn Running>> {
        controllers::parse(&self.text, &self.name, robot).ok()
    }
}

impl Setup {
    /// Reads the file at `path`, or the shipped example.
    ///
    /// # Errors
    /// One line that names file, line, key, value and limit.
    pub(crate) fn read(path: Option<&Path>) -> anyhow::Result<Self> {
        let own = match path {
            Some(path) => pkm_daemon::config::read(path)?,
            None => (SHIPPED[0].0.to_string(), SHIPPED[0].1.to_string()),
        };
        let config = DaemonConfig::parse(&own.1, &own.0)?;
        let base = path.map(|path| path.parent().unwrap_or(Path::new("")).to_path_buf());
        let robot_path = Self::robot_path(&config, base.as_deref());
        let robot = robot_file::read(&robot_path).map_err(|e| config.about("robot", &format!("{e:#}")))?;
        let hold = controller(&config, base.as_deref(), "controller", config.controller(), &robot.robot)?;
        let run =
            config.run_controller().map(|name| controller(&config, base.as_deref(), "run.controller", name, &robot.robot)).transpose()?;
        if let Some(run) = run.as_ref().filter(|run| (run.rate_hz - hold.rate_hz).abs() > 0.0) {
            let problem = format!("its rate is {} Hz (must be that of the position loop, {} Hz)", run.rate_hz, hold.rate_hz);
            bail!(config.about("run.controller", &problem));
        }
        let settings = config.settings(&robot.robot.model, hold.rate_hz)?;
        let motion = config.motion().map(|name| motion(&config, base.as_deref(), name, &robot)).transpose()?;
        Ok(Self { config, settings, robot, own, hold, run, motion, base })
    }

    /// A name of a shipped robot stays one; anything else is beside the file.
    fn robot_path(config: &DaemonConfig, base: Option<&Path>) -> PathBuf {
        let name = config.robot();
        let is_file = base.is_some_and(|base| base.join(name).is_file()) || name.contains(['/', '.']);
        if is_file { joined(base, name) } else { PathBuf::from(name) }
    }

    /// The private directory: the one the file names, else one of the user's own.
    pub(crate) fn directory(&self) -> PathBuf {
        directory(&self.config, self.base.as_deref())
    }

    /// Whether this process may be a side of this robot.
    ///
    /// # Errors
    /// It is not of the user or the group that the file names.
    pub(crate) fn admit(&self) -> Result<(), Stopped> {
        let refused = |(key, problem): (&str, String)| Stopped::new(CONFIGURATION, self.config.about(key, &problem));
        pkm_daemon::owners::check(self.config.owners()).map_err(refused)
    }

    /// The phase in which the robot runs.
    pub(crate) fn phase(&self) -> Phase {
        match self.run.as_ref().map(|run| run.law.as_str()) {
            Some("exercise") => Phase::Exercise,
            Some(law) if controllers::CONTACT.contains(&law) => Phase::Force,
            _ => Phase::Position,
        }
    }

    /// Whether the robot is simulated in this process.
    pub(crate) fn is_simulated(&self) -> bool {
        self.config.hal() == HalKind::Simulated
    }

    /// Further sensors of the robot: the six components of a wrench, or none.
    pub(crate) fn n_sensors(&self) -> usize {
        if self.settings.wrench.is_some() { 6 } else { 0 }
    }
}

/// The private directory of the daemon whose file is at `path` (the shipped example without one), from that file alone.
///
/// # Errors
/// The file cannot be read, or is no daemon's.
pub(crate) fn directory_of(path: Option<&Path>) -> anyhow::Result<PathBuf> {
    let (name, text) = match path {
        Some(path) => pkm_daemon::config::read(path)?,
        None => (SHIPPED[0].0.to_string(), SHIPPED[0].1.to_string()),
    };
    let config = DaemonConfig::parse(&text, &name)?;
    Ok(directory(&config, path.map(|path| path.parent().unwrap_or(Path::new("")))))
}

fn directory(config: &DaemonConfig, base: Option<&Path>) -> PathBuf {
    match config.directory() {
        Some(directory) => base.map_or_else(|| directory.clone(), |base| base.join(&directory)),
        None => match std::env::var_os("XDG_RUNTIME_DIR").filter(|dir| !dir.is_empty()) {
            Some(dir) => PathBuf::from(dir).join("pkm"),
            None => std::env::temp_dir().join(format!("pkm-{}", rustix::process::geteuid().as_raw())),
        },
    }
}

fn joined(base: Option<&Path>, name: &str) -> PathBuf {
    base.map_or_else(|| PathBuf::from(name), |base| base.join(name))
}

fn controller(config: &DaemonConfig, base: Option<&Path>, key: &str, name: &str, robot: &Robot) -> anyhow::Result<ControllerText> {
    let shipped = SHIPPED.iter().find(|(file, _)| base.is_none() && *file == name);
    let bad = |problem: String| config.about(key, &problem);
    let (name, text) = match shipped {
        Some((file, text)) => ((*file).to_string(), (*text).to_string()),
        None => controllers::read(&joined(base, name)).map_err(|e| bad(e.to_string()))?,
    };
    let built = controllers::parse(&text, &name, robot).map_err(|e| bad(e.to_string()))?;
    let about = built.about();
    ensure!(about.drives == Drives::Effort, bad(format!("law {:?} commands voltages (a robot takes efforts)", about.name)));
    Ok(ControllerText { law: about.name.clone(), rate_hz: about.rate_hz, name, text })
}

/// The motion of a recording, sample by sample, within the robot's limits.
fn motion(config: &DaemonConfig, base: Option<&Path>, name: &str, robot: &Description) -> anyhow::Result<Playback> {
    let path = joined(base, name);
    let read = || -> anyhow::Result<Playback> {
        let model = &robot.robot.model;
        let recording = match SHIPPED.iter().find(|(file, _)| base.is_none() && *file == name) {
            Some((_, text)) => shipped_recording(text)?,
            None => pkm_record::read(&path, &ReadOptions::default())?,
        };
        let mut columns = Vec::new();
        for &j in &model.actuators {
            let name = format!("q_ref.{}", model.joints[j].name);
            let column = recording.signal(&name).with_context(|| format!("{}: no column {name:?}", path.display()))?;
            if let Some(i) = column.iter().position(|x| !x.is_finite()) {
                bail!("{}: {name} is missing at t = {} s (a motion has no gaps)", path.display(), recording.time[i]);
            }
            columns.push(column.to_vec());
        }
        let motion = Playback::try_new(&recording.time, columns).with_context(|| path.display().to_string())?;
        check_limits(model, &motion, motion.duration_s()).with_context(|| path.display().to_string())?;
        Ok(motion)
    };
    read().map_err(|e| config.about("motion", &format!("{e:#}")).into())
}

/// The shipped motion, which is part of the program: through a file, as any other.
fn shipped_recording(text: &str) -> anyhow::Result<Recording> {
    let file = tempfile::Builder::new().suffix(".csv").tempfile()?;
    std::fs::write(file.path(), text)?;
    Ok(pkm_record::read(file.path(), &ReadOptions::default())?)
}
