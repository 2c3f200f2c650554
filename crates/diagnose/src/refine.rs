//! The refined robot: what the files had, with every finding in it, each effect once per place.

use pkm_dyn::Model;
use pkm_dyn::effects::{Applied, JointState, Law, Robot, Site};
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL, NAMES};

use crate::design::ColumnId;
use crate::evidence::Refined;
use crate::explain::is_of_the_effort_reading;
use crate::work::{Candidate, Work};

/// Effects whose parameters a joint has anyway; the robot file may state them either way.
const ORDINARY: [&str; 3] = ["friction_viscous", "friction_coulomb", "rotor_inertia"];

/// The model with ordinary effects of the robot file counted into its joints: what a total is a total of.
pub(crate) fn baseline(robot: &Robot) -> Model {
    let mut model = robot.model.clone();
    for e in robot.effects.iter().filter(|e| ORDINARY.contains(&e.entry.name)) {
        let joint = &mut model.joints[e.place];
        match e.entry.name {
            "friction_viscous" => joint.viscous += e.values[0],
            "friction_coulomb" => joint.coulomb += e.values[0],
            _ => joint.armature += e.values[0],
        }
    }
    model
}

/// A finding's parameters by name.
pub(crate) type Parameters = Vec<(&'static str, f64)>;

/// Puts every pick, read as `readings`, into the robot that was diagnosed, and what was fitted along by `coefficient`; `bare` is its model
/// before any effect of its file.
pub(crate) fn refine(work: &Work, bare: &Model, readings: &[Parameters], coefficient: &dyn Fn(ColumnId) -> f64) -> Refined {
    let mut out = Refined { model: bare.clone(), effects: work.robot.effects.clone() };
    out.model.gravity = work.robot.model.gravity;
    out.effects.retain(|e| !matches!(e.entry.law, Law::Gravity(_)) && e.entry.name != "inertia_error");
    for e in &work.robot.effects {
        // An inertia error of the robot file is in the model that was diagnosed; it goes into the URDF now.
        if let (Law::Inertia(apply), "inertia_error") = (e.entry.law, e.entry.name) {
            apply(&mut out.model, e.place, &e.values);
        }
    }
    if work.is_refitted {
        fit_along(work, &mut out, coefficient);
    }
    // Laws that contain others come last, so that they replace them.
    let mut order: Vec<usize> = (0..readings.len()).collect();
    order.sort_by_key(|&i| contains_friction(work.candidates[work.picks[i].candidate].effect_name()));
    for &i in order.iter().filter(|&&i| !is_of_the_effort_reading(work, i)) {
        let c = &work.candidates[work.picks[i].candidate];
        put(work, &mut out, c, &readings[i]);
    }
    for &i in &order {
        make_room(work, &mut out, i);
    }
    keep_damping_nominal(work, &mut out);
    out
}

/// Inertias, frictions and offsets that were fitted beside the picks. A link that would be no body comes as near to its fit as a body can.
fn fit_along(work: &Work, out: &mut Refined, coefficient: &dyn Fn(ColumnId) -> f64) {
    let standard = &work.standard;
    for (k, &j) in work.robot.model.actuators.iter().enumerate() {
        let joint = &mut out.model.joints[j];
        joint.coulomb = (joint.coulomb + coefficient(standard.coulomb[work.softness][k])).max(0.0);
        joint.viscous = (joint.viscous + coefficient(standard.viscous[k])).max(0.0);
        if let Some(entry) = pkm_dyn::effects::find("torque_offset") {
            let values = vec![coefficient(standard.offset[k])];
            let mut offset = Applied { entry, place: j, site: Site::Joint, other: None, values };
            combine(out, &mut offset);
            out.effects.push(offset);
        }
    }
    for (l, ids) in work.robot.model.massive_links().into_iter().zip(standard.rigid.chunks_exact(N_INERTIAL)) {
        let old = out.model.links[l].parameters.to_vector();
        let moved = |share: f64| {
            let mut theta = old;
            theta.iter_mut().zip(ids).for_each(|(t, &id)| *t += share * coefficient(id));
            InertialParameters::from_vector(&theta)
        };
        let shares = (0..=16).map(|i| 1.0 - f64::from(i) / 16.0);
        if let Some(body) = shares.map(moved).find(|b| b.mass > 0.0 && b.is_feasible(0.0)) {
            out.model.set_link_parameters(l, body);
        }
    }
}

fn contains_friction(effect: &str) -> u8 {
    match effect {
        "friction_stribeck" => 1,
        "friction_asymmetric" => 2,
        _ => 0,
    }
}

fn put(work: &Work, out: &mut Refined, c: &Candidate, reading: &Parameters) {
    let (entry, place) = (c.effect.entry(), c.place);
    let value = |name: &str| reading.iter().find(|(n, _)| *n == name).map(|(_, v)| *v);
    match entry.name {
        "inertia_error" => change_link(work, &mut out.model, place, reading),
        "gravity_tilt" => {
            if let Law::Gravity(apply) = entry.law {
                apply(&mut out.model, place, &[value("roll").unwrap_or(0.0), value("pitch").unwrap_or(0.0)]);
            }
        }
        "rotor_inertia" => {
            out.effects.retain(|e| !(e.entry.name == entry.name && e.place == place));
            out.model.joints[place].armature = value("inertia").unwrap_or(0.0);
        }
        _ => {
            if c.site == Site::Joint && c.other.is_none() {
                clear(out, entry.name, place);
            }
            let values = entry.parameters.iter().map(|p| value(p.name).or(p.default).unwrap_or(0.0)).collect();
            let mut applied = Applied { entry, place, site: c.site, other: c.other, values };
            combine(out, &mut applied);
            out.effects.push(applied);
        }
    }
}

/// Takes away what the new law at the joint replaces.
fn clear(out: &mut Refined, effect: &str, place: usize) {
    let joint = &mut out.model.joints[place];
    let (dry, damping): (bool, bool) = match effect {
        "friction_coulomb" | "friction_stribeck" => (true, false),
        "friction_viscous" => (false, true),
        "friction_asymmetric" | "friction_passive" => (true, true),
        _ => (false, false),
    };
    if dry {
        joint.coulomb = 0.0;
    }
    if damping {
        joint.viscous = 0.0;
    }
    out.effects.retain(|e| {
        let is_same = e.entry.name == effect && replaces(effect);
        let is_part = (dry && e.entry.name == "friction_coulomb") || (damping && e.entry.name == "friction_viscous");
        !e.is_at_joint(place) || !(is_same || is_part)
    });
}

/// Whether a reading is a total (it replaces what the file had) or an addition.
fn replaces(effect: &str) -> bool {
    matches!(effect, "friction_coulomb" | "friction_viscous" | "friction_passive" | "actuator_lag" | "time_delay" | "friction_asymmetric")
}

/// How a reading and what the robot file had at the same place become one.
#[derive(Clone, Copy, PartialEq)]
enum Together {
    /// Both stay.
    Apart,
    /// Every number is a sum.
    Sum,
    /// Scales multiply.
    Product,
    /// Stiffnesses in series: their inverses add.
    InSeries,
    /// The smaller limit holds.
    Least,
    /// What is left of the command is multiplied.
    Remainder,
}

fn together(effect: &str) -> Together {
    match effect {
        "torque_offset" | "encoder_offset" | "friction_load" | "backlash" | "dead_zone" | "geometry_error" | "sensor_drift" => {
            Together::Sum
        }
        "torque_constant" => Together::Product,
        "joint_elasticity" | "structure_flexibility" => Together::InSeries,
        "saturation" => Together::Least,
        "controller_mismatch" => Together::Remainder,
        _ => Together::Apart,
    }
}

/// Additions to the same effect at the same place become one.
pub(crate) fn combine(out: &mut Refined, new: &mut Applied) {
    let how = together(new.entry.name);
    let (effect, site, place) = (new.entry.name, new.site, new.place);
    out.effects.retain(|e| {
        let is_same = e.entry.name == effect && e.site == site && e.place == place && how != Together::Apart;
        if !is_same {
            return true;
        }
        let (first, old) = (new.values[0], e.values[0]);
        match how {
            Together::Apart => {}
            Together::Sum => new.values.iter_mut().zip(&e.values).for_each(|(new, old)| *new += old),
            Together::Product => new.values[0] *= old,
            Together::InSeries => {
                // The damping and the motor's inertia are the file's: a fit of slow motions says nothing of them.
                new.values.clone_from(&e.values);
                new.values[0] = first * old / (first + old);
            }
            Together::Least => new.values[0] = first.min(old),
            Together::Remainder => new.values[0] = 1.0 - (1.0 - first) * (1.0 - old),
        }
        false
    });
}

/// Friction along the stroke is read with a mean of zero, but its law takes away no more than the joint's nominal friction, which now
/// may stand in another effect: what it needs of the joint's dry friction moves into it.
fn make_room(work: &Work, out: &mut Refined, pick: usize) {
    let c = &work.candidates[work.picks[pick].candidate];
    if c.effect_name() != "friction_position" {
        return;
    }
    let (k, place) = (c.scope[0], c.place);
    let Some(law) = out.effects.iter_mut().rfind(|e| e.entry.name == "friction_position" && e.is_at_joint(place)) else { return };
    let Law::JointEffort(effort) = law.entry.law else { return };
    let level = |q: f64| effort(&law.values, &JointState { q, sign: 1.0, coulomb: f64::INFINITY, ..JointState::default() });
    let positions = work.motions.iter().flat_map(|m| m.segment.q[k].iter().copied());
    let needed = -positions.map(level).fold(0.0, f64::min);
    let stated = |name: &str| -> &[usize] {
        // Places of the levels of dry friction among the parameters of the laws that state one.
        match name {
            "friction_coulomb" => &[0],
            "friction_stribeck" | "friction_asymmetric" => &[0, 1],
            _ => &[],
        }
    };
    let room = |out: &Refined| -> Vec<(usize, usize)> {
        let at = |(i, e): (usize, &Applied)| stated(e.entry.name).iter().map(move |&p| (i, p)).collect::<Vec<_>>();
        out.effects.iter().enumerate().filter(|(_, e)| e.is_at_joint(place)).flat_map(at).collect()
    };
    law.values[2] += needed;
    let levels = room(out);
    // The first law that states dry friction gives it; without one, the joint itself.
    let Some(&(first, _)) = levels.first() else {
        out.model.joints[place].coulomb = (out.model.joints[place].coulomb - needed).max(0.0);
        return;
    };
    for (i, p) in levels.into_iter().filter(|(i, _)| *i == first) {
        out.effects[i].values[p] = (out.effects[i].values[p] - needed).max(0.0);
    }
}

/// A change of damping with warmth is a share of the joint's nominal damping: total damping at such a joint is stated there and not as
/// an effect of its own.
fn keep_damping_nominal(work: &Work, out: &mut Refined) {
    let is_warming = |e: &Applied| e.entry.name == "friction_thermal";
    let places: Vec<usize> = out.effects.iter().filter(|e| is_warming(e)).map(|e| e.place).collect();
    for place in places {
        let old = work.robot.model.joints[place].viscous;
        let mut total = out.model.joints[place].viscous;
        out.effects.retain(|e| {
            let is_damping = e.entry.name == "friction_viscous" && e.is_at_joint(place);
            total += if is_damping { e.values[0] } else { 0.0 };
            !is_damping
        });
        for e in out.effects.iter_mut().filter(|e| e.is_at_joint(place)) {
            if e.entry.name == "friction_asymmetric" {
                // What both directions have in common.
                let common = e.values[2].min(e.values[3]);
                (e.values[2], e.values[3], total) = (e.values[2] - common, e.values[3] - common, total + common);
            }
        }
        let found =
            work.picks.iter().map(|p| &work.candidates[p.candidate]).any(|c| c.effect_name() == "friction_thermal" && c.place == place);
        let stated = out.effects.iter_mut().filter(|e| is_warming(e) && e.is_at_joint(place));
        // A rate of the robot's file was a share of the old damping; a found one is one of the new.
        let n = stated.count() - usize::from(found);
        let old_ones = out.effects.iter_mut().filter(|e| is_warming(e) && e.is_at_joint(place)).take(n);
        old_ones.for_each(|e| e.values[0] *= if total > 0.0 { old / total } else { 1.0 });
        out.model.joints[place].viscous = total;
    }
}

fn change_link(work: &Work, model: &mut Model, link: usize, reading: &Parameters) {
    // The reading is the total with payloads of the robot file counted in; the URDF gets the change only.
    let old = work.robot.model.links[link].parameters.to_vector();
    let mut theta = model.links[link].parameters.to_vector();
    for (k, name) in NAMES.iter().enumerate() {
        if let Some((_, new)) = reading.iter().find(|(n, _)| n == name) {
            theta[k] += new - old[k];
        }
    }
    model.set_link_parameters(link, InertialParameters::from_vector(&theta));
}

/// The pick at the same joint without which this one is no cause of its own: a friction peak states the dry friction it rides on, and what yields
/// before it slides does so in the place of friction that comes at once.
pub(crate) fn container(work: &Work, pick: usize) -> Option<usize> {
    let at = |i: usize| &work.candidates[work.picks[i].candidate];
    if at(pick).effect_name() != "friction_coulomb" {
        return None;
    }
    let is_lead = |i: &usize| matches!(at(*i).effect_name(), "friction_stribeck" | "friction_presliding") && at(*i).is_where(at(pick));
    (0..work.picks.len()).find(is_lead)
}

/// Dry friction that comes at once and stays beside what yields before it slides, of these readings `[N | N·m]`.
pub(crate) fn stays_beside(work: &Work, pick: usize, readings: &[Parameters]) -> Option<f64> {
    if work.candidates[work.picks[pick].candidate].effect_name() != "friction_presliding" {
        return None;
    }
    let held = (0..work.picks.len()).find(|&i| container(work, i) == Some(pick))?;
    readings[held].iter().find(|(name, _)| *name == "coulomb").map(|(_, value)| *value)
}
