//! What identification can estimate of a robot: a list of parameters, each with a name, a unit, its nominal value and the column of the
//! regressor that belongs to it.
//!
//! The effort of the drives is linear in all of them: ten inertial parameters of every link with mass, rotor inertia and effort offset of
//! every drive, viscous and Coulomb friction of every joint that moves, passive ones included, the stiffness of springs that the robot
//! file names, amplitude and phase of ripples it names (an effort periodic in position: gear mesh, cogging, a spring on a lever), and
//! every value that enters linearly of the other friction laws it names (Stribeck's two levels, friction by direction, by load). Friction
//! of a passive joint reaches the drives through the reduction.

use pkm_dyn::effects::{Applied, Energy, JointState, Law, Robot, Unit, bent_away};
use pkm_dyn::inverse_dynamics::actuated_regressor;
use pkm_dyn::loops::drive_reduction;
use pkm_dyn::model::Joint;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL, NAMES, UNITS};
use pkm_dyn::{Data, Model, math};

/// What a parameter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// An inertial parameter of a link, about the link's frame.
    Inertial {
        /// Index of the link.
        link: usize,
        /// Which of the ten, in the order of [`NAMES`].
        which: usize,
    },
    /// Rotor inertia of a drive, seen at its joint.
    Rotor {
        /// The driven joint.
        joint: usize,
    },
    /// Viscous friction.
    Viscous {
        /// The joint, driven or passive.
        joint: usize,
    },
    /// Coulomb friction.
    Coulomb {
        /// The joint, driven or passive.
        joint: usize,
    },
    /// Constant part of a drive's effort.
    Offset {
        /// The driven joint.
        joint: usize,
    },
    /// Stiffness of a spring of the robot file, about its stated rest.
    Stiffness {
        /// The joint, driven or passive.
        joint: usize,
    },
    /// Sine or cosine part of a torque ripple of the robot file, at its stated order.
    Wave {
        /// The joint, driven or passive.
        joint: usize,
        /// Which part.
        part: Part,
    },
    /// A value of a friction law of the robot file that the effort is linear in.
    Law {
        /// The joint, driven or passive.
        joint: usize,
        /// The law, among those of [`Columns::laws`].
        law: usize,
        /// Which of its values.
        value: usize,
    },
}

/// A part of an effort `sine·sin(order·q) + cosine·cos(order·q)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Of the sine.
    Sine,
    /// Of the cosine.
    Cosine,
}

/// One parameter and its column.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// What it is.
    pub quantity: Quantity,
    /// Name, `<link or joint>.<parameter>`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Value in the robot's files.
    pub nominal: f64,
    /// Smallest physical value; inertial parameters are bound by the pseudo-inertia instead.
    pub lower: f64,
}

/// All parameters of a robot, and how its files' other effects stay in the equations.
#[derive(Debug, Clone)]
pub struct Columns {
    /// The parameters, in the order of the columns.
    pub list: Vec<Parameter>,
    /// Links with mass, in the order of the inertial columns.
    pub links: Vec<usize>,
    bodies: Vec<(usize, nalgebra::SMatrix<f64, N_INERTIAL, N_INERTIAL>)>,
    /// Rest and curvature of every stiffness, order of every wave, by column; zeros for other columns.
    stated: Vec<[f64; 2]>,
    /// Friction laws of the robot file whose linear values are columns.
    pub laws: Vec<Applied>,
    /// Values with which a law makes the column of its value number `k`, `alone[law][k]`.
    alone: Vec<Vec<Vec<f64>>>,
    kept: Vec<Applied>,
}

/// A friction law that the file states and that is estimated value by value; one that is no sum over its linear values (an efficiency, of
/// which one less it is a loss, or friction along the stroke from a place that is stated) stays as it is stated.
pub(crate) fn is_friction_law(e: &Applied) -> bool {
    matches!(e.entry.law, Law::JointEffort(_)) && e.entry.energy == Energy::Dissipates && !ESTIMATED.contains(&e.entry.name) && is_a_sum(e)
}

/// States of a joint at which laws are asked what they are: to both sides, with and without friction of its own, below which some laws do
/// not let friction fall.
fn probes() -> impl Iterator<Item = JointState> {
    let states = [(0.3, 1.0, 2.0), (-0.7, -1.0, 0.4), (0.05, 1.0, -3.0), (-0.02, -1.0, -1.0)];
    let sides = [(0.4, 1e3), (-0.4, 0.0), (0.4, 0.0), (-0.4, 1e3)];
    states.into_iter().zip(sides).map(|((v, sign, load), (q, coulomb))| JointState {
        q,
        v,
        a: 0.1,
        sign,
        load,
        viscous: 10.0,
        coulomb,
        warmth: 1.5,
        ..JointState::default()
    })
}

