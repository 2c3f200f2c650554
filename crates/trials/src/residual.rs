//! What a nominal robot leaves of a recording, and the generator's own measure of size: how far an effect stands out of the noise once
//! everything that the nominal robot could be refitted to is taken off.
//!
//! A zero-phase low-pass with a Gaussian kernel acts on efforts and on positions; residuals are forces on the free coordinates.

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
}

/// Gaussian smoothing of a series sampled every `dt`, with half power at `band` `[Hz]`; at both ends the kernel is cut.
#[must_use]
pub fn smooth(x: &[f64], dt: f64, band: f64) -> Vec<f64> {
    let sigma = LN_2.sqrt() / (TAU * band) / dt;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred samples")]
    let reach = (4.0 * sigma).ceil() as usize;
    let kernel: Vec<f64> = (0..=reach).map(|k| exp(-0.5 * (k as f64 / sigma) * (k as f64 / sigma))).collect();
    let at = |i: usize| {
        let (low, high) = (i.saturating_sub(reach), (i + reach).min(x.len() - 1));
        let mut sum = [0.0; 2];
        for (k, value) in x.iter().enumerate().take(high + 1).skip(low) {
            if value.is_finite() {
                let w = kernel[k.abs_diff(i)];
                sum = [sum[0] + w * value, sum[1] + w];
            }
        }
        if sum[1] > 0.0 { sum[0] / sum[1] } else { 0.0 }
    };
    (0..x.len()).map(at).collect()
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

/// Speed below which a sign is smoothed: a hundredth of the joint's highest speed.
fn soft(plant: &Plant, joint: usize) -> f64 {
    0.003 * plant.robot.joints[joint].speed
}

/// Force of the nominal friction on the free coordinates.
fn friction(plant: &Plant, m: &Moving) -> DVector<f64> {
    let mut tree = DVector::zeros(m.velocity.len());
    for (i, j) in plant.robot.joints.iter().enumerate() {
        let v = m.velocity[i];
        tree[i] = j.viscous * v + j.coulomb * tanh(v / soft(plant, i));
    }
    m.ratio.tr_mul(&tree)
}

/// What the nominal robot `plant` leaves of `recording`, a recording of `trace`, below `band` `[Hz]`.
///
/// The true pose serves to find the branch of the loops and the Jacobian of the readings; the motion itself comes from the readings.
///
/// # Errors
/// Where a loop opens.
pub fn residual(plant: &Plant, trace: &Trace, recording: &Recording, band: f64) -> Result<Residual, RobotError> {
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
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few samples")]
    let every = (1.0 / (2.5 * band * dt)).round().max(1.0) as usize;
    let mut left: Vec<Vec<f64>> = vec![Vec::with_capacity(n); d];
    let mut motion = Vec::new();
    // The cut kernel at both ends is left out.
    let is_row = |i: usize| i >= 4 * every && i + 4 * every < n && i.is_multiple_of(every);
    for i in 0..n {
        let mut q = closed[i].clone();
        plant.free.iter().enumerate().for_each(|(k, &j)| q[j] = free[k][i]);
        let v: Vec<f64> = rate.iter().map(|x| x[i]).collect();
        let a = DVector::from_iterator(d, push.iter().map(|x| x[i]));
        let m = plant.moving(&mut q, &v)?;
        let measured = drive_ratio(plant, &m).tr_mul(&DVector::from_column_slice(&recording.tau[i]));
        let rest = measured - &m.mass * &a - &m.bias - friction(plant, &m);
        left.iter_mut().zip(rest.iter()).for_each(|(x, r)| x.push(*r));
        if is_row(i) {
            motion.push((m, a));
        }
    }
    // Effort and model go through one filter: signs of velocities are then as soft on one side as on the other.
    let left: Vec<Vec<f64>> = left.iter().map(|x| smooth(x, dt, band)).collect();
    let rows = (0..n).filter(|i| is_row(*i)).map(|i| DVector::from_iterator(d, left.iter().map(|x| x[i]))).collect();
    Ok(Residual { rows, motion })
}

impl Residual {
    /// This minus another of the same length.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Vec<DVector<f64>> {
        self.rows.iter().zip(&other.rows).map(|(a, b)| a - b).collect()
    }

    /// Columns that a refit of the nominal robot can use: ten numbers per link, and the frictions that it has.
    #[must_use]
    pub fn basis(&self, plant: &Plant) -> Vec<DMatrix<f64>> {
        self.motion.iter().map(|(m, a)| basis_row(plant, m, a)).collect()
    }
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
            columns.push(&through * tanh(v / soft(plant, d.joint)));
        }
    }
    DMatrix::from_columns(&columns)
}

