//! Loops and couplings as MuJoCo's equality constraints.

use super::super::closure::{Kind, closing, points};
use super::super::{ExportError, Names, axes, numbers};
use super::xml::Xml;
use crate::model::{Coupling, FrameOnBody, Model};
use crate::spatial::Pose;

const HAS: &str = "points (x y z), pins (x y z and two of rx ry rz) and rigid connections (all six)";

/// One equality constraint between two sites.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Closure {
    name: String,
    element: &'static str,
    /// Name and place of the two sites.
    pub(super) ends: [(String, FrameOnBody); 2],
}

/// What closes the loops of the model; `home` is a closed pose `[m | rad]`.
pub(super) fn closures(model: &Model, home: &[f64]) -> Result<Vec<Closure>, ExportError> {
    let (mut out, mut names, mut sites) = (Vec::new(), Names::default(), Names::default());
    for (index, l) in model.loops.iter().enumerate() {
        let same = closing(model, home, index);
        let refused = || ExportError::Loop { name: l.name.clone(), axes: axes(&l.constrain), program: "MuJoCo", has: HAS };
        let kind = same.kind.ok_or_else(refused)?;
        let mut add = |element, at: Pose, suffix: &str| {
            let end = |frame: &FrameOnBody, shift: &Pose| FrameOnBody { body: frame.body, pose: frame.pose.compose(shift).compose(&at) };
            let a = (sites.fresh(&format!("{}_a{suffix}", l.name)), end(&l.a, &same.shift));
            let b = (sites.fresh(&format!("{}_b{suffix}", l.name)), end(&l.b, &Pose::identity()));
            out.push(Closure { name: names.fresh(&format!("{}{suffix}", l.name)), element, ends: [a, b] });
        };
        let at = |translation| Pose { translation, ..Pose::identity() };
        match (kind, points(kind).as_slice()) {
            (Kind::Frame, _) => add("weld", Pose::identity(), ""),
            (_, [one]) => add("connect", at(*one), ""),
            (_, points) => points.iter().zip(["1", "2"]).for_each(|(p, suffix)| add("connect", at(*p), suffix)),
        }
    }
    Ok(out)
}

/// The elements `tendon` and `equality`.
pub(super) fn write(xml: &mut Xml, model: &Model, closures: &[Closure]) -> Result<(), ExportError> {
    let name = |j: usize| model.joints[j].name.clone();
    let several: Vec<&Coupling> = model.couplings.iter().filter(|c| c.of.len() > 1).collect();
    if !several.is_empty() {
        xml.open("tendon", &[])?;
        for c in &several {
            // Joint equality knows one other joint; a fixed tendon is a sum of any number.
            xml.open("fixed", &[("name", name(c.joint))])?;
            for (j, coefficient) in [(c.joint, 1.0)].into_iter().chain(c.of.iter().map(|&(j, ratio)| (j, -ratio))) {
                xml.empty("joint", &[("joint", name(j)), ("coef", numbers(&[coefficient]))])?;
            }
            xml.close("fixed")?;
        }
        xml.close("tendon")?;
    }
    if closures.is_empty() && model.couplings.is_empty() {
        return Ok(());
    }
    xml.open("equality", &[])?;
    for c in closures {
        let [a, b] = &c.ends;
        xml.empty(c.element, &[("name", c.name.clone()), ("site1", a.0.clone()), ("site2", b.0.clone())])?;
    }
    for c in &model.couplings {
        let constant = |linear: f64| ("polycoef", numbers(&[c.offset, linear, 0.0, 0.0, 0.0]));
        match c.of.as_slice() {
            [] => xml.empty("joint", &[("joint1", name(c.joint)), constant(0.0)])?,
            [(j, ratio)] => xml.empty("joint", &[("joint1", name(c.joint)), ("joint2", name(*j)), constant(*ratio)])?,
            _ => xml.empty("tendon", &[("tendon1", name(c.joint)), constant(0.0)])?,
        }
    }
    xml.close("equality")
}