/// Whether the effort is the sum over the linear values of value times the effort that the value one makes alone, and nothing besides.
fn is_a_sum(e: &Applied) -> bool {
    let Law::JointEffort(law) = e.entry.law else { return false };
    let linear: Vec<usize> = (0..e.values.len()).filter(|&k| is_linear(e, k)).collect();
    probes().all(|s| {
        let whole = law(&e.values, &s);
        let sum: f64 = linear.iter().map(|&k| e.values[k] * effort_of(e, &alone(e, k), &s)).sum();
        (whole - sum).abs() <= 1e-9 * (whole.abs() + sum.abs()) + 1e-12
    })
}

/// Whether the effort of a law is linear in its value number `k`: told by the law itself at a few states.
#[must_use]
pub fn is_linear(e: &Applied, k: usize) -> bool {
    let Law::JointEffort(law) = e.entry.law else { return false };
    let at = |scale: f64, s: &JointState| {
        // Levels that are equal would hide what tells them apart.
        let mut values: Vec<f64> = e.values.iter().enumerate().map(|(i, x)| x.abs().max(0.5) + 0.3 * (i + 1) as f64).collect();
        values[k] *= scale;
        law(&values, s)
    };
    probes().all(|s| {
        let [a, b, c] = [1.0, 2.0, 3.0].map(|scale| at(scale, &s));
        (c - 2.0 * b + a).abs() <= 1e-9 * (a.abs() + b.abs() + c.abs())
    })
}

/// Effects of a robot file that are parameters here: their values are counted into the nominal ones and they leave the file.
pub(crate) const ESTIMATED: [&str; 9] = [
    "friction_viscous",
    "friction_coulomb",
    "friction_passive",
    "rotor_inertia",
    "torque_offset",
    "spring",
    "torque_ripple",
    "inertia_error",
    "payload",
];

