//! Replay of a recording in simulation: what the controller of [`crate::run`] would have done along the same reference with a given robot,
//! next to what was measured.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;

use crate::error::SimError;
use crate::reference::Sample;
use crate::scenario::{PlantKind, Scenario, Setup, run_with};
use crate::sensors::rms;
use crate::trajectory::Trajectory;

/// Measured against simulated, joint by joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Twin {
    /// One entry per drive, in their order.
    pub joints: Vec<TwinJoint>,
    /// Length of the comparison `[s]`.
    pub duration_s: f64,
    /// What the simulated run recorded.
    pub simulated: Recording,
}

/// How far a simulated drive is from the measured one.
#[derive(Debug, Clone, PartialEq)]
pub struct TwinJoint {
    /// The joint.
    pub joint: String,
    /// Measured less simulated position `[m | rad]`.
    pub position: Apart,
    /// Measured less simulated effort `[N | N·m]`; none where the recording has no effort.
    pub effort: Option<Apart>,
    /// Work of the drive on its joint, measured and simulated `[J]`.
    pub work: Option<[f64; 2]>,
}

/// Size of a difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// Root mean square of the difference.
    pub rms: f64,
    /// Its largest size.
    pub peak: f64,
    /// Root mean square of the measured signal about its mean: what the difference is to be compared with.
    pub measured_rms: f64,
}

/// A recorded reference: positions and velocities are met at every sample, cubic between.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedReference {
    time: Vec<f64>,
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

/// Moves `truth` along the reference in `recording` under the controller of [`crate::run`], which knows `nominal`, without any noise, and
/// compares. Measured positions are the encoders', so effects on the encoders of `truth` are in both.
///
/// # Errors
/// A recording without reference or positions; everything a run can fail with.
pub fn twin(robots: [&Robot; 2], recording: &Recording, plant: PlantKind) -> Result<Twin, SimError> {
    twin_with(Setup::new(robots), recording, plant)
}

/// As [`twin`] under any controller.
///
/// # Errors
/// As [`twin`], and what [`run_with`] adds.
pub fn twin_with(setup: Setup<'_>, recording: &Recording, plant: PlantKind) -> Result<Twin, SimError> {
    let nominal = setup.robots[1];
    let reference = RecordedReference::try_new(nominal, recording)?;
    let duration_s = recording.duration();
    let scenario = Scenario {
        duration_s,
        rate_hz: rate_hz(recording),
        encoder_resolution: 0.0,
        encoder_noise: 0.0,
        effort_noise: 0.0,
        plant,
        ..Scenario::default()
    };
    let simulated = run_with(setup, &scenario, &reference, &mut |_| {})?;
    let mut joints = Vec::new();
    for &j in &nominal.model.actuators {
        let name = &nominal.model.joints[j].name;
        let q = finite(recording, format!("q.{name}"))?;
        let at_samples = |signal: &str| -> Vec<f64> {
            let column = simulated.signal(signal).unwrap_or_default();
            reference.time.iter().map(|&t| between(&simulated.time, column, t)).collect()
        };
        let q_sim = at_samples(&format!("q.{name}"));
        let tau = recording.signal(&format!("tau.{name}")).is_some().then(|| finite(recording, format!("tau.{name}"))).transpose()?;
        let tau_sim = at_samples(&format!("tau.{name}"));
        joints.push(TwinJoint {
            joint: name.clone(),
            position: apart(&q, &q_sim),
            effort: tau.as_ref().map(|tau| apart(tau, &tau_sim)),
            work: tau.as_ref().map(|tau| [work(tau, &q), work(&tau_sim, &q_sim)]),
        });
    }
    Ok(Twin { joints, duration_s, simulated })
}

/// Mean rate to six digits `[Hz]`: time stamps of whole nanoseconds must not make 1000 Hz a little more.
fn rate_hz(recording: &Recording) -> f64 {
    let rate = (recording.len() - 1) as f64 / recording.duration();
    let unit = [1e-3, 1e-2, 1e-1].into_iter().find(|unit| rate < 1e6 * unit).unwrap_or(1.0);
    (rate / unit).round() * unit
}

fn finite(recording: &Recording, name: String) -> Result<Vec<f64>, SimError> {
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
fn between(time: &[f64], column: &[f64], t: f64) -> f64 {
    let last = column.len().min(time.len()).saturating_sub(1);
    if last == 0 {
        return column.first().copied().unwrap_or(f64::NAN);
    }
    let i = time.partition_point(|&x| x <= t).clamp(1, last) - 1;
    let share = ((t - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
    column[i] + share * (column[i + 1] - column[i])
}

fn apart(measured: &[f64], simulated: &[f64]) -> Apart {
    let difference = || measured.iter().zip(simulated).map(|(m, s)| m - s);
    let mean = measured.iter().sum::<f64>() / measured.len().max(1) as f64;
    Apart {
        rms: rms(difference()),
        peak: difference().fold(0.0, |top, x| top.max(x.abs())),
        measured_rms: rms(measured.iter().map(|m| m - mean)),
    }
}

/// Work of an effort along its positions, by the trapezoidal rule `[J]`.
fn work(tau: &[f64], q: &[f64]) -> f64 {
    tau.windows(2).zip(q.windows(2)).map(|(t, q)| 0.5 * (t[0] + t[1]) * (q[1] - q[0])).sum()
}
