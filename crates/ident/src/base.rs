//! Base parameters: how many combinations of the inertial parameters the drives' efforts depend on.
//!
//! The number is the rank of the actuated regressor stacked over many states that the robot can take. Columns are brought to length one
//! first, so that kilograms and kilogram square metres count alike, and the rank is read off the singular values of the stack itself
//! (not of its normal equations, whose values are the squares and would drown in rounding).

use faer::Mat;
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, friction_regressor};
use pkm_dyn::loops::{assemble, mid_pose, solve_positions, walk_to};
use pkm_dyn::model::JointKind;
use pkm_dyn::parameters::N_INERTIAL;
use pkm_dyn::{Data, Model};

/// Singular values below this share of the largest count as zero: loops close to 1e-12, and no base parameter of a robot of usual
/// proportions comes below 1e-6.
pub const RANK_TOLERANCE: f64 = 1e-9;

/// A column shorter than this share of the longest one with the same unit does not act at all: it is rounding.
const ACTS: f64 = 1e-10;

/// Share of the stated travel that states are drawn from: joints have their stops at the ends.
const TRAVEL_SHARE: f64 = 0.9;

/// Travel to each side where none is stated `[m]` or `[rad]`.
const UNSTATED: [f64; 2] = [0.05, 0.5];

/// Largest speed `[m/s | rad/s]` and acceleration `[m/s² | rad/s²]` drawn: both terms are then of the size of weight.
pub(crate) const SPEED: f64 = 2.0;
pub(crate) const ACCELERATION: f64 = 10.0;

/// A pose counts as singular when the loop closure's pivots fall below this share of those at the start.
const PIVOT_SHARE: f64 = 0.05;

/// States refused in a row before the range they are drawn from shrinks by [`SHRINK`].
const PATIENCE: usize = 10;
const SHRINK: f64 = 0.8;

/// Below this share of the travel the robot has no neighbourhood to move in.
const SMALLEST: f64 = 1e-3;

/// Which states the regressor is stacked over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum States {
    /// Positions, velocities and accelerations.
    Moving,
    /// Positions alone: what weight shows.
    AtRest,
}

/// Numbers of parameters, with what they were read from.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameters {
    /// Ten per link with mass.
    pub standard: usize,
    /// Parameters of moving bodies that some drive feels at all.
    pub acting: usize,
    /// Independent combinations of inertial parameters: the rank.
    pub inertial: usize,
    /// The same with one rotor inertia per drive.
    pub with_rotors: usize,
    /// The same again with viscous and Coulomb friction of every joint, passive ones included: they reach the drives through the loops.
    pub with_friction: usize,
    /// States the regressor was stacked over.
    pub states: usize,
    /// Share of the travel that these states span.
    pub travel_share: f64,
    /// Last singular value that counts over the first that does not; infinite when none is left over.
    pub gap: f64,
    /// Smallest singular value that counts, over the largest: how hard the weakest combination is to see.
    pub weakest: f64,
}

/// Why the numbers cannot be given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaseError {
    /// The loops do not close at the start.
    #[error("loops do not close in the stated assembly: gap {gap:.3e} m or rad in row {row} (limit 1e-9)")]
    Open {
        /// Largest gap `[m | rad]`.
        gap: f64,
        /// Constraint row of the largest gap.
        row: usize,
    },
    /// No pose beside the start can be reached.
    #[error("no pose within {share:.1e} of the travel around the start can be reached: a singular assembly or contradicting limits")]
    NoRoom {
        /// Share of the travel that was tried last.
        share: f64,
    },
    /// A regressor that is not a number.
    #[error("the regressor is not finite: the robot has no dynamics to speak of")]
    NotFinite,
}

