//! Physics to be concealed in a robot: one effect of the catalogue, drawn by seed, clearly visible but of realistic size.

use pkm_dyn::effects::{Applied, EffectError, Entry, Law, Parameter, PlaceKind, Robot, Site, Unit, find};
use pkm_dyn::model::{JointKind, Model};
use pkm_dyn::urdf::Description;

use crate::error::SimError;
use crate::nominal_motion::NominalMotion;
use crate::random::{Random, Stream};
use pkm_ident::size::rms;

/// Hidden effects change the effort of some drive by this share of its rms, where their own physical bounds allow it.
const VISIBLE: (f64, f64) = (0.10, 0.20);

/// An effect drawn without a name changes some effort by at least this share of its rms, or another is drawn: an encoder offset that
/// no drive feels is hidden too well. Delays and lags are exempt: theirs is a small change with a clear signature.
const TOO_WELL_HIDDEN: f64 = 0.02;

/// Draws of an unnamed effect before the last one is taken as it is.
const DRAWS: usize = 20;

/// Draws one effect of those named in `among`, or `effect`, with a place and a size that suit the robot.
///
/// `among` are usually the effects that a diagnosis looks for; with `effect` stated it is not used.
///
/// # Errors
/// An unknown effect, or one that the robot has no place for; a robot on which no motion is possible.
pub fn draw(seed: u64, description: &Description, effect: Option<&str>, among: &[&str]) -> Result<Vec<Applied>, SimError> {
    let robot = &description.robot;
    let has_passive = !robot.model.passive().is_empty();
    let known = |name: &str| find(name).ok_or_else(|| EffectError::Unknown { name: name.to_string() });
    let named = effect.map(known).transpose()?;
    if let Some(entry) = named
        && entry.place == PlaceKind::PassiveJoint
        && !has_passive
    {
        return Err(SimError::NoPlace { effect: entry.name, problem: "the robot has no passive joint" });
    }
    let mut suitable = among.iter().map(|name| known(name)).collect::<Result<Vec<_>, _>>()?;
    suitable.retain(|e| has_passive || e.place != PlaceKind::PassiveJoint);
    if named.is_none() && suitable.is_empty() {
        return Err(SimError::Scenario { what: "number of effects to draw among", value: 0.0, limit: "must be > 0" });
    }
    let motion = NominalMotion::new(robot, seed)?;
    let mut random = Random::new(seed, Stream::Hidden);
    let mut draws = 1;
    loop {
        let entry = named.unwrap_or_else(|| suitable[random.index(suitable.len())]);
        let share = random.uniform(VISIBLE.0, VISIBLE.1);
        let mut dice = Dice { robot, motion: &motion, random: &mut random, share, entry };
        let applied = match entry.place {
            PlaceKind::Joint => dice.at_a_drive(),
            PlaceKind::PassiveJoint => dice.at_a_passive_joint(),
            PlaceKind::Link => match entry.law {
                Law::Inertia(_) => dice.on_a_link(),
                _ => dice.on_the_environment(),
            },
            PlaceKind::RootLink => dice.at_the_mounting(),
            PlaceKind::JointPair => dice.at_two_drives(),
            PlaceKind::LinkOrLoop => dice.at_a_length(),
            PlaceKind::JointOrSensor | PlaceKind::LinkOrJoint => dice.on_a_drive_over_time(),
        }?;
        if named.is_some() || draws == DRAWS || dice.change_of(&applied)? >= TOO_WELL_HIDDEN {
            return Ok(vec![applied]);
        }
        draws += 1;
    }
}

/// The effects as one line: name, place, numbers with units.
#[must_use]
pub fn describe(effects: &[Applied], model: &Model) -> String {
    let one = |e: &Applied| {
        // Links have metres and newtons where joints have theirs.
        let kind = if e.site == Site::Joint { model.joints[e.place].kind } else { JointKind::Prismatic };
        // Zeros that need not be stated are left out.
        let stated = e.entry.parameters.iter().zip(&e.values).filter(|(p, v)| v.abs() > 0.0 || p.default.is_none());
        let unit =
            |p: &Parameter| if matches!(p.unit, Unit::One | Unit::Share) { String::new() } else { format!(" {}", p.unit.text(kind)) };
        let numbers: Vec<String> = stated.map(|(p, v)| format!("{} = {}{}", p.name, rounded(*v), unit(p))).collect();
        format!("{} at {}: {}", e.entry.name, e.place_names(model).join(" and "), numbers.join(", "))
    };
    if effects.is_empty() { "nothing".to_string() } else { effects.iter().map(one).collect::<Vec<_>>().join("; ") }
}

