//! Contact on the 3-PRS lower-limb robot: a patient's foot as a spring on the platform, hybrid control, and an exercise of two stages.

use nalgebra::Vector3;
use pkm_ctrl::exercise::{Assistance, Channel, Exercise, ExerciseConfig, Phase, Resistance, Script, Wave};
use pkm_ctrl::force::{
    Admittance, AdmittanceConfig, ForcePidConfig, Hybrid, HybridConfig, Impedance, ImpedanceConfig, PlatformTask, TaskMap,
};
use pkm_ctrl::{Command, Controller, Input, PdGravity, PdGravityConfig, PdGravityState};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{Output, assemble, output_jacobian};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::spatial::Pose;
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, Model, math};
use pkm_sim::{Plant, ReducedPlant};
use pkm_tests::Draw;

/// Control period of the paper `[s]`.
const DT: f64 = 0.01;
/// Steps of the plant in a period.
const FINE: usize = 5;
/// Platform side, sphere to sphere `[m]`.
const L_M: f64 = 0.516_003;

fn robot() -> pkm_dyn::effects::Robot {
    let shipped = pkm_robots::find("prs3").expect("a shipped robot");
    parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("a shipped robot reads").robot
}

/// Height, turn about x and turn about y of the platform's centre.
fn task() -> PlatformTask<3> {
    let model = robot().model;
    let platform = Output::named(&model, "platform").expect("the platform");
    let centre = platform.frame.pose.compose(&Pose::from_xyz_rpy([-L_M / math::sqrt(3.0), 0.0, 0.0], [0.0; 3]));
    let centre = Output { name: "centre".into(), frame: FrameOnBody { body: platform.frame.body, pose: centre } };
    PlatformTask::try_new(model, centre, [2, 3, 4], 0.3).expect("three freedoms")
}

/// Efforts of the robot's own model along the reference, friction included, and a PD loop: what a model-based position controller is.
struct ModelBased {
    model: Model,
    pd: PdGravity<3>,
}

impl ModelBased {
    fn new() -> Self {
        let config = PdGravityConfig { kp: [10_600.0; 3], kd: [900.0; 3], tau_limit: [1500.0; 3], dt: DT, filter_s: 0.0 };
        Self { model: robot().model, pd: PdGravity::try_new(config).expect("numbers in range") }
    }
}

impl Controller<3> for ModelBased {
    type State = (Data, PdGravityState<3>);

    fn at_rest(&self) -> Self::State {
        let mut data = Data::new(&self.model);
        assert!(assemble(&self.model, &mut data).is_closed);
        (data, PdGravityState::default())
    }

    fn step(&self, (data, state): &mut Self::State, input: &Input<3>) -> Command<3> {
        let mut modelled = *input;
        if inverse_dynamics(&self.model, data, &input.q_ref, &input.v_ref, &input.a_ref).is_closed {
            for k in 0..3 {
                let joint = &self.model.joints[self.model.actuators[k]];
                let v = input.v_ref[k];
                modelled.tau_ff[k] = data.tau_act[k] + joint.viscous * v + joint.coulomb * math::tanh(v / 2e-3);
            }
        }
        self.pd.step(state, &modelled)
    }
}

/// The robot, and a foot strapped to its platform's centre.
struct World {
    plant: ReducedPlant,
    map: PlatformTask<3>,
    state: <PlatformTask<3> as TaskMap<3, 3>>::State,
    /// Of the foot: stiffness `[N/m]`, damping `[N·s/m]`, height at rest `[m]`.
    foot: [f64; 3],
    /// Additional push of the patient `[N]`.
    push: f64,
    wrench: [f64; 6],
    noise: Draw,
}

impl World {
    fn new(height: f64, foot: [f64; 3]) -> Self {
        let plant = ReducedPlant::try_new(robot(), &[height; 3]).expect("the loops close");
        let map = task();
        let state = TaskMap::<3, 3>::at_rest(&map);
        Self { plant, map, state, foot, push: 0.0, wrench: [0.0; 6], noise: Draw::new(3) }
    }