/// Counts base parameters of `model` over `states` random states.
///
/// `uniform` gives independent numbers in [0, 1); the same numbers give the same answer. States lie around the middle of travel inside
/// the limits (the assembly, where the middle cannot be reached), on the branch of the stated assembly and away from singularities.
///
/// # Errors
/// A robot whose loops do not close, or that cannot move from its assembly.
pub fn base_parameters(model: &Model, kind: States, states: usize, uniform: &mut dyn FnMut() -> f64) -> Result<BaseParameters, BaseError> {
    let bodies = massive_bodies(model);
    let (n_act, nv, n_inertial) = (model.n_act(), model.nv(), N_INERTIAL * bodies.len());
    let mut data = Data::new(model);
    let n_ind = data.n_ind();
    let mut stack = Mat::<f64>::zeros(states * n_ind, n_inertial + n_act + 2 * nv);
    let mut range = Range::try_new(model)?;
    for s in 0..states {
        let q = range.draw(model, &mut data, uniform)?;
        let mut about = |size: f64| match kind {
            States::Moving => (0..n_act).map(|_| size * (2.0 * uniform() - 1.0)).collect(),
            States::AtRest => vec![0.0; n_act],
        };
        let (v, a) = (about(SPEED), about(ACCELERATION));
        let _closed_by_draw = closed_loop_motion(model, &mut data, &q, &v, &a);
        let w = actuated_regressor(model, &mut data);
        for k in 0..n_ind {
            for (b, &body) in bodies.iter().enumerate() {
                for p in 0..N_INERTIAL {
                    stack[(s * n_ind + k, N_INERTIAL * b + p)] = w[(k, N_INERTIAL * body + p)];
                }
            }
        }
        let f = friction_regressor(model, &mut data);
        for k in 0..n_ind {
            for (drive, &j) in model.actuators.iter().enumerate() {
                stack[(s * n_ind + k, n_inertial + drive)] = f[(k, j)];
            }
            for column in 0..2 * nv {
                stack[(s * n_ind + k, n_inertial + n_act + column)] = f[(k, nv + column)];
            }
        }
    }
    let inertial = rank(&stack, n_inertial)?;
    let rotors = rank(&stack, n_inertial + n_act)?;
    let all = rank(&stack, n_inertial + n_act + 2 * nv)?;
    Ok(BaseParameters {
        standard: N_INERTIAL * model.massive_links().len(),
        acting: inertial.acting,
        inertial: inertial.rank,
        with_rotors: rotors.rank,
        with_friction: all.rank,
        states,
        travel_share: range.share,
        gap: inertial.gap,
        weakest: inertial.weakest,
    })
}

fn massive_bodies(model: &Model) -> Vec<usize> {
    let mut bodies: Vec<usize> = model.massive_links().iter().filter_map(|&l| model.links[l].body).collect();
    bodies.sort_unstable();
    bodies.dedup();
    bodies
}

struct Rank {
    acting: usize,
    rank: usize,
    gap: f64,
    weakest: f64,
}

/// Rank of the first `columns` columns of `stack`.
fn rank(stack: &Mat<f64>, columns: usize) -> Result<Rank, BaseError> {
    let length = |j: usize| (0..stack.nrows()).map(|i| stack[(i, j)] * stack[(i, j)]).sum::<f64>().sqrt();
    let lengths: Vec<f64> = (0..columns).map(length).collect();
    if lengths.iter().any(|l| !l.is_finite()) {
        return Err(BaseError::NotFinite);
    }
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let acting: Vec<usize> = (0..columns).filter(|&j| lengths[j] > ACTS * longest).collect();
    if acting.is_empty() {
        return Ok(Rank { acting: 0, rank: 0, gap: f64::INFINITY, weakest: 0.0 });
    }
    let scaled = Mat::from_fn(stack.nrows(), acting.len(), |i, j| stack[(i, acting[j])] / lengths[acting[j]]);
    let values = scaled.singular_values().map_err(|_| BaseError::NotFinite)?;
    let largest = values.first().copied().unwrap_or(0.0);
    let rank = values.iter().filter(|&&s| s > RANK_TOLERANCE * largest).count();
    let weakest = values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0);
    let gap = values.get(rank).map_or(f64::INFINITY, |next| weakest / next.max(f64::MIN_POSITIVE));
    Ok(Rank { acting: acting.len(), rank, gap, weakest: weakest / largest })
}

/// Where states are drawn from: around a closed pose, inside the limits.
pub(crate) struct Range {
    /// Closed tree coordinates at the centre.
    start: Vec<f64>,
    centre: Vec<f64>,
    /// Travel from the centre to each side.
    half: Vec<[f64; 2]>,
    pivot: f64,
    share: f64,
}

