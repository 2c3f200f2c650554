//! One pass over a segment through the robot's equations: everything candidate columns are made of.

use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, rigid_effort};
use pkm_dyn::jacobian::{Reference, frame_jacobian};
use pkm_dyn::loops::{self, drive_reduction};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};
use pkm_dyn::{Data, Model, math};
use pkm_ident::degrees::unit_that_closes;

use crate::channels::{self, Channel};
use crate::error::InputError;
use crate::held::Held;
use crate::nominal;
use crate::pushed::Pushed;
use crate::segment::Segment;
use crate::sensitivity::{Here, Knots, Lengths, Sensitivity};
use crate::settings::SOFTNESS;
use crate::shelf::Tape;
use crate::turning::Turn;

/// A passive joint along a segment.
#[derive(Debug, Clone)]
pub(crate) struct Passive {
    /// Position `[m | rad]`.
    pub(crate) q: Vec<f64>,
    /// Velocity `[m/s | rad/s]`.
    pub(crate) v: Vec<f64>,
    /// Acceleration `[m/s² | rad/s²]`.
    pub(crate) a: Vec<f64>,
    /// Row of the reduction: velocity per velocity of each drive, [drive][sample].
    pub(crate) g: Vec<Vec<f64>>,
}

/// A segment seen through the robot. Efforts are at the drives; outer index: drive, inner: raw sample.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub(crate) segment: Segment,
    /// Rigid bodies and rotor inertia, and what surplus drives were measured to do to each other `[N | N·m]`.
    pub(crate) rigid: Vec<Vec<f64>>,
    /// Effort per unit of each inertial parameter of each massive link: [link·10 + k][drive][sample].
    pub(crate) link_columns: Vec<Vec<Tape>>,
    /// Gravity in the root frame `[m/s²]`.
    gravity: [f64; 3],
    /// Change of the rigid effort with positions, speeds, accelerations and lengths.
    pub(crate) sensitivity: Sensitivity,
    /// Effort per unit of acceleration of the ground along each axis of the root: [axis][drive][sample].
    pub(crate) shaken: [Vec<Tape>; 3],
    /// Force of the ground on the robot along each axis of the root `[N]`.
    pub(crate) reaction: [Vec<f64>; 3],
    /// Effort that passes through each drive's transmission, friction on the load's side included, the rotor's own inertia not.
    pub(crate) transmitted: Vec<Vec<f64>>,
    /// Positions measured besides those of the drives.
    pub(crate) channels: Vec<Channel>,
    /// Rotor inertia of each drive `[kg | kg·m²]`.
    pub(crate) rotor: Vec<f64>,
    /// Joints without a drive, ascending.
    pub(crate) passive: Vec<Passive>,
    /// Their numbers in the tree.
    pub(crate) dependent: Vec<usize>,
    /// Links that may be held or pushed.
    pub(crate) held: Vec<Held>,
    /// Of more drives than freedoms what of the drives' efforts moves the robot, [drive][drive][sample]; empty otherwise.
    pub(crate) moves: Vec<Vec<Vec<f64>>>,
    /// Measured position of each of these drives less the one that the loops have for all of them together, [drive][sample].
    pub(crate) contradiction: Vec<Vec<f64>>,
    /// Links that may be pushed, those nearer to the root first.
    pub(crate) pushed: Vec<Pushed>,
    /// Effort of the model as given, per softness: [softness][drive][sample].
    pub(crate) nominal: Vec<Vec<Vec<f64>>>,
    /// How directions pass through zero: [softness][tree joint].
    pub(crate) turns: Vec<Vec<Turn>>,
    /// Weight of rows in which a drive turns over, by drive; nothing where its friction there may be anything.
    pub(crate) turning_weight: Vec<f64>,
}

impl Motion {
    /// Smoothed direction of motion.
    pub(crate) fn direction(v: &[f64], turn: Turn) -> Vec<f64> {
        v.iter().map(|v| turn.sign(*v)).collect()
    }

    /// Effort per radian of base roll (axis 0) or pitch (axis 1): [drive][sample].
    pub(crate) fn tilt(&self, axis: usize) -> Vec<Vec<f64>> {
        // Gravity seen from a base turned by +roll or +pitch turns the other way.
        let [x, y, z] = self.gravity;
        let part = [[0.0, z, -y], [-z, 0.0, x]][axis];
        let of_drive = |k: usize| {
            let shaken = self.shaken.each_ref().map(|axis| axis[k].read());
            (0..self.segment.valid.len()).map(|i| -(0..3).map(|c| part[c] * shaken[c][i]).sum::<f64>()).collect()
        };
        (0..self.rigid.len()).map(of_drive).collect()
    }

