//! Laws that follow a motion, as the [catalogue](crate::catalogue) has them.

use super::bounds::Bounds;
use super::erased::AnyLaw;
use super::observers::observer;
use super::section::{ANY, NOT_NEGATIVE, POSITIVE, Section, UP_TO_INFINITY};
use super::{FileError, Site};
use crate::adrc::{Adrc, AdrcConfig, Extended, Feedback};
use crate::catalogue::mass_at_assembly;
use crate::computed_torque::{ComputedTorque, ComputedTorqueConfig, FrictionVelocity};
use crate::computed_torque_dae::{ComputedTorqueDae, ComputedTorqueDaeConfig};
use crate::controller::ConfigError;
use crate::error_dynamics::ErrorGains;
use crate::linear_system;
use crate::observer::NonlinearEso;
use crate::pd_gravity::{PdGravity, PdGravityConfig};
use crate::pd_model::{PdModel, PdModelConfig};
use crate::pid::{AntiWindup, Pid, PidConfig};

/// Laws whose command is an effort, by name.
pub const LAWS: [&str; 7] = ["pd_gravity", "pd_model", "pid", "pid_clamping", "computed_torque", "adrc", "adrc_nonlinear"];

/// Gains of a law and the bandwidth that those left out come from.
struct Gains<const N: usize> {
    kp: [f64; N],
    ki: [f64; N],
    kd: [f64; N],
    bandwidth: Option<f64>,
}

/// What a gain is scaled with.
#[derive(Clone, Copy, PartialEq)]
enum Scale {
    /// The inertia at the assembly.
    Inertia,
    /// One: gains are those of an acceleration.
    One,
}

/// Whether a law integrates its error.
#[derive(Clone, Copy, PartialEq)]
enum Integral {
    Used,
    Unused,
}

fn gains<const N: usize>(s: &Section<'_>, site: &Site<'_>, scale: Scale, integral: Integral) -> Result<Gains<N>, FileError> {
    let bandwidth = s.maybe("bandwidth", POSITIVE)?;
    let kp = s.maybe_each("kp", NOT_NEGATIVE)?;
    let kd = s.maybe_each("kd", NOT_NEGATIVE)?;
    let ki = if integral == Integral::Used { s.maybe_each("ki", NOT_NEGATIVE)? } else { Some([0.0; N]) };
    if let (Some(kp), Some(ki), Some(kd)) = (kp, ki, kd) {
        return Ok(Gains { kp, ki, kd, bandwidth });
    }
    let stated = if integral == Integral::Used { "kp, ki and kd" } else { "kp and kd" };
    let w = bandwidth.ok_or_else(|| s.whole(&alloc::format!("gains are missing (state {stated}, or bandwidth)")))?;
    let mass = match scale {
        Scale::Inertia => mass_at_assembly::<N>(site.robot).map_err(|e| s.refusal(&e))?,
        Scale::One => [[1.0; N]; N],
    };
    let of = |gain: fn(f64, f64) -> f64| core::array::from_fn(|k| gain(mass[k][k], w));
    // Rounded as the catalogue's are.
    Ok(Gains {
        kp: kp.unwrap_or_else(|| of(|m, w| m * w * w)),
        ki: ki.unwrap_or_else(|| of(|m, w| m * w * w * w / 4.0)),
        kd: kd.unwrap_or_else(|| of(|m, w| m * 2.0 * w)),
        bandwidth,
    })
}

/// The tracking law `name` with the numbers of `s`, the whole file or its `[inner]`.
pub(super) fn law<const N: usize>(name: &str, s: &Section<'_>, site: &Site<'_>, bounds: &Bounds<N>) -> Result<AnyLaw<N>, FileError> {
    let tau_limit = bounds.config.tau_limit;
    let refused = |e: ConfigError| s.refusal(&e);
    let robot = || site.robot.clone();
    Ok(match name {
        "pd_gravity" => {
            let Gains { kp, kd, bandwidth, .. } = gains(s, site, Scale::Inertia, Integral::Unused)?;
            let usual = bandwidth.map_or(0.0, |w| 1.0 / (3.0 * w));
            let filter_s = s.maybe("filter_s", NOT_NEGATIVE)?.unwrap_or(usual);
            AnyLaw::new(PdGravity::try_new(PdGravityConfig { kp, kd, tau_limit, dt: site.dt(), filter_s }).map_err(refused)?)
        }
        "pd_model" => {
            let Gains { kp, kd, bandwidth, .. } = gains(s, site, Scale::Inertia, Integral::Unused)?;
            let observer = observer(s, site, "model_based", bandwidth)?;
            AnyLaw::new(PdModel::try_new(robot(), observer, PdModelConfig { kp, kd, tau_limit }).map_err(refused)?)
        }
        "pid" | "pid_clamping" => {
            let Gains { kp, ki, kd, bandwidth } = gains(s, site, Scale::Inertia, Integral::Used)?;
            let observer = observer(s, site, "filtered_derivative", bandwidth)?;
            let anti_windup = anti_windup(name, s, bandwidth)?;
            AnyLaw::new(Pid::try_new(observer, PidConfig { kp, ki, kd, tau_limit, anti_windup }).map_err(refused)?)
        }
        "computed_torque" => {
            let Gains { kp, kd, bandwidth, .. } = gains(s, site, Scale::One, Integral::Unused)?;
            let observer = observer(s, site, "commanded_acceleration", bandwidth)?;
            let (friction_velocity, creep) = friction(s)?;
            let misfit_limit = s.maybe("misfit_limit", UP_TO_INFINITY)?.unwrap_or(f64::INFINITY);
            let config = ComputedTorqueConfig { kp, kd, tau_limit, friction_velocity, creep, misfit_limit };
            AnyLaw::new(ComputedTorque::try_new(robot(), observer, config).map_err(refused)?)
        }
        "adrc" | "adrc_nonlinear" => adrc(name, s, site, tau_limit)?,
        _ => {
            let known = LAWS.iter().chain(&["computed_torque_dae"]).chain(&super::CONTACT).copied();
            let known: alloc::vec::Vec<&str> = known.collect();
            let _ = s.choice("law", &known)?;
            return Err(s.whole(&alloc::format!("law {name:?} cannot be used here (can: {})", LAWS.join(", "))));
        }
    })
}

