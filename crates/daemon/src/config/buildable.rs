//! What is accepted can be built: limits and safe action as the robot's side will refuse or take them, before it is opened.

use pkm_hal::backends::Loopback;
use pkm_hal::{AxisLimits, HalError, Limiter, ManualClock, SafeAction, Watchdog, WatchdogLimits};
use toml::Spanned;

use super::layout::PerDrive;
use super::{ConfigError, Reader};

/// What the contract of hardware calls a number, the key it comes from, and where that stands.
type Origin<'a> = (&'static str, &'static str, Option<&'a Spanned<PerDrive>>);

impl Reader<'_> {
    /// Whether a robot of these limits and this safe action can be built.
    pub(super) fn buildable(&self, axes: &[AxisLimits], safe: SafeAction) -> Result<(), ConfigError> {
        let (l, s) = (&self.config.layout.limits, &self.config.layout.safe);
        let clock = ManualClock::new(0);
        let limited = Limiter::try_new(Loopback::new(self.n(), &clock), axes).map_err(|error| {
            let origins = [
                ("effort", "limits.effort", l.effort.as_ref()),
                ("effort rate", "limits.effort_rate", l.effort_rate.as_ref()),
                ("velocity", "limits.velocity", l.velocity.as_ref()),
                ("upper end", "limits.upper", l.upper.as_ref()),
                ("velocity gain", "limits.velocity_gain", l.velocity_gain.as_ref()),
                ("position gain", "limits.position_gain", l.position_gain.as_ref()),
            ];
            self.refused(&error, &origins)
        })?;
        Watchdog::try_new(limited, &clock, WatchdogLimits::of_period(1), safe).map(|_| ()).map_err(|error| {
            let origins = [
                ("stiffness", "safe.stiffness", s.stiffness.as_ref()),
                ("damping", "safe.damping", s.damping.as_ref()),
                ("effort", "safe.effort", s.effort.as_ref().or(l.effort.as_ref())),
            ];
            self.refused(&error, &origins)
        })
    }

    fn refused(&self, error: &HalError, origins: &[Origin<'_>]) -> ConfigError {
        let HalError::Config { axis, what, value, limit } = *error else { return self.config.error(0, error.to_string()) };
        let origin = origins.iter().find(|(name, ..)| *name == what);
        let (key, stated) = origin.map_or((what, None), |(_, key, stated)| (*key, *stated));
        let joint = self.model.actuators.get(axis).and_then(|j| self.model.joints.get(*j)).map_or("", |joint| joint.name.as_str());
        self.config.error(stated.map_or(0, |s| s.span().start), format!("{key} = {value} at joint {joint:?} ({limit})"))
    }
}
