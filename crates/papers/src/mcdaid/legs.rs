//! Lengths of the legs, their Jacobian, and the force that moves nothing, from the shipped robot's own closed loops.

use nalgebra::DMatrix;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::internal_efforts;
use pkm_dyn::{Data, Model};

use super::ankle::lengths;
use crate::error::PaperError;
use crate::refused::refused;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};

const WHAT: &str = "legs of the ankle robot";

/// Why Table 8.2 needs a reading.
const READING: &str = "the figure that says where the points sit is missing: the reading that meets six of seven limits of motion";

/// Numbers that Table 8.2 gives as it is read here, in the neutral pose.
const NEUTRAL: [f64; 4] = [0.327_232_85, 0.327_232_85, 0.330_797_02, 0.330_797_02];
const JACOBIAN: [[f64; 3]; 4] = [
    [0.024_557_56, -0.056_771_72, -0.011_389_43],
    [0.024_557_56, 0.056_771_72, 0.011_389_43],
    [-0.027_596_78, 0.063_447_23, -0.014_083_39],
    [-0.027_596_78, -0.063_447_23, 0.014_083_39],
];
const SINGULAR: [f64; 3] = [0.120_477_22, 0.052_242_81, 0.025_268_94];
const NULL: [f64; 4] = [0.528_240_67, 0.528_240_67, 0.470_065_73, 0.470_065_73];

/// Lengths at 10, 5 and −4 degrees.
const TILTED: [f64; 3] = [10.0, 5.0, -4.0];
const AT_TILTED: [f64; 4] = [0.327_303_83, 0.337_911_91, 0.334_714_2, 0.320_834_71];

/// Half a unit of the eighth decimal, and rounding.
const EIGHT: f64 = 6e-9;

/// Lengths and their derivatives by the ankle's angles, from the loops with the angles as drives.
fn of_model(angles: [f64; 3]) -> Result<(Vec<f64>, DMatrix<f64>), PaperError> {
    let model = by_angles()?;
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &angles, WHAT)?;
    closed(&closed_loop_motion(&model, &mut data, &angles, &[0.0; 3], &[0.0; 3]), WHAT)?;
    let drives = drives(&model)?;
    let rates = DMatrix::from_fn(4, 3, |i, k| data.reduction[(drives[i], k)]);
    Ok((drives.iter().map(|&j| data.q[j]).collect(), rates))
}

/// Joints of the four lengths.
fn drives(model: &Model) -> Result<Vec<usize>, PaperError> {
    let missing = |name: &&str| PaperError::Other { what: WHAT, reason: format!("no joint {name:?}") };
    ["l1", "l2", "l3", "l4"].iter().map(|name| model.joint_index(name).ok_or_else(|| missing(name))).collect()
}

fn by_angles() -> Result<Model, PaperError> {
    let mut model = shipped("ups4")?.bare;
    model.actuators.clear();
    for joint in ["rx", "ry", "rz"] {
        model.add_actuator(joint, 0.0).map_err(refused(WHAT))?;
    }
    Ok(model)
}

/// Largest difference of the model's derivatives and central differences of the lengths in closed form.
fn derivative_gap(angles: [f64; 3], rates: &DMatrix<f64>) -> f64 {
    let mut worst = 0.0_f64;
    for k in 0..3 {
        let along = |h: f64| {
            let mut at = angles;
            at[k] += h;
            lengths(at, [0.0; 3])
        };
        let h = 1e-3;
        let [near, far] = [h, 2.0 * h].map(|h| (along(h), along(-h)));
        for i in 0..4 {
            // Five points: the error falls with the fourth power of the step.
            let slope = (8.0 * (near.0[i] - near.1[i]) - (far.0[i] - far.1[i])) / (12.0 * h);
            worst = worst.max((slope - rates[(i, k)]).abs());
        }
    }
    worst
}

/// The force along the one direction that moves nothing, from the loops with the lengths as drives.
fn null_of_model() -> Result<Vec<f64>, PaperError> {
    let model = shipped("ups4")?.bare;
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &lengths([0.0; 3], [0.0; 3]), WHAT)?;
    Ok(internal_efforts(&model, &mut data).iter().copied().collect())
}

/// One row per length and singular value.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = Vec::new();
    let mut add = |place, what: String, ours: f64, checked: f64| {
        rows.push(Row::held_against(place, what, ours, None, (Gate::Within(EIGHT), checked)).because(READING));
    };
    let tilted = TILTED.map(f64::to_radians);
    let (neutral, rates) = of_model([0.0; 3])?;
    let (at_tilted, rates_tilted) = of_model(tilted)?;
    for i in 0..4 {
        add("Table 8.2", format!("length of leg {} in the neutral pose, m", i + 1), neutral[i], NEUTRAL[i]);
    }
    for i in 0..4 {
        add("Table 8.2", format!("length of leg {} at 10, 5, -4 degrees, m", i + 1), at_tilted[i], AT_TILTED[i]);
    }
    let mut values: Vec<f64> = rates.singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    for (k, (ours, checked)) in values.into_iter().zip(SINGULAR).enumerate() {
        add("eq. 8.4", format!("singular value {} of J in the neutral pose, m", k + 1), ours, checked);
    }
    let null = null_of_model()?;
    for (i, checked) in NULL.into_iter().enumerate() {
        add("eq. 8.7", format!("share of leg {} in the force that moves nothing", i + 1), null[i].abs(), checked);
    }
    let gap =
        (0..4).flat_map(|i| (0..3).map(move |k| (i, k))).fold(0.0, |worst: f64, (i, k)| worst.max((rates[(i, k)] - JACOBIAN[i][k]).abs()));
    rows.push(
        Row::new("eq. 8.4", "largest error of an entry of J in the neutral pose, m", gap, None, Gate::AtMost(EIGHT)).because(READING),
    );
    let slope = derivative_gap([0.0; 3], &rates).max(derivative_gap(tilted, &rates_tilted));
    rows.push(Row::new("eq. 8.4", "largest difference of J from differences of the lengths, m", slope, None, Gate::AtMost(1e-9)));
    Ok(rows)
}
