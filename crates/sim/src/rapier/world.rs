//! The engine's world of one robot: filled once, pushed, stepped and read.

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::Data;
use pkm_dyn::model::{JointKind, Model};
use pkm_dyn::spatial::{Force, Motion, Pose};
use rapier3d_f64::dynamics::{
    GenericJoint, ImpulseJointHandle, JointAxesMask, JointAxis, MassProperties, MotorModel, RigidBodyBuilder, RigidBodyHandle,
    SpringCoefficients,
};
use rapier3d_f64::pipeline::PhysicsWorld;

use super::build::{Fastening, Plan, refused};
use super::chains::axial;
use super::convert::{pose_from, pose_to, rotation_to, vector_from, vector_to};
use crate::error::SimError;

/// Stiffness of fastenings as the frequency of a spring `[Hz]`: a substep takes up all but 1e-9 of a gap.
const FASTENING_HZ: f64 = 1e12;

/// A principal moment of inertia below this share of the largest is none: the engine takes zero for infinite.
const NO_INERTIA: f64 = 1e-12;

const AXES: [JointAxesMask; 6] =
    [JointAxesMask::LIN_X, JointAxesMask::LIN_Y, JointAxesMask::LIN_Z, JointAxesMask::ANG_X, JointAxesMask::ANG_Y, JointAxesMask::ANG_Z];

/// Mass properties about the centre of mass, in the body's frame.
#[derive(Debug, Clone, Copy)]
struct Mass {
    mass: f64,
    centre: Vector3<f64>,
    central: Matrix3<f64>,
}

/// One body with its motion at the middle of the last substep.
struct Member {
    handle: RigidBodyHandle,
    mass: Mass,
    pose: Pose,
    /// Velocity of the centre of mass and angular velocity, in the root's axes.
    middle: Motion,
    /// Their change over the time from the middle of the substep before to that of the last.
    rate: Motion,
    /// What pushes it next, about the centre of mass, in the root's axes.
    push: Force,
}

impl Member {
    fn centre(&self) -> Vector3<f64> {
        self.pose.transform_point(&self.mass.centre)
    }

    /// Velocity `since` `[s]` after the middle of the last substep.
    fn velocity(&self, since: f64) -> Motion {
        self.middle + self.rate * since
    }

    fn inertia(&self) -> Matrix3<f64> {
        self.pose.rotation * self.mass.central * self.pose.rotation.transpose()
    }
}

/// A drive-like row of the engine on the free axis of a fastening.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// Impulse per difference of velocity `[kg | kg·m²]`; zero switches it off.
    pub(super) gain: f64,
    /// Velocity it pulls towards `[m/s | rad/s]`.
    pub(super) target: f64,
}

pub(super) struct World {
    physics: PhysicsWorld,
    gravity: Vector3<f64>,
    /// One per chain of the plan.
    members: Vec<Member>,
    /// Member that carries each body of the tree.
    member_of: Vec<Option<usize>>,
    fastenings: Vec<(Fastening, ImpulseJointHandle)>,
}

impl World {
    /// At the pose in `data`, at rest. `sweeps` go over all fastenings in every substep.
    pub(super) fn try_new(model: &Model, data: &Data, plan: &Plan, sweeps: usize) -> Result<Self, SimError> {
        let mut physics = PhysicsWorld::default();
        let settings = &mut physics.integration_parameters;
        // One substep per step: inertias and efforts would be those of the first substep in the others.
        settings.num_solver_iterations = 1;
        settings.num_internal_pgs_iterations = sweeps;
        // The pass without the gaps takes out energy.
        settings.num_internal_stabilization_iterations = 0;
        settings.warmstart_joints = true;
        settings.normalized_max_linear_velocity = f64::MAX;
        settings.max_ccd_substeps = 0;
        let root = physics.insert_body(RigidBodyBuilder::fixed());
        let (mut members, mut member_of) = (Vec::new(), vec![None; model.nv()]);
        for chain in &plan.chains {
            let body = chain.body();
            member_of[body] = Some(members.len());
            members.push(insert(&mut physics, model, body, data.pose_wb[body])?);
        }
        let mut world = Self { physics, gravity: model.gravity, members, member_of, fastenings: Vec::new() };
        for fastening in &plan.fastenings {
            let handle = |body: Option<usize>| world.member(body).map_or(root, |m| m.handle);
            let ends = [handle(fastening.a.body), handle(fastening.b.body)];
            let joint = world.physics.insert_impulse_joint(ends[0], ends[1], generic(fastening));
            world.fastenings.push((fastening.clone(), joint));
        }
        Ok(world)
    }

