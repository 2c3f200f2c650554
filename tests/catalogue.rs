//! The catalogue of effects: complete, with names of the file format, and its laws keep their promises.

extern crate alloc;

use alloc::collections::BTreeSet;

use nalgebra::Vector3;
use pkm_dyn::effects::{Applied, CATALOGUE, Energy, Entry, JointState, Law, PlaceKind, Robot, find};
use pkm_dyn::math;
use pkm_dyn::model::Model;
use pkm_tests::{Draw, Shape, drawn_loops, drawn_tree};

/// What the library holds.
const IN_LIBRARY: [&str; 17] = [
    "actuator_lag",
    "encoder_offset",
    "friction_asymmetric",
    "friction_coulomb",
    "friction_load",
    "friction_passive",
    "friction_stribeck",
    "friction_viscous",
    "gravity_tilt",
    "inertia_error",
    "payload",
    "rotor_inertia",
    "spring",
    "time_delay",
    "torque_constant",
    "torque_offset",
    "torque_ripple",
];

/// Every name of the file format, in the library or not yet [formats, section 4].
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
fn the_catalogue_holds_the_seventeen_effects_once_each() {
    let names: Vec<&str> = CATALOGUE.iter().map(|e| e.name).collect();
    let unique: BTreeSet<&str> = names.iter().copied().collect();
    assert_eq!(names.len(), unique.len(), "a name is there twice");
    assert_eq!(unique, IN_LIBRARY.into_iter().collect());
    assert!(IN_LIBRARY.iter().all(|name| IN_FORMAT.contains(name)));
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
        let is_sound = p.default.is_none_or(|d| (d.is_finite() && d >= p.lower) || (d.is_nan() && e.name == "inertia_error"));
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
    e.parameters.iter().map(|p| p.lower.max(0.0) + draw.uniform(0.0..5.0)).collect()
}

#[test]
fn dissipative_effects_never_feed_power_into_the_joint() {
    let mut draw = Draw::new(11);
    for e in CATALOGUE.iter().filter(|e| e.energy == Energy::Dissipates) {
        let Law::JointEffort(law) = e.law else { panic!("{} is no effort at a joint", e.name) };
        for _ in 0..2000 {
            let (v, load) = (draw.uniform(-2.0..2.0), draw.uniform(-50.0..50.0));
            // Hard and smoothed signs: an estimator passes zero gently.
            for sign in [math::sign(v), math::tanh(v / 0.05)] {
                let (q, a) = (draw.uniform(-3.0..3.0), draw.uniform(-9.0..9.0));
                let state = JointState { q, v, a, sign, load, ..JointState::default() };
                let power = law(&physical(e, &mut draw), &state) * v;
                assert!(power >= 0.0, "{}: {power} W at {state:?}", e.name);
            }
        }
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
fn stored_energy_comes_back_on_a_closed_way() {
    let mut draw = Draw::new(13);
    for name in ["spring", "torque_ripple"] {
        let e = find(name).expect("in the library");
        let Law::JointEffort(law) = e.law else { panic!("{name} is no effort at a joint") };
        let p = physical(e, &mut draw);
        let work = |v: f64| -> f64 {
            (0..2000).map(|k| law(&p, &JointState { q: 1e-3 * f64::from(k), v, sign: math::sign(v), ..JointState::default() })).sum()
        };
        assert!((work(1.0) - work(-1.0)).abs() < 1e-12, "{name} depends on direction");
    }
}

fn place(model: &Model, kind: PlaceKind) -> String {
    match kind {
        PlaceKind::Joint | PlaceKind::JointOrSensor => model.joints[model.actuators[0]].name.clone(),
        PlaceKind::JointPair => format!("{},{}", model.joints[0].name, model.joints[1].name),
        PlaceKind::PassiveJoint => model.joints[model.passive()[0]].name.clone(),
        PlaceKind::Link | PlaceKind::LinkOrJoint | PlaceKind::LinkOrLoop => model.links[1].name.clone(),
        PlaceKind::RootLink => model.root.clone(),
    }
}

#[test]
fn every_effect_can_be_put_on_a_closed_loop_robot_by_name() {
    let model = drawn_loops(Shape::Planar, &mut Draw::new(5));
    for e in CATALOGUE {
        let required: Vec<(String, f64)> = e.parameters.iter().filter(|p| p.default.is_none()).map(|p| (p.name.to_string(), 0.5)).collect();
        let at = place(&model, e.place);
        let applied = Applied::try_new(&model, e.name, &at, &required).expect("required parameters suffice");
        assert_eq!(applied.place_name(&model), at);
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
