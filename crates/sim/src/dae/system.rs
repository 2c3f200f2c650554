//! Equations of motion of an extended model with every effect: accelerations of the tree for a state and the drives' efforts.

use pkm_dyn::constrained::{Stabilisation, bias_motion, complete_motion};
use pkm_dyn::effects::{JointState, Law, Memory, Robot, Site};
use pkm_dyn::loops::distribute;
use pkm_dyn::model::Model;
use pkm_dyn::spatial::{Force, Pose};
use pkm_dyn::{Data, math};

use crate::dae::extension::{Extension, Spring};
use crate::dae::person::Person;
use crate::dae::touch::{Touching, link_pose, push_link};
use crate::laws::ForeignLaw;

type JointLaw = (fn(&[f64], &JointState) -> f64, Vec<f64>);

/// A joint with anything that acts at its coordinate and has no state of its own.
#[derive(Debug)]
pub(crate) struct Resisting {
    pub(crate) joint: usize,
    viscous: f64,
    coulomb: f64,
    laws: Vec<JointLaw>,
    /// Laws with states of their own at this joint, by index.
    foreign: Vec<usize>,
    /// Joint whose rotor an effect on inertia changes, and its inertia without effects.
    rotor: usize,
    armature: f64,
    has_inertia: bool,
}

impl Resisting {
    pub(crate) fn has_foreign(&self, law: usize) -> bool {
        self.foreign.contains(&law)
    }
}

/// A force with a memory at a joint.
#[derive(Debug)]
struct Remembering {
    joint: usize,
    memory: Memory,
    values: Vec<f64>,
}

/// What moves, how far and how fast, and what it remembers.
#[derive(Debug, Clone)]
pub(crate) struct State {
    /// Tree coordinates of the extended model `[m | rad]`.
    pub(crate) q: Vec<f64>,
    /// `[m/s | rad/s]`.
    pub(crate) v: Vec<f64>,
    /// States of the laws with a memory.
    pub(crate) z: Vec<f64>,
    /// Efforts that the rigid robot transmits at its joints, as last evaluated `[N | N·m]`.
    pub(crate) load: Vec<f64>,
    /// Accelerations as last evaluated `[m/s² | rad/s²]`.
    pub(crate) a: Vec<f64>,
    /// `[s]`.
    pub(crate) time: f64,
}

impl State {
    pub(crate) fn new(nv: usize, n_memories: usize) -> Self {
        let zero = vec![0.0; nv];
        Self { q: zero.clone(), v: zero.clone(), z: vec![0.0; n_memories], load: zero.clone(), a: zero, time: 0.0 }
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.q.copy_from_slice(&other.q);
        self.v.copy_from_slice(&other.v);
        self.z.copy_from_slice(&other.z);
        self.load.copy_from_slice(&other.load);
        self.a.copy_from_slice(&other.a);
        self.time = other.time;
    }
}

/// The equations, with their scratch.
#[derive(Debug)]
pub(crate) struct System {
    pub(crate) model: Model,
    pub(crate) data: Data,
    /// Number of drives; the model's further actuators are freedoms that nothing drives.
    pub(crate) n_act: usize,
    /// Efforts of the tree `[N | N·m]`.
    pub(crate) tau: Vec<f64>,
    /// Rates of the memories.
    pub(crate) dz: Vec<f64>,
    pub(crate) resisting: Vec<Resisting>,
    pub(crate) springs: Vec<Spring>,
    pub(crate) foreign: Vec<Box<dyn ForeignLaw>>,
    remembering: Vec<Remembering>,
    touching: Vec<Touching>,
    persons: Vec<Person>,
    /// Wrenches from outside: link, and force and moment in its frame at its origin.
    pub(crate) pushed: Vec<(usize, Force)>,
    /// Direction in which each resisting joint slides: −1, 0 (it has no direction) or 1.
    pub(crate) directions: Vec<f64>,
}

