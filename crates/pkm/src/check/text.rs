//! A check in words and as JSON.

use pkm_dyn::Model;
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::model::{AXES, FrameOnBody, Joint, JointKind, SensorKind};
use pkm_ident::base::{BaseParameters, RANK_TOLERANCE};
use serde_json::{Value, json};

use super::Checked;
use crate::out::{number, table};

/// The check in words.
pub(super) fn text(robot: &Robot, checked: &Checked) -> String {
    let model = &robot.model;
    let mut out = vec![format!(
        "{}: joints {}, driven {}, loops {}, couplings {}; gravity [{}] m/s² in {:?}",
        model.name,
        model.nv(),
        model.n_act(),
        model.loops.len(),
        model.couplings.len(),
        model.gravity.iter().map(|g| number(*g)).collect::<Vec<_>>().join(", "),
        model.root
    )];
    section(&mut out, "Links with mass", links(model));
    let without = without_mass(model);
    if !without.is_empty() {
        out.push(format!("  without mass, which the URDF's <inertial> gives: {}", without.join(", ")));
    }
    section(&mut out, "Joints", joints(model, &checked.home_q));
    section(&mut out, "Loops", loops(model));
    section(&mut out, "Couplings", couplings(model));
    section(&mut out, "Sensors", sensors(model));
    section(&mut out, "Effects", robot.effects.iter().map(|e| vec![effect(e, model)]).collect());
    out.push("\nMotion".to_string());
    motion(&mut out, model, checked);
    out.push(format!("  actuated coordinates: {}", names(model, &model.actuators)));
    let passive = model.passive();
    let list = if passive.is_empty() { "none".to_string() } else { names(model, &passive) };
    out.push(format!("  passive coordinates: {list}"));
    for (at, closure) in [("assembly", &checked.home), ("middle of travel", &checked.middle)] {
        let answer = if closure.is_closed { "closed" } else { "NOT CLOSED" };
        out.push(format!("  loops at the {at}: {answer}, residual {:.1e} m or rad (limit 1e-9)", closure.gap));
    }
    out.push("\nParameters".to_string());
    match &checked.base {
        Ok(counts) => parameters(&mut out, &counts.moving, &counts.at_rest),
        Err(why) => out.push(format!("  not counted: {why}")),
    }
    if !checked.warnings.is_empty() {
        out.push("\nWarnings".to_string());
        out.extend(checked.warnings.iter().map(|w| format!("  {w}")));
    }
    out.join("\n")
}

fn motion(out: &mut Vec<String>, model: &Model, checked: &Checked) {
    if checked.internal.is_empty() {
        out.push(format!("  mobility {}, equal to the number of drives", checked.mobility));
    } else {
        let independent = names(model, &checked.independent);
        out.push(format!("  mobility {}, drives {}: independent coordinates are {independent}", checked.mobility, model.n_act()));
        for efforts in &checked.internal {
            let list: Vec<String> = efforts.iter().map(|e| number(*e)).collect();
            out.push(format!("  efforts of the drives that strain the robot and move nothing: [{}]", list.join(", ")));
        }
    }
    if !checked.redundant.is_empty() {
        let (rows, list) = (model.n_constraints(), checked.redundant.join("; "));
        out.push(format!("  constraints {rows}, of which {} follow from the others: {list}", checked.redundant.len()));
    }
}

fn section(out: &mut Vec<String>, title: &str, rows: Vec<Vec<String>>) {
    if !rows.is_empty() {
        out.push(format!("\n{title}"));
        out.push(table(&rows));
    }
}

fn names(model: &Model, joints: &[usize]) -> String {
    joints.iter().map(|&j| model.joints[j].name.as_str()).collect::<Vec<_>>().join(" ")
}

fn links(model: &Model) -> Vec<Vec<String>> {
    let row = |&l: &usize| {
        let link = &model.links[l];
        let (com, _) = link.parameters.centre_of_mass();
        let com: Vec<String> = com.iter().map(|c| number(*c)).collect();
        let carried = link.body.map_or("root", |b| &model.joints[b].name).to_string();
        vec![
            link.name.clone(),
            format!("{} kg", number(link.parameters.mass)),
            format!("at [{}] m", com.join(", ")),
            format!("moved by {carried}"),
        ]
    };
    model.massive_links().iter().map(row).collect()
}

