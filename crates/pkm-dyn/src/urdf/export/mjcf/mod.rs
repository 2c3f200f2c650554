//! A robot as MJCF, MuJoCo's own format (3.2 or later).
//!
//! Loops are equality constraints between sites, so that they do not depend on a pose: MuJoCo takes anchors on bodies from coordinates
//! zero, where the loops of a parallel robot are open. Bodies have their inertia about the centre of mass in the link's own frame. The
//! capsules are a skeleton to look at: no mass, no contact.

mod bodies;
mod closures;
mod inertia;
mod joints;
mod xml;

use nalgebra::{Matrix3, Vector3};

use super::joints::left_out;
use super::{ExportError, Names, home, numbers, printable};
use crate::effects::Robot;
use crate::model::Model;
use crate::spatial::Pose;
use bodies::{Body, bodies};
use xml::Xml;

/// A robot written for MuJoCo.
#[derive(Debug, Clone, PartialEq)]
pub struct Mjcf {
    /// The model file.
    pub xml: String,
    /// What the file does not say or says otherwise, one line each; they stand at its head as well.
    pub notes: Vec<String>,
}

/// Writes the robot for MuJoCo, with its closed assembly as the keyframe `home`.
///
/// # Errors
/// Loops that MuJoCo cannot close exactly (it has points, pins and rigid connections) or that are open, and inertias that no body has.
pub fn mjcf(robot: &Robot) -> Result<Mjcf, ExportError> {
    let model = &robot.model;
    let home = home(model)?;
    let closures = closures::closures(model, &home)?;
    let bodies = bodies(model);
    let mut notes = bodies::notes(robot, &bodies, inertia::TINY);
    notes.extend(left_out(robot, &[]));
    notes.extend(
        model.joints.iter().filter(|j| joints::is_stuck(j)).map(|j| format!("joint {:?}: no travel is stated, none is written", j.name)),
    );
    if !model.sensors.is_empty() {
        notes.push("sensors are left out".to_string());
    }
    let mut xml = Xml::new();
    let head = [format!("{}: written by pkm; SI units, gravity in the root link's frame.", model.name)];
    xml.comment(&[&head[..], &notes].concat())?;
    xml.open("mujoco", &[("model", printable(&model.name))])?;
    settings(&mut xml, model)?;
    Tree { robot, bodies: &bodies, sites: sites(model, &closures), reach: reach(model) }.write(&mut xml)?;
    closures::write(&mut xml, model, &closures)?;
    drives(&mut xml, model)?;
    let q: Vec<f64> = bodies.iter().flat_map(|b| joints::coordinates(model, b, &home)).collect();
    xml.open("keyframe", &[])?;
    xml.empty("key", &[("name", "home".to_string()), ("qpos", numbers(&q))])?;
    xml.close("keyframe")?;
    xml.close("mujoco")?;
    Ok(Mjcf { xml: xml.text()?, notes })
}

fn settings(xml: &mut Xml, model: &Model) -> Result<(), ExportError> {
    let text = str::to_string;
    xml.empty("compiler", &[("angle", text("radian")), ("autolimits", text("true"))])?;
    let g = numbers(model.gravity.as_slice());
    xml.empty("option", &[("gravity", g), ("timestep", text("0.001")), ("integrator", text("implicitfast"))])?;
    xml.open("default", &[])?;
    xml.empty("geom", &[("contype", text("0")), ("conaffinity", text("0")), ("mass", text("0")), ("rgba", text("0.5 0.6 0.7 1"))])?;
    // As stiff as the step allows: the loops of the model do not give way.
    xml.empty("equality", &[("solref", text("0.002 1")), ("solimp", text("0.9999 0.9999 0.001 0.5 2"))])?;
    xml.close("default")
}

/// A frame fixed to a body (or the world) that the file names.
struct Site {
    body: Option<usize>,
    name: String,
    pose: Pose,
}

/// Frames of the loops, and links fixed to others.
fn sites(model: &Model, closures: &[closures::Closure]) -> Vec<Site> {
    let mut out: Vec<Site> = Vec::new();
    for c in closures {
        out.extend(c.ends.iter().map(|(name, frame)| Site { body: frame.body, name: name.clone(), pose: frame.pose }));
    }
    let mut names = Names::new(out.iter().map(|s| s.name.as_str()));
    let is_fixed = |l: &&crate::model::Link| l.pose != Pose::identity();
    let links: Vec<Site> =
        model.links.iter().filter(is_fixed).map(|l| Site { body: l.body, name: names.fresh(&l.name), pose: l.pose }).collect();
    out.extend(links);
    out
}

