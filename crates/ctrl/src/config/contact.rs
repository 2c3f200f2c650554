//! Laws of contact: forces that are wanted, and motion that yields, in the coordinates of `[task]`.

use alloc::format;
use alloc::vec::Vec;

use super::bounds::Bounds;
use super::erased::{AnyLaw, AnyTask};
use super::section::{Allowed, FINITE, NOT_NEGATIVE, POSITIVE, Section, UP_TO_INFINITY};
use super::{FileError, Site, exercises, tasks, tracking};
use crate::controller::ConfigError;
use crate::exercise::{Exercise, ExerciseConfig};
use crate::force::gains::{Decoupling, Forward};
use crate::force::{
    ActuatorForce, ActuatorForceConfig, Admittance, AdmittanceConfig, ExplicitForce, ExplicitForceConfig, ForceLaw, ForcePidConfig,
    GainCurve, Hybrid, HybridConfig, Impedance, ImpedanceConfig,
};

/// Laws of contact of `N` drives, whatever the number of coordinates.
pub(super) trait Dispatch<const N: usize> {
    fn law(name: &str, root: &Section<'_>, site: &Site<'_>, bounds: &Bounds<N>) -> Result<AnyLaw<N>, FileError>;
}

macro_rules! dispatch {
    ($($n:literal: $($m:literal)*;)*) => {$(
        impl Dispatch<$n> for () {
            fn law(name: &str, root: &Section<'_>, site: &Site<'_>, bounds: &Bounds<$n>) -> Result<AnyLaw<$n>, FileError> {
                if name == "explicit_force" {
                    return explicit(root, site, bounds);
                }
                if tasks::is_joint(root)? {
                    return law::<$n, $n>(name, root, site, bounds, tasks::joint());
                }
                match tasks::coordinates(root, $n)? {
                    $($m => law::<$n, $m>(name, root, site, bounds, tasks::task(root, site)?),)*
                    m => {
                        let known = [$(stringify!($m)),*].join(" or ");
                        Err(root.whole(&format!("task.components has {m} names (must be {known} for {} drives)", $n)))
                    }
                }
            }
        }
    )*};
}

// As many coordinates as drives, or one less: robots with one surplus drive. A frame has six.
dispatch! {
    1: 1;
    2: 1 2;
    3: 2 3;
    4: 3 4;
    5: 4 5;
    6: 5 6;
    7: 6;
    8: 6;
}

/// `[force]`: the loop around a force.
fn force_pid<const M: usize>(root: &Section<'_>, site: &Site<'_>) -> Result<ForcePidConfig<M>, FileError> {
    let s = root.must("force")?;
    let gain = |key| Ok(s.maybe_each(key, NOT_NEGATIVE)?.unwrap_or([0.0; M]));
    let limit = |key| Ok(s.maybe_each(key, UP_TO_INFINITY)?.unwrap_or([f64::INFINITY; M]));
    Ok(ForcePidConfig {
        kp: gain("kp")?,
        ki: gain("ki")?,
        kd: gain("kd")?,
        output_limit: limit("output_limit")?.map(|x: f64| x.min(f64::MAX)),
        rate_limit: limit("rate_limit")?,
        filter_s: s.maybe("filter_s", NOT_NEGATIVE)?.unwrap_or(0.0),
        dt: site.dt(),
    })
}

fn explicit<const N: usize>(root: &Section<'_>, site: &Site<'_>, bounds: &Bounds<N>) -> Result<AnyLaw<N>, FileError> {
    let config = ExplicitForceConfig { pid: force_pid(root, site)?, tau_limit: bounds.config.tau_limit };
    Ok(AnyLaw::new(ExplicitForce::try_new(config).map_err(|e| root.refusal(&e))?))
}

/// The position loop that a law of contact moves.
fn inner<const N: usize>(root: &Section<'_>, site: &Site<'_>, bounds: &Bounds<N>) -> Result<AnyLaw<N>, FileError> {
    let s = root.must("inner")?;
    let name = s.text("law")?;
    tracking::law(&name, &s, site, bounds)
}

