//! What a nominal robot leaves of a recording, and the columns that a refit of it can use.
//!
//! A zero-phase low-pass with a Gaussian kernel acts on efforts, on the model and on the columns of a refit alike; residuals are forces on
//! the free coordinates.

use core::f64::consts::{LN_2, TAU};

use nalgebra::{DMatrix, DVector};

use crate::machine::Trace;
use crate::math::{exp, tanh};
use crate::plant::{Moving, Plant};
use crate::reference::drive_ratio;
use crate::robot::RobotError;
use crate::sensing::Recording;

/// Frequency at which the low-pass of the ruler halves the power `[Hz]`.
pub const BAND: f64 = 10.0;

/// Positions are differentiated below this frequency at least `[Hz]`: signs of velocities want sharp reversals.
const MOTION_BAND: f64 = 30.0;

/// Filtered residuals and the motion they belong to, at 2.5 samples per period of the band.
#[derive(Debug, Clone)]
pub struct Residual {
    /// Residual force per row and free coordinate.
    pub rows: Vec<DVector<f64>>,
    /// Motion of the nominal robot at the rows.
    pub motion: Vec<(Moving, DVector<f64>)>,
    /// Whether each drive stands or turns round within the filter's reach of the row: dry friction is then whatever holds it.
    pub still: Vec<Vec<bool>>,
}

/// A Gaussian low-pass; at both ends of a series the kernel is cut.
struct Smoother {
    weights: Vec<f64>,
}

impl Smoother {
    /// Half power at `band` `[Hz]` for samples every `dt` `[s]`.
    fn new(dt: f64, band: f64) -> Self {
        let sigma = LN_2.sqrt() / (TAU * band) / dt;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred samples")]
        let reach = (4.0 * sigma).ceil() as usize;
        Self { weights: (0..=reach).map(|k| exp(-0.5 * (k as f64 / sigma) * (k as f64 / sigma))).collect() }
    }

    /// Sample `i` of the smoothed series; what is not finite is passed over.
    fn at(&self, x: &[f64], i: usize) -> f64 {
        let reach = self.weights.len() - 1;
        let (low, high) = (i.saturating_sub(reach), (i + reach).min(x.len() - 1));
        let mut sum = [0.0; 2];
        for (k, value) in (low..=high).zip(&x[low..=high]) {
            if value.is_finite() {
                let w = self.weights[k.abs_diff(i)];
                sum = [sum[0] + w * value, sum[1] + w];
            }
        }
        if sum[1] > 0.0 { sum[0] / sum[1] } else { 0.0 }
    }
}

/// Gaussian smoothing of a series sampled every `dt` `[s]`, with half power at `band` `[Hz]`; at both ends the kernel is cut.
#[must_use]
pub fn smooth(x: &[f64], dt: f64, band: f64) -> Vec<f64> {
    let smoother = Smoother::new(dt, band);
    (0..x.len()).map(|i| smoother.at(x, i)).collect()
}

/// Derivative by fourth-order central differences; at both ends the nearest value.
fn derivative(x: &[f64], dt: f64) -> Vec<f64> {
    let n = x.len();
    let at = |i: usize| {
        let i = i.clamp(2, n - 3);
        (8.0 * (x[i + 1] - x[i - 1]) - (x[i + 2] - x[i - 2])) / (12.0 * dt)
    };
    (0..n).map(at).collect()
}

/// Speed at which friction of a joint without a drive has turned over, as a share of the joint's highest.
pub(crate) const FADES: f64 = 0.01;

/// Share of a joint's dry friction that acts at speed `v`, with its sign.
///
/// It turns over as the true robot's does: a fit whose sign is softer or sharper puts the difference into damping, and the robot that it hands over is then
/// wrong in numbers that nobody meant to conceal.
fn direction(plant: &Plant, joint: usize, v: f64) -> f64 {
    plant.turns[joint].map_or_else(|| tanh(v / (FADES * plant.robot.joints[joint].speed)), |dry| dry.direction(v))
}

