//! From named parts to a [`Model`]: orders the tree, lumps fixed links, checks every number.

use alloc::string::{String, ToString};
use alloc::vec;
use alloc::vec::Vec;

use nalgebra::Vector3;

use super::{Compound, Coupling, FrameOnBody, Joint, JointKind, Limits, Link, LoopClosure, Model, Part, Principal, Sensor, SensorKind};
use crate::parameters::InertialParameters;
use crate::spatial::Pose;

/// Why the parts do not make a robot.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// Two things of one kind share a name.
    #[error("{kind} {name:?} is there twice")]
    Duplicate {
        /// `link`, `joint`, `loop`, …
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A name that nothing bears.
    #[error("{at}: no {kind} {name:?} in this robot")]
    Unknown {
        /// Who names it.
        at: String,
        /// `link` or `joint`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// The links do not form one tree.
    #[error("links do not form one tree: {detail}")]
    NotATree {
        /// What is wrong.
        detail: String,
    },
    /// A number outside its limits.
    #[error("{at}: {what} = {value} {unit} ({limit})")]
    OutOfRange {
        /// Who has it.
        at: String,
        /// Which number.
        what: &'static str,
        /// The value.
        value: f64,
        /// Unit.
        unit: &'static str,
        /// What is allowed.
        limit: &'static str,
    },
    /// A drive or relation on a joint that cannot have it.
    #[error("joint {joint:?}: {detail}")]
    Joint {
        /// The joint.
        joint: String,
        /// What is wrong.
        detail: &'static str,
    },
}

/// What a joint in a robot's file lets its child do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Freedom {
    /// Nothing.
    Fixed,
    /// One coordinate.
    One(JointKind),
    /// Several coordinates.
    Several(Compound),
}

/// A joint before the tree is ordered.
#[derive(Debug, Clone)]
pub(crate) struct JointPart {
    pub(crate) name: String,
    pub(crate) freedom: Freedom,
    pub(crate) parent: String,
    pub(crate) child: String,
    pub(crate) placement: Pose,
    pub(crate) axis: Vector3<f64>,
    pub(crate) limits: Limits,
    pub(crate) viscous: f64,
    pub(crate) coulomb: f64,
}

/// Collects links, joints, loops and drives, and builds a [`Model`].
#[derive(Debug, Clone, Default)]
pub struct ModelBuilder {
    name: String,
    gravity: Vector3<f64>,
    links: Vec<(String, InertialParameters)>,
    joints: Vec<JointPart>,
}

impl ModelBuilder {
    /// An empty robot with gravity in the root link's frame `[m/s²]`.
    #[must_use]
    pub fn new(name: &str, gravity: [f64; 3]) -> Self {
        Self { name: name.to_string(), gravity: Vector3::from(gravity), ..Self::default() }
    }

    /// Adds a link with its mass properties in its own frame.
    pub fn link(&mut self, name: &str, parameters: InertialParameters) -> &mut Self {
        self.links.push((name.to_string(), parameters));
        self
    }

    pub(crate) fn joint(&mut self, part: JointPart) -> &mut Self {
        self.joints.push(part);
        self
    }

    /// Adds a joint along or about the unit `axis`; `placement` is its frame in the parent link.
    pub fn moving_joint(&mut self, name: &str, kind: JointKind, ends: (&str, &str), placement: Pose, axis: Vector3<f64>) -> &mut Self {
        self.part(name, Freedom::One(kind), ends, placement, axis)
    }

    /// Adds a joint with several coordinates; `placement` is its frame in the parent link. A planar joint's normal is the frame's z.
    pub fn compound_joint(&mut self, name: &str, compound: Compound, ends: (&str, &str), placement: Pose) -> &mut Self {
        self.part(name, Freedom::Several(compound), ends, placement, Vector3::z())
    }

    /// Adds a universal joint: turns about the unit `axes` one after the other, `<name>.1` and `<name>.2`, through a massless cross of
    /// that name. `placement` is its frame in the parent link.
    #[doc(alias = "JointModelUniversal")]
    pub fn universal_joint(&mut self, name: &str, ends: (&str, &str), placement: Pose, axes: [Vector3<f64>; 2]) -> &mut Self {
        self.link(name, InertialParameters::default());
        self.part(&alloc::format!("{name}.1"), Freedom::One(JointKind::Revolute), (ends.0, name), placement, axes[0]);
        self.part(&alloc::format!("{name}.2"), Freedom::One(JointKind::Revolute), (name, ends.1), Pose::identity(), axes[1])
    }

