//! Whether reversals are fitted: where a lag or delay of a drive shows there.
//!
//! What a drive's friction does while it turns over is known worst of all its motion, and rows that hold it tell little of masses, springs or people. Of a lag or
//! delay they tell most. So they are looked at for these two alone, and join the others where one of them stands out.

use pkm_dyn::effects::{Law, Robot};
use rayon::prelude::*;

use crate::design::Design;
use crate::motion::{Motion, softnesses};
use crate::settings::Settings;
use crate::work::Work;
use crate::{nominal, search, turning};

/// What reversals are looked at for.
const CHAIN: [&str; 2] = ["time_delay", "actuator_lag"];

/// Puts laws of turning over into the motions where some drive has one and a lag or delay stands out beside it; leaves them as they are otherwise.
pub(crate) fn fit_where_they_tell(robot: &Robot, motions: &mut [Motion], band: f64, settings: &Settings) {
    let names: Vec<&str> = CHAIN.into_iter().filter(|name| !settings.leaves_out(name)).collect();
    // What gives way in the robot's file is counted into what other sensors read once and for all.
    let gives_way = robot.effects.iter().any(|e| matches!(e.entry.law, Law::Transmission(_) | Law::Structure));
    if names.is_empty() || gives_way || !turning::settle(robot, motions, band) {
        return forget(robot, motions);
    }
    fill(robot, motions);
    let design = Design::new(robot, motions, band);
    let mut work = Work::looking(robot, motions, (design, band), &names);
    let shows = search::shows_a_chain(&mut work, band, settings);
    tracing::debug!(shows, "a lag or delay at reversals");
    if !shows {
        forget(robot, motions);
        fill(robot, motions);
    }
}

fn fill(robot: &Robot, motions: &mut [Motion]) {
    motions.par_iter_mut().for_each(|m| nominal::fill(robot, m));
}

/// Back to directions that no recording speaks of.
fn forget(robot: &Robot, motions: &mut [Motion]) {
    for m in motions {
        m.turns = softnesses(&robot.model, m);
        m.turning_weight.fill(0.0);
    }
}