impl System {
    /// The equations of `robot`, extended by `extension`; `foreign` laws name joints of the extended model.
    pub(crate) fn new(robot: &Robot, extension: &Extension, foreign: Vec<Box<dyn ForeignLaw>>, seed: u64) -> Self {
        let model = extension.model.clone();
        let nv = model.nv();
        let mut remembering = Vec::new();
        let mut touching = Vec::new();
        let mut persons = Vec::new();
        for e in &robot.effects {
            let joint = (e.site == Site::Joint).then(|| extension.joint[e.place]);
            let link = if joint.is_some() { 0 } else { e.place };
            match e.entry.law {
                Law::Memory(memory) => {
                    remembering.extend(joint.map(|joint| Remembering { joint, memory, values: e.values.clone() }));
                }
                Law::Wrench(law) => touching.push(Touching { law, values: e.values.clone(), link, joint, start: Pose::identity() }),
                Law::Person => persons.push(Person::draw(seed, persons.len() as u64, link, e.values[0])),
                _ => {}
            }
        }
        let resisting = resisting(robot, extension, &foreign);
        Self {
            n_act: robot.model.n_act(),
            data: Data::new(&model),
            tau: vec![0.0; nv],
            dz: vec![0.0; remembering.len()],
            directions: vec![0.0; resisting.len()],
            springs: extension.springs.clone(),
            model,
            resisting,
            foreign,
            remembering,
            touching,
            persons,
            pushed: Vec::new(),
        }
    }

    pub(crate) fn n_memories(&self) -> usize {
        self.remembering.len()
    }

    /// Remembers where links and joints are: displacements count from here. Poses in `data` are those of `state`.
    pub(crate) fn begin_at(&mut self, state: &State) {
        for touching in &mut self.touching {
            match touching.joint {
                Some(j) => touching.start.translation.x = state.q[j],
                None => touching.start = link_pose(&self.model, &self.data, touching.link),
            }
        }
    }

    /// Accelerations in `data.a`, rates of the memories in `dz`, for a state and the drives' efforts `push` `[N | N·m]`; joints that rub
    /// slide in `directions`. Loads and accelerations are left in `state` for what depends on them next. `None` where nothing moves.
    #[must_use]
    pub(crate) fn accelerate(&mut self, state: &mut State, push: &[f64]) -> Option<()> {
        self.bias(state)?;
        self.undirected_efforts(state, push);
        for r in 0..self.resisting.len() {
            let joint = self.resisting[r].joint;
            let v = state.v[joint];
            let sign = if self.directions[r] == 0.0 { math::sign(v) } else { self.directions[r] };
            self.tau[joint] -= self.effort(r, &self.joint_state(r, state, v, sign));
        }
        if !complete_motion(&self.model, &mut self.data, &self.tau) {
            return None;
        }
        self.keep_loads(state);
        Some(())
    }

    /// Kinematics and velocity terms at a state.
    #[must_use]
    pub(crate) fn bias(&mut self, state: &State) -> Option<()> {
        self.set_rotors(state);
        let closure = bias_motion(&self.model, &mut self.data, &state.q, &state.v, Stabilisation::default());
        (closure.rank == self.data.dependent.len() && closure.gap.is_finite()).then_some(())
    }

    /// `tau` of drives, springs, memories, touched links and persons.
    pub(crate) fn undirected_efforts(&mut self, state: &State, push: &[f64]) {
        self.tau.fill(0.0);
        for (&j, push) in self.model.actuators.iter().zip(push) {
            self.tau[j] += push;
        }
        for s in &self.springs {
            let of = |x: &[f64]| x[s.plus] - s.minus.map_or(0.0, |m| x[m]);
            let effort = s.stiffness * of(&state.q) + s.damping * of(&state.v);
            self.tau[s.plus] -= effort;
            if let Some(m) = s.minus {
                self.tau[m] += effort;
            }
        }
        for (i, r) in self.remembering.iter().enumerate() {
            let (z, v) = (state.z[i], state.v[r.joint]);
            self.tau[r.joint] -= (r.memory.effort)(&r.values, z, v);
            self.dz[i] = (r.memory.rate)(&r.values, z, v);
        }
        self.touch(state);
    }

    fn touch(&mut self, state: &State) {
        let Self { model, data, tau, touching, persons, pushed, .. } = self;
        for t in touching.iter() {
            if let Some(j) = t.joint {
                tau[j] -= t.at_joint(state, j);
            } else {
                let on_robot = t.on_robot(model, data, state.time);
                push_link(model, data, tau, t.link, &on_robot);
            }
        }
        for person in persons.iter() {
            let at = link_pose(model, data, person.link).translation;
            let linear = person.force(state.time);
            push_link(model, data, tau, person.link, &Force { linear, angular: at.cross(&linear) });
        }
        for (link, wrench) in pushed.iter() {
            push_link(model, data, tau, *link, &link_pose(model, data, *link).force_to_parent(wrench));
        }
    }