    fn q(&self) -> [f64; 3] {
        core::array::from_fn(|k| self.plant.position()[k])
    }

    /// Height, turns about x and y.
    fn pose(&mut self) -> [f64; 3] {
        let q = self.q();
        self.map.at(&mut self.state, &q).expect("the loops close").x
    }

    fn input(&mut self) -> Input<3> {
        let mut wrench = self.wrench;
        // Half a newton of noise in the load cell.
        wrench[2] += self.noise.uniform(-0.5..0.5);
        Input { wrench_meas: wrench, ..Input::standing(self.q(), DT) }
    }

    fn step(&mut self, tau: &[f64; 3]) {
        for _ in 0..FINE {
            let q = self.q();
            let here = self.map.at(&mut self.state, &q).expect("the loops close");
            let v = here.of_drives(&core::array::from_fn(|k| self.plant.velocity()[k]));
            let [k, d, z] = self.foot;
            self.wrench[2] = -k * (here.x[0] - z) - d * v[0] + self.push;
            let push = here.efforts(&[self.wrench[2], 0.0, 0.0]);
            let tau: [f64; 3] = core::array::from_fn(|i| tau[i] + push[i]);
            self.plant.step(&tau, DT / FINE as f64).expect("the plant moves on");
        }
    }
}

/// Slider heights of 0.144 m carry the level platform this much lower than the sliders.
fn level(height: f64) -> f64 {
    let mut world = World::new(height, [0.0; 3]);
    world.pose()[0]
}

fn pid() -> ForcePidConfig<3> {
    ForcePidConfig {
        kp: [2.5e-3, 0.0, 0.0],
        ki: [8e-3, 0.0, 0.0],
        kd: [0.0; 3],
        output_limit: [0.1; 3],
        rate_limit: [4.0; 3],
        filter_s: 0.02,
        dt: DT,
    }
}

const W: f64 = core::f64::consts::FRAC_PI_2;
const AMPLITUDE: f64 = 60.0;

#[test]
fn the_task_of_the_model_is_equation_15s() {
    let (map, q) = (task(), [0.12, 0.09, 0.105]);
    let mut state = TaskMap::<3, 3>::at_rest(&map);
    let here = TaskMap::<3, 3>::at(&map, &mut state, &q).expect("the loops close");
    // There and back through the inverse kinematics, and the Jacobian as its differences.
    let back: [f64; 3] = map.drives(&mut state, &here.x).expect("within reach");
    assert!((0..3).all(|k| (back[k] - q[k]).abs() < 1e-10), "{back:?}");
    for k in 0..3 {
        let mut at = |h: f64| -> [f64; 3] {
            let mut x = here.x;
            x[k] += h;
            map.drives(&mut state, &x).expect("within reach")
        };
        let (ahead, behind) = (at(1e-5), at(-1e-5));
        for i in 0..3 {
            let slope = (ahead[i] - behind[i]) / 2e-5;
            assert!((slope - here.inverse_jacobian[i][k]).abs() < 1e-5, "({i}, {k}): {slope} {here:?}");
        }
    }
    let beyond: Option<[f64; 3]> = map.drives(&mut state, &[here.x[0], 2.0, 0.0]);
    assert!(beyond.is_none());
    // Work of a moment is the same in angles and in space.
    let model = map.model().clone();
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    assert!(inverse_dynamics(&model, &mut data, &q, &[0.05, -0.03, 0.02], &[0.0; 3]).is_closed);
    let mut jacobian = nalgebra::DMatrix::zeros(6, model.nv());
    output_jacobian(&model, &data, &Output::named(&model, "platform").expect("the platform"), &mut jacobian);
    let rates = &jacobian * &nalgebra::DVector::from_column_slice(&data.v);
    let [rx, ry] = [here.x[1], here.x[2]];
    let axes = [Vector3::x(), Pose::from_xyz_rpy([0.0; 3], [rx, 0.0, 0.0]).rotation * Vector3::y()];
    let z = Pose::from_xyz_rpy([0.0; 3], [rx, 0.0, 0.0]).rotation * Pose::from_xyz_rpy([0.0; 3], [0.0, ry, 0.0]).rotation * Vector3::z();
    let turn = axes[0] * rates[3] + axes[1] * rates[4] + z * rates[5];
    let moment = Vector3::new(3.0, -2.0, 0.0);
    let mut input = Input::standing(q, DT);
    input.wrench_meas = [0.0, 0.0, 0.0, moment.x, moment.y, moment.z];
    let [forces, _] = map.forces(&input, &here);
    let about_z = moment.dot(&z) * rates[5];
    assert!((moment.dot(&turn) - (forces[1] * rates[3] + forces[2] * rates[4] + about_z)).abs() < 1e-12);
}

