//! The catalogue of effects: complete, with names of the file format, and its laws keep their promises.

extern crate alloc;

use alloc::collections::BTreeSet;

use nalgebra::Vector3;
use pkm_dyn::effects::{Applied, CATALOGUE, Energy, Entry, JointState, Law, LinkState, PlaceKind, Robot, find};
use pkm_dyn::kinematics::forward_kinematics;
use pkm_dyn::model::Model;
use pkm_dyn::spatial::Pose;
use pkm_dyn::urdf::{parse, refined_toml};
use pkm_dyn::{Data, math};
use pkm_tests::{Draw, Shape, drawn_loops, drawn_tree};

/// Every name of the file format.
const IN_FORMAT: [&str; 37] = [
    "friction_viscous",
    "friction_coulomb",
    "friction_asymmetric",
    "friction_stribeck",
    "friction_quadratic",
    "friction_load",
    "friction_presliding",
    "friction_position",
    "friction_thermal",
    "friction_passive",
    "directional_efficiency",
    "backlash",
    "joint_elasticity",
    "structure_flexibility",
    "rotor_inertia",
    "payload",
    "inertia_error",
    "spring",
    "cable_force",
    "gravity_tilt",
    "torque_constant",
    "torque_offset",
    "torque_ripple",
    "transmission_coupling",
    "actuator_lag",
    "time_delay",
    "saturation",
    "dead_zone",
    "encoder_offset",
    "encoder_eccentricity",
    "geometry_error",
    "limb_impedance",
    "contact",
    "external_force",
    "active_limb",
    "sensor_drift",
    "controller_mismatch",
];

#[test]
fn the_catalogue_holds_the_effects_of_the_file_format_once_each() {
    let names: Vec<&str> = CATALOGUE.iter().map(|e| e.name).collect();
    let unique: BTreeSet<&str> = names.iter().copied().collect();
    assert_eq!(names.len(), unique.len(), "a name is there twice");
    assert_eq!(unique, IN_FORMAT.into_iter().collect());
    assert!(names.iter().all(|name| find(name).is_some_and(|e| e.name == *name)));
}

/// What an entry lacks, as one line per fault.
fn faults(e: &Entry) -> Vec<String> {
    let mut out = Vec::new();
    let mut fault = |what: String| out.push(format!("{}: {what}", e.name));
    for (what, text) in [("sentence", e.sentence), ("equation", e.equation), ("compensation", e.compensation)] {
        if text.trim().len() < 5 || text.contains('\n') {
            fault(format!("no {what}"));
        }
    }
    if e.sentence.ends_with('.') || e.sentence.starts_with(char::is_uppercase) {
        fault("the sentence is a clause: no capital, no full stop".to_string());
    }
    let parameters: BTreeSet<&str> = e.parameters.iter().map(|p| p.name).collect();
    if parameters.len() != e.parameters.len() || parameters.is_empty() {
        fault("parameter names".to_string());
    }
    for p in e.parameters {
        // NaN stands for "as it was", which only makes sense for a link's own numbers.
        let is_sound =
            p.default.is_none_or(|d| (d.is_finite() && d >= p.lower && d <= p.unit.upper()) || (d.is_nan() && e.name == "inertia_error"));
        if !is_sound || p.lower.is_nan() {
            fault(format!("default or limit of {}", p.name));
        }
    }
    let looks: BTreeSet<&str> = e.look_alikes.iter().map(|l| l.effect).collect();
    if looks.len() != e.look_alikes.len() || looks.len() < 2 {
        fault("needs two different look-alikes".to_string());
    }
    for l in e.look_alikes {
        if !IN_FORMAT.contains(&l.effect) || l.effect == e.name || l.experiment.trim().len() < 10 {
            fault(format!("look-alike {}", l.effect));
        }
    }
    out
}

#[test]
fn every_entry_is_complete_and_names_look_alikes_of_the_file_format() {
    let all: Vec<String> = CATALOGUE.iter().flat_map(|e| faults(e)).collect();
    assert!(all.is_empty(), "{all:#?}");
}

#[test]
fn an_incomplete_entry_is_noticed() {
    let mut e = *find("spring").expect("spring");
    e.sentence = "";
    e.look_alikes = &[];
    assert_eq!(faults(&e).len(), 2);
}