    /// Force and moment of environment and persons on `link`, about the root's origin in its axes, from the poses in `data`.
    pub(crate) fn touch_of(&self, link: usize, time: f64) -> Force {
        let mut sum = Force::zero();
        let same = |l: usize| l == link || (self.model.links[l].body.is_some() && self.model.links[l].body == self.model.links[link].body);
        for t in self.touching.iter().filter(|t| t.joint.is_none() && same(t.link)) {
            sum += t.on_robot(&self.model, &self.data, time);
        }
        for person in self.persons.iter().filter(|p| same(p.link)) {
            let at = link_pose(&self.model, &self.data, person.link).translation;
            let linear = person.force(time);
            sum += Force { linear, angular: at.cross(&linear) };
        }
        for (l, wrench) in self.pushed.iter().filter(|(l, _)| same(*l)) {
            sum += link_pose(&self.model, &self.data, *l).force_to_parent(wrench);
        }
        sum
    }

    /// The state of a resisting joint as its laws see it.
    pub(crate) fn joint_state(&self, r: usize, state: &State, v: f64, sign: f64) -> JointState {
        let Resisting { joint, viscous, coulomb, .. } = self.resisting[r];
        JointState {
            q: state.q[joint],
            v,
            sign,
            load: state.load[joint],
            viscous,
            coulomb,
            warmth: state.time,
            time: state.time,
            ..JointState::default()
        }
    }

    /// Effort of everything without a state of the plant's at a resisting joint `[N | N·m]`.
    pub(crate) fn effort(&self, r: usize, s: &JointState) -> f64 {
        let at = &self.resisting[r];
        let mut sum = at.viscous * s.v + at.coulomb * s.sign;
        for (law, values) in &at.laws {
            sum += law(values, s);
        }
        for &f in &at.foreign {
            let (backward, forward) = self.foreign[f].levels(s);
            sum += 0.5 * (backward + forward + s.sign * (forward - backward));
        }
        sum
    }

    /// Derivatives of a memory's effort in a step of `h` by the joint's velocity, and its effort and state in mid-step.
    pub(crate) fn memory_step(&self, i: usize, z: f64, v: f64, h: f64) -> (f64, f64) {
        let Remembering { memory, values, .. } = &self.remembering[i];
        let rate = (memory.rate)(values, z, v);
        let slope = self.memory_slope(i, z, v, rate);
        // Half a step of a rate linear in z, implicit: bounded however stiff the memory is.
        let factor = 1.0 - 0.5 * h * slope;
        let middle = z + 0.5 * h * rate / factor;
        let effort = (memory.effort)(values, middle, v);
        let dv = 1e-6 * (1.0 + v.abs());
        let faster = z + 0.5 * h * (memory.rate)(values, z, v + dv) / factor;
        (effort, ((memory.effort)(values, faster, v + dv) - effort) / dv)
    }

    /// A memory after a step of `h` at a constant velocity.
    pub(crate) fn memory_after(&self, i: usize, z: f64, v: f64, h: f64) -> f64 {
        let Remembering { memory, values, .. } = &self.remembering[i];
        let rate = (memory.rate)(values, z, v);
        z + h * rate / (1.0 - 0.5 * h * self.memory_slope(i, z, v, rate))
    }

    fn memory_slope(&self, i: usize, z: f64, v: f64, rate: f64) -> f64 {
        let Remembering { memory, values, .. } = &self.remembering[i];
        // A displacement: whatever the unit, a thousandth of a micrometre or more.
        let dz = 1e-9 + 1e-6 * z.abs();
        (((memory.rate)(values, z + dz, v) - rate) / dz).min(0.0)
    }

