//! Equation (3) in one state.

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;

use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};

/// Heights `[m]` and speeds `[m/s]` of the sliders.
const STATE: [[f64; 3]; 2] = [[0.12, 0.09, 0.105], [0.05, -0.03, 0.02]];

/// Weight, and weight with velocity forces `[N]`; mass matrix `[kg]`: by an independent program, four decimals.
const WEIGHT: [f64; 3] = [73.7973, 73.3565, 73.5712];
const BIAS: [f64; 3] = [73.8011, 73.3592, 73.5697];
const MASS: [[f64; 3]; 3] = [[26.5612, 0.4925, 0.4689], [0.4925, 26.4653, 0.5198], [0.4689, 0.5198, 26.5109]];

/// Half a digit of four decimals, and rounding.
const HALF_A_DIGIT: f64 = 6e-5;

/// Weight, velocity forces and mass matrix.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "mass matrix";
    let model = shipped("prs3")?.bare;
    let mut data = Data::new(&model);
    let ([q, v], zero) = (STATE, [0.0; 3]);
    closed_at(&model, &mut data, &q, WHAT)?;
    let mut effort = |v: [f64; 3], a: [f64; 3]| -> Result<[f64; 3], PaperError> {
        closed(&inverse_dynamics(&model, &mut data, &q, &v, &a), WHAT)?;
        Ok(core::array::from_fn(|k| data.tau_act[k]))
    };
    let (weight, bias) = (effort(zero, zero)?, effort(v, zero)?);
    let mut rows = Vec::new();
    let mut push = |what: String, ours: f64, checked: f64| {
        let row = Row::held_against("eq. 3", what, ours, None, (Gate::Within(HALF_A_DIGIT), checked));
        rows.push(row.because("masses, inertias and rotors are assumed, inside the paper's bounds: it prints none"));
    };
    for k in 0..3 {
        push(format!("weight felt by drive {}, N", k + 1), weight[k], WEIGHT[k]);
        push(format!("weight and velocity force of drive {}, N", k + 1), bias[k], BIAS[k]);
    }
    for k in 0..3 {
        let mut a = zero;
        a[k] = 1.0;
        let column = effort(zero, a)?;
        for i in 0..=k {
            push(format!("mass matrix, entry {}, {}, kg", i + 1, k + 1), column[i] - weight[i], MASS[i][k]);
        }
    }
    Ok(rows)
}