    /// Lets go of what only columns are made from.
    pub(crate) fn shed(&mut self) {
        self.link_columns.iter_mut().flatten().chain(self.shaken.iter_mut().flatten()).for_each(Tape::shed);
        (self.sensitivity, self.reaction, self.transmitted) = (Sensitivity::default(), Default::default(), Vec::new());
        (self.held, self.pushed) = (Vec::new(), Vec::new());
    }
}

/// `v/√(v² + w²)`: the sign of `v`, passing through zero over a width `w`.
pub(crate) fn soft_sign(v: f64, width: f64) -> f64 {
    let length = math::sqrt(v * v + width * width);
    if length > 0.0 { v / length } else { 0.0 }
}

/// A series that stays below this share of the largest of its unit is rounding: efforts that matter are nine digits above it.
const ROUNDING: f64 = 1e-12;

struct Pass {
    model: Model,
    data: Data,
    links: Vec<usize>,
    lengths: Lengths,
    out: Motion,
}

/// Runs the robot's equations along a segment.
pub(crate) fn motion(robot: &Robot, segment: Segment) -> Result<Motion, InputError> {
    motion_with(robot, segment, Lengths::Taken)
}

/// The same, with or without what wrong lengths would do: most of the work where a robot has loops.
pub(crate) fn motion_with(robot: &Robot, segment: Segment, lengths: Lengths) -> Result<Motion, InputError> {
    let mut model = robot.model.clone();
    if let Some(g) = segment.gravity {
        model.gravity = g.into();
    }
    apply_load(&mut model, &segment)?;
    let (n, na) = (segment.valid.len(), model.n_act());
    let links = model.massive_links();
    let data = Data::new(&model);
    let zeros = || vec![vec![0.0; n]; na];
    let tapes = || vec![Tape::new(&segment.shelf); na];
    let dependent = model.passive();
    let passive = dependent.iter().map(|_| Passive { q: vec![0.0; n], v: vec![0.0; n], a: vec![0.0; n], g: zeros() }).collect();
    let is_shared = na > data.n_ind();
    let (moves, contradiction) = if is_shared { (vec![zeros(); na], zeros()) } else { (Vec::new(), Vec::new()) };
    let out = Motion {
        rigid: zeros(),
        link_columns: vec![tapes(); links.len() * N_INERTIAL],
        gravity: model.gravity.into(),
        sensitivity: Sensitivity::default(),
        shaken: [tapes(), tapes(), tapes()],
        reaction: [vec![0.0; n], vec![0.0; n], vec![0.0; n]],
        transmitted: zeros(),
        channels: segment
            .channels
            .iter()
            .map(|(kind, measured)| Channel {
                kind: *kind,
                measured: measured.clone(),
                nominal: vec![0.0; n],
                by_drive: Vec::new(),
                by_length: Vec::new(),
            })
            .collect(),
        rotor: model.actuators.iter().map(|&j| model.joints[j].armature).collect(),
        passive,
        dependent,
        moves,
        contradiction,
        held: Held::all(robot, (na, n), &segment.shelf),
        pushed: Vec::new(),
        nominal: Vec::new(),
        turns: Vec::new(),
        turning_weight: vec![0.0; na],
        segment,
    };
    let mut pass = Pass { model, data, links, lengths, out };
    pass.run()?;
    let mut out = pass.out;
    out.turns = softnesses(&robot.model, &out);
    nominal::fill(robot, &mut out);
    Ok(out)
}

fn apply_load(model: &mut Model, segment: &Segment) -> Result<(), InputError> {
    let Some(load) = &segment.load else { return Ok(()) };
    let bad = |detail: String| InputError::Meta { recording: segment.name.clone(), key: "load", detail };
    let link = model.link_index(&load.link).ok_or_else(|| bad(format!("no link {:?} in this robot", load.link)))?;
    if !(load.mass.is_finite() && load.mass >= 0.0) {
        return Err(bad(format!("mass = {} kg (must be finite and >= 0)", load.mass)));
    }
    let body = InertialParameters::from_centre_of_mass(load.mass, load.xyz.into(), nalgebra_zero());
    let sum = model.links[link].parameters.joined(&body);
    model.set_link_parameters(link, sum);
    Ok(())
}

fn nalgebra_zero() -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::zeros()
}