    fn part(&mut self, name: &str, freedom: Freedom, ends: (&str, &str), placement: Pose, axis: Vector3<f64>) -> &mut Self {
        self.joint(JointPart {
            name: name.to_string(),
            freedom,
            parent: ends.0.to_string(),
            child: ends.1.to_string(),
            placement,
            axis,
            limits: Limits::default(),
            viscous: 0.0,
            coulomb: 0.0,
        })
    }

    /// Orders the tree and builds the model, without loops or drives.
    ///
    /// # Errors
    /// Duplicate or unknown names, links that are not one tree, numbers that are not finite or out of range.
    pub fn build(&self) -> Result<Model, BuildError> {
        self.check_names()?;
        self.check_numbers()?;
        let root = self.root()?;
        let mut model = Model {
            name: self.name.clone(),
            root: root.clone(),
            gravity: self.gravity,
            joints: Vec::new(),
            bodies: Vec::new(),
            links: Vec::new(),
            loops: Vec::new(),
            couplings: Vec::new(),
            actuators: Vec::new(),
            assembly: Vec::new(),
            sensors: Vec::new(),
        };
        self.grow(&mut model, &root);
        if model.links.len() != self.links.len() {
            let lost = self.links.iter().find(|(name, _)| model.link_index(name).is_none());
            let detail = lost.map_or(String::new(), |(name, _)| alloc::format!("link {name:?} is not reached from {root:?}"));
            return Err(BuildError::NotATree { detail });
        }
        model.assembly = vec![0.0; model.nv()];
        Ok(model)
    }

    fn check_names(&self) -> Result<(), BuildError> {
        let twice = |kind, names: Vec<&String>| {
            let repeated = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name));
            repeated.map_or(Ok(()), |(_, name)| Err(BuildError::Duplicate { kind, name: (*name).clone() }))
        };
        twice("link", self.links.iter().map(|(name, _)| name).collect())?;
        twice("joint", self.joints.iter().map(|j| &j.name).collect())?;
        for joint in &self.joints {
            for link in [&joint.parent, &joint.child] {
                if !self.links.iter().any(|(name, _)| name == link) {
                    return Err(BuildError::Unknown { at: alloc::format!("joint {:?}", joint.name), kind: "link", name: link.clone() });
                }
            }
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<(), BuildError> {
        for (name, p) in &self.links {
            let at = alloc::format!("link {name:?}");
            if !p.to_vector().iter().all(|x| x.is_finite()) {
                return Err(BuildError::OutOfRange { at, what: "inertia", value: f64::NAN, unit: "", limit: "must be finite" });
            }
            if p.mass < 0.0 {
                return Err(BuildError::OutOfRange { at, what: "mass", value: p.mass, unit: "kg", limit: "must be >= 0" });
            }
        }
        for j in &self.joints {
            let at = || alloc::format!("joint {:?}", j.name);
            let bad = |what, value, unit, limit| Err(BuildError::OutOfRange { at: at(), what, value, unit, limit });
            let placed = j.placement.rotation.iter().chain(j.placement.translation.iter()).all(|x| x.is_finite());
            if !placed {
                return bad("origin", f64::NAN, "", "must be finite");
            }
            let length = crate::math::sqrt(j.axis.dot(&j.axis));
            if j.freedom != Freedom::Fixed && !(length.is_finite() && length > 1e-6) {
                return bad("axis length", length, "", "must be finite and > 0");
            }
            for (what, value) in [("damping", j.viscous), ("friction", j.coulomb)] {
                if !(value.is_finite() && value >= 0.0) {
                    return bad(what, value, "", "must be finite and >= 0");
                }
            }
            let l = j.limits;
            if [l.lower, l.upper, l.velocity, l.effort].iter().any(|x| x.is_nan()) || l.lower > l.upper {
                return bad("limit lower", l.lower, "", "must be <= upper and not NaN");
            }
        }
        Ok(())
    }

    fn root(&self) -> Result<String, BuildError> {
        let is_child = |name: &String| self.joints.iter().filter(|j| j.child == *name).count();
        if let Some((name, _)) = self.links.iter().find(|(name, _)| is_child(name) > 1) {
            return Err(BuildError::NotATree {
                detail: alloc::format!("link {name:?} is the child of two joints; close loops in robot.toml"),
            });
        }
        let roots: Vec<&String> = self.links.iter().map(|(name, _)| name).filter(|name| is_child(name) == 0).collect();
        match roots.as_slice() {
            [one] => Ok((*one).clone()),
            [] => Err(BuildError::NotATree { detail: "there is no root link".to_string() }),
            [a, b, ..] => Err(BuildError::NotATree { detail: alloc::format!("{a:?} and {b:?} are both roots") }),
        }
    }

    fn grow(&self, model: &mut Model, root: &str) {
        // Depth first with an explicit stack (a hostile file may be deep); a joint gets its index when its child is reached.
        let mut stack: Vec<(&str, Option<&JointPart>, Option<usize>, Pose)> = vec![(root, None, None, Pose::identity())];
        while let Some((name, via, parent, parent_pose)) = stack.pop() {
            let (body, pose) = match via {
                None => (parent, parent_pose),
                Some(j) => j.put_on(model, parent, parent_pose.compose(&j.placement)),
            };
            let parameters = self.links.iter().find(|(n, _)| n == name).map(|(_, p)| *p).unwrap_or_default();
            model.links.push(Link { name: name.to_string(), body, pose, parameters });
            if let Some(body) = body {
                model.bodies[body] = model.bodies[body].joined(&parameters.transformed(&pose));
            }
            let children: Vec<_> = self.joints.iter().filter(|j| j.parent == name).collect();
            stack.extend(children.into_iter().rev().map(|j| (j.child.as_str(), Some(j), body, pose)));
        }
    }
}