#[test]
fn laws_sit_where_they_can_act() {
    for e in CATALOGUE {
        let fits = match e.law {
            Law::JointEffort(_) => matches!(e.place, PlaceKind::Joint | PlaceKind::PassiveJoint),
            Law::Inertia(_) => e.place == PlaceKind::Link,
            Law::Gravity(_) => e.place == PlaceKind::RootLink,
            Law::PairEffort(_) => e.place == PlaceKind::JointPair,
            Law::Drift => e.place == PlaceKind::JointOrSensor,
            Law::Structure | Law::Person => e.place == PlaceKind::Link,
            Law::Wrench(_) => matches!(e.place, PlaceKind::Link | PlaceKind::LinkOrJoint),
            Law::Geometry(_) => e.place == PlaceKind::LinkOrLoop,
            _ => e.place == PlaceKind::Joint,
        };
        assert!(fits, "{}", e.name);
    }
}

/// Numbers a real friction has: an estimator may subtract friction that was too large, a plant cannot.
fn physical(e: &Entry, draw: &mut Draw) -> Vec<f64> {
    e.parameters.iter().map(|p| (p.lower.max(0.0) + draw.uniform(0.0..5.0)).min(p.unit.upper())).collect()
}

/// Effort of a joint that carries the effect on top of nominal friction, beyond that friction where the effect adds to it.
fn friction(e: &'static Entry, values: Vec<f64>, state: &JointState) -> f64 {
    let mut model = drawn_tree(1, &mut Draw::new(1));
    let is_share = ["friction_thermal", "friction_position"].contains(&e.name);
    (model.joints[0].viscous, model.joints[0].coulomb) = if is_share { (3.0, 2.0) } else { (0.0, 0.0) };
    Robot::new(model, vec![Applied::at(e, 0, values)]).joint_effort(0, state)
}

#[test]
fn dissipative_effects_never_feed_power_into_the_joint() {
    let mut draw = Draw::new(11);
    for e in CATALOGUE.iter().copied().filter(|e| e.energy == Energy::Dissipates) {
        assert!(matches!(e.law, Law::JointEffort(_)), "{} is no effort at a joint", e.name);
        for _ in 0..500 {
            let (v, load, warmth) = (draw.uniform(-2.0..2.0), draw.uniform(-50.0..50.0), draw.uniform(-9.0..9.0));
            // Hard and smoothed signs: an estimator passes zero gently.
            for sign in [math::sign(v), math::tanh(v / 0.05)] {
                let (q, a) = (draw.uniform(-3.0..3.0), draw.uniform(-9.0..9.0));
                let state = JointState { q, v, a, sign, load, warmth, ..JointState::default() };
                let power = friction(e, physical(e, &mut draw), &state) * v;
                assert!(power >= 0.0, "{}: {power} W at {state:?}", e.name);
            }
        }
    }
}

#[test]
fn friction_that_falls_takes_away_no_more_than_there_is() {
    let moving = JointState { q: 0.5, v: 0.3, sign: 1.0, warmth: 10.0, ..JointState::default() };
    for (name, values, left) in [
        ("friction_position", vec![-100.0, 0.0, 0.0, 0.0, 0.0], 3.0 * 0.3),
        ("friction_thermal", vec![-1.0], 2.0),
        ("friction_thermal", vec![-0.05], 2.0 + 0.5 * 3.0 * 0.3),
        ("friction_position", vec![-1.0, 0.3, 0.5, 2.0, 0.0], 2.0 + 0.5 - 0.2 + 0.08 + 3.0 * 0.3),
    ] {
        let effort = friction(find(name).expect("in the library"), values, &moving);
        assert!((effort - left).abs() < 1e-12, "{name}: {effort} instead of {left}");
    }
}

#[test]
fn friction_pushes_nothing_at_rest() {
    let mut draw = Draw::new(12);
    for e in CATALOGUE.iter().filter(|e| e.energy == Energy::Dissipates) {
        let Law::JointEffort(law) = e.law else { panic!("{} is no effort at a joint", e.name) };
        let effort = law(&physical(e, &mut draw), &JointState { load: 30.0, ..JointState::default() });
        assert!(effort.abs() < 1e-300, "{}: {effort} N", e.name);
    }
}

