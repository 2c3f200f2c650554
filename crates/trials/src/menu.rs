//! What can be concealed in which robot: for every effect the law that the true robot gets, where, and a first guess of its size.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;

use crate::base::HOLDOUT;
use crate::laws::{Dry, Flex, Resist};
use crate::machine::{Felt, Hand, Machine, Push, Resistance};
use crate::math::{cos, pow, sin};
use crate::plant::{Plant, tilt};
use crate::random::Stream;
use crate::robot::{Motion, RobotError};

/// Effects that can be concealed, by the names of the catalogue.
pub const INSIDE: [&str; 36] = [
    "friction_viscous",
    "friction_coulomb",
    "friction_asymmetric",
    "friction_stribeck",
    "friction_quadratic",
    "friction_load",
    "friction_presliding",
    "friction_position",
    "friction_thermal",
    "friction_passive",
    "directional_efficiency",
    "backlash",
    "joint_elasticity",
    "structure_flexibility",
    "rotor_inertia",
    "payload",
    "inertia_error",
    "spring",
    "cable_force",
    "gravity_tilt",
    "torque_constant",
    "torque_offset",
    "torque_ripple",
    "transmission_coupling",
    "actuator_lag",
    "time_delay",
    "saturation",
    "dead_zone",
    "encoder_offset",
    "encoder_eccentricity",
    "geometry_error",
    "limb_impedance",
    "contact",
    "external_force",
    "active_limb",
    "sensor_drift",
];

/// Physics that no catalogue has a name for.
pub const OUTSIDE: [&str; 6] =
    ["outside_cubed_coupling", "outside_free_sine", "outside_detent", "outside_creep", "outside_inertial_stick", "outside_travel_friction"];

/// What a drive does in the healthy robot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Fact {
    /// Standard deviation of the effort `[N]`.
    pub spread: f64,
    /// Largest effort `[N]`.
    pub peak: f64,
    /// Middle of the motion `[m | rad]`.
    pub centre: f64,
    /// Largest excursion from the middle.
    pub reach: f64,
    /// Root mean square of the velocity.
    pub speed: f64,
    /// Inertia that the drive feels with the others free `[kg | kg·m²]`.
    pub inertia: f64,
}

/// What is known when an effect is chosen.
#[derive(Debug)]
pub struct Scene<'a> {
    /// The nominal robot.
    pub plant: &'a Plant,
    /// Facts per drive.
    pub facts: &'a [Fact],
    /// Root mean square of the velocity of every joint.
    pub speeds: &'a [f64],
}

/// Puts an effect of a given size on a machine; the second number is the recording, for what differs between recordings.
type Apply = Box<dyn Fn(&mut Machine, f64, usize) -> Result<(), RobotError> + Send + Sync>;

/// A parameter of the true robot, to be compared with an estimate.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Parameter {
    /// Name, as in the catalogue.
    pub name: String,
    /// True value, SI.
    pub value: f64,
    /// Value that the nominal robot has.
    pub from: f64,
}

/// An effect, somewhere, of any size.
pub struct Choice {
    /// Name.
    pub effect: String,
    /// Joints, links or loops.
    pub place: Vec<String>,
    /// What the law is, in words.
    pub form: &'static str,
    /// Whether a catalogue would write it the same way.
    pub is_textbook: bool,
    /// First guess of the size.
    pub start: f64,
    /// Largest sensible size.
    pub cap: f64,
    apply: Apply,
    parameters: Box<dyn Fn(f64) -> Vec<Parameter> + Send + Sync>,
}

impl core::fmt::Debug for Choice {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} at {:?}: {}", self.effect, self.place, self.form)
    }
}

impl Choice {
    /// Puts the effect with the given size on a machine, for recording number `recording`.
    ///
    /// # Errors
    /// When the changed robot does not assemble.
    pub fn put_on(&self, machine: &mut Machine, size: f64, recording: usize) -> Result<(), RobotError> {
        (self.apply)(machine, size, recording)
    }

    /// True parameters at that size.
    #[must_use]
    pub fn parameters(&self, size: f64) -> Vec<Parameter> {
        (self.parameters)(size)
    }

    fn new(effect: &str, place: &[&str], form: &'static str, start: f64, apply: Apply) -> Self {
        let place = place.iter().map(|s| (*s).to_string()).collect();
        Self {
            effect: effect.to_string(),
            place,
            form,
            is_textbook: false,
            start,
            cap: f64::INFINITY,
            apply,
            parameters: Box::new(|_| Vec::new()),
        }
    }

