//! All results and scratch of the algorithms: allocated once, by [`Data::new`].

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{DMatrix, Matrix6xX};

use crate::aba::Articulated;
use crate::elimination::Elimination;
use crate::loops::{Choice, Path, choose_independent};
use crate::model::{Model, Part};
use crate::parameters::N_INERTIAL;
use crate::spatial::{Force, Inertia, Motion, Pose};

/// Results and scratch for one [`Model`]; every algorithm writes its result here and returns a reference to it.
///
/// Names that end in `_w` are at the root's origin in the root's axes.
#[derive(Debug, Clone)]
pub struct Data {
    /// Pose of each body in its parent body.
    pub pose_pb: Vec<Pose>,
    /// Pose of each body in the root frame.
    pub pose_wb: Vec<Pose>,
    /// Unit motion of each joint.
    pub axis_w: Vec<Motion>,
    /// Velocity of each body, in its own frame.
    pub velocity: Vec<Motion>,
    /// Velocity of each body.
    pub velocity_w: Vec<Motion>,
    /// Acceleration of each body in its own frame, with the base accelerated by `-gravity`.
    pub acceleration: Vec<Motion>,
    /// Acceleration of each body, with the base accelerated as the algorithm says.
    pub acceleration_w: Vec<Motion>,
    /// Velocity term each joint adds to its body's acceleration.
    pub coriolis: Vec<Motion>,
    /// Velocity term each joint adds to its body's acceleration.
    pub coriolis_w: Vec<Motion>,
    /// Wrench each joint transmits to its body, in the body's frame.
    pub force: Vec<Force>,
    /// Wrench each joint transmits to its body.
    pub force_w: Vec<Force>,
    /// Tree coordinates `[m | rad]`, nv.
    pub q: Vec<f64>,
    /// Tree velocities `[m/s | rad/s]`, nv.
    pub v: Vec<f64>,
    /// Tree accelerations `[m/s² | rad/s²]`, nv.
    pub a: Vec<f64>,
    /// Generalized efforts of the tree `[N | N·m]`, nv.
    pub tau: Vec<f64>,
    /// Efforts at the independent coordinates `[N | N·m]`.
    pub tau_ind: Vec<f64>,
    /// Efforts at the drives `[N | N·m]`, one per drive.
    pub tau_act: Vec<f64>,
    /// Mass matrix of the tree, nv × nv.
    pub mass_matrix: DMatrix<f64>,
    /// Jacobian of a frame, or of all joints: 6 × nv, linear part first.
    pub jacobian: Matrix6xX<f64>,
    /// Joint-torque regressor of the tree, nv × 10·bodies.
    pub joint_torque_regressor: DMatrix<f64>,
    /// Regressor of the independent coordinates, independent × 10·bodies; they are the drives unless there are more drives than freedoms.
    pub regressor: DMatrix<f64>,
    /// Closure error of every constraint row `[m | rad]`.
    pub loop_gap: Vec<f64>,
    /// Jacobian of the closure error, rows × nv.
    pub loop_jacobian: DMatrix<f64>,
    /// Second time derivative of the closure error at zero joint acceleration `[m/s² | rad/s²]`.
    pub loop_drift: Vec<f64>,
    /// Loop efforts, one per constraint row `[N | N·m]`: `M·a + nle = tau + Jᵀ·lambda`.
    pub lambda: Vec<f64>,
    /// Reduction to the independent coordinates: `v_tree = reduction · v_ind`, nv × independent.
    pub reduction: DMatrix<f64>,
    /// Mass matrix in the independent coordinates, independent × independent.
    pub reduced_mass_matrix: DMatrix<f64>,
    /// Joints whose motion determines all others, in the order of `tau_ind`: the drives, or as many of them as there are freedoms, which
    /// then change with the pose.
    pub independent: Vec<usize>,
    /// Joints solved for by loop closure, ascending.
    pub dependent: Vec<usize>,
    /// How the drives move with the independent coordinates, `v_act = drive_jacobian · v_ind`, drives × independent.
    pub drive_jacobian: DMatrix<f64>,
    /// How the drives share efforts at the independent coordinates, `tau_act = distribution · tau_ind`, drives × independent.
    pub distribution: DMatrix<f64>,
    /// Motion of each joint of the tree per motion of each drive, nv × drives: `reduction · distributionᵀ`.
    pub drive_reduction: DMatrix<f64>,
    /// Efforts of the drives that move nothing and only strain the robot, as orthonormal columns, drives × (drives − independent).
    pub internal_efforts: DMatrix<f64>,
    /// Columns of rotor inertia, viscous and Coulomb friction of every joint in the independent coordinates, independent × 3·nv.
    pub friction_regressor: DMatrix<f64>,
    pub(crate) inertia_w: Vec<Inertia>,
    pub(crate) articulated: Vec<Articulated>,
    /// Motion of each body per unit of each independent coordinate, body by body.
    pub(crate) partial_w: Vec<Motion>,
    /// Mass matrix of the tree times the reduction, joint by joint.
    pub(crate) mass_reduction: Vec<f64>,
    /// Frames a and b of each loop in the root frame; the orientation of b only where the loop forbids turns.
    pub(crate) ends: Vec<[Pose; 2]>,
    pub(crate) paths: Vec<Path>,
    pub(crate) elimination: Elimination,
    /// Tree coordinates at which `elimination` and `reduction` hold.
    pub(crate) reduced_at: Vec<f64>,
    pub(crate) step: Vec<f64>,
    pub(crate) scratch: Vec<f64>,
    pub(crate) gram: DMatrix<f64>,
    pub(crate) choice: Choice,
    pub(crate) has_compound: bool,
}

