//! Words: a finding as a sentence and an equation a robot engineer can read.

use pkm_dyn::effects::{Law, PlaceKind, Site};
use pkm_dyn::model::JointKind;

use crate::alternatives::is_wider_law;
use crate::design::ColumnId;
use crate::rank::Step;
use crate::verdict::{Compensation, EffectAt, Estimate};
use crate::work::Work;
use alloc::collections::BTreeMap;

/// Joint kind that decides a candidate's units.
pub(crate) fn kind(work: &Work, pick: usize) -> JointKind {
    let c = &work.candidates[work.picks[pick].candidate];
    match c.site {
        Site::Joint => work.robot.model.joints[c.place].kind,
        _ => JointKind::Prismatic,
    }
}

/// Unit of a pick's parameter.
pub(crate) fn unit(work: &Work, pick: usize, parameter: &str) -> String {
    let entry = work.candidates[work.picks[pick].candidate].effect.entry();
    if is_of_the_effort_reading(work, pick) {
        return format!("{}/s", kind(work, pick).unit_effort());
    }
    entry.parameters.iter().find(|p| p.name == parameter).map_or(String::new(), |p| p.unit.text(kind(work, pick)).to_string())
}

/// Whether it is the recorded effort that is wrong, and not the robot or its positions.
pub(crate) fn is_of_the_effort_reading(work: &Work, pick: usize) -> bool {
    let p = &work.picks[pick];
    work.candidates[p.candidate].effect.is_of_the_effort_reading(&p.variant.values)
}

/// A number with three to four significant digits.
pub(crate) fn number(x: f64) -> String {
    let a = x.abs();
    if a == 0.0 {
        "0".to_string()
    } else if !(1e-3..1e5).contains(&a) {
        format!("{x:.2e}")
    } else {
        let digits = if a >= 1000.0 {
            0
        } else if a >= 100.0 {
            1
        } else if a >= 10.0 {
            2
        } else if a >= 1.0 {
            3
        } else {
            4
        };
        format!("{x:.digits$}")
    }
}

/// Friction or rotor inertia that the robot's file has already in a parameter of a pick; 0 where it has none.
fn stated(work: &Work, pick: usize, parameter: &str) -> f64 {
    let c = &work.candidates[work.picks[pick].candidate];
    if c.site != Site::Joint {
        return 0.0;
    }
    let joint = &work.robot.model.joints[c.place];
    match (c.effect_name(), parameter) {
        ("rotor_inertia", "inertia") => joint.armature,
        (effect, _) if !effect.starts_with("friction_") => 0.0,
        (_, name) if name.starts_with("coulomb") => joint.coulomb,
        (_, name) if name.starts_with("viscous") => joint.viscous,
        _ => 0.0,
    }
}

/// Parameters with their sizes; what they are in the robot's file stands beside it.
fn values(work: &Work, pick: usize, parameters: &BTreeMap<String, Estimate>, order: &[&str]) -> Vec<String> {
    order
        .iter()
        .filter_map(|name| parameters.get(*name).map(|e| (name, e)))
        .map(|(name, e)| {
            let unit = if e.unit == "1" { String::new() } else { format!(" {}", e.unit) };
            let stated = stated(work, pick, name);
            let already = if stated > 0.0 { format!(" ({}{unit} in the robot's file)", number(stated)) } else { String::new() };
            format!("{name} = {}{unit}{already}", number(e.value))
        })
        .collect()
}

/// What is said of the dry friction that the robot's file has, where it yields before it slides instead.
pub(crate) fn dry_friction_beside(work: &Work, pick: usize, stays: Option<f64>) -> String {
    let unit = kind(work, pick).unit_effort();
    stays.map_or(String::new(), |stays| format!(" Of dry friction that comes at once {} {unit} stay there.", number(stays)))
}

/// Findings whose numbers are within those of a pick: where it is compensated, they are as well.
fn held_within(work: &Work, pick: usize, parameters: &BTreeMap<String, Estimate>) -> Vec<&'static str> {
    let own = work.picks[pick].candidate;
    // The level of what yields before it slides is its own.
    if work.candidates[own].effect_name() == "friction_presliding" {
        return Vec::new();
    }
    let others = (0..work.picks.len()).filter(|&other| other != pick && is_wider_law(work, own, work.picks[other].candidate));
    let names = others.map(|other| work.candidates[work.picks[other].candidate].effect_name());
    let has = |start: &str| parameters.keys().any(|name| name.starts_with(start));
    names.filter(|name| name.strip_prefix("friction_").is_some_and(has)).collect()
}

/// What a mass that nobody sees is: that of a load on a link that turns about its own origin.
fn least_mass(work: &Work, pick: usize) -> &'static str {
    let p = &work.picks[pick];
    let power = |id: ColumnId| -> f64 {
        let at = |j: usize| work.gram.local[j][id].map_or(0.0, |l| work.gram.xx_all[j][(l, l)]);
        (0..work.design.n_joints).map(at).sum()
    };
    let columns = &p.variant.columns;
    if work.candidates[p.candidate].effect_name() != "payload" || columns.len() < 4 {
        return "";
    }
    let moments = columns[1..4].iter().map(|&id| power(id)).fold(0.0, f64::max);
    if power(columns[0]) > 1e-12 * moments {
        return "";
    }
    " The link turns about its own origin, so only mass times distance shows: the mass is the least that fits on the link, and may be larger and nearer."
}

