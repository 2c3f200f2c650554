//! The proof in motion: recordings replayed in closed loop by the robot as given and by the refined one.
//!
//! A regression may fit efforts and still be no robot. Here both robots are simulated under the same controller along what was recorded,
//! and what their drives do is held against what was measured. Who simulates is the caller's business: this crate knows no simulator.

use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_ident::filter::LowPass;
use pkm_ident::grid::Grid;
use pkm_ident::size::{rms, work};

use crate::evidence::{Diagnosis, ReplaySeries};
use crate::verdict::{Replay, Use};

/// A simulator with a controller, as a diagnosis uses it.
pub trait Twin {
    /// What moves the simulated robot and along what, for the report.
    fn about(&self, nominal: &Robot, recording: &Recording) -> String;

    /// Moves the first robot as the recording was moved, under a controller that knows the second, without noise; the comparison is of
    /// what lies below `band_hz`.
    ///
    /// # Errors
    /// Why this recording cannot be replayed, in one line.
    fn replay(&self, robots: [&Robot; 2], recording: &Recording, band_hz: f64) -> Result<Vec<Simulation>, String>;
}

/// What one drive of the simulated robot did, at the recording's samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// The joint.
    pub joint: String,
    /// Position `[m | rad]`.
    pub q: Vec<f64>,
    /// Effort `[N | N·m]`.
    pub tau: Vec<f64>,
}

/// Samples of a curve that are kept: more than a page has pixels.
const CURVE: usize = 1500;

/// Replays the held-out recordings, or the fitted ones where no other was given, and adds what came out to `diagnosis`, efforts after the
/// verdict's low-pass. A recording that cannot be replayed becomes a note. `progress` is told the share done, 0 to 1.
pub fn replay(
    diagnosis: &mut Diagnosis,
    description: &Description,
    recordings: &[Recording],
    twin: &dyn Twin,
    progress: &mut dyn FnMut(f64),
) {
    let Some(refined) = &diagnosis.refined else { return };
    let robots = [description.robot.clone(), Robot::new(refined.model.clone(), refined.effects.clone())];
    let band = diagnosis.verdict.heldout.band_hz;
    let judged = |r: &&Recording| {
        let is_used = |u: &Use| diagnosis.verdict.recordings.iter().any(|v| v.path == r.name && v.used == *u);
        is_used(&Use::Holdout) || is_used(&Use::Both)
    };
    let chosen: Vec<&Recording> = recordings.iter().filter(judged).collect();
    let n = (2 * chosen.len()).max(1) as f64;
    for (i, r) in chosen.into_iter().enumerate() {
        let mut both = Vec::with_capacity(2);
        for (k, robot) in robots.iter().enumerate() {
            match twin.replay([robot, &description.robot], r, band) {
                Ok(joints) => both.push(joints),
                Err(why) => {
                    let which = ["as given", "refined"][k];
                    diagnosis.verdict.notes.push(format!("{}: the robot {which} could not be replayed: {why}", r.name));
                    break;
                }
            }
            progress((2 * i + k + 1) as f64 / n);
        }
        let [given, refined] = both.as_slice() else { continue };
        let how = twin.about(&description.robot, r);
        for (g, f) in given.iter().zip(refined) {
            let Some(pair) = Pair::new(r, g, f, band) else { continue };
            diagnosis.verdict.replay.push(pair.compared(&how));
            diagnosis.evidence.replay.push(pair.series());
        }
    }
}

/// One drive: measured, as given, refined, on one grid and after one low-pass.
struct Pair<'r> {
    recording: &'r str,
    joint: &'r str,
    time: Vec<f64>,
    q: [Vec<f64>; 3],
    tau: [Vec<f64>; 3],
}

impl<'r> Pair<'r> {
    /// `None` where the recording lacks the drive's columns.
    fn new(r: &'r Recording, given: &'r Simulation, refined: &Simulation, band: f64) -> Option<Self> {
        let grid = Grid::over(&r.time)?;
        let filter = LowPass::new(band, grid.dt);
        // As in every error of the verdict, one period of the band at both ends is left out: the filter has no past there, and the
        // simulation begins at rest.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive time over a positive period")]
        let edge = ((1.0 / (band * grid.dt)).ceil() as usize).min(grid.n / 2);
        let inner = edge..grid.n - edge;
        let smooth = |x: &[f64]| filter.apply(&grid.resample(&r.time, x))[inner.clone()].to_vec();
        let measured = |kind: &str| r.signal(&format!("{kind}.{}", given.joint));
        let three = |kind: &str, g: &[f64], f: &[f64]| measured(kind).map(|m| [m, g, f].map(smooth));
        Some(Self {
            recording: &r.name,
            joint: &given.joint,
            time: inner.clone().map(|i| grid.time(i)).collect(),
            q: three("q", &given.q, &refined.q)?,
            tau: three("tau", &given.tau, &refined.tau)?,
        })
    }

    fn compared(&self, how: &str) -> Replay {
        let [work_measured, work_before, work_after] = [0, 1, 2].map(|k| work(&self.tau[k], &self.q[k]));
        let mean = self.tau[0].iter().sum::<f64>() / self.tau[0].len().max(1) as f64;
        Replay {
            recording: self.recording.to_string(),
            joint: self.joint.to_string(),
            how: how.to_string(),
            rms_tau: rms(self.tau[0].iter().map(|x| x - mean)),
            effort_before: apart(&self.tau[0], &self.tau[1]),
            effort_after: apart(&self.tau[0], &self.tau[2]),
            position_before: apart(&self.q[0], &self.q[1]),
            position_after: apart(&self.q[0], &self.q[2]),
            work_measured,
            work_before,
            work_after,
        }
    }

    fn series(&self) -> ReplaySeries {
        let step = self.time.len().div_ceil(CURVE).max(1);
        let thin = |x: &[f64]| x.iter().step_by(step).copied().collect();
        ReplaySeries {
            recording: self.recording.to_string(),
            joint: self.joint.to_string(),
            time: thin(&self.time),
            measured: thin(&self.tau[0]),
            given: thin(&self.tau[1]),
            refined: thin(&self.tau[2]),
        }
    }
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    rms(a.iter().zip(b).map(|(a, b)| a - b))
}