#[test]
fn a_gear_gives_its_efficiencies_and_opposes_motion_both_ways() {
    let Law::JointEffort(law) = find("directional_efficiency").expect("in the library").law else { panic!("an effort at a joint") };
    let at = |load: f64, sign: f64| load + law(&[0.8, 0.6], &JointState { load, v: 0.1 * sign, sign, ..JointState::default() });
    // Lifting 40 N takes 40/0.8, letting it down leaves 40·0.6 for the drive to hold; and mirrored.
    for (load, sign, want) in [(40.0, 1.0, 50.0), (40.0, -1.0, 24.0), (-40.0, -1.0, -50.0), (-40.0, 1.0, -24.0)] {
        assert!((at(load, sign) - want).abs() < 1e-12, "{load} {sign}: {}", at(load, sign));
    }
}

/// z and the work done along a sine of that amplitude, per period after the first three.
fn presliding_cycle(p: &[f64], amplitude: f64) -> (f64, f64) {
    let Law::Memory(memory) = find("friction_presliding").expect("in the library").law else { panic!("a law with a memory") };
    let (steps, mut z, mut work, mut top) = (20_000, 0.0, 0.0, 0.0_f64);
    let h = 2.0 * core::f64::consts::PI / f64::from(steps);
    for i in 0..4 * steps {
        let v = |t: f64| amplitude * math::cos(t);
        let t = h * f64::from(i);
        // Midpoint rule.
        let middle = z + 0.5 * h * (memory.rate)(p, z, v(t));
        z += h * (memory.rate)(p, middle, v(t + 0.5 * h));
        let effort = (memory.effort)(p, middle, v(t + 0.5 * h));
        top = top.max(effort.abs());
        if i >= 3 * steps {
            work += h * effort * v(t + 0.5 * h);
        }
    }
    (top, work)
}

#[test]
fn presliding_is_bounded_by_coulomb_dissipates_over_a_cycle_and_holds_at_rest() {
    let p = [1000.0, 2.0];
    for amplitude in [1e-4, 1e-3, 0.01, 1.0] {
        let (top, work) = presliding_cycle(&p, amplitude);
        assert!(top <= 2.0 + 1e-9 && work > 0.0, "{amplitude}: {top} N, {work} J");
        assert!(work <= 4.0 * amplitude * 2.0, "{amplitude}: {work} J is more than sliding all the way costs");
    }
    // Far beyond pre-sliding it is dry friction, less what the bristles give back: after a reversal the effort is
    // coulomb·(1 − 2·exp(−way·stiffness/coulomb)), so each of both ways is 2·coulomb/stiffness shorter.
    let (_, work) = presliding_cycle(&p, 1.0);
    let want = 2.0 * 2.0 * (2.0 - 2.0 * 2.0 / 1000.0);
    assert!((work / want - 1.0).abs() < 2e-3, "{work} J instead of {want} J");
    let Law::Memory(memory) = find("friction_presliding").expect("in the library").law else { panic!("a law with a memory") };
    assert!((memory.rate)(&p, 1e-3, 0.0).abs() < 1e-300 && ((memory.effort)(&p, 1e-3, 0.0) - 1.0).abs() < 1e-12);
}

fn wrench(name: &str) -> fn(&[f64], &LinkState) -> [f64; 6] {
    let Law::Wrench(law) = find(name).expect("in the library").law else { panic!("{name} is no wrench") };
    law
}

#[test]
fn a_contact_pushes_beyond_its_place_only_and_never_pulls() {
    let law = wrench("contact");
    let mut draw = Draw::new(14);
    for _ in 0..2000 {
        let side = if draw.uniform(0.0..1.0) < 0.5 { -1.0 } else { 1.0 };
        let p = [100.0, 0.2, draw.uniform(0.0..50.0), side, 0.6, 0.0, -0.8];
        let position = [0, 1, 2].map(|_| draw.uniform(-1.0..1.0));
        let velocity = [0, 1, 2, 3, 4, 5].map(|_| draw.uniform(-5.0..5.0));
        let f = law(&p, &LinkState { position, velocity, ..LinkState::default() });
        let depth = side * (0.6 * position[0] - 0.8 * position[2] - 0.2);
        let push = side * (0.6 * f[0] - 0.8 * f[2]);
        let want = if depth > 0.0 { (100.0 * depth + p[2] * side * (0.6 * velocity[0] - 0.8 * velocity[2])).max(0.0) } else { 0.0 };
        assert!(push >= 0.0 && (push - want).abs() < 1e-12 && f[1].abs() + f[3..].iter().map(|m| m.abs()).sum::<f64>() <= 0.0);
    }
}

