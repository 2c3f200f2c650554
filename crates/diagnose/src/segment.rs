//! The gate: recordings become uniform, smoothed, checked motions, or a one-line refusal.
//!
//! Velocities come from positions. A recorded `dq` is often a filtered register that lags by many milliseconds, and a lag of the
//! velocity looks like damping.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::{Applied, Law, Robot};
use pkm_dyn::model::{Model, SensorKind};
use pkm_dyn::{Data, math};
use pkm_ident::filter::{LowPass, advanced, derivative, lagged};
use pkm_ident::grid::Grid;
use pkm_ident::{Recording, spectrum};

use crate::channels::{self, Kind};
use crate::error::InputError;
use crate::settings::{FEWEST_HARMONICS, HARMONICS, LUMPED_HZ, MIN_SAMPLES};
use crate::shelf::Shelf;
use crate::verdict::Use;

/// One recording on a uniform grid. Outer index: actuated joint; inner: raw sample.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    pub(crate) name: String,
    pub(crate) samples: usize,
    pub(crate) duration: f64,
    pub(crate) used: Use,
    pub(crate) start: f64,
    pub(crate) dt: f64,
    /// Band in which efforts are compared `[Hz]`.
    pub(crate) band: f64,
    pub(crate) q: Vec<Vec<f64>>,
    pub(crate) v: Vec<Vec<f64>>,
    pub(crate) a: Vec<Vec<f64>>,
    pub(crate) tau: Vec<Vec<f64>>,
    /// Temperature above that of the first sample `[°C]`; empty where none is recorded.
    pub(crate) warmth: Vec<Vec<f64>>,
    /// Columns of the recording that no model uses, by name.
    pub(crate) extra: BTreeMap<String, Vec<f64>>,
    /// Raw samples that may be used: measured, not in a gap.
    pub(crate) valid: Vec<bool>,
    /// Gravity stated for this recording, if the base was tilted on purpose `[m/s²]`.
    pub(crate) gravity: Option<[f64; 3]>,
    /// Known load stated for this recording.
    pub(crate) load: Option<pkm_ident::KnownLoad>,
    /// Measured wrenches of the environment on the robot, in their sensors' frames.
    pub(crate) wrenches: Vec<Wrench>,
    /// Positions measured besides those of the drives: what, and the raw samples where this recording has it.
    pub(crate) channels: Vec<(Kind, Option<Vec<f64>>)>,
    /// Where the long series of a diagnosis wait.
    pub(crate) shelf: Shelf,
}

/// What a wrench sensor of the robot's files measured.
#[derive(Debug, Clone)]
pub(crate) struct Wrench {
    /// Index of the sensor.
    pub(crate) sensor: usize,
    /// Force `[N]`, then moment `[N·m]`: [component][raw sample].
    pub(crate) components: Vec<Vec<f64>>,
}

/// A signal on the grid, before any filter.
struct Raw {
    grid: Grid,
    q: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
    warmth: Vec<Vec<f64>>,
    valid: Vec<bool>,
    wrenches: Vec<Wrench>,
    channels: Vec<(Kind, Option<Vec<f64>>)>,
}

/// Every how many samples of period `dt` `[s]` one is taken for `rate` a second `[1/s]`, or more.
pub(crate) fn every(dt: f64, rate: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive rates")]
    let every = (1.0 / (dt * rate)).floor() as usize;
    every.max(1)
}

/// All recordings, checked, and the band `[Hz]`.
pub(crate) fn segments(robot: &Robot, recordings: &[(&Recording, Use)], band: Option<f64>) -> Result<(Vec<Segment>, f64), InputError> {
    if recordings.is_empty() {
        return Err(InputError::NoRecording);
    }
    if let Some(effect) = robot.left_aside(is_taken_into_account) {
        return Err(InputError::Effect { effect, robot: robot.model.name.clone() });
    }
    let hangs = |e: &&Applied| matches!(e.entry.law, Law::Structure) && robot.model.links[e.place].body.is_some();
    if let Some(e) = robot.effects.iter().find(hangs) {
        let effect = format!("effect {} at {:?}, a link that moves,", e.entry.name, e.place_name(&robot.model));
        return Err(InputError::Effect { effect, robot: robot.model.name.clone() });
    }
    let kinds = channels::kinds(robot, &recordings.iter().map(|(r, _)| *r).collect::<Vec<_>>());
    let raws = recordings.iter().map(|(r, _)| raw(robot, r, &kinds)).collect::<Result<Vec<_>, _>>()?;
    let slowest = raws.iter().map(|r| 1.0 / r.grid.dt).fold(f64::INFINITY, f64::min);
    let limit = 0.4 * slowest;
    let band = match band {
        Some(b) if b > 0.0 && b <= limit => b,
        Some(band) => return Err(InputError::Band { band, limit }),
        None => choose_band(&raws, recordings).min(0.5 * limit),
    };
    let shelf = Shelf::default();
    let out = raws.into_iter().zip(recordings).map(|(raw, (r, used))| segment(raw, r, *used, (band, &shelf))).collect();
    Ok((out, band))
}