    fn textbook(mut self) -> Self {
        self.is_textbook = true;
        self
    }

    fn cap(mut self, cap: f64) -> Self {
        self.cap = cap;
        self.start = self.start.min(0.5 * cap);
        self
    }

    fn with(mut self, parameters: impl Fn(f64) -> Vec<Parameter> + Send + Sync + 'static) -> Self {
        self.parameters = Box::new(parameters);
        self
    }
}

fn one(name: &str, value: f64, from: f64) -> Vec<Parameter> {
    vec![Parameter { name: name.to_string(), value, from }]
}

/// A resistance at a joint of the tree.
fn resist(joint: usize, other: usize, law: Resist) -> Apply {
    Box::new(move |m, size, _| {
        // A rocking base is one more joint in front.
        let shift = usize::from(m.rock.is_some());
        m.resistances.push(Resistance { joint: joint + shift, other: other + shift, law: law.clone(), size });
        Ok(())
    })
}

/// The effect called `name` at a random place of the robot; none where it makes no sense.
#[must_use]
pub fn choose(name: &str, scene: &Scene<'_>, random: &mut Stream) -> Option<Choice> {
    let k = random.index(scene.facts.len());
    let pick = Pick { scene, k, joint: scene.plant.robot.drives[k].joint, fact: scene.facts[k] };
    pick.friction(name, random)
        .or_else(|| pick.transmission(name, random))
        .or_else(|| pick.mass(name, random))
        .or_else(|| pick.position(name, random))
        .or_else(|| pick.effort(name, random))
        .or_else(|| pick.sensor(name, random))
        .or_else(|| pick.outer(name, random))
        .or_else(|| pick.outside(name, random))
}

struct Pick<'a> {
    scene: &'a Scene<'a>,
    k: usize,
    joint: usize,
    fact: Fact,
}