#[test]
fn a_limb_without_damping_gives_back_all_and_with_it_never_more() {
    let law = wrench("limb_impedance");
    let work = |damping: f64| -> f64 {
        let mut p = vec![0.0; 24];
        (p[0], p[1], p[4], p[7], p[16]) = (200.0, damping, 30.0, 4.0, 0.01);
        let steps = 4000;
        let h = 2.0 * core::f64::consts::PI / f64::from(steps);
        (0..steps)
            .map(|i| {
                let (s, c) = math::sin_cos(h * f64::from(i));
                let (displacement, velocity) = ([0.1 * s, 0.1 * c, 0.0, 0.0, 0.0, 0.2 * s], [0.1 * c, -0.1 * s, 0.0, 0.0, 0.0, 0.2 * c]);
                let f = law(&p, &LinkState { displacement, velocity, ..LinkState::default() });
                h * f.iter().zip(velocity).map(|(f, v)| f * v).sum::<f64>()
            })
            .sum()
    };
    assert!(work(0.0).abs() < 1e-12, "{}", work(0.0));
    // damping · v² over a turn: 5 · 2π · 0.01
    assert!((work(5.0) - 0.1 * core::f64::consts::PI).abs() < 1e-12, "{}", work(5.0));
}

#[test]
fn a_limb_that_rests_in_space_pulls_to_the_same_place_wherever_the_motion_began() {
    let law = wrench("limb_impedance");
    let mut p = vec![0.0; 24];
    (p[0], p[15], p[20]) = (200.0, 0.3, 1.0);
    let from = |start: [f64; 3]| {
        let position = [0.1, 0.5, -0.2];
        let moved = [0, 1, 2].map(|i| position[i] - start[i]);
        let displacement = [moved[0], moved[1], moved[2], 0.0, 0.0, 0.0];
        law(&p, &LinkState { position, displacement, ..LinkState::default() })
    };
    let want = [20.0, 40.0, -40.0];
    for start in [[0.0; 3], [0.1, -0.4, 0.2]] {
        assert!(from(start).iter().zip(want).all(|(f, w)| (f - w).abs() < 1e-12), "{:?}", from(start));
    }
    // Told from where the motion began instead, it pulls elsewhere from another start.
    p[20] = 0.0;
    assert!((law(&p, &LinkState { displacement: [0.1, 0.5, -0.2, 0.0, 0.0, 0.0], ..LinkState::default() })[1] - 40.0).abs() < 1e-12);
}

#[test]
fn a_limb_held_beside_the_origin_pulls_and_twists_as_at_a_frame_of_its_own() {
    let law = wrench("limb_impedance");
    let (mut p, mut at_frame) = (vec![0.0; 24], vec![0.0; 24]);
    (p[0], p[1], p[16]) = (200.0, 3.0, 0.02);
    at_frame[..21].copy_from_slice(&p[..21]);
    let point = Vector3::new(0.1, -0.2, 0.3);
    (p[21], p[22], p[23]) = (point.x, point.y, point.z);
    let start = Pose::from_xyz_rpy([0.3, 0.0, -0.1], [0.2, 0.4, -1.0]);
    let now = Pose::from_xyz_rpy([0.25, 0.1, 0.0], [0.9, -0.3, 0.2]);
    let (linear, angular) = (Vector3::new(0.3, -0.1, 0.2), Vector3::new(1.0, 2.0, -0.5));
    let state = |from: &Pose, to: &Pose, linear: Vector3<f64>| {
        let turn = Pose { rotation: to.rotation * from.rotation.transpose(), ..*to }.rotation_vector();
        let six = |a: Vector3<f64>, b: Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
        LinkState {
            position: to.translation.into(),
            displacement: six(to.translation - from.translation, turn),
            velocity: six(linear, angular),
            axes: to.rotation.into(),
            time: 0.0,
        }
    };
    let frame = Pose { translation: point, ..Pose::identity() };
    let arm = now.rotation * point;
    for in_space in [0.0, 1.0] {
        (p[20], at_frame[20]) = (in_space, in_space);
        let held = law(&p, &state(&start, &now, linear));
        // A frame of the link whose origin is that point: its force, and the moment of that force about the link's origin.
        let want = law(&at_frame, &state(&start.compose(&frame), &now.compose(&frame), linear + angular.cross(&arm)));
        let force = Vector3::new(want[0], want[1], want[2]);
        let moment = arm.cross(&force);
        let want = [force.x, force.y, force.z, moment.x, moment.y, moment.z];
        assert!(force.norm() > 1.0 && held.iter().zip(want).all(|(h, w)| (h - w).abs() < 1e-12), "{held:?} instead of {want:?}");
    }
}

