//! Efforts of the four drives at rest in one pose of the final geometry.

use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;

use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};

/// Lengths q13, q23, q33, q42 at X = 0.05 m, Z = 0.65 m, theta = 0.10, psi = −0.05 rad `[m]`.
const LENGTHS: [f64; 4] = [0.696_829_242, 0.702_074_883, 0.697_219_921, 0.657_647_322];

/// Efforts that the laboratory's link data give there `[N]`.
const EFFORTS: [f64; 4] = [11.310_339_761, 15.961_319_328, -35.008_474_711, 154.815_183_247];

/// One row per drive.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "efforts at rest";
    let mut model = shipped("ups3_rpu1")?.bare;
    // The paper's equations have no rotors.
    model.joints.iter_mut().for_each(|joint| joint.armature = 0.0);
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &LENGTHS, WHAT)?;
    closed(&inverse_dynamics(&model, &mut data, &LENGTHS, &[0.0; 4], &[0.0; 4]), WHAT)?;
    let row = |((leg, ours), checked): ((usize, &f64), f64)| {
        // Lengths with nine decimals.
        let row = Row::held_against("eq. 19", format!("effort of leg {leg} at rest, N"), *ours, None, (Gate::Within(1e-5), checked));
        row.because("the paper prints no masses: those of the laboratory's program")
    };
    Ok((1..).zip(&data.tau_act).zip(EFFORTS).map(row).collect())
}
