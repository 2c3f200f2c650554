//! A robot as URDF and a loop file in the style of Gepetto's toolbox-parallel-robots, for Pinocchio.
//!
//! The toolbox reads `robot.urdf` and `robot.yaml` of one folder. The YAML names pairs of frames of the URDF that a constraint of type
//! `3d` (origins coincide) or `6d` (frames coincide) keeps together, and the driven joints. A pin is two points on its axis. Loops
//! that are neither, and do not amount to either in this robot, are closed at the end of massless links on joints that carry the free
//! motions. What a URDF cannot say stands in the YAML under keys that the toolbox passes over: `armature`, `gravity`, `home`.

mod several;

use nalgebra::{Matrix3, Vector3};
use urdf_rs::JointType;

use super::closure::{Kind, closing, gap, points};
use super::joints::{left_out, physics};
use super::{ExportError, Names, axes, home, printable};
use crate::effects::{Law, Robot};
use crate::math;
use crate::model::{LoopClosure, Model};
use crate::spatial::Pose;
use crate::urdf::read::Description;
use crate::urdf::write::changed_urdf;

/// What a limit that is not stated becomes: a URDF has no word for it `[any unit]`.
const UNLIMITED: f64 = 1e9;

/// Gravity that Pinocchio assumes, along −z `[m/s²]`.
const STANDARD_GRAVITY: f64 = 9.81;

const HAS: &str = "constraints of types 3d (x y z) and 6d (all six) and, to loosen them, massless joints with one free rotation or all";

/// A robot written for Pinocchio.
#[derive(Debug, Clone, PartialEq)]
pub struct Gepetto {
    /// `robot.urdf`.
    pub urdf: String,
    /// `robot.yaml`.
    pub yaml: String,
    /// What the files do not say or say otherwise, one line each; they stand at the head of the YAML as well.
    pub notes: Vec<String>,
}

/// Writes the robot for Pinocchio.
///
/// # Errors
/// Loops that forbid one rotation alone, loops that are open, couplings to several independent joints.
pub fn gepetto(description: &Description) -> Result<Gepetto, ExportError> {
    // Origins are the URDF's own: lengths that effects change are not in them, and must not be in the poses that go with them.
    let notes = left_out(&description.robot, &["spring", "geometry_error"]);
    let mut straight = description.clone();
    let effects = description.robot.effects.iter().filter(|e| !matches!(e.entry.law, Law::Geometry(_)));
    straight.robot = Robot::new(description.bare.clone(), effects.cloned().collect());
    written(&straight, notes)
}

fn written(description: &Description, notes: Vec<String>) -> Result<Gepetto, ExportError> {
    let robot = &description.robot;
    let q = home(&robot.model)?;
    let mut model = robot.model.clone();
    for j in 0..model.nv() {
        let p = physics(robot, j);
        (model.joints[j].armature, model.joints[j].viscous, model.joints[j].coulomb) = (p.armature, p.viscous, p.coulomb);
    }
    let urdf = changed_urdf(description, &model);
    let taken = urdf.links.iter().map(|l| l.name.as_str()).chain(urdf.joints.iter().map(|j| j.name.as_str()));
    let mut out = Writing { names: Names::new(taken), urdf, home: Vec::new(), pairs: Vec::new(), notes };
    let whole = (0..model.nv()).filter(|&j| model.joints[j].is_whole());
    out.home = whole.map(|j| (model.joints[j].name.clone(), format!("{:?}", q[j]))).collect();
    out.several(&model, &q);
    out.limits(&model);
    out.couplings(&model)?;
    for index in 0..model.loops.len() {
        out.close(description, &q, index)?;
    }
    let gravity = out.upright(&model);
    if out.urdf.links.iter().any(has_mesh) {
        out.notes.push("mesh files are not copied; their names are those of the original URDF".to_string());
    }
    let yaml = out.yaml(&model, gravity);
    let urdf = urdf_rs::write_to_string(&out.urdf).map_err(|e| ExportError::Writing(e.to_string()))?;
    Ok(Gepetto { urdf, yaml, notes: out.notes })
}

fn has_mesh(link: &urdf_rs::Link) -> bool {
    let mut shapes = link.visual.iter().map(|v| &v.geometry).chain(link.collision.iter().map(|c| &c.geometry));
    shapes.any(|g| matches!(g, urdf_rs::Geometry::Mesh { .. }))
}