impl Columns {
    /// The parameters of `robot`.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let model = &robot.model;
        let links = model.massive_links();
        let frame = |&l: &usize| (model.links[l].body.unwrap_or(0), InertialParameters::transform_matrix(&model.links[l].pose));
        let is_kept =
            |e: &&Applied| matches!(e.entry.law, Law::JointEffort(_)) && !ESTIMATED.contains(&e.entry.name) && !is_friction_law(e);
        let (mut list, mut stated) = list(robot, &links);
        let laws: Vec<Applied> = robot.effects.iter().filter(|e| is_friction_law(e)).cloned().collect();
        list.extend(laws.iter().enumerate().flat_map(|(l, e)| law_parameters(model, l, e)));
        stated.resize(list.len(), [0.0; 2]);
        Self {
            alone: laws.iter().map(|e| (0..e.values.len()).map(|k| alone(e, k)).collect()).collect(),
            laws,
            list,
            bodies: links.iter().map(frame).collect(),
            links,
            stated,
            kept: robot.effects.iter().filter(is_kept).cloned().collect(),
        }
    }

    /// Number of parameters.
    #[must_use]
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there is nothing to estimate.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Values in the robot's files.
    #[must_use]
    pub fn nominal(&self) -> Vec<f64> {
        self.list.iter().map(|p| p.nominal).collect()
    }

    /// One body by itself, ten parameters.
    pub(crate) fn of_body(name: &str, body: &InertialParameters) -> Self {
        let theta = body.to_vector();
        let parameter = |which: usize| Parameter {
            quantity: Quantity::Inertial { link: 0, which },
            name: format!("{name}.{}", NAMES[which]),
            unit: UNITS[which],
            nominal: theta[which],
            lower: f64::NEG_INFINITY,
        };
        Self {
            list: (0..N_INERTIAL).map(parameter).collect(),
            links: vec![0],
            bodies: Vec::new(),
            stated: vec![[0.0; 2]; N_INERTIAL],
            laws: Vec::new(),
            alone: Vec::new(),
            kept: Vec::new(),
        }
    }

    /// Index of the parameter of that name.
    #[must_use]
    pub fn index(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|p| p.name == name)
    }

    /// Writes the columns at the motion in `data` ([`pkm_dyn::inverse_dynamics::closed_loop_motion`]): `put(drive, column, value)`.
    ///
    /// `direction` has one entry per tree joint, −1 to 1. Columns that are zero by structure are not put. Of more drives than freedoms a column
    /// is what of it moves the robot ([`pkm_dyn::loops::drive_reduction`]): one drive's friction is then felt in the rows of all.
    pub fn fill(&self, model: &Model, data: &mut Data, direction: &[f64], put: &mut impl FnMut(usize, usize, f64)) {
        actuated_regressor(model, data);
        drive_reduction(model, data);
        let n_act = model.n_act();
        let is_shared = n_act > data.n_ind();
        // Effort that the nominal rigid robot transmits at the drives: some friction grows with it.
        let mut load = vec![0.0; if self.laws.is_empty() { 0 } else { n_act }];
        for (l, (body, to_body)) in self.bodies.iter().enumerate() {
            for k in 0..n_act {
                let mut own = [0.0; N_INERTIAL];
                for (b, own) in own.iter_mut().enumerate() {
                    let felt = data.regressor.column(body * N_INERTIAL + b);
                    *own = if is_shared { data.distribution.row(k).iter().zip(felt.iter()).map(|(d, x)| d * x).sum() } else { felt[k] };
                }
                if own.iter().all(|x| x.abs() <= 0.0) {
                    continue;
                }
                for c in 0..N_INERTIAL {
                    // Columns are per body about the body's frame; a link fixed at an offset needs them about its own.
                    let sum: f64 = own.iter().enumerate().map(|(b, x)| x * to_body[(b, c)]).sum();
                    put(k, l * N_INERTIAL + c, sum);
                    if let Some(load) = load.get_mut(k) {
                        *load += sum * self.list[l * N_INERTIAL + c].nominal;
                    }
                }
            }
        }
        for (c, p) in self.list.iter().enumerate().skip(self.links.len() * N_INERTIAL) {
            let (joint, value) = match p.quantity {
                Quantity::Inertial { .. } => continue,
                Quantity::Rotor { joint } => (joint, data.a[joint]),
                Quantity::Viscous { joint } => (joint, data.v[joint]),
                Quantity::Coulomb { joint } => (joint, direction[joint]),
                Quantity::Offset { joint } => (joint, 1.0),
                Quantity::Stiffness { joint } => {
                    let [rest, curvature] = self.stated[c];
                    (joint, bent_away(data.q[joint] - rest, curvature))
                }
                Quantity::Wave { joint, part: Part::Sine } => (joint, math::sin(self.stated[c][0] * data.q[joint])),
                Quantity::Wave { joint, part: Part::Cosine } => (joint, math::cos(self.stated[c][0] * data.q[joint])),
                Quantity::Law { joint, law, value } => {
                    let at_drive = model.actuators.iter().position(|&a| a == joint);
                    let load = at_drive.map_or(0.0, |k| load[k] + model.joints[joint].armature * data.a[joint]);
                    let [q, v, a] = [data.q[joint], data.v[joint], data.a[joint]];
                    let (viscous, coulomb) = (model.joints[joint].viscous, model.joints[joint].coulomb);
                    let state = JointState { q, v, a, sign: direction[joint], load, viscous, coulomb, ..JointState::default() };
                    (joint, effort_of(&self.laws[law], &self.alone[law][value], &state))
                }
            };
            for k in 0..n_act {
                let gain = data.drive_reduction[(joint, k)];
                if gain.abs() > 0.0 {
                    put(k, c, gain * value);
                }
            }
        }
    }

    /// Effort of the effects that stay as the file states them, at the drives, into `out` `[N | N·m]`; `load` is the rigid effort there. Call
    /// [`Columns::fill`] or [`pkm_dyn::loops::drive_reduction`] first.
    pub fn kept_effort(&self, model: &Model, data: &Data, direction: &[f64], load: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for e in &self.kept {
            let Law::JointEffort(law) = e.entry.law else { continue };
            let j = e.place;
            let at_drive = model.actuators.iter().position(|&a| a == j);
            let load = at_drive.map_or(0.0, |k| load[k]);
            let (viscous, coulomb) = (model.joints[j].viscous, model.joints[j].coulomb);
            let [q, v, a] = [data.q[j], data.v[j], data.a[j]];
            let state = JointState { q, v, a, sign: direction[j], load, viscous, coulomb, ..JointState::default() };
            let effort = law(&e.values, &state);
            for (k, out) in out.iter_mut().enumerate() {
                *out += data.drive_reduction[(j, k)] * effort;
            }
        }
    }

    /// Rest of the stiffness, or order of the wave, that column `c` is about; zero for other columns.
    pub(crate) fn stated(&self, c: usize) -> f64 {
        self.stated[c][0]
    }

    /// Whether any effect stays as the file states it.
    #[must_use]
    pub fn has_kept_effort(&self) -> bool {
        !self.kept.is_empty()
    }

    /// The inertial parameters of massive link number `l` within `theta`.
    ///
    /// # Panics
    /// With fewer values than inertial columns.
    #[must_use]
    pub fn inertial(theta: &[f64], l: usize) -> InertialParameters {
        let at = l * N_INERTIAL;
        InertialParameters::from_vector(&nalgebra::SVector::from_column_slice(&theta[at..at + N_INERTIAL]))
    }
}

