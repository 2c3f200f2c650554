//! The robot of a daemon or driver: simulated in this process, or in another one.

use alloc::sync::Arc;
use core::sync::atomic::AtomicBool;

use pkm_daemon::config::Settings;
use pkm_dyn::urdf::Description;
use pkm_hal::{AxisLimits, Backend, HalError, Limiter, MAX_AXES, SystemClock, Watchdog, WatchdogLimits};
use pkm_sim::sensors::ForceCell;
use pkm_sim::{ConstrainedOptions, Paced, PlantKind, SimBackend, SimOptions};

use super::brakes::{Braked, Brakes};
use super::setup::Setup;

/// A device as a whole HAL: session, watchdog, limits.
type Guarded<B> = Watchdog<Limiter<B, Arc<[AxisLimits]>>, SystemClock>;

/// A simulated robot as one.
pub(crate) type Simulated = Guarded<Brakes<Paced<Braked, SystemClock>>>;

/// How long commands may be valid at most, in multiples of what the daemon asks for.
const HORIZON: u64 = 2;

/// The robot of `setup`, standing at its assembly on its brakes, as effects of its files have it.
///
/// # Errors
/// A robot that cannot be simulated.
pub(crate) fn simulated(setup: &Setup) -> anyhow::Result<Simulated> {
    let period_ns = setup.settings.limits.period_ns;
    let (plant, is_engaged) = plant(&setup.robot, &setup.settings)?;
    let device = Paced::try_new(plant, SystemClock, period_ns)?;
    Ok(guarded(Brakes::new(device, is_engaged), &setup.settings)?)
}

/// `device` within limits, for one commander.
///
/// # Errors
/// Limits that the device cannot be kept in.
pub(crate) fn guarded<B: Backend>(device: B, settings: &Settings) -> Result<Guarded<B>, HalError> {
    let limits = &settings.limits;
    let watched = WatchdogLimits {
        late_ns: limits.gate.late_ns,
        stale_ns: limits.gate.stale_ns,
        ahead_ns: limits.gate.ahead_ns,
        horizon_ns: limits.valid_for_ns.saturating_mul(HORIZON),
    };
    Watchdog::try_new(Limiter::sharing(device, Arc::clone(&settings.axes))?, SystemClock, watched, limits.safe)
}

fn plant(robot: &Description, settings: &Settings) -> anyhow::Result<(SimBackend<Braked>, Arc<AtomicBool>)> {
    let model = &robot.robot.model;
    let start: Vec<f64> = model.actuators.iter().map(|&j| model.assembly[j]).collect();
    // Drives without power let go: the robot rests on its end stops, as it would.
    let kind = PlantKind::Constrained(ConstrainedOptions { end_stops: Some(0.0), ..ConstrainedOptions::default() });
    let plant = kind.build(&robot.robot, 1, &start, &[0.0; MAX_AXES][..start.len()])?;
    let (plant, is_engaged) = Braked::new(plant, model);
    // Steps of half a millisecond at most, whatever the period.
    let substeps = u32::try_from(settings.limits.period_ns.div_ceil(500_000)).unwrap_or(1).max(1);
    let options = SimOptions {
        period_ns: settings.limits.period_ns,
        substeps,
        encoder_resolution: 1e-6,
        encoder_noise: 1e-6,
        ..SimOptions::default()
    };
    let mut hal = SimBackend::of_robot(plant, &robot.robot, &options)?;
    if let Some(sensor) = settings.wrench {
        hal.add_wrench(sensor, core::array::from_fn(|i| ForceCell::new(options.effort, options.seed, 200 + i)))?;
    }
    Ok((hal, is_engaged))
}