#[test]
fn what_feeds_brings_energy_in_and_only_that() {
    let feeding: Vec<&str> = CATALOGUE.iter().filter(|e| e.energy == Energy::Feeds).map(|e| e.name).collect();
    assert_eq!(feeding, ["external_force", "active_limb"]);
    let law = wrench("external_force");
    let at = |time: f64| law(&[1.0, 2.0, 5.0, 0.0, -3.0, 0.0, 0.0, 0.5], &LinkState { time, ..LinkState::default() });
    for (time, share) in [(0.9, 0.0), (1.0, 0.0), (1.005, 0.5), (1.01, 1.0), (1.5, 1.0), (1.995, 0.5), (2.0, 0.0), (7.0, 0.0)] {
        let want = [-5.0, 0.0, 3.0, 0.0, 0.0, -0.5].map(|x| share * x);
        assert!(at(time).iter().zip(want).all(|(f, w)| (f - w).abs() < 1e-9), "{time} s: {:?}", at(time));
    }
}

#[test]
fn a_coupling_is_felt_by_both_joints_alike() {
    let Law::PairEffort(law) = find("transmission_coupling").expect("in the library").law else { panic!("a law of two joints") };
    // Power at both joints is the effort times the sum of the velocities: friction of the sum never feeds.
    for (v1, v2) in [(0.3, -0.1), (-0.4, 0.1), (0.2, 0.2)] {
        let v = v1 + v2;
        let effort = law(&[0.5, 2.0, 3.0], &JointState { v, sign: math::sign(v), ..JointState::default() });
        assert!(effort * v1 + effort * v2 > 0.0 && (effort - (2.0 * math::sign(v) + 3.0 * v)).abs() < 1e-12);
    }
    assert!((law(&[0.5, 2.0, 3.0], &JointState { a: 4.0, ..JointState::default() }) - 2.0).abs() < 1e-12);
}

#[test]
fn a_changed_length_moves_the_link_by_that_much() {
    let model = drawn_tree(3, &mut Draw::new(15));
    let shift = [("dx", 0.01), ("dy", -0.02), ("dz", 0.03)].map(|(n, v)| (n.to_string(), v));
    let moved = Robot::new(model.clone(), vec![Applied::try_new(&model, "geometry_error", "l2", &shift).expect("a moved link")]).model;
    let body = model.links[model.link_index("l2").expect("l2")].body.expect("it moves");
    let q = [0.3, -0.4, 0.7];
    let [before, after] = [&model, &moved].map(|m| {
        let mut data = Data::new(m);
        forward_kinematics(m, &mut data, &q);
        data.pose_wb.clone()
    });
    let parent = model.joints[body].parent;
    let turn = parent.map_or_else(nalgebra::Matrix3::identity, |p| before[p].rotation);
    let wanted = turn * Vector3::new(0.01, -0.02, 0.03);
    for (j, (old, new)) in before.iter().zip(&after).enumerate() {
        let change = new.translation - old.translation;
        let wanted = if model.supports(body, Some(j)) { wanted } else { Vector3::zeros() };
        assert!((change - wanted).norm() < 1e-14 && (new.rotation - old.rotation).norm() < 1e-14, "body {j}: {change}");
    }
    let refused = Applied::try_new(&model, "geometry_error", "base", &shift).expect_err("the root hangs on nothing");
    assert!(refused.to_string().contains("a link that a joint moves"), "{refused}");
}

#[test]
fn an_anchor_of_a_loop_moves_in_its_body() {
    let model = drawn_loops(Shape::Planar, &mut Draw::new(5));
    let name = model.loops[0].name.clone();
    let shift = vec![("dx".to_string(), 0.004)];
    let robot = Robot::new(model.clone(), vec![Applied::try_new(&model, "geometry_error", &name, &shift).expect("a loop")]);
    let change = robot.model.loops[0].b.pose.translation - model.loops[0].b.pose.translation;
    assert!((change - Vector3::new(0.004, 0.0, 0.0)).norm() < 1e-15);
}