fn anti_windup(name: &str, s: &Section<'_>, bandwidth: Option<f64>) -> Result<AntiWindup, FileError> {
    if name == "pid_clamping" {
        return Ok(AntiWindup::Clamping);
    }
    let own = s.maybe("anti_windup_s", POSITIVE)?;
    let time_s = own.or(bandwidth.map(|w| 1.0 / w));
    let time_s = time_s.ok_or_else(|| s.whole("anti_windup_s is missing (must be finite and > 0, or state bandwidth)"))?;
    Ok(AntiWindup::BackCalculation { time_s })
}

/// At which velocity friction is compensated, and below which speed dry friction fades.
fn friction(s: &Section<'_>) -> Result<(FrictionVelocity, f64), FileError> {
    let Some(friction) = s.section("friction")? else { return Ok((FrictionVelocity::Reference, 0.0)) };
    let velocity = match friction.choice("velocity", &["reference", "estimate"])?.as_deref() {
        Some("estimate") => FrictionVelocity::Estimate,
        _ => FrictionVelocity::Reference,
    };
    Ok((velocity, friction.maybe("creep", NOT_NEGATIVE)?.unwrap_or(0.0)))
}

fn adrc<const N: usize>(name: &str, s: &Section<'_>, site: &Site<'_>, limit: [f64; N]) -> Result<AnyLaw<N>, FileError> {
    let w = s.number("bandwidth", POSITIVE)?;
    let b = if s.has("b") {
        s.matrix("b")?
    } else {
        let mass = mass_at_assembly::<N>(site.robot).map_err(|e| s.refusal(&e))?;
        linear_system::inverse(&mass).ok_or_else(|| s.whole("the inertia at the assembly has no inverse: state b"))?
    };
    let reference_acceleration = s.maybe("reference_acceleration", UP_TO_INFINITY)?.unwrap_or(f64::INFINITY);
    let (extended, feedback) = if name == "adrc" {
        let fast = s.maybe("observer_bandwidth", POSITIVE)?.unwrap_or(3.0 * w);
        (Extended::Linear { bandwidth: fast }, Feedback::Linear { bandwidth: w })
    } else {
        let dt = site.dt();
        let delta = s.maybe("delta", POSITIVE)?.unwrap_or(dt);
        let usual = NonlinearEso::for_period(dt, delta);
        let beta = s.maybe_each("beta", POSITIVE)?.unwrap_or(usual.beta);
        let r = s.maybe("r", POSITIVE)?.unwrap_or(10.0 * w);
        let c = s.maybe("c", POSITIVE)?.unwrap_or(1.0);
        let h = s.maybe("h", POSITIVE)?.unwrap_or(10.0 * dt);
        (Extended::Nonlinear(NonlinearEso { beta, delta }), Feedback::TimeOptimal { r, c, h })
    };
    let config = AdrcConfig { b, extended, feedback, reference_acceleration, limit };
    Ok(AnyLaw::new(Adrc::try_new(config).map_err(|e| s.refusal(&e))?))
}

/// Computed torque with integrated voltages, and its effort per rate of the voltage.
pub(super) fn voltage<const N: usize>(s: &Section<'_>, site: &Site<'_>, bounds: &Bounds<N>) -> Result<(AnyLaw<N>, [f64; N]), FileError> {
    let bandwidth = s.maybe("bandwidth", POSITIVE)?;
    let poles = match s.maybe_each::<3>("poles", ANY)? {
        Some(poles) => poles,
        None => {
            let w = bandwidth.ok_or_else(|| s.whole("poles are missing (three numbers below 0, in 1/s, or state bandwidth)"))?;
            [-w, -1.2 * w, -1.4 * w]
        }
    };
    if poles.iter().any(|p| !(p.is_finite() && *p < 0.0)) {
        return Err(s.whole("poles: must be three finite numbers below 0, in 1/s"));
    }
    let b0 = s.each("b0", POSITIVE)?;
    let u_limit = bounds.u_limit.ok_or_else(|| s.whole("limits.u_limit is missing (must be finite and > 0, in V)"))?;
    let slowest = poles.iter().fold(f64::INFINITY, |least, p| least.min(-p));
    let observer = observer(s, site, "commanded_acceleration", bandwidth.or(Some(slowest)))?;
    let (_, creep) = friction(s)?;
    let config = ComputedTorqueDaeConfig { gains: [ErrorGains::placed_sampled(poles, site.dt()); N], b0, u_limit, creep };
    let law = ComputedTorqueDae::try_new(site.robot.clone(), observer, config).map_err(|e| s.refusal(&e))?;
    Ok((AnyLaw::new(law), b0))
}
