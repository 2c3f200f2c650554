//! Concealment: the nominal robot refitted to the corrupted recordings before it is handed over, by a regressor of its own.

use nalgebra::{DMatrix, DVector};

use crate::machine::Trace;
use crate::plant::Plant;
use crate::reference::drive_ratio;
use crate::residual::{BAND, Residual, basis, residual};
use crate::robot::{Inertia, Robot, RobotError};
use crate::ruler::gram;
use crate::sensing::Recording;

/// Weights of the prior that are tried: standard deviation of 30 % at weight 1.
const PRIORS: [f64; 4] = [0.01, 0.1, 1.0, 10.0];

/// Smallest second moment of a refitted body over its largest.
const SOLID: f64 = 1e-4;

/// Refits `nominal` to the recordings: inertias of all links, viscous and Coulomb friction where it has them.
///
/// Least squares with a prior on the given values; of several weights of the prior the one that leaves least after every body has been
/// made one that can exist. `noise` is the standard deviation per free coordinate.
///
/// # Errors
/// Where a loop opens.
pub fn refit(nominal: &Plant, taken: &[(&Trace, &Recording)], noise: &DVector<f64>) -> Result<Robot, RobotError> {
    let measure = |plant: &Plant| taken.iter().map(|(t, r)| residual(plant, t, r, BAND)).collect::<Result<Vec<Residual>, RobotError>>();
    let before = measure(nominal)?;
    let mut columns: Vec<DMatrix<f64>> = Vec::new();
    for (trace, recording) in taken {
        columns.extend(basis(nominal, trace, recording, BAND)?);
    }
    let normal = gram(&columns, noise);
    let mut right = DVector::zeros(normal.nrows());
    for (b, y) in columns.iter().zip(before.iter().flat_map(|r| &r.rows)) {
        right += b.tr_mul(&y.component_div(noise).component_div(noise));
    }
    let scale = scales(nominal);
    let mut best = (size(&before, noise), nominal.robot.clone());
    for prior in PRIORS {
        let ridge = DMatrix::from_diagonal(&scale.map(|s| prior / (0.3 * s * 0.3 * s)));
        let Some(change) = (&normal + ridge).cholesky().map(|c| c.solve(&right)) else { continue };
        let robot = changed(nominal, &change);
        let plant = nominal.weighing(robot.clone());
        let left = size(&measure(&plant)?, noise);
        if left < best.0 {
            best = (left, robot);
        }
    }
    Ok(best.1)
}

fn size(residuals: &[Residual], noise: &DVector<f64>) -> f64 {
    residuals.iter().flat_map(|r| &r.rows).map(|y| y.component_div(noise).norm_squared()).sum()
}

/// How large each parameter is, per column of the basis.
fn scales(plant: &Plant) -> DVector<f64> {
    let mut out = Vec::new();
    for i in plant.weighty() {
        let body = &plant.robot.joints[i].inertia;
        let reach = (body.tensor.trace() / (2.0 * body.mass)).sqrt().max(0.05);
        let is_point = body.central().trace() <= 1e-12;
        out.push(body.mass);
        out.extend([body.mass * reach; 3]);
        // A point of mass stays nearly one.
        out.extend([body.mass * reach * reach * if is_point { 1e-3 } else { 1.0 }; 6]);
    }
    for d in &plant.robot.drives {
        let j = &plant.robot.joints[d.joint];
        out.extend([j.viscous, j.coulomb].into_iter().filter(|x| *x > 0.0));
    }
    DVector::from_vec(out)
}

fn changed(plant: &Plant, change: &DVector<f64>) -> Robot {
    let mut robot = plant.robot.clone();
    let mut at = 0;
    for i in plant.weighty() {
        let body = &mut robot.joints[i].inertia;
        let mut numbers = body.numbers();
        numbers.iter_mut().zip(change.as_slice()[at..at + 10].iter()).for_each(|(x, c)| *x += c);
        numbers[0] = numbers[0].max(0.1 * body.mass);
        *body = possible(&Inertia::from_numbers(&numbers));
        at += 10;
    }
    for d in &plant.robot.drives {
        let j = &mut robot.joints[d.joint];
        for x in [&mut j.viscous, &mut j.coulomb].into_iter().filter(|x| **x > 0.0) {
            *x = (*x + change[at]).max(0.05 * *x);
            at += 1;
        }
    }
    robot
}

/// The nearest body that can exist: negative second moments about the centre become small positive ones.
fn possible(body: &Inertia) -> Inertia {
    if body.solidity() >= SOLID {
        return *body;
    }
    let central = body.central();
    let second = nalgebra::Matrix3::identity() * (central.trace() / 2.0) - central;
    let eigen = second.symmetric_eigen();
    let floor = SOLID * eigen.eigenvalues.max().max(1e-6 * body.mass);
    let values = eigen.eigenvalues.map(|x| x.max(floor));
    let second = eigen.eigenvectors * nalgebra::Matrix3::from_diagonal(&values) * eigen.eigenvectors.transpose();
    let central = nalgebra::Matrix3::identity() * second.trace() - second;
    Inertia::about_centre(body.mass, body.centre(), central)
}

/// Share of the measured effort that the model `plant` leaves of a recording, below each of `bands` `[Hz]`.
///
/// Per drive the root mean square of the residual over that of the effort, then the root mean square over drives.
///
/// # Errors
/// Where a loop opens.
pub fn left_share(plant: &Plant, trace: &Trace, recording: &Recording, bands: &[f64]) -> Result<Vec<[f64; 2]>, RobotError> {
    let drives = plant.robot.drives.len();
    let rows = recording.tau.len() as f64;
    let effort: Vec<f64> = (0..drives).map(|k| recording.tau.iter().map(|r| r[k] * r[k]).sum::<f64>() / rows).collect();
    let mut out = Vec::new();
    for &band in bands {
        let left = residual(plant, trace, recording, band)?;
        let mut squares = vec![0.0; drives];
        for (e, (m, _)) in left.rows.iter().zip(&left.motion) {
            let Some(u) = crate::reference::efforts(&drive_ratio(plant, m), e) else { continue };
            squares.iter_mut().zip(u.iter()).for_each(|(s, u)| *s += u * u);
        }
        let count = left.rows.len().max(1) as f64;
        let mean = squares.iter().zip(&effort).map(|(s, t)| s / count / t.max(1e-12)).sum::<f64>() / drives as f64;
        out.push([band, mean.sqrt()]);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn an_impossible_body_becomes_a_possible_one_with_the_same_mass_and_centre() {
        let central = Matrix3::from_diagonal(&Vector3::new(1.0, 0.1, 0.1));
        let body = Inertia::about_centre(2.0, Vector3::new(0.1, 0.0, 0.2), central);
        assert!(body.solidity() < 0.0);
        let made = possible(&body);
        assert!(made.solidity() > 0.0 && (made.mass - 2.0).abs() < 1e-12 && (made.centre() - body.centre()).norm() < 1e-12);
    }
}