impl Pick<'_> {
    fn name(&self) -> &str {
        &self.scene.plant.robot.joints[self.joint].name
    }

    /// A force worth mentioning at the drive.
    fn force(&self) -> f64 {
        0.05 * self.fact.spread
    }

    /// Speed below which foreign laws fade.
    fn soft(&self) -> f64 {
        0.01 * self.fact.speed
    }

    fn friction(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (k, f, force, soft) = (self.k, self.fact, self.force(), self.soft());
        let nominal = &self.scene.plant.robot.joints[self.joint];
        let (viscous, coulomb) = (nominal.viscous, nominal.coulomb);
        let here = [self.name()];
        let at = |law| resist(self.joint, self.joint, law);
        Some(match name {
            "friction_viscous" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.friction[k].viscous += a;
                    Ok(())
                });
                Choice::new(name, &here, "linear", force / f.speed, apply).textbook().with(move |a| one("viscous", viscous + a, viscous))
            }
            "friction_coulomb" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.friction[k].coulomb += a;
                    Ok(())
                });
                Choice::new(name, &here, "bristles, a band or a root at rest", force, apply)
                    .with(move |a| one("coulomb", coulomb + a, coulomb))
            }
            "friction_asymmetric" => {
                let (way, share) = (random.sign(), random.uniform(0.3, 1.0) / f.speed);
                let names = if way > 0.0 { ["coulomb_pos", "viscous_pos"] } else { ["coulomb_neg", "viscous_neg"] };
                Choice::new(
                    name,
                    &here,
                    "more in one direction, smooth switch",
                    force,
                    at(Resist::OneWay { speed: soft, viscous: share, way }),
                )
                .with(move |a| [one(names[0], coulomb + a, coulomb), one(names[1], viscous + a * share, viscous)].concat())
            }
            "friction_stribeck" => {
                let exponent = [1.0, 1.6, 2.0][random.index(3)];
                let speed = random.uniform(0.08, 0.2) * f.speed;
                let apply: Apply = Box::new(move |m, a, _| {
                    m.friction[k].peak = [a, speed, exponent];
                    Ok(())
                });
                let choice = Choice::new(name, &here, "exponent 1, 1.6 or 2 on bristles or smooth friction", 2.0 * force, apply);
                let choice = if exponent > 1.9 { choice.textbook() } else { choice };
                choice.with(move |a| one("stiction", coulomb + a, coulomb))
            }
            "friction_quadratic" => {
                let kind = random.index(3);
                let power = [2.0, 2.5, 0.5][kind];
                let law = Resist::Drag { v0: 0.05 * f.speed, power };
                let choice = Choice::new(name, &here, "power 2, 2.5 or 0.5 of a smoothed speed", force / pow(f.speed, power), at(law));
                let choice = if kind == 0 { choice.textbook() } else { choice };
                choice.with(move |a| [one("drag", a, 0.0), one("exponent", power, 0.0)].concat())
            }
            _ => return self.more_friction(name, random),
        })
    }

    /// Friction that depends on more than the speed.
    fn more_friction(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (k, f, force, soft) = (self.k, self.fact, self.force(), self.soft());
        let nominal = &self.scene.plant.robot.joints[self.joint];
        let (viscous, coulomb) = (nominal.viscous, nominal.coulomb);
        let here = [self.name()];
        let at = |law| resist(self.joint, self.joint, law);
        Some(match name {
            "friction_load" => {
                Choice::new(name, &here, "root of load squared", 0.03, at(Resist::Load { speed: soft, floor: 0.1 * f.spread }))
                    .cap(0.5)
                    .with(|a| one("mu", a, 0.0))
            }
            "friction_presliding" => {
                let mass = f.inertia;
                let apply: Apply = Box::new(move |m, a, _| {
                    let stiffness = m.friction[k].coulomb / a;
                    m.friction[k].dry = Dry::Bristles { reach: a, damping: 0.4 * (stiffness * mass).sqrt() };
                    Ok(())
                });
                Choice::new(name, &here, "LuGre bristles", 0.02 * f.reach, apply)
                    .cap(0.5 * f.reach)
                    .with(move |a| one("stiffness", coulomb / a, 0.0))
            }
            "friction_position" => {
                Choice::new(name, &here, "smooth sign", force / f.reach, at(Resist::Along { speed: soft, at: f.centre }))
                    .textbook()
                    .cap(0.8 * coulomb / f.reach)
                    .with(|a| one("coulomb_slope", a, 0.0))
            }
            "friction_thermal" => {
                let time = random.uniform(3.0, 8.0);
                Choice::new(name, &here, "warm-up of first order, no thermometer", force / f.speed, at(Resist::Warming { time }))
                    .cap(0.8 * viscous)
            }
            "friction_passive" => return self.passive(random),
            "directional_efficiency" => {
                Choice::new(name, &here, "smooth sign", 0.03, at(Resist::Efficiency { speed: soft, back: 0.3 })).cap(0.4)
            }
            _ => return None,
        })
    }

    fn passive(&self, random: &mut Stream) -> Option<Choice> {
        let plant = self.scene.plant;
        let is_driven = |j: usize| plant.robot.drives.iter().any(|d| d.joint == j);
        let candidates: Vec<usize> = (0..plant.robot.joints.len()).filter(|&j| !is_driven(j) && self.scene.speeds[j] > 0.02).collect();
        let joint = *random.choose(&candidates)?;
        let speed = self.scene.speeds[joint];
        let start = self.force() * self.fact.speed / speed;
        let law = Resist::Coulomb { speed: 0.02 * speed };
        let name = plant.robot.joints[joint].name.as_str();
        Some(Choice::new("friction_passive", &[name], "smooth sign", start, resist(joint, joint, law)).with(|a| one("coulomb", a, 0.0)))
    }

    fn transmission(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (k, joint, f) = (self.k, self.joint, self.fact);
        let rotor = self.scene.plant.rotors[joint];
        let here = [self.name()];
        let link = (f.inertia - rotor).max(0.1 * rotor);
        // What swings when motor and link swing against each other.
        let swinging = rotor * link / (rotor + link).max(1e-9);
        let flexible = move |m: &mut Machine, flex: Flex| {
            m.flex[k] = Some((flex, rotor));
            m.plant.rotors[joint] = 0.0;
            m.substeps = m.substeps.max(3);
        };
        Some(match name {
            "backlash" if rotor > 0.0 => {
                let stiffness = swinging * (TAU * 60.0) * (TAU * 60.0);
                let apply: Apply = Box::new(move |m, a, _| {
                    let damping = 0.4 * (stiffness * swinging).sqrt();
                    flexible(m, Flex { stiffness, hardening: f64::INFINITY, damping, gap: a });
                    Ok(())
                });
                Choice::new(name, &here, "gap between springs and dampers, impacts", 3e-3 * f.reach, apply)
                    .cap(0.1 * f.reach)
                    .with(|a| one("gap", a, 0.0))
            }
            "joint_elasticity" if rotor > 0.0 => {
                let per_hertz = swinging * TAU * TAU;
                let is_hard = random.chance(0.6);
                let apply: Apply = Box::new(move |m, a, _| {
                    let hardening = if is_hard { 3.0 * f.spread * a } else { f64::INFINITY };
                    flexible(m, Flex { stiffness: 1.0 / a, hardening, damping: 0.1 * (swinging / a).sqrt(), gap: 0.0 });
                    Ok(())
                });
                let choice =
                    Choice::new(name, &here, "linear or hardening spring", 1.0 / (per_hertz * 900.0), apply).cap(1.0 / (per_hertz * 36.0));
                let choice = if is_hard { choice } else { choice.textbook() };
                choice.with(|a| one("stiffness", 1.0 / a, 0.0))
            }
            "structure_flexibility" => return self.rocking(random),
            "transmission_coupling" if self.scene.plant.robot.loops.is_empty() && k > 0 => {
                let from = self.scene.plant.robot.drives[k - 1].joint;
                let other = self.scene.facts[k - 1];
                let strength = [0.05 * (f.inertia * other.inertia).sqrt(), self.force(), self.force() / other.speed];
                let apply: Apply = Box::new(move |m, a, _| {
                    m.felt.push(Felt { from, to: joint, strength: strength.map(|s| s * a) });
                    Ok(())
                });
                let names = [self.scene.plant.robot.drive_name(k - 1), self.name()];
                Choice::new(name, &names, "inertia, dry and viscous friction", 0.5, apply).textbook().cap(10.0).with(move |a| {
                    [one("inertia", a * strength[0], 0.0), one("coulomb", a * strength[1], 0.0), one("viscous", a * strength[2], 0.0)]
                        .concat()
                })
            }
            _ => return None,
        })
    }

    fn rocking(&self, random: &mut Stream) -> Option<Choice> {
        let plant = self.scene.plant;
        let heading = random.uniform(0.0, PI);
        let axis = if plant.robot.gravity.norm() > 0.0 { Vector3::new(cos(heading), sin(heading), 0.0) } else { Vector3::z() };
        let mut rocking = Plant::rocking(&plant.robot, axis).ok()?;
        rocking.rotors[1..].copy_from_slice(&plant.rotors);
        let mut q = rocking.home.clone();
        let inertia = rocking.moving(&mut q, &vec![0.0; rocking.freedoms()]).ok()?.mass[(0, 0)];
        let per_hertz = inertia * TAU * TAU;
        let apply: Apply = Box::new(move |m, a, _| {
            // The robot of the machine, not the nominal one: decoys stay.
            let mut rocking = Plant::rocking(&m.plant.robot, axis)?;
            rocking.rotors[1..].copy_from_slice(&m.plant.rotors);
            for r in &mut m.resistances {
                (r.joint, r.other) = (r.joint + 1, r.other + 1);
            }
            m.plant = rocking;
            m.rock = Some([1.0 / a, 0.1 * (inertia / a).sqrt()]);
            m.substeps = m.substeps.max(2);
            Ok(())
        });
        let choice =
            Choice::new("structure_flexibility", &[&plant.robot.root], "base on a torsion spring", 1.0 / (per_hertz * 400.0), apply);
        Some(choice.cap(1.0 / (per_hertz * 16.0)).with(|a| one("stiffness", 1.0 / a, 0.0)))
    }

    fn mass(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let robot = &self.scene.plant.robot;
        let joint = self.joint;
        Some(match name {
            "rotor_inertia" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.plant.rotors[joint + usize::from(m.rock.is_some())] += a;
                    Ok(())
                });
                Choice::new(name, &[self.name()], "inertia", 0.05 * self.fact.inertia, apply).textbook().with(|a| one("inertia", a, 0.0))
            }
            "payload" => {
                let end = robot.end();
                let at = robot.joints[end].inertia.centre() + Vector3::from_fn(|_, _| random.uniform(-0.08, 0.08));
                let total: f64 = robot.joints.iter().map(|j| j.inertia.mass).sum();
                let apply: Apply = Box::new(move |m, a, _| {
                    let ball = crate::robot::Inertia::about_centre(a, at, nalgebra::Matrix3::identity() * (a * 0.0016));
                    let link = end + usize::from(m.rock.is_some());
                    m.plant.robot.joints[link].inertia = m.plant.robot.joints[link].inertia.plus(&ball);
                    Ok(())
                });
                Choice::new(name, &[&robot.joints[end].link], "a ball off the middle", 0.02 * total, apply)
                    .textbook()
                    .with(|a| one("mass", a, 0.0))
            }
            "inertia_error" => {
                let link = *random.choose(&self.scene.plant.weighty())?;
                let mass = robot.joints[link].inertia.mass;
                let apply: Apply = Box::new(move |m, a, _| {
                    let link = link + usize::from(m.rock.is_some());
                    m.plant.robot.joints[link].inertia = m.plant.robot.joints[link].inertia.times(1.0 + a);
                    Ok(())
                });
                Choice::new(name, &[&robot.joints[link].link], "all ten numbers too small", 0.1, apply)
                    .textbook()
                    .cap(2.0)
                    .with(move |a| one("mass", mass * (1.0 + a), mass))
            }
            "gravity_tilt" if robot.gravity.norm() > 0.0 => {
                let (is_roll, sign) = (random.chance(0.5), random.sign());
                let heading = if is_roll { 0.0 } else { FRAC_PI_2 };
                let apply: Apply = Box::new(move |m, a, _| {
                    m.plant.robot.gravity = tilt(heading, sign * a) * m.plant.robot.gravity;
                    Ok(())
                });
                Choice::new(name, &[&robot.root], "gravity about x or y", 0.01, apply)
                    .textbook()
                    .cap(0.2)
                    .with(move |a| one(if is_roll { "roll" } else { "pitch" }, a, 0.0))
            }
            "geometry_error" => return self.geometry(random),
            _ => return None,
        })
    }

    fn geometry(&self, random: &mut Stream) -> Option<Choice> {
        let robot = &self.scene.plant.robot;
        let sign = random.sign();
        let axis_name = |axis: usize| ["dx", "dy", "dz"][axis];
        if robot.loops.is_empty() {
            let joint = *random.choose(&[2_usize, 3].into_iter().filter(|j| *j < robot.joints.len()).collect::<Vec<_>>())?;
            let axis = robot.joints[joint].origin.iamax();
            let apply: Apply = Box::new(move |m, a, _| {
                m.plant.robot.joints[joint + usize::from(m.rock.is_some())].origin[axis] += sign * a;
                Ok(())
            });
            let link = &robot.joints[robot.joints[joint].parent?].link;
            return Some(
                Choice::new("geometry_error", &[link], "a longer link", 2e-3, apply)
                    .textbook()
                    .cap(0.05)
                    .with(move |a| one(axis_name(axis), a, 0.0)),
            );
        }
        let l = random.index(robot.loops.len());
        let axis = robot.loops[l].held[random.index(robot.loops[l].held.len())];
        let apply: Apply = Box::new(move |m, a, _| {
            m.plant.robot.loops[l].a.1[axis] += sign * a;
            Ok(())
        });
        let choice = Choice::new("geometry_error", &[&robot.loops[l].name], "an anchor beside its place", 1e-3, apply);
        Some(choice.textbook().cap(0.02).with(move |a| one(axis_name(axis), a, 0.0)))
    }

    fn position(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (f, force) = (self.fact, self.force());
        let here = [self.name()];
        let at = |law| resist(self.joint, self.joint, law);
        Some(match name {
            "spring" => {
                let rest = f.centre + random.uniform(-0.5, 0.5) * f.reach;
                Choice::new(name, &here, "hardening", force / f.reach, at(Resist::Spring { rest, hardening: 2.0 * f.reach }))
                    .with(|a| one("stiffness", a, 0.0))
            }
            "cable_force" => {
                let mut heights = [0.0; 5].map(|_: f64| random.uniform(-1.5, 1.5));
                let mean = heights.iter().sum::<f64>() / 5.0;
                heights.iter_mut().for_each(|h| *h -= mean);
                let stroke = [f.centre - 1.1 * f.reach, f.centre + 1.1 * f.reach];
                Choice::new(name, &here, "spline of Catmull and Rom with hysteresis", force, at(Resist::Hose { stroke, heights }))
            }
            "torque_ripple" => {
                let order = random.uniform(3.0, 7.0) * PI / f.reach;
                let law = Resist::Ripple { order, phase: random.uniform(0.0, TAU), harmonics: [0.3, 0.15] };
                Choice::new(name, &here, "three harmonics", force, at(law))
                    .with(move |a| [one("amplitude", a, 0.0), one("order", order, 0.0)].concat())
            }
            "contact" => {
                let side = random.sign();
                let from = f.centre + 0.55 * side * f.reach;
                Choice::new(name, &here, "Hunt and Crossley", force / pow(0.2 * f.reach, 1.5), at(Resist::Contact { at: from, side }))
                    .with(move |_| one("position", from, 0.0))
            }
            _ => return None,
        })
    }

    fn effort(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (k, f, force) = (self.k, self.fact, self.force());
        let here = [self.name()];
        Some(match name {
            "torque_constant" => {
                let sign = random.sign();
                let apply: Apply = Box::new(move |m, a, _| {
                    m.chains[k].scale = 1.0 + sign * a;
                    Ok(())
                });
                Choice::new(name, &here, "scale", 0.05, apply).textbook().cap(0.5).with(move |a| one("scale", 1.0 + sign * a, 1.0))
            }
            "torque_offset" => {
                let sign = random.sign();
                let joint = self.joint;
                let apply: Apply = Box::new(move |m, a, r| resist(joint, joint, Resist::Offset)(m, sign * a, r));
                Choice::new(name, &here, "constant", force, apply).textbook().with(move |a| one("offset", sign * a, 0.0))
            }
            "actuator_lag" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.chains[k].lag = a;
                    // The second pole must stay well inside the step.
                    m.substeps = m.substeps.max(if a < 1e-3 {
                        8
                    } else if a < 3e-3 {
                        4
                    } else {
                        2
                    });
                    Ok(())
                });
                Choice::new(name, &here, "second order", 2e-3, apply).cap(0.02).with(|a| one("time_constant", a, 0.0))
            }
            "time_delay" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.chains[k].delay += a;
                    Ok(())
                });
                Choice::new(name, &here, "pure delay", 1e-3, apply).textbook().cap(0.02).with(|a| one("delay", a, 0.0))
            }
            "saturation" => {
                let peak = f.peak;
                let apply: Apply = Box::new(move |m, a, _| {
                    m.chains[k].limit = peak * (1.0 - a);
                    Ok(())
                });
                Choice::new(name, &here, "rounded corner", 0.05, apply).cap(0.5).with(move |a| one("limit", peak * (1.0 - a), 0.0))
            }
            "dead_zone" => {
                let apply: Apply = Box::new(move |m, a, _| {
                    m.chains[k].dead = a;
                    Ok(())
                });
                Choice::new(name, &here, "dead zone", force, apply).textbook().cap(0.5 * f.spread).with(|a| one("width", a, 0.0))
            }
            _ => return None,
        })
    }

    fn sensor(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (k, f) = (self.k, self.fact);
        let here = [self.name()];
        let is_slide = self.scene.plant.robot.joints[self.joint].motion == Motion::Slide;
        Some(match name {
            "encoder_offset" => {
                let sign = random.sign();
                let apply: Apply = Box::new(move |m, a, _| {
                    m.encoders[k].offset = sign * a;
                    Ok(())
                });
                Choice::new(name, &here, "constant", 0.01 * f.reach, apply)
                    .textbook()
                    .cap(0.2 * f.reach)
                    .with(move |a| one("offset", sign * a, 0.0))
            }
            "encoder_eccentricity" => {
                // Once per turn of a screw of 20 mm, or of the joint.
                let order = if is_slide { TAU / 0.02 } else { 1.0 + f64::from(u8::from(random.chance(0.5))) };
                let phase = random.uniform(0.0, TAU);
                let apply: Apply = Box::new(move |m, a, _| {
                    m.encoders[k] = crate::laws::Encoder { amplitude: a, order, phase, ..m.encoders[k] };
                    Ok(())
                });
                let cap = (0.1 * f.reach).min(0.3 / order);
                Choice::new(name, &here, "two harmonics", 0.05 * cap, apply).cap(cap).with(|a| one("amplitude", a, 0.0))
            }
            "sensor_drift" => {
                let sign = random.sign();
                let apply: Apply = Box::new(move |m, a, _| {
                    m.drift[k] = sign * a;
                    Ok(())
                });
                Choice::new(name, &here, "effort drifts in proportion to time", self.force() / 6.0, apply)
                    .textbook()
                    .with(move |a| one("rate", sign * a, 0.0))
            }
            _ => return None,
        })
    }

    /// Hands on the end effector.
    fn outer(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let robot = &self.scene.plant.robot;
        let link = robot.end();
        // The middle of mass, unless that is where the link turns about.
        let centre = robot.joints[link].inertia.centre();
        let point = if robot.name == "motobotte" { Vector3::zeros() } else { centre };
        let here = [robot.joints[link].link.as_str()];
        let arm = if robot.joints[self.joint].motion == Motion::Slide { 1.0 } else { 0.4 };
        let force = self.force() / arm;
        let hold = move |m: &mut Machine, push: Push| {
            m.hands.push(Hand { link: link + usize::from(m.rock.is_some()), point, push });
            Ok(())
        };
        Some(match name {
            "limb_impedance" => {
                let reach = self.fact.reach * arm;
                let apply: Apply = Box::new(move |m, a, _| hold(m, Push::Limb { stiffness: a, damping: 0.1, hardening: 3.0 * reach }));
                Choice::new(name, &here, "stiffening, with a Maxwell branch", force / reach, apply).with(|a| one("stiffness", a, 0.0))
            }
            "external_force" => {
                let along = Vector3::from_fn(|_, _| random.normal()).normalize();
                let start = random.uniform(2.0, 5.0);
                let times = [start, start + random.uniform(2.0, 4.0)];
                let apply: Apply = Box::new(move |m, a, recording| {
                    // Nobody pushes during the holdout.
                    if recording < HOLDOUT { hold(m, Push::Between { along: along * a, times }) } else { Ok(()) }
                });
                Choice::new(name, &here, "swelling and fading", 2.0 * force, apply)
            }
            "active_limb" => {
                let restless = restless(random);
                let apply: Apply = Box::new(move |m, a, recording| hold(m, Push::Restless { sines: restless(a, recording) }));
                Choice::new(name, &here, "never repeats", force, apply)
            }
            _ => return None,
        })
    }

    fn outside(&self, name: &str, random: &mut Stream) -> Option<Choice> {
        let (f, force, soft) = (self.fact, self.force(), self.soft());
        let here = [self.name()];
        let at = |law| resist(self.joint, self.joint, law);
        Some(match name {
            "outside_cubed_coupling" if self.scene.facts.len() > 1 => {
                let k = (self.k + 1 + random.index(self.scene.facts.len() - 1)) % self.scene.facts.len();
                let speed = self.scene.facts[k].speed;
                let apply = resist(self.joint, self.scene.plant.robot.drives[k].joint, Resist::CubedOther);
                Choice::new(name, &here, "cube of another joint's velocity", force / pow(speed, 3.0), apply)
            }
            "outside_free_sine" => {
                let law = Resist::FreeSine { hz: random.uniform(1.1, 3.7), phase: random.uniform(0.0, TAU) };
                Choice::new(name, &here, "sine in time", force, at(law))
            }
            "outside_detent" => {
                let law = Resist::Detent { at: f.centre + random.uniform(-0.4, 0.4) * f.reach, width: 0.08 * f.reach };
                Choice::new(name, &here, "magnetic detent", 3.0 * force, at(law))
            }
            "outside_creep" => Choice::new(
                name,
                &here,
                "spring and damper in series",
                force / f.reach,
                at(Resist::Creep { time: random.uniform(0.3, 1.0) }),
            ),
            "outside_inertial_stick" => Choice::new(
                name,
                &here,
                "dry friction in proportion to acceleration",
                force / (6.0 * f.speed),
                at(Resist::InertialStick { speed: soft }),
            ),
            "outside_travel_friction" => {
                let law = Resist::Travel { pitch: random.uniform(2.0, 4.0) * f.reach, speed: soft };
                Choice::new(name, &here, "dry friction that comes and goes with distance travelled", force, at(law))
            }
            _ => return None,
        })
    }
}

/// A patient who never does the same twice: forces of that root mean square `[N]` for each recording.
pub fn restless(random: &mut Stream) -> impl Fn(f64, usize) -> [Vec<[f64; 3]>; 3] + Send + Sync + use<> {
    let seed = random.bits();
    move |rms, recording| {
        let mut random = Stream::new(seed, recording as u64, "restless");
        [0; 3].map(|_| {
            // Square roots of primes over the recording: no common period.
            (0..8).map(|_| [rms / 2.0, random.uniform(0.2, 2.5), random.uniform(0.0, TAU)]).collect()
        })
    }
}
