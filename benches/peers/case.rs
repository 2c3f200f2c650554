//! A robot with many random states, in memory and as the files the other side reads.

use core::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use pkm_dyn::loops::{assemble, close_at, mid_pose, solve_accelerations, solve_velocities, walk_to};
use pkm_dyn::model::{FrameOnBody, JointKind};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// States of each robot: more than a branch predictor remembers.
const STATES: usize = 2048;

/// Samples of one motion of a closed-loop robot.
const STRETCH: usize = 64;

/// How long before a state the previous samples are `[s]`.
pub(crate) const BEFORE_S: [f64; 2] = [1e-3, 10e-3];

/// Closed-loop robots stay this near to mid travel `[m]`: all loops close there.
const REACH_M: f64 = 0.04;

/// A pose counts as far from singular above this pivot ratio of the loops' elimination.
const REGULAR: f64 = 1e-3;

/// One sample: tree coordinates, velocities, accelerations, efforts, and closed poses the times [`BEFORE_S`] earlier.
pub(crate) struct State {
    pub(crate) q: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) a: Vec<f64>,
    pub(crate) tau: Vec<f64>,
    pub(crate) before: [Vec<f64>; 2],
    /// Position, velocity and acceleration of the drives.
    pub(crate) drives: [Vec<f64>; 3],
    /// Whether the state in front of this one is of another motion; else it is the sample a millisecond earlier.
    pub(crate) is_first: bool,
}

/// A robot and its states.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) model: Model,
    pub(crate) states: Vec<State>,
    /// Joints that the others follow on the other side, which has no notion of surplus drives.
    pub(crate) independent: Vec<usize>,
}

struct Dice(ChaCha8Rng);

impl Dice {
    /// Uniform between `-size` and `size`: the upper 53 bits, which a double holds exactly.
    fn within(&mut self, size: f64) -> f64 {
        size * (2.0 * ((self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64) - 1.0)
    }

    fn each(&mut self, size: f64, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.within(size)).collect()
    }
}

impl Case {
    /// Draws the states; those of a closed-loop robot close its loops in position, velocity and acceleration.
    pub(crate) fn new(name: &str, model: Model) -> Self {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(20_261_126));
        let states = if model.is_constrained() { closed_states(&model, &mut dice) } else { open_states(&model, &mut dice) };
        let independent = Data::new(&model).independent;
        Self { name: name.to_string(), model, states, independent }
    }

    /// Whether every loop is a ball joint and there is nothing else: what the other side can express.
    pub(crate) fn has_ball_loops(&self) -> bool {
        let is_ball = |l: &pkm_dyn::model::LoopClosure| l.constrain == [true, true, true, false, false, false];
        self.model.is_constrained() && self.model.couplings.is_empty() && self.model.loops.iter().all(is_ball)
    }

    /// Writes `robot.txt` and `states.bin` into a folder of its own below `folder`, and returns it.
    pub(crate) fn write(&self, folder: &Path) -> Result<PathBuf, String> {
        let folder = folder.join(&self.name);
        let put = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))
        };
        fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        put("robot.txt", self.text().as_bytes())?;
        let rows = self.states.iter().flat_map(|s| [&s.q, &s.v, &s.a, &s.tau, &s.before[0], &s.before[1]]);
        let bytes: Vec<u8> = rows.flatten().flat_map(|x| x.to_le_bytes()).collect();
        put("states.bin", &bytes)?;
        Ok(folder)
    }

    /// The robot as numbers, in the order peer.cpp reads them; bodies count from 1, the root is 0.
    fn text(&self) -> String {
        let m = &self.model;
        let mut out = String::new();
        line(&mut out, m.gravity.as_slice());
        let _ = writeln!(out, "{}", m.nv());
        for (i, joint) in m.joints.iter().enumerate() {
            let kind = match joint.kind {
                JointKind::Revolute => "revolute",
                JointKind::Prismatic => "prismatic",
            };
            let _ = writeln!(out, "{} {kind}", joint.parent.map_or(0, |p| p + 1));
            line(&mut out, joint.axis.as_slice());
            pose(&mut out, &joint.placement);
            line(&mut out, m.bodies[i].to_vector().as_slice());
            // Of more drives than freedoms, those the others follow: the other side has no notion of the rest.
            line(&mut out, &[joint.armature, f64::from(u8::from(self.independent.contains(&i)))]);
        }
        let loops = if self.has_ball_loops() { m.loops.as_slice() } else { &[] };
        let _ = writeln!(out, "{}", loops.len());
        for closure in loops {
            for FrameOnBody { body, pose: at } in [&closure.a, &closure.b] {
                let _ = writeln!(out, "{}", body.map_or(0, |b| b + 1));
                pose(&mut out, at);
            }
        }
        let _ = writeln!(out, "{}", self.states.len());
        out
    }
}

