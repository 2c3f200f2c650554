//! The observation matrix: columns of all parameters along all recordings, filtered like the effort, thinned to what the band can hold.
//!
//! [`Observation::each`] walks over the recordings and hands out blocks of rows. What it has handed out it keeps for the next visit, up to
//! a size; longer recordings are walked again, so that memory depends on the number of columns and on the band, not on their length. Every zero-phase low-pass runs over columns and effort alike, so it
//! is no model error; what it does to noise is said in [`crate::filter`].
//!
//! While a joint stands its friction may be anything between its limits, so the equation of that drive does not hold there. Rows to fit on
//! have effort and columns of a drive set to zero at such samples, before the filter: nothing of a stick leaks into its neighbours. Rows
//! to judge on keep standstill.
//!
//! Of more drives than freedoms a row is what of the drives' efforts moves the robot ([`pkm_dyn::loops::drive_reduction`]): what they do to
//! each other obeys whoever commands it, and no equation of motion. The rows of such drives share noise; [`Observation::drives_per_freedom`]
//! is what that makes of intervals.

use std::sync::OnceLock;

use pkm_dyn::effects::{Law, Robot};

use crate::Recording;
use crate::columns::Columns;
use crate::error::InputError;
use crate::motion::{Motion, Use, motions};
use crate::preprocess::differentiation::Derivative;
use crate::walk::{Walk, model_for, thin};

/// Blocks in time that a recording is cut into: folds of cross-validation, and what is held out of a recording that serves both.
pub const BLOCKS: usize = 10;

/// What happens to samples at which a drive stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standstill {
    /// Taken out of the fit.
    Cut,
    /// Fitted like all others.
    Keep,
}

/// How recordings become rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowOptions {
    /// Zero-phase low-pass of effort and columns `[Hz]`; chosen from the motion when `None`.
    pub band_hz: Option<f64>,
    /// Samples at standstill.
    pub standstill: Standstill,
    /// Width over which the direction of motion passes through zero, as a share of the joint's top speed.
    pub softness: f64,
    /// How positions become velocities and accelerations.
    pub derivative: Derivative,
}

impl Default for RowOptions {
    fn default() -> Self {
        Self { band_hz: None, standstill: Standstill::Cut, softness: 0.003, derivative: Derivative::Filtered }
    }
}

/// Which rows to visit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rows {
    /// Those to fit on.
    Fitted,
    /// Those to judge on.
    HeldOut,
}

/// Consecutive rows of one recording, of all drives.
#[derive(Debug)]
pub struct Block<'b> {
    /// Index of the recording.
    pub recording: usize,
    /// Time of each row `[s]`.
    pub time: &'b [f64],
    /// Fold of each row.
    pub fold: &'b [usize],
    pub(crate) n_columns: usize,
    pub(crate) w: &'b [Vec<f64>],
    pub(crate) z: &'b [Vec<f64>],
    pub(crate) tau: &'b [Vec<f64>],
    pub(crate) active: &'b [Vec<bool>],
}

impl Block<'_> {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Regressor of `drive` in row `i`.
    #[must_use]
    pub fn row(&self, drive: usize, i: usize) -> &[f64] {
        &self.w[drive][i * self.n_columns..(i + 1) * self.n_columns]
    }

    /// What the columns must explain in row `i`: the measured effort less what is known of it `[N | N·m]`.
    #[must_use]
    pub fn target(&self, drive: usize, i: usize) -> f64 {
        self.z[drive][i]
    }

    /// Measured effort in row `i` `[N | N·m]`; of more drives than freedoms what of it moves the robot.
    #[must_use]
    pub fn effort(&self, drive: usize, i: usize) -> f64 {
        self.tau[drive][i]
    }

    /// Whether the drive's equation is to be used in row `i`: it moves during most of the filter's window.
    #[must_use]
    pub fn is_active(&self, drive: usize, i: usize) -> bool {
        self.active[drive][i]
    }
}

/// Numbers of all rows of a kind that are kept, at most: 128 MB.
const KEPT: usize = 1 << 24;

