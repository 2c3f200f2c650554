//! The 3-PRS with a wrench sensor under its plate and a leg that rests on it.

use pkm_daemon::DaemonConfig;
use pkm_daemon::config::Settings;
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::parse;
use pkm_hal::ManualClock;
use pkm_sim::sensors::ForceCell;
use pkm_sim::{ConstrainedOptions, Paced, PlantKind, SimBackend, SimOptions};

use super::rig::{CONFIG, Guarded, behind_limits};

const SENSOR: &str = "\n[[sensor]]\nname = \"foot\"\nkind = \"wrench\"\nlink = \"platform\"\n";

/// A leg that rests on the plate.
pub(crate) const LIMB: &str =
    "\n[[effect]]\nname = \"limb_impedance\"\nwhere = [\"platform\"]\nparameters = { stiffness = 500.0, damping = 50.0 }\n";

/// The robot with its sensor, and with further tables of its file.
pub(crate) fn robot(more: &str) -> Robot {
    let shipped = pkm_robots::find("prs3").expect("a shipped robot");
    let toml = format!("{}{SENSOR}{more}", shipped.toml);
    parse(&toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("it loads").robot
}

/// Numbers of the shipped example, with the sensor and a largest force `[N]`.
pub(crate) fn settings(robot: &Robot, limit: f64) -> Settings {
    let text = CONFIG.replace("[limits]\n", &format!("[limits]\nforce = {limit:?}\n")).replace("[hal]\n", "[hal]\nwrench = \"foot\"\n");
    let config = DaemonConfig::parse(&text, "daemon.toml").expect("the example");
    config.settings(&robot.model, 200.0).expect("the example fits")
}

/// What `real` is in truth, simulated, behind limits and a watchdog of its own.
pub(crate) fn guarded<'c>(real: &Robot, settings: &Settings, clock: &'c ManualClock) -> Guarded<'c> {
    let kind = PlantKind::Constrained(ConstrainedOptions { end_stops: Some(0.0), ..ConstrainedOptions::default() });
    let plant = kind.build(real, 1, &[0.14, 0.15, 0.16], &[0.0; 3]).expect("it closes");
    let period_ns = settings.limits.period_ns;
    let options = SimOptions { period_ns, substeps: 10, encoder_resolution: 1e-6, encoder_noise: 1e-6, ..SimOptions::default() };
    let mut device = SimBackend::of_robot(plant, real, &options).expect("three drives");
    device.add_wrench(0, core::array::from_fn(|i| ForceCell::new(options.effort, 1, 200 + i))).expect("this plant feels");
    let device = Paced::try_new(device, clock, period_ns).expect("a state");
    behind_limits(device, settings, clock)
}