/// Links that joints move and that weigh nothing: frames between two axes of one place, or links whose `<inertial>` was forgotten.
fn without_mass(model: &Model) -> Vec<String> {
    let moved = model.links.iter().filter(|l| l.parameters.mass <= 0.0).filter_map(|l| Some((l, l.body?)));
    moved.map(|(link, body)| format!("{} (moved by {})", link.name, model.joints[body].name)).collect()
}

fn joints(model: &Model, home: &[f64]) -> Vec<Vec<String>> {
    let row = |(j, joint): (usize, &Joint)| {
        let unit = joint.kind.unit_position();
        let role = if model.actuators.contains(&j) { "driven" } else { "passive" };
        let mut more = Vec::new();
        for (what, value, unit) in [
            ("viscous", joint.viscous, format!("{}·s/{unit}", joint.kind.unit_effort())),
            ("Coulomb", joint.coulomb, joint.kind.unit_effort().to_string()),
            ("rotor", joint.armature, if joint.kind == JointKind::Prismatic { "kg" } else { "kg·m²" }.to_string()),
        ] {
            if value.abs() > 0.0 {
                more.push(format!("{what} {} {unit}", number(value)));
            }
        }
        vec![
            joint.name.clone(),
            kind(joint).to_string(),
            role.to_string(),
            limits(joint),
            format!("assembly {}", number(home[j])),
            more.join(", "),
        ]
    };
    model.joints.iter().enumerate().map(row).collect()
}

fn kind(joint: &Joint) -> &'static str {
    match joint.kind {
        JointKind::Revolute => "revolute",
        JointKind::Prismatic => "prismatic",
    }
}

fn limits(joint: &Joint) -> String {
    let l = &joint.limits;
    let unit = joint.kind.unit_position();
    if !(l.lower.is_finite() || l.upper.is_finite()) {
        return "no limits".to_string();
    }
    let more =
        |value: f64, unit: String| if value.is_finite() && value > 0.0 { format!(", {} {unit}", number(value)) } else { String::new() };
    let speed = more(l.velocity, format!("{unit}/s"));
    let effort = more(l.effort, joint.kind.unit_effort().to_string());
    format!("{} to {} {unit}{speed}{effort}", number(l.lower), number(l.upper))
}

fn carrier<'m>(model: &'m Model, frame: &FrameOnBody) -> &'m str {
    let link = model.links.iter().find(|l| l.body == frame.body);
    link.map_or(model.root.as_str(), |l| l.name.as_str())
}

fn loops(model: &Model) -> Vec<Vec<String>> {
    let row = |l: &pkm_dyn::model::LoopClosure| {
        let axes: Vec<&str> = AXES.iter().zip(l.constrain).filter(|(_, c)| *c).map(|(name, _)| *name).collect();
        vec![l.name.clone(), format!("{} to {}", carrier(model, &l.a), carrier(model, &l.b)), format!("forbids {}", axes.join(" "))]
    };
    model.loops.iter().map(row).collect()
}

fn couplings(model: &Model) -> Vec<Vec<String>> {
    let row = |c: &pkm_dyn::model::Coupling| {
        let terms: Vec<String> = c.of.iter().map(|(j, ratio)| format!("{}·{}", number(*ratio), model.joints[*j].name)).collect();
        vec![format!("{} = {} + {}", model.joints[c.joint].name, terms.join(" + "), number(c.offset))]
    };
    model.couplings.iter().map(row).collect()
}

fn sensor_kind(kind: SensorKind) -> &'static str {
    match kind {
        SensorKind::Wrench => "wrench",
        SensorKind::Pose => "pose",
    }
}

fn sensors(model: &Model) -> Vec<Vec<String>> {
    let row =
        |s: &pkm_dyn::model::Sensor| vec![s.name.clone(), sensor_kind(s.kind).to_string(), format!("on {}", model.links[s.link].name)];
    model.sensors.iter().map(row).collect()
}

fn effect(e: &Applied, model: &Model) -> String {
    pkm_sim::describe(core::slice::from_ref(e), model)
}