#[test]
fn numbers_out_of_physics_and_places_out_of_reach_are_refused_in_one_line() {
    let model = drawn_loops(Shape::Planar, &mut Draw::new(5));
    let (driven, passive) = (model.joints[model.actuators[0]].name.clone(), model.joints[model.passive()[0]].name.clone());
    let link = model.links[1].name.clone();
    for (effect, at, numbers, part) in [
        ("directional_efficiency", &driven, &[("efficiency_drive", 1.2), ("efficiency_back", 0.5)][..], "0.001 to 1"),
        ("external_force", &link, &[("start", 2.0), ("end", 2.0)], "must be after the start"),
        ("external_force", &driven, &[("start", 1.0), ("end", 2.0), ("fy", 1.0)], "at a joint it can only be 0"),
        ("contact", &link, &[("stiffness", 1.0), ("position", 0.1), ("nz", 0.0)], "no direction"),
        ("contact", &driven, &[("stiffness", 1.0), ("position", 0.1), ("nz", 1.0)], "at a joint it can only be 0"),
        ("saturation", &passive, &[("limit", 1.0)], "is not a driven joint"),
        ("sensor_drift", &passive, &[("rate", 1.0)], "a driven joint or sensor"),
        ("transmission_coupling", &driven, &[], "FIRST,SECOND"),
        ("backlash", &driven, &[], "\"gap\" is missing"),
    ] {
        let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
        let said = Applied::try_new(&model, effect, at, &numbers).expect_err(effect).to_string();
        assert!(said.contains(part) && !said.contains('\n'), "{said}");
    }
    let contact = [("stiffness", 100.0), ("position", 0.1)].map(|(n, v)| (n.to_string(), v));
    let at_joint = Applied::try_new(&model, "contact", &driven, &contact).expect("a contact at a joint");
    let pressed = LinkState { position: [0.3, 0.0, 0.0], ..LinkState::default() };
    assert!((wrench("contact")(&at_joint.values, &pressed)[0] - 20.0).abs() < 1e-12, "{:?}", at_joint.values);
}

#[test]
fn stored_energy_comes_back_on_a_closed_way() {
    let mut draw = Draw::new(13);
    for name in ["spring", "torque_ripple", "cable_force"] {
        let e = find(name).expect("in the library");
        let Law::JointEffort(law) = e.law else { panic!("{name} is no effort at a joint") };
        let p = physical(e, &mut draw);
        let work = |v: f64| -> f64 {
            (0..2000).map(|k| law(&p, &JointState { q: 1e-3 * f64::from(k), v, sign: math::sign(v), ..JointState::default() })).sum()
        };
        assert!((work(1.0) - work(-1.0)).abs() < 1e-9, "{name} depends on direction");
    }
}

/// Two joints of one kind.
fn pair(model: &Model) -> String {
    let other = (1..model.nv()).find(|&j| model.joints[j].kind == model.joints[0].kind).expect("two joints of one kind");
    format!("{},{}", model.joints[0].name, model.joints[other].name)
}

fn place(model: &Model, kind: PlaceKind) -> String {
    match kind {
        PlaceKind::Joint | PlaceKind::JointOrSensor => model.joints[model.actuators[0]].name.clone(),
        PlaceKind::JointPair => pair(model),
        PlaceKind::PassiveJoint => model.joints[model.passive()[0]].name.clone(),
        PlaceKind::Link | PlaceKind::LinkOrJoint | PlaceKind::LinkOrLoop => model.links[1].name.clone(),
        PlaceKind::RootLink => model.root.clone(),
    }
}

#[test]
fn every_effect_can_be_put_on_a_closed_loop_robot_by_name() {
    let model = drawn_loops(Shape::Planar, &mut Draw::new(5));
    for e in CATALOGUE {
        // An end lies after its start.
        let value = |name: &str| if name == "end" { 1.5 } else { 0.5 };
        let required = e.parameters.iter().filter(|p| p.default.is_none());
        let required: Vec<(String, f64)> = required.map(|p| (p.name.to_string(), value(p.name))).collect();
        let at = place(&model, e.place);
        let applied = Applied::try_new(&model, e.name, &at, &required).expect("required parameters suffice");
        assert_eq!(applied.place_names(&model).join(","), at);
        assert_eq!(applied.values.len(), e.parameters.len());
        let robot = Robot::new(model.clone(), vec![applied]);
        let state = JointState { q: 0.3, v: 0.2, a: 1.0, sign: 1.0, load: 2.0, ..JointState::default() };
        assert!((0..model.nv()).all(|j| robot.joint_effort(j, &state).is_finite()));
        assert!(robot.model.bodies.iter().all(|b| b.to_vector().iter().all(|x| x.is_finite())), "{}", e.name);
    }
}

