//! The algorithms of the spanning tree and of closed-loop dynamics, sample by sample; arrays row by row, as numpy wants them.

use nalgebra::{DMatrix, Matrix3xX, Matrix6xX, Vector3};
use pkm_dyn::constrained::Stabilisation;
use pkm_dyn::jacobian::Reference;
use pkm_dyn::loops::{Choice, Output, coordinates, output_jacobian};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::parameters::N_INERTIAL;
use pkm_dyn::{Data, Model, aba, configuration, constrained, crba, energy, inverse_dynamics, jacobian, kinematics, loops, regressor, rnea};

use crate::array::Samples;
use crate::motion::{Open, checked};

/// Appends what `each` returns for every sample of the tree's positions.
fn at_each(model: &Model, q: &Samples, mut each: impl FnMut(&mut Data, &[f64], &mut Vec<f64>)) -> Vec<f64> {
    let mut data = Data::new(model);
    let mut out = Vec::new();
    for i in 0..q.len() {
        each(&mut data, q.row(i), &mut out);
    }
    out
}

/// The same with velocities.
fn along(model: &Model, [q, v]: [&Samples; 2], mut each: impl FnMut(&mut Data, [&[f64]; 2], &mut Vec<f64>)) -> Vec<f64> {
    let mut data = Data::new(model);
    let mut out = Vec::new();
    for i in 0..q.len() {
        each(&mut data, [q.row(i), v.row(i)], &mut out);
    }
    out
}

/// Mass matrices of the tree, `n_samples × nv × nv`.
pub(crate) fn mass_matrices(model: &Model, q: &Samples) -> Vec<f64> {
    at_each(model, q, |data, q, out| push_rows(out, crba::crba(model, data, q)))
}

/// Efforts against gravity, `n_samples × nv`.
pub(crate) fn gravity(model: &Model, q: &Samples) -> Vec<f64> {
    at_each(model, q, |data, q, out| out.extend_from_slice(rnea::generalized_gravity(model, data, q)))
}

/// Coriolis, centrifugal and gravity efforts, `n_samples × nv`.
pub(crate) fn nle(model: &Model, qv: [&Samples; 2]) -> Vec<f64> {
    along(model, qv, |data, [q, v], out| out.extend_from_slice(rnea::nle(model, data, q, v)))
}

/// Accelerations of the open tree, `n_samples × nv`.
pub(crate) fn accelerations(model: &Model, [q, v, tau]: [&Samples; 3]) -> Vec<f64> {
    let mut data = Data::new(model);
    let mut out = Vec::with_capacity(q.len() * model.nv());
    for i in 0..q.len() {
        out.extend_from_slice(aba::aba(model, &mut data, q.row(i), v.row(i), tau.row(i)));
    }
    out
}

/// Accelerations of the tree and efforts of the loops, loops closed: `n_samples × nv`, `n_samples × rows`.
pub(crate) fn constrained(model: &Model, [q, v, tau]: [&Samples; 3], rate: Stabilisation) -> Result<[Vec<f64>; 2], Open> {
    let mut data = Data::with_choice(model, Choice::Pivoting);
    let mut out = [Vec::new(), Vec::new()];
    for i in 0..q.len() {
        let closure = constrained::stabilised_forward_dynamics(model, &mut data, q.row(i), v.row(i), tau.row(i), rate);
        checked(&data, closure, Some(i))?;
        out[0].extend_from_slice(&data.a);
        out[1].extend_from_slice(&data.lambda);
    }
    Ok(out)
}

/// States with their loops closed, `n_samples × nv` each.
pub(crate) fn projected(model: &Model, [q, v]: [&Samples; 2]) -> Result<[Vec<f64>; 2], Open> {
    let mut data = Data::new(model);
    let mut out = [Vec::new(), Vec::new()];
    for i in 0..q.len() {
        let (mut q, mut v) = (q.row(i).to_vec(), v.row(i).to_vec());
        let closure = constrained::project(model, &mut data, &mut q, &mut v);
        checked(&data, closure, Some(i))?;
        out[0].append(&mut q);
        out[1].append(&mut v);
    }
    Ok(out)
}

/// Coordinates of an output, `n_samples × 6`, and their rates, `n_samples × 6 × nv`.
pub(crate) fn outputs(model: &Model, output: &Output, q: &Samples) -> [Vec<f64>; 2] {
    let (mut rates, mut one) = (Vec::new(), DMatrix::zeros(6, model.nv()));
    let places = at_each(model, q, |data, q, out| {
        kinematics::forward_kinematics(model, data, q);
        output_jacobian(model, data, output, &mut one);
        out.extend(coordinates(&output.pose(data)));
        push_rows(&mut rates, &one);
    });
    [places, rates]
}

/// Kinetic and potential energies, `n_samples` each.
pub(crate) fn energies(model: &Model, qv: [&Samples; 2]) -> [Vec<f64>; 2] {
    let kinetic = along(model, qv, |data, [q, v], out| out.push(energy::kinetic_energy(model, data, q, v)));
    [kinetic, at_each(model, qv[0], |data, q, out| out.push(energy::potential_energy(model, data, q)))]
}