/// [Valera2017] hybrid control, acceptance 8: 60 N at π/2 rad/s in z, level in pitch and roll.
#[test]
fn hybrid_control_follows_a_force_sine_and_stays_level() {
    let config = HybridConfig { selection: [1.0, 0.0, 0.0], pid: pid(), travel: [0.08; 3], margin: 1e-3 };
    let controller = Hybrid::try_new(task(), ModelBased::new(), config).expect("numbers in range");
    let mut state = controller.at_rest();
    let mut world = World::new(0.144, [5000.0, 50.0, level(0.144)]);
    let (mut squares, mut count, mut tilt) = (0.0, 0.0, 0.0_f64);
    for k in 0..2000 {
        let t = DT * f64::from(k);
        let mut input = world.input();
        input.q_ref = [0.144; 3];
        // The robot presses with the sine: the environment presses back.
        input.wrench_ref[2] = -AMPLITUDE * math::sin(W * t);
        let command = controller.step(&mut state, &input);
        assert!(!command.health.is_faulted && command.health.acted.is_empty(), "{:?} at {t}", command.health);
        world.step(&command.tau);
        if t > 4.0 {
            let error = world.wrench[2] - input.wrench_ref[2];
            squares += error * error;
            count += 1.0;
        }
        let pose = world.pose();
        tilt = tilt.max(pose[1].abs()).max(pose[2].abs());
    }
    let rms = math::sqrt(squares / count);
    println!("hybrid: force error {rms:.2} N rms of {AMPLITUDE} N, tilt {:.3} deg", tilt.to_degrees());
    assert!(rms <= 0.1 * AMPLITUDE, "{rms} N");
    assert!(tilt.to_degrees() <= 0.5, "{} deg", tilt.to_degrees());
}

