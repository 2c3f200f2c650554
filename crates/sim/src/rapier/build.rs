//! What the engine is given of a robot: its bodies with mass, and fastenings that forbid some of their relative motions.
//!
//! Joints of the tree, joints that close loops and joints across massless bodies (the cross of a universal joint, the rings of a gimbal)
//! all become fastenings. Nothing in here knows the engine; what its fastenings cannot say is refused.

use core::ops::Range;

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::Data;
use pkm_dyn::math::sqrt;
use pkm_dyn::model::{Compound, FrameOnBody, JointKind, Model, Part};
use pkm_dyn::spatial::Pose;

use super::ENGINE;
use crate::error::SimError;

/// Axes meet, or coincide, within this `[m]`.
const MEET: f64 = 1e-9;

/// Axes are parallel below this sine of the angle between them.
const PARALLEL: f64 = 1e-3;

/// The joints from one body with mass to the next, or from the root.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chain {
    /// Its joints; the last is that of the body.
    pub(super) joints: Range<usize>,
    /// The body it starts from; `None` is the root.
    pub(super) parent: Option<usize>,
}

impl Chain {
    /// The body at its end.
    pub(super) fn body(&self) -> usize {
        self.joints.end - 1
    }
}

/// Relative motions of frame b against frame a that are forbidden, as of [`pkm_dyn::model::LoopClosure`].
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fastening {
    /// The joint or loop it is for.
    pub(super) name: String,
    pub(super) a: FrameOnBody,
    pub(super) b: FrameOnBody,
    /// x y z of the vector from a to b seen in a, then of the rotation vector.
    pub(super) forbidden: [bool; 6],
    /// The joint whose coordinate is the only motion left, along or about x.
    pub(super) joint: Option<usize>,
}

/// All of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plan {
    /// One per body with mass, parents first.
    pub(super) chains: Vec<Chain>,
    pub(super) fastenings: Vec<Fastening>,
}

pub(super) fn refused(what: &str, problem: &'static str) -> SimError {
    SimError::NotRepresentable { engine: ENGINE, what: what.to_string(), problem }
}

impl Plan {
    /// For the pose in `data` (`pose_wb` and `axis_w`), at which all loops are closed.
    pub(super) fn try_new(model: &Model, data: &Data) -> Result<Self, SimError> {
        if let Some(coupling) = model.couplings.first() {
            return Err(refused(
                &format!("the coupling of joint {:?}", model.joints[coupling.joint].name),
                "it has no gears between joints",
            ));
        }
        let chains = chains(model)?;
        let mut fastenings = Vec::new();
        for chain in &chains {
            fastenings.extend(Joined { model, data, chain }.fastenings()?);
        }
        for closure in &model.loops {
            let is_massless = |body: Option<usize>| body.is_some_and(|b| model.bodies[b].is_massless());
            if is_massless(closure.a.body) || is_massless(closure.b.body) {
                return Err(refused(&format!("loop {:?}", closure.name), "it ends on a body without mass"));
            }
            if closure.a.body == closure.b.body {
                return Err(refused(&format!("loop {:?}", closure.name), "both its ends are on one body"));
            }
            fastenings.push(Fastening {
                name: closure.name.clone(),
                a: closure.a,
                b: closure.b,
                forbidden: closure.constrain,
                joint: None,
            });
        }
        Ok(Self { chains, fastenings })
    }
}

fn chains(model: &Model) -> Result<Vec<Chain>, SimError> {
    let mut out = Vec::new();
    let mut first = 0;
    for (j, body) in model.bodies.iter().enumerate() {
        let children = model.joints.iter().filter(|joint| joint.parent == Some(j)).count();
        if body.is_massless() {
            // Joints are numbered depth first: the only child of a body has the next number.
            if children != 1 {
                return Err(refused(
                    &format!("the body of joint {:?}", model.joints[j].name),
                    "it has no mass and is not between two joints",
                ));
            }
            continue;
        }
        out.push(Chain { joints: first..j + 1, parent: model.joints[first].parent });
        first = j + 1;
    }
    Ok(out)
}

/// A chain at a pose.
struct Joined<'m> {
    model: &'m Model,
    data: &'m Data,
    chain: &'m Chain,
}

/// A joint's axis in the root frame.
struct Axis {
    kind: JointKind,
    direction: Vector3<f64>,
    point: Vector3<f64>,
}

