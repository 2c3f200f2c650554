//! `[observer]`: where velocities come from.

use super::erased::AnyObserver;
use super::section::{NOT_NEGATIVE, POSITIVE, Section};
use super::{FileError, Site};
use crate::observer::{
    AlphaBeta, CommandedAcceleration, CommandedVelocity, Discretisation, ExtendedState, FilteredDerivative, FirstDifference, Kalman,
    ModelBased, SuperTwisting,
};

/// Names of observers.
const KINDS: [&str; 9] = [
    "first_difference",
    "filtered_derivative",
    "alpha_beta",
    "kalman",
    "super_twisting",
    "commanded_acceleration",
    "commanded_velocity",
    "model_based",
    "extended_state",
];

/// The observer of a law: the file's, else `usual` at three times the law's bandwidth.
pub(super) fn observer<const N: usize>(
    law: &Section<'_>,
    site: &Site<'_>,
    usual: &'static str,
    bandwidth: Option<f64>,
) -> Result<AnyObserver<N>, FileError> {
    let stated = law.section("observer")?;
    let kind = match &stated {
        Some(s) => s.choice("kind", &KINDS)?.ok_or_else(|| s.whole(&alloc::format!("kind is missing (one of: {})", KINDS.join(", "))))?,
        None => usual.into(),
    };
    let fast = bandwidth.map(|w| [3.0 * w; N]);
    let missing = |what: &str| law.whole(&alloc::format!("observer: {what} is missing (state it, or bandwidth for the whole)"));
    let rate = |s: Option<&Section<'_>>| -> Result<[f64; N], FileError> {
        let own = s.map(|s| s.maybe_each("bandwidth", POSITIVE)).transpose()?.flatten();
        own.or(fast).ok_or_else(|| missing("bandwidth"))
    };
    let discretisation = |s: Option<&Section<'_>>| -> Result<Discretisation, FileError> {
        let own = s.map(|s| s.choice("discretisation", &["zero_order_hold", "euler"])).transpose()?.flatten();
        Ok(if own.as_deref() == Some("euler") { Discretisation::Euler } else { Discretisation::ZeroOrderHold })
    };
    let s = stated.as_ref();
    let at = s.unwrap_or(law);
    let refused = |e| at.refusal(&e);
    Ok(match kind.as_str() {
        "first_difference" => AnyObserver::new(FirstDifference),
        "commanded_velocity" => AnyObserver::new(CommandedVelocity),
        "filtered_derivative" => {
            let own = s.map(|s| s.maybe_each("time_s", NOT_NEGATIVE)).transpose()?.flatten();
            let time_s = own.or(fast.map(|w| w.map(|w| 1.0 / w))).ok_or_else(|| missing("time_s"))?;
            AnyObserver::new(FilteredDerivative::try_new(time_s).map_err(refused)?)
        }
        "alpha_beta" => AnyObserver::new(AlphaBeta::try_new(rate(s)?).map_err(refused)?),
        "extended_state" => AnyObserver::new(ExtendedState::try_new(rate(s)?).map_err(refused)?),
        "kalman" => AnyObserver::new(Kalman::try_new(at.each("sigma_q", POSITIVE)?, at.each("sigma_a", POSITIVE)?).map_err(refused)?),
        "super_twisting" => AnyObserver::new(SuperTwisting::try_new(at.each("a_bound", POSITIVE)?).map_err(refused)?),
        "model_based" => AnyObserver::new(ModelBased::try_new(site.robot.clone(), rate(s)?, discretisation(s)?).map_err(refused)?),
        _ => AnyObserver::new(CommandedAcceleration::try_new(rate(s)?, discretisation(s)?).map_err(refused)?),
    })
}
