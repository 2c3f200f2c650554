//! `[task]`: the coordinates in which a law of contact is stated.

use alloc::format;

use pkm_dyn::loops::Output;
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::spatial::Pose;

use super::erased::AnyTask;
use super::section::{FINITE, POSITIVE, Section};
use super::{FileError, Site};
use crate::force::task::{JointTask, LinearTask, PlatformTask};

/// Coordinates of a frame, in the order of their numbers.
const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// Components of a wrench, in the order of their numbers.
const WRENCH: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];

/// Number of coordinates that `[task]` states: that of drives for the drives themselves.
pub(super) fn coordinates(root: &Section<'_>, n_drives: usize) -> Result<usize, FileError> {
    let Some(s) = root.section("task")? else { return Ok(n_drives) };
    let kind = s.choice("kind", &["joint", "platform", "linear"])?;
    if kind.as_deref() == Some("joint") {
        return Ok(n_drives);
    }
    Ok(s.texts("components")?.ok_or_else(|| s.whole("task.components is missing (a list of texts)"))?.len())
}

/// Where a law needs more than the map itself: the drives as their own coordinates.
pub(super) fn joint<const N: usize>() -> AnyTask<N, N> {
    AnyTask::new(JointTask)
}

/// Whether the file leaves the task to the drives themselves.
pub(super) fn is_joint(root: &Section<'_>) -> Result<bool, FileError> {
    let Some(s) = root.section("task")? else { return Ok(true) };
    Ok(s.choice("kind", &["joint", "platform", "linear"])?.as_deref() == Some("joint"))
}

/// A task of `M` coordinates on a frame of the robot, or one that is linear in the drives.
pub(super) fn task<const N: usize, const M: usize>(root: &Section<'_>, site: &Site<'_>) -> Result<AnyTask<N, M>, FileError> {
    let s = root.must("task")?;
    let kind = s.choice("kind", &["joint", "platform", "linear"])?;
    let names = s.texts("components")?.unwrap_or_default();
    let known = if kind.as_deref() == Some("linear") { WRENCH } else { AXES };
    let mut components = [0; M];
    for (slot, name) in components.iter_mut().zip(&names) {
        let found = known.iter().position(|x| x == name);
        *slot = found.ok_or_else(|| s.whole(&format!("task.components: {name:?} is unknown (has: {})", known.join(", "))))?;
    }
    let refused = |e| s.refusal(&e);
    if kind.as_deref() == Some("linear") {
        let (q_0, x_0) = (s.each("q_0", FINITE)?, s.each("x_0", FINITE)?);
        let inverse_jacobian = s.matrix::<N, M>("inverse_jacobian")?;
        return Ok(AnyTask::new(LinearTask::try_new(q_0, x_0, inverse_jacobian, components).map_err(refused)?));
    }
    let model = &site.robot.model;
    let link = s.text("link")?;
    let at = Output::named(model, &link).ok_or_else(|| s.whole(&format!("task.link: {link:?} is no link, sensor or loop of the robot")))?;
    let (xyz, rpy) = (s.maybe_each("xyz", FINITE)?.unwrap_or([0.0; 3]), s.maybe_each("rpy", FINITE)?.unwrap_or([0.0; 3]));
    let pose = at.frame.pose.compose(&Pose::from_xyz_rpy(xyz, rpy));
    let output = Output { frame: FrameOnBody { body: at.frame.body, pose }, ..at };
    let length = s.maybe("length", POSITIVE)?.unwrap_or(1.0);
    Ok(AnyTask::new(PlatformTask::try_new(model.clone(), output, components, length).map_err(refused)?))
}
