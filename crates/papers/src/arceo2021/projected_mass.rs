//! What the identified input gains say: the inertia that the drive feels.

use pkm_dyn::Data;
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::inverse_dynamics::inverse_dynamics;

use crate::arceo2021::geometry::inverse_kinematics;
use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Line, Plot, Row};

/// Input gains of Table 2: effort per rate of the voltage `[N·s/V]`, velocity per voltage `[m/(s·V)]`.
const GAINS: [f64; 2] = [0.0627, 0.007_45];

/// Travel of the piston `[m]`.
const TRAVEL: f64 = 0.103;

/// The ratio of the gains against the projected mass, and the projected mass over the travel.
pub(super) fn rows() -> Result<(Vec<Row>, Plot), PaperError> {
    const WHAT: &str = "projected mass";
    let mut model = shipped("motobotte")?.bare;
    model.joints.iter_mut().for_each(|joint| joint.armature = 0.0);
    let mut data = Data::new(&model);
    let mut mass = |d: f64| -> Result<f64, PaperError> {
        closed_at(&model, &mut data, &[d], WHAT)?;
        closed(&inverse_dynamics(&model, &mut data, &[d], &[0.0], &[0.0]), WHAT)?;
        Ok(reduced_mass_matrix(&model, &mut data)[(0, 0)])
    };
    let ours = mass(inverse_kinematics(110.0_f64.to_radians())[0])?;
    let row = Row::new(
        "Table 2",
        "inertia felt by the drive at 110 degrees against b0/b1, kg",
        ours,
        Some(GAINS[0] / GAINS[1]),
        Gate::Within(0.01),
    );
    let row = row.because("(8) inverts M11 = 11.16 kg; what was identified is the projected inertia R'MR");
    let points = (0..=50).map(|k| f64::from(k) / 50.0 * TRAVEL).map(|d| Ok((d, mass(d)?))).collect::<Result<Vec<_>, PaperError>>()?;
    let level = [0.0, TRAVEL].map(|d| (d, GAINS[0] / GAINS[1])).to_vec();
    let plot = Plot {
        title: "Inertia felt by the drive".to_string(),
        x_label: "position of the piston, m".to_string(),
        y_label: "kg".to_string(),
        lines: vec![
            Line { label: "projected mass R'MR".to_string(), points },
            Line { label: "b0/b1 of Table 2".to_string(), points: level },
        ],
    };
    Ok((vec![row], plot))
}