/// Force of the nominal friction on the free coordinates.
fn friction(plant: &Plant, m: &Moving) -> DVector<f64> {
    let mut tree = DVector::zeros(m.velocity.len());
    for (i, j) in plant.robot.joints.iter().enumerate() {
        let v = m.velocity[i];
        tree[i] = j.viscous * v + j.coulomb * direction(plant, i, v);
    }
    m.ratio.tr_mul(&tree)
}

/// Samples of a recording that become rows: 2.5 per period of the band, without both ends, where the kernel is cut.
fn is_row(i: usize, n: usize, dt: f64, band: f64) -> bool {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few samples")]
    let every = (1.0 / (2.5 * band * dt)).round().max(1.0) as usize;
    i >= 4 * every && i + 4 * every < n && i.is_multiple_of(every)
}

/// Visits every sample of `recording`, a recording of `trace`, with the motion of the nominal robot `plant` and the accelerations of its
/// free coordinates.
///
/// The true pose serves to find the branch of the loops and the Jacobian of the readings; the motion itself comes from the readings.
fn walk(
    plant: &Plant,
    (trace, recording): (&Trace, &Recording),
    band: f64,
    mut visit: impl FnMut(usize, Moving, DVector<f64>),
) -> Result<(), RobotError> {
    let (n, d) = (recording.t.len(), plant.freedoms());
    let dt = recording.t[1] - recording.t[0];
    let mut free: Vec<Vec<f64>> = vec![Vec::with_capacity(n); d];
    let mut closed = Vec::with_capacity(n);
    for i in 0..n {
        let mut q = trace.truth[i].clone();
        let m = plant.moving(&mut q, &vec![0.0; d])?;
        let ratio = drive_ratio(plant, &m);
        let gap = DVector::from_iterator(
            recording.q[i].len(),
            plant.robot.drives.iter().enumerate().map(|(k, drive)| recording.q[i][k] - q[drive.joint]),
        );
        let normal = ratio.tr_mul(&ratio).cholesky().ok_or_else(|| RobotError::Unknown("drives that do not tell the pose".to_string()))?;
        let shift = normal.solve(&ratio.tr_mul(&gap));
        free.iter_mut().enumerate().for_each(|(k, x)| x.push(q[plant.free[k]] + shift[k]));
        closed.push(q);
    }
    let free: Vec<Vec<f64>> = free.iter().map(|x| smooth(x, dt, MOTION_BAND.max(band))).collect();
    let rate: Vec<Vec<f64>> = free.iter().map(|x| derivative(x, dt)).collect();
    let push: Vec<Vec<f64>> = rate.iter().map(|x| derivative(x, dt)).collect();
    for i in 0..n {
        let mut q = closed[i].clone();
        plant.free.iter().enumerate().for_each(|(k, &j)| q[j] = free[k][i]);
        let v: Vec<f64> = rate.iter().map(|x| x[i]).collect();
        visit(i, plant.moving(&mut q, &v)?, DVector::from_iterator(d, push.iter().map(|x| x[i])));
    }
    Ok(())
}

/// What the nominal robot `plant` leaves of `recording`, a recording of `trace`, below `band` `[Hz]`.
///
/// # Errors
/// Where a loop opens.
pub fn residual(plant: &Plant, trace: &Trace, recording: &Recording, band: f64) -> Result<Residual, RobotError> {
    let (n, d) = (recording.t.len(), plant.freedoms());
    let dt = recording.t[1] - recording.t[0];
    let mut left: Vec<Vec<f64>> = vec![Vec::with_capacity(n); d];
    let mut motion = Vec::new();
    let mut speed = vec![Vec::with_capacity(n); plant.robot.drives.len()];
    walk(plant, (trace, recording), band, |i, m, a| {
        plant.robot.drives.iter().zip(&mut speed).for_each(|(d, speed)| speed.push(m.velocity[d.joint]));
        let measured = drive_ratio(plant, &m).tr_mul(&DVector::from_column_slice(&recording.tau[i]));
        let rest = measured - &m.mass * &a - &m.bias - friction(plant, &m);
        left.iter_mut().zip(rest.iter()).for_each(|(x, r)| x.push(*r));
        if is_row(i, n, dt, band) {
            motion.push((m, a));
        }
    })?;
    // Effort and model go through one filter: signs of velocities are then as soft on one side as on the other.
    let smoother = Smoother::new(dt, band);
    let row = |i: usize| DVector::from_iterator(d, left.iter().map(|x| smoother.at(x, i)));
    let slow: Vec<Vec<bool>> = speed.iter().map(|v| slow(v)).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few samples")]
    let reach = (0.5 / (band * dt)).ceil() as usize;
    let near = |i: usize| slow.iter().map(|s| s[i.saturating_sub(reach)..(i + reach + 1).min(n)].contains(&true)).collect();
    let rows: Vec<usize> = (0..n).filter(|i| is_row(*i, n, dt, band)).collect();
    Ok(Residual { rows: rows.iter().map(|&i| row(i)).collect(), motion, still: rows.into_iter().map(near).collect() })
}