/// Four significant digits, without an exponent where a person would not write one.
fn rounded(x: f64) -> String {
    let size = x.abs();
    if size >= 1000.0 {
        format!("{x:.0}")
    } else if size >= 0.001 {
        let digits = if size >= 100.0 {
            1
        } else if size >= 10.0 {
            2
        } else if size >= 1.0 {
            3
        } else {
            4
        };
        format!("{x:.digits$}")
    } else if size > 0.0 {
        format!("{x:.3e}")
    } else {
        "0".to_string()
    }
}

/// Everything a draw depends on.
pub(crate) struct Dice<'d> {
    pub(crate) robot: &'d Robot,
    pub(crate) motion: &'d NominalMotion,
    pub(crate) random: &'d mut Random,
    pub(crate) share: f64,
    pub(crate) entry: &'static Entry,
}

impl Dice<'_> {
    /// The entry at a place, as its place kind counts them.
    pub(crate) fn applied(&self, place: usize, values: Vec<f64>) -> Result<Applied, SimError> {
        let place = Applied::at(self.entry, place, Vec::new()).place_name(&self.robot.model).to_string();
        self.applied_at(&place, &values)
    }

    /// The entry at a place by name; trailing parameters that are not given have their defaults.
    pub(crate) fn applied_at(&self, place: &str, values: &[f64]) -> Result<Applied, SimError> {
        let names = self.entry.parameters.iter().map(|p| p.name.to_string());
        let stated: Vec<(String, f64)> = names.zip(values.iter().copied()).collect();
        // Through the same door as a user's file, so that every bound is checked.
        Ok(Applied::try_new(&self.robot.model, self.entry.name, place, &stated)?)
    }

    fn at_a_drive(&mut self) -> Result<Applied, SimError> {
        if matches!(self.entry.law, Law::PositionOffset) {
            return self.at_an_encoder();
        }
        let k = self.random.index(self.robot.model.n_act());
        let j = self.robot.model.actuators[k];
        let size = self.share * self.motion.effort_rms(k);
        let values = match self.entry.name {
            "torque_constant" => vec![1.0 + self.random.sign() * self.random.uniform(0.08, 0.16)],
            "time_delay" => vec![self.random.uniform(6e-3, 12e-3)],
            "actuator_lag" => vec![self.random.uniform(8e-3, 16e-3)],
            "friction_thermal" => return self.at_a_warming_drive(),
            _ => match self.values_of_a_drive(k, j, size) {
                Some(values) => values,
                None => self.effort_values(k, j, size)?,
            },
        };
        self.applied(j, values)
    }

    /// Parameters of a joint effort whose rms along the motion is about `size` `[N | N·m]`.
    fn effort_values(&mut self, k: usize, j: usize, size: f64) -> Result<Vec<f64>, SimError> {
        let motion = self.motion;
        let over = |x: f64| size / x.max(f64::MIN_POSITIVE);
        let of = |f: fn(&crate::reference::Sample) -> &Vec<f64>| rms(motion.samples.iter().map(|s| f(s)[k]));
        let (speed, acceleration) = (of(|s| &s.v), of(|s| &s.a));
        let (low, high) = self.range(k);
        let (middle, span) = (0.5 * (low + high), (high - low).max(f64::MIN_POSITIVE));
        let random = &mut *self.random;
        Ok(match self.entry.name {
            "friction_coulomb" => vec![size],
            "friction_viscous" => vec![over(speed)],
            "torque_offset" => vec![random.sign() * size],
            "friction_stribeck" => {
                // Most of it must be the peak, and the peak must be passed slowly enough to be seen.
                vec![0.4 * size, random.uniform(2.0, 3.0) * size, random.uniform(0.15, 0.25) * speed]
            }
            "friction_asymmetric" => {
                let (more, less) = (1.5 * size, random.uniform(0.2, 0.5) * size);
                if random.sign() > 0.0 { vec![more, less, 0.0, 0.0] } else { vec![less, more, 0.0, 0.0] }
            }
            "friction_load" => vec![over(rms(motion.rigid[k].iter().copied())).min(0.4)],
            // Gearing with half to twice the inertia that is already there: more would be another machine.
            "rotor_inertia" => {
                let present = self.robot.model.joints[j].armature;
                let wanted = over(acceleration);
                vec![if present > 0.0 { wanted.clamp(0.5 * present, 2.0 * present) } else { wanted }]
            }
            "spring" => {
                let rest = middle + 0.2 * span * random.uniform(-1.0, 1.0);
                vec![over(rms(motion.samples.iter().map(|s| s.q[k] - rest))), rest, 0.0]
            }
            "torque_ripple" => {
                let (cycles, phase) = (random.uniform(3.0, 7.0), random.uniform(-3.0, 3.0));
                vec![0.7 * size * core::f64::consts::SQRT_2, cycles * 2.0 * core::f64::consts::PI / span, phase]
            }
            name => return Err(SimError::NoPlace { effect: name, problem: "no rule for its size" }),
        })
    }

    /// An offset as visible as asked, but no more than 5 % of the travel used and no less than 1 %, at a drive that some effort depends
    /// on (the first axis of an upright arm has no zero that matters).
    fn at_an_encoder(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        let mut candidates = Vec::new();
        for k in 0..model.n_act() {
            let (low, high) = self.range(k);
            let one_percent = 0.01 * (high - low);
            candidates.push((k, one_percent, self.change_by_offset(k, one_percent)?));
        }
        let most = candidates.iter().map(|c| c.2).fold(0.0, f64::max);
        candidates.retain(|c| c.2 >= 0.3 * most);
        let (k, one_percent, change) = candidates[self.random.index(candidates.len())];
        let percents = (self.share / change.max(f64::MIN_POSITIVE)).clamp(1.0, 5.0);
        let offset = self.random.sign() * one_percent * percents;
        self.applied(model.actuators[k], vec![offset])
    }

    /// Lowest and highest position of drive `k` along the motion `[m | rad]`.
    pub(crate) fn range(&self, k: usize) -> (f64, f64) {
        let positions = self.motion.samples.iter().map(|s| s.q[k]);
        positions.fold((f64::MAX, f64::MIN), |(low, high), q| (low.min(q), high.max(q)))
    }

    fn change_by_offset(&self, k: usize, offset: f64) -> Result<f64, SimError> {
        let mut offsets = vec![0.0; self.robot.model.n_act()];
        offsets[k] = offset;
        let shifted = NominalMotion::along(self.robot, self.motion.samples.clone(), &offsets)?;
        Ok(self.motion.change(&shifted))
    }

    /// Change of effort by an effect, as far as the nominal motion shows it. A scale, a lag or a delay counts as visible; what takes states or
    /// time to be felt (play, give, memory, warmth, a limb) does not: nothing here says that it is.
    fn change_of(&self, applied: &Applied) -> Result<f64, SimError> {
        match applied.entry.law {
            _ if applied.entry.name == "friction_thermal" => Ok(0.0),
            Law::PositionOffset => {
                let drive = self.robot.model.actuators.iter().position(|&j| j == applied.place);
                drive.map_or(Ok(0.0), |k| self.change_by_offset(k, applied.values[0]))
            }
            Law::JointEffort(_) | Law::Inertia(_) | Law::Gravity(_) | Law::Geometry(_) => self.change_of_effort(applied.clone()),
            Law::EffortScale | Law::EffortLag | Law::EffortDelay => Ok(f64::INFINITY),
            _ => Ok(0.0),
        }
    }

    fn at_a_passive_joint(&mut self) -> Result<Applied, SimError> {
        let (model, motion) = (&self.robot.model, self.motion);
        let speed = |j: usize| rms(motion.tree_velocity[j].iter().copied());
        let passive = model.passive();
        let fastest = passive.iter().map(|&j| speed(j)).fold(0.0, f64::max);
        // Friction in a joint that hardly moves could not be seen in any drive.
        let moving: Vec<usize> = passive.into_iter().filter(|&j| speed(j) > 0.2 * fastest).collect();
        let Some(&j) = moving.get(self.random.index(moving.len())) else {
            return Err(SimError::NoPlace { effect: self.entry.name, problem: "no passive joint moves" });
        };
        // Effort at the passive joint that changes the drive which feels it most by the wanted share.
        let felt = (0..model.n_act())
            .map(|k| rms(motion.reduction[j][k].iter().copied()) / motion.effort_rms(k).max(f64::MIN_POSITIVE))
            .fold(f64::MIN_POSITIVE, f64::max);
        let effort = self.share / felt;
        self.applied(j, vec![0.7 * effort, 0.3 * effort / speed(j).max(f64::MIN_POSITIVE)])
    }

    fn on_a_link(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        if self.entry.name == "payload" {
            let link = last_link(model).ok_or(SimError::NoPlace { effect: self.entry.name, problem: "the robot has no link with mass" })?;
            let (com, _) = model.links[link].parameters.centre_of_mass();
            let own = model.links[link].parameters.mass;
            let near: [f64; 3] = core::array::from_fn(|axis| com[axis] + self.random.uniform(-0.02, 0.02));
            let values = |mass: f64| vec![mass, near[0], near[1], near[2], 0.0];
            let per_own_mass = self.change_by(link, values(own))?;
            let mass = own * (self.share / per_own_mass).clamp(0.1, 1.5);
            return self.applied(link, values(mass));
        }
        let mut visible = Vec::new();
        for link in model.massive_links() {
            let change = self.change_by(link, scaled(model, link, 2.0))?;
            visible.push((link, change));
        }
        let most = visible.iter().map(|(_, c)| *c).fold(0.0, f64::max);
        // A link whose inertia no drive feels (the first of a chain, say) cannot be wrong in any way that matters.
        visible.retain(|(_, change)| *change > 0.3 * most);
        let Some(&(link, change)) = visible.get(self.random.index(visible.len())) else {
            return Err(SimError::NoPlace { effect: self.entry.name, problem: "the robot has no link with mass" });
        };
        let factor = 1.0 + (self.share / change.max(f64::MIN_POSITIVE)).clamp(0.1, 0.6);
        self.applied(link, scaled(model, link, factor))
    }

    fn at_the_mounting(&mut self) -> Result<Applied, SimError> {
        let model = &self.robot.model;
        let root = model.link_index(&model.root).ok_or(SimError::NoPlace { effect: self.entry.name, problem: "no root link" })?;
        let direction = self.random.uniform(-core::f64::consts::PI, core::f64::consts::PI);
        let (s, c) = pkm_dyn::math::sin_cos(direction);
        let per_degree = self.change_by(root, vec![s.to_radians(), c.to_radians()])?;
        let angle = (self.share / per_degree).clamp(1.5, 6.0).to_radians();
        self.applied(root, vec![angle * s, angle * c])
    }

    /// Change of effort by the entry with those values, as [`NominalMotion::change`] has it; never zero.
    fn change_by(&self, place: usize, values: Vec<f64>) -> Result<f64, SimError> {
        self.change_of_effort(Applied::at(self.entry, place, values))
    }

    /// Change of effort by `effect` along the nominal motion; never zero.
    pub(crate) fn change_of_effort(&self, effect: Applied) -> Result<f64, SimError> {
        let mut changed = Robot::new(self.robot.model.clone(), vec![effect]);
        changed.effects.extend(self.robot.effects.iter().cloned());
        let offsets = vec![0.0; self.robot.model.n_act()];
        let motion = NominalMotion::along(&changed, self.motion.samples.clone(), &offsets)?;
        Ok(self.motion.change(&motion).max(f64::MIN_POSITIVE))
    }
}

/// All ten parameters of a link times `factor`: as feasible as they were.
fn scaled(model: &Model, link: usize, factor: f64) -> Vec<f64> {
    model.links[link].parameters.to_vector().iter().map(|p| p * factor).collect()
}

/// The link with mass that is farthest from the root: platform or flange.
pub(crate) fn last_link(model: &Model) -> Option<usize> {
    let depth = |link: usize| {
        let (mut at, mut depth) = (model.links[link].body, 0_usize);
        while let Some(body) = at {
            (at, depth) = (model.joints[body].parent, depth + 1);
        }
        depth
    };
    // The first of several equally far ones.
    model.massive_links().into_iter().rev().max_by_key(|&l| depth(l))
}