/// The files in the making.
struct Writing {
    names: Names,
    urdf: urdf_rs::Robot,
    /// Coordinates of every moving joint in the closed assembly `[m | rad]`, as the YAML has them.
    home: Vec<(String, String)>,
    /// Frames that coincide, and by which type of constraint.
    pairs: Vec<([String; 2], &'static str)>,
    notes: Vec<String>,
}

impl Writing {
    /// Pinocchio reads no revolute or prismatic joint without limits, and takes missing numbers for zero.
    fn limits(&mut self, model: &Model) {
        for joint in &mut self.urdf.joints {
            let Some(j) = model.joint_index(&joint.name).filter(|_| joint.joint_type != JointType::Continuous) else { continue };
            let limits = model.joints[j].limits;
            let finite = |x: f64| x.clamp(-UNLIMITED, UNLIMITED);
            let l = &mut joint.limit;
            (l.lower, l.upper) = (finite(limits.lower), finite(limits.upper));
            (l.velocity, l.effort) = (finite(limits.velocity), finite(limits.effort));
        }
    }

    fn couplings(&mut self, model: &Model) -> Result<(), ExportError> {
        for c in &model.couplings {
            let name = &model.joints[c.joint].name;
            let (of, offset) = resolved(model, c.joint);
            let [(leader, ratio)] = of.as_slice() else {
                return Err(ExportError::Coupling { joint: name.clone(), leaders: of.len() });
            };
            let mimic = urdf_rs::Mimic { joint: model.joints[*leader].name.clone(), multiplier: Some(*ratio), offset: Some(offset) };
            if let Some(joint) = self.urdf.joints.iter_mut().find(|j| j.name == *name) {
                joint.mimic = Some(mimic);
            }
        }
        if !model.couplings.is_empty() {
            self.notes.push("couplings are <mimic>: Pinocchio heeds them when asked to (mimic=True), the toolbox does not".to_string());
        }
        Ok(())
    }

    fn close(&mut self, description: &Description, q: &[f64], index: usize) -> Result<(), ExportError> {
        let (model, spec) = (&description.robot.model, &description.spec.loops[index]);
        let closure = &model.loops[index];
        // Frames in the links that robot.toml names: the URDF still has fixed joints that the model has lumped.
        let a = (spec.a.link.as_str(), Pose::from_xyz_rpy(spec.a.xyz, spec.a.rpy));
        let b = (spec.b.link.as_str(), Pose::from_xyz_rpy(spec.b.xyz, spec.b.rpy));
        let same = closing(model, q, index);
        let a = (a.0, a.1.compose(&same.shift));
        if let Some(kind) = same.kind {
            self.close_as(kind, &closure.name, a, b);
        } else {
            self.close_loosely(&loosened(closure, &same.rows, &gap(model, q, index))?, &closure.name, a, b);
        }
        Ok(())
    }

    fn close_as(&mut self, kind: Kind, name: &str, a: (&str, Pose), b: (&str, Pose)) {
        let mut points = points(kind);
        let kind = if kind == Kind::Frame { "6d" } else { "3d" };
        if points.is_empty() {
            points.push(Vector3::zeros());
        }
        let is_one = points.len() == 1;
        for (i, translation) in points.into_iter().enumerate() {
            let at = Pose { translation, ..Pose::identity() };
            let suffix = if is_one { String::new() } else { (i + 1).to_string() };
            let ends =
                [("a", a), ("b", b)].map(|(end, (link, pose))| self.frame(&format!("{name}_{end}{suffix}"), link, &pose.compose(&at)));
            self.pairs.push((ends, kind));
        }
    }

    fn close_loosely(&mut self, loose: &Loose, name: &str, a: (&str, Pose), b: (&str, Pose)) {
        let mut end = self.frame(&format!("{name}_a"), a.0, &a.1);
        let mut joints = Vec::new();
        for (axis, kind, value) in &loose.joints {
            let word = if *kind == JointType::Prismatic { "slide" } else { "turn" };
            let link = self.link(&format!("{name}_{word}_{}", ["x", "y", "z"][*axis]));
            let joint = self.joint(&format!("{link}_joint"), kind.clone(), [&end, &link], &Pose::identity());
            joint.axis.xyz.0 = Vector3::ith(*axis, 1.0).into();
            let joint = joint.name.clone();
            self.home.push((joint.clone(), format!("{value:?}")));
            joints.push(joint);
            end = link;
        }
        let b = self.frame(&format!("{name}_b"), b.0, &b.1);
        self.pairs.push(([end, b], loose.kind));
        self.notes.push(format!(
            "loop {name:?} ends in massless links on the joints {}: forward dynamics needs a little mass there, all else does not",
            joints.join(" ")
        ));
    }

    /// A link fixed to another, by name; the new link's name.
    fn frame(&mut self, wanted: &str, link: &str, pose: &Pose) -> String {
        let name = self.link(wanted);
        self.joint(&format!("{name}_joint"), JointType::Fixed, [link, &name], pose);
        name
    }

    /// A link without mass, by the name or the nearest free one.
    fn link(&mut self, wanted: &str) -> String {
        let name = self.names.fresh(wanted);
        let inertial = urdf_rs::Inertial::default();
        self.urdf.links.push(urdf_rs::Link { name: name.clone(), inertial, visual: Vec::new(), collision: Vec::new() });
        name
    }