/// Longest stretch from one joint to the next `[m]`: the size of what is drawn.
fn reach(model: &Model) -> f64 {
    let longest = model.joints.iter().map(|j| j.placement.translation.norm()).fold(0.0, f64::max);
    if longest > 0.0 { longest } else { 1.0 }
}

/// The bodies, and what is needed to write them.
struct Tree<'t> {
    robot: &'t Robot,
    bodies: &'t [Body],
    sites: Vec<Site>,
    reach: f64,
}

impl Tree<'_> {
    fn write(&self, xml: &mut Xml) -> Result<(), ExportError> {
        xml.open("worldbody", &[])?;
        self.fixed(xml, None)?;
        // Depth first order: a body's parent is open, others on top of it are to be closed.
        let mut open: Vec<usize> = Vec::new();
        for (i, body) in self.bodies.iter().enumerate() {
            while open.last() != body.parent.as_ref() {
                open.pop();
                xml.close("body")?;
            }
            self.body(xml, i)?;
            open.push(i);
        }
        for _ in open {
            xml.close("body")?;
        }
        xml.close("worldbody")
    }

    fn body(&self, xml: &mut Xml, i: usize) -> Result<(), ExportError> {
        let (body, model) = (&self.bodies[i], &self.robot.model);
        let mut attributes = vec![("name", body.name.clone())];
        attributes.extend(placed(&body.pose));
        xml.open("body", &attributes)?;
        let m = inertia::inertial(&model.bodies[body.body], &body.name)?;
        let i6 = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|at| m.central[at]);
        let com = numbers(m.com.as_slice());
        xml.empty("inertial", &[("pos", com), ("mass", numbers(&[m.mass])), ("fullinertia", numbers(&i6))])?;
        for attributes in joints::attributes(self.robot, body) {
            xml.empty("joint", &attributes)?;
        }
        self.fixed(xml, Some(body.body))?;
        self.skeleton(xml, i)
    }

    /// Sites of a body, or of the world.
    fn fixed(&self, xml: &mut Xml, body: Option<usize>) -> Result<(), ExportError> {
        for site in self.sites.iter().filter(|s| s.body == body) {
            let mut attributes = vec![("name", site.name.clone()), ("size", numbers(&[0.03 * self.reach]))];
            attributes.extend(placed(&site.pose));
            xml.empty("site", &attributes)?;
        }
        Ok(())
    }

    /// Capsules from the body's origin to everything fixed to it.
    fn skeleton(&self, xml: &mut Xml, i: usize) -> Result<(), ExportError> {
        let children = self.bodies.iter().filter(|b| b.parent == Some(i)).map(|b| b.pose.translation);
        let ends = self.sites.iter().filter(|s| s.body == Some(self.bodies[i].body)).map(|s| s.pose.translation);
        let size = numbers(&[0.02 * self.reach]);
        for end in children.chain(ends).filter(|p| p.norm() > 0.02 * self.reach) {
            let stretch = numbers(&[0.0, 0.0, 0.0, end.x, end.y, end.z]);
            xml.empty("geom", &[("type", "capsule".to_string()), ("size", size.clone()), ("fromto", stretch)])?;
        }
        Ok(())
    }
}

fn placed(pose: &Pose) -> Vec<(&'static str, String)> {
    let mut out = Vec::new();
    if pose.translation != Vector3::zeros() {
        out.push(("pos", numbers(pose.translation.as_slice())));
    }
    if pose.rotation != Matrix3::identity() {
        out.push(("quat", numbers(&joints::turned(&pose.rotation))));
    }
    out
}

/// One motor per drive, in the order of `tau`: its control is the drive's effort.
fn drives(xml: &mut Xml, model: &Model) -> Result<(), ExportError> {
    xml.open("actuator", &[])?;
    for &j in &model.actuators {
        let joint = &model.joints[j];
        let mut attributes = vec![("name", joint.name.clone()), ("joint", joint.name.clone())];
        if joint.limits.effort.is_finite() && joint.limits.effort > 0.0 {
            attributes.push(("ctrlrange", numbers(&[-joint.limits.effort, joint.limits.effort])));
        }
        xml.empty("motor", &attributes)?;
    }
    xml.close("actuator")
}