/// Effort of a law whose value number `k` is one and whose other linear values are zero.
fn alone(e: &Applied, k: usize) -> Vec<f64> {
    let value = |i: usize| if i == k { 1.0 } else { f64::from(u8::from(!is_linear(e, i))) * e.values[i] };
    (0..e.values.len()).map(value).collect()
}

fn effort_of(e: &Applied, values: &[f64], state: &JointState) -> f64 {
    if let Law::JointEffort(law) = e.entry.law { law(values, state) } else { 0.0 }
}

/// The values of a friction law that the effort is linear in.
fn law_parameters(model: &Model, law: usize, e: &Applied) -> Vec<Parameter> {
    let Joint { name, kind, .. } = &model.joints[e.place];
    let parameter = |k: usize| {
        let p = &e.entry.parameters[k];
        Parameter {
            quantity: Quantity::Law { joint: e.place, law, value: k },
            name: format!("{name}.{}.{}", e.entry.name, p.name),
            unit: p.unit.text(*kind),
            nominal: e.values[k],
            lower: p.lower,
        }
    };
    (0..e.values.len()).filter(|&k| is_linear(e, k)).map(parameter).collect()
}

/// Parameters, and what the robot file states of each that is not estimated.
fn list(robot: &Robot, links: &[usize]) -> (Vec<Parameter>, Vec<[f64; 2]>) {
    let model = &robot.model;
    let mut out = Vec::new();
    for &link in links {
        let theta = model.links[link].parameters.to_vector();
        for which in 0..N_INERTIAL {
            out.push(Parameter {
                quantity: Quantity::Inertial { link, which },
                name: format!("{}.{}", model.links[link].name, NAMES[which]),
                unit: UNITS[which],
                nominal: theta[which],
                lower: f64::NEG_INFINITY,
            });
        }
    }
    let counted = |effect: &str, joint: usize, value: usize| -> f64 {
        let such = |e: &&Applied| e.entry.name == effect && e.place == joint;
        robot.effects.iter().filter(such).map(|e| e.values[value]).sum()
    };
    let mut push = |quantity, j: usize, what: &str, unit: Unit, nominal: f64, lower: f64| {
        let Joint { name, kind, .. } = &model.joints[j];
        out.push(Parameter { quantity, name: format!("{name}.{what}"), unit: unit.text(*kind), nominal, lower });
    };
    for &joint in &model.actuators {
        let rotor = model.joints[joint].armature + counted("rotor_inertia", joint, 0);
        push(Quantity::Rotor { joint }, joint, "rotor_inertia", Unit::Inertia, rotor, 0.0);
    }
    for j in frictional(model) {
        let viscous = model.joints[j].viscous + counted("friction_viscous", j, 0) + counted("friction_passive", j, 1);
        let coulomb = model.joints[j].coulomb + counted("friction_coulomb", j, 0) + counted("friction_passive", j, 0);
        push(Quantity::Viscous { joint: j }, j, "viscous", Unit::EffortPerVelocity, viscous, 0.0);
        push(Quantity::Coulomb { joint: j }, j, "coulomb", Unit::Effort, coulomb, 0.0);
    }
    for &joint in &model.actuators {
        push(Quantity::Offset { joint }, joint, "offset", Unit::Effort, counted("torque_offset", joint, 0), f64::NEG_INFINITY);
    }
    let mut stated = Vec::new();
    for e in robot.effects.iter().filter(|e| e.entry.name == "spring") {
        push(Quantity::Stiffness { joint: e.place }, e.place, "stiffness", Unit::EffortPerPosition, e.values[0], f64::NEG_INFINITY);
        stated.push([e.values[1], e.values[2]]);
    }
    for e in robot.effects.iter().filter(|e| e.entry.name == "torque_ripple") {
        let [amplitude, order, phase] = [e.values[0], e.values[1], e.values[2]];
        for (part, name, share) in [(Part::Sine, "sine", math::cos(phase)), (Part::Cosine, "cosine", math::sin(phase))] {
            let name = format!("{name}_{order}");
            push(Quantity::Wave { joint: e.place, part }, e.place, &name, Unit::Effort, amplitude * share, f64::NEG_INFINITY);
            stated.push([order, 0.0]);
        }
    }
    let before = out.len() - stated.len();
    let stated = [vec![[0.0; 2]; before], stated].concat();
    (out, stated)
}

/// Joints that can rub: drives first, then passive joints that move bodies, in the order of the tree.
fn frictional(model: &Model) -> Vec<usize> {
    let mut joints = model.actuators.clone();
    joints.extend(model.passive());
    joints
}
