//! How far the foot can be turned with the legs' stroke, and what moments the drives can hold.

use super::ankle::{jacobian, lengths};
use crate::error::PaperError;
use crate::row::{Gate, Row};

/// Shortest and longest leg: the stroke of 0.1 m, where it meets most of the chapter's limits `[m]`.
const WINDOW: [f64; 2] = [0.2725, 0.3725];

/// Half the side of the cube in which the ankle's centre may lie `[m]`.
const HALF_CUBE: f64 = 0.015;

/// Largest force of a drive `[N]`.
const FORCE: f64 = 2000.0;

/// Steps per degree of the search.
const STEPS: u32 = 10;

/// Whether the foot can be turned so with its centre at all of these places.
fn is_reached(angles: [f64; 3], centres: &[[f64; 3]]) -> bool {
    centres.iter().all(|&c| lengths(angles, c).iter().all(|l| (WINDOW[0]..=WINDOW[1]).contains(l)))
}

/// Largest turn about axis `k` to the side of `sign` with all smaller ones reached as well `[deg]`.
fn limit(k: usize, sign: f64, centres: &[[f64; 3]]) -> f64 {
    let at = |i: u32| f64::from(i) / f64::from(STEPS);
    let turned = |i: &u32| {
        let mut angles = [0.0; 3];
        angles[k] = sign * at(*i).to_radians();
        is_reached(angles, centres)
    };
    at((1..90 * STEPS).take_while(turned).last().unwrap_or(0))
}

/// Corners, middles of edges and faces, and the middle of the cube.
fn cube() -> Vec<[f64; 3]> {
    let at = |i: usize| (i as f64 - 1.0) * HALF_CUBE;
    (0..27).map(|i| [at(i % 3), at(i / 3 % 3), at(i / 9)]).collect()
}

/// Largest moment about axis `k` alone `[N·m]` with no drive above [`FORCE`].
///
/// Forces for a moment of one are `F + s·v_0`; the largest of them is least where two are of one size.
fn capacity(k: usize) -> Result<f64, PaperError> {
    let pinv = super::ankle::pseudo_inverse([0.0; 3])?;
    let v0 = super::ankle::null_direction([0.0; 3])?;
    let f: [f64; 4] = core::array::from_fn(|i| pinv[(k, i)]);
    let top = |s: f64| (0..4).map(|i| (f[i] + s * v0[i]).abs()).fold(0.0, f64::max);
    let mut least = top(0.0);
    for i in 0..4 {
        for j in 0..i {
            for sign in [-1.0, 1.0] {
                let slope = v0[i] - sign * v0[j];
                if slope.abs() > 1e-9 {
                    least = least.min(top((sign * f[j] - f[i]) / slope));
                }
            }
        }
    }
    Ok(FORCE / least)
}

/// Motion of the foot, then moments.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let (nominal, cube) = ([[0.0; 3]], cube());
    let motion = [
        ("section 8.2.2", "plantar flexion, ankle at its nominal place, deg", 0, 1.0, &nominal[..], 52.0),
        ("section 8.2.2", "dorsiflexion, ankle at its nominal place, deg", 0, -1.0, &nominal, 48.0),
        ("section 8.2.2", "inversion, ankle at its nominal place, deg", 1, 1.0, &nominal, 34.0),
        ("Table 8.3", "plantar flexion, ankle anywhere in the cube, deg", 0, 1.0, &cube, 44.0),
        ("Table 8.3", "dorsiflexion, ankle anywhere in the cube, deg", 0, -1.0, &cube, 36.0),
        ("Table 8.3", "inversion, ankle anywhere in the cube, deg", 1, 1.0, &cube, 26.0),
    ];
    let mut rows: Vec<Row> = motion
        .map(|(place, what, k, sign, centres, paper)| {
            let row = Row::new(place, what, limit(k, sign, centres), Some(paper), Gate::Within(4.0));
            row.because("the points' places are read from six of seven of these limits, the stroke's ends with them: not independent of it")
        })
        .into();
    let row = Row::held_against(
        "Table 8.3",
        "external rotation, ankle anywhere in the cube, deg",
        limit(2, 1.0, &cube),
        Some(72.0),
        (Gate::Within(1.0), 55.0),
    );
    rows.push(row.not_reproducible(
        "the reading that gives the other six limits gives 55 degrees; the one that gives 76 loses rank at 36 degrees of flexion, inside the claimed range",
    ));
    let checked = [("X", 151.0, 209.0), ("Y", 38.0, 432.0), ("Z", 68.0, 96.0)];
    for (k, (axis, paper, checked)) in checked.into_iter().enumerate() {
        let what = format!("moment about {axis} alone in the neutral pose, N·m");
        let row = Row::held_against("Table 8.3", what, capacity(k)?, Some(paper), (Gate::Within(1.0), checked));
        rows.push(row.not_reproducible("none of some 45 readings of Table 8.2 gives the printed moments with 2000 N in every drive"));
    }
    let least =
        (-8..=10).map(|i| jacobian([(5.0 * f64::from(i)).to_radians(), 0.0, 0.0]).singular_values().min()).fold(f64::INFINITY, f64::min);
    let row =
        Row::new("Figure 8.4", "smallest singular value of J for flexion from -40 to 50 degrees, m", least, None, Gate::AtLeast(0.025));
    rows.push(row.because("no singularity along the flexion of the foot"));
    Ok(rows)
}
