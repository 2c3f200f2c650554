//! Concealment: the nominal robot refitted to the corrupted recordings before it is handed over, by a regressor of its own.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Vector4};

use crate::machine::Trace;
use crate::plant::{Moving, Plant};
use crate::reference::drive_ratio;
use crate::residual::{BAND, Residual, basis, residual};
use crate::robot::{Inertia, Robot, RobotError};
use crate::sensing::Recording;

/// Weights of the prior that are tried: standard deviation of 30 % at weight 1.
const PRIORS: [f64; 4] = [0.01, 0.1, 1.0, 10.0];

/// Smallest second moment of a refitted body over its largest.
const SOLID: f64 = 1e-4;

/// Turns of the splitting between the fit and bodies that can exist.
const TURNS: usize = 200;

/// Refits `nominal` to the recordings: inertias of all links, viscous and Coulomb friction where it has them.
///
/// Least squares with a prior on the given values, among bodies that can exist; of several weights of the prior the one that leaves least.
/// `noise` is the standard deviation per free coordinate.
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
    let told: Vec<DMatrix<f64>> = before.iter().flat_map(|r| told(nominal, r, noise)).collect();
    let (mut normal, mut right) = (DMatrix::zeros(columns[0].ncols(), columns[0].ncols()), DVector::zeros(columns[0].ncols()));
    for ((b, p), y) in columns.iter().zip(&told).zip(before.iter().flat_map(|r| &r.rows)) {
        let b = p * b;
        normal += b.tr_mul(&b);
        right += b.tr_mul(&(p * y));
    }
    let scale = scales(nominal);
    let mut best = (size(&before, &told), nominal.robot.clone());
    for prior in PRIORS {
        let robot = changed(nominal, &possible_fit(nominal, (&normal, &right), &scale, prior));
        let plant = nominal.weighing(robot.clone());
        let left = size(&measure(&plant)?, &told);
        if left < best.0 {
            best = (left, robot);
        }
    }
    Ok(best.1)
}

/// For each row what a force on the free coordinates says in units of `noise`, whatever holds the drives that stand there. No identification would
/// fit a friction to them.
fn told(plant: &Plant, residual: &Residual, noise: &DVector<f64>) -> Vec<DMatrix<f64>> {
    let one = |((m, _), still): (&(Moving, DVector<f64>), &Vec<bool>)| {
        let standing: Vec<usize> = (0..still.len()).filter(|&k| still[k]).collect();
        let mut held = drive_ratio(plant, m).select_rows(&standing).transpose();
        held.row_iter_mut().zip(noise.iter()).for_each(|(mut r, s)| r /= *s);
        let mut square = held.tr_mul(&held);
        let ridge = 1e-9 * square.trace();
        (0..standing.len()).for_each(|k| square[(k, k)] += ridge);
        let all = DMatrix::from_diagonal(&noise.map(|s| 1.0 / s));
        match square.cholesky() {
            Some(c) if !standing.is_empty() => &all - &held * c.solve(&held.tr_mul(&all)),
            _ => all,
        }
    };
    residual.motion.iter().zip(&residual.still).map(one).collect()
}

fn size(residuals: &[Residual], told: &[DMatrix<f64>]) -> f64 {
    residuals.iter().flat_map(|r| &r.rows).zip(told).map(|(y, p)| (p * y).norm_squared()).sum()
}

/// Changes of the parameters that leave least with a weight of the prior, among bodies that can exist: the alternating direction method of
/// multipliers between the least squares and the bodies, in units of `scale`. Least squares first and bodies afterwards would hand over a robot that no
/// identification would.
fn possible_fit(nominal: &Plant, (normal, right): (&DMatrix<f64>, &DVector<f64>), scale: &DVector<f64>, prior: f64) -> DVector<f64> {
    let n = scale.len();
    let units = DMatrix::from_diagonal(scale);
    let square = &units * normal * &units + DMatrix::identity(n, n) * (prior / (0.3 * 0.3));
    let linear = right.component_mul(scale);
    // Geometric mean of what is stiff and what is soft: neither side waits for the other.
    let eigen = square.clone().symmetric_eigen().eigenvalues;
    let pull = eigen.max() * (eigen.min() / eigen.max()).max(1e-9).sqrt();
    let Some(factor) = (square + DMatrix::identity(n, n) * pull).cholesky() else { return DVector::zeros(n) };
    let (mut z, mut u) = (DVector::zeros(n), DVector::zeros(n));
    for _ in 0..TURNS {
        let x = factor.solve(&(&linear + (&z - &u) * pull));
        z = changes(nominal, &changed(nominal, &(&x + &u).component_mul(scale))).component_div(scale);
        u += x - &z;
    }
    z.component_mul(scale)
}