/// Laws of the robot's files that a prediction of efforts has in it.
fn is_taken_into_account(law: &Law) -> bool {
    let is_an_effort = matches!(law, Law::JointEffort(_) | Law::PairEffort(_) | Law::Memory(_) | Law::Wrench(_));
    let is_in_the_chain = matches!(law, Law::EffortScale | Law::EffortLag | Law::EffortDelay | Law::PositionOffset);
    law.is_in_the_model()
        || is_an_effort
        || is_in_the_chain
        || matches!(law, Law::PositionPeriodic | Law::Drift | Law::Transmission(_) | Law::Structure)
        || matches!(law, Law::EffortLimit | Law::EffortDeadZone | Law::CommandShare | Law::Person)
}

/// Seven harmonics of the fastest motion, or five where they reach above what lumped models hold for: each joint's motion in the fitted recording
/// in which it is fastest, the median over joints.
fn choose_band(raws: &[Raw], recordings: &[(&Recording, Use)]) -> f64 {
    let fitted: Vec<&Raw> = raws.iter().zip(recordings).filter(|(_, (_, used))| *used != Use::Holdout).map(|(raw, _)| raw).collect();
    let joints = 0..fitted.first().map_or(0, |raw| raw.q.len());
    let fastest = |k: usize| fitted.iter().map(|raw| (speed(raw, k), raw)).max_by(|a, b| a.0.total_cmp(&b.0));
    let bandwidths = joints.filter_map(|k| fastest(k).map(|(_, raw)| spectrum::motion_bandwidth(&raw.q[k], raw.grid.dt)));
    let mut f: Vec<f64> = bandwidths.filter(|f| *f > 0.0).collect();
    f.sort_by(f64::total_cmp);
    // The lower median: a joint that hunts on its encoder's last bit looks fast and is not.
    f.get(f.len().saturating_sub(1) / 2).map_or(1.0, |f| (HARMONICS * f).min(LUMPED_HZ).max(FEWEST_HARMONICS * f))
}

/// Root mean square of a joint's velocity from sample to sample `[m/s | rad/s]`.
fn speed(raw: &Raw, joint: usize) -> f64 {
    let q = &raw.q[joint];
    let square: f64 = q.windows(2).map(|w| (w[1] - w[0]) * (w[1] - w[0])).sum();
    math::sqrt(square / q.len().max(1) as f64) / raw.grid.dt
}

fn raw(robot: &Robot, r: &Recording, kinds: &[Kind]) -> Result<Raw, InputError> {
    let model = &robot.model;
    for &j in &model.actuators {
        for kind in ["q", "tau"] {
            let column = format!("{kind}.{}", model.joints[j].name);
            let Some(signal) = r.signal(&column) else {
                return Err(InputError::MissingColumn { recording: r.name.clone(), column, robot: model.name.clone(), found: r.columns() });
            };
            let known = signal.iter().filter(|x| x.is_finite()).count();
            if 2 * known < signal.len() {
                return Err(InputError::EmptyColumn { recording: r.name.clone(), column, known, samples: r.len() });
            }
        }
    }
    let too_short = InputError::TooShort { recording: r.name.clone(), samples: r.len(), limit: MIN_SAMPLES };
    if r.len() < MIN_SAMPLES {
        return Err(too_short);
    }
    let grid = Grid::over(&r.time).filter(|g| g.n >= MIN_SAMPLES).ok_or(too_short)?;
    let mut out = Raw {
        valid: vec![true; grid.n],
        grid,
        q: Vec::new(),
        tau: Vec::new(),
        warmth: Vec::new(),
        wrenches: Vec::new(),
        channels: Vec::new(),
    };
    let is_shared = model.n_act() > Data::new(model).n_ind();
    for &j in &model.actuators {
        let name = &model.joints[j].name;
        let sensor = PositionSensor::of(robot, j);
        for (kind, target) in [("q", &mut out.q), ("tau", &mut out.tau)] {
            let Some(signal) = r.signal(&format!("{kind}.{name}")) else { continue };
            for (ok, missing) in out.valid.iter_mut().zip(out.grid.missing(&r.time, signal)) {
                *ok &= !missing;
            }
            target.push(out.grid.resample(&r.time, signal));
        }
        let temperature = r.signal(&format!("temp.{name}")).map(|t| out.grid.resample(&r.time, t)).unwrap_or_default();
        let first = temperature.first().copied().unwrap_or(0.0);
        out.warmth.push(temperature.iter().map(|t| t - first).collect());
        if let Some(q) = out.q.last_mut() {
            let dt = out.grid.dt;
            q.iter_mut().enumerate().for_each(|(i, q)| *q = sensor.true_position(*q, dt * i as f64));
        }
        if let Some(tau) = out.tau.last_mut() {
            let most = largest_effort(robot, j);
            tau.iter_mut().for_each(|t| *t = t.clamp(-most, most));
            if is_shared {
                *tau = acting(robot, j, tau, out.grid.dt);
            }
        }
    }
    wrenches(model, r, &mut out);
    other_positions(robot, r, kinds, &mut out);
    Ok(out)
}