impl JointPart {
    /// Adds the joint's coordinates to the tree; the body that carries its child link, and the link's pose in it.
    fn put_on(&self, model: &mut Model, parent: Option<usize>, placement: Pose) -> (Option<usize>, Pose) {
        let mut add = |joint: Joint| {
            model.joints.push(joint);
            model.bodies.push(InertialParameters::default());
            Some(model.joints.len() - 1)
        };
        let axis = self.axis / crate::math::sqrt(self.axis.dot(&self.axis));
        match self.freedom {
            Freedom::Fixed => (parent, placement),
            Freedom::One(kind) => {
                (add(self.coordinate(self.name.clone(), (kind, axis), Part::Whole, (parent, placement))), Pose::identity())
            }
            Freedom::Several(compound) => {
                // A plane may lie any way: its normal is z of a frame of its own, in which the child is turned back.
                let turn = if compound == Compound::Planar { z_to(&axis) } else { Pose::identity() };
                let mut at = (parent, placement.compose(&turn));
                for (k, name) in compound.coordinates().iter().enumerate() {
                    let part = match k {
                        0 => Part::First(compound),
                        _ if k + 1 == compound.n() => Part::Last,
                        _ => Part::Inner,
                    };
                    let name = alloc::format!("{}.{name}", self.name);
                    at = (add(self.coordinate(name, compound.coordinate(k), part, at)), Pose::identity());
                }
                (at.0, turn.inverse())
            }
        }
    }

    fn coordinate(&self, name: String, (kind, axis): (JointKind, Vector3<f64>), part: Part, at: (Option<usize>, Pose)) -> Joint {
        Joint {
            name,
            kind,
            part,
            axis,
            placement: at.1,
            parent: at.0,
            // Limits of a joint with several coordinates mean none of them in particular.
            limits: if part == Part::Whole { self.limits } else { Limits::default() },
            viscous: self.viscous,
            coulomb: self.coulomb,
            armature: 0.0,
            principal: Principal::of(&axis),
        }
    }
}

/// The frame, at the same origin, whose z is `axis`, by the shortest turn.
fn z_to(axis: &Vector3<f64>) -> Pose {
    let across = Vector3::z().cross(axis);
    let sine = crate::math::sqrt(across.dot(&across));
    let about = if sine > 1e-12 { across / sine } else { Vector3::x() };
    Pose { rotation: crate::spatial::rotation_about(&about, crate::math::atan2(sine, axis.z)), translation: Vector3::zeros() }
}

impl Model {
    /// The frame at `pose` in the link of that name.
    ///
    /// # Errors
    /// `at` named a link that is not there.
    pub fn frame_on(&self, at: &str, link: &str, pose: Pose) -> Result<FrameOnBody, BuildError> {
        let unknown = || BuildError::Unknown { at: at.to_string(), kind: "link", name: link.to_string() };
        let link = &self.links[self.link_index(link).ok_or_else(unknown)?];
        Ok(FrameOnBody { body: link.body, pose: link.pose.compose(&pose) })
    }

    fn joint_named(&self, at: &str, joint: &str) -> Result<usize, BuildError> {
        let unknown = || BuildError::Unknown { at: at.to_string(), kind: "joint", name: joint.to_string() };
        self.joint_index(joint).ok_or_else(unknown)
    }

    /// Adds a loop closure.
    ///
    /// # Errors
    /// A loop of that name exists already.
    pub fn add_loop(&mut self, closure: LoopClosure) -> Result<(), BuildError> {
        if self.loops.iter().any(|l| l.name == closure.name) {
            return Err(BuildError::Duplicate { kind: "loop", name: closure.name });
        }
        self.loops.push(closure);
        Ok(())
    }

