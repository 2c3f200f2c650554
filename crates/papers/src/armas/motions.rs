//! The exciting motions: Fourier series of seven harmonics, optimised once for the condition number and stored.

use pkm_dyn::Model;
use pkm_ident::excitation::{Basis, Periodic};
use pkm_sim::{Sample, Trajectory, check_limits};

use crate::error::PaperError;
use crate::row::{Gate, Row};

/// Harmonics \[Armas, sec. 2.3\].
const HARMONICS: usize = 7;

/// Periods `[s]`.
pub(super) const IDENTIFY_S: f64 = 20.0;
pub(super) const VERIFY_S: f64 = 10.0;

/// Fastest motion of a drive `[m/s]`.
const SPEED: f64 = 0.05;

/// `q_0, a_1, b_1, a_2, …` of the four drives: a position `[m]`, then velocities `[m/s]`.
type Coefficients = [[f64; 2 * HARMONICS + 1]; 4];

/// Of the motion to identify with.
const IDENTIFY: Coefficients = [
    [
        0.76858, 0.00424, 0.00566, 0.00219, 0.00059, -0.00893, -0.00183, -0.01262, -0.00346, -0.00061, -0.01132, 0.01115, 0.02737, 0.00456,
        -0.01359,
    ],
    [
        0.76326, -0.00098, -0.00500, 0.00293, -0.00222, 0.00894, 0.02283, 0.00019, 0.00446, 0.01093, -0.00034, -0.01925, -0.00868,
        -0.00277, -0.00330,
    ],
    [
        0.77666, -0.00661, -0.00040, -0.00497, 0.00011, 0.00299, -0.00378, 0.00217, 0.01532, 0.01620, -0.00526, 0.01081, 0.00370, -0.02059,
        -0.00652,
    ],
    [
        0.70859, -0.00038, 0.00262, -0.01213, 0.00571, 0.00410, -0.00248, 0.00082, -0.01561, -0.01071, -0.00208, -0.00213, -0.01183,
        0.02042, 0.01961,
    ],
];

/// Of the motion to verify with.
const VERIFY: Coefficients = [
    [
        0.76478, -0.00372, 0.00082, 0.00077, 0.00482, -0.02507, 0.01095, 0.01641, 0.00434, 0.00034, 0.00437, 0.00334, 0.00134, 0.00792,
        -0.01293,
    ],
    [
        0.76055, -0.00295, -0.00647, -0.00596, 0.00583, 0.00692, 0.00356, 0.01500, 0.00231, 0.01010, -0.00401, -0.02326, 0.01642, 0.00014,
        -0.01479,
    ],
    [
        0.78028, 0.00016, -0.01209, -0.00389, 0.00108, -0.00678, 0.00347, -0.00085, 0.00002, -0.00027, 0.00050, 0.02911, 0.00437, -0.01748,
        -0.00418,
    ],
    [
        0.70794, -0.01236, 0.01689, 0.00553, 0.00477, 0.01739, 0.01692, -0.01296, 0.00021, -0.01297, 0.01072, 0.01251, -0.01525, 0.00287,
        -0.00574,
    ],
];

/// A stored motion.
#[derive(Debug, Clone)]
pub(super) struct Stored(Periodic);

impl Trajectory for Stored {
    fn at(&self, t: f64, out: &mut Sample) {
        let state = self.0.at(t);
        (out.q, out.v, out.a) = (state.q, state.v, state.a);
    }
}

fn stored(coefficients: &Coefficients, period_s: f64) -> Stored {
    let coefficients = coefficients.iter().map(|c| c.to_vec()).collect();
    Stored(Periodic { basis: Basis::Fourier { harmonics: HARMONICS }, period_s, coefficients })
}

/// The motion to identify with.
pub(super) fn identify() -> Stored {
    stored(&IDENTIFY, IDENTIFY_S)
}

/// The motion to verify with.
pub(super) fn verify() -> Stored {
    stored(&VERIFY, VERIFY_S)
}

/// Both motions keep the limits of the final geometry: lengths, joints, and the assumed speed.
pub(super) fn rows(model: &Model) -> Result<Vec<Row>, PaperError> {
    let mut slow = model.clone();
    for &j in &model.actuators {
        slow.joints[j].limits.velocity = SPEED;
    }
    let mut rows = Vec::new();
    for (what, motion, seconds) in [("to identify", identify(), IDENTIFY_S), ("to verify", verify(), VERIFY_S)] {
        check_limits(&slow, &motion, seconds)?;
        let mut s = Sample::default();
        let mut fastest = 0.0_f64;
        for i in 0..2000 {
            motion.at(seconds * f64::from(i) / 2000.0, &mut s);
            fastest = s.v.iter().fold(fastest, |top, v| top.max(v.abs()));
        }
        let row = Row::new("eq. 29-31", format!("fastest motion of a drive, motion {what}, m/s"), fastest, None, Gate::AtMost(SPEED));
        rows.push(row.because(
            "speed limits \"0.01 to 0.01\" are a misprint, and 0.01 m/s leaves 3 cm of travel in 20 s: 0.05 m/s; lengths and joints stay inside \
             the limits of the final geometry, universal joints within 0.6 rad",
        ));
    }
    Ok(rows)
}