/// Positions measured besides those that determine the motion.
fn other_positions(robot: &Robot, r: &Recording, kinds: &[Kind], out: &mut Raw) {
    let model = &robot.model;
    for &kind in kinds {
        let signal = channels::signal(model, r, kind);
        if let Some(signal) = signal {
            for (ok, missing) in out.valid.iter_mut().zip(out.grid.missing(&r.time, signal)) {
                *ok &= !missing;
            }
        }
        let mut series = signal.map(|signal| out.grid.resample(&r.time, signal));
        if let (Kind::Surplus(k), Some(series)) = (kind, &mut series) {
            let (sensor, dt) = (PositionSensor::of(robot, model.actuators[k]), out.grid.dt);
            series.iter_mut().enumerate().for_each(|(i, q)| *q = sensor.true_position(*q, dt * i as f64));
        }
        out.channels.push((kind, series));
    }
}

/// Measured wrenches; a component that is not recorded is taken for zero.
fn wrenches(model: &Model, r: &Recording, out: &mut Raw) {
    for (sensor, s) in model.sensors.iter().enumerate().filter(|(_, s)| s.kind == SensorKind::Wrench) {
        let columns = ["fx", "fy", "fz", "mx", "my", "mz"].map(|c| r.signal(&format!("wrench.{}.{c}", s.name)));
        if columns.iter().all(Option::is_none) {
            continue;
        }
        let mut components = Vec::new();
        for signal in columns {
            let Some(signal) = signal else {
                components.push(vec![0.0; out.valid.len()]);
                continue;
            };
            for (ok, missing) in out.valid.iter_mut().zip(out.grid.missing(&r.time, signal)) {
                *ok &= !missing;
            }
            components.push(out.grid.resample(&r.time, signal));
        }
        out.wrenches.push(Wrench { sensor, components });
    }
}

/// What the robot's files say of a drive's position sensor.
struct PositionSensor {
    offset: f64,
    drift: f64,
    /// Amplitude `[m | rad]`, order `[1/m | 1/rad]`, phase `[rad]`.
    periodic: Vec<[f64; 3]>,
}

impl PositionSensor {
    fn of(robot: &Robot, j: usize) -> Self {
        let waves = robot.effects.iter().filter(|e| e.is_at_joint(j) && matches!(e.entry.law, Law::PositionPeriodic));
        Self {
            offset: robot.chain(j, |law| matches!(law, Law::PositionOffset)).sum(),
            drift: robot.chain(j, |law| matches!(law, Law::Drift)).sum(),
            periodic: waves.map(|e| [e.values[0], e.values[1], e.values[2]]).collect(),
        }
    }

    /// The position at which it reads `reading` `[m | rad]`, `t` `[s]` after the recording began.
    fn true_position(&self, reading: f64, t: f64) -> f64 {
        let steady = reading + self.offset - self.drift * t;
        let wave = |q: f64| self.periodic.iter().map(|[a, order, phase]| a * math::sin(order * q + phase)).sum::<f64>();
        // A contraction by amplitude times order, far below one for anything that is still a position sensor.
        if self.periodic.is_empty() { steady } else { (0..20).fold(steady, |q, _| steady + wave(q)) }
    }
}

/// Largest recorded effort of a drive that can act as recorded: what is commanded beyond its limit is no effort of the robot.
fn largest_effort(robot: &Robot, j: usize) -> f64 {
    let limit = robot.chain(j, |law| matches!(law, Law::EffortLimit)).fold(f64::INFINITY, f64::min);
    let scale: f64 = robot.chain(j, |law| matches!(law, Law::EffortScale)).product();
    let zone: f64 = robot.chain(j, |law| matches!(law, Law::EffortDeadZone)).map(|w| 0.5 * w).sum();
    let recorded: f64 = robot.chain(j, |law| matches!(law, Law::CommandShare)).map(|share| 1.0 - share).product();
    recorded * (limit / scale + zone)
}

