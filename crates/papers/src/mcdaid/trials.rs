//! The paper's two trials of performance: a foot that moves the robot freely, and a moment that is held.

use nalgebra::DVector;

use super::ankle::{PROPOSED, pseudo_inverse};
use super::trial::{Errors, Foot, internal, try_out};
use crate::error::PaperError;
use crate::row::{Gate, Row};

/// Coulomb friction of a rod `[N]`.
const COULOMB: f64 = 20.0;

/// Internal force that carries the limb `[N]`.
const SUPPORT: f64 = 60.0;

/// What the trials stand for.
const FOOT: &str = "a foot moved by sines on the linear model; the paper's subjects and their motion are not recorded";

/// Acceptance of the first trial: uniform gain 5 against the proposed gains.
pub(super) fn free_motion() -> Result<Vec<Row>, PaperError> {
    let foot = Foot { moment: 5.0, pace: 1.0 };
    let commanded = internal(SUPPORT)?;
    let uniform = try_out([5.0; 4], commanded, COULOMB, foot)?;
    let proposed = try_out(PROPOSED, commanded, COULOMB, foot)?;
    let less = |of: fn(&Errors) -> [f64; 4]| {
        let (a, b) = (of(&uniform), of(&proposed));
        core::array::from_fn::<f64, 4, _>(|i| 1.0 - b[i] / a[i])
    };
    let falls = less(|e| e.force);
    let many = falls.iter().filter(|fall| **fall >= 0.3).count();
    let most = falls.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let moments: [f64; 3] = core::array::from_fn(|i| proposed.moment[i] / uniform.moment[i]);
    let mut rows = vec![
        Row::new("Figure 8.17", "drives whose force error falls by 30 % or more", many as f64, None, Gate::AtLeast(2.0)).because(FOOT),
        Row::new("Figure 8.17", "largest fall of the force error of a drive, %", 100.0 * most, Some(50.0), Gate::AtLeast(30.0))
            .conclusion_only(FOOT),
        Row::new("Figure 8.17", "turn of the foot, proposed over uniform gains", proposed.reach / uniform.reach, None, Gate::AtLeast(1.0))
            .because("the robot is easier to move"),
    ];
    for (k, axis) in ["X", "Y"].into_iter().enumerate() {
        let what = format!("moment error about {axis}, proposed over uniform gains");
        rows.push(Row::new("Figure 8.19", what, moments[k], None, Gate::AtMost(1.0)).because(FOOT));
    }
    let row =
        Row::held_against("Figure 8.19", "moment error about Z, proposed over uniform gains", moments[2], None, (Gate::Within(0.25), 1.0));
    rows.push(row.because("similar, since the direction that Z feels has the gain 5 in both"));
    Ok(rows)
}

/// Acceptance of the second trial: a moment about X at three levels, the foot moving slowly.
pub(super) fn held_moment() -> Result<Vec<Row>, PaperError> {
    let pinv = pseudo_inverse([0.0; 3])?;
    let support = internal(SUPPORT)?;
    let error = |level: f64, coulomb: f64| {
        let forces = pinv.transpose() * DVector::from_row_slice(&[level, 0.0, 0.0]);
        let commanded = core::array::from_fn(|k| support[k] + forces[k]);
        Ok::<_, PaperError>(try_out(PROPOSED, commanded, coulomb, Foot { moment: 6.0, pace: 0.1 })?.moment[0])
    };
    let levels = [4.0, 8.0, 12.0];
    let mut found = [0.0; 3];
    for (found, level) in found.iter_mut().zip(levels) {
        *found = error(level, COULOMB)?;
    }
    let (least, most) = found.iter().fold((f64::INFINITY, 0.0_f64), |(l, m), e| (l.min(*e), m.max(*e)));
    let without = error(8.0, 0.0)?;
    let mut rows = vec![
        Row::new("Figure 8.20", "largest over smallest moment error at 4, 8 and 12 N·m", most / least, None, Gate::AtMost(1.02))
            .because("the error does not depend on the commanded moment"),
        Row::new(
            "Figure 8.20",
            "moment error with 20 N of Coulomb friction over that without",
            found[1] / without,
            None,
            Gate::AtLeast(1.15),
        )
        .because("friction has a share in it"),
    ];
    let tenfold = error(8.0, 10.0 * COULOMB)?;
    let row = Row::new("section 8.4.2", "moment error about X, rms, N·m", found[1], Some(1.5), Gate::AtMost(1.5));
    rows.push(row.not_reproducible(format!(
        "the loop divides what friction does by one and its gain: 20 N in every rod leave {:.2} N·m rms, ten times as much {tenfold:.2}",
        found[1]
    )));
    Ok(rows)
}