    fn member(&self, body: Option<usize>) -> Option<&Member> {
        self.member_of[body?].map(|m| &self.members[m])
    }

    /// Pose of a body in the root frame.
    pub(super) fn pose(&self, body: Option<usize>) -> Pose {
        self.member(body).map_or_else(Pose::identity, |m| m.pose)
    }

    /// Starts all bodies with the velocities in `data` (`velocity_w`).
    pub(super) fn start(&mut self, data: &Data) {
        let bodies = self.member_of.iter().enumerate().filter_map(|(body, m)| m.map(|m| (body, m)));
        for (body, m) in bodies {
            let member = &mut self.members[m];
            member.middle = data.velocity_w[body].at(&member.centre());
            member.rate = Motion::zero();
            let rigid = &mut self.physics.bodies[member.handle];
            rigid.set_linvel(vector_to(&member.middle.linear), true);
            rigid.set_angvel(vector_to(&member.middle.angular), true);
        }
    }

    /// Adds a wrench on `body`, given about the origin and in the axes of `body`, and its opposite on `other`.
    pub(super) fn push(&mut self, body: usize, other: Option<usize>, wrench: &Force) {
        let x = self.pose(Some(body));
        let (linear, angular) = (x.rotation * wrench.linear, x.rotation * wrench.angular);
        let about_origin = Force { linear, angular };
        for (on, sign) in [(Some(body), 1.0), (other, -1.0)] {
            let Some(m) = on.and_then(|b| self.member_of[b]) else { continue };
            let member = &mut self.members[m];
            member.push += about_origin.about(&(member.centre() - x.translation)) * sign;
        }
    }

    /// Inertia along the free axis of fastening `f` if nothing else held the bodies on either side `[kg | kg·m²]`: other fastenings only add.
    pub(super) fn free_inertia(&self, f: usize, kind: JointKind) -> f64 {
        let fastening = &self.fastenings[f].0;
        let x = self.pose(fastening.a.body).compose(&fastening.a.pose);
        let axis = x.rotation.column(0).into_owned();
        let response = |member: &Member| {
            let turned = match kind {
                JointKind::Revolute => axis,
                JointKind::Prismatic => (x.translation - member.centre()).cross(&axis),
            };
            let pushed = if kind == JointKind::Prismatic { 1.0 / member.mass.mass } else { 0.0 };
            // Inertias were found positive definite.
            pushed + member.inertia().cholesky().map_or(0.0, |factor| turned.dot(&factor.solve(&turned)))
        };
        let ends = [fastening.a.body, fastening.b.body];
        1.0 / ends.into_iter().filter_map(|body| self.member(body)).map(response).sum::<f64>()
    }

    /// Sets the row on the free axis of fastening `f`, whose joint is of this kind.
    pub(super) fn set_row(&mut self, f: usize, kind: JointKind, row: Row, h: f64) {
        let Some(joint) = self.physics.impulse_joints.get_mut(self.fastenings[f].1, false) else { return };
        let axis = free_axis(kind);
        joint.data.set_motor_model(axis, MotorModel::ForceBased);
        joint.data.set_motor(axis, 0.0, row.target, 0.0, row.gain / h);
        joint.data.set_motor_max_force(axis, if row.gain > 0.0 { f64::MAX } else { 0.0 });
    }

    /// Impulse that the row of fastening `f` took from the joint in the last substep `[N·s | N·m·s]`.
    pub(super) fn row_impulse(&self, f: usize, kind: JointKind) -> f64 {
        let joint = self.physics.impulse_joints.get(self.fastenings[f].1);
        joint.and_then(|joint| joint.data.motor(free_axis(kind))).map_or(0.0, |motor| motor.impulse)
    }