/// [Valera2017] active-resistive exercise: position to 0.144 m until 9 s, then 81 s of force.
#[test]
fn the_exercise_of_two_stages_is_followed_without_a_jump() {
    let (low, high) = (level(0.10), level(0.144));
    let flat = Channel::Position(Wave::constant(0.0));
    let phases = [
        Phase { duration_s: 9.0, ramp_s: 6.0, channels: [Channel::Position(Wave::constant(high)), flat, flat] },
        Phase { duration_s: 81.0, ramp_s: 1.0, channels: [Channel::Force(Wave { mean: 0.0, amplitude: AMPLITUDE, w: W }), flat, flat] },
    ];
    let script = Script::try_new(&phases).expect("phases");
    assert!((script.duration() - 90.0).abs() < 1e-12);
    let config = ExerciseConfig { script, pid: pid(), lower: [low - 0.05, -0.2, -0.2], upper: [high + 0.08, 0.2, 0.2] };
    let controller = Exercise::try_new(task(), ModelBased::new(), config).expect("numbers in range");
    let mut state = controller.at_rest();
    // The foot is strapped on where the first stage ends, and soft on the way there.
    let mut world = World::new(0.10, [0.0, 50.0, high]);
    let (mut squares, mut count, mut tilt, mut jump) = (0.0, 0.0, 0.0_f64, 0.0_f64);
    let mut last: Option<[f64; 3]> = None;
    for k in 0..9000 {
        let t = DT * f64::from(k);
        if k == 850 {
            let z = world.pose()[0];
            // Coulomb friction of 30 N is 2.8 mm of the position loop's 10.6 kN/m.
            assert!((z - high).abs() < 2.8e-3, "the height is reached: {z} of {high}");
            world.foot = [5000.0, 50.0, z];
        }
        let command = controller.step(&mut state, &world.input());
        assert!(!command.health.is_faulted && command.health.acted.is_empty(), "{:?} at {t}", command.health);
        if let Some(last) = last
            && (t - 9.0).abs() < 1.5
        {
            jump = (0..3).fold(jump, |j, i| j.max((command.tau[i] - last[i]).abs()));
        }
        last = Some(command.tau);
        world.step(&command.tau);
        if t > 12.0 {
            let error = AMPLITUDE * math::sin(W * (t - 9.0)) + world.wrench[2];
            squares += error * error;
            count += 1.0;
        }
        let pose = world.pose();
        tilt = tilt.max(pose[1].abs()).max(pose[2].abs());
    }
    assert_eq!(state.phase, Some(1));
    let rms = math::sqrt(squares / count);
    println!("exercise: force error {rms:.2} N rms, tilt {:.3} deg, largest change of an effort around 9 s {jump:.1} N", tilt.to_degrees());
    assert!(rms <= 0.1 * AMPLITUDE, "{rms} N");
    assert!(tilt.to_degrees() <= 0.5, "{} deg", tilt.to_degrees());
    assert!(jump < 60.0, "{jump} N in one period");
}

/// A steady push moves the platform by force over stiffness, of the virtual spring, or of the impedance.
#[test]
fn admittance_and_impedance_yield_as_their_springs_say() {
    let yielding = AdmittanceConfig {
        mass: [30.0, 2.0, 2.0],
        damping: [600.0, 40.0, 40.0],
        stiffness: [3000.0, 200.0, 200.0],
        travel: [0.06, 0.2, 0.2],
        speed: [0.2, 0.5, 0.5],
        dt: DT,
    };
    let admittance = Admittance::try_new(task(), ModelBased::new(), yielding).expect("numbers in range");
    let stiff = ImpedanceConfig {
        stiffness: [20_000.0, 800.0, 800.0],
        damping: [1500.0, 60.0, 60.0],
        force_limit: [600.0, 100.0, 100.0],
        tau_limit: [1500.0; 3],
        filter_s: 0.01,
        dt: DT,
    };
    let impedance = Impedance::try_new(task(), stiff).expect("numbers in range");
    let home = level(0.144);
    let mut world = World::new(0.144, [0.0, 0.0, home]);
    let mut state = admittance.at_rest();
    world.push = 60.0;
    for _ in 0..400 {
        let mut input = world.input();
        input.q_ref = [0.144; 3];
        let command = admittance.step(&mut state, &input);
        assert!(!command.health.is_faulted);
        world.step(&command.tau);
    }
    let moved = world.pose()[0] - home;
    println!("admittance: {:.2} mm of 20", 1e3 * moved);
    // Coulomb friction of 30 N in a drive leaves at most 3 mm of a position loop with 10.6 kN/m.
    assert!((moved - 0.020).abs() < 3e-3, "{moved}");
    assert!((state.x[0] - 0.020).abs() < 5e-4, "{:?}", state.x);
    let mut world = World::new(0.144, [0.0, 0.0, home]);
    let model = robot().model;
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed && inverse_dynamics(&model, &mut data, &[0.144; 3], &[0.0; 3], &[0.0; 3]).is_closed);
    let weight: [f64; 3] = core::array::from_fn(|k| data.tau_act[k]);
    let mut state = impedance.at_rest();
    world.push = -300.0;
    for _ in 0..400 {
        let mut input = world.input();
        (input.q_ref, input.tau_ff) = ([0.144; 3], weight);
        let command = impedance.step(&mut state, &input);
        assert!(!command.health.is_faulted);
        world.step(&command.tau);
    }
    let moved = world.pose()[0] - home;
    println!("impedance: {:.2} mm of -15", 1e3 * moved);
    // Three drives stick with up to 86 N together: 4.3 mm of 20 kN/m.
    assert!(moved < -0.010 && moved > -0.0155, "{moved}");
}

