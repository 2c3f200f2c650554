//! Freedoms that effects add to a robot, as joints of an extended model: motors behind their transmissions, links on springs, sums of
//! two coordinates.
//!
//! Everything beyond the rigid robot is then a joint, a spring between two joints or a stop between them, and the equations of motion
//! need not know where a freedom came from.

use nalgebra::Vector3;
use pkm_dyn::InertialParameters;
use pkm_dyn::effects::{Law, Robot, Site, Transmission};
use pkm_dyn::model::{Coupling, FrameOnBody, Joint, JointKind, Model, Part};

use crate::error::SimError;

/// A spring with damper on the difference of two coordinates, or on one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spring {
    pub(crate) plus: usize,
    pub(crate) minus: Option<usize>,
    /// `[N/m | N·m/rad]`.
    pub(crate) stiffness: f64,
    /// `[N·s/m | N·m·s/rad]`.
    pub(crate) damping: f64,
}

/// A one-sided limit of the difference of two coordinates, or of one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stop {
    pub(crate) plus: usize,
    pub(crate) minus: Option<usize>,
    /// 1: the difference stays below the limit, −1: above it.
    pub(crate) side: f64,
    /// `[m | rad]`.
    pub(crate) limit: f64,
    /// Speed after over speed before an impact, 0 to 1.
    pub(crate) restitution: f64,
}

impl Stop {
    /// Difference of the coordinates `x`.
    pub(crate) fn difference(&self, x: &[f64]) -> f64 {
        x[self.plus] - self.minus.map_or(0.0, |m| x[m])
    }

    /// Way left to the stop `[m | rad]`, negative beyond it.
    pub(crate) fn room(&self, q: &[f64]) -> f64 {
        self.side * (self.limit - self.difference(q))
    }
}

/// A robot's model with every freedom that its effects add.
#[derive(Debug, Clone)]
pub(crate) struct Extension {
    /// Drives first, in their order, then the added freedoms that no drive moves: all of them are the model's "actuators".
    pub(crate) model: Model,
    /// Joint of the extended model for each joint of the robot.
    pub(crate) joint: Vec<usize>,
    /// Joint that carries the rotor of each joint of the robot: its motor where it has one, else itself.
    pub(crate) rotor: Vec<usize>,
    pub(crate) springs: Vec<Spring>,
    pub(crate) stops: Vec<Stop>,
    /// Joint of the sum for each effect on a pair of joints, by index of the effect.
    pub(crate) sums: Vec<(usize, usize)>,
    /// Motors and the joints behind them.
    pub(crate) motors: Vec<[usize; 2]>,
}

impl Extension {
    /// Extends the model of `robot`; `end_stops` is the restitution of its joint limits, if they are to stop it.
    pub(crate) fn try_new(robot: &Robot, end_stops: Option<f64>) -> Result<Self, SimError> {
        let nv = robot.model.nv();
        let mut out = Self {
            model: robot.model.clone(),
            joint: (0..nv).collect(),
            rotor: (0..nv).collect(),
            springs: Vec::new(),
            stops: Vec::new(),
            sums: Vec::new(),
            motors: Vec::new(),
        };
        // Structures first: they move the indices of joints.
        let mut hung = Vec::new();
        for e in &robot.effects {
            if matches!(e.entry.law, Law::Structure) {
                out.hang(e.place, [e.values[0], e.values[1]], &mut hung);
            }
        }
        out.rotor.clone_from(&out.joint);
        for (i, e) in robot.effects.iter().enumerate() {
            match (e.entry.law, e.other) {
                (Law::PairEffort(_), Some(other)) => out.add_sum(i, e.place, other),
                (Law::PairEffort(_), None) => return no_place(e.entry.name, "it needs two joints"),
                (Law::Transmission(kind), _) if e.site == Site::Joint => out.part(e.entry.name, e.place, kind, &e.values)?,
                _ => {}
            }
        }
        if let Some(restitution) = end_stops {
            out.add_end_stops(restitution);
        }
        out.model.actuators.extend(hung);
        out.model.actuators.extend(out.motors.iter().map(|m| m[1]));
        Ok(out)
    }

    /// Puts three springs between a link's body and what carried it.
    fn hang(&mut self, link: usize, [stiffness, damping]: [f64; 2], hung: &mut Vec<usize>) {
        let at = insert(&mut self.model, link);
        let shift = |j: &mut usize| {
            if *j >= at {
                *j += 3;
            }
        };
        self.joint.iter_mut().for_each(shift);
        hung.iter_mut().for_each(shift);
        for spring in &mut self.springs {
            shift(&mut spring.plus);
        }
        for k in 0..3 {
            self.springs.push(Spring { plus: at + k, minus: None, stiffness, damping });
            hung.push(at + k);
        }
    }