#[test]
fn a_payload_adds_its_mass_where_it_rides_and_nothing_else() {
    let model = drawn_tree(4, &mut Draw::new(6));
    let numbers = [("mass", 2.0), ("x", 0.1), ("y", -0.2), ("z", 0.3)].map(|(n, v)| (n.to_string(), v));
    let payload = Applied::try_new(&model, "payload", "l2", &numbers).expect("a payload on a link");
    let loaded = Robot::new(model.clone(), vec![payload]).model;
    let body = model.links[model.link_index("l2").expect("l2")].body.expect("it moves");
    for (i, (old, new)) in model.bodies.iter().zip(&loaded.bodies).enumerate() {
        let change = new.to_vector() - old.to_vector();
        if i == body {
            // Mass, first moments, and m·(c² 1 − c cᵀ) about the link's origin, in the order of NAMES.
            let wanted = [2.0, 0.2, -0.4, 0.6, 0.26, 0.04, 0.2, -0.06, 0.12, 0.1];
            assert!(change.iter().zip(wanted).all(|(c, w)| (c - w).abs() < 1e-14), "{change}");
        } else {
            assert!(change.amax() < 1e-15, "{change}");
        }
    }
}

#[test]
fn a_base_rolled_or_pitched_feels_gravity_along_the_sunken_axis() {
    let mut model = drawn_tree(2, &mut Draw::new(7));
    model.gravity = Vector3::new(0.0, 0.0, -9.81);
    let (angle, down) = (0.1, -9.81 * math::cos(0.1));
    let side = 9.81 * math::sin(angle);
    // Rolled by +angle, y points up and gravity pulls along −y; pitched by +angle, x points down.
    for (name, wanted) in [("roll", Vector3::new(0.0, -side, down)), ("pitch", Vector3::new(side, 0.0, down))] {
        let tilt = Applied::try_new(&model, "gravity_tilt", "base", &[(name.to_string(), angle)]).expect("a tilt of the root");
        let tilted = Robot::new(model.clone(), vec![tilt]).model;
        assert!((tilted.gravity - wanted).norm() < 1e-13, "{name}: {}", tilted.gravity);
    }
}

#[test]
fn every_effect_survives_the_way_through_a_robot_file() {
    let shipped = pkm_robots::find("prs3").expect("a shipped robot");
    let bare = parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("it reads").bare;
    for e in CATALOGUE {
        let numbers: Vec<String> = e.parameters.iter().filter(|p| p.default.is_none()).map(|p| format!("{} = 0.5", p.name)).collect();
        let numbers = if e.name == "external_force" { vec!["start = 0.5".to_string(), "end = 1.5".to_string()] } else { numbers };
        let places: Vec<String> = place(&bare, e.place).split(',').map(|p| format!("{p:?}")).collect();
        let stated =
            format!("[[effect]]\nname = {:?}\nwhere = [{}]\nparameters = {{ {} }}\n", e.name, places.join(", "), numbers.join(", "));
        let names = [shipped.toml_name, shipped.urdf_name];
        let read = |toml: &str| parse(toml, shipped.urdf, names).unwrap_or_else(|x| panic!("{}: {x}", e.name));
        let once = read(&format!("{}\n{stated}", shipped.toml));
        let effects = &once.robot.effects;
        assert_eq!(effects.len(), 1, "{}", e.name);
        // These two are not written as effects: gravity and link inertias go to where they belong.
        if matches!(e.name, "gravity_tilt" | "inertia_error") {
            continue;
        }
        let again = read(&refined_toml(&once, &once.bare, effects, shipped.urdf_name).expect("it can be written"));
        let [old, new] = [&effects[0], &again.robot.effects[0]];
        assert_eq!(
            (old.entry.name, old.site, old.place, old.other, &old.values),
            (new.entry.name, new.site, new.place, new.other, &new.values)
        );
    }
}
