//! Columns of the effects to be told apart: the effort that each makes at the drives, at one state.

use pkm_dyn::effects::{Applied, JointState, Law, Robot};
use pkm_dyn::{Data, Model};

use super::ExciteError;
use super::basis::dot;
use crate::columns::{Columns, Quantity};

/// Where an effect's effort comes from.
#[derive(Clone)]
enum Acting {
    /// A law at a joint's coordinate, or at the sum of two.
    Joint { law: fn(&[f64], &JointState) -> f64, joint: usize, other: Option<usize> },
    /// Other mass properties of a link: what they add to the nominal parameters, by column.
    Bodies(Vec<f64>),
    /// Another gravity.
    Gravity(Box<Model>),
    /// A share of a drive's own effort.
    Share { drive: usize, share: f64 },
}

/// An effect as a column.
#[derive(Clone)]
pub(super) struct Effect {
    values: Vec<f64>,
    acting: Acting,
}

/// What the robot does at the state that a column is wanted for.
pub(super) struct Seen<'s> {
    pub(super) robot: &'s Robot,
    pub(super) columns: &'s Columns,
    /// All columns of each drive, and their nominal values.
    pub(super) full: &'s [Vec<f64>],
    pub(super) theta: &'s [f64],
    /// Rigid effort and whole effort of each drive `[N | N·m]`.
    pub(super) load: &'s [f64],
    pub(super) effort: &'s [f64],
    /// Direction of every tree joint.
    pub(super) signs: &'s [f64],
}

impl Effect {
    /// The effect on `robot`, whose parameters are `columns`.
    ///
    /// # Errors
    /// An effect whose effort is no column of one state: it has a memory, a delay or coordinates of its own.
    pub(super) fn try_new(robot: &Robot, columns: &Columns, applied: &Applied) -> Result<Self, ExciteError> {
        let refused = |problem| ExciteError::Effect { effect: applied.entry.name.to_string(), problem };
        let model = &robot.model;
        let acting = match applied.entry.law {
            Law::JointEffort(law) => Acting::Joint { law, joint: applied.place, other: None },
            Law::PairEffort(law) => Acting::Joint { law, joint: applied.place, other: applied.other },
            Law::Inertia(change) => {
                let mut other = robot.clone();
                change(&mut other.model, applied.place, &applied.values);
                let there = Columns::new(&other);
                if there.links != columns.links {
                    return Err(refused("is at a link without mass, which has no column of its own here"));
                }
                let delta = |(new, old): (f64, f64)| new - old;
                Acting::Bodies(there.nominal().into_iter().zip(columns.nominal()).map(delta).collect())
            }
            Law::Gravity(change) => {
                let mut other = model.clone();
                change(&mut other, applied.place, &applied.values);
                Acting::Gravity(Box::new(other))
            }
            Law::EffortScale => {
                let drive = model.actuators.iter().position(|&j| j == applied.place);
                let drive = drive.ok_or_else(|| refused("is not at a drive"))?;
                Acting::Share { drive, share: 1.0 / applied.values[0] - 1.0 }
            }
            _ => return Err(refused("has no column of its own: its effort is not that of one state")),
        };
        Ok(Self { values: applied.values.clone(), acting })
    }

