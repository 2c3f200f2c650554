//! The constrained plant against other programs, against the reduced plant, and against itself.

mod fixture;

use core::f64::consts::PI;

use fixture::{blocks, entry, frictionless, plant, run, shipped, stated};
use pkm_dyn::effects::{Applied, Entry, JointState, Law, PlaceKind, Robot};
use pkm_dyn::loops::{internal_efforts, mid_pose};
use pkm_dyn::math;
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_sim::{ConstrainedOptions, ConstrainedPlant, ForeignLaw, Integrator, Plant, ReducedPlant, SimError};
use serde_json::Value;

static EVEN: Entry = entry("even friction", PlaceKind::LinkOrJoint, Law::JointEffort(even));
static PERSON: Entry = entry("person", PlaceKind::Link, Law::Person);

/// `a·v² + b·v`, the printed friction of [Arceo2021].
fn even(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.v * s.v + p[1] * s.v
}

/// The ankle robot with the angles of the paper: both links turn against the base.
const MOTOBOTTE: &str = r#"<robot name="motobotte"><link name="base"/>
  <link name="slider"><inertial><mass value="6.1514"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <link name="long_link"><inertial><origin xyz="-0.4646 0.125 0"/><mass value="2.1398"/>
    <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <link name="short_link"/>
  <joint name="d" type="prismatic"><parent link="base"/><child link="slider"/><origin xyz="0.461471723821609 -0.100369590953829 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="300" velocity="1"/></joint>
  <joint name="T1" type="continuous"><parent link="slider"/><child link="long_link"/><axis xyz="0 0 -1"/></joint>
  <joint name="T2" type="continuous"><parent link="base"/><child link="short_link"/><axis xyz="0 0 -1"/></joint></robot>"#;

fn motobotte() -> Model {
    let toml = "name = \"motobotte\"\nurdf = \"m.urdf\"\ngravity = [0.0, 0.0, 0.0]\nassembly = { d = 0.0747, T1 = 0.0753, T2 = -2.1945 }\n\
        loop = [{ name = \"pin\", a = { link = \"long_link\", xyz = [-0.4646, 0.125, 0.0] }, \
        b = { link = \"short_link\", xyz = [0.0, -0.1014, 0.0] }, constrain = [\"x\", \"y\"] }]\n[[actuator]]\njoint = \"d\"\n";
    parse(toml, MOTOBOTTE, ["robot.toml", "m.urdf"]).expect("the robot loads").bare
}

fn golden(text: &str) -> Value {
    serde_json::from_str(text).expect("a golden file")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

fn printed_friction() -> Vec<Applied> {
    let printed = [[56.3869, -2.8211], [-9.3843, -0.6755], [-0.0841, 0.0440]];
    let at =
        |(j, [a, b]): (usize, [f64; 2])| Applied { site: pkm_dyn::effects::Site::Joint, ..Applied::at(&EVEN, j, vec![a, b, 0.0, 0.0]) };
    printed.into_iter().enumerate().map(at).collect()
}

#[test]
fn the_ankle_robot_moves_as_its_equations_with_multipliers_do() {
    let golden = golden(include_str!("golden/motobotte.json"));
    let start = numbers(&golden["start"]);
    for run in golden["runs"].as_array().unwrap() {
        let friction = if run["has_friction"].as_bool().unwrap() { printed_friction() } else { Vec::new() };
        let mut plant = plant(&motobotte(), friction, &start[..1], Integrator::RungeKutta);
        let (times, q, v) = (numbers(&run["time"]), run["q"].as_array().unwrap(), run["v"].as_array().unwrap());
        let parts = 200;
        for i in 1..times.len() {
            let h = (times[i] - times[i - 1]) / f64::from(parts);
            for part in 0..parts {
                // The mean of the push over the step, to fourth order.
                let t = times[i - 1] + h * (f64::from(part) + 0.5);
                plant.step(&[2.0 * math::sin(5.0 * t) * (1.0 - 25.0 * h * h / 24.0)], h).unwrap();
            }
            let [have_q, have_v] = plant.tree().unwrap();
            for (have, want) in have_q.iter().chain(have_v).zip(numbers(&q[i]).iter().chain(&numbers(&v[i]))) {
                assert!((have - want).abs() < 2e-6, "t = {}: {have} {want} ({:e})", times[i], have - want);
            }
        }
    }
}

#[test]
fn the_ankle_robot_accelerates_as_published() {
    let golden = golden(include_str!("golden/motobotte.json"));
    let start = numbers(&golden["start"]);
    let mut plant = plant(&motobotte(), printed_friction(), &start[..1], Integrator::RungeKutta);
    plant.set_velocity(&[0.03]);
    let h = 1e-6;
    plant.step(&[0.0627 * 5.0], h).unwrap();
    let a = (plant.velocity()[0] - 0.03) / h;
    assert!((a - 0.030_570_769_1).abs() < 1e-6 && (a - golden["acceleration"].as_f64().unwrap()).abs() < 1e-6, "{a}");
}

#[test]
fn a_serial_arm_swings_as_it_does_in_mujoco() {
    let golden = golden(include_str!("golden/serial_arm_mujoco.json"));
    let mut model = shipped("serial_arm");
    for joint in &mut model.joints {
        joint.coulomb = 0.0;
    }
    let start = numbers(&golden["start"]);
    let tau = numbers(&golden["tau"]);
    let mut plant = plant(&model, Vec::new(), &start, Integrator::RungeKutta);
    let samples = golden["q"].as_array().unwrap();
    for (i, want) in samples.iter().enumerate() {
        if i > 0 {
            run(&mut plant, &tau, 5e-4, 200);
        }
        for (have, want) in plant.position().iter().zip(numbers(want)) {
            assert!((have - want).abs() < 1e-7, "sample {i}: {have} {want} ({:e})", have - want);
        }
    }
}

/// How friction varies.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Worn {
    Evenly,
    /// Along the stroke and in time.
    Along,
}

