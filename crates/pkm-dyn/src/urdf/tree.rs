//! URDF text to a tree: guards before the parser, checks after it.

use nalgebra::{Matrix3, Vector3};
use urdf_rs::JointType;

use super::blame::blame;
use crate::model::{BuildError, Compound, Freedom, JointKind, Limits, Model, ModelBuilder};
use crate::parameters::InertialParameters;
use crate::spatial::Pose;

/// Larger files are refused before parsing `[bytes]`.
pub(super) const MAX_BYTES: usize = 20_000_000;
/// Deeper nesting is refused before parsing: the parser recurses.
const MAX_DEPTH: usize = 64;
/// More links or joints than any robot has; keeps name checks quick on hostile files.
const MAX_LINKS: usize = 2000;

/// Names of elements are told up to here.
const MAX_NAME: usize = 40;

/// Why a URDF text is no robot, without the file's name.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum TreeError {
    #[error("{0}")]
    Text(String),
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// Parses and checks the tree; returns the parsed URDF as well, for writing a changed one later.
pub(super) fn tree(text: &str, name: &str, gravity: [f64; 3]) -> Result<(urdf_rs::Robot, Model), TreeError> {
    guard(text)?;
    let refused = |e: urdf_rs::UrdfError| TreeError::Text(blame(text).unwrap_or_else(|| one_line(&e.to_string())));
    let urdf = urdf_rs::read_from_string(text).map_err(refused)?;
    for (what, count) in [("links", urdf.links.len()), ("joints", urdf.joints.len())] {
        if count > MAX_LINKS {
            return Err(TreeError::Text(format!("{count} {what} (limit {MAX_LINKS})")));
        }
    }
    let mut builder = ModelBuilder::new(name, gravity);
    for link in &urdf.links {
        builder.link(&link.name, link_parameters(link));
    }
    for joint in &urdf.joints {
        builder.joint(joint_part(joint)?);
    }
    let mut model = builder.build()?;
    for joint in &urdf.joints {
        if let Some(mimic) = &joint.mimic {
            let of = [(mimic.joint.clone(), mimic.multiplier.unwrap_or(1.0))];
            model.add_coupling(&joint.name, &of, mimic.offset.unwrap_or(0.0))?;
        }
    }
    Ok((urdf, model))
}

fn guard(text: &str) -> Result<(), TreeError> {
    if text.len() > MAX_BYTES {
        return Err(TreeError::Text(format!("{} bytes (limit {MAX_BYTES})", text.len())));
    }
    let line = |at: usize| 1 + text[..at].matches('\n').count();
    // Where each element that is open begins.
    let (mut open, mut at) = (Vec::new(), 0_usize);
    while let Some(start) = text[at..].find('<').map(|i| at + i) {
        let rest = &text[start..];
        let (end, change) = markup(rest).ok_or_else(|| TreeError::Text(format!("line {}: a URDF has no <!DOCTYPE>", line(start))))?;
        match change {
            Change::Opens => open.push(start),
            Change::Closes => {
                let (closes, opens) = (element(rest), open.pop());
                if opens.is_none_or(|opens| element(&text[opens..]) != closes) {
                    let wanted = opens.map_or("nothing is open there".to_string(), |opens| {
                        format!("<{}> of line {} is open there", element(&text[opens..]), line(opens))
                    });
                    return Err(TreeError::Text(format!("line {}: </{closes}> closes nothing: {wanted}", line(start))));
                }
            }
            Change::Stays => {}
        }
        if open.len() > MAX_DEPTH {
            return Err(TreeError::Text(format!("line {}: elements nested deeper than {MAX_DEPTH}", line(start))));
        }
        at = start + end;
    }
    open.last().map_or(Ok(()), |&opens| {
        let name = element(&text[opens..]);
        Err(TreeError::Text(format!("line {}: <{name}> is never closed: the file ends without </{name}>", line(opens))))
    })
}

/// Name of the element whose opening or closing markup this is; its first letters where it has no end.
pub(super) fn element(markup: &str) -> &str {
    let name = markup[1..].trim_start_matches('/');
    let end = name.find(|c: char| c.is_whitespace() || matches!(c, '>' | '/')).unwrap_or(name.len());
    let end = (0..=end.min(MAX_NAME)).rev().find(|&i| name.is_char_boundary(i)).unwrap_or(0);
    &name[..end]
}

/// What a piece of markup does to the depth of nesting.
pub(super) enum Change {
    Opens,
    Closes,
    Stays,
}

/// Length of the markup that `text` starts with, and what it does to the depth; `None` for declarations, whose entities could hide
/// any depth. Markup without an end reaches to the end of the text: the parser will say so.
pub(super) fn markup(text: &str) -> Option<(usize, Change)> {
    let until = |end: &str| text.find(end).map_or(text.len(), |i| i + end.len());
    for (open, close) in [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")] {
        if text.starts_with(open) {
            return Some((until(close), Change::Stays));
        }
    }
    if text.starts_with("<!") {
        return None;
    }
    if text.starts_with("</") {
        return Some((until(">"), Change::Closes));
    }
    // A `>` or `/>` inside a quoted attribute ends nothing.
    let mut quote = None;
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '>') if text[..i].ends_with('/') => return Some((i + 1, Change::Stays)),
            (None, '>') => return Some((i + 1, Change::Opens)),
            _ => {}
        }
    }
    Some((text.len(), Change::Opens))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn link_parameters(link: &urdf_rs::Link) -> InertialParameters {
    let i = &link.inertial;
    let t = &i.inertia;
    let central = Matrix3::new(t.ixx, t.ixy, t.ixz, t.ixy, t.iyy, t.iyz, t.ixz, t.iyz, t.izz);
    let pose = pose(&i.origin);
    // The inertia is given in a frame at the centre of mass that may be turned against the link.
    InertialParameters::from_centre_of_mass(i.mass.value, Vector3::zeros(), central).transformed(&pose)
}

fn pose(origin: &urdf_rs::Pose) -> Pose {
    Pose::from_xyz_rpy(*origin.xyz, *origin.rpy)
}

fn joint_part(joint: &urdf_rs::Joint) -> Result<crate::model::JointPart, TreeError> {
    let freedom = match joint.joint_type {
        JointType::Revolute | JointType::Continuous => Freedom::One(JointKind::Revolute),
        JointType::Prismatic => Freedom::One(JointKind::Prismatic),
        JointType::Fixed => Freedom::Fixed,
        JointType::Spherical => Freedom::Several(Compound::Spherical),
        JointType::Planar => Freedom::Several(Compound::Planar),
        JointType::Floating => Freedom::Several(Compound::Free),
    };
    let mut limits = Limits::default();
    // URDF demands limits for revolute and prismatic joints; all zero means that none were written.
    let l = &joint.limit;
    let is_stated = [l.lower, l.upper, l.velocity, l.effort].iter().any(|x| x.abs() > 0.0);
    if is_stated && joint.joint_type != JointType::Continuous {
        limits = Limits { lower: l.lower, upper: l.upper, velocity: l.velocity, effort: l.effort };
    }
    let dynamics = joint.dynamics.as_ref();
    Ok(crate::model::JointPart {
        name: joint.name.clone(),
        freedom,
        parent: joint.parent.link.clone(),
        child: joint.child.link.clone(),
        placement: pose(&joint.origin),
        axis: Vector3::from(*joint.axis.xyz),
        limits,
        viscous: dynamics.map_or(0.0, |d| d.damping),
        coulomb: dynamics.map_or(0.0, |d| d.friction),
    })
}
