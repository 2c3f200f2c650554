//! Joints of the tree, one coordinate each; a joint with several (ball, plane, free flight) is several in a row.

use alloc::string::String;

use nalgebra::{Matrix3, Vector3};

use crate::math;
use crate::spatial::{Motion, Pose, rotation_about, rotation_exp};

/// What a joint's coordinate means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Rotation about the axis `[rad]` (URDF `revolute` and `continuous`).
    Revolute,
    /// Travel along the axis `[m]`.
    Prismatic,
}

impl JointKind {
    /// Unit of the coordinate.
    #[must_use]
    pub fn unit_position(self) -> &'static str {
        match self {
            Self::Revolute => "rad",
            Self::Prismatic => "m",
        }
    }

    /// Unit of the effort.
    #[must_use]
    pub fn unit_effort(self) -> &'static str {
        match self {
            Self::Revolute => "N·m",
            Self::Prismatic => "N",
        }
    }
}

/// Limits of a joint; infinite where the file states none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest coordinate `[m | rad]`.
    pub lower: f64,
    /// Highest coordinate `[m | rad]`.
    pub upper: f64,
    /// Highest speed `[m/s | rad/s]`.
    pub velocity: f64,
    /// Highest effort `[N | N·m]`.
    pub effort: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, velocity: f64::INFINITY, effort: f64::INFINITY }
    }
}

/// A joint with several coordinates. It is written as that many [`Joint`]s in a row, the first of which carries the whole pose.
///
/// Velocities are those of the child in its own frame, as in Pinocchio; positions need no quaternion: orientation is a rotation vector
/// `[rad]`, so that there are as many coordinates as velocities. See [`crate::configuration`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compound {
    /// A ball: rx ry rz.
    #[doc(alias = "JointModelSpherical")]
    Spherical,
    /// A body on a plane: x y of the plane, then the turn about its normal z.
    #[doc(alias = "JointModelPlanar")]
    Planar,
    /// A body that flies: x y z, then rx ry rz.
    #[doc(alias = "JointModelFreeFlyer")]
    Free,
}

impl Compound {
    /// Its coordinates by name, in order.
    #[must_use]
    pub const fn coordinates(self) -> &'static [&'static str] {
        match self {
            Self::Spherical => &["rx", "ry", "rz"],
            Self::Planar => &["x", "y", "rz"],
            Self::Free => &["x", "y", "z", "rx", "ry", "rz"],
        }
    }

    /// Number of coordinates.
    #[must_use]
    pub const fn n(self) -> usize {
        self.coordinates().len()
    }

    /// Kind and axis of coordinate `k`.
    pub(crate) fn coordinate(self, k: usize) -> (JointKind, Vector3<f64>) {
        let name = self.coordinates()[k];
        let kind = if name.len() == 2 { JointKind::Revolute } else { JointKind::Prismatic };
        let axis = match name.as_bytes()[name.len() - 1] {
            b'x' => Vector3::x(),
            b'y' => Vector3::y(),
            _ => Vector3::z(),
        };
        (kind, axis)
    }

    /// Pose of the child in the joint's frame; `q` begins with this joint's coordinates `[m | rad]`.
    #[must_use]
    pub fn pose(self, q: &[f64]) -> Pose {
        match self {
            Self::Spherical => Pose { rotation: rotation_exp(&Vector3::new(q[0], q[1], q[2])), translation: Vector3::zeros() },
            Self::Planar => Pose { rotation: rotation_about(&Vector3::z(), q[2]), translation: Vector3::new(q[0], q[1], 0.0) },
            Self::Free => Pose { rotation: rotation_exp(&Vector3::new(q[3], q[4], q[5])), translation: Vector3::new(q[0], q[1], q[2]) },
        }
    }
}

/// What a [`Joint`] is of the joint in the robot's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All of it: one coordinate.
    Whole,
    /// The first coordinate of several.
    First(Compound),
    /// Neither first nor last.
    Inner,
    /// The last: its body is the one with mass, the bodies before it are massless and coincide with it.
    Last,
}

/// Whether an axis is one of the frame's own: rotations about it need a fraction of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Principal {
    X,
    Y,
    Z,
    No,
}