/// Largest difference of any drive's position between both plants along the same efforts.
fn apart(name: &str, h: f64, worn: Worn) -> f64 {
    let model = shipped(name);
    let start = mid_pose(&model);
    let joints: Vec<String> = model.actuators.iter().map(|&j| model.joints[j].name.clone()).collect();
    let held = |(j, q): (&String, &f64)| stated(&model, "spring", j, &[("stiffness", 400.0), ("rest", *q)]);
    let mut springs: Vec<Applied> = joints.iter().zip(&start).map(held).collect();
    if worn == Worn::Along {
        for (&j, q) in model.actuators.iter().zip(&start) {
            // Friction falls to nothing within a tenth of a unit on the one side.
            let slope = -10.0 * model.joints[j].coulomb;
            springs.push(stated(&model, "friction_position", &model.joints[j].name, &[("coulomb_slope", slope), ("q0", *q)]));
            springs.push(stated(&model, "friction_thermal", &model.joints[j].name, &[("rate", -0.5)]));
        }
    }
    let robot = Robot::new(model.clone(), springs.clone());
    let mut reduced = ReducedPlant::try_new(robot, &start).expect("it starts");
    let mut constrained = plant(&model, springs, &start, Integrator::Auto);
    let mut largest = 0.0_f64;
    let steps = (1.0 / h).round();
    let mut step = 0.0;
    while step < steps {
        let t = h * (step + 0.5);
        let wave = |k: usize| math::sin(2.0 * PI * (1.0 + 0.3 * k as f64) * t);
        let limit = |k: usize| model.joints[model.actuators[k]].limits.effort.min(200.0);
        let tau: Vec<f64> = (0..start.len()).map(|k| 0.2 * limit(k) * wave(k)).collect();
        reduced.step(&tau, h).expect("it moves on");
        constrained.step(&tau, h).expect("it moves on");
        for (a, b) in reduced.position().iter().zip(constrained.position()) {
            largest = largest.max((a - b).abs());
        }
        step += 1.0;
    }
    largest
}

#[test]
fn both_plants_move_alike_with_friction_in_every_joint_and_the_more_so_the_shorter_the_step() {
    for name in ["serial_arm", "five_bar", "prs3", "ups3_rpu1"] {
        // A joint that breaks loose does so at the end of a step in both: what they differ by is of first order there.
        for worn in [Worn::Evenly, Worn::Along] {
            let (coarse, fine) = (apart(name, 1e-3, worn), apart(name, 2.5e-4, worn));
            assert!(fine < 1e-4 && fine < 0.5 * coarse, "{name}, {worn:?}: {coarse:e} {fine:e}");
        }
    }
}

#[test]
fn surplus_drives_strain_the_robot_without_moving_it() {
    let model = frictionless("ups4");
    let mut data = pkm_dyn::Data::new(&model);
    assert!(pkm_dyn::loops::assemble(&model, &mut data).is_closed);
    let start: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
    let zero = vec![0.0; start.len()];
    assert!(pkm_dyn::inverse_dynamics::inverse_dynamics(&model, &mut data, &start, &zero, &zero).is_closed);
    let hold = data.tau_act.clone();
    let strain: Vec<f64> = internal_efforts(&model, &mut data).column(0).iter().copied().collect();
    let mut plant = plant(&model, Vec::new(), &start, Integrator::RungeKutta);
    let tau: Vec<f64> = hold.iter().zip(&strain).map(|(h, s)| h + 100.0 * s).collect();
    run(&mut plant, &tau, 1e-3, 100);
    for (q, s) in plant.position().iter().zip(&start) {
        assert!((q - s).abs() < 1e-9, "{:e}", q - s);
    }
    // And pushed it moves, with its loops closed and its energy that of the work.
    let mut plant = self::plant(&model, Vec::new(), &start, Integrator::RungeKutta);
    let at_rest = plant.stored_energy().unwrap();
    let tau: Vec<f64> = hold.iter().zip([15.0, -10.0, -5.0, 0.0]).map(|(h, push)| h + push).collect();
    run(&mut plant, &tau, 5e-4, 400);
    let work: f64 = plant.position().iter().zip(&start).zip(&tau).map(|((q, s), t)| t * (q - s)).sum();
    let gained = plant.stored_energy().unwrap() - at_rest;
    assert!(work.abs() > 1e-3 && (gained - work).abs() < 1e-9 * (1.0 + work.abs()) && plant.gap() < 1e-9, "{gained} {work}");
}

