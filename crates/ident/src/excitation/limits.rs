//! What a motion must keep: limits of the robot file, limits for this motion alone, distance from singularities.

use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::model::JointKind;
use pkm_dyn::workspace::{Cone, cones};
use pkm_dyn::{Data, Model};

use super::ExciteError;
use super::mechanism::leading;

/// Travel to each side where the robot file states none `[m]` or `[rad]`.
const UNSTATED: [f64; 2] = [0.05, 0.5];

/// What a motion may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Share of the robot file's limits of position, velocity and effort, 0 to 1. Positions are counted from the middle of the travel.
    pub share: f64,
    /// Fastest motion of any drive `[m/s | rad/s]`, beside the robot file's limits.
    pub velocity: Option<f64>,
    /// Largest acceleration of any drive `[m/s² | rad/s²]`.
    pub acceleration: Option<f64>,
    /// How far ball and universal joints may lean from the assembly `[rad]`.
    pub cone: Option<f64>,
    /// Least distance from a singularity: the smallest singular value of the constraints with respect to the joints without a drive, as a
    /// share of that in the middle of the travel, 0 to 1.
    pub singularity: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { share: 0.95, velocity: None, acceleration: None, cone: None, singularity: 0.1 }
    }
}

/// What is bounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bounded {
    /// Position of a joint.
    Position,
    /// Velocity of a joint.
    Velocity,
    /// Acceleration of a drive.
    Acceleration,
    /// Effort of a drive.
    Effort,
    /// Lean of a ball or universal joint.
    Cone,
    /// Distance from a singularity.
    Singularity,
}

impl Bounded {
    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Effort => "effort",
            Self::Cone => "lean",
            Self::Singularity => "distance from singularity",
        }
    }
}

/// A bound: `lower <= value <= upper`, either of which may be infinite.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bound {
    pub(super) what: Bounded,
    /// Joint, drive or cone.
    pub(super) place: usize,
    pub(super) lower: f64,
    pub(super) upper: f64,
}

impl Bound {
    /// Room to both ends in units of half the range, 1 in the middle; 1 to an end that is none.
    pub(super) fn room(&self, value: f64) -> [f64; 2] {
        let half = self.half();
        // To be further than usual from the only end is worth nothing.
        let most = if self.upper.is_finite() { 2.0 } else { 1.0 };
        let share = |room: f64| if room.is_finite() { (room / half).min(most) } else { 1.0 };
        [share(value - self.lower), share(self.upper - value)]
    }

    /// Half the range; for a bound with one end, what the value usually has.
    pub(super) fn half(&self) -> f64 {
        let half = 0.5 * (self.upper - self.lower);
        if half.is_finite() { half } else { 1.0 - self.lower }
    }

    /// The least room at `value`; not a number counts as none.
    pub(super) fn least(&self, value: f64) -> f64 {
        let [a, b] = self.room(value);
        if value.is_finite() { a.min(b) } else { f64::NEG_INFINITY }
    }

    /// The same with this share of the range, about its middle.
    pub(super) fn narrowed(&self, share: f64) -> Self {
        let half = self.half();
        let trim = if half.is_finite() { (1.0 - share) * half } else { 0.0 };
        Self { lower: self.lower + trim, upper: self.upper - trim, ..self.clone() }
    }

    /// Its place in words.
    pub(super) fn name(&self, model: &Model, cones: &[Cone]) -> String {
        match self.what {
            Bounded::Cone => cones[self.place].name.clone(),
            Bounded::Singularity => model.name.clone(),
            Bounded::Effort => model.joints[model.actuators[self.place]].name.clone(),
            _ => model.joints[self.place].name.clone(),
        }
    }
}

/// All bounds of one robot, and where it stands in the middle.
#[derive(Debug, Clone)]
pub(super) struct Bounds {
    /// Drives' positions in the middle of the travel `[m | rad]`.
    pub(super) centre: Vec<f64>,
    /// Tree coordinates there.
    pub(super) tree: Vec<f64>,
    /// Position, velocity and acceleration of each drive.
    pub(super) drives: Vec<[Bound; 3]>,
    /// Bounds that need the pose of the whole robot.
    pub(super) robot: Vec<Bound>,
    pub(super) cones: Vec<Cone>,
}