/// Noise per free coordinate, and the directions that a refit takes away.
#[derive(Debug, Clone)]
pub struct Ruler {
    /// Standard deviation of the residual's noise per free coordinate.
    pub noise: DVector<f64>,
    basis: Vec<DMatrix<f64>>,
    /// Inverse Gram matrix of the weighted basis over what is well determined.
    inverse: DMatrix<f64>,
}

impl Ruler {
    /// From residuals of the healthy robot with and without noise.
    #[must_use]
    pub fn new(plant: &Plant, noisy: &[Residual], silent: &[Residual]) -> Self {
        let d = plant.freedoms();
        let mut sum = DVector::zeros(d);
        let mut count = 0.0;
        for (a, b) in noisy.iter().zip(silent) {
            for e in a.minus(b) {
                sum += e.component_mul(&e);
                count += 1.0;
            }
        }
        let noise = sum.map(|s: f64| (s / f64::max(count, 1.0)).sqrt().max(1e-12));
        let basis: Vec<DMatrix<f64>> = silent.iter().flat_map(|r| r.basis(plant)).collect();
        let inverse = pseudo_inverse(&gram(&basis, &noise));
        Self { noise, basis, inverse }
    }

    /// Length of a column over the noise: all of it, and what is left beside the basis.
    #[must_use]
    pub fn lengths(&self, column: &[DVector<f64>]) -> [f64; 2] {
        let mut all = 0.0;
        let mut on_basis = DVector::zeros(self.inverse.nrows());
        for (y, b) in column.iter().zip(&self.basis) {
            let weighted = y.component_div(&self.noise);
            all += weighted.norm_squared();
            on_basis += b.tr_mul(&weighted.component_div(&self.noise));
        }
        let taken = on_basis.dot(&(&self.inverse * &on_basis));
        [all.sqrt(), (all - taken).max(0.0).sqrt()]
    }
}

/// Sum of BᵀS⁻²B over rows.
#[must_use]
pub fn gram(basis: &[DMatrix<f64>], noise: &DVector<f64>) -> DMatrix<f64> {
    let n = basis.first().map_or(0, DMatrix::ncols);
    let mut out = DMatrix::zeros(n, n);
    for b in basis {
        let mut weighted = b.clone();
        weighted.row_iter_mut().zip(noise.iter()).for_each(|(mut r, s)| r /= *s);
        out += weighted.tr_mul(&weighted);
    }
    out
}

/// Inverse over the directions whose eigenvalue, columns scaled to one, is above 1e-7 of the largest.
fn pseudo_inverse(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let n = gram.nrows();
    let scale = DVector::from_fn(n, |i, _| if gram[(i, i)] > 0.0 { 1.0 / gram[(i, i)].sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(n, n, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let mut out = DMatrix::zeros(n, n);
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > 1e-7 * largest {
            out += vector * vector.transpose() / *value;
        }
    }
    DMatrix::from_fn(n, n, |i, j| out[(i, j)] * scale[i] * scale[j])
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

    #[test]
    fn a_column_of_the_basis_has_nothing_left_and_one_beside_it_everything() {
        let angle = |i: i32| f64::from(i) * 0.1;
        let basis: Vec<DMatrix<f64>> = (0..630).map(|i| DMatrix::from_element(1, 1, crate::math::sin(angle(i)))).collect();
        let noise = DVector::from_element(1, 2.0);
        let ruler = Ruler { inverse: pseudo_inverse(&gram(&basis, &noise)), noise, basis: basis.clone() };
        let inside: Vec<DVector<f64>> = basis.iter().map(|b| DVector::from_element(1, 3.0 * b[(0, 0)])).collect();
        let beside: Vec<DVector<f64>> = (0..630).map(|i| DVector::from_element(1, crate::math::cos(angle(i)))).collect();
        let [all, left] = ruler.lengths(&inside);
        assert!(left < 1e-6 * all);
        let [all, left] = ruler.lengths(&beside);
        assert!((left / all - 1.0).abs() < 1e-3);
        // Closed form: √(Σcos²)/σ = √(315)/2.
        assert!((all - 315.0_f64.sqrt() / 2.0).abs() < 0.05, "{all}");
    }
}