/// A block by itself.
#[derive(Debug, Clone)]
struct Kept {
    recording: usize,
    time: Vec<f64>,
    fold: Vec<usize>,
    w: Vec<Vec<f64>>,
    z: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
    active: Vec<Vec<bool>>,
}

impl Kept {
    fn of(b: &Block<'_>) -> Self {
        Self {
            recording: b.recording,
            time: b.time.to_vec(),
            fold: b.fold.to_vec(),
            w: b.w.to_vec(),
            z: b.z.to_vec(),
            tau: b.tau.to_vec(),
            active: b.active.to_vec(),
        }
    }

    fn block(&self, n_columns: usize) -> Block<'_> {
        let Self { recording, time, fold, w, z, tau, active } = self;
        Block { recording: *recording, time, fold, n_columns, w, z, tau, active }
    }
}

/// Recordings seen through a robot's equations.
#[derive(Debug, Clone)]
pub struct Observation<'r> {
    robot: &'r Robot,
    columns: Columns,
    motions: Vec<Motion>,
    band: f64,
    options: RowOptions,
    /// Rows to fit on and to judge on, once they have been visited.
    kept: [OnceLock<Vec<Kept>>; 2],
}

/// The first effect that the regression of efforts cannot have in it. Damping that follows temperature is a law of a joint's effort, but
/// no recording says here how warm the joint was.
fn left_aside(robot: &Robot) -> Option<String> {
    let is_known = |law: &Law| {
        law.is_in_the_model()
            || matches!(law, Law::JointEffort(_) | Law::EffortScale | Law::EffortLag | Law::EffortDelay | Law::PositionOffset)
    };
    let thermal = robot.effects.iter().find(|e| e.entry.name == "friction_thermal");
    let line = thermal.map(|e| format!("effect {} at {:?}", e.entry.name, e.place_name(&robot.model)));
    robot.left_aside(is_known).or(line)
}

impl<'r> Observation<'r> {
    /// Checks recordings against the robot and chooses the band.
    ///
    /// # Errors
    /// Recordings that do not fit the robot.
    pub fn try_new(robot: &'r Robot, recordings: &[(&Recording, Use)], options: RowOptions) -> Result<Self, InputError> {
        if let Some(effect) = left_aside(robot) {
            return Err(InputError::Effect { effect, robot: robot.model.name.clone() });
        }
        let (motions, band) = motions(robot, recordings, &options)?;
        for m in &motions {
            let _checked = model_for(&robot.model, m)?;
        }
        Ok(Self { robot, columns: Columns::new(robot), motions, band, options, kept: Default::default() })
    }

