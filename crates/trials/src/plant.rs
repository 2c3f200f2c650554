//! Motion of a robot with loops by Kane's equations: partial velocities in the world's frame, free coordinates, loops closed by Newton.
//!
//! Written for the trials alone and unlike `pkm-dyn` on purpose: no spatial vectors, no recursion of forces, no multipliers. What both
//! agree on is then more than one program's opinion; `tests/blind_proof.rs` holds them against each other.

use nalgebra::{DMatrix, DVector, Dyn, LU, Matrix3, Rotation3, Unit, Vector3};

use crate::laws::Dry;
use crate::math;
use crate::robot::{Inertia, Motion, Robot, RobotError};

/// Loops are closed to this gap `[m]`.
const GAP: f64 = 1e-11;

/// Newton steps of a closure before it is called lost.
const STEPS: usize = 30;

/// A robot that can move.
#[derive(Debug, Clone)]
pub struct Plant {
    /// The robot.
    pub robot: Robot,
    /// Free coordinates: indices of joints.
    pub free: Vec<usize>,
    /// Coordinates that the loops determine.
    pub bound: Vec<usize>,
    /// Inertia of the drive that is felt at each joint `[kg | kg·m²]`.
    pub rotors: Vec<f64>,
    /// A closed pose to start from.
    pub home: Vec<f64>,
    /// How dry friction of each joint turns over with its direction, for whoever fits it; `None` where that fades below a share of the highest speed.
    pub turns: Vec<Option<Dry>>,
    /// For each joint, whether it moves each link.
    moves: Vec<Vec<bool>>,
}

/// Where every link is.
#[derive(Debug, Clone)]
pub struct Pose {
    /// Orientation of each joint's link in the world.
    pub turn: Vec<Matrix3<f64>>,
    /// Origin of each link `[m]`.
    pub at: Vec<Vector3<f64>>,
    /// Axis of each joint in the world.
    pub axis: Vec<Vector3<f64>>,
}

/// How every link moves, and what moving it takes.
#[derive(Debug, Clone)]
pub struct Moving {
    /// Where every link is.
    pub pose: Pose,
    /// Velocities of all joints over those of the free ones.
    pub ratio: DMatrix<f64>,
    /// Accelerations of all joints while those of the free ones are zero `[m/s² | rad/s²]`.
    pub ratio_bias: DVector<f64>,
    /// Velocities of all joints `[m/s | rad/s]`.
    pub velocity: DVector<f64>,
    /// Partial velocities: angular and of the origin, per link and free coordinate.
    pub partial: Vec<Vec<[Vector3<f64>; 2]>>,
    /// Per link: angular velocity, velocity of the origin, and angular and linear acceleration while the free ones are zero.
    pub links: Vec<[Vector3<f64>; 4]>,
    /// Mass matrix of the free coordinates.
    pub mass: DMatrix<f64>,
    /// Force on the free coordinates that keeps their accelerations at zero.
    pub bias: DVector<f64>,
}

impl Plant {
    /// Assembles a robot.
    ///
    /// # Errors
    /// Loops that do not close from the robot's assembly, or coordinates that do not determine the pose.
    pub fn new(robot: Robot) -> Result<Self, RobotError> {
        let n = robot.joints.len();
        let is_below = |joint: usize, link: usize| core::iter::successors(Some(link), |&j| robot.joints[j].parent).any(|j| j == joint);
        let moves = (0..n).map(|joint| (0..n).map(|link| is_below(joint, link)).collect()).collect();
        let mut rotors = vec![0.0; n];
        for d in &robot.drives {
            rotors[d.joint] = d.rotor;
        }
        let home = robot.assembly.clone();
        let mut plant = Self { robot, free: Vec::new(), bound: Vec::new(), rotors, home, turns: vec![None; n], moves };
        plant.assemble()?;
        plant.choose_coordinates()?;
        Ok(plant)
    }

