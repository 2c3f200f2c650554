//! Lengths of the legs in the neutral pose.

use pkm_dyn::Data;
use pkm_dyn::loops::assemble;

use crate::error::PaperError;
use crate::robot::{closed, shipped};
use crate::row::{Gate, Row};

/// Lengths of front and rear legs that Table 8.2 gives as it is read here `[m]`.
const LENGTHS: [f64; 4] = [0.327_232_85, 0.327_232_85, 0.330_797_02, 0.330_797_02];

/// One row per leg.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let model = shipped("ups4")?.bare;
    let mut data = Data::new(&model);
    closed(&assemble(&model, &mut data), "neutral pose")?;
    let row = |((leg, &j), checked): ((usize, &usize), f64)| {
        let what = format!("length of leg {leg} in the neutral pose, m");
        let row = Row::held_against("Table 8.2", what, data.q[j], None, (Gate::Within(6e-9), checked));
        row.because("the figure that says where the points sit is missing: the reading that meets six of seven limits of Table 8.3")
    };
    Ok((1..).zip(&model.actuators).zip(LENGTHS).map(row).collect())
}
