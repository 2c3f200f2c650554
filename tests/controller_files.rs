//! Controllers from files: the same bits as built in code, every example of the documentation, every refusal.

use core::fmt::Write;

use pkm_ctrl::catalogue::{ALL, Drives, Entry, Visit, every};
use pkm_ctrl::config::{CONTACT, parse};
use pkm_ctrl::{Controller, FaultCode, Input, Limit, Signals};
use pkm_dyn::effects::Robot;
use pkm_tests::closed_loop::{Sines, shipped_robot, tuning};

/// An input as what a controller of any number of drives sees.
fn signals<const N: usize>(input: &Input<N>) -> Signals<'_> {
    Signals {
        dt: input.dt,
        q_dt: input.q_dt,
        q_meas: &input.q_meas,
        tau_meas: &input.tau_meas,
        wrench_meas: input.wrench_meas,
        q_ref: &input.q_ref,
        v_ref: &input.v_ref,
        a_ref: &input.a_ref,
        wrench_ref: input.wrench_ref,
        tau_ff: &input.tau_ff,
    }
}

/// A motion that is followed badly.
fn input<const N: usize>(motion: &Sines<N>, k: u32) -> Input<N> {
    let t = 1e-3 * f64::from(k);
    let ([q_ref, v_ref, a_ref], [q_meas, _, _]) = (motion.at(t), motion.at(t - 0.004));
    Input { q_ref, v_ref, a_ref, tau_ff: [3.0; N], tau_meas: [2.5; N], ..Input::standing(q_meas, 1e-3) }
}

struct Compares<'r, const N: usize> {
    robot: &'r Robot,
    motion: Sines<N>,
    visited: usize,
}

impl<const N: usize> Visit<N> for Compares<'_, N> {
    fn visit<C: Controller<N>>(&mut self, entry: &'static Entry, controller: &C) {
        let mut text = format!("law = {:?}\nrate_hz = 1000\nbandwidth = 25\n", entry.name);
        if entry.drives == Drives::Voltage {
            text.push_str("b0 = 1\n");
        }
        text.push_str("[limits]\nu_limit = 1e4\nq_lower = -inf\nq_upper = inf\nv_limit = inf\n");
        let mut running = parse(&text, "c.toml", self.robot).expect("a controller");
        assert_eq!((running.about().name.as_str(), running.about().drives, running.about().n_drives), (entry.name, entry.drives, N));
        for _ in 0..2 {
            let (mut state, mut tau) = (controller.at_rest(), [0.0; N]);
            for k in 0..300 {
                let input = input(&self.motion, k);
                let wanted = controller.step(&mut state, &input);
                let health = running.step(&signals(&input), &mut tau);
                assert_eq!(tau.map(f64::to_bits), wanted.tau.map(f64::to_bits), "{} {k}", entry.name);
                assert_eq!((health.is_faulted, running.health()), (false, health), "{} {k}", entry.name);
            }
            running.reset();
        }
        self.visited += 1;
    }
}

fn compared<const N: usize>(name: &str) {
    let robot = shipped_robot(name);
    let mut compares = Compares { robot: &robot, motion: Sines::<N>::about_the_middle(&robot, 0.02), visited: 0 };
    every(&robot, &tuning::<N>(&robot, 25.0, 1e-3), &mut compares).expect("all can be built");
    assert_eq!(compares.visited, ALL.len());
}

#[test]
fn every_law_of_the_catalogue_gives_the_same_bits_from_a_file() {
    compared::<1>("motobotte");
    compared::<2>("five_bar");
    compared::<3>("prs3");
    compared::<4>("ups3_rpu1");
    compared::<6>("serial_arm");
}