    /// The parameters.
    #[must_use]
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// The robot as its files have it.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        self.robot
    }

    /// The recordings as motions.
    #[must_use]
    pub fn motions(&self) -> &[Motion] {
        &self.motions
    }

    /// How recordings become rows.
    #[must_use]
    pub fn options(&self) -> &RowOptions {
        &self.options
    }

    /// The band `[Hz]`.
    #[must_use]
    pub fn band(&self) -> f64 {
        self.band
    }

    /// Drives per freedom: 1 unless there are more drives than freedoms.
    #[must_use]
    pub fn drives_per_freedom(&self) -> f64 {
        let model = &self.robot.model;
        model.n_act() as f64 / pkm_dyn::Data::new(model).n_ind().max(1) as f64
    }

    /// Number of folds that [`Block::fold`] counts.
    #[must_use]
    pub fn n_folds(&self) -> usize {
        self.motions.len() * BLOCKS
    }

    /// Time between rows of a recording `[s]`.
    #[must_use]
    pub fn row_period(&self, recording: usize) -> f64 {
        let m = &self.motions[recording];
        m.dt * thin(m.dt, self.band) as f64
    }

    /// Visits all rows of a kind, recording by recording, in the order of time; `progress` is told the share done.
    ///
    /// # Errors
    /// Loops that do not close along a recording.
    pub fn each(&self, rows: Rows, visit: &mut dyn FnMut(&Block<'_>), progress: &mut dyn FnMut(f64)) -> Result<(), InputError> {
        let store = &self.kept[usize::from(rows == Rows::HeldOut)];
        if let Some(blocks) = store.get() {
            blocks.iter().for_each(|b| visit(&b.block(self.columns.len())));
            progress(1.0);
            return Ok(());
        }
        let (mut kept, mut size) = (Vec::new(), 0);
        let mut visit = |block: &Block<'_>| {
            visit(block);
            size += block.len() * self.robot.model.n_act() * (self.columns.len() + 3);
            if size <= KEPT {
                kept.push(Kept::of(block));
            } else {
                kept = Vec::new();
            }
        };
        let wanted = |m: &&Motion| m.used == Use::Both || (m.used == Use::Fit) == (rows == Rows::Fitted);
        let total: usize = self.motions.iter().filter(wanted).map(Motion::len).sum();
        let mut done = 0;
        for (index, motion) in self.motions.iter().enumerate().filter(|(_, m)| wanted(m)) {
            let mut walk = Walk::try_new(self, index, motion, rows)?;
            walk.run(&mut visit, &mut |n| progress((done + n) as f64 / total as f64))?;
            done += motion.len();
        }
        if size <= KEPT {
            // Another thread that was faster kept the same.
            drop(store.set(kept));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::LowPass;
    use pkm_dyn::math;

    /// A hinge and a minute of it at 500 Hz: seven windows.
    fn recorded() -> (Robot, Recording) {
        let urdf = r#"<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
            <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
            <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
        let toml = "name = \"p\"\nurdf = \"p.urdf\"\n[[actuator]]\njoint = \"j\"\n";
        let robot = pkm_dyn::urdf::parse(toml, urdf, ["p.toml", "p.urdf"]).unwrap().robot;
        let mut out = Recording { name: "made".to_string(), ..Recording::default() };
        out.time = (0..30_000).map(|i| f64::from(i) * 2e-3).collect();
        let signal = |f: &dyn Fn(f64) -> f64| out.time.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let q = signal(&|t| math::sin(3.0 * t) + 0.3 * math::sin(7.0 * t));
        let tau = signal(&|t| math::sin(11.0 * t) + math::cos(40.0 * t) + 0.2 * math::sin(900.0 * t));
        out.signals.insert("q.j".to_string(), q);
        out.signals.insert("tau.j".to_string(), tau);
        (robot, out)
    }

    #[test]
    fn windows_leave_no_seams() {
        let (robot, recording) = recorded();
        let options = RowOptions { band_hz: Some(4.0), standstill: Standstill::Keep, ..RowOptions::default() };
        let observation = Observation::try_new(&robot, &[(&recording, Use::Fit)], options).unwrap();
        let whole = LowPass::new(4.0, 2e-3).apply(recording.signal("tau.j").unwrap());
        let offset = observation.columns().index("j.offset").unwrap();
        let (mut blocks, mut rows, mut last) = (0, 0, 0.0);
        let mut visit = |block: &Block<'_>| {
            blocks += 1;
            for i in 0..block.len() {
                let at = (block.time[i] / 2e-3).round();
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
                let want = whole[at as usize];
                assert!((block.target(0, i) - want).abs() < 1e-5, "{}: {} {want}", block.time[i], block.target(0, i));
                assert!((block.row(0, i)[offset] - 1.0).abs() < 1e-5 && block.is_active(0, i));
                assert!(block.time[i] > last);
                last = block.time[i];
                rows += 1;
            }
        };
        observation.each(Rows::Fitted, &mut visit, &mut |_| {}).unwrap();
        // Ten rows per second, less a period of the band at each end.
        assert!(blocks > 5 && (594..=600).contains(&rows), "{blocks} {rows}");
    }

    #[test]
    fn what_is_held_out_is_never_fitted() {
        let (robot, recording) = recorded();
        let observation = Observation::try_new(&robot, &[(&recording, Use::Both)], RowOptions::default()).unwrap();
        let times = |rows| {
            let mut out = Vec::new();
            observation.each(rows, &mut |block| out.extend_from_slice(block.time), &mut |_| {}).unwrap();
            out
        };
        let (fitted, held_out) = (times(Rows::Fitted), times(Rows::HeldOut));
        assert!(fitted.len() > 100 && held_out.len() > 100);
        assert!(fitted.iter().all(|t| held_out.iter().all(|h| (t - h).abs() > 1e-3)));
    }
}
