//! Replay of a recording in simulation: what the controller of [`crate::run`] would have done along the same reference with a given robot,
//! next to what was measured.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_ident::size::{rms, work};

use crate::error::SimError;
use crate::replay::{RecordedReference, between, finite, rate_hz, under_stated_conditions};
use crate::scenario::{PlantKind, Scenario, Setup, run_with};

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

/// What the simulated robot is made to follow.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Follow {
    /// The recorded reference.
    #[default]
    Reference,
    /// The measured motion, for recordings without reference, smoothed at a frequency `[Hz]` (zero: not at all): efforts are those of that
    /// motion, and positions differ by the tracking error of the simulated run alone.
    Measured(f64),
}

/// Moves `truth` along the reference in `recording` under the controller of [`crate::run`], which knows `nominal`, without any noise, and
/// compares. Gravity and load that the recording states hold for both. Measured positions are the encoders', so effects on the encoders of `truth` are in both.
///
/// # Errors
/// A recording without reference or positions, or with a load on a link that is none; everything a run can fail with.
pub fn twin(robots: [&Robot; 2], recording: &Recording, plant: PlantKind) -> Result<Twin, SimError> {
    twin_with(Setup::new(robots), recording, plant)
}

/// As [`twin`] under any controller.
///
/// # Errors
/// As [`twin`], and what [`run_with`] adds.
pub fn twin_with(setup: Setup<'_>, recording: &Recording, plant: PlantKind) -> Result<Twin, SimError> {
    twin_along(setup, recording, plant, Follow::Reference)
}

/// As [`twin_with`] along what `follow` says.
///
/// # Errors
/// As [`twin_with`].
pub fn twin_along(setup: Setup<'_>, recording: &Recording, plant: PlantKind, follow: Follow) -> Result<Twin, SimError> {
    let [truth, nominal] = setup.robots;
    let reference = match follow {
        Follow::Reference => RecordedReference::try_new(nominal, recording)?,
        Follow::Measured(cutoff_hz) => RecordedReference::measured(nominal, recording, cutoff_hz)?,
    };
    let (truth, nominal) = (under_stated_conditions(truth, recording)?, under_stated_conditions(nominal, recording)?);
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
    let setup = Setup { robots: [&truth, &nominal], ..setup };
    let simulated = run_with(setup, &scenario, &reference, &mut |_| {})?;
    let first = recording.time.first().copied().unwrap_or(0.0);
    // A reference must be whole; of a measured motion samples may be missing, and are left out of the comparison.
    let column = |signal: String| match follow {
        Follow::Reference => finite(recording, signal),
        Follow::Measured(_) => recording.signal(&signal).map(<[f64]>::to_vec).ok_or(SimError::NoSignal { signal }),
    };
    let mut joints = Vec::new();
    for &j in &nominal.model.actuators {
        let name = &nominal.model.joints[j].name;
        let q = column(format!("q.{name}"))?;
        let at_samples = |signal: &str| -> Vec<f64> {
            let column = simulated.signal(signal).unwrap_or_default();
            recording.time.iter().map(|&t| between(&simulated.time, column, t - first)).collect()
        };
        let q_sim = at_samples(&format!("q.{name}"));
        let tau = recording.signal(&format!("tau.{name}")).is_some().then(|| column(format!("tau.{name}"))).transpose()?;
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

impl Twin {
    /// A signal of the simulated run at times since its beginning, linear between its samples; none where there is no such signal.
    #[must_use]
    pub fn at(&self, signal: &str, times: &[f64]) -> Option<Vec<f64>> {
        let column = self.simulated.signal(signal)?;
        Some(times.iter().map(|&t| between(&self.simulated.time, column, t)).collect())
    }
}

fn apart(measured: &[f64], simulated: &[f64]) -> Apart {
    let difference = || measured.iter().zip(simulated).map(|(m, s)| m - s).filter(|x| x.is_finite());
    let known = || measured.iter().copied().filter(|x| x.is_finite());
    let mean = known().sum::<f64>() / known().count().max(1) as f64;
    Apart { rms: rms(difference()), peak: difference().fold(0.0, |top, x| top.max(x.abs())), measured_rms: rms(known().map(|m| m - mean)) }
}
