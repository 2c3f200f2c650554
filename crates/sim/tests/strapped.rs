//! A limb strapped to a link, against closed forms and the balance of energy.

mod fixture;

use fixture::{blocks, double_pendulum, plant, shipped};
use pkm_dyn::math;
use pkm_dyn::model::{Model, Sensor, SensorKind};
use pkm_dyn::spatial::Pose;
use pkm_sim::limb::{Impedance, Patient, PatientConfig, Strapped, Will};
use pkm_sim::{Consistent, ConstrainedPlant, Integrator, Plant, Reference, ReferenceOptions, Sample, Trajectory};

fn spring(stiffness: f64) -> Impedance {
    Impedance { stiffness, ..Impedance::FREE }
}

fn link(model: &Model, name: &str) -> usize {
    model.links.iter().position(|l| l.name == name).expect("a link of this name")
}

#[test]
fn a_block_on_a_strapped_spring_swings_as_a_sine_and_its_sensor_shows_the_spring() {
    let mut model = blocks(1, [0.0; 3]);
    let pose = Pose::from_xyz_rpy([0.0, 0.3, 0.0], [0.0; 3]);
    model.sensors.push(Sensor { name: "cell".to_string(), kind: SensorKind::Wrench, link: link(&model, "block1"), pose });
    let mut block = plant(&model, Vec::new(), &[0.1], Integrator::RungeKutta);
    block.set_velocity(&[0.2]);
    let mut axes = [Impedance::FREE; 6];
    axes[0] = spring(50.0);
    let mut strapped = Strapped::try_new(block, &model, link(&model, "block1"), axes, &[0.1]).unwrap();
    // 50 N/m and 2 kg: 5 rad/s.
    for k in 1..=4000 {
        strapped.step(&[0.0], 5e-4).unwrap();
        let x = 0.1 + 0.2 / 5.0 * math::sin(5.0 * 5e-4 * f64::from(k));
        assert!((strapped.position()[0] - x).abs() < 1e-6, "{} {x}", strapped.position()[0]);
        let wrench = strapped.sensor_wrench(0).unwrap();
        // Held since the middle of the step at up to 0.2 m/s.
        assert!((wrench.linear.x + 50.0 * (x - 0.1)).abs() < 50.0 * 0.2 * 2.6e-4, "{wrench:?}");
        // The force acts at the link's origin, 0.3 m beside the sensor.
        assert!((wrench.angular.z - 0.3 * wrench.linear.x).abs() < 1e-12);
    }
}

#[test]
fn a_strapped_limb_without_losses_keeps_energy() {
    let mut model = double_pendulum();
    model.gravity.fill(0.0);
    let mut pendulum = plant(&model, Vec::new(), &[0.3, -0.5], Integrator::RungeKutta);
    pendulum.set_velocity(&[1.0, -2.0]);
    let lower = link(&model, "lower");
    let axes = [spring(30.0), spring(0.0), spring(20.0), spring(0.0), spring(5.0), spring(0.0)];
    let mut strapped = Strapped::try_new(pendulum, &model, lower, axes, &[0.3, -0.5]).unwrap();
    // In the pendulum and in the limb.
    let energy = |s: &mut Strapped<ConstrainedPlant>| {
        let pose = s.link_motion(lower).unwrap().0;
        s.limb().energy(&pose) + s.stored_energy().unwrap()
    };
    let start = energy(&mut strapped);
    let mut worst = 0.0_f64;
    for _ in 0..6000 {
        strapped.step(&[0.0, 0.0], 5e-4).unwrap();
        worst = worst.max((energy(&mut strapped) / start - 1.0).abs());
    }
    assert!(start > 0.1 && worst < 1e-4, "{start} J, off by {worst}");
}

#[test]
fn who_assists_pushes_along_the_wanted_motion_of_his_link() {
    let model = blocks(1, [0.0; 3]);
    let block = plant(&model, Vec::new(), &[0.0], Integrator::RungeKutta);
    let config = PatientConfig { will: Will::Assists, strength: [4.0; 6], variation: 0.0, speed: 0.05, ..PatientConfig::default() };
    let strapped = Strapped::try_new(block, &model, link(&model, "block1"), [Impedance::FREE; 6], &[0.0]).unwrap();
    let mut strapped = strapped.with_patient(Some(Patient::try_new(config, 1).unwrap()));
    strapped.expect_motion(&[0.0], &[-0.5]);
    strapped.step(&[0.0], 1e-3).unwrap();
    let expected = -4.0 * 0.5 / math::hypot(0.5, 0.05) / 2.0 * 1e-3;
    assert!((strapped.velocity()[0] - expected).abs() < 1e-12, "{}", strapped.velocity()[0]);
}

#[test]
fn drives_in_surplus_go_where_the_loops_take_them() {
    let model = shipped("ups4");
    let drawn = Reference::draw(&model, &ReferenceOptions { seed: 1, period_s: 5.0, amplitude: 0.3 }).unwrap();
    let motion = Consistent::try_new(&model, Box::new(drawn)).unwrap();
    let (mut before, mut here, mut after) = (Sample::default(), Sample::default(), Sample::default());
    let mut data = pkm_dyn::Data::new(&model);
    assert!(pkm_dyn::loops::assemble(&model, &mut data).is_closed);
    for k in 0..50 {
        let (t, h) = (0.1 * f64::from(k), 1e-4);
        motion.at(t - h, &mut before);
        motion.at(t + h, &mut after);
        motion.at(t, &mut here);
        // Rates are those of the positions, also of the drive that follows.
        for j in 0..4 {
            let slope = (after.q[j] - before.q[j]) / (2.0 * h);
            assert!((slope - here.v[j]).abs() < 1e-6 * (1.0 + slope.abs()), "{slope} {}", here.v[j]);
        }
        // Loops close with all four drives there.
        assert!(pkm_dyn::loops::solve_positions(&model, &mut data, &here.q).is_closed);
        for (j, q) in model.actuators.iter().zip(&here.q) {
            assert!((data.q[*j] - q).abs() < 1e-9);
        }
    }
}