impl Pass {
    fn run(&mut self) -> Result<(), InputError> {
        let (n, na) = (self.out.segment.valid.len(), self.model.n_act());
        let moments: Vec<_> = self
            .links
            .iter()
            .map(|&l| (self.model.links[l].body.unwrap_or(0), InertialParameters::transform_matrix(&self.model.links[l].pose)))
            .collect();
        let (mut q, mut v, mut a) = (vec![0.0; na], vec![0.0; na], vec![0.0; na]);
        let mut spared = vec![vec![0.0; n]; na];
        let kinds = self.out.channels.iter().map(|c| c.kind).collect();
        let mut knots = Knots::new(&self.model, (kinds, self.lengths), (n, self.out.segment.dt), self.out.segment.band);
        self.out.pushed = Pushed::all(&self.model, (n, knots.every()));
        let closure = loops::assemble(&self.model, &mut self.data);
        self.check(&closure, 0)?;
        for i in 0..n {
            for k in 0..na {
                (q[k], v[k], a[k]) = (self.out.segment.q[k][i], self.out.segment.v[k][i], self.out.segment.a[k][i]);
            }
            if i == 0 {
                let closure = loops::walk_to(&self.model, &mut self.data, &q);
                self.check(&closure, 0)?;
            }
            let closure = closed_loop_motion(&self.model, &mut self.data, &q, &v, &a);
            self.check(&closure, i)?;
            rigid_effort(&self.model, &mut self.data);
            drive_reduction(&self.model, &mut self.data);
            self.store(i, &moments);
            for held in &mut self.out.held {
                held.store(&self.model, &mut self.data, i);
            }
            self.ground(i);
            self.measured_wrenches(i, &mut spared);
            for c in &mut self.out.channels {
                c.nominal[i] = channels::value(&self.model, &self.data, c.kind, &q);
            }
            if knots.is_knot(i) {
                self.out.pushed.iter_mut().for_each(|p| p.take(&self.model, &mut self.data));
                let effort: Vec<f64> = self.out.rigid.iter().map(|r| r[i]).collect();
                let internal = self.internal(i);
                let here = Here { q: &q, v: &v, a: &a, effort: &effort, internal: &internal };
                knots.take(&self.model, &mut self.data, &here).or_else(|closure| self.check(&closure, i))?;
            }
        }
        let (sensitivity, of_channels) = knots.finish();
        self.out.sensitivity = sensitivity;
        for (c, [by_drive, by_length]) in self.out.channels.iter_mut().zip(of_channels) {
            (c.by_drive, c.by_length) = (by_drive, by_length);
            c.unwrap_turns();
        }
        for (rigid, spared) in self.out.rigid.iter_mut().flatten().zip(spared.iter().flatten()) {
            *rigid -= spared;
        }
        for i in 0..n {
            let internal = self.internal(i);
            self.out.rigid.iter_mut().zip(internal).for_each(|(rigid, strain)| rigid[i] += strain);
        }
        self.clear_rounding();
        Ok(())
    }

    /// Makes inertial columns that no drive feels the zeros they stand for: brought to unit length, rounding would be a regressor.
    fn clear_rounding(&mut self) {
        for unit in [0..1, 1..4, 4..N_INERTIAL] {
            let of_unit = |column: usize| unit.contains(&(column % N_INERTIAL));
            let columns = self.out.link_columns.iter_mut().enumerate().filter(|(c, _)| of_unit(*c));
            let mut series: Vec<&mut Tape> = columns.flat_map(|(_, drives)| drives.iter_mut()).collect();
            let largest = series.iter().map(|x| x.top()).fold(0.0, f64::max);
            series.iter_mut().filter(|x| x.top() < ROUNDING * largest).for_each(|x| x.clear());
        }
    }

    fn check(&mut self, closure: &loops::Closure, i: usize) -> Result<(), InputError> {
        if closure.is_closed {
            return Ok(());
        }
        let robot = self.model.name.clone();
        if closure.gap < 1e-9 {
            let q = self.data.q.clone();
            let mobility = loops::mobility(&self.model, &mut self.data, &q);
            return Err(InputError::Mobility { robot, mobility, drives: self.model.n_act() });
        }
        let s = &self.out.segment;
        let time = s.start + s.dt * i as f64;
        let q: Vec<f64> = s.q.iter().map(|q| q[i]).collect();
        let unit = unit_that_closes(&self.model, &q);
        Err(InputError::Open { recording: s.name.clone(), time, row: closure.row, gap: closure.gap, robot, unit })
    }

    fn store(&mut self, i: usize, moments: &[(usize, nalgebra::SMatrix<f64, 10, 10>)]) {
        let na = self.model.n_act();
        for k in 0..na {
            self.out.rigid[k][i] = self.data.tau_act[k];
        }
        let Motion { dependent, passive, moves, contradiction, segment, .. } = &mut self.out;
        for (&j, passive) in dependent.iter().zip(passive) {
            (passive.q[i], passive.v[i], passive.a[i]) = (self.data.q[j], self.data.v[j], self.data.a[j]);
            for k in 0..na {
                passive.g[k][i] = self.data.drive_reduction[(j, k)];
            }
        }
        for (d, (&j, row)) in self.model.actuators.iter().zip(moves).enumerate() {
            row.iter_mut().enumerate().for_each(|(k, series)| series[i] = self.data.drive_reduction[(j, k)]);
            contradiction[d][i] = segment.q[d][i] - self.data.q[j];
        }
        actuated_regressor(&self.model, &mut self.data);
        let is_shared = na > self.data.n_ind();
        for (l, (body, l_to_body)) in moments.iter().enumerate() {
            for c in 0..N_INERTIAL {
                // Columns are per body about the body's frame; a link fixed at an offset needs them about its own.
                let data = &self.data;
                let felt = |k: usize| (0..N_INERTIAL).map(|b| data.regressor[(k, body * N_INERTIAL + b)] * l_to_body[(b, c)]).sum::<f64>();
                for k in 0..na {
                    let shared = || (0..data.n_ind()).map(|f| data.distribution[(k, f)] * felt(f)).sum();
                    self.out.link_columns[l * N_INERTIAL + c][k].push(if is_shared { shared() } else { felt(k) });
                }
            }
        }
    }