impl Joined<'_> {
    fn fastenings(&self) -> Result<Vec<Fastening>, SimError> {
        let joints = &self.model.joints[self.chain.joints.clone()];
        let axes: Vec<Axis> = self.chain.joints.clone().map(|j| self.axis(j)).collect();
        if let (Part::First(compound), Part::Whole | Part::Last) = (joints[0].part, joints[joints.len() - 1].part)
            && compound.n() == joints.len()
        {
            return Ok(self.compound(compound));
        }
        let no_compound = joints.iter().all(|joint| joint.part == Part::Whole);
        let found = if no_compound { self.of_axes(&axes) } else { None };
        found.ok_or_else(|| {
            refused(
                &format!("the body of joint {:?}", joints[0].name),
                "it has no mass, and the joints on either side of it are no universal joint, ball, cylinder or table",
            )
        })
    }

    fn axis(&self, j: usize) -> Axis {
        let (joint, x) = (&self.model.joints[j], &self.data.pose_wb[j]);
        Axis { kind: joint.kind, direction: x.rotation * joint.axis, point: x.translation }
    }

    fn of_axes(&self, axes: &[Axis]) -> Option<Vec<Fastening>> {
        use JointKind::{Prismatic, Revolute};
        let kinds: Vec<JointKind> = axes.iter().map(|axis| axis.kind).collect();
        match kinds.as_slice() {
            [Revolute] => Some(vec![self.only(&axes[0], [true, true, true, false, true, true])]),
            [Prismatic] => Some(vec![self.only(&axes[0], [false, true, true, true, true, true])]),
            [Revolute, Revolute] => self.universal(&axes[0], &axes[1]),
            [Revolute, Revolute, Revolute] => {
                let point = meeting(&axes[0], &axes[1])?;
                let meets = distance(&axes[2], &point) < MEET && meeting(&axes[1], &axes[2]).is_some();
                meets.then(|| vec![self.at(&at_point(point), BALL)])
            }
            [Revolute, Prismatic] | [Prismatic, Revolute] => {
                let is_one = is_parallel(&axes[0], &axes[1]) && distance(&axes[0], &axes[1].point) < MEET;
                is_one.then(|| vec![self.at(&along(&axes[0].direction, axes[0].point), [false, true, true, false, true, true])])
            }
            [Prismatic, Prismatic] if !is_parallel(&axes[0], &axes[1]) => {
                let normal = axes[0].direction.cross(&axes[1].direction);
                Some(vec![self.at(&along(&normal, axes[0].point), [true, false, false, true, true, true])])
            }
            [Prismatic, Prismatic, Prismatic] if spans_space(axes) => {
                Some(vec![self.at(&at_point(axes[0].point), [false, false, false, true, true, true])])
            }
            _ => None,
        }
    }

    /// A fastening whose frames coincide at `x` in the root frame.
    fn at(&self, x: &Pose, forbidden: [bool; 6]) -> Fastening {
        self.between([x, x], forbidden)
    }

    fn between(&self, [a, b]: [&Pose; 2], forbidden: [bool; 6]) -> Fastening {
        let on = |body: Option<usize>, x: &Pose| FrameOnBody {
            body,
            pose: body.map_or(*x, |body| self.data.pose_wb[body].inverse().compose(x)),
        };
        let name = self.model.joints[self.chain.joints.start].name.clone();
        Fastening { name, a: on(self.chain.parent, a), b: on(Some(self.chain.body()), b), forbidden, joint: None }
    }

    fn only(&self, axis: &Axis, forbidden: [bool; 6]) -> Fastening {
        Fastening { joint: Some(self.chain.body()), ..self.at(&along(&axis.direction, axis.point), forbidden) }
    }

    fn compound(&self, compound: Compound) -> Vec<Fastening> {
        let first = self.chain.joints.start;
        let placement = self.model.joints[first].placement;
        let start = self.chain.parent.map_or(placement, |p| self.data.pose_wb[p].compose(&placement));
        let end = &self.data.pose_wb[self.chain.body()];
        match compound {
            Compound::Spherical => vec![self.between([&start, end], BALL)],
            Compound::Planar => vec![self.between([&start, end], [false, false, true, true, true, false])],
            Compound::Free => Vec::new(),
        }
    }

    /// A ball, and a point of the second axis that stays on a plane across the first: the angle between the axes stays.
    ///
    /// The engine's lock of one turn is no universal joint: it forbids a component of the rotation vector.
    fn universal(&self, first: &Axis, second: &Axis) -> Option<Vec<Fastening>> {
        let point = meeting(first, second)?;
        let arm = self.arm(&point);
        let cosine = first.direction.dot(&second.direction);
        let plane = along(&first.direction, point + first.direction * (arm * cosine));
        let far = at_point(point + second.direction * arm);
        Some(vec![self.at(&at_point(point), BALL), self.between([&plane, &far], [true, false, false, false, false, false])])
    }

    /// Radius of gyration of the body about a point of the root frame `[m]`: an arm at which a force turns as much as it pushes.
    fn arm(&self, point: &Vector3<f64>) -> f64 {
        let body = self.chain.body();
        let there = at_point(self.data.pose_wb[body].inverse().transform_point(point));
        let about = self.model.bodies[body].transformed(&there.inverse());
        sqrt(0.5 * about.rotational().trace() / about.mass)
    }
}

const BALL: [bool; 6] = [true, true, true, false, false, false];

fn at_point(point: Vector3<f64>) -> Pose {
    Pose { rotation: Matrix3::identity(), translation: point }
}

/// A frame with x along `direction`.
fn along(direction: &Vector3<f64>, point: Vector3<f64>) -> Pose {
    let x = direction / sqrt(direction.dot(direction));
    let least = if x.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let across = x.cross(&least);
    let y = across / sqrt(across.dot(&across));
    Pose { rotation: Matrix3::from_columns(&[x, y, x.cross(&y)]), translation: point }
}

fn is_parallel(a: &Axis, b: &Axis) -> bool {
    let across = a.direction.cross(&b.direction);
    across.dot(&across) < PARALLEL * PARALLEL
}

fn spans_space(axes: &[Axis]) -> bool {
    axes[0].direction.cross(&axes[1].direction).dot(&axes[2].direction).abs() > PARALLEL
}

/// Distance of a point from an axis `[m]`.
fn distance(axis: &Axis, point: &Vector3<f64>) -> f64 {
    let across = axis.direction.cross(&(point - axis.point));
    sqrt(across.dot(&across))
}

/// The point in which two axes meet that are not parallel.
fn meeting(a: &Axis, b: &Axis) -> Option<Vector3<f64>> {
    if is_parallel(a, b) {
        return None;
    }
    let normal = a.direction.cross(&b.direction);
    let way = b.point - a.point;
    let along_a = way.cross(&b.direction).dot(&normal) / normal.dot(&normal);
    let point = a.point + a.direction * along_a;
    (distance(b, &point) < MEET).then_some(point)
}
