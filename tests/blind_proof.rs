//! The generator of the blind trials: closed forms of mechanics, and its rigid robots against those of pkm-dyn, which it does not know.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

use core::f64::consts::{PI, TAU};

use nalgebra::{DVector, Vector3};
use pkm_dyn::inverse_dynamics::inverse_dynamics_at;
use pkm_dyn::{Data, math};
use pkm_trials::case::{Level, Wish, make};
use pkm_trials::plant::Plant;
use pkm_trials::random::Stream;
use pkm_trials::reference::{drive_ratio, efforts};
use pkm_trials::robot::{Robot, urdf_with};

/// Both programs on the same closed poses and motions; the largest difference over the largest effort.
fn difference(name: &str) -> f64 {
    let plant = Plant::new(Robot::shipped(name).unwrap()).unwrap();
    let files = pkm_robots::find(name).unwrap();
    let description = pkm_dyn::urdf::parse(files.toml, files.urdf, ["robot.toml", "robot.urdf"]).unwrap();
    let model = &description.bare;
    let mut data = Data::new(model);
    let order: Vec<usize> = model.joints.iter().map(|j| plant.robot.joint(&j.name).unwrap()).collect();
    let mut random = Stream::new(1, 1, name);
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for _ in 0..50 {
        let mut q = plant.home.clone();
        for &j in &plant.free {
            let [low, high] = plant.robot.joints[j].limits;
            let span = if high > low { high - low } else { 1.0 };
            q[j] += random.uniform(-0.15, 0.15) * span;
        }
        plant.close(&mut q).unwrap();
        let x: Vec<f64> = plant.free.iter().map(|&j| random.uniform(-0.5, 0.5) * plant.robot.joints[j].speed.min(2.0)).collect();
        let a = DVector::from_fn(plant.freedoms(), |_, _| random.uniform(-3.0, 3.0));
        let m = plant.moving(&mut q, &x).unwrap();
        assert!(plant.gap(&m.pose).iter().all(|g| g.abs() < 1e-10), "{name}");
        let all = &m.ratio * &a + &m.ratio_bias;
        let ours = efforts(&drive_ratio(&plant, &m), &(&m.mass * &a + &m.bias)).unwrap();
        let of = |x: &[f64]| order.iter().map(|&i| x[i]).collect::<Vec<f64>>();
        assert!(inverse_dynamics_at(model, &mut data, &of(&q), &of(m.velocity.as_slice()), &of(all.as_slice())).is_closed, "{name}");
        for (u, t) in ours.iter().zip(data.tau_act.iter()) {
            worst = worst.max((u - t).abs());
            largest = largest.max(t.abs());
        }
    }
    assert!(largest > 0.1, "{name}: something moves");
    worst / largest
}

#[test]
fn rigid_robots_agree_with_pkm_dyn() {
    for name in ["prs3", "ups4", "serial_arm", "ups3_rpu1", "motobotte", "five_bar"] {
        let difference = difference(name);
        assert!(difference < 1e-6, "{name}: {difference}");
    }
}

const PENDULUM: &str = r#"<robot name="p"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -0.7"/><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link><joint name="hinge" type="revolute"><parent link="base"/>
<child link="bob"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="9"/></joint></robot>"#;

/// Heun's method on the plant alone: positions of the first joint every `dt`, energies at both ends.
fn swing(plant: &Plant, (mut q, mut x): (Vec<f64>, Vec<f64>), dt: f64, steps: usize) -> (Vec<f64>, [f64; 2]) {
    let slope = |q: &mut Vec<f64>, x: &[f64]| {
        let m = plant.moving(q, x).unwrap();
        let a = m.mass.clone().cholesky().unwrap().solve(&-&m.bias);
        (m.velocity.as_slice().to_vec(), a, plant.energy(&m, x).iter().sum::<f64>())
    };
    let (mut path, mut energy) = (vec![q[0]], [0.0; 2]);
    for i in 0..steps {
        let (v1, a1, e) = slope(&mut q, &x);
        energy[usize::from(i > 0)] = e;
        let mut q2: Vec<f64> = q.iter().zip(&v1).map(|(q, v)| q + dt * v).collect();
        let x2: Vec<f64> = x.iter().zip(a1.iter()).map(|(x, a)| x + dt * a).collect();
        let (v2, a2, _) = slope(&mut q2, &x2);
        q.iter_mut().zip(v1.iter().zip(&v2)).for_each(|(q, (a, b))| *q += 0.5 * dt * (a + b));
        x.iter_mut().zip(a1.iter().zip(a2.iter())).for_each(|(x, (a, b))| *x += 0.5 * dt * (a + b));
        path.push(q[0]);
    }
    (path, energy)
}