impl Range {
    pub(crate) fn try_new(model: &Model) -> Result<Self, BaseError> {
        let mut data = Data::new(model);
        let home = assemble(model, &mut data);
        if !home.is_closed {
            return Err(BaseError::Open { gap: home.gap, row: home.row });
        }
        let at_home = data.q.clone();
        let mut centre = mid_pose(model);
        let mut closure = walk_to(model, &mut data, &centre);
        if !closure.is_closed {
            closure = home;
            data.q.copy_from_slice(&at_home);
            centre = model.actuators.iter().map(|&j| at_home[j]).collect();
        }
        let side = |(&j, &c): (&usize, &f64)| {
            let joint = &model.joints[j];
            let unstated = if joint.kind == JointKind::Prismatic { UNSTATED[0] } else { UNSTATED[1] };
            [c - joint.limits.lower, joint.limits.upper - c]
                .map(|room| if room.is_finite() { TRAVEL_SHARE * room.max(0.0) } else { unstated })
        };
        let half = model.actuators.iter().zip(&centre).map(side).collect();
        Ok(Self { start: data.q, centre, half, pivot: closure.pivot_ratio, share: 1.0 })
    }

    /// Drive positions of a reachable state; `data.q` holds the closed tree coordinates.
    pub(crate) fn draw(&mut self, model: &Model, data: &mut Data, uniform: &mut dyn FnMut() -> f64) -> Result<Vec<f64>, BaseError> {
        let mut refused = 0;
        loop {
            let mut place = |(c, half): (&f64, &[f64; 2])| {
                let u = 2.0 * uniform() - 1.0;
                c + self.share * u * if u < 0.0 { half[0] } else { half[1] }
            };
            let q: Vec<f64> = self.centre.iter().zip(&self.half).map(&mut place).collect();
            data.q.copy_from_slice(&self.start);
            let closure = walk_to(model, data, &q);
            if closure.is_closed && closure.pivot_ratio >= PIVOT_SHARE * self.pivot && solve_positions(model, data, &q).is_closed {
                return Ok(q);
            }
            refused += 1;
            if refused % PATIENCE == 0 {
                self.share *= SHRINK;
            }
            if self.share < SMALLEST {
                return Err(BaseError::NoRoom { share: self.share });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One hinge at the root with a body of general mass properties.
    fn pendulum(axis: &str) -> Model {
        let urdf = format!(
            r#"<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
            <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="0.01" izz="0.15"/></inertial></link>
            <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="{axis}"/></joint></robot>"#
        );
        let toml = "name = \"p\"\nurdf = \"p.urdf\"\n[[actuator]]\njoint = \"j\"\n";
        pkm_dyn::urdf::parse(toml, &urdf, ["p.toml", "p.urdf"]).unwrap().bare
    }

    /// Numbers that fill [0, 1) evenly: multiples of the golden ratio.
    fn even() -> impl FnMut() -> f64 {
        let mut x = 0.1;
        move || {
            x = (x + 0.618_033_988_749_895) % 1.0;
            x
        }
    }

    #[test]
    fn a_hinge_shows_its_inertia_and_what_gravity_reaches() {
        // About a level axis: two first moments and one inertia; about an upright one the inertia alone.
        let level = base_parameters(&pendulum("1 0 0"), States::Moving, 40, &mut even()).unwrap();
        assert_eq!((level.standard, level.inertial, level.with_rotors), (10, 3, 3), "{level:?}");
        let upright = base_parameters(&pendulum("0 0 1"), States::Moving, 40, &mut even()).unwrap();
        assert_eq!((upright.inertial, upright.gap > 1e6), (1, true), "{upright:?}");
        let resting = base_parameters(&pendulum("1 0 0"), States::AtRest, 40, &mut even()).unwrap();
        assert_eq!(resting.inertial, 2, "{resting:?}");
    }

    #[test]
    fn the_same_numbers_give_the_same_answer() {
        let count = || base_parameters(&pendulum("1 0 0"), States::Moving, 20, &mut even()).unwrap();
        assert_eq!(count(), count());
    }
}
