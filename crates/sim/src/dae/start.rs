//! Where a robot with added freedoms starts: loops closed, springs carrying the weight, play taken up.

use pkm_dyn::Data;
use pkm_dyn::constrained::{project, reduced_mass_matrix};
use pkm_dyn::effects::{JointState, Robot};
use pkm_dyn::loops::{Choice, assemble, mobility, walk_to};

use crate::dae::extension::Extension;
use crate::dae::system::{State, System};
use crate::error::SimError;
use crate::plant::check;

/// Share of the inertia at a drive that is its motor's where neither the robot's file nor the effect states a rotor.
const MOTOR_SHARE: f64 = 0.1;

/// Steps towards the rest of the springs; each leaves a share of weight's own stiffness over the spring's.
const MAX_RELAXATIONS: usize = 100;

/// Springs are at rest when no coordinate moves more than this `[m | rad]`.
const AT_REST: f64 = 1e-13;

/// Gives motors without a rotor their share of the inertia that the drives feel at the start.
pub(crate) fn give_rotors(robot: &Robot, extension: &mut Extension, q_act: &[f64]) -> Result<(), SimError> {
    if extension.motors.iter().all(|m| extension.model.joints[m[0]].armature > 0.0) {
        return Ok(());
    }
    let model = &robot.model;
    let mut data = Data::new(model);
    for closure in [assemble(model, &mut data), walk_to(model, &mut data, q_act)] {
        check(&closure, 0.0)?;
    }
    let mass = reduced_mass_matrix(model, &mut data).clone();
    let at_drive = |j: usize| data.independent.iter().position(|&i| i == j).map_or(0.0, |k| mass[(k, k)]);
    for [motor, load] in extension.motors.clone() {
        if extension.model.joints[motor].armature > 0.0 {
            continue;
        }
        let joint = extension.joint.iter().position(|&j| j == load).unwrap_or(load);
        let inertia = MOTOR_SHARE * robot_mass(&data.independent, joint, &at_drive);
        if inertia <= 0.0 {
            return Err(SimError::Massless { time: 0.0 });
        }
        extension.model.joints[motor].armature = inertia;
    }
    Ok(())
}

fn robot_mass(independent: &[usize], joint: usize, at_drive: &impl Fn(usize) -> f64) -> f64 {
    // A surplus drive is no coordinate of its own: as much as the lightest that is.
    let least = independent.iter().map(|&j| at_drive(j)).fold(f64::INFINITY, f64::min);
    if independent.contains(&joint) { at_drive(joint) } else { least }
}

/// Puts `system` and `state` at rest with the drives at `q_act` `[m | rad]`.
pub(crate) fn place(system: &mut System, state: &mut State, q_act: &[f64]) -> Result<(), SimError> {
    let (model, n) = (&system.model, system.n_act);
    if q_act.len() != n {
        return Err(SimError::Mobility { robot: model.name.clone(), mobility: n, drives: q_act.len() });
    }
    check(&assemble(model, &mut system.data), 0.0)?;
    let freedoms = mobility(model, &mut system.data.clone(), &system.data.q.clone());
    if freedoms == 0 {
        return Err(SimError::Mobility { robot: model.name.clone(), mobility: 0, drives: n });
    }
    if freedoms > model.n_act() {
        system.data = Data::with_choice(model, Choice::Freedoms);
        check(&assemble(model, &mut system.data), 0.0)?;
    }
    let mut wanted: Vec<f64> = q_act.to_vec();
    let added = &model.actuators[n..];
    wanted.extend(added.iter().map(|&j| behind(system, j).map_or(0.0, |drive| q_act[drive])));
    check(&walk_to(model, &mut system.data, &wanted), 0.0)?;
    state.q.copy_from_slice(&system.data.q);
    Ok(())
}

/// The drive whose motor moves joint `load` through a spring or a play.
fn behind(system: &System, load: usize) -> Option<usize> {
    let name = format!("{}.motor", system.model.joints[load].name);
    system.model.actuators[..system.n_act].iter().position(|&j| system.model.joints[j].name == name)
}

/// Moves the added freedoms to where springs carry the weight, the drives standing still.
pub(crate) fn relax(system: &mut System, state: &mut State, drives: &[f64]) -> Result<(), SimError> {
    let added: Vec<usize> = system.model.actuators[system.n_act..].to_vec();
    let stiffness = |s: &System, j: usize| {
        s.springs.iter().filter(|spring| spring.plus == j || spring.minus == Some(j)).map(|spring| spring.stiffness).sum::<f64>()
    };
    let soft: Vec<(usize, f64)> = added.iter().map(|&j| (j, stiffness(system, j))).filter(|(_, k)| *k > 0.0).collect();
    for _ in 0..MAX_RELAXATIONS {
        if soft.is_empty() {
            break;
        }
        let left = unbalanced(system, state, drives)?;
        let mut way = 0.0_f64;
        for (j, stiffness) in &soft {
            let Some(k) = system.data.independent.iter().position(|i| i == j) else { continue };
            let step = left[k] / stiffness;
            state.q[*j] += step;
            way = way.max(step.abs());
        }
        check(&project(&system.model, &mut system.data, &mut state.q, &mut state.v), 0.0)?;
        if way < AT_REST {
            break;
        }
    }
    Ok(())
}

/// Efforts at the independent coordinates that nothing balances at rest `[N | N·m]`.
pub(crate) fn unbalanced(system: &mut System, state: &mut State, drives: &[f64]) -> Result<Vec<f64>, SimError> {
    state.v.fill(0.0);
    system.bias(state).ok_or(SimError::Massless { time: 0.0 })?;
    system.undirected_efforts(state, drives);
    for r in 0..system.resisting.len() {
        let joint = system.resisting[r].joint;
        system.tau[joint] -= system.effort(r, &JointState { sign: 0.0, ..system.joint_state(r, state, 0.0, 0.0) });
    }
    let left = system.tau.iter().zip(&system.data.tau).map(|(tau, bias)| tau - bias).collect::<Vec<f64>>();
    Ok(system.data.reduction.column_iter().map(|column| column.iter().zip(&left).map(|(g, t)| g * t).sum()).collect())
}

/// Lets every load fall to the side of its play to which the weight pulls it.
pub(crate) fn take_up(system: &mut System, state: &mut State, extension: &Extension) -> Result<(), SimError> {
    if extension.motors.is_empty() {
        return Ok(());
    }
    let left = unbalanced(system, state, &[])?;
    for [motor, load] in &extension.motors {
        let Some(k) = system.data.independent.iter().position(|j| j == load) else { continue };
        for stop in extension.stops.iter().filter(|s| s.plus == *motor && s.minus == Some(*load)) {
            // The load pushed forward leads its motor: their difference is at its lower end.
            if stop.side * left[k] < 0.0 {
                state.q[*load] = state.q[*motor] - stop.limit;
            }
        }
    }
    check(&project(&system.model, &mut system.data, &mut state.q, &mut state.v), 0.0)
}