impl Principal {
    pub(crate) fn of(axis: &Vector3<f64>) -> Self {
        match axis {
            a if *a == Vector3::x() => Self::X,
            a if *a == Vector3::y() => Self::Y,
            a if *a == Vector3::z() => Self::Z,
            _ => Self::No,
        }
    }
}

/// One coordinate and the place of its body in the tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name; a coordinate of several is `<joint>.<coordinate>`, as in `ball.rx`.
    pub name: String,
    /// What the coordinate means.
    pub kind: JointKind,
    /// What it is of the joint in the robot's file.
    pub part: Part,
    /// Unit axis in the joint's frame.
    pub axis: Vector3<f64>,
    /// Joint frame in the parent body's frame at coordinate zero.
    pub placement: Pose,
    /// Parent body; `None` is the root.
    pub parent: Option<usize>,
    /// Limits.
    pub limits: Limits,
    /// Nominal viscous friction `[N·s/m | N·m·s/rad]`.
    pub viscous: f64,
    /// Nominal Coulomb friction `[N | N·m]`.
    pub coulomb: f64,
    /// Rotor inertia seen at the joint `[kg | kg·m²]`.
    pub armature: f64,
    pub(crate) principal: Principal,
}

impl Joint {
    /// A joint of one coordinate about or along the unit vector `axis`, its frame that of its parent: no limits, friction or rotor.
    #[must_use]
    pub fn new(name: String, kind: JointKind, axis: Vector3<f64>, parent: Option<usize>) -> Self {
        Self {
            name,
            kind,
            part: Part::Whole,
            principal: Principal::of(&axis),
            axis,
            placement: Pose::identity(),
            parent,
            limits: Limits::default(),
            viscous: 0.0,
            coulomb: 0.0,
            armature: 0.0,
        }
    }

    /// Pose of the body in its parent; `q` begins with this joint's coordinate `[m | rad]` and holds those of the same joint after it.
    #[must_use]
    #[inline]
    pub fn pose(&self, q: &[f64]) -> Pose {
        match (self.part, self.kind) {
            (Part::Whole, JointKind::Revolute) => {
                Pose { rotation: self.turned(&self.placement.rotation, q[0]), translation: self.placement.translation }
            }
            (Part::Whole, JointKind::Prismatic) => Pose {
                rotation: self.placement.rotation,
                translation: self.placement.translation + self.axis_in(&self.placement.rotation) * q[0],
            },
            (Part::First(compound), _) => self.placement.compose(&compound.pose(q)),
            (Part::Inner | Part::Last, _) => Pose::identity(),
        }
    }

    /// `frame` turned by `angle` `[rad]` about the joint's axis.
    #[inline]
    fn turned(&self, frame: &Matrix3<f64>, angle: f64) -> Matrix3<f64> {
        // The two columns that turn; the third is the axis.
        let (i, j) = match self.principal {
            Principal::X => (1, 2),
            Principal::Y => (2, 0),
            Principal::Z => (0, 1),
            Principal::No => return frame * rotation_about(&self.axis, angle),
        };
        let (s, c) = math::sin_cos(angle);
        let mut out = *frame;
        for row in 0..3 {
            let (a, b) = (frame[(row, i)], frame[(row, j)]);
            out[(row, i)] = a * c + b * s;
            out[(row, j)] = b * c - a * s;
        }
        out
    }

    /// The joint's axis, seen where the body's frame has orientation `rotation`.
    #[inline]
    pub(crate) fn axis_in(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        match self.principal {
            Principal::X => rotation.column(0).into_owned(),
            Principal::Y => rotation.column(1).into_owned(),
            Principal::Z => rotation.column(2).into_owned(),
            Principal::No => rotation * self.axis,
        }
    }

    /// The joint's unit motion, in the body's frame.
    #[must_use]
    #[inline]
    pub fn motion(&self) -> Motion {
        match self.kind {
            JointKind::Revolute => Motion { linear: Vector3::zeros(), angular: self.axis },
            JointKind::Prismatic => Motion { linear: self.axis, angular: Vector3::zeros() },
        }
    }

    /// Whether its coordinate is its own: the rate of the coordinate is then the joint's velocity.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.part == Part::Whole
    }
}