    /// The same robot on a base that rocks about `axis`: one more joint, and free coordinate, at the root, named `rock`.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn rocking(robot: &Robot, axis: Vector3<f64>) -> Result<Self, RobotError> {
        let mut robot = robot.clone();
        let shift = |i: Option<usize>| Some(i.map_or(0, |i| i + 1));
        let mut rock = robot.joints[0].clone();
        (rock.name, rock.link, rock.parent) = ("rock".to_string(), robot.root.clone(), None);
        (rock.motion, rock.axis, rock.turn, rock.origin) = (Motion::Turn, axis, Matrix3::identity(), Vector3::zeros());
        (rock.viscous, rock.coulomb, rock.inertia) = (0.0, 0.0, Inertia::ZERO);
        robot.joints.iter_mut().for_each(|j| j.parent = shift(j.parent));
        robot.joints.insert(0, rock);
        robot.assembly.insert(0, 0.0);
        for l in &mut robot.loops {
            (l.a.0, l.b.0) = (shift(l.a.0), shift(l.b.0));
        }
        robot.drives.iter_mut().for_each(|d| d.joint += 1);
        Self::new(robot)
    }

    /// The same mechanism with the inertias and frictions of `robot`.
    #[must_use]
    pub fn weighing(&self, robot: Robot) -> Self {
        Self { robot, ..self.clone() }
    }

    /// Number of free coordinates.
    #[must_use]
    pub fn freedoms(&self) -> usize {
        self.free.len()
    }

    fn assemble(&mut self) -> Result<(), RobotError> {
        let mut q = self.home.clone();
        for _ in 0..STEPS {
            let pose = self.pose(&q);
            let (gap, jacobian) = (self.gap(&pose), self.loop_jacobian(&pose));
            if gap.is_empty() || gap.amax() < GAP {
                self.home = q;
                return Ok(());
            }
            let step = jacobian.svd(true, true).solve(&gap, 1e-9).map_err(|e| RobotError::Unknown(e.to_string()))?;
            q.iter_mut().zip(step.iter()).for_each(|(x, s)| *x -= s);
        }
        Err(RobotError::Unknown(format!("{}: the loops do not close", self.robot.name)))
    }

    /// The driven joints where they are as many as the freedoms; with more drives, the joints between base and end effector.
    fn choose_coordinates(&mut self) -> Result<(), RobotError> {
        let n = self.robot.joints.len();
        let jacobian = self.loop_jacobian(&self.pose(&self.home));
        let rank = if jacobian.nrows() == 0 { 0 } else { jacobian.rank(1e-8) };
        let root = self.robot.joint("rock");
        let driven: Vec<usize> = root.into_iter().chain(self.robot.drives.iter().map(|d| d.joint)).collect();
        let end = self.robot.end();
        let path = (0..n).filter(|&j| self.moves[j][end] && self.robot.drives.iter().all(|d| d.joint != j)).collect::<Vec<_>>();
        self.free = if driven.len() == n - rank { driven } else { path };
        self.free.sort_unstable();
        self.bound = (0..n).filter(|j| !self.free.contains(j)).collect();
        if self.free.len() != n - rank || rank != jacobian.nrows() {
            return Err(RobotError::Unknown(format!("{}: no coordinates that determine its pose", self.robot.name)));
        }
        Ok(())
    }

    /// Where every link is when the joints are at `q` `[m | rad]`.
    #[must_use]
    pub fn pose(&self, q: &[f64]) -> Pose {
        let n = q.len();
        let mut pose = Pose { turn: Vec::with_capacity(n), at: Vec::with_capacity(n), axis: Vec::with_capacity(n) };
        for (j, &q) in self.robot.joints.iter().zip(q) {
            let (turn, at) = j.parent.map_or((Matrix3::identity(), Vector3::zeros()), |p| (pose.turn[p], pose.at[p]));
            let frame = turn * j.turn;
            let axis = frame * j.axis;
            let origin = at + turn * j.origin;
            match j.motion {
                Motion::Turn => {
                    pose.turn.push(frame * turned(&j.axis, q));
                    pose.at.push(origin);
                }
                Motion::Slide => {
                    pose.turn.push(frame);
                    pose.at.push(origin + axis * q);
                }
            }
            pose.axis.push(axis);
        }
        pose
    }

    fn ends(&self, pose: &Pose, l: usize) -> ([Vector3<f64>; 2], Matrix3<f64>) {
        let l = &self.robot.loops[l];
        let place = |i: Option<usize>, x: &Vector3<f64>| i.map_or(*x, |i| pose.at[i] + pose.turn[i] * x);
        let turn = l.a.0.map_or(l.a.2, |i| pose.turn[i] * l.a.2);
        ([place(l.a.0, &l.a.1), place(l.b.0, &l.b.1)], turn)
    }

    /// What is left open of the loops `[m]`.
    #[must_use]
    pub fn gap(&self, pose: &Pose) -> DVector<f64> {
        let mut out = Vec::new();
        for (i, l) in self.robot.loops.iter().enumerate() {
            let ([a, b], turn) = self.ends(pose, i);
            let c = turn.tr_mul(&(b - a));
            out.extend(l.held.iter().map(|&k| c[k]));
        }
        DVector::from_vec(out)
    }

    /// Derivative of the gap by the joints.
    fn loop_jacobian(&self, pose: &Pose) -> DMatrix<f64> {
        let rows = self.robot.loops.iter().map(|l| l.held.len()).sum();
        let mut out = DMatrix::zeros(rows, self.robot.joints.len());
        let mut row = 0;
        for (i, l) in self.robot.loops.iter().enumerate() {
            let ([_, b], turn) = self.ends(pose, i);
            for (j, joint) in self.robot.joints.iter().enumerate() {
                let is_before = |link: Option<usize>| link.is_some_and(|k| self.moves[j][k]);
                let axis = pose.axis[j];
                let mut rate = Vector3::zeros();
                if is_before(l.b.0) {
                    rate += if joint.motion == Motion::Turn { axis.cross(&(b - pose.at[j])) } else { axis };
                }
                if is_before(l.a.0) {
                    // Frame a turns as well: seen from it, the far end moves the other way. Together: the velocity of a's matter at b.
                    rate -= if joint.motion == Motion::Turn { axis.cross(&(b - pose.at[j])) } else { axis };
                }
                let rate = turn.tr_mul(&rate);
                l.held.iter().enumerate().for_each(|(r, &k)| out[(row + r, j)] = rate[k]);
            }
            row += l.held.len();
        }
        out
    }

    fn bound_part(&self, jacobian: &DMatrix<f64>) -> DMatrix<f64> {
        jacobian.select_columns(&self.bound)
    }

    /// Closes the loops by moving the bound joints only; the pose and the factored Jacobian come along.
    ///
    /// # Errors
    /// Where they do not close.
    pub fn close(&self, q: &mut [f64]) -> Result<Closed, RobotError> {
        let mut pose = self.pose(q);
        if self.bound.is_empty() {
            return Ok(Closed { pose, jacobian: DMatrix::zeros(0, q.len()), factors: None });
        }
        for _ in 0..STEPS {
            let jacobian = self.loop_jacobian(&pose);
            let factors = self.bound_part(&jacobian).lu();
            let Some(step) = factors.solve(&self.gap(&pose)) else { break };
            let size = step.amax();
            if !size.is_finite() || size > 10.0 {
                break;
            }
            if size > 0.0 {
                self.bound.iter().zip(step.iter()).for_each(|(&j, s)| q[j] -= s);
                pose = self.pose(q);
            }
            // Newton's error is about the square of its last step.
            if size < 1e-6 {
                return Ok(Closed { pose, jacobian, factors: Some(factors) });
            }
        }
        Err(RobotError::Unknown(format!("{}: the loops do not close", self.robot.name)))
    }

    /// Everything about a motion at the joints `q`, closed on the way, with velocities `x` of the free coordinates.
    ///
    /// # Errors
    /// Where the loops do not close.
    pub fn moving(&self, q: &mut [f64], x: &[f64]) -> Result<Moving, RobotError> {
        let closed = self.close(q)?;
        let (n, d) = (q.len(), self.free.len());
        let mut ratio = DMatrix::zeros(n, d);
        self.free.iter().enumerate().for_each(|(k, &j)| ratio[(j, k)] = 1.0);
        if let Some(factors) = &closed.factors {
            let right = -closed.jacobian.select_columns(&self.free);
            let solved = factors.solve(&right).ok_or_else(|| RobotError::Unknown("a singular pose".to_string()))?;
            self.bound.iter().enumerate().for_each(|(r, &j)| ratio.row_mut(j).copy_from(&solved.row(r)));
        }
        let velocity = &ratio * DVector::from_column_slice(x);
        let mut ratio_bias = DVector::zeros(n);
        if let Some(factors) = &closed.factors {
            let links = self.links(&closed.pose, &velocity, &ratio_bias);
            let curve = self.loop_acceleration(&closed.pose, &links);
            let solved = factors.solve(&curve).ok_or_else(|| RobotError::Unknown("a singular pose".to_string()))?;
            self.bound.iter().zip(solved.iter()).for_each(|(&j, s)| ratio_bias[j] = -s);
        }
        let links = self.links(&closed.pose, &velocity, &ratio_bias);
        let partial = self.partial(&closed.pose, &ratio);
        let mut moving =
            Moving { pose: closed.pose, ratio, ratio_bias, velocity, partial, links, mass: DMatrix::zeros(d, d), bias: DVector::zeros(d) };
        self.weigh(&mut moving);
        Ok(moving)
    }

    /// Velocities and accelerations of every link for given ones of the joints.
    fn links(&self, pose: &Pose, velocity: &DVector<f64>, acceleration: &DVector<f64>) -> Vec<[Vector3<f64>; 4]> {
        let mut out: Vec<[Vector3<f64>; 4]> = Vec::with_capacity(pose.at.len());
        let zero = Vector3::zeros();
        for (i, j) in self.robot.joints.iter().enumerate() {
            let [w, v, alpha, a] = j.parent.map_or([zero; 4], |p| out[p]);
            let arm = pose.at[i] - j.parent.map_or(zero, |p| pose.at[p]);
            let (axis, rate, push) = (pose.axis[i], velocity[i], acceleration[i]);
            let carried = [v + w.cross(&arm), a + alpha.cross(&arm) + w.cross(&w.cross(&arm))];
            out.push(match j.motion {
                Motion::Turn => [w + axis * rate, carried[0], alpha + axis * push + w.cross(&axis) * rate, carried[1]],
                Motion::Slide => [w, carried[0] + axis * rate, alpha, carried[1] + axis * push + w.cross(&axis) * (2.0 * rate)],
            });
        }
        out
    }

    fn partial(&self, pose: &Pose, ratio: &DMatrix<f64>) -> Vec<Vec<[Vector3<f64>; 2]>> {
        let d = ratio.ncols();
        let zero = Vector3::zeros();
        let mut out: Vec<Vec<[Vector3<f64>; 2]>> = Vec::with_capacity(pose.at.len());
        for (i, j) in self.robot.joints.iter().enumerate() {
            let arm = pose.at[i] - j.parent.map_or(zero, |p| pose.at[p]);
            let mut here = Vec::with_capacity(d);
            for k in 0..d {
                let [w, v] = j.parent.map_or([zero; 2], |p| out[p][k]);
                let own = pose.axis[i] * ratio[(i, k)];
                here.push(match j.motion {
                    Motion::Turn => [w + own, v + w.cross(&arm)],
                    Motion::Slide => [w, v + w.cross(&arm) + own],
                });
            }
            out.push(here);
        }
        out
    }

    /// Second derivative of the gap for the links' motion.
    fn loop_acceleration(&self, pose: &Pose, links: &[[Vector3<f64>; 4]]) -> DVector<f64> {
        let mut out = Vec::new();
        for (i, l) in self.robot.loops.iter().enumerate() {
            let (points, turn) = self.ends(pose, i);
            let point = |link: Option<usize>, p: Vector3<f64>| {
                link.map_or([Vector3::zeros(); 4], |k| {
                    let ([w, v, alpha, a], arm) = (links[k], p - pose.at[k]);
                    [w, v + w.cross(&arm), alpha, a + alpha.cross(&arm) + w.cross(&w.cross(&arm))]
                })
            };
            let ([w, va, alpha, aa], [_, vb, _, ab]) = (point(l.a.0, points[0]), point(l.b.0, points[1]));
            let (r, rate) = (points[1] - points[0], vb - va);
            let c = turn.tr_mul(&(ab - aa - alpha.cross(&r) - w.cross(&rate) * 2.0 + w.cross(&w.cross(&r))));
            out.extend(l.held.iter().map(|&k| c[k]));
        }
        DVector::from_vec(out)
    }

    /// Fills in mass matrix and bias.
    fn weigh(&self, m: &mut Moving) {
        let d = self.free.len();
        for (i, j) in self.robot.joints.iter().enumerate() {
            let body = &j.inertia;
            if body.mass > 0.0 || body.tensor.amax() > 0.0 {
                let (moment, tensor) = (m.pose.turn[i] * body.moment, m.pose.turn[i] * body.tensor * m.pose.turn[i].transpose());
                for k in 0..d {
                    let [w, v] = m.partial[i][k];
                    let (f, n) = (v * body.mass + w.cross(&moment), moment.cross(&v) + tensor * w);
                    for l in 0..d {
                        m.mass[(l, k)] += m.partial[i][l][1].dot(&f) + m.partial[i][l][0].dot(&n);
                    }
                }
                let [w, _, alpha, a] = m.links[i];
                let a = a - self.robot.gravity;
                let f = a * body.mass + alpha.cross(&moment) + w.cross(&w.cross(&moment));
                let n = moment.cross(&a) + tensor * alpha + w.cross(&(tensor * w));
                for l in 0..d {
                    m.bias[l] += m.partial[i][l][1].dot(&f) + m.partial[i][l][0].dot(&n);
                }
            }
            if self.rotors[i] > 0.0 {
                for l in 0..d {
                    let share = self.rotors[i] * m.ratio[(i, l)];
                    m.bias[l] += share * m.ratio_bias[i];
                    (0..d).for_each(|k| m.mass[(l, k)] += share * m.ratio[(i, k)]);
                }
            }
        }
    }

    /// Kinetic and potential energy `[J]`.
    #[must_use]
    pub fn energy(&self, m: &Moving, x: &[f64]) -> [f64; 2] {
        let x = DVector::from_column_slice(x);
        let height = |i: usize| {
            let body = &self.robot.joints[i].inertia;
            -self.robot.gravity.dot(&(m.pose.at[i] * body.mass + m.pose.turn[i] * body.moment))
        };
        [0.5 * x.dot(&(&m.mass * &x)), (0..m.pose.at.len()).map(height).sum()]
    }

    /// Force on the free coordinates that each of the ten numbers of each link takes, at accelerations `a` of the free coordinates:
    /// columns in the order of [`Inertia::numbers`], links without mass left out.
    #[must_use]
    pub fn inertia_columns(&self, m: &Moving, a: &DVector<f64>) -> DMatrix<f64> {
        let d = self.free.len();
        let bodies: Vec<usize> = self.weighty();
        let mut out = DMatrix::zeros(d, 10 * bodies.len());
        for (b, &i) in bodies.iter().enumerate() {
            let [w, _, mut alpha, mut acc] = m.links[i];
            for k in 0..d {
                alpha += m.partial[i][k][0] * a[k];
                acc += m.partial[i][k][1] * a[k];
            }
            let back = m.pose.turn[i].transpose();
            let (w, alpha, acc) = (back * w, back * alpha, back * (acc - self.robot.gravity));
            for p in 0..10 {
                let mut unit = [0.0; 10];
                unit[p] = 1.0;
                let body = Inertia::from_numbers(&unit);
                let f = acc * body.mass + alpha.cross(&body.moment) + w.cross(&w.cross(&body.moment));
                let n = body.moment.cross(&acc) + body.tensor * alpha + w.cross(&(body.tensor * w));
                let (f, n) = (m.pose.turn[i] * f, m.pose.turn[i] * n);
                for l in 0..d {
                    out[(l, 10 * b + p)] = m.partial[i][l][1].dot(&f) + m.partial[i][l][0].dot(&n);
                }
            }
        }
        out
    }

    /// Joints whose link has mass.
    #[must_use]
    pub fn weighty(&self) -> Vec<usize> {
        (0..self.robot.joints.len()).filter(|&i| self.robot.joints[i].inertia.mass > 0.0).collect()
    }
}

/// A closed pose.
#[derive(Debug, Clone)]
pub struct Closed {
    /// Where every link is.
    pub pose: Pose,
    jacobian: DMatrix<f64>,
    factors: Option<LU<f64, Dyn, Dyn>>,
}

fn turned(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = (math::sin(angle), math::cos(angle));
    let x = axis.cross_matrix();
    Matrix3::identity() + x * s + x * x * (1.0 - c)
}

/// A rotation of the base about a horizontal direction at `heading` from x, by `angle` `[rad]`.
#[must_use]
pub fn tilt(heading: f64, angle: f64) -> Matrix3<f64> {
    let axis = Unit::new_normalize(Vector3::new(math::cos(heading), math::sin(heading), 0.0));
    Rotation3::from_axis_angle(&axis, angle).into_inner()
}