    /// A joint between links that are there, parent and child, by the name or the nearest free one.
    fn joint(&mut self, wanted: &str, joint_type: JointType, ends: [&str; 2], pose: &Pose) -> &mut urdf_rs::Joint {
        let name = self.names.fresh(wanted);
        let [parent, child] = ends.map(|link| urdf_rs::LinkName { link: link.to_string() });
        let limit = if joint_type == JointType::Fixed { urdf_rs::JointLimit::default() } else { unlimited() };
        let at = self.urdf.joints.len();
        self.urdf.joints.push(urdf_rs::Joint {
            name,
            joint_type,
            origin: origin(pose),
            parent,
            child,
            axis: urdf_rs::Axis::default(),
            limit,
            calibration: None,
            dynamics: None,
            mimic: None,
            safety_controller: None,
        });
        &mut self.urdf.joints[at]
    }

    /// Puts the root on a new one in which gravity points along −z, where it does not; gravity in the root that results `[m/s²]`.
    fn upright(&mut self, model: &Model) -> Vector3<f64> {
        let g = model.gravity;
        let size = math::sqrt(g.dot(&g));
        if (size - STANDARD_GRAVITY).abs() > 1e-12 {
            self.notes.push(format!("gravity is {size} m/s² and Pinocchio assumes {STANDARD_GRAVITY}: set model.gravity"));
        }
        let down = Vector3::new(0.0, 0.0, -size);
        if size <= 0.0 || (g - down).amax() <= 1e-15 * size {
            return g;
        }
        let pose = Pose { rotation: turning(&(g / size), &-Vector3::z()), translation: Vector3::zeros() };
        let (root, old) = (self.link("upright"), model.root.clone());
        self.joint(&format!("{root}_joint"), JointType::Fixed, [&root, &old], &pose);
        // The new root comes first: readers that do not look for it take it for the root.
        self.urdf.links.rotate_right(1);
        self.notes.push(format!("the root link {old:?} stands turned in {root:?}, whose z axis points up: a URDF has no gravity"));
        down
    }

    fn yaml(&self, model: &Model, gravity: Vector3<f64>) -> String {
        use core::fmt::Write;
        let list = |items: Vec<String>| format!("[{}]", items.join(", "));
        let mut out =
            format!("# {}: loops and drives of robot.urdf, for toolbox-parallel-robots. Written by pkm.\n", printable(&model.name));
        for note in &self.notes {
            let _ = writeln!(out, "# {}", printable(note));
        }
        let pairs = self.pairs.iter().map(|([a, b], _)| format!("[{}, {}]", quoted(a), quoted(b))).collect();
        let types = self.pairs.iter().map(|(_, kind)| quoted(kind)).collect();
        let drives = |text: &dyn Fn(usize) -> String| list(model.actuators.iter().map(|&j| text(j)).collect());
        let _ = writeln!(out, "closed_loop: {}\ntype: {}", list(pairs), list(types));
        let _ = writeln!(out, "name_mot: {}", drives(&|j| quoted(&model.joints[j].name)));
        let _ = writeln!(
            out,
            "# Not the toolbox's own: rotor inertia of every joint that has one, gravity of the root frame, the closed assembly. SI."
        );
        let rotors = model.joints.iter().filter(|j| j.armature > 0.0).map(|j| format!("{}: {:?}", quoted(&j.name), j.armature));
        let _ = writeln!(out, "armature: {{{}}}", rotors.collect::<Vec<_>>().join(", "));
        let _ = writeln!(out, "gravity: {}", list(gravity.iter().map(|x| format!("{x:?}")).collect()));
        let home = self.home.iter().map(|(name, q)| format!("{}: {q}", quoted(name))).collect::<Vec<_>>().join(", ");
        let _ = writeln!(out, "home: {{{home}}}");
        out
    }
}

/// What stands for no limits.
fn unlimited() -> urdf_rs::JointLimit {
    urdf_rs::JointLimit { lower: -UNLIMITED, upper: UNLIMITED, effort: UNLIMITED, velocity: UNLIMITED, ..Default::default() }
}

/// Joints that carry what a loop leaves free, and the constraint at their end.
struct Loose {
    /// Axis, kind, and coordinate in the closed assembly `[m | rad]`.
    joints: Vec<(usize, JointType, f64)>,
    kind: &'static str,
}

/// The vector from a to b and the rotation vector are coordinates of slides, and of one hinge or none. Two free components of a
/// rotation vector are no two hinges in series.
fn loosened(closure: &LoopClosure, rows: &[bool; 6], gap: &[f64; 6]) -> Result<Loose, ExportError> {
    let free = |k: &usize| !rows[*k];
    let mut joints: Vec<_> = (0..3).filter(free).map(|k| (k, JointType::Prismatic, gap[k])).collect();
    let turns: Vec<usize> = (3..6).filter(free).collect();
    match turns.as_slice() {
        [] => Ok(Loose { joints, kind: "6d" }),
        [k] => {
            joints.push((k - 3, JointType::Revolute, gap[*k]));
            Ok(Loose { joints, kind: "6d" })
        }
        [_, _, _] => Ok(Loose { joints, kind: "3d" }),
        _ => Err(ExportError::Loop {
            name: closure.name.clone(),
            axes: axes(&closure.constrain),
            program: "toolbox-parallel-robots",
            has: HAS,
        }),
    }
}

/// A coupled joint as a sum over independent joints: their ratios, and the constant part `[m | rad]`.
fn resolved(model: &Model, joint: usize) -> (Vec<(usize, f64)>, f64) {
    let (mut of, mut offset) = (vec![(joint, 1.0)], 0.0);
    // Every round puts the leaders in the place of a follower. Followers in a circle never end; those are as many leaders.
    for _ in 0..model.couplings.len() {
        let mut next: Vec<(usize, f64)> = Vec::new();
        for (j, ratio) in of {
            let Some(c) = model.couplings.iter().find(|c| c.joint == j) else {
                next.push((j, ratio));
                continue;
            };
            offset += ratio * c.offset;
            next.extend(c.of.iter().map(|&(leader, r)| (leader, ratio * r)));
        }
        of = summed(next);
    }
    (of, offset)
}

fn summed(terms: Vec<(usize, f64)>) -> Vec<(usize, f64)> {
    let mut out: Vec<(usize, f64)> = Vec::new();
    for (j, ratio) in terms {
        match out.iter_mut().find(|(k, _)| *k == j) {
            Some((_, sum)) => *sum += ratio,
            None => out.push((j, ratio)),
        }
    }
    out
}

/// The shortest rotation that takes the unit vector `from` to the unit vector `to`.
fn turning(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let (axis, cosine) = (from.cross(to), from.dot(to));
    let sine = math::sqrt(axis.dot(&axis));
    if sine > 0.0 {
        return crate::spatial::rotation_about(&(axis / sine), math::atan2(sine, cosine));
    }
    if cosine > 0.0 { Matrix3::identity() } else { Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)) }
}

