//! A limb at the joints of a plant's drives: a knee in an orthosis, an ankle on a single axis.

use pkm_dyn::spatial::{Force, Motion, Pose};

use crate::error::SimError;
use crate::limb::{Impedance, Patient};
use crate::plant::Plant;

/// A plant with an impedance at each of its drives, and a person who adds his own efforts at the first six of them.
///
/// The impedance is taken in the middle of a step, as the plant takes its own forces: energy does not drift. A step must be short against the
/// period of the limb on the robot. The limb's mass belongs into the robot's model.
#[derive(Debug, Clone)]
pub struct Worn<P> {
    plant: P,
    joints: Vec<Impedance>,
    patient: Option<Patient>,
    v_ref: [f64; 6],
    tau: Vec<f64>,
}

impl<P: Plant> Worn<P> {
    /// `plant` with a limb at its drives.
    ///
    /// # Errors
    /// Not one impedance for each drive, or one that is no passive impedance.
    pub fn try_new(plant: P, joints: Vec<Impedance>, patient: Option<Patient>) -> Result<Self, SimError> {
        let n = plant.position().len();
        if joints.len() != n {
            return Err(SimError::Scenario { what: "number of impedances", value: joints.len() as f64, limit: "one for each drive" });
        }
        joints.iter().try_for_each(Impedance::check)?;
        Ok(Self { plant, joints, patient, v_ref: [0.0; 6], tau: vec![0.0; n] })
    }

    /// The plant without the limb.
    #[must_use]
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// Says which motion is wanted of the first six drives `[m/s | rad/s]`: a person who assists helps that one.
    pub fn want(&mut self, v_ref: [f64; 6]) {
        self.v_ref = v_ref;
    }
}

impl<P: Plant> Plant for Worn<P> {
    fn position(&self) -> &[f64] {
        self.plant.position()
    }

    fn velocity(&self) -> &[f64] {
        self.plant.velocity()
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        let (q, v) = (self.plant.position(), self.plant.velocity());
        for (k, joint) in self.joints.iter().enumerate() {
            self.tau[k] = tau[k] + joint.effort(q[k] + 0.5 * h * v[k], v[k]);
        }
        if let Some(patient) = &mut self.patient {
            patient.advance(h);
            let rates = core::array::from_fn(|k| v.get(k).copied().unwrap_or(0.0));
            for (tau, own) in self.tau.iter_mut().zip(patient.efforts(&rates, &self.v_ref)) {
                *tau += own;
            }
        }
        self.plant.step(&self.tau, h)
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

    /// Of the plant alone: [`Impedance::energy`] is the limb's.
    fn stored_energy(&mut self) -> Option<f64> {
        self.plant.stored_energy()
    }

    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        self.plant.link_motion(link)
    }

    fn sensor_wrench(&mut self, sensor: usize) -> Option<Force> {
        self.plant.sensor_wrench(sensor)
    }

    fn push_link(&mut self, link: usize, wrench: &Force) -> Result<(), SimError> {
        self.plant.push_link(link, wrench)
    }

    fn expect_motion(&mut self, q_ref: &[f64], v_ref: &[f64]) {
        self.v_ref = core::array::from_fn(|k| v_ref.get(k).copied().unwrap_or(0.0));
        self.plant.expect_motion(q_ref, v_ref);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limb::{EndStops, PatientConfig, Will};
    use pkm_dyn::math;

    const MASS: f64 = 2.0;

    /// A mass on a rail.
    #[derive(Debug, Clone)]
    struct Block([f64; 1], [f64; 1]);

    impl Plant for Block {
        fn position(&self) -> &[f64] {
            &self.0
        }

        fn velocity(&self) -> &[f64] {
            &self.1
        }

        fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
            let a = tau[0] / MASS;
            self.0[0] += h * (self.1[0] + 0.5 * h * a);
            self.1[0] += h * a;
            Ok(())
        }
    }

    fn worn(damping: f64, patient: Option<PatientConfig>) -> Worn<Block> {
        let joint = Impedance { stiffness: 200.0, damping, rest: 0.0, stops: EndStops::NONE };
        let patient = patient.map(|config| Patient::try_new(config, 3).unwrap());
        Worn::try_new(Block([0.1], [0.0]), vec![joint], patient).unwrap()
    }

    #[test]
    fn a_block_on_a_limb_swings_and_dies_away_as_its_closed_form_says() {
        for (damping, tolerance) in [(0.0, 1e-5), (1.6, 2e-4)] {
            let (mut worn, h) = (worn(damping, None), 1e-4);
            let decay = damping / (2.0 * MASS);
            let omega = math::sqrt(200.0 / MASS - decay * decay);
            for k in 1..=20_000 {
                worn.step(&[0.0], h).unwrap();
                let t = h * f64::from(k);
                let (s, c) = math::sin_cos(omega * t);
                let want = 0.1 * math::exp(-decay * t) * (c + decay / omega * s);
                assert!((worn.position()[0] - want).abs() < 0.1 * tolerance, "{t} s: {} not {want}", worn.position()[0]);
            }
        }
    }

    #[test]
    fn a_person_who_resists_calms_it_and_one_who_assists_moves_it() {
        let config = PatientConfig { strength: [3.0; 6], variation: 0.0, ..PatientConfig::default() };
        let mut calmed = worn(0.0, Some(PatientConfig { will: Will::Resists, ..config }));
        let mut moved = worn(0.0, Some(PatientConfig { will: Will::Assists, ..config }));
        moved.want([10.0; 6]);
        let (mut last, mut sum) = (f64::INFINITY, 0.0);
        for k in 0..40_000 {
            calmed.step(&[0.0], 1e-4).unwrap();
            moved.step(&[0.0], 1e-4).unwrap();
            sum += moved.position()[0] / 40_000.0;
            // The energy of Verlet's steps ripples; looked at once a swing it only falls.
            if k % 6283 == 0 {
                let (q, v) = (calmed.position()[0], calmed.velocity()[0]);
                let energy = 100.0 * q * q + 0.5 * MASS * v * v;
                assert!(energy < last);
                last = energy;
            }
        }
        // Stationary about effort over stiffness; four seconds are not whole swings.
        assert!(last < 0.1 && (sum - 3.0 / 200.0).abs() < 2e-3, "{last} J, {sum} m");
    }

    #[test]
    fn what_the_plant_tells_is_told_with_the_limb_on() {
        let robot = pkm_robots::find("five_bar").unwrap();
        let robot = pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).unwrap().robot;
        let start = pkm_dyn::loops::mid_pose(&robot.model);
        let mut bare = crate::ReducedPlant::try_new(robot, &start).unwrap();
        let mut worn = Worn::try_new(bare.clone(), vec![Impedance::FREE; 2], None).unwrap();
        for plant in [&mut bare as &mut dyn Plant, &mut worn] {
            plant.step(&[0.1, 0.2], 1e-3).unwrap();
        }
        assert!(worn.time().is_some() && worn.time() == bare.time() && worn.stored_energy() == bare.stored_energy());
        assert!(worn.link_motion(1).is_some() && worn.link_motion(1) == bare.link_motion(1));
    }

    #[test]
    fn impedances_must_match_the_drives() {
        assert!(Worn::try_new(Block([0.0], [0.0]), Vec::new(), None).is_err());
        let feeding = Impedance { damping: -1.0, ..Impedance::FREE };
        assert!(Worn::try_new(Block([0.0], [0.0]), vec![feeding], None).is_err());
        assert!(worn(0.0, None).plant().velocity()[0].abs() <= 0.0);
    }
}