    /// One substep of `h` `[s]`: all pushes act for `kick` `[s]`, from `since` `[s]` after the middle of the last substep.
    pub(super) fn step(&mut self, h: f64, kick: f64, since: f64) {
        let share = kick / h;
        self.physics.gravity = vector_to(&(self.gravity * share));
        self.physics.integration_parameters.dt = h;
        for member in &mut self.members {
            let spin = member.velocity(since).angular;
            let gyroscopic = spin.cross(&(member.inertia() * spin));
            let rigid = &mut self.physics.bodies[member.handle];
            rigid.reset_forces(false);
            rigid.reset_torques(false);
            rigid.add_force(vector_to(&(member.push.linear * share)), false);
            rigid.add_torque(vector_to(&((member.push.angular - gyroscopic) * share)), false);
            member.push = Force::zero();
        }
        self.physics.step();
        for member in &mut self.members {
            let rigid = &self.physics.bodies[member.handle];
            let now = Motion { linear: vector_from(rigid.linvel()), angular: vector_from(rigid.angvel()) };
            member.rate = (now - member.middle) * (1.0 / kick);
            member.middle = now;
            member.pose = pose_from(rigid.position());
        }
    }

    /// The fastening that is open farthest, and by how much `[m | rad]`.
    pub(super) fn gap(&self) -> (f64, &str) {
        let mut worst = (0.0_f64, "");
        for (fastening, _) in &self.fastenings {
            let a = self.pose(fastening.a.body).compose(&fastening.a.pose);
            let b = self.pose(fastening.b.body).compose(&fastening.b.pose);
            let arm = a.rotation.tr_mul(&(b.translation - a.translation));
            let turn = axial(&a.rotation.tr_mul(&b.rotation));
            for k in (0..6).filter(|&k| fastening.forbidden[k]) {
                let gap = if k < 3 { arm[k] } else { turn[k - 3] }.abs();
                // A gap that is not a number must not pass for none.
                if gap > worst.0 || gap.is_nan() {
                    worst = (gap, &fastening.name);
                }
            }
        }
        worst
    }

    /// Kinetic and potential energy of the bodies `since` `[s]` after the middle of the last substep `[J]`.
    pub(super) fn energy(&self, since: f64) -> f64 {
        let of = |m: &Member| {
            let (v, mass) = (m.velocity(since), m.mass.mass);
            let turning = v.angular.dot(&(m.inertia() * v.angular));
            0.5 * (mass * v.linear.dot(&v.linear) + turning) - mass * self.gravity.dot(&m.centre())
        };
        self.members.iter().map(of).sum()
    }
}

fn free_axis(kind: JointKind) -> JointAxis {
    match kind {
        JointKind::Revolute => JointAxis::AngX,
        JointKind::Prismatic => JointAxis::LinX,
    }
}

fn insert(physics: &mut PhysicsWorld, model: &Model, body: usize, pose: Pose) -> Result<Member, SimError> {
    let (centre, central) = model.bodies[body].centre_of_mass();
    let mass = Mass { mass: model.bodies[body].mass, centre, central };
    let eigen = central.symmetric_eigen();
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.neg_mut();
    }
    let (least, largest) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    if !(mass.mass > 0.0 && least > NO_INERTIA * largest) {
        let what = format!("the body of joint {:?}", model.joints[body].name);
        return Err(refused(&what, "it needs a mass and a rotational inertia above zero about every axis"));
    }
    let properties =
        MassProperties::with_principal_inertia_frame(vector_to(&centre), mass.mass, vector_to(&eigen.eigenvalues), rotation_to(&axes));
    let builder = RigidBodyBuilder::dynamic()
        .pose(pose_to(&pose))
        .additional_mass_properties(properties)
        .can_sleep(false)
        .allow_fast_rotation(true)
        // Its own gyroscopic term is of first order in the substep.
        .gyroscopic_forces_enabled(false);
    let handle = physics.insert_body(builder);
    // Stated masses do not count before this.
    physics.bodies[handle].recompute_mass_properties_from_colliders(&physics.colliders);
    let (middle, rate, push) = (Motion::zero(), Motion::zero(), Force::zero());
    Ok(Member { handle, mass, pose, middle, rate, push })
}

fn generic(fastening: &Fastening) -> GenericJoint {
    let mut locked = JointAxesMask::empty();
    for (axis, _) in AXES.into_iter().zip(fastening.forbidden).filter(|(_, is_forbidden)| *is_forbidden) {
        locked |= axis;
    }
    let mut joint = GenericJoint::new(locked);
    joint.set_local_frame1(pose_to(&fastening.a.pose)).set_local_frame2(pose_to(&fastening.b.pose));
    joint.set_contacts_enabled(false);
    joint.softness = SpringCoefficients::new(FASTENING_HZ, 1.0);
    joint
}