#[test]
fn every_law_has_an_example_that_is_read() {
    let robot = shipped_robot("prs3");
    let examples = pkm_tests::examples("controllers");
    let mut laws = Vec::new();
    for (name, text) in &examples {
        let controller = parse(text, name, &robot).expect(name);
        laws.push(controller.about().name.clone());
    }
    for law in ALL.iter().map(|e| e.name).chain(CONTACT) {
        assert!(laws.iter().any(|l| l == law), "{law}");
    }
}

/// Effort of the first step of `text` on the 3-PRS, off by 1 mm at 10 mm/s, wanted efforts 300 N, measured ones 280 N.
fn first(text: &str, wrench_meas: [f64; 6]) -> [f64; 3] {
    let mut running = parse(text, "c.toml", &shipped_robot("prs3")).expect("a controller");
    let input = Input {
        q_ref: [0.151; 3],
        v_ref: [0.01; 3],
        tau_ff: [300.0; 3],
        tau_meas: [280.0; 3],
        wrench_meas,
        ..Input::standing([0.15; 3], 1e-3)
    };
    let mut tau = [0.0; 3];
    assert!(!running.step(&signals(&input), &mut tau).is_faulted);
    tau
}

fn near(tau: [f64; 3], wanted: [f64; 3]) {
    assert!(tau.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{tau:?} {wanted:?}");
}

#[test]
fn laws_of_contact_do_what_their_equations_say() {
    let head = "rate_hz = 1000\n";
    let force = "[force]\nkp = [0.5, 0.25, 1]\n";
    // tau_ff + kp·(tau_ff − tau_meas).
    near(first(&format!("law = \"explicit_force\"\n{head}{force}"), [0.0; 6]), [310.0, 305.0, 320.0]);
    // tau_ff + K·e + D·e'.
    near(first(&format!("law = \"impedance\"\n{head}stiffness = [1e4, 2e4, 0]\ndamping = 100"), [0.0; 6]), [311.0, 321.0, 301.0]);
    // (I + K)·tau_ff − K·tau_meas with the same gain in every direction.
    let unit = "inertia = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]";
    near(first(&format!("law = \"actuator_force\"\n{head}gain = 0.5\n{unit}"), [0.0; 6]), [310.0; 3]);
    // Of a force from outside the drives' own task takes tau_ff − tau_meas = 20 N: 2 kg move by 20/2·dt²/2, at 20/2·dt.
    let inner = "[inner]\nlaw = \"pd_gravity\"\nkp = 1e4\nkd = 100";
    let numbers = "mass = 2\ndamping = 0\nstiffness = 0\ntravel = 1\nspeed = 1";
    let wanted = 300.0 + 1e4 * (0.001 + 5e-6) + 100.0 * (0.01 + 0.01);
    near(first(&format!("law = \"admittance\"\n{head}{numbers}\n{inner}"), [0.0; 6]), [wanted; 3]);
    // A linear task: x = q1, a force of 4 N along it moves the first drive by kp·4·dt.
    let task = "[task]\nkind = \"linear\"\ncomponents = [\"fx\", \"fy\", \"fz\"]\nq_0 = 0.15\nx_0 = 0\n\
                inverse_jacobian = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n";
    let hybrid = format!("law = \"hybrid\"\n{head}selection = [1, 0, 0]\ntravel = 0.1\n[force]\nkp = 0.01\n{task}{inner}");
    let (moved, still) = (300.0 + 1e4 * (0.001 + 4e-5) + 100.0 * (0.01 + 0.04), 300.0 + 1e4 * 0.001 + 100.0 * 0.01);
    near(first(&hybrid, [4.0, 5.0, 6.0, 0.0, 0.0, 0.0]), [moved, still, still]);
}

#[test]
fn limits_of_the_robot_act_unless_the_file_has_others() {
    let robot = shipped_robot("prs3");
    let step = |text: &str, q_ref: f64, q_meas: f64| {
        let mut running = parse(text, "c.toml", &robot).expect("a controller");
        let mut tau = [0.0; 3];
        let input = Input { q_ref: [q_ref; 3], tau_ff: [300.0; 3], ..Input::standing([q_meas; 3], 1e-3) };
        (running.step(&signals(&input), &mut tau), tau)
    };
    let law = "law = \"pd_gravity\"\nrate_hz = 1000\nkp = 1e5\nkd = 0\n";
    let (health, tau) = step(law, 0.2, 0.15);
    assert!(health.is_saturated && health.acted.is_empty(), "{health:?}");
    near(tau, [1500.0; 3]);
    let (health, tau) = step(&format!("{law}[limits]\ntau_limit = [200, 400, 500]\nq_upper = 0.18"), 0.2, 0.15);
    assert!(health.acted.at(Limit::Position, 1), "{health:?}");
    near(tau, [200.0, 400.0, 500.0]);
    // The joint ends at 0.3 m; a centimetre beyond that is a fault, and the weight is carried from the first step on.
    let (health, tau) = step(law, 0.3, 0.3101);
    let fault = health.fault.expect("outside");
    assert_eq!((fault.code, fault.drive, fault.value, tau), (FaultCode::Position, 0, 0.3101, [300.0; 3]));
    assert!(step(&format!("{law}[limits]\nq_tolerance = 0.02"), 0.3, 0.3101).0.fault.is_none());
}

#[test]
fn friction_is_left_out_where_the_file_says_so() {
    let robot = shipped_robot("prs3");
    assert!(robot.model.joints[robot.model.actuators[0]].coulomb > 0.0);
    let effort = |more: &str| {
        let text = format!("law = \"computed_torque\"\nrate_hz = 1000\nbandwidth = 20\n[friction]\n{more}");
        let mut running = parse(&text, "c.toml", &robot).expect("a controller");
        let mut tau = [0.0; 3];
        let input = Input { v_ref: [0.05; 3], ..Input::standing([0.15; 3], 1e-3) };
        running.step(&signals(&input), &mut tau);
        tau[0]
    };
    let joint = &robot.model.joints[robot.model.actuators[0]];
    let whole = effort("creep = 0");
    assert!((whole - effort("compensate = \"none\"") - joint.coulomb - 0.05 * joint.viscous).abs() < 1e-6);
    // At standstill the estimate is zero: its dry friction is not compensated.
    assert!((whole - effort("velocity = \"estimate\"") - joint.coulomb - 0.05 * joint.viscous).abs() < 1e-6);
}

#[test]
fn a_wrong_file_is_refused_in_one_line_that_names_the_place() {
    let robot = shipped_robot("prs3");
    let pd = "law = \"pd_gravity\"\nrate_hz = 1000\n";
    let cases: [(String, &str); 24] = [
        ("law = ".into(), "c.toml:1: "),
        (String::new(), "c.toml:1: rate_hz is missing (must be 1 to 1e5 Hz)"),
        ("rate_hz = 1000".into(), "c.toml:1: law is missing (must be a text)"),
        ("rate_hz = 0\nlaw = \"pid\"".into(), "c.toml:1: rate_hz = 0 (must be 1 to 1e5 Hz)"),
        ("rate_hz = \"fast\"".into(), "c.toml:1: rate_hz = \"fast\" (must be 1 to 1e5 Hz)"),
        ("rate_hz = 1000\nlaw = \"bang\"".into(), "c.toml:2: law = \"bang\" (must be one of: pd_gravity, pd_model, pid, "),
        (pd.into(), "c.toml:1: gains are missing (state kp and kd, or bandwidth)"),
        (format!("{pd}kp = -1\nkd = 1"), "c.toml:3: kp = -1 (must be finite and >= 0)"),
        (format!("{pd}kp = [1, 2, nan]\nkd = 1"), "c.toml:3: kp = nan (must be finite and >= 0)"),
        (format!("{pd}kp = [1, 2]\nkd = 1"), "c.toml:3: kp = [1, 2] (must be one number or 3)"),
        (format!("{pd}bandwidth = 10\n\nki = 3"), "c.toml:5: ki is unknown (has: bandwidth, filter_s, friction, kd, kp, law, limits, rate_hz)"),
        (format!("{pd}bandwidth = 10\n[limits]\ntau_limit = 0"), "c.toml:5: limits.tau_limit = 0 (must be finite and > 0)"),
        (format!("{pd}bandwidth = 10\n[limits]\ntau = 1"), "c.toml:5: limits.tau is unknown (has: brake, "),
        (format!("{pd}bandwidth = 10\n[limits]\nq_lower = 2"), "c.toml:5: drive 0: q_upper - q_lower = -1.7 (must be > 0)"),
        (format!("{pd}bandwidth = 10\n[limits]\nsafe = \"off\""), "c.toml:5: limits.safe = \"off\" (must be one of: zero, weight, damped, ramp)"),
        (format!("{pd}bandwidth = 10\nlimits = 3"), "c.toml:4: limits = 3 (must be a table)"),
        ("law = \"pid\"\nrate_hz = 1000\nkp = 1\nki = 1\nkd = 1".into(), "c.toml:1: observer: time_s is missing"),
        ("law = \"pid\"\nrate_hz = 1000\nbandwidth = 1\n[observer]\nkind = \"x\"".into(), "c.toml:5: observer.kind = \"x\" (must be one of: first_diff"),
        ("law = \"pid\"\nrate_hz = 1000\nbandwidth = 1\n[observer]\nkind = \"kalman\"\nsigma_q = 1".into(), "c.toml:4: observer.sigma_a is missing"),
        ("law = \"computed_torque_dae\"\nrate_hz = 1000\nbandwidth = 9\nb0 = 1".into(), "limits.u_limit is missing (must be finite and > 0, in V)"),
        ("law = \"hybrid\"\nrate_hz = 1000".into(), "c.toml:1: selection is missing (must be 0 to 1)"),
        (
            "law = \"impedance\"\nrate_hz = 1000\nstiffness = 1\ndamping = 1\n[task]\nkind = \"platform\"\nlink = \"no\"\ncomponents = [\"x\", \"y\", \"z\"]".into(),
            "c.toml:5: task.link: \"no\" is no link, sensor or loop of the robot",
        ),
        (
            "law = \"impedance\"\nrate_hz = 1000\nstiffness = 1\ndamping = 1\n[task]\nkind = \"platform\"\nlink = \"platform\"\ncomponents = [\"x\"]".into(),
            "task.components has 1 names (must be 2 or 3 for 3 drives)",
        ),
        (
            "law = \"admittance\"\nrate_hz = 1000\nmass = 1\ndamping = 1\nstiffness = 1\ntravel = 1\nspeed = 1\n[inner]\nlaw = \"hybrid\"".into(),
            "c.toml:8: law \"hybrid\" cannot be used here",
        ),
    ];
    for (text, part) in cases {
        let told = parse(&text, "c.toml", &robot).err().expect(&text).to_string();
        assert!(told.contains(part) && told.lines().count() == 1, "{text}\n{told}\n{part}");
    }
}

/// What is not a controller must be an error, not a panic: every example cut off and with one byte changed.
#[test]
fn damaged_files_are_refused_or_read_but_never_panic() {
    let robot = shipped_robot("five_bar");
    let mut told = String::new();
    for (name, text) in pkm_tests::examples("controllers") {
        for cut in (0..text.len()).step_by(37) {
            let (head, tail) = text.split_at((0..=cut).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0));
            let changed = format!("{head}\u{0}{tail}").replace('\u{0}', "9");
            for text in [head, changed.as_str()] {
                if let Err(e) = parse(text, &name, &robot) {
                    writeln!(told, "{e}").expect("a string");
                }
            }
        }
    }
    assert!(told.lines().all(|line| line.starts_with("docs/") || line.contains(".toml")), "{told}");
}