    /// Efforts at all drives into `out` `[N | N·m]`; `data` holds the motion.
    pub(super) fn fill(&self, seen: &Seen<'_>, data: &mut Data, out: &mut [f64]) {
        out.fill(0.0);
        let model = &seen.robot.model;
        match &self.acting {
            Acting::Joint { law, joint, other } => {
                let state = state_of(seen, data, *joint, *other);
                let effort = law(&self.values, &state);
                for (k, out) in out.iter_mut().enumerate() {
                    let through = data.drive_reduction[(*joint, k)] + other.map_or(0.0, |o| data.drive_reduction[(o, k)]);
                    *out = through * effort;
                }
            }
            Acting::Bodies(delta) => out.iter_mut().zip(seen.full).for_each(|(out, row)| *out = dot(row, delta)),
            Acting::Gravity(tilted) => {
                // Weight is in the accelerations of the bodies, as that of a base that is accelerated the other way.
                let turned = model.gravity - tilted.gravity;
                for sign in [1.0, -1.0] {
                    let by = if sign > 0.0 { turned } else { -turned };
                    data.acceleration_w.iter_mut().for_each(|a| a.linear += by);
                    let mut add = |k: usize, c: usize, x: f64| out[k] += sign * x * seen.theta[c];
                    seen.columns.fill(model, data, seen.signs, &mut add);
                }
            }
            Acting::Share { drive, share } => {
                // A drive's own row is the first of all that it shares with others.
                let joint = model.actuators[*drive];
                out.iter_mut().enumerate().for_each(|(k, out)| *out = share * data.drive_reduction[(joint, k)] * seen.effort[*drive]);
            }
        }
    }
}

/// The state of a joint, or the sum of two joints' states.
fn state_of(seen: &Seen<'_>, data: &Data, joint: usize, other: Option<usize>) -> JointState {
    let model = &seen.robot.model;
    let load = model.actuators.iter().position(|&a| a == joint).map_or(0.0, |k| seen.load[k]);
    let (viscous, coulomb) = (model.joints[joint].viscous, model.joints[joint].coulomb);
    let mut state = JointState { load, viscous, coulomb, ..JointState::default() };
    let sum = |x: &[f64]| x[joint] + other.map_or(0.0, |o| x[o]);
    (state.q, state.v, state.a) = (sum(&data.q), sum(&data.v), sum(&data.a));
    // The direction of a sum is not the sum of directions.
    state.sign = if other.is_some() { pkm_dyn::math::sign(state.v) } else { seen.signs[joint] };
    state
}