impl Bounds {
    /// Of more drives than freedoms the first ones are bounded as drives, the others as joints that they move.
    pub(super) fn try_new(whole: &Model, limits: &Limits) -> Result<Self, ExciteError> {
        check(limits)?;
        let leading = leading(whole);
        let model = leading.as_ref().unwrap_or(whole);
        let mut data = Data::new(model);
        let home = assemble(model, &mut data);
        if !home.is_closed {
            return Err(ExciteError::Open { gap: home.gap, row: home.row });
        }
        let at_home = data.q.clone();
        let cones = cones(model, &mut data, &at_home);
        data.q.copy_from_slice(&at_home);
        let mut centre = mid_pose(model);
        if !walk_to(model, &mut data, &centre).is_closed {
            data.q.copy_from_slice(&at_home);
            centre = model.actuators.iter().map(|&j| at_home[j]).collect();
        }
        let drives = model.actuators.iter().zip(&centre).map(|(&j, &c)| of_drive(model, limits, j, c)).collect();
        let robot = of_robot([model, whole], limits, cones.len());
        Ok(Self { centre, tree: data.q, drives, robot, cones })
    }

    /// All with a share of their ranges.
    pub(super) fn narrowed(&self, share: f64) -> Self {
        let drives = self.drives.iter().map(|d| d.each_ref().map(|b| b.narrowed(share))).collect();
        Self { drives, robot: self.robot.iter().map(|b| b.narrowed(share)).collect(), ..self.clone() }
    }
}

fn check(limits: &Limits) -> Result<(), ExciteError> {
    let positive = |x: Option<f64>| x.unwrap_or(1.0);
    for (what, value, limit, is_good) in [
        ("share of the limits", limits.share, "must be > 0 and <= 1", limits.share > 0.0 && limits.share <= 1.0),
        ("velocity", positive(limits.velocity), "must be finite and > 0", is_positive(positive(limits.velocity))),
        ("acceleration", positive(limits.acceleration), "must be finite and > 0", is_positive(positive(limits.acceleration))),
        ("cone", positive(limits.cone), "must be finite and > 0", is_positive(positive(limits.cone))),
        ("singularity", limits.singularity, "must be >= 0 and < 1", (0.0..1.0).contains(&limits.singularity)),
    ] {
        if !is_good {
            return Err(ExciteError::Setting { what, value, limit });
        }
    }
    Ok(())
}

fn is_positive(x: f64) -> bool {
    x > 0.0 && x.is_finite()
}

fn of_drive(model: &Model, limits: &Limits, j: usize, centre: f64) -> [Bound; 3] {
    let joint = &model.joints[j];
    let stated = joint.limits;
    let unstated = if joint.kind == JointKind::Prismatic { UNSTATED[0] } else { UNSTATED[1] };
    let end = |x: f64, side: f64| if x.is_finite() { x } else { centre + side * unstated };
    let position =
        Bound { what: Bounded::Position, place: j, lower: end(stated.lower, -1.0), upper: end(stated.upper, 1.0) }.narrowed(limits.share);
    let symmetric = |what, most: f64| Bound { what, place: j, lower: -most, upper: most };
    let speed = if stated.velocity > 0.0 { limits.share * stated.velocity } else { f64::INFINITY };
    let velocity = symmetric(Bounded::Velocity, speed.min(limits.velocity.unwrap_or(f64::INFINITY)));
    [position, velocity, symmetric(Bounded::Acceleration, limits.acceleration.unwrap_or(f64::INFINITY))]
}

/// `whole` has all the drives.
fn of_robot([model, whole]: [&Model; 2], limits: &Limits, n_cones: usize) -> Vec<Bound> {
    let mut out = Vec::new();
    let passive: Vec<usize> = if model.is_constrained() { model.passive() } else { Vec::new() };
    for &j in &passive {
        let stated = model.joints[j].limits;
        if stated.lower.is_finite() && stated.upper.is_finite() && stated.upper > stated.lower {
            out.push(Bound { what: Bounded::Position, place: j, lower: stated.lower, upper: stated.upper }.narrowed(limits.share));
        }
        if stated.velocity > 0.0 && stated.velocity.is_finite() {
            let most = limits.share * stated.velocity;
            out.push(Bound { what: Bounded::Velocity, place: j, lower: -most, upper: most });
        }
    }
    for (k, &j) in whole.actuators.iter().enumerate() {
        let most = limits.share * model.joints[j].limits.effort;
        if most > 0.0 && most.is_finite() {
            out.push(Bound { what: Bounded::Effort, place: k, lower: -most, upper: most });
        }
    }
    if let Some(most) = limits.cone {
        // A lean has no sign, so there is no lower end to keep away from.
        let of = |c| Bound { what: Bounded::Cone, place: c, lower: -most, upper: most };
        out.extend((0..n_cones).map(of));
    }
    if model.is_constrained() && limits.singularity > 0.0 {
        out.push(Bound { what: Bounded::Singularity, place: 0, lower: limits.singularity, upper: f64::INFINITY });
    }
    out
}