/// How large each parameter is, per column of the basis.
fn scales(plant: &Plant) -> DVector<f64> {
    let mut out = Vec::new();
    for i in plant.weighty() {
        let body = &plant.robot.joints[i].inertia;
        let reach = reach(body);
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
        *body = possible(&Inertia::from_numbers(&numbers), body);
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

/// What makes `robot` of `plant`, in the order of its basis.
fn changes(plant: &Plant, robot: &Robot) -> DVector<f64> {
    let mut out = Vec::new();
    for i in plant.weighty() {
        let [to, from] = [robot, &plant.robot].map(|r| r.joints[i].inertia.numbers());
        out.extend(to.iter().zip(&from).map(|(a, b)| a - b));
    }
    for d in &plant.robot.drives {
        let (to, from) = (&robot.joints[d.joint], &plant.robot.joints[d.joint]);
        out.extend([(to.viscous, from.viscous), (to.coulomb, from.coulomb)].into_iter().filter(|x| x.1 > 0.0).map(|(a, b)| a - b));
    }
    DVector::from_vec(out)
}

/// The nearest body that can exist, in units of `given`: masses, first and second moments in one matrix, which is positive definite exactly where some
/// distribution of mass has them; its eigenvalues are kept above [`SOLID`]. Nor does it lose more than nine tenths of its mass.
fn possible(body: &Inertia, given: &Inertia) -> Inertia {
    let reach = reach(given);
    let unit = Vector4::new(reach, reach, reach, 1.0) * given.mass.sqrt();
    let second = Matrix3::identity() * (body.tensor.trace() / 2.0) - body.tensor;
    let mut all = Matrix4::zeros();
    all.fixed_view_mut::<3, 3>(0, 0).copy_from(&second);
    all.fixed_view_mut::<3, 1>(0, 3).copy_from(&body.moment);
    all.fixed_view_mut::<1, 3>(3, 0).copy_from(&body.moment.transpose());
    all[(3, 3)] = body.mass;
    let eigen = Matrix4::from_fn(|i, j| all[(i, j)] / (unit[i] * unit[j])).symmetric_eigen();
    if eigen.eigenvalues.min() < SOLID {
        let raised = Matrix4::from_diagonal(&eigen.eigenvalues.map(|x| x.max(SOLID)));
        let near = eigen.eigenvectors * raised * eigen.eigenvectors.transpose();
        all = Matrix4::from_fn(|i, j| near[(i, j)] * unit[i] * unit[j]);
    }
    let second = all.fixed_view::<3, 3>(0, 0).into_owned();
    let tensor = Matrix3::identity() * second.trace() - second;
    Inertia { mass: all[(3, 3)].max(0.1 * given.mass), moment: all.fixed_view::<3, 1>(0, 3).into_owned(), tensor }
}

/// How far a body's mass lies from its joint, at least five centimetres.
fn reach(body: &Inertia) -> f64 {
    (body.tensor.trace() / (2.0 * body.mass)).sqrt().max(0.05)
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

    use crate::base::Base;
    use crate::case::{Level, Wish};
    use crate::random::Stream;
    use crate::sensing::Noise;

    /// A robot of L7 that lacks nothing, and two recordings of it with noise of a hundredth.
    fn recorded(number: u64, robot: &str) -> (Base, Vec<(Trace, Recording)>) {
        let wish = Wish { number, seed: 7001, level: Level::L7, robot: robot.into(), size: 1.0, noise: 1.0, recordings: 2, effect: None };
        let base = Base::new(&wish).unwrap();
        let (mut paths, mut sensors) = (Stream::new(1, number, "paths"), Stream::new(1, number, "sensors"));
        let traces: Vec<Trace> = (0..2).map(|r| base.followed(r, &mut paths).unwrap().1).collect();
        let mean = |k: usize| traces[0].effort.iter().map(|r| r[k] * r[k]).sum::<f64>() / traces[0].effort.len() as f64;
        let spread: Vec<f64> = (0..base.plant.robot.drives.len()).map(|k| mean(k).sqrt()).collect();
        let noise = Noise::typical(&base.plant.robot, &spread, 0.01, false);
        let taken: Vec<Recording> = traces.iter().map(|t| noise.record(t, &mut sensors)).collect();
        (base, traces.into_iter().zip(taken).collect())
    }

    #[test]
    fn frictions_of_a_robot_that_lacks_nothing_come_out_as_they_are() {
        for number in [7, 19] {
            let (base, pairs) = recorded(number, "ups3_rpu1");
            let pairs: Vec<(&Trace, &Recording)> = pairs.iter().map(|(t, r)| (t, r)).collect();
            let robot = refit(&base.plant, &pairs, &DVector::from_element(base.plant.freedoms(), 0.4)).unwrap();
            for d in &robot.drives {
                let (is, should) = (&robot.joints[d.joint], &base.machine.plant.robot.joints[d.joint]);
                assert!((is.viscous / should.viscous - 1.0).abs() < 0.03, "{}: {} for {}", is.name, is.viscous, should.viscous);
                assert!((is.coulomb / should.coulomb - 1.0).abs() < 0.01, "{}: {} for {}", is.name, is.coulomb, should.coulomb);
            }
        }
    }

    #[test]
    fn an_impossible_body_becomes_a_possible_one_near_it_and_a_possible_one_stays() {
        let given = Inertia::about_centre(2.0, Vector3::new(0.1, 0.0, 0.2), Matrix3::from_diagonal(&Vector3::new(0.02, 0.02, 0.02)));
        let same = possible(&given, &given);
        assert!(same.numbers().iter().zip(&given.numbers()).all(|(a, b)| (a - b).abs() < 1e-12));
        let thin = Inertia::about_centre(2.0, Vector3::new(0.1, 0.0, 0.2), Matrix3::from_diagonal(&Vector3::new(1.0, 0.1, 0.1)));
        assert!(thin.solidity() < 0.0);
        let made = possible(&thin, &given);
        assert!(made.solidity() > 0.0, "{}", made.solidity());
        // To be nearest is to be left where it is by a second turn, and to be no farther than the body it was compared with.
        let apart = |a: &Inertia, b: &Inertia| a.numbers().iter().zip(&b.numbers()).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        assert!(apart(&possible(&made, &given), &made) < 1e-20 && apart(&made, &thin) < apart(&given, &thin));
        let light = Inertia { mass: -1.0, ..given };
        assert!(possible(&light, &given).mass >= 0.2 && possible(&light, &given).solidity() > 0.0);
    }

    #[test]
    fn a_refit_of_every_robot_has_numbers_and_leaves_less() {
        for (number, robot) in ["prs3", "motobotte", "serial_arm", "five_bar", "ups4"].into_iter().enumerate() {
            let (base, pairs) = recorded(number as u64, robot);
            let pairs: Vec<(&Trace, &Recording)> = pairs.iter().map(|(t, r)| (t, r)).collect();
            let noise = DVector::from_element(base.plant.freedoms(), 0.1);
            let robot = refit(&base.plant, &pairs, &noise).unwrap();
            let left = |robot: &Robot| {
                let plant = base.plant.weighing(robot.clone());
                let of = |(t, r): &(&Trace, &Recording)| {
                    let left = residual(&plant, t, r, BAND).unwrap();
                    size(core::slice::from_ref(&left), &told(&plant, &left, &noise))
                };
                pairs.iter().map(of).sum::<f64>()
            };
            assert!(robot.joints.iter().all(|j| j.inertia.numbers().iter().all(|x| x.is_finite()) && j.viscous.is_finite()));
            let [given, fitted, truth] = [&base.plant.robot, &robot, &base.machine.plant.robot].map(left);
            assert!(fitted < given && fitted < 1.1 * truth, "{}: {given} as given, {fitted} refitted, {truth} true", robot.name);
        }
    }
}