/// What acts at a drive while its recorded effort is `tau`, as far as the robot's files say what lies between. Surplus drives move the robot
/// by what acts at all of them: their chains cannot be put on the model drive by drive.
fn acting(robot: &Robot, j: usize, tau: &[f64], dt: f64) -> Vec<f64> {
    let sum = |is: fn(&Law) -> bool| -> f64 { robot.chain(j, is).sum() };
    let scale: f64 = robot.chain(j, |law| matches!(law, Law::EffortScale)).product();
    let recorded: f64 = robot.chain(j, |law| matches!(law, Law::CommandShare)).map(|share| 1.0 - share).product();
    let zone = 0.5 * sum(|law| matches!(law, Law::EffortDeadZone));
    let (lag, delay) = (sum(|law| matches!(law, Law::EffortLag)), sum(|law| matches!(law, Law::EffortDelay)));
    let mut out = if delay.abs() > 0.0 { advanced(tau, -delay, dt) } else { tau.to_vec() };
    if lag > 0.0 {
        out = lagged(&out, lag, dt);
    }
    let passes = |x: f64| math::sign(x) * (x.abs() - zone).max(0.0);
    out.iter_mut().for_each(|x| *x = scale * passes(*x / recorded));
    out
}

fn segment(raw: Raw, r: &Recording, used: Use, (band, shelf): (f64, &Shelf)) -> Segment {
    let dt = raw.grid.dt;
    // Wide enough to leave the band's derivatives alone, narrow enough to keep the direction of motion out of encoder noise.
    let smooth = LowPass::new(5.0 * band, dt);
    let q: Vec<Vec<f64>> = raw.q.iter().map(|q| smooth.apply(q)).collect();
    let v: Vec<Vec<f64>> = q.iter().map(|q| derivative(q, dt)).collect();
    let a = v.iter().map(|v| derivative(v, dt)).collect();
    Segment {
        name: r.name.clone(),
        samples: r.len(),
        duration: r.duration(),
        used,
        start: raw.grid.start,
        dt,
        band,
        q,
        v,
        a,
        tau: raw.tau,
        warmth: raw.warmth,
        extra: extra(&raw.grid, r),
        valid: raw.valid,
        wrenches: raw.wrenches,
        channels: raw.channels,
        gravity: r.meta.gravity,
        load: r.meta.load.clone(),
        shelf: shelf.clone(),
    }
}

/// Columns that say something else than the model's own variables do, on the grid. A column that repeats an effort by gain or sign is a
/// copy of it and would explain itself.
fn extra(grid: &Grid, r: &Recording) -> BTreeMap<String, Vec<f64>> {
    const KNOWN: [&str; 11] = ["q", "dq", "ddq", "tau", "q_ref", "dq_ref", "ddq_ref", "q_link", "temp", "wrench", "pose"];
    let is_known = |name: &str| KNOWN.contains(&name.split('.').next().unwrap_or(name));
    let efforts: Vec<&Vec<f64>> = r.signals.iter().filter(|(name, _)| name.starts_with("tau.")).map(|(_, x)| x).collect();
    let columns = r.signals.iter().filter(|(name, x)| !is_known(name) && x.iter().any(|x| x.is_finite()));
    columns.filter(|(_, x)| !efforts.iter().any(|tau| is_copy(x, tau))).map(|(name, x)| (name.clone(), grid.resample(&r.time, x))).collect()
}

/// Whether two columns are the same but for gain, sign, offset and a delay of a few samples.
fn is_copy(x: &[f64], tau: &[f64]) -> bool {
    const COPY: f64 = 0.98;
    (0..=LATE).any(|d| correlation(&x[d.min(x.len())..], tau).abs() > COPY || correlation(x, &tau[d.min(tau.len())..]).abs() > COPY)
}

/// Samples by which a copy may be late.
const LATE: usize = 20;

/// Correlation of two columns over the samples that both have.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let pairs = || a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite());
    let n = pairs().count().max(1) as f64;
    let (mean_a, mean_b) = (pairs().map(|(a, _)| a).sum::<f64>() / n, pairs().map(|(_, b)| b).sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs() {
        let (a, b) = (a - mean_a, b - mean_b);
        (ab, aa, bb) = (ab + a * b, aa + a * a, bb + b * b);
    }
    if aa > 0.0 && bb > 0.0 { ab / math::sqrt(aa * bb) } else { 0.0 }
}