/// Speed at which a drive stands, as a share of the root mean square of its speed.
const STANDS: f64 = 0.02;

/// At which samples a drive stands or turns round.
fn slow(speed: &[f64]) -> Vec<bool> {
    let rms = (speed.iter().map(|v| v * v).sum::<f64>() / speed.len().max(1) as f64).sqrt();
    speed.iter().map(|v| v.abs() <= STANDS * rms).collect()
}

impl Residual {
    /// This minus another of the same length.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Vec<DVector<f64>> {
        self.rows.iter().zip(&other.rows).map(|(a, b)| a - b).collect()
    }
}

/// Columns that a refit of the nominal robot can use, at the rows of [`residual`]: ten numbers per link, and the frictions that it has.
///
/// They are built at the rate of the recording and then go through the filter of the residual: a sign that is sharp on one side and smooth on
/// the other would leave something at every reversal that no refit could take.
///
/// # Errors
/// Where a loop opens.
pub fn basis(plant: &Plant, trace: &Trace, recording: &Recording, band: f64) -> Result<Vec<DMatrix<f64>>, RobotError> {
    let (n, d) = (recording.t.len(), plant.freedoms());
    let dt = recording.t[1] - recording.t[0];
    // One series per entry of the matrix, in its own order.
    let mut series: Vec<Vec<f64>> = Vec::new();
    walk(plant, (trace, recording), band, |i, m, a| {
        let row = basis_row(plant, &m, &a);
        series.resize(row.len(), vec![0.0; n]);
        series.iter_mut().zip(row.iter()).for_each(|(x, value)| x[i] = *value);
    })?;
    let smoother = Smoother::new(dt, band);
    let row = |i: usize| DMatrix::from_iterator(d, series.len() / d, series.iter().map(|x| smoother.at(x, i)));
    Ok((0..n).filter(|i| is_row(*i, n, dt, band)).map(row).collect())
}

fn basis_row(plant: &Plant, m: &Moving, a: &DVector<f64>) -> DMatrix<f64> {
    let inertia = plant.inertia_columns(m, a);
    let mut columns: Vec<DVector<f64>> = inertia.column_iter().map(|c| c.into_owned()).collect();
    for d in &plant.robot.drives {
        let (v, j) = (m.velocity[d.joint], &plant.robot.joints[d.joint]);
        let through = m.ratio.row(d.joint).transpose();
        if j.viscous > 0.0 {
            columns.push(&through * v);
        }
        if j.coulomb > 0.0 {
            columns.push(&through * direction(plant, d.joint, v));
        }
    }
    DMatrix::from_columns(&columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_low_pass_halves_the_power_at_its_band_and_keeps_the_phase() {
        let dt = 2e-3;
        let x: Vec<f64> = (0..4000).map(|i| crate::math::sin(TAU * 10.0 * f64::from(i) * dt)).collect();
        let y = smooth(&x, dt, 10.0);
        let amplitude = y[1000..3000].iter().copied().fold(0.0, f64::max);
        assert!((amplitude - 0.5_f64.sqrt()).abs() < 0.01, "{amplitude}");
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (xy, xx) = (product(&x[1000..3000], &y[1000..3000]), product(&x[1000..3000], &x[1000..3000]));
        assert!((xy / xx - amplitude).abs() < 0.01, "in phase");
    }
}