/// One phase in z, level otherwise, with a patient who pushes steadily: where the platform settles, against where it began, and the phase's
/// wanted force at the end.
fn settle(channel: Channel, push: f64) -> [f64; 2] {
    let home = level(0.144);
    let flat = Channel::Position(Wave::constant(0.0));
    let script = Script::try_new(&[Phase { duration_s: 30.0, ramp_s: 2.0, channels: [channel, flat, flat] }]).expect("a phase");
    let config = ExerciseConfig { script, pid: pid(), lower: [home - 0.08, -0.2, -0.2], upper: [home + 0.08, 0.2, 0.2] };
    let controller = Exercise::try_new(task(), ModelBased::new(), config).expect("numbers in range");
    let mut state = controller.at_rest();
    let mut world = World::new(0.144, [0.0, 20.0, home]);
    world.push = push;
    for _ in 0..3000 {
        let command = controller.step(&mut state, &world.input());
        assert!(!command.health.is_faulted && command.health.acted.is_empty(), "{:?}", command.health);
        world.step(&command.tau);
    }
    [world.pose()[0] - home, state.f_ref[0]]
}

/// Active-resistive: the platform goes where load and spring balance the patient's push.
#[test]
fn a_resistance_balances_the_patient_where_its_spring_says() {
    let resist = |load| Channel::Resist(Resistance { load, stiffness: 2000.0, centre: level(0.144), damping: 400.0 });
    for (load, push) in [(30.0, -50.0), (0.0, -40.0), (20.0, -20.0), (0.0, 60.0)] {
        let [moved, force] = settle(resist(load), push);
        let want = (load + push) / 2000.0;
        println!("resistance: {:.2} mm of {:.2}, {force:.1} N of {:.1}", 1e3 * moved, 1e3 * want, -push);
        assert!((moved - want).abs() < 5e-4 && (force + push).abs() < 1.5, "{load} {push}: {moved} {force}");
    }
    let heavy = Channel::Resist(Resistance { load: 0.0, stiffness: 0.0, centre: 0.0, damping: 1e5 });
    let script = Script::try_new(&[Phase { duration_s: 1.0, ramp_s: 0.5, channels: [heavy; 3] }]).expect("a phase");
    let config = ExerciseConfig { script, pid: pid(), lower: [-1.0; 3], upper: [1.0; 3] };
    assert!(Exercise::<3, 3, _, _>::try_new(task(), ModelBased::new(), config).is_err(), "a loop that would alternate");
}

/// Active-assistive: a patient who lets 40 N of leg hang on the platform is lifted as far as spring and learned help carry it; one who
/// carries the leg is let alone within the tolerance.
#[test]
fn assistance_comes_as_needed_and_is_forgotten() {
    let (tolerance, stiffness, learning, forgetting_s) = (1e-3, 8000.0, 2000.0, 3.0);
    let path = Wave::constant(level(0.144) + 0.02);
    let assist = Channel::Assist(Assistance { path, tolerance, stiffness, learning, forgetting_s, damping: 300.0, most: 120.0 });
    let [moved, force] = settle(assist, -40.0);
    let want = 0.02 - tolerance - 40.0 / (stiffness + learning * forgetting_s);
    println!("assistance: {:.2} mm of {:.2}, {force:.1} N", 1e3 * moved, 1e3 * want);
    assert!((moved - want).abs() < 5e-4 && (force - 40.0).abs() < 1.5, "{moved} {force}");
    let [moved, force] = settle(assist, 0.0);
    println!("without need: {:.2} mm of 20, {force:.1} N", 1e3 * moved);
    assert!((0.02 - moved).abs() < tolerance + 5e-4 && force.abs() < 1.5, "{moved} {force}");
}