/// Whether a column is that of an effect, so that it is no base parameter beside it.
pub(super) fn is_of(columns: &Columns, column: usize, e: &Applied) -> bool {
    match (e.entry.name, columns.list[column].quantity) {
        ("friction_coulomb", Quantity::Coulomb { joint })
        | ("friction_viscous", Quantity::Viscous { joint })
        | ("friction_passive", Quantity::Coulomb { joint } | Quantity::Viscous { joint })
        | ("torque_offset", Quantity::Offset { joint })
        | ("rotor_inertia", Quantity::Rotor { joint })
        | ("spring", Quantity::Stiffness { joint }) => joint == e.place,
        // Sine and cosine of another order are another ripple.
        ("torque_ripple", Quantity::Wave { joint, .. }) => joint == e.place && (columns.stated(column) - e.values[1]).abs() < 1e-9,
        ("payload" | "inertia_error", Quantity::Inertial { link, .. }) => link == e.place,
        (name, Quantity::Law { joint, law, .. }) => joint == e.place && columns.laws[law].entry.name == name,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::inverse_dynamics::inverse_dynamics;
    use pkm_dyn::loops::{assemble, walk_to};

    fn robot() -> Robot {
        let found = pkm_robots::find("five_bar").unwrap();
        pkm_dyn::urdf::parse(found.toml, found.urdf, [found.toml_name, found.urdf_name]).unwrap().robot
    }

    fn applied(robot: &Robot, name: &str, place: &str, values: &[(&str, f64)]) -> Applied {
        let values: Vec<(String, f64)> = values.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
        Applied::try_new(&robot.model, name, place, &values).unwrap()
    }

    /// Column of an effect at one state, and the whole rigid effort there.
    fn column(robot: &Robot, e: &Applied, [q, v, a]: [&[f64]; 3]) -> [Vec<f64>; 2] {
        let (columns, mut data) = (Columns::new(robot), Data::new(&robot.model));
        assert!(assemble(&robot.model, &mut data).is_closed && walk_to(&robot.model, &mut data, q).is_closed);
        assert!(inverse_dynamics(&robot.model, &mut data, q, v, a).is_closed);
        let load = data.tau_act.clone();
        let signs: Vec<f64> = data.v.iter().map(|v| pkm_dyn::math::sign(*v)).collect();
        let mut full = vec![vec![0.0; columns.len()]; 2];
        columns.fill(&robot.model, &mut data, &signs, &mut |k, c, x| full[k][c] = x);
        let theta = columns.nominal();
        let seen = Seen { robot, columns: &columns, full: &full, theta: &theta, load: &load, effort: &load, signs: &signs };
        let mut out = vec![0.0; 2];
        Effect::try_new(robot, &columns, e).unwrap().fill(&seen, &mut data, &mut out);
        [out, load]
    }

    #[test]
    fn columns_are_the_differences_of_inverse_dynamics() {
        let plain = robot();
        let home = pkm_dyn::loops::mid_pose(&plain.model);
        let q: Vec<f64> = home.iter().map(|q| q + 0.05).collect();
        let motion = [&q[..], &[0.7, -0.4], &[2.0, 3.0]];
        let link = plain.model.links[plain.model.massive_links()[1]].name.clone();
        let root = plain.model.root.clone();
        let effects = [
            applied(&plain, "payload", &link, &[("mass", 0.8), ("x", 0.1)]),
            applied(&plain, "gravity_tilt", &root, &[("roll", 0.2), ("pitch", 0.1)]),
        ];
        for e in &effects {
            let mut other = plain.clone();
            match e.entry.law {
                Law::Inertia(change) | Law::Gravity(change) => change(&mut other.model, e.place, &e.values),
                _ => unreachable!("both change the model"),
            }
            let [found, before] = column(&plain, e, motion);
            let [_, after] = column(&other, e, motion);
            assert!(before.iter().zip(&after).any(|(a, b)| (a - b).abs() > 1e-3), "{}: {before:?} {after:?}", e.entry.name);
            for k in 0..2 {
                assert!((after[k] - before[k] - found[k]).abs() < 1e-9 * (1.0 + after[k].abs()), "{}: {found:?}", e.entry.name);
            }
        }
        let drive = plain.model.joints[plain.model.actuators[1]].name.clone();
        // Recorded = acting / scale.
        let [share, load] = column(&plain, &applied(&plain, "torque_constant", &drive, &[("scale", 0.8)]), motion);
        assert!(share[0].abs() < 1e-15 && (share[1] - 0.25 * load[1]).abs() < 1e-12 * load[1].abs(), "{share:?} {load:?}");
    }

    #[test]
    fn what_depends_on_the_past_has_no_column() {
        let plain = robot();
        let drive = plain.model.joints[plain.model.actuators[0]].name.clone();
        let e = applied(&plain, "time_delay", &drive, &[("delay", 0.01)]);
        let said = Effect::try_new(&plain, &Columns::new(&plain), &e).err().unwrap().to_string();
        assert!(said.contains("time_delay") && said.contains("no column"), "{said}");
    }

    #[test]
    fn columns_of_a_stated_ripple_and_law_are_theirs_and_no_others() {
        let mut robot = robot();
        let drive = robot.model.joints[robot.model.actuators[0]].name.clone();
        let ripple = applied(&robot, "torque_ripple", &drive, &[("amplitude", 0.2), ("order", 4.0)]);
        let other = applied(&robot, "torque_ripple", &drive, &[("amplitude", 0.2), ("order", 6.0)]);
        let law = applied(&robot, "friction_asymmetric", &drive, &[("coulomb_pos", 0.2), ("coulomb_neg", 0.1)]);
        robot.effects = vec![ripple.clone(), law.clone()];
        let columns = Columns::new(&robot);
        let of =
            |e: &Applied| (0..columns.len()).filter(|&c| is_of(&columns, c, e)).map(|c| columns.list[c].name.clone()).collect::<Vec<_>>();
        assert_eq!(of(&ripple), [format!("{drive}.sine_4"), format!("{drive}.cosine_4")]);
        assert!(of(&other).is_empty());
        assert!(of(&law).len() >= 2 && of(&law).iter().all(|n| n.contains("friction_asymmetric")), "{:?}", of(&law));
    }
}