fn line(out: &mut String, numbers: &[f64]) {
    // `{:e}` writes the shortest text that reads back as the same bits.
    let words: Vec<String> = numbers.iter().map(|x| format!("{x:e}")).collect();
    let _ = writeln!(out, "{}", words.join(" "));
}

fn pose(out: &mut String, pose: &Pose) {
    let rotation = pose.rotation.transpose();
    line(out, rotation.as_slice());
    line(out, pose.translation.as_slice());
}

fn open_states(model: &Model, dice: &mut Dice) -> Vec<State> {
    let draw = |_| {
        let n = model.nv();
        let (q, v, a, tau) = (dice.each(2.0, n), dice.each(3.0, n), dice.each(10.0, n), dice.each(30.0, n));
        let drives = [&q, &v, &a].map(|x| model.actuators.iter().map(|&j| x[j]).collect());
        State { before: [q.clone(), q.clone()], q, v, a, tau, drives, is_first: true }
    };
    (0..STATES).map(draw).collect()
}

fn closed_states(model: &Model, dice: &mut Dice) -> Vec<State> {
    // As many drives as freedoms: those of them that are too many are where the loops put them.
    let mut driven = model.clone();
    driven.actuators = Data::new(model).independent;
    let mut data = Data::new(&driven);
    let home = mid_pose(&driven);
    assert!(assemble(&driven, &mut data).is_closed && walk_to(&driven, &mut data, &home).is_closed, "the loops close at mid travel");
    let centre = data.q.clone();
    let mut states = Vec::new();
    for _ in 0..STATES {
        data.q.copy_from_slice(&centre);
        states.extend(stretch(model, &driven, &mut data, dice).unwrap_or_default());
        if states.len() == STATES {
            return states;
        }
    }
    panic!("{}: too many motions near mid travel do not close", model.name)
}

/// A short motion near the pose in `data.q`, one state a millisecond, or none when it leaves reach or comes close to singular.
fn stretch(model: &Model, driven: &Model, data: &mut Data, dice: &mut Dice) -> Option<Vec<State>> {
    let n = driven.n_act();
    let start: Vec<f64> = driven.actuators.iter().map(|&j| data.q[j] + dice.within(REACH_M)).collect();
    let (speed, rate) = (dice.each(0.2, n), dice.each(4.0, n));
    let closure = walk_to(driven, data, &start);
    if !closure.is_closed || closure.pivot_ratio < REGULAR {
        return None;
    }
    let mut states = Vec::new();
    for sample in 0..STRETCH {
        let t = 1e-3 * sample as f64;
        let at = |t: f64| -> Vec<f64> { (0..n).map(|k| start[k] + t * speed[k] + 0.5 * t * t * rate[k]).collect() };
        let v: Vec<f64> = (0..n).map(|k| speed[k] + t * rate[k]).collect();
        let mut before = [Vec::new(), Vec::new()];
        for (pose, ago) in before.iter_mut().zip(BEFORE_S) {
            close(driven, data, &at(t - ago))?;
            pose.clone_from(&data.q);
        }
        close(driven, data, &at(t))?;
        solve_velocities(driven, data, &v);
        solve_accelerations(driven, data, &rate);
        let drives = [&data.q, &data.v, &data.a].map(|x| model.actuators.iter().map(|&j| x[j]).collect());
        let mut tau = vec![0.0; model.nv()];
        // Efforts at the drives alone: what a controller could send.
        for &j in &model.actuators {
            tau[j] = dice.within(300.0);
        }
        let (q, v, a) = (data.q.clone(), data.v.clone(), data.a.clone());
        states.push(State { q, v, a, tau, before, drives, is_first: sample == 0 });
    }
    Some(states)
}

/// Closes the loops with the independent coordinates at `q_ind`; nothing where they do not close.
fn close(model: &Model, data: &mut Data, q_ind: &[f64]) -> Option<()> {
    for (k, &j) in data.independent.iter().enumerate() {
        data.q[j] = q_ind[k];
    }
    close_at(model, data).is_closed.then_some(())
}