    fn add_sum(&mut self, effect: usize, first: usize, second: usize) {
        let [first, second] = [first, second].map(|j| self.joint[j]);
        let model = &mut self.model;
        let name = format!("{}+{}", model.joints[first].name, model.joints[second].name);
        let sum = append(model, Joint::new(name, model.joints[first].kind, Vector3::z(), None));
        model.assembly[sum] = model.assembly[first] + model.assembly[second];
        model.couplings.push(Coupling { joint: sum, of: vec![(first, 1.0), (second, 1.0)], offset: 0.0 });
        self.sums.push((effect, sum));
    }

    /// Gives the drive of a joint a motor with a coordinate of its own.
    fn part(&mut self, effect: &'static str, place: usize, kind: Transmission, values: &[f64]) -> Result<(), SimError> {
        let load = self.joint[place];
        let Some(drive) = self.model.actuators.iter().position(|&j| j == load) else {
            return no_place(effect, "the joint has no drive of its own, or its drive has a transmission already");
        };
        let model = &mut self.model;
        let joint = &model.joints[load];
        let stated = if kind == Transmission::Spring { values.get(2).copied().unwrap_or(0.0) } else { 0.0 };
        let mut motor = Joint::new(format!("{}.motor", joint.name), joint.kind, Vector3::z(), None);
        motor.limits = joint.limits;
        // A rotor stated smaller than the robot file's leaves the rest of it, the gear, on the joint's side.
        motor.armature = if stated > 0.0 { stated } else { joint.armature };
        model.joints[load].armature = (model.joints[load].armature - motor.armature).max(0.0);
        let start = model.assembly[load];
        let motor = append(model, motor);
        model.assembly[motor] = start;
        model.actuators[drive] = motor;
        self.rotor[place] = motor;
        self.motors.push([motor, load]);
        match kind {
            Transmission::Spring => {
                self.springs.push(Spring { plus: motor, minus: Some(load), stiffness: values[0], damping: values[1] });
            }
            Transmission::Play => {
                for side in [1.0, -1.0] {
                    let limit = side * 0.5 * values[0];
                    self.stops.push(Stop { plus: motor, minus: Some(load), side, limit, restitution: 0.0 });
                }
            }
        }
        Ok(())
    }

    fn add_end_stops(&mut self, restitution: f64) {
        for &j in &self.joint {
            let limits = self.model.joints[j].limits;
            for (side, limit) in [(1.0, limits.upper), (-1.0, limits.lower)] {
                if limit.is_finite() && limits.upper > limits.lower {
                    self.stops.push(Stop { plus: j, minus: None, side, limit, restitution });
                }
            }
        }
    }
}

fn no_place<T>(effect: &'static str, problem: &'static str) -> Result<T, SimError> {
    Err(SimError::NoPlace { effect, problem })
}

/// Appends a joint that moves a massless body on the root; its index.
fn append(model: &mut Model, joint: Joint) -> usize {
    model.joints.push(joint);
    model.bodies.push(InertialParameters::default());
    model.assembly.push(0.0);
    model.nv() - 1
}

/// Inserts three travels before the body of `link`, or under everything where it is fixed to the root; the index of the first.
fn insert(model: &mut Model, link: usize) -> usize {
    let body = model.links[link].body;
    // A joint of several coordinates is moved as one.
    let mut at = body.unwrap_or(0);
    while at > 0 && body.is_some() && matches!(model.joints[at].part, Part::Inner | Part::Last) {
        at -= 1;
    }
    let carrier = body.and_then(|_| model.joints[at].parent);
    let moved = |j: usize| if j >= at { j + 3 } else { j };
    let last = at + 2;
    let on = |b: Option<usize>| match (b, body) {
        (Some(b), _) => Some(moved(b)),
        (None, None) => Some(last),
        (None, Some(_)) => None,
    };
    if body.is_none() {
        let fixed = model.links.iter().filter(|l| l.body.is_none());
        let base = fixed.fold(InertialParameters::default(), |sum, l| sum.joined(&l.parameters.transformed(&l.pose)));
        model.bodies.splice(0..0, [InertialParameters::default(), InertialParameters::default(), base]);
    } else {
        model.bodies.splice(at..at, [InertialParameters::default(); 3]);
    }
    for (j, joint) in model.joints.iter_mut().enumerate() {
        joint.parent = if j == at && body.is_some() { Some(last) } else { on(joint.parent) };
    }
    let name = |k: usize| format!("{}.{}", model.links[link].name, ["x", "y", "z"][k]);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let travels: Vec<Joint> =
        (0..3).map(|k| Joint::new(name(k), JointKind::Prismatic, axes[k], if k == 0 { carrier } else { Some(at + k - 1) })).collect();
    model.joints.splice(at..at, travels);
    model.assembly.splice(at..at, [0.0; 3]);
    for l in &mut model.links {
        l.body = on(l.body);
    }
    let frames = model.loops.iter_mut().flat_map(|l| [&mut l.a, &mut l.b]);
    frames.for_each(|frame: &mut FrameOnBody| frame.body = on(frame.body));
    for c in &mut model.couplings {
        c.joint = moved(c.joint);
        c.of.iter_mut().for_each(|(j, _)| *j = moved(*j));
    }
    model.actuators.iter_mut().for_each(|j| *j = moved(*j));
    at
}
