//! What replays of a recording have in common: its rate, the conditions it states, its references, and values between its samples.

use pkm_dyn::effects::Robot;
use pkm_dyn::parameters::InertialParameters;
use pkm_ident::Recording;
use pkm_ident::filter::{LowPass, derivative};
use pkm_ident::grid::Grid;

use crate::error::SimError;
use crate::reference::Sample;
use crate::trajectory::Trajectory;

/// A recorded reference: positions and velocities are met at every sample, cubic between.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedReference {
    /// Since the first sample `[s]`.
    pub(crate) time: Vec<f64>,
    q: Vec<Vec<f64>>,
    v: Vec<Vec<f64>>,
}

impl RecordedReference {
    /// The reference in `recording`, `q_ref.<joint>` and `dq_ref.<joint>` of every drive of `robot`; velocities that are not recorded are
    /// central differences. Time begins at 0.
    ///
    /// # Errors
    /// A recording without references, with fewer than two samples, or with numbers that are not finite.
    pub fn try_new(robot: &Robot, recording: &Recording) -> Result<Self, SimError> {
        let n = recording.len();
        if n < 2 {
            return Err(SimError::Scenario { what: "samples of the recording", value: n as f64, limit: "must be at least 2" });
        }
        let first = recording.time[0];
        let time: Vec<f64> = recording.time.iter().map(|t| t - first).collect();
        let mut out = Self { q: Vec::new(), v: Vec::new(), time };
        for &j in &robot.model.actuators {
            let name = &robot.model.joints[j].name;
            let q = finite(recording, format!("q_ref.{name}"))?;
            let v = match recording.signal(&format!("dq_ref.{name}")) {
                Some(_) => finite(recording, format!("dq_ref.{name}"))?,
                None => slopes(&out.time, &q),
            };
            out.q.push(q);
            out.v.push(v);
        }
        Ok(out)
    }
}

impl RecordedReference {
    /// The motion itself as the reference, for recordings that hold none: `q.<joint>` of every drive, smoothed without delay at
    /// `cutoff_hz`, so that encoder noise is no velocity.
    ///
    /// # Errors
    /// As [`RecordedReference::try_new`].
    pub fn measured(robot: &Robot, recording: &Recording, cutoff_hz: f64) -> Result<Self, SimError> {
        let few = SimError::Scenario { what: "samples of the recording", value: recording.len() as f64, limit: "must be at least 3" };
        let Some(grid) = Grid::over(&recording.time).filter(|g| g.n >= 3) else { return Err(few) };
        let mut out = Self { q: Vec::new(), v: Vec::new(), time: (0..grid.n).map(|i| grid.dt * i as f64).collect() };
        for &j in &robot.model.actuators {
            let name = format!("q.{}", robot.model.joints[j].name);
            let q = recording.signal(&name).ok_or(SimError::NoSignal { signal: name })?;
            if !q.iter().any(|x| x.is_finite()) {
                return Err(SimError::Scenario {
                    what: "a number of the recording",
                    value: f64::NAN,
                    limit: "must be finite for a replay",
                });
            }
            let q = grid.resample(&recording.time, q);
            let q = if cutoff_hz > 0.0 { LowPass::new(cutoff_hz.min(0.4 / grid.dt), grid.dt).apply(&q) } else { q };
            out.v.push(derivative(&q, grid.dt));
            out.q.push(q);
        }
        Ok(out)
    }
}

impl Trajectory for RecordedReference {
    fn at(&self, t: f64, out: &mut Sample) {
        let last = self.time.len() - 1;
        let is_outside = t < 0.0 || t > self.time[last] + 1e-9;
        let t = t.clamp(0.0, self.time[last]);
        let i = self.time.partition_point(|&x| x <= t).clamp(1, last) - 1;
        let h = self.time[i + 1] - self.time[i];
        let s = (t - self.time[i]) / h;
        for x in [&mut out.q, &mut out.v, &mut out.a] {
            x.clear();
            x.resize(self.q.len(), 0.0);
        }
        for k in 0..self.q.len() {
            let (q0, q1, v0, v1) = (self.q[k][i], self.q[k][i + 1], h * self.v[k][i], h * self.v[k][i + 1]);
            // Hermite's cubic: q0 + v0·s + b·s² + c·s³.
            let (b, c) = (3.0 * (q1 - q0) - 2.0 * v0 - v1, 2.0 * (q0 - q1) + v0 + v1);
            out.q[k] = q0 + s * (v0 + s * (b + s * c));
            if !is_outside {
                out.v[k] = (v0 + s * (2.0 * b + s * 3.0 * c)) / h;
                out.a[k] = (2.0 * b + 6.0 * s * c) / (h * h);
            }
        }
    }
}

/// Mean rate of a recording to six digits `[Hz]`: time stamps of whole nanoseconds must not make 1000 Hz a little more. Replays run at it.
#[must_use]
pub fn rate_hz(recording: &Recording) -> f64 {
    let rate = (recording.len().saturating_sub(1)) as f64 / recording.duration();
    let unit = [1e-3, 1e-2, 1e-1].into_iter().find(|unit| rate < 1e6 * unit).unwrap_or(1.0);
    (rate / unit).round() * unit
}

/// The robot with the gravity and the load that the recording states.
pub(crate) fn under_stated_conditions(robot: &Robot, recording: &Recording) -> Result<Robot, SimError> {
    let mut out = robot.clone();
    if let Some(g) = recording.meta.gravity {
        out.model.gravity = g.into();
    }
    if let Some(load) = &recording.meta.load {
        let Some(link) = out.model.link_index(&load.link) else { return Err(SimError::NoLink { link: load.link.clone() }) };
        let body = InertialParameters::from_centre_of_mass(load.mass, load.xyz.into(), nalgebra::Matrix3::zeros());
        let sum = out.model.links[link].parameters.joined(&body);
        out.model.set_link_parameters(link, sum);
    }
    Ok(out)
}

/// A column of the recording, all of its numbers finite.
pub(crate) fn finite(recording: &Recording, name: String) -> Result<Vec<f64>, SimError> {
    let Some(column) = recording.signal(&name) else { return Err(SimError::NoSignal { signal: name }) };
    match column.iter().find(|x| !x.is_finite()) {
        Some(&value) => Err(SimError::Scenario { what: "a number of the recording", value, limit: "must be finite for a replay" }),
        None => Ok(column.to_vec()),
    }
}

/// Central differences.
fn slopes(time: &[f64], q: &[f64]) -> Vec<f64> {
    let last = q.len() - 1;
    let ends = |i: usize| (i.saturating_sub(1), (i + 1).min(last));
    (0..q.len()).map(ends).map(|(a, b)| (q[b] - q[a]) / (time[b] - time[a])).collect()
}

/// Linear between samples.
pub(crate) fn between(time: &[f64], column: &[f64], t: f64) -> f64 {
    let last = column.len().min(time.len()).saturating_sub(1);
    if last == 0 {
        return column.first().copied().unwrap_or(f64::NAN);
    }
    let i = time.partition_point(|&x| x <= t).clamp(1, last) - 1;
    let share = ((t - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
    column[i] + share * (column[i + 1] - column[i])
}
