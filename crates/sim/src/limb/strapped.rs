//! A limb strapped to a link of a plant: a foot on a platform, an arm in a cuff.

use nalgebra::Matrix3;
use pkm_dyn::kinematics::{forward_kinematics, world_velocities};
use pkm_dyn::loops::{assemble, solve_positions, solve_velocities, walk_to};
use pkm_dyn::model::Model;
use pkm_dyn::spatial::{Force, Motion, Pose, skew};
use pkm_dyn::{Data, math};

use crate::error::SimError;
use crate::limb::{Impedance, Limb, Patient};
use crate::plant::{Plant, check};

/// A plant with a [`Limb`] at one of its links, and a person who adds his own efforts in the limb's six coordinates.
///
/// The wrench is taken in the middle of a step and held in the link's frame meanwhile. A step must be short against the period of the limb on
/// the robot. The limb's mass belongs into the robot's model.
#[derive(Debug, Clone)]
pub struct Strapped<P> {
    plant: P,
    link: usize,
    limb: Limb,
    patient: Option<Patient>,
    /// What the person knows of the robot, to tell from the wanted motion of the drives that of his limb.
    model: Model,
    data: Data,
    v_ref: [f64; 6],
}

impl<P: Plant> Strapped<P> {
    /// `plant`, a robot with `model`, with a limb of these impedances that rests where `link` is now, the drives of `model` being at `q_act`
    /// `[m | rad]`.
    ///
    /// # Errors
    /// Impedances that are not passive, a plant that cannot be pushed at a link, loops that do not close.
    pub fn try_new(mut plant: P, model: &Model, link: usize, axes: [Impedance; 6], q_act: &[f64]) -> Result<Self, SimError> {
        let nowhere =
            SimError::NotRepresentable { engine: "this plant", what: "a limb at a link".to_string(), problem: "take the constrained one" };
        let (rest, _) = plant.link_motion(link).ok_or(nowhere)?;
        plant.push_link(link, &Force::zero())?;
        let limb = Limb { axes, ..Limb::free(rest) };
        limb.check()?;
        let mut data = Data::new(model);
        for closure in [assemble(model, &mut data), walk_to(model, &mut data, q_act)] {
            check(&closure, 0.0)?;
        }
        Ok(Self { plant, link, limb, patient: None, model: model.clone(), data, v_ref: [0.0; 6] })
    }

    /// The same with a person who adds his own.
    #[must_use]
    pub fn with_patient(mut self, patient: Option<Patient>) -> Self {
        self.patient = patient;
        self
    }

    /// The limb.
    #[must_use]
    pub fn limb(&self) -> &Limb {
        &self.limb
    }
}

/// `pose` moved by `h` `[s]` at `velocity` in its own frame.
fn moved(pose: &Pose, velocity: &Motion, h: f64) -> Pose {
    let turn = velocity.angular * h;
    let angle = math::sqrt(turn.dot(&turn));
    let rotation = if angle > 0.0 {
        let (axis, (s, c)) = (skew(&(turn / angle)), math::sin_cos(angle));
        Matrix3::identity() + axis * s + axis * axis * (1.0 - c)
    } else {
        Matrix3::identity()
    };
    Pose { rotation: pose.rotation * rotation, translation: pose.translation + pose.rotation * velocity.linear * h }
}

impl<P: Plant> Plant for Strapped<P> {
    fn position(&self) -> &[f64] {
        self.plant.position()
    }

    fn velocity(&self) -> &[f64] {
        self.plant.velocity()
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        if let Some((pose, velocity)) = self.plant.link_motion(self.link) {
            let (linear, angular) = (pose.rotation.tr_mul(&velocity.linear), pose.rotation.tr_mul(&velocity.angular));
            let velocity = Motion { linear, angular };
            let middle = moved(&pose, &velocity, 0.5 * h);
            let efforts = self.patient.as_mut().map_or([0.0; 6], |patient| {
                patient.advance(h);
                patient.efforts(&self.limb.rate(&middle, &velocity), &self.v_ref)
            });
            self.plant.push_link(self.link, &self.limb.wrench(&middle, &velocity, &efforts))?;
        }
        self.plant.step(tau, h)
    }

    fn time(&self) -> Option<f64> {
        self.plant.time()
    }

    fn load_position(&self) -> &[f64] {
        self.plant.load_position()
    }

    fn tree(&self) -> Option<[&[f64]; 2]> {
        self.plant.tree()
    }

    /// Of the plant alone: [`Limb::energy`] is the limb's.
    fn stored_energy(&mut self) -> Option<f64> {
        self.plant.stored_energy()
    }

    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        self.plant.link_motion(link)
    }

    fn sensor_wrench(&mut self, sensor: usize) -> Option<Force> {
        self.plant.sensor_wrench(sensor)
    }

    fn expect_motion(&mut self, q_ref: &[f64], v_ref: &[f64]) {
        self.plant.expect_motion(q_ref, v_ref);
        if !self.patient.as_ref().is_some_and(Patient::is_helpful) {
            return;
        }
        let Self { model, data, .. } = self;
        if !solve_positions(model, data, q_ref).is_closed {
            return;
        }
        solve_velocities(model, data, v_ref);
        let (q, v) = (data.q.clone(), data.v.clone());
        forward_kinematics(model, data, &q);
        world_velocities(model, data, &v);
        let link = &model.links[self.link];
        let Some(body) = link.body else { return };
        let pose = data.pose_wb[body].compose(&link.pose);
        let velocity = data.velocity_w[body].at(&pose.translation);
        let (linear, angular) = (pose.rotation.tr_mul(&velocity.linear), pose.rotation.tr_mul(&velocity.angular));
        self.v_ref = self.limb.rate(&pose, &Motion { linear, angular });
    }
}