    /// Refuses a coordinate that is one of several of a joint: it has no meaning alone.
    fn must_be_whole(&self, j: usize, detail: &'static str) -> Result<(), BuildError> {
        if self.joints[j].is_whole() { Ok(()) } else { Err(BuildError::Joint { joint: self.joints[j].name.clone(), detail }) }
    }

    /// Adds a coupling by joint names.
    ///
    /// # Errors
    /// Unknown joints, numbers that are not finite, or a joint that would follow itself or be defined twice.
    pub fn add_coupling(&mut self, joint: &str, of: &[(String, f64)], offset: f64) -> Result<(), BuildError> {
        let at = alloc::format!("coupling of {joint:?}");
        let follower = self.joint_named(&at, joint)?;
        if self.couplings.iter().any(|c| c.joint == follower) {
            return Err(BuildError::Duplicate { kind: "coupling", name: joint.to_string() });
        }
        let alone = "a coordinate of a joint with several cannot be coupled";
        self.must_be_whole(follower, alone)?;
        let mut leaders = Vec::new();
        for (name, ratio) in of {
            let leader = self.joint_named(&at, name)?;
            self.must_be_whole(leader, alone)?;
            if leader == follower {
                return Err(BuildError::Joint { joint: joint.to_string(), detail: "a coupling cannot make a joint follow itself" });
            }
            if !ratio.is_finite() {
                return Err(BuildError::OutOfRange { at, what: "ratio", value: *ratio, unit: "", limit: "must be finite" });
            }
            leaders.push((leader, *ratio));
        }
        if !offset.is_finite() {
            return Err(BuildError::OutOfRange { at, what: "offset", value: offset, unit: "", limit: "must be finite" });
        }
        self.couplings.push(Coupling { joint: follower, of: leaders, offset });
        Ok(())
    }

    /// Adds a drive with its rotor inertia seen at the joint `[kg | kg·m²]`.
    ///
    /// # Errors
    /// Unknown joint, second drive on a joint, or a rotor inertia that is negative or not finite.
    pub fn add_actuator(&mut self, joint: &str, rotor_inertia: f64) -> Result<(), BuildError> {
        let j = self.joint_named("actuator", joint)?;
        self.must_be_whole(
            j,
            "a coordinate of a joint with several cannot be driven; write the joint as joints of one coordinate in series",
        )?;
        if self.actuators.contains(&j) {
            return Err(BuildError::Duplicate { kind: "actuator", name: joint.to_string() });
        }
        if self.couplings.iter().any(|c| c.joint == j) {
            return Err(BuildError::Joint { joint: joint.to_string(), detail: "a joint that a coupling defines cannot be driven" });
        }
        if !(rotor_inertia.is_finite() && rotor_inertia >= 0.0) {
            let at = alloc::format!("actuator {joint:?}");
            return Err(BuildError::OutOfRange {
                at,
                what: "rotor_inertia",
                value: rotor_inertia,
                unit: "kg or kg·m²",
                limit: "must be finite and >= 0",
            });
        }
        self.actuators.push(j);
        self.joints[j].armature = rotor_inertia;
        Ok(())
    }

    /// Adds a sensor on a link.
    ///
    /// # Errors
    /// Unknown link or a second sensor of that name.
    pub fn add_sensor(&mut self, name: &str, kind: SensorKind, link: &str, pose: Pose) -> Result<(), BuildError> {
        if self.sensors.iter().any(|s| s.name == name) {
            return Err(BuildError::Duplicate { kind: "sensor", name: name.to_string() });
        }
        let at = alloc::format!("sensor {name:?}");
        let unknown = BuildError::Unknown { at, kind: "link", name: link.to_string() };
        let link = self.link_index(link).ok_or(unknown)?;
        self.sensors.push(Sensor { name: name.to_string(), kind, link, pose });
        Ok(())
    }

    /// Sets the rough coordinate of a joint in the intended assembly `[m | rad]`.
    ///
    /// # Errors
    /// Unknown joint or a value that is not finite.
    pub fn set_assembly(&mut self, joint: &str, value: f64) -> Result<(), BuildError> {
        let j = self.joint_named("assembly", joint)?;
        if !value.is_finite() {
            let at = alloc::format!("assembly of {joint:?}");
            return Err(BuildError::OutOfRange { at, what: "coordinate", value, unit: "m or rad", limit: "must be finite" });
        }
        self.assembly[j] = value;
        Ok(())
    }
}
