//! What the benches share: the shipped robots, and motions about the middle of their travel.

use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Model, loops, math};

/// The shipped robot of that name.
///
/// # Panics
/// When there is none, or its files cannot be read.
#[must_use]
#[expect(clippy::expect_used, reason = "a bench has no caller to report to")]
pub fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a sound robot")
}

/// Positions, velocities and accelerations of the drives, one row per sample of a slow motion about the middle of travel: a hundredth
/// of a second apart, so that each loop closure starts near its solution as it does along a recording.
#[must_use]
pub fn motion(model: &Model, samples: u32) -> Vec<[Vec<f64>; 3]> {
    let centre = loops::mid_pose(model);
    let row = |t: f64| {
        let each = |f: &dyn Fn(f64, f64, f64) -> f64| {
            let drives = centre.iter().enumerate();
            drives.map(|(k, c)| f(*c, 0.02, 1.0 + 0.3 * k as f64)).collect::<Vec<f64>>()
        };
        [
            each(&|c, size, w| c + size * math::sin(w * t)),
            each(&|_, size, w| size * w * math::cos(w * t)),
            each(&|_, size, w| -size * w * w * math::sin(w * t)),
        ]
    };
    (0..samples).map(|k| row(0.01 * f64::from(k))).collect()
}
