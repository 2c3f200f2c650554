//! Efforts of the four drives in one pose of the final geometry, at rest and moving.

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::solve_positions;

use super::geometry::{ACCELERATION, POSE, RATE, Table1};
use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};

const WHAT: &str = "efforts of the drives";

/// Efforts that the laboratory's link data give at rest and moving `[N]`, computed by another program.
const AT_REST: [f64; 4] = [11.310_339_761, 15.961_319_328, -35.008_474_711, 154.815_183_247];
const MOVING: [f64; 4] = [16.677_890_746, 22.387_307_067, -38.872_607_514, 144.333_035_558];

/// Lengths, rates and accelerations of the drives along `x + xd·t + xdd·t²/2`, by differences of nine points.
fn motion() -> [[f64; 4]; 3] {
    let at = |t: f64| Table1::last().lengths(core::array::from_fn(|k| POSE[k] + RATE[k] * t + 0.5 * ACCELERATION[k] * t * t));
    let slope = |f: &dyn Fn(f64) -> [f64; 4]| {
        let mut out = [0.0; 4];
        let h = 0.02;
        for (k, weight) in (1..).zip([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0]) {
            let x = h * f64::from(k);
            let (plus, minus) = (f(x), f(-x));
            (0..4).for_each(|i| out[i] += weight * (plus[i] - minus[i]) / h);
        }
        out
    };
    let rate = |t: f64| slope(&|h| at(t + h));
    [at(0.0), rate(0.0), slope(&rate)]
}

/// One row per drive at rest, one moving.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut model = shipped("ups3_rpu1")?.bare;
    // The paper's equations have no rotors.
    model.joints.iter_mut().for_each(|joint| joint.armature = 0.0);
    let mut data = Data::new(&model);
    let [q, v, a] = motion();
    closed_at(&model, &mut data, &q, WHAT)?;
    // Newton stops at gaps of 1e-12; one more step from nearby leaves rounding.
    model.passive().into_iter().for_each(|j| data.q[j] += 1e-8);
    closed(&solve_positions(&model, &mut data, &q), WHAT)?;
    let mut rows = Vec::new();
    for (what, v, a, checked) in [("at rest", [0.0; 4], [0.0; 4], AT_REST), ("moving", v, a, MOVING)] {
        closed(&inverse_dynamics(&model, &mut data, &q, &v, &a), WHAT)?;
        for ((leg, ours), checked) in (1..).zip(&data.tau_act).zip(checked) {
            let row = Row::held_against("eq. 19", format!("effort of leg {leg} {what}, N"), *ours, None, (Gate::Within(1e-8), checked));
            rows.push(row.because("the paper prints no masses: those of the laboratory's program"));
        }
    }
    Ok(rows)
}