    /// Fastest decay `[1/s]` and oscillation `[rad/s]` of the memories, with the inertia at their joints.
    pub(crate) fn fastest_memory(&self, state: &State, inertia: impl Fn(usize) -> f64) -> (f64, f64) {
        let mut fastest = (0.0_f64, 0.0_f64);
        for (i, Remembering { joint, memory, values }) in self.remembering.iter().enumerate() {
            let (z, v) = (state.z[i], state.v[*joint]);
            let rate = (memory.rate)(values, z, v);
            let (dz, dv) = (1e-9 + 1e-6 * z.abs(), 1e-6 * (1.0 + v.abs()));
            let stiffness = ((memory.effort)(values, z + dz, v) - (memory.effort)(values, z, v)) / dz;
            let follows = ((memory.rate)(values, z, v + dv) - rate) / dv;
            fastest.0 = fastest.0.max(-self.memory_slope(i, z, v, rate));
            fastest.1 = fastest.1.max(math::sqrt((stiffness * follows).max(0.0) / inertia(*joint)));
        }
        fastest
    }

    pub(crate) fn memory_joint(&self, i: usize) -> usize {
        self.remembering[i].joint
    }

    /// Rotors with what effects add to their inertia at this state.
    fn set_rotors(&mut self, state: &State) {
        for r in 0..self.resisting.len() {
            if !self.resisting[r].has_inertia {
                continue;
            }
            let inertia = self.inertia(r, state);
            let at = &self.resisting[r];
            self.model.joints[at.rotor].armature = at.armature + inertia;
        }
    }

    fn inertia(&self, r: usize, state: &State) -> f64 {
        let s = self.joint_state(r, state, state.v[self.resisting[r].joint], 0.0);
        self.effort(r, &JointState { a: 1.0, ..s }) - self.effort(r, &s)
    }

    /// Finds which joints carry an effect on inertia; call once, with the start.
    pub(crate) fn find_inertia(&mut self, state: &State) {
        for r in 0..self.resisting.len() {
            let rotor = self.resisting[r].rotor;
            self.resisting[r].armature = self.model.joints[rotor].armature;
            self.resisting[r].has_inertia = self.inertia(r, state) != 0.0;
        }
    }

    /// Efforts that the rigid robot transmits, for effects that grow with the load, and the accelerations.
    pub(crate) fn keep_loads(&mut self, state: &mut State) {
        state.a.copy_from_slice(&self.data.a);
        if self.resisting.is_empty() {
            return;
        }
        let Self { model, data, .. } = self;
        for (k, column) in data.reduction.column_iter().enumerate() {
            data.tau_ind[k] = column.iter().zip(&data.tau).map(|(g, t)| g * t).sum();
        }
        if model.n_act() > data.n_ind() {
            distribute(model, data);
            model.actuators.iter().zip(&data.tau_act).for_each(|(&j, load)| state.load[j] = *load);
            return;
        }
        data.independent.iter().zip(&data.tau_ind).for_each(|(&j, load)| state.load[j] = *load);
    }
}

fn resisting(robot: &Robot, extension: &Extension, foreign: &[Box<dyn ForeignLaw>]) -> Vec<Resisting> {
    let model = &extension.model;
    let mut out = Vec::new();
    for joint in 0..model.nv() {
        let own = extension.joint.iter().position(|&j| j == joint);
        let acts = |i: usize| match robot.effects[i].entry.law {
            Law::JointEffort(_) => own.is_some_and(|j| robot.effects[i].is_at_joint(j)),
            Law::PairEffort(_) => extension.sums.contains(&(i, joint)),
            _ => false,
        };
        let laws: Vec<JointLaw> = (0..robot.effects.len())
            .filter(|&i| acts(i))
            .filter_map(|i| match robot.effects[i].entry.law {
                Law::JointEffort(law) | Law::PairEffort(law) => Some((law, robot.effects[i].values.clone())),
                _ => None,
            })
            .collect();
        let foreign: Vec<usize> = (0..foreign.len()).filter(|&f| own == Some(foreign[f].joint())).collect();
        let (viscous, coulomb) = (model.joints[joint].viscous, model.joints[joint].coulomb);
        if viscous > 0.0 || coulomb > 0.0 || !laws.is_empty() || !foreign.is_empty() {
            let rotor = own.map_or(joint, |j| extension.rotor[j]);
            out.push(Resisting { joint, viscous, coulomb, laws, foreign, rotor, armature: 0.0, has_inertia: false });
        }
    }
    out
}