    /// What the drives were measured to do to each other at sample `i`: their efforts without what moves the robot.
    fn internal(&self, i: usize) -> Vec<f64> {
        let tau = &self.out.segment.tau;
        let moved = |row: &Vec<Vec<f64>>| -> f64 { row.iter().zip(tau).map(|(p, tau)| p[i] * tau[i]).sum() };
        self.out.moves.iter().zip(tau).map(|(row, tau)| tau[i] - moved(row)).collect()
    }

    /// Weight is linear in gravity: a small tilt adds the weight under the turned part of gravity, and ground that is accelerated one way
    /// is gravity the other way.
    fn ground(&mut self, i: usize) {
        // The wrenches of the bodies are still those of the motion; what the root's own joints carry, the ground does.
        let roots = self.model.joints.iter().enumerate().filter(|(_, j)| j.parent.is_none());
        let carried = roots.fold(nalgebra::Vector3::zeros(), |sum, (b, _)| sum + self.data.force_w[b].linear);
        for axis in 0..3 {
            self.out.reaction[axis][i] = carried[axis];
            let mut up = nalgebra::Vector3::zeros();
            up[axis] = -1.0;
            for (k, e) in weight(&self.model, &mut self.data, up).into_iter().enumerate() {
                self.out.shaken[axis][k].push(e);
            }
        }
    }

    /// Effort that the drives are spared by what the environment was measured to do: `Jᵀ·w`, seen from the drives.
    fn measured_wrenches(&mut self, i: usize, spared: &mut [Vec<f64>]) {
        for w in &self.out.segment.wrenches {
            let sensor = &self.model.sensors[w.sensor];
            let link = &self.model.links[sensor.link];
            let frame = FrameOnBody { body: link.body, pose: link.pose.compose(&sensor.pose) };
            let jacobian = frame_jacobian(&self.model, &mut self.data, &frame, Reference::Local).clone();
            for (k, spared) in spared.iter_mut().enumerate() {
                for (row, component) in w.components.iter().enumerate() {
                    let moved: f64 = (0..self.model.nv()).map(|j| jacobian[(row, j)] * self.data.drive_reduction[(j, k)]).sum();
                    spared[i] += moved * component[i];
                }
            }
        }
    }
}

fn weight(model: &Model, data: &mut Data, gravity: nalgebra::Vector3<f64>) -> Vec<f64> {
    // Jᵀ·m·g summed over bodies: potential energy's gradient, needing only poses.
    let mut tree = vec![0.0; model.nv()];
    for (b, body) in model.bodies.iter().enumerate() {
        if body.mass <= 0.0 {
            continue;
        }
        let force = -gravity * body.mass;
        let point = data.pose_wb[b].transform_point(&(body.first_moment() / body.mass));
        let mut at = Some(b);
        while let Some(j) = at {
            let x = &data.pose_wb[j];
            let s = model.joints[j].motion();
            let velocity = x.rotation * s.linear + (x.rotation * s.angular).cross(&(point - x.translation));
            tree[j] += velocity.dot(&force);
            at = model.joints[j].parent;
        }
    }
    (0..model.n_act()).map(|k| data.drive_reduction.column(k).iter().zip(&tree).map(|(g, t)| g * t).sum()).collect()
}

/// How directions pass through zero where nothing else says it: [softness][tree joint].
pub(crate) fn softnesses(model: &Model, motion: &Motion) -> Vec<Vec<Turn>> {
    let mut top = vec![0.0; model.nv()];
    for (k, &j) in model.actuators.iter().enumerate() {
        top[j] = top_speed(&motion.segment.v[k]);
    }
    for (p, passive) in model.passive().into_iter().zip(&motion.passive) {
        top[p] = top_speed(&passive.v);
    }
    SOFTNESS.iter().map(|share| top.iter().map(|t| Turn::soft(share * t)).collect()).collect()
}

/// Speed that 99 % of the samples stay below.
pub(crate) fn top_speed(v: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = v.iter().map(|v| v.abs()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() * 99 / 100).copied().unwrap_or(0.0)
}
