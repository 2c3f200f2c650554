//! Places and sizes of hidden effects that are no plain effort of a drive or property of a link: visible, and no machine of another kind.

use pkm_dyn::effects::Applied;
use pkm_dyn::math;

use crate::error::SimError;
use crate::hidden::{Dice, last_link};
use crate::scenario::Scenario;
use pkm_ident::size::rms;

/// Length of the recording that slow effects are sized for `[s]`.
const RECORDING_S: f64 = 20.0;

/// Steps that a changed length is sized with `[m]`, and the most it becomes.
const LENGTH_STEP: f64 = 1e-3;
const LENGTH_MOST: f64 = 0.02;

/// Damping of a spring in a structure, as a share of the critical one.
const STRUCTURAL_DAMPING: f64 = 0.03;

impl Dice<'_> {
    /// Parameters of an effect at drive `k`, joint `j`, that changes efforts by about `size` `[N | N·m]`; `None` of one sized elsewhere.
    pub(crate) fn values_of_a_drive(&mut self, k: usize, j: usize, size: f64) -> Option<Vec<f64>> {
        let (low, high) = self.range(k);
        let (middle, span) = (0.5 * (low + high), (high - low).max(f64::MIN_POSITIVE));
        let motion = self.motion;
        let over = |x: f64| size / x.max(f64::MIN_POSITIVE);
        let effort = motion.effort_rms(k);
        let peak = motion.effort[k].iter().fold(0.0_f64, |top, e| top.max(e.abs()));
        let random = &mut *self.random;
        let wave = |cycles: f64| cycles * 2.0 * core::f64::consts::PI / span;
        Some(match self.entry.name {
            "friction_quadratic" => vec![over(rms(motion.samples.iter().map(|s| s.v[k] * s.v[k]))), 2.0],
            // The loop is passed within a hundredth of the travel: wide for a good drive, and wide enough to be seen.
            "friction_presliding" => vec![size / (random.uniform(0.005, 0.015) * span), size],
            "friction_position" => vec![random.sign() * 1.5 * size / span, middle, size],
            "directional_efficiency" => {
                let loss = over(rms(motion.rigid[k].iter().copied())).min(0.4);
                vec![1.0 / (1.0 + loss), 1.0 - loss * random.uniform(1.3, 1.8)]
            }
            "backlash" => vec![random.uniform(0.003, 0.01) * span],
            "joint_elasticity" => {
                let stiffness = effort / (random.uniform(0.004, 0.01) * span);
                let rotor = self.robot.model.joints[j].armature;
                let moved = effort / rms(motion.samples.iter().map(|s| s.a[k])).max(f64::MIN_POSITIVE);
                vec![stiffness, 1e-3 * stiffness, if rotor > 0.0 { 0.0 } else { 0.2 * moved }]
            }
            "cable_force" => {
                // A bow and a tilt of it over the travel, multiplied out in q.
                let (m, half) = (middle, 0.5 * span);
                let at = |q: f64| {
                    let x = (q - m) / half;
                    x * x * (1.0 + 0.5 * x)
                };
                let a = random.sign() * over(rms(motion.samples.iter().map(|s| at(s.q[k]))));
                let (b, c) = (a / (half * half), 0.5 * a / (half * half * half));
                vec![b * m * m - c * m * m * m, 3.0 * c * m * m - 2.0 * b * m, b - 3.0 * c * m, c]
            }
            // The top fifth of the effort is clipped.
            "saturation" => vec![0.8 * peak],
            "dead_zone" => vec![2.0 * size],
            "encoder_eccentricity" => vec![random.uniform(0.005, 0.015) * span, wave(random.uniform(1.0, 3.0)), random.uniform(-3.0, 3.0)],
            "controller_mismatch" => vec![random.uniform(0.1, 0.2)],
            _ => return None,
        })
    }

    /// Damping that changes at the drive where most effort goes into damping.
    pub(crate) fn at_a_warming_drive(&mut self) -> Result<Applied, SimError> {
        let (model, motion) = (&self.robot.model, self.motion);
        let damping = |k: usize| {
            let joint = &model.joints[model.actuators[k]];
            joint.viscous * rms(motion.samples.iter().map(|s| s.v[k])) / motion.effort_rms(k).max(f64::MIN_POSITIVE)
        };
        let most = (0..model.n_act()).max_by(|&a, &b| damping(a).total_cmp(&damping(b)));
        let Some(k) = most.filter(|&k| damping(k) > 0.0) else {
            return Err(SimError::NoPlace { effect: self.entry.name, problem: "no drive has nominal damping" });
        };
        // What the share asks for in the middle of a recording; oil thins by no more than four fifths, grease stiffens to 2.5 times.
        let wanted = self.share / damping(k) / (0.5 * RECORDING_S);
        let rate = if self.random.sign() < 0.0 { -wanted.min(0.8 / RECORDING_S) } else { wanted.min(1.5 / RECORDING_S) };
        self.applied(model.actuators[k], vec![rate])
    }

    /// Between two drives of one kind.
    pub(crate) fn at_two_drives(&mut self) -> Result<Applied, SimError> {
        let (model, motion) = (&self.robot.model, self.motion);
        let joint = |k: usize| &model.joints[model.actuators[k]];
        let pairs: Vec<(usize, usize)> = (1..model.n_act()).map(|k| (k - 1, k)).filter(|&(a, b)| joint(a).kind == joint(b).kind).collect();
        let Some(&(first, second)) = pairs.get(self.random.index(pairs.len())) else {
            return Err(SimError::NoPlace { effect: self.entry.name, problem: "no two neighbouring drives are of one kind" });
        };
        let size = self.share * motion.effort_rms(first).min(motion.effort_rms(second));
        let over = |share: f64, x: f64| share * size / x.max(f64::MIN_POSITIVE);
        let speed = rms(motion.samples.iter().map(|s| s.v[first] + s.v[second]));
        let acceleration = rms(motion.samples.iter().map(|s| s.a[first] + s.a[second]));
        let place = format!("{},{}", joint(first).name, joint(second).name);
        self.applied_at(&place, &[over(0.3, acceleration), 0.6 * size, over(0.3, speed)])
    }

    /// A drifting reading, a contact or a push, at a drive.
    pub(crate) fn on_a_drive_over_time(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        let k = self.random.index(model.n_act());
        let (low, high) = self.range(k);
        let span = (high - low).max(f64::MIN_POSITIVE);
        let size = self.share * self.motion.effort_rms(k);
        let random = &mut *self.random;
        let values = match self.entry.name {
            "sensor_drift" => vec![random.sign() * random.uniform(0.01, 0.02) * span / RECORDING_S],
            // In the last tenth to fifth of the travel on one side, pushed with several times the share at the end of it.
            "contact" => {
                let (deep, side) = (random.uniform(0.1, 0.2) * span, random.sign());
                let position = if side > 0.0 { high - deep } else { low + deep };
                vec![random.uniform(3.0, 5.0) * size / deep, position, 0.0, side]
            }
            _ => {
                let start = random.uniform(0.25, 0.4) * RECORDING_S;
                vec![start, start + random.uniform(0.05, 0.1) * RECORDING_S, random.sign() * random.uniform(2.0, 4.0) * size]
            }
        };
        self.applied_at(&model.joints[model.actuators[k]].name, &values)
    }

    /// A person or spring at the last link, a soft base under the root.
    pub(crate) fn on_the_environment(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        let none = |problem| SimError::NoPlace { effect: self.entry.name, problem };
        if self.entry.name == "structure_flexibility" {
            let mass: f64 = model.bodies.iter().map(|b| b.mass).sum();
            // As much as it would sink under the robot's own weight: one to three millimetres.
            let stiffness = mass * model.gravity.norm().max(1.0) / self.random.uniform(1e-3, 3e-3);
            let damping = 2.0 * STRUCTURAL_DAMPING * math::sqrt(stiffness * mass);
            return self.applied_at(&model.root, &[stiffness, damping]);
        }
        let link = last_link(model).ok_or_else(|| none("the robot has no link with mass"))?;
        let path = self.motion.path(self.robot, link)?;
        let speed = path.speed(Scenario::default().period_s);
        if speed <= 0.0 {
            return Err(none("the last link does not move"));
        }
        // The force that at the link's speed has the wanted share of the drives' power.
        let samples = self.motion.samples.iter().enumerate();
        let power = samples.map(|(i, s)| s.v.iter().enumerate().map(|(k, v)| v * self.motion.effort[k][i]).sum::<f64>());
        let force = self.share * rms(power) / speed;
        let values = match self.entry.name {
            "limb_impedance" => {
                let stiffness = force / path.displacement().max(f64::MIN_POSITIVE);
                vec![stiffness, self.random.uniform(0.02, 0.1) * stiffness]
            }
            _ => vec![force],
        };
        self.applied(link, values)
    }

    /// A length or anchor that some drive feels; loops that would not close with it are passed over.
    pub(crate) fn at_a_length(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        let names = model.links.iter().map(|l| &l.name).chain(model.loops.iter().map(|l| &l.name));
        let direction: [f64; 3] = core::array::from_fn(|_| self.random.normal());
        let length = math::sqrt(direction.iter().map(|x| x * x).sum::<f64>()).max(f64::MIN_POSITIVE);
        let along = |step: f64| direction.map(|x| step * x / length);
        let mut felt = Vec::new();
        for name in names {
            // Links fixed to another are no place for it.
            let Ok(applied) = self.applied_at(name, &along(LENGTH_STEP)) else { continue };
            // A link's own joint may be its root: shifting all of the robot changes nothing.
            let Ok(change) = self.change_of_effort(applied) else { continue };
            felt.push((name, change));
        }
        let most = felt.iter().map(|(_, c)| *c).fold(0.0, f64::max);
        felt.retain(|(_, change)| *change > 0.3 * most && *change > 1e-9);
        let mut step = LENGTH_MOST;
        if let Some(&(name, change)) = felt.get(self.random.index(felt.len())) {
            step = step.min(LENGTH_STEP * self.share / change);
            for _ in 0..4 {
                let applied = self.applied_at(name, &along(step))?;
                if self.change_of_effort(applied.clone()).is_ok() {
                    return Ok(applied);
                }
                step *= 0.5;
            }
        }
        Err(SimError::NoPlace { effect: self.entry.name, problem: "no length can change with the loops closed, or no drive feels one" })
    }
}