impl Data {
    /// Room for every algorithm on `model`. The independent coordinates are its drives; of more drives than there are freedoms, those
    /// that determine the motion best at the stated assembly, whose loops are closed for that.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self::with_choice(model, Choice::Drives)
    }

    /// As [`Data::new`], with another choice of independent coordinates.
    #[must_use]
    pub fn with_choice(model: &Model, choice: Choice) -> Self {
        let mut data = Self::with_independent(model, model.actuators.clone());
        let independent = choose_independent(model, &mut data, choice);
        // Made anew: what the choice left in it is nobody's start.
        Self { choice, ..Self::with_independent(model, independent) }
    }

    fn with_independent(model: &Model, independent: Vec<usize>) -> Self {
        let (nv, rows, n_act, n_ind) = (model.nv(), model.n_constraints(), model.n_act(), independent.len());
        let dependent: Vec<usize> = (0..nv).filter(|j| !independent.contains(j)).collect();
        let mut reduction = DMatrix::zeros(nv, n_ind);
        for (k, &j) in independent.iter().enumerate() {
            reduction[(j, k)] = 1.0;
        }
        Self {
            pose_pb: vec![Pose::identity(); nv],
            pose_wb: vec![Pose::identity(); nv],
            axis_w: vec![Motion::zero(); nv],
            velocity: vec![Motion::zero(); nv],
            velocity_w: vec![Motion::zero(); nv],
            acceleration: vec![Motion::zero(); nv],
            acceleration_w: vec![Motion::zero(); nv],
            coriolis: vec![Motion::zero(); nv],
            coriolis_w: vec![Motion::zero(); nv],
            force: vec![Force::zero(); nv],
            force_w: vec![Force::zero(); nv],
            q: model.assembly.clone(),
            v: vec![0.0; nv],
            a: vec![0.0; nv],
            tau: vec![0.0; nv],
            tau_ind: vec![0.0; n_ind],
            tau_act: vec![0.0; n_act],
            mass_matrix: DMatrix::zeros(nv, nv),
            jacobian: Matrix6xX::zeros(nv),
            joint_torque_regressor: DMatrix::zeros(nv, N_INERTIAL * nv),
            regressor: DMatrix::zeros(n_ind, N_INERTIAL * nv),
            loop_gap: vec![0.0; rows],
            loop_jacobian: DMatrix::zeros(rows, nv),
            loop_drift: vec![0.0; rows],
            lambda: vec![0.0; rows],
            reduction,
            reduced_mass_matrix: DMatrix::zeros(n_ind, n_ind),
            drive_jacobian: DMatrix::zeros(n_act, n_ind),
            distribution: DMatrix::zeros(n_act, n_ind),
            drive_reduction: DMatrix::zeros(nv, n_act),
            internal_efforts: DMatrix::zeros(n_act, n_act.saturating_sub(n_ind)),
            friction_regressor: DMatrix::zeros(n_ind, 3 * nv),
            inertia_w: vec![Inertia::default(); nv],
            articulated: vec![Articulated::default(); nv],
            partial_w: vec![Motion::zero(); nv * n_ind],
            mass_reduction: vec![0.0; nv * n_ind],
            ends: vec![[Pose::identity(); 2]; model.loops.len()],
            paths: model.loops.iter().map(|l| Path::of(model, l)).collect(),
            elimination: Elimination::new(rows, dependent.len()),
            reduced_at: vec![f64::NAN; nv],
            step: vec![0.0; nv.max(rows)],
            scratch: vec![0.0; nv.max(rows)],
            gram: DMatrix::zeros(n_ind, n_ind),
            choice: Choice::Drives,
            has_compound: model.joints.iter().any(|j| j.part != Part::Whole),
            independent,
            dependent,
        }
    }

    /// Degrees of freedom that the independent coordinates stand for.
    #[must_use]
    pub fn n_ind(&self) -> usize {
        self.independent.len()
    }
}