fn law<const N: usize, const M: usize>(
    name: &str,
    root: &Section<'_>,
    site: &Site<'_>,
    bounds: &Bounds<N>,
    map: AnyTask<N, M>,
) -> Result<AnyLaw<N>, FileError> {
    let refused = |e: ConfigError| root.refusal(&e);
    let (tau_limit, dt) = (bounds.config.tau_limit, site.dt());
    Ok(match name {
        "impedance" => {
            let config = ImpedanceConfig {
                stiffness: root.each("stiffness", NOT_NEGATIVE)?,
                damping: root.each("damping", NOT_NEGATIVE)?,
                force_limit: root.maybe_each("force_limit", POSITIVE)?.unwrap_or([f64::MAX; M]),
                tau_limit,
                filter_s: root.maybe("filter_s", NOT_NEGATIVE)?.unwrap_or(0.0),
                dt,
            };
            AnyLaw::new(Impedance::try_new(map, config).map_err(refused)?)
        }
        "admittance" => {
            let config = AdmittanceConfig {
                mass: root.each("mass", POSITIVE)?,
                damping: root.each("damping", NOT_NEGATIVE)?,
                stiffness: root.each("stiffness", NOT_NEGATIVE)?,
                travel: root.each("travel", POSITIVE)?,
                speed: root.each("speed", POSITIVE)?,
                dt,
            };
            AnyLaw::new(Admittance::try_new(map, inner(root, site, bounds)?, config).map_err(refused)?)
        }
        "hybrid" => {
            let config = HybridConfig {
                selection: root.each("selection", (|x| (0.0..=1.0).contains(&x), "must be 0 to 1"))?,
                pid: force_pid(root, site)?,
                travel: root.each("travel", POSITIVE)?,
                margin: root.maybe("margin", NOT_NEGATIVE)?.unwrap_or(0.0),
            };
            AnyLaw::new(Hybrid::try_new(map, inner(root, site, bounds)?, config).map_err(refused)?)
        }
        "exercise" => {
            let config = ExerciseConfig {
                script: exercises::script(root)?,
                pid: force_pid(root, site)?,
                lower: root.each("lower", FINITE)?,
                upper: root.each("upper", FINITE)?,
            };
            AnyLaw::new(Exercise::try_new(map, inner(root, site, bounds)?, config).map_err(refused)?)
        }
        _ => AnyLaw::new(ActuatorForce::try_new(map, actuator_force(root, site, bounds)?).map_err(refused)?),
    })
}

fn actuator_force<const N: usize, const M: usize>(
    root: &Section<'_>,
    site: &Site<'_>,
    bounds: &Bounds<N>,
) -> Result<ActuatorForceConfig<N, M>, FileError> {
    let share: Allowed = (|x| (0.0..1.0).contains(&x), "must be >= 0 and < 1");
    let law = if root.has("share") {
        let forward = root.choice("forward", &["moving", "holding"])?;
        ForceLaw::Decoupling(Decoupling {
            share: root.number("share", share)?,
            power: root.maybe("power", (|x| (0.0..=1.0).contains(&x), "must be 0 to 1"))?.unwrap_or(1.0),
            null_share: root.maybe("null_share", share)?.unwrap_or(0.0),
            apparent_mass: root.number("apparent_mass", POSITIVE)?,
            forward: if forward.as_deref() == Some("holding") { Forward::Holding } else { Forward::Moving },
        })
    } else {
        ForceLaw::Directional { curves: curves(root)?, null: root.maybe("null_gain", NOT_NEGATIVE)?.unwrap_or(0.0) }
    };
    Ok(ActuatorForceConfig {
        law,
        inertia: root.matrix("inertia")?,
        derivative: root.maybe("derivative", NOT_NEGATIVE)?.unwrap_or(0.0),
        tau_limit: bounds.config.tau_limit,
        dt: site.dt(),
    })
}

/// Gains of the directions: a number for all or one each, or `[[curve]]` with points.
fn curves<const M: usize>(root: &Section<'_>) -> Result<[GainCurve; M], FileError> {
    if !root.has("curve") {
        return Ok(root.each("gain", NOT_NEGATIVE)?.map(GainCurve::constant));
    }
    let mut all = Vec::new();
    for s in root.sections("curve")? {
        let points = s.rows::<2>("points")?;
        all.push(GainCurve::try_new(&points).map_err(|e| s.refusal(&e))?);
    }
    let n = all.len();
    all.try_into().map_err(|_| root.whole(&format!("curve is given {n} times (must be {M}: one per direction of the task)")))
}