fn parameters(out: &mut Vec<String>, moving: &BaseParameters, at_rest: &BaseParameters) {
    out.push(format!(
        "  {} standard inertial parameters (ten per link with mass), {} of them act on a drive",
        moving.standard, moving.acting
    ));
    out.push(format!("  {} base parameters: combinations that the drives' efforts can tell apart", moving.inertial));
    out.push(format!("  {} with one rotor inertia per drive, {} at rest", moving.with_rotors, at_rest.inertial));
    out.push(format!("  {} with viscous and Coulomb friction of every joint as well, passive ones included", moving.with_friction));
    let gap = if moving.gap.is_finite() { format!("{:.0e}", moving.gap) } else { "none left over".to_string() };
    out.push(format!(
        "  rank of the regressor over {} random states in {:.0} % of the travel; tolerance {RANK_TOLERANCE:.0e}, gap of singular values {gap}, weakest {:.1e}",
        moving.states,
        100.0 * 0.9 * moving.travel_share,
        moving.weakest
    ));
}

/// The check as JSON.
pub(super) fn json(robot: &Robot, checked: &Checked) -> Value {
    let model = &robot.model;
    let closure =
        |c: &pkm_dyn::loops::Closure| json!({"is_closed": c.is_closed, "residual": c.gap, "rank": c.rank, "pivot_ratio": c.pivot_ratio});
    let loops =
        model.loops.iter().map(|l| json!({"name": l.name, "a": carrier(model, &l.a), "b": carrier(model, &l.b), "rows": l.n_rows()}));
    let couplings = model.couplings.iter().map(|c| json!({"joint": model.joints[c.joint].name, "offset": c.offset}));
    let sensors = model.sensors.iter().map(|s| json!({"name": s.name, "kind": sensor_kind(s.kind), "link": model.links[s.link].name}));
    let effects = robot.effects.iter().map(|e| json!({"effect": e.entry.name, "where": e.place_names(model), "says": effect(e, model)}));
    let passive = model.passive();
    let list = |js: &[usize]| js.iter().map(|&j| model.joints[j].name.clone()).collect::<Vec<_>>();
    json!({
        "schema": "pkm.check/1",
        "robot": model.name,
        "root": model.root,
        "gravity": model.gravity.as_slice(),
        "links": links_json(model),
        "joints": joints_json(model, &checked.home_q),
        "loops": loops.collect::<Vec<_>>(),
        "couplings": couplings.collect::<Vec<_>>(),
        "sensors": sensors.collect::<Vec<_>>(),
        "effects": effects.collect::<Vec<_>>(),
        "mobility": checked.mobility,
        "drives": model.n_act(),
        "actuated": list(&model.actuators),
        "passive": list(&passive),
        "independent": list(&checked.independent),
        "internal_efforts": checked.internal,
        "redundant_constraints": checked.redundant,
        "assembly": closure(&checked.home),
        "middle": closure(&checked.middle),
        "parameters": base_json(checked),
        "warnings": checked.warnings,
    })
}

fn links_json(model: &Model) -> Vec<Value> {
    let one = |l: &pkm_dyn::model::Link| {
        let parameters: serde_json::Map<String, Value> =
            pkm_dyn::parameters::NAMES.iter().zip(l.parameters.to_vector().iter()).map(|(n, v)| ((*n).to_string(), json!(v))).collect();
        json!({"name": l.name, "moved_by": l.body.map(|b| &model.joints[b].name), "parameters": parameters})
    };
    model.links.iter().map(one).collect()
}

fn joints_json(model: &Model, home: &[f64]) -> Vec<Value> {
    let finite = |x: f64| x.is_finite().then_some(x);
    let one = |(j, joint): (usize, &Joint)| {
        let l = &joint.limits;
        json!({
            "name": joint.name,
            "kind": kind(joint),
            "driven": model.actuators.contains(&j),
            "lower": finite(l.lower),
            "upper": finite(l.upper),
            "velocity": finite(l.velocity),
            "effort": finite(l.effort),
            "viscous": joint.viscous,
            "coulomb": joint.coulomb,
            "rotor_inertia": joint.armature,
            "assembly": home[j],
        })
    };
    model.joints.iter().enumerate().map(one).collect()
}

fn base_json(checked: &Checked) -> Value {
    match &checked.base {
        Err(why) => json!({"not_counted": why}),
        Ok(c) => json!({
            "standard": c.moving.standard,
            "acting": c.moving.acting,
            "base": c.moving.inertial,
            "base_with_rotors": c.moving.with_rotors,
            "base_with_friction": c.moving.with_friction,
            "base_at_rest": c.at_rest.inertial,
            "states": c.moving.states,
            "tolerance": RANK_TOLERANCE,
            "gap": c.moving.gap.is_finite().then_some(c.moving.gap),
            "weakest": c.moving.weakest,
        }),
    }
}