#[test]
fn a_pendulum_swings_with_its_period() {
    let robot = Robot::read("name = \"p\"\nurdf = \"p.urdf\"\n[[actuator]]\njoint = \"hinge\"\n", PENDULUM).unwrap();
    let plant = Plant::new(robot).unwrap();
    let dt = 2e-4;
    let amplitude = 0.3_f64;
    let (path, energy) = swing(&plant, (vec![amplitude], vec![0.0]), dt, 12_000);
    let crossings: Vec<f64> = path
        .windows(2)
        .enumerate()
        .filter(|(_, w)| w[0] > 0.0 && w[1] <= 0.0)
        .map(|(i, w)| dt * (i as f64 + w[0] / (w[0] - w[1])))
        .collect();
    // T = 4 K(sin(θ₀/2))·√(l/g), with the arithmetic-geometric mean: T = 2π·√(l/g)/agm(1, cos(θ₀/2)).
    let (mut a, mut b) = (1.0, math::cos(amplitude / 2.0));
    for _ in 0..6 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    let period = TAU * (0.7_f64 / 9.81).sqrt() / a;
    assert!(((crossings[1] - crossings[0]) / period - 1.0).abs() < 1e-6, "{crossings:?} {period}");
    assert!(((energy[1] - energy[0]) / (2.0 * 9.81 * 0.7)).abs() < 1e-6);
}

#[test]
fn a_free_robot_with_loops_keeps_its_energy_and_its_loops_closed() {
    for name in ["prs3", "five_bar"] {
        let plant = Plant::new(Robot::shipped(name).unwrap()).unwrap();
        let start = vec![0.05; plant.freedoms()];
        let mut q = plant.home.clone();
        plant.close(&mut q).unwrap();
        let scale = {
            let m = plant.moving(&mut q.clone(), &start).unwrap();
            plant.energy(&m, &start)[0]
        };
        // Short: without drives the sliders of the 3-PRS fall. Sixteen times the steps, a 256th of the error of Heun's method at least.
        let drift = |steps: u32| {
            let (_, e) = swing(&plant, (q.clone(), start.clone()), 0.08 / f64::from(steps), usize::try_from(steps).unwrap());
            ((e[1] - e[0]) / scale).abs()
        };
        let fine = drift(3200);
        assert!(fine < 1e-5, "{name}: {fine}");
    }
}

#[test]
fn changed_inertias_survive_the_way_through_a_file() {
    let files = pkm_robots::find("serial_arm").unwrap();
    let mut robot = Robot::read(files.toml, files.urdf).unwrap();
    for (i, j) in robot.joints.iter_mut().enumerate() {
        j.inertia = j.inertia.times(1.0 + 0.1 * i as f64);
        j.coulomb *= 1.3;
    }
    let back = Robot::read(files.toml, &urdf_with(&robot, files.urdf).unwrap()).unwrap();
    for (a, b) in robot.joints.iter().zip(&back.joints) {
        let difference = a.inertia.numbers().iter().zip(b.inertia.numbers()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-12 && (a.coulomb - b.coulomb).abs() < 1e-12, "{}", a.name);
    }
}

#[test]
fn a_rocking_base_is_a_pendulum_of_the_whole_robot() {
    // About a vertical axis gravity does nothing: the frozen arm on a torsion spring swings with √(k/I).
    let robot = Robot::shipped("serial_arm").unwrap();
    let rocking = Plant::rocking(&robot, Vector3::z()).unwrap();
    let mut q = rocking.home.clone();
    let m = rocking.moving(&mut q, &vec![0.0; rocking.freedoms()]).unwrap();
    // Turning the base and turning joint 1 about the same axis move the same matter; the rotor is not part of the arm.
    let still = Plant::new(robot).unwrap();
    let arm = still.moving(&mut still.home.clone(), &vec![0.0; still.freedoms()]).unwrap();
    assert!((m.mass[(0, 0)] - (arm.mass[(0, 0)] - still.rotors[0])).abs() < 1e-9);
}

#[test]
fn a_case_is_the_same_every_time_and_different_from_the_next() {
    let wish = |number| Wish {
        number,
        seed: 5,
        level: Level::L1,
        robot: "motobotte".to_string(),
        size: 4.0,
        noise: 1.0,
        recordings: 2,
        effect: Some("spring".to_string()),
    };
    let (a, b, c) = (make(&wish(1)).unwrap(), make(&wish(1)).unwrap(), make(&wish(2)).unwrap());
    assert!(a.files == b.files && a.answer == b.answer && a.answer.salt != c.answer.salt && a.files != c.files);
    let spring = &a.answer.concealed[0];
    assert!((spring.size.unwrap() / 4.0 - 1.0).abs() < 0.2 && spring.place == ["d"], "{spring:?}");
    // What is public says nothing of what is concealed.
    for (name, text) in a.files.iter().filter(|(name, _)| !name.ends_with(".csv")) {
        assert!(!text.contains("spring") && !text.contains("[[effect]]"), "{name}");
    }
}

#[test]
fn streams_are_not_those_of_a_neighbour() {
    let mut sum = 0.0;
    let (mut a, mut b) = (Stream::new(1, 1, "x"), Stream::new(1, 2, "x"));
    for _ in 0..10_000 {
        sum += a.normal() * b.normal();
    }
    // Correlation of independent normal numbers: 1/√n; five of it.
    assert!((sum / 10_000.0).abs() < 5.0 / 100.0);
    assert!(a.uniform(0.0, PI) >= 0.0);
}