fn origin(pose: &Pose) -> urdf_rs::Pose {
    // Zero has no sign here.
    let signless = |v: [f64; 3]| urdf_rs::Vec3(v.map(|x| x + 0.0));
    urdf_rs::Pose { xyz: signless(pose.translation.into()), rpy: signless(rpy(&pose.rotation)) }
}

/// Roll, pitch, yaw `[rad]` of `Rz(yaw)·Ry(pitch)·Rx(roll)`.
fn rpy(r: &Matrix3<f64>) -> [f64; 3] {
    let cosine = math::hypot(r[(0, 0)], r[(1, 0)]);
    let pitch = math::atan2(-r[(2, 0)], cosine);
    // Upright, roll and yaw turn about one axis, and yaw alone says it all.
    if cosine < 1e-12 {
        return [0.0, pitch, math::atan2(-r[(0, 1)], r[(1, 1)])];
    }
    [math::atan2(r[(2, 1)], r[(2, 2)]), pitch, math::atan2(r[(1, 0)], r[(0, 0)])]
}

/// A YAML scalar in double quotes, which take JSON's escapes.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => out.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roll_pitch_yaw_come_back() {
        for angles in
            [[0.3, -0.7, 2.0], [-3.0, 1.5, 0.1], [0.4, core::f64::consts::FRAC_PI_2, -0.2], [0.0, -core::f64::consts::FRAC_PI_2, 1.0]]
        {
            let r = Pose::from_xyz_rpy([0.0; 3], angles).rotation;
            let back = Pose::from_xyz_rpy([0.0; 3], rpy(&r)).rotation;
            assert!((back - r).amax() < 1e-15, "{angles:?}: {:e}", (back - r).amax());
        }
    }

    #[test]
    fn any_direction_turns_down() {
        let down = -Vector3::z();
        for from in [Vector3::x(), Vector3::z(), down, Vector3::new(0.6, 0.0, 0.8), Vector3::new(1e-9, 0.0, -1.0).normalize()] {
            let r = turning(&from, &down);
            assert!((r * from - down).norm() < 1e-15 && (r.determinant() - 1.0).abs() < 1e-15, "{from:?}");
        }
    }

    #[test]
    fn names_are_quoted_as_yaml_wants() {
        assert_eq!(quoted("a\"b\\c\n: #"), "\"a\\\"b\\\\c\\u000a: #\"");
    }
}
