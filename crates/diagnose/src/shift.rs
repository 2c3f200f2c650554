//! Efforts that a shift of a drive or of the ground takes, to first order: what sensors, transmissions and mountings have in common.

use pkm_dyn::math;
use pkm_ident::filter::derivative;

use crate::channels::Channel;
use crate::motion::{Motion, soft_sign};

/// Change of the effort of every drive, and of every channel after them, when drive `j` is at `q + e(t)` where its reading is `q`:
/// [drive or channel][sample].
pub(crate) fn of_reading(m: &Motion, j: usize, e: &[f64]) -> Vec<Vec<f64>> {
    let rate = derivative(e, m.segment.dt);
    let acceleration = derivative(&rate, m.segment.dt);
    let s = &m.sensitivity;
    let effort =
        |k: usize| (0..e.len()).map(|i| s.offset[j][k][i] * e[i] + s.rate[j][k][i] * rate[i] + s.mass[j][k][i] * acceleration[i]).collect();
    let channel = |c: &Channel| of_channel(m, c, |i| c.by_drive[j][i] * e[i]);
    (0..m.rigid.len()).map(effort).chain(m.channels.iter().map(channel)).collect()
}

/// A channel's part of a column; zero where this recording does not measure it.
fn of_channel(m: &Motion, c: &Channel, x: impl Fn(usize) -> f64) -> Vec<f64> {
    let n = m.segment.valid.len();
    if c.measured.is_none() { vec![0.0; n] } else { c.settled((0..n).map(x).collect(), &m.segment.valid) }
}

/// Change of every drive's effort and of every channel per metre of a length: [drive or channel][sample].
pub(crate) fn of_length(m: &Motion, length: usize) -> Vec<Vec<f64>> {
    let channel = |c: &Channel| of_channel(m, c, |i| c.by_length[length][i]);
    m.sensitivity.length[length].iter().cloned().chain(m.channels.iter().map(channel)).collect()
}

/// The same when only the load is shifted: the rotor turns as its sensor says.
pub(crate) fn of_load(m: &Motion, j: usize, e: &[f64]) -> Vec<Vec<f64>> {
    let mut out = of_reading(m, j, e);
    let acceleration = derivative(&derivative(e, m.segment.dt), m.segment.dt);
    out[j].iter_mut().zip(acceleration).for_each(|(out, a)| *out -= m.rotor[j] * a);
    out
}

/// Per unit of compliance of drive `j`'s transmission: the load stays behind by the effort that passes.
pub(crate) fn of_compliance(m: &Motion, j: usize) -> Vec<Vec<f64>> {
    let behind: Vec<f64> = m.transmitted[j].iter().map(|t| -t).collect();
    of_load(m, j, &behind)
}

/// Per unit of gap of drive `j`'s transmission: the load rests on one end of the play, on the side that passes the effort.
pub(crate) fn of_play(m: &Motion, j: usize) -> Vec<Vec<f64>> {
    let behind: Vec<f64> = side(&m.transmitted[j]).iter().map(|s| -0.5 * s).collect();
    of_load(m, j, &behind)
}

/// Per unit of compliance of the mounting: the ground is pushed away by the robot's reaction, and its acceleration is felt.
pub(crate) fn of_mounting(m: &Motion) -> Vec<Vec<f64>> {
    let dt = m.segment.dt;
    let away: Vec<Vec<f64>> = m.reaction.iter().map(|force| derivative(&derivative(force, dt), dt).iter().map(|a| -a).collect()).collect();
    (0..m.rigid.len())
        .map(|k| (0..m.segment.valid.len()).map(|i| (0..3).map(|axis| m.shaken[axis][k][i] * away[axis][i]).sum()).collect())
        .chain(m.channels.iter().map(|_| vec![0.0; m.segment.valid.len()]))
        .collect()
}

/// Sign of an effort, passing through zero over a twentieth of its rms: a gap is crossed, not jumped over.
pub(crate) fn side(effort: &[f64]) -> Vec<f64> {
    let width = 0.05 * math::sqrt(effort.iter().map(|t| t * t).sum::<f64>() / effort.len().max(1) as f64);
    effort.iter().map(|t| soft_sign(*t, width)).collect()
}
