//! What the identified input gains say: the inertia that the drive feels.

use pkm_dyn::Data;
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::inverse_dynamics::inverse_dynamics;

use crate::arceo2021::equations::{B0, B1};
use crate::arceo2021::geometry::{FITTED, TRAVEL};
use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Line, Plot, Row};

/// Foot angles `[deg]` and the inertia there `[kg]` by an independent program, four decimals.
const CHECKED: [(f64, f64); 4] = [(80.0, 12.1243), (92.7, 9.6688), (110.0, 8.4230), (140.0, 7.9494)];

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
    let mut rows = Vec::new();
    for (degrees, checked) in CHECKED {
        let ours = mass(FITTED.inverse_kinematics(degrees.to_radians())[0])?;
        let what = format!("inertia felt by the drive at {degrees} deg, kg");
        rows.push(
            Row::held_against("eq. 8", what, ours, None, (Gate::Within(5e-5), checked)).because("not printed: an independent program"),
        );
        if (degrees - 110.0).abs() < 0.5 {
            let what = "inertia felt by the drive at 110 degrees against b0/b1, kg";
            let row = Row::new("Table 2", what, ours, Some(B0 / B1), Gate::Within(0.01));
            rows.push(row.because("(8) inverts M11 = 11.16 kg; what was identified is the projected inertia R'MR"));
        }
    }
    let points = (0..=50).map(|k| f64::from(k) / 50.0 * TRAVEL).map(|d| Ok((d, mass(d)?))).collect::<Result<Vec<_>, PaperError>>()?;
    let level = [0.0, TRAVEL].map(|d| (d, B0 / B1)).to_vec();
    let plot = Plot {
        title: "Inertia felt by the drive".to_string(),
        x_label: "position of the piston, m".to_string(),
        y_label: "kg".to_string(),
        lines: vec![
            Line { label: "projected mass R'MR".to_string(), points },
            Line { label: "b0/b1 of Table 2".to_string(), points: level },
        ],
    };
    Ok((rows, plot))
}