/// Kinetic and potential energies per inertial parameter, `n_samples × 10·nv` each.
pub(crate) fn energy_regressors(model: &Model, qv: [&Samples; 2]) -> [Vec<f64>; 2] {
    let mut row = vec![0.0; N_INERTIAL * model.nv()];
    let mut other = row.clone();
    let kinetic = along(model, qv, |data, [q, v], out| {
        regressor::kinetic_energy_regressor(model, data, q, v, &mut row);
        out.extend_from_slice(&row);
    });
    let potential = at_each(model, qv[0], |data, q, out| {
        regressor::potential_energy_regressor(model, data, q, &mut other);
        out.extend_from_slice(&other);
    });
    [kinetic, potential]
}

/// Velocities and accelerations of a frame in the root's axes, `n_samples × 6` each.
pub(crate) fn frame_motions(model: &Model, frame: &FrameOnBody, [q, v, a]: [&Samples; 3]) -> [Vec<f64>; 2] {
    let mut data = Data::new(model);
    let mut out = [Vec::new(), Vec::new()];
    for i in 0..q.len() {
        kinematics::forward_kinematics(model, &mut data, q.row(i));
        kinematics::world_velocities(model, &mut data, v.row(i));
        kinematics::world_accelerations(model, &mut data, a.row(i), &Vector3::zeros());
        let motions = [kinematics::frame_velocity(&data, frame), kinematics::frame_acceleration(&data, frame)];
        for (out, motion) in out.iter_mut().zip(motions) {
            out.extend(motion.linear.iter().chain(motion.angular.iter()));
        }
    }
    out
}

/// Centres of mass, `n_samples × 3`, and their Jacobians, `n_samples × 3 × nv`.
pub(crate) fn centres(model: &Model, q: &Samples) -> [Vec<f64>; 2] {
    let mut jacobians = Vec::new();
    let mut one = Matrix3xX::zeros(model.nv());
    let centres = at_each(model, q, |data, q, out| {
        let (centre, _) = jacobian::jacobian_center_of_mass(model, data, q, &mut one);
        out.extend(centre.iter());
        (0..3).for_each(|i| jacobians.extend(one.row(i).iter()));
    });
    [centres, jacobians]
}

/// Jacobians of a frame, `n_samples × 6 × nv`; with velocities their time derivatives.
pub(crate) fn frame_jacobians(model: &Model, frame: &FrameOnBody, q: &Samples, v: Option<&Samples>, reference: Reference) -> Vec<f64> {
    let push = |out: &mut Vec<f64>, j: &Matrix6xX<f64>| (0..6).for_each(|i| out.extend(j.row(i).iter()));
    match v {
        None => at_each(model, q, |data, q, out| {
            kinematics::forward_kinematics(model, data, q);
            push(out, jacobian::frame_jacobian(model, data, frame, reference));
        }),
        Some(v) => along(model, [q, v], |data, [q, v], out| {
            jacobian::motion_of(model, data, q, v);
            push(out, jacobian::frame_jacobian_time_variation(model, data, frame, reference));
        }),
    }
}

/// Poses of a frame in the root frame as 4 × 4 matrices, `n_samples × 4 × 4`.
pub(crate) fn frame_poses(model: &Model, frame: &FrameOnBody, q: &Samples) -> Vec<f64> {
    at_each(model, q, |data, q, out| {
        kinematics::forward_kinematics(model, data, q);
        let x = kinematics::frame_pose(data, frame);
        for i in 0..3 {
            out.extend(x.rotation.row(i).iter().chain([&x.translation[i]]));
        }
        out.extend([0.0, 0.0, 0.0, 1.0]);
    })
}

/// Closure errors, `n_samples × rows`, and their Jacobians, `n_samples × rows × nv`.
pub(crate) fn gaps(model: &Model, q: &Samples) -> [Vec<f64>; 2] {
    let mut jacobians = Vec::new();
    let gaps = at_each(model, q, |data, q, out| {
        loops::loop_gap(model, data, q);
        out.extend_from_slice(&data.loop_gap);
        push_rows(&mut jacobians, &data.loop_jacobian);
    });
    [gaps, jacobians]
}

/// Positions moved by `dv`, `n_samples × nv`.
pub(crate) fn integrated(model: &Model, [q, dv]: [&Samples; 2]) -> Vec<f64> {
    along(model, [q, dv], |_, [q, dv], out| {
        let mut moved = q.to_vec();
        configuration::integrate(model, &mut moved, dv);
        out.extend(moved);
    })
}

/// Ways between positions, `n_samples × nv`.
pub(crate) fn differences(model: &Model, [from, to]: [&Samples; 2]) -> Vec<f64> {
    along(model, [from, to], |_, [from, to], out| {
        let mut way = vec![0.0; model.nv()];
        configuration::difference(model, from, to, &mut way);
        out.extend(way);
    })
}

/// Efforts of the loops for the tree motion in `data`, appended.
pub(crate) fn push_loop_efforts(model: &Model, data: &mut Data, out: &mut Vec<f64>) {
    inverse_dynamics::rigid_effort(model, data);
    out.extend_from_slice(inverse_dynamics::loop_efforts(model, data));
}

/// numpy wants rows, nalgebra keeps columns.
pub(crate) fn push_rows(out: &mut Vec<f64>, matrix: &DMatrix<f64>) {
    for i in 0..matrix.nrows() {
        out.extend(matrix.row(i).iter());
    }
}