/// Where a limb holds its link and pulls to.
fn where_held(parameters: &BTreeMap<String, Estimate>, effect: &str) -> String {
    if effect != "limb_impedance" {
        return String::new();
    }
    let mut out = String::new();
    if let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| parameters.get(name)) {
        let away = pkm_dyn::math::hypot(pkm_dyn::math::hypot(x.value, y.value), z.value);
        out += &format!(" It explains more at the link's centre of mass, {} m from its origin, than there.", number(away));
    }
    if parameters.contains_key("in_space") {
        out += " It pulls to one place in space, wherever a recording begins.";
    }
    if !parameters.contains_key("stiffness") {
        out += " What a stiffness would do, masses and weights imitate along these motions.";
    }
    out
}

/// What was found, where, how large, and what it does for the fit, from the step before it to its own.
pub(crate) fn sentence(
    work: &Work,
    pick: usize,
    parameters: &BTreeMap<String, Estimate>,
    [before, after]: [&Step; 2],
    same: &[EffectAt],
) -> String {
    let c = &work.candidates[work.picks[pick].candidate];
    let entry = c.effect.entry();
    let order: Vec<&str> = entry.parameters.iter().map(|p| p.name).take(4).collect();
    let sizes = values(work, pick, parameters, &order).join(", ");
    let place = match entry.place {
        PlaceKind::RootLink => format!("At the mounting ({})", c.name),
        _ if c.site == Site::Link => format!("On link {}", c.name),
        PlaceKind::PassiveJoint => format!("At passive joint {}", c.name),
        _ => format!("At {}", c.places(&work.robot.model).join(" and ")),
    };
    let sentence = if is_of_the_effort_reading(work, pick) {
        entry.sentence.replacen("a reading", "the effort's reading", 1)
    } else {
        entry.sentence.to_string()
    };
    let mut out = format!("{place}, {sentence}: {sizes}.{}{}", least_mass(work, pick), where_held(parameters, entry.name));
    let (b, a) = (100.0 * before.heldout, 100.0 * after.heldout);
    out += &format!(" With it the held-out error goes from {b:.1} % to {a:.1} % of the effort");
    out += &if a > b && after.moving < before.moving {
        let (b, a) = (100.0 * before.moving, 100.0 * after.moving);
        format!(", and from {b:.2} % to {a:.2} % where joints move: how friction holds a joint that stands is in no law here.")
    } else {
        ".".to_string()
    };
    let within = held_within(work, pick, parameters);
    if !within.is_empty() {
        out += &format!(" Its numbers hold those of {} there.", within.join(" and "));
    }
    if !same.is_empty() {
        let mut names: Vec<String> = Vec::new();
        for s in same {
            let name = if s.place.len() > 2 { s.effect.clone() } else { format!("{} at {}", s.effect, s.place.join(", ")) };
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let shown = names.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
        let more = if names.len() > 3 { format!(" and {} more", names.len() - 3) } else { String::new() };
        out += &format!(" These recordings cannot tell it from {shown}{more}.");
    }
    out
}

/// What a controller does about a finding: whether loading the refined robot is enough, and the rule with its numbers.
pub(crate) fn compensation(work: &Work, pick: usize, parameters: &BTreeMap<String, Estimate>) -> Compensation {
    let entry = work.candidates[work.picks[pick].candidate].effect.entry();
    // What a controller's model computes: rigid bodies, gravity, lengths, and efforts at joints.
    let in_refined_model = entry.law.is_in_the_model() || matches!(entry.law, Law::JointEffort(_));
    let order: Vec<&str> = entry.parameters.iter().map(|p| p.name).collect();
    let mut says = format!("{}; {}", entry.compensation, values(work, pick, parameters, &order).join(", "));
    if order.iter().any(|name| stated(work, pick, name) > 0.0) {
        says += "; add only what the controller does not do already";
    }
    let within = held_within(work, pick, parameters);
    if !within.is_empty() {
        says += &format!("; instead of what is said of {} there", within.join(" and "));
    }
    Compensation { in_refined_model, says }
}

/// The equation in the form it was fitted.
pub(crate) fn equation(work: &Work, pick: usize, parameters: &BTreeMap<String, Estimate>) -> String {
    let p = &work.picks[pick];
    let c = &work.candidates[p.candidate];
    let entry = c.effect.entry();
    let order: Vec<&str> = entry.parameters.iter().map(|p| p.name).collect();
    let law = if is_of_the_effort_reading(work, pick) { "recorded effort = effort + rate·t" } else { entry.equation };
    let mut out = format!("{law}; {}", values(work, pick, parameters, &order).join(", "));
    if p.variant.softness.is_some() && entry.name.starts_with("friction") && entry.name != "friction_viscous" {
        let turn = work.widths[work.softness][c.place];
        let unit = pkm_dyn::effects::Unit::Velocity.text(kind(work, pick));
        out += &format!("; {}, w = {} {unit}", turn.equation(), number(turn.width));
    }
    out
}