#[derive(Debug)]
struct Drag {
    travelled: f64,
}

impl ForeignLaw for Drag {
    fn joint(&self) -> usize {
        0
    }

    fn levels(&self, s: &JointState) -> (f64, f64) {
        (4.0 * s.v - 3.0, 4.0 * s.v + 3.0)
    }

    fn advance(&mut self, s: &JointState, h: f64) {
        self.travelled += s.v * h;
    }
}

#[test]
fn a_law_from_elsewhere_acts_as_the_same_law_of_the_catalogue() {
    let mut model = blocks(1, [0.0; 3]);
    let law: Box<dyn ForeignLaw> = Box::new(Drag { travelled: 0.0 });
    let options = ConstrainedOptions::default();
    let mut foreign = ConstrainedPlant::with_laws(Robot::new(model.clone(), Vec::new()), &[0.0], options, vec![law]).unwrap();
    model.joints[0].viscous = 4.0;
    let mut own = plant(&model, vec![fixture::coulomb(&model, "x1", 3.0)], &[0.0], Integrator::Auto);
    for k in 0..2000 {
        let push = 10.0 * math::sin(2.0 * PI * 2.0 * 1e-3 * f64::from(k));
        foreign.step(&[push], 1e-3).unwrap();
        own.step(&[push], 1e-3).unwrap();
        assert!((foreign.position()[0] - own.position()[0]).abs() < 1e-12, "step {k}");
    }
    assert!(own.position()[0] > 0.01);
    let law: Box<dyn ForeignLaw> = Box::new(Drag { travelled: 0.0 });
    let robot = Robot::new(frictionless("five_bar"), Vec::new());
    assert!(ConstrainedPlant::with_laws(robot, &[0.0], options, vec![law]).is_err());
}

#[test]
fn a_person_pushes_differently_with_every_seed_and_the_same_with_one() {
    let model = blocks(1, [0.0; 3]);
    let end = |seed: u64| {
        let robot = Robot::new(model.clone(), vec![Applied::at(&PERSON, 1, vec![10.0, 0.0, 0.0, 0.0])]);
        let mut plant = ConstrainedPlant::try_new(robot, &[0.0], ConstrainedOptions { seed, ..ConstrainedOptions::default() }).unwrap();
        run(&mut plant, &[0.0], 1e-3, 1000);
        plant.position()[0]
    };
    assert_eq!(end(1).to_bits(), end(1).to_bits());
    assert!((end(1) - end(2)).abs() > 1e-4);
}

#[test]
fn what_the_reduced_plant_has_no_state_for_it_refuses() {
    let robot = Robot::new(blocks(1, [0.0; 3]), vec![Applied::at(&PERSON, 1, vec![10.0, 0.0, 0.0, 0.0])]);
    assert!(matches!(ReducedPlant::try_new(robot, &[0.0]), Err(SimError::NoPlace { effect: "person", .. })));
}

/// FNV-1a over the bits of positions and velocities.
fn hash(plant: &mut ConstrainedPlant, steps: usize) -> u64 {
    let mut hash = 0xCBF2_9CE4_8422_2325_u64;
    let n = plant.position().len();
    for k in 0..steps {
        let tau: Vec<f64> = (0..n).map(|d| 20.0 * math::sin(0.01 * (k * (d + 1)) as f64)).collect();
        plant.step(&tau, 1e-3).expect("it moves on");
        for x in plant.position().iter().chain(plant.velocity()) {
            for byte in x.to_bits().to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
            }
        }
    }
    hash
}

/// The same in debug and release builds; a change is a change of results and needs a reason in the change log.
const HASHES: [u64; 2] = [0x0C65_8B03_0B61_B84D, 0x993D_120A_A7F3_60D3];

#[test]
fn a_motion_has_the_same_bits_as_ever() {
    let five_bar = shipped("five_bar");
    let start = mid_pose(&five_bar);
    let robots = [(blocks(2, [0.0; 3]), vec![0.0; 2], Integrator::Radau), (five_bar, start, Integrator::Auto)];
    let got = robots.map(|(model, start, integrator)| {
        let friction: Vec<Applied> = model.actuators.iter().map(|&j| fixture::coulomb(&model, &model.joints[j].name, 2.0)).collect();
        hash(&mut plant(&model, friction, &start, integrator), 400)
    });
    assert_eq!(got, HASHES, "{got:#018x?}");
}
