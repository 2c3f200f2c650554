//! Parameters identified from simulated recordings: what is true comes back, what is built from it is physical, and motion that shows
//! too little is said to.

use core::f64::consts::PI;
use core::slice::from_ref;

use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Data, Model, math};
use pkm_ident::columns::{Columns, Quantity};
use pkm_ident::estimate::Method;
use pkm_ident::note::{Note, Status};
use pkm_ident::observation::RowOptions;
use pkm_ident::refine::identified;
use pkm_ident::{Identification, Intervals, Recording, Settings, Term, identify};
use pkm_sim::{Reference, ReferenceOptions, Sample, Scenario, run};
use pkm_tests::Draw;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load")
}

/// The robot with other masses, rotors and friction: every body is scaled and carries a lump somewhere.
fn another(model: &Model, draw: &mut Draw) -> Model {
    let mut out = model.clone();
    for link in model.massive_links() {
        let p = model.links[link].parameters;
        let (com, _) = p.centre_of_mass();
        let at = com + draw.direction() * 0.05;
        let lump = InertialParameters::from_centre_of_mass(0.2 * p.mass, at, nalgebra::Matrix3::zeros());
        let scaled = InertialParameters::from_vector(&(p.to_vector() * draw.uniform(0.7..1.3)));
        out.set_link_parameters(link, scaled.joined(&lump));
    }
    for &j in &model.actuators {
        let joint = &mut out.joints[j];
        joint.viscous *= draw.uniform(0.6..1.6);
        joint.coulomb *= draw.uniform(0.6..1.6);
        joint.armature *= draw.uniform(0.8..1.2);
    }
    out
}

fn settings(method: Method) -> Settings {
    Settings { method, ..Settings::default() }
}

fn go(robot: &Robot, fit: &[Recording], holdout: &[Recording], settings: &Settings) -> Identification {
    identify(robot, fit, holdout, settings, &mut |_| {}).expect("recordings of this robot")
}

/// Errors of a robot on recordings of it, drive by drive: what no estimate can be better than.
fn own_errors(truth: &Robot, test: &Recording) -> Vec<f64> {
    let answer = go(truth, from_ref(test), from_ref(test), &settings(Method::Wls));
    answer.joints.iter().map(|j| j.nominal).collect()
}

fn lowest_eigenvalue(answer: &Identification) -> f64 {
    let of = |l: usize| Columns::inertial(&answer.theta, l).pseudo_inertia().symmetric_eigenvalues().min();
    (0..answer.columns.links.len()).map(of).fold(f64::INFINITY, f64::min)
}

/// Two motions of a robot that differs from `description` in every number, as its recorder wrote them.
fn recorded(description: &Description, truth: &Robot, seconds: f64) -> [Recording; 2] {
    [1, 2].map(|seed| {
        let scenario = Scenario { seed, duration_s: seconds, ..Scenario::default() };
        run(truth, &description.robot, &scenario, &mut |_| {}).expect("the robot can be simulated")
    })
}

#[test]
fn a_parallel_robot_with_friction_comes_back_and_can_be_built() {
    let description = shipped("prs3");
    let truth = Robot::new(another(&description.bare, &mut Draw::new(5)), Vec::new());
    let [train, test] = recorded(&description, &truth, 15.0);
    let answer = go(&description.robot, from_ref(&train), from_ref(&test), &settings(Method::Sdp));
    println!("{:?} {:?} {:#?}", answer.status, answer.notes, answer.joints);
    assert_eq!(answer.status, Status::Identified, "{:?}", answer.notes);
    assert_eq!((answer.base.structural, answer.base.shown), (answer.base.shown, answer.base.structural));
    assert!(lowest_eigenvalue(&answer) > 0.0);
    for (p, value) in answer.columns.list.iter().zip(&answer.theta) {
        let is_bound = matches!(p.quantity, Quantity::Viscous { .. } | Quantity::Coulomb { .. } | Quantity::Rotor { .. });
        assert!(!is_bound || *value >= 0.0, "{} = {value}", p.name);
    }
    for (j, own) in answer.joints.iter().zip(own_errors(&truth, &test)) {
        assert!(j.nominal > 1.5 * j.identified && j.identified < 1.1 * own, "{}: {} -> {}, truth {own}", j.joint, j.nominal, j.identified);
    }
    for &j in &truth.model.actuators {
        let joint = &truth.model.joints[j];
        let got = |what: &str| answer.theta[answer.columns.index(&format!("{}.{what}", joint.name)).expect("a column")];
        assert!((got("coulomb") / joint.coulomb - 1.0).abs() < 0.03, "{}: {} of {}", joint.name, got("coulomb"), joint.coulomb);
        assert!((got("viscous") / joint.viscous - 1.0).abs() < 0.03, "{}: {} of {}", joint.name, got("viscous"), joint.viscous);
    }
    // Without friction columns the residual is at least twice as large [Valera2017].
    let mut smooth = description.robot.clone();
    for joint in &mut smooth.model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    let held = Settings { held: vec![Term::Friction, Term::PassiveFriction], ..Settings::default() };
    let without = go(&smooth, &[train], from_ref(&test), &held);
    assert!(without.pooled(|j| j.fitted) > 2.0 * answer.pooled(|j| j.fitted));
    // The files that are written are that robot.
    let [toml, urdf] = identified(&description, &answer).texts(&description, "a.urdf").expect("it can be written");
    let built = parse(&toml, &urdf, ["a.toml", "a.urdf"]).expect("it can be read");
    let rows = RowOptions { band_hz: Some(answer.band_hz), ..RowOptions::default() };
    let again = go(&built.robot, from_ref(&test), from_ref(&test), &Settings { rows, ..settings(Method::Wls) });
    for (a, b) in answer.joints.iter().zip(&again.joints) {
        assert!((a.identified - b.nominal).abs() < 1e-6, "{}: {} written, {} read", a.joint, a.identified, b.nominal);
    }
}

// ---- two hinges, whose recordings are made without a simulator: positions exact, effort as the equations say

const RIG_TOML: &str = "name = \"rig\"\nurdf = \"rig.urdf\"\n[[actuator]]\njoint = \"j1\"\nrotor_inertia = 0.05\n[[actuator]]\njoint = \"j2\"\nrotor_inertia = 0.02\n";
const RIG_URDF: &str = r#"<robot name="rig"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="hand"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.005"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.2" velocity="6" effort="80"/><dynamics damping="0.4" friction="0.5"/></joint>
<joint name="j2" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.4" upper="1.4" velocity="6" effort="40"/><dynamics damping="0.2" friction="0.3"/></joint></robot>
"#;

fn rig() -> Description {
    parse(RIG_TOML, RIG_URDF, ["rig.toml", "rig.urdf"]).expect("the rig loads")
}

/// A motion to be recorded, and what spoils the effort.
struct Made {
    seed: u64,
    seconds: f64,
    rate: f64,
    /// Standard deviation of a first-order coloured noise, as a share of each effort's rms, and its correlation from sample to sample.
    noise: [f64; 2],
}

fn normal(draw: &mut Draw) -> f64 {
    (0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0
}

/// What a recorder would write of `truth` on a drawn motion.
fn made(truth: &Model, options: &Made) -> Recording {
    let motion = Reference::draw(truth, &ReferenceOptions { seed: options.seed, period_s: 5.0, amplitude: 0.6 }).expect("a motion");
    made_along(truth, options, &mut |t, sample| motion.at(t, sample))
}

fn made_along(truth: &Model, options: &Made, motion: &mut dyn FnMut(f64, &mut Sample)) -> Recording {
    let mut data = Data::new(truth);
    let mut sample = Sample::default();
    let mut out = Recording { name: "made".to_string(), ..Recording::default() };
    let n_act = truth.n_act();
    let (mut q, mut tau) = (vec![Vec::new(); n_act], vec![Vec::new(); n_act]);
    let steps = (0..).map(|i| f64::from(i) / options.rate).take_while(|t| *t <= options.seconds);
    for t in steps {
        motion(t, &mut sample);
        if out.time.is_empty() {
            assert!(assemble(truth, &mut data).is_closed && walk_to(truth, &mut data, &sample.q).is_closed);
        }
        assert!(inverse_dynamics(truth, &mut data, &sample.q, &sample.v, &sample.a).is_closed);
        for (k, &j) in truth.actuators.iter().enumerate() {
            let joint = &truth.joints[j];
            q[k].push(sample.q[k]);
            tau[k].push(data.tau_act[k] + joint.viscous * sample.v[k] + joint.coulomb * math::sign(sample.v[k]));
        }
        out.time.push(t);
    }
    let mut draw = Draw::new(options.seed.wrapping_mul(77).wrapping_add(13));
    for (k, &j) in truth.actuators.iter().enumerate() {
        let rms = (tau[k].iter().map(|t| t * t).sum::<f64>() / tau[k].len() as f64).sqrt();
        let [size, colour] = options.noise;
        let drive = size * rms * (1.0 - colour * colour).sqrt();
        let mut e = size * rms * normal(&mut draw);
        for t in &mut tau[k] {
            *t += e;
            e = colour * e + drive * normal(&mut draw);
        }
        let name = &truth.joints[j].name;
        out.signals.insert(format!("q.{name}"), q[k].clone());
        out.signals.insert(format!("tau.{name}"), tau[k].clone());
    }
    out
}

const SHORT: Made = Made { seed: 1, seconds: 12.0, rate: 250.0, noise: [0.02, 0.0] };

#[test]
fn every_method_finds_the_rig() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let [train, test] = [1, 2].map(|seed| made(&truth, &Made { seed, ..SHORT }));
    let own = own_errors(&Robot::new(truth.clone(), Vec::new()), &test);
    let own = (own.iter().map(|e| e * e).sum::<f64>() / own.len() as f64).sqrt();
    for method in Method::ALL {
        let answer = go(&description.robot, from_ref(&train), from_ref(&test), &settings(method));
        println!(
            "{method:?}: {:?} {:.4} -> {:.4}, truth {own:.4}",
            answer.status,
            answer.pooled(|j| j.nominal),
            answer.pooled(|j| j.identified)
        );
        println!("{:?} {}", answer.notes, answer.prior_weight);
        assert!(answer.pooled(|j| j.identified) < 1.1 * own && answer.pooled(|j| j.nominal) > 0.15, "{method:?}");
        assert!(lowest_eigenvalue(&answer) > 0.0, "{method:?}");
    }
}

#[test]
fn the_same_recordings_give_the_same_bits() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let train = made(&truth, &SHORT);
    let [a, b] = [(), ()].map(|()| go(&description.robot, from_ref(&train), &[], &settings(Method::Sdp)));
    assert_eq!((a.theta, a.parameters), (b.theta, b.parameters));
}

#[test]
fn a_known_load_and_a_tilted_base_of_a_recording_are_no_part_of_the_robot() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let mut loaded = truth.clone();
    let hand = truth.link_index("hand").expect("hand");
    let load = InertialParameters::from_centre_of_mass(0.7, [0.1, 0.0, 0.05].into(), nalgebra::Matrix3::zeros());
    loaded.set_link_parameters(hand, truth.links[hand].parameters.joined(&load));
    loaded.gravity = [3.0, 0.0, -9.34].into();
    let mut train = made(&loaded, &SHORT);
    train.meta.gravity = Some([3.0, 0.0, -9.34]);
    train.meta.load = Some(pkm_ident::KnownLoad { link: "hand".to_string(), mass: 0.7, xyz: [0.1, 0.0, 0.05] });
    let test = made(&truth, &Made { seed: 2, ..SHORT });
    let own = own_errors(&Robot::new(truth, Vec::new()), &test);
    let answer = go(&description.robot, &[train], &[test], &settings(Method::Sdp));
    assert!(answer.joints.iter().zip(&own).all(|(j, own)| j.identified < 1.1 * own), "{own:?} {:?}", answer.joints);
}

// ---- results are values

fn says(answer: &Identification, is: fn(&Note) -> bool) -> bool {
    answer.notes.iter().any(is)
}

#[test]
fn an_axis_that_stands_still_keeps_its_nominal_parameters() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let motion = Reference::draw(&truth, &ReferenceOptions { seed: 1, period_s: 5.0, amplitude: 0.6 }).expect("a motion");
    let train = made_along(&truth, &SHORT, &mut |t, s| {
        motion.at(t, s);
        (s.q[1], s.v[1], s.a[1]) = (0.3 + 1e-4 * math::sin(300.0 * t), 0.0, 0.0);
    });
    let answer = go(&description.robot, &[train], &[], &settings(Method::Sdp));
    assert_eq!(answer.status, Status::Doubtful);
    assert!(answer.notes.iter().any(|n| matches!(n, Note::StandsStill { joint, .. } if joint == "j2")), "{:?}", answer.notes);
    for what in ["coulomb", "viscous", "rotor_inertia", "offset"] {
        let i = answer.columns.index(&format!("j2.{what}")).expect("a column");
        assert!((answer.theta[i] - answer.columns.list[i].nominal).abs() < 1e-12, "j2.{what}");
    }
    assert!(answer.joints[0].identified < 0.03, "{:?}", answer.joints[0]);
}

#[test]
fn a_robot_that_does_not_move_is_not_identified() {
    let description = rig();
    let train = made_along(&description.bare, &SHORT, &mut |_, s| {
        *s = Sample { q: vec![0.2, 0.3], v: vec![0.0; 2], a: vec![0.0; 2] };
    });
    let answer = go(&description.robot, &[train], &[], &settings(Method::Sdp));
    assert_eq!(answer.status, Status::NotIdentified);
    assert!(says(&answer, |n| matches!(n, Note::NoMotion)), "{:?}", answer.notes);
    assert_eq!(answer.theta, answer.columns.nominal());
}

#[test]
fn too_short_a_recording_is_not_identified() {
    let description = rig();
    let train = made(&description.bare, &Made { seconds: 1.2, ..SHORT });
    let held = Settings { rows: RowOptions { band_hz: Some(4.0), ..RowOptions::default() }, ..Settings::default() };
    let answer = go(&description.robot, &[train], &[], &held);
    assert_eq!(answer.status, Status::NotIdentified);
    assert!(says(&answer, |n| matches!(n, Note::FewRows { rows, limit, .. } if rows < limit)), "{:?}", answer.notes);
}

#[test]
fn a_platform_that_only_rises_shows_fewer_parameters_than_it_has() {
    let description = shipped("prs3");
    let train = made_along(&description.bare, &SHORT, &mut |t, s| {
        let w = 2.0 * PI * 0.4;
        let (q, v, a) = (0.15 + 0.1 * math::sin(w * t), 0.1 * w * math::cos(w * t), -0.1 * w * w * math::sin(w * t));
        *s = Sample { q: vec![q; 3], v: vec![v; 3], a: vec![a; 3] };
    });
    let answer = go(&description.robot, &[train], &[], &settings(Method::Sdp));
    assert_eq!(answer.status, Status::Doubtful);
    assert!(says(&answer, |n| matches!(n, Note::RankDeficient { structural, shown, .. } if shown < structural)), "{:?}", answer.notes);
    assert!(lowest_eigenvalue(&answer) > 0.0 && answer.pooled(|j| j.identified) < 0.03, "{:?}", answer.joints);
}

#[test]
fn ten_percent_of_spikes_are_replaced_and_told() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let [mut train, test] = [1, 2].map(|seed| made(&truth, &Made { seed, ..SHORT }));
    let mut draw = Draw::new(9);
    for tau in train.signals.iter_mut().filter(|(name, _)| name.starts_with("tau.")).map(|(_, tau)| tau) {
        for t in tau.iter_mut() {
            if draw.uniform(0.0..1.0) < 0.1 {
                *t += draw.uniform(-100.0..100.0);
            }
        }
    }
    let answer = go(&description.robot, &[train], &[test], &settings(Method::Sdp));
    assert_eq!(answer.status, Status::Doubtful);
    assert!(says(&answer, |n| matches!(n, Note::Spikes { share, .. } if *share > 0.05)), "{:?}", answer.notes);
    assert!(answer.pooled(|j| j.identified) < 0.04, "{:?}", answer.joints);
}

#[test]
fn ten_percent_of_the_time_in_contact_is_told_and_survived_by_robust_weights() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let [mut train, test] = [1, 2].map(|seed| made(&truth, &Made { seed, seconds: 20.0, ..SHORT }));
    let time = train.time.clone();
    for tau in train.signals.iter_mut().filter(|(name, _)| name.starts_with("tau.")).map(|(_, tau)| tau) {
        // A push of half a second in every five.
        tau.iter_mut().zip(&time).filter(|(_, t)| (*t % 5.0) > 4.5).for_each(|(tau, _)| *tau += 15.0);
    }
    let [plain, robust] = [Method::Wls, Method::Bisquare].map(|m| go(&description.robot, from_ref(&train), from_ref(&test), &settings(m)));
    assert!(says(&robust, |n| matches!(n, Note::Outliers { share, .. } if (0.05..0.2).contains(share))), "{:?}", robust.notes);
    assert_ne!(plain.status, Status::Identified, "{:?}", plain.notes);
    let (plain, robust) = (plain.pooled(|j| j.identified), robust.pooled(|j| j.identified));
    assert!(robust < 0.015 && plain > 3.0 * robust, "{plain} {robust}");
}

#[test]
fn recordings_that_no_robot_could_make_are_called_infeasible() {
    let description = rig();
    let mut impossible = description.bare.clone();
    // Friction that drives.
    for &j in &description.bare.actuators {
        (impossible.joints[j].viscous, impossible.joints[j].coulomb) = (-1.0, -2.0);
    }
    let [train, test] = [1, 2].map(|seed| made(&impossible, &Made { seed, ..SHORT }));
    let answer = go(&description.robot, &[train], &[test], &settings(Method::Sdp));
    assert_eq!(answer.status, Status::Doubtful);
    assert!(says(&answer, |n| matches!(n, Note::Infeasible { unbounded, physical, .. } if physical > unbounded)), "{:?}", answer.notes);
    assert!(answer.theta[answer.columns.index("j1.coulomb").expect("a column")] >= 0.0);
}

// ---- intervals

/// Robots as another made them, and how often the intervals of a method hold them.
struct Coverage {
    inside: u32,
    all: u32,
    /// Answers, of the first seed on.
    answers: Vec<Identification>,
}

impl Coverage {
    fn share(&self) -> f64 {
        f64::from(self.inside) / f64::from(self.all)
    }

    /// Mean over base parameters and answers of the logarithm of interval widths.
    fn width(&self) -> f64 {
        let each = self.answers.iter().flat_map(|a| &a.parameters).map(|p| math::ln(p.ci95[1] - p.ci95[0]));
        each.sum::<f64>() / f64::from(self.all)
    }
}

#[expect(clippy::print_stdout, reason = "the shares are what a long run is for")]
fn coverage(truth: &Model, settings: &Settings, runs: u64, noise: [f64; 2]) -> Coverage {
    let description = rig();
    let true_theta = Columns::new(&Robot::new(truth.clone(), Vec::new())).nominal();
    let mut out = Coverage { inside: 0, all: 0, answers: Vec::new() };
    for seed in 0..runs {
        let train = made(truth, &Made { seed: 100 + seed, noise, ..SHORT });
        let answer = go(&description.robot, &[train], &[], settings);
        let set = answer.set.as_ref().expect("an answer");
        for (p, want) in answer.parameters.iter().zip(set.project(&true_theta)) {
            out.all += 1;
            out.inside += u32::from(p.ci95[0] <= want && want <= p.ci95[1]);
        }
        out.answers.push(answer);
    }
    println!("{}: {} of {} intervals hold the truth: {:.3}", settings.method.name(), out.inside, out.all, out.share());
    out
}

/// The truth has a sharp sign; so has the model then.
fn sharp(method: Method) -> Settings {
    Settings { method, rows: RowOptions { softness: 1e-6, ..RowOptions::default() }, ..Settings::default() }
}

fn is_long() -> bool {
    std::env::var_os("PKM_LONG").is_some()
}

#[test]
fn ninety_five_percent_intervals_hold_the_truth_nineteen_times_in_twenty() {
    let truth = another(&rig().bare, &mut Draw::new(3));
    // Coloured over ten samples: five rows of the regression are not five measurements.
    let found = coverage(&truth, &sharp(Method::Wls), if is_long() { 300 } else { 30 }, [0.05, 0.9]);
    assert!((0.90..=0.99).contains(&found.share()), "{}", found.share());
}

#[test]
fn every_method_has_intervals_of_its_own_that_hold_the_truth() {
    let truth = another(&rig().bare, &mut Draw::new(3));
    let runs = if is_long() { 300 } else { 10 };
    // Ten runs are some eighty numbers, not independent: two standard deviations are about seven hundredths.
    let least = if is_long() { 0.90 } else { 0.86 };
    let of = |method| coverage(&truth, &sharp(method), runs, [0.05, 0.9]);
    let weighted = of(Method::Wls);
    for method in [Method::Ols, Method::Huber, Method::Bisquare] {
        let found = of(method);
        assert!((least..=0.995).contains(&found.share()), "{method:?}: {}", found.share());
        assert!(found.answers.iter().all(|a| a.intervals == Intervals::Sampling));
        // No linear estimate is better than the weighted one, and robust weights cost some percent where nothing is wild.
        assert!(found.width() > weighted.width() - 0.02, "{method:?}: {} {}", found.width(), weighted.width());
    }
    for method in [Method::Ridge, Method::Sdp] {
        let found = of(method);
        // The pull to the nominal robot is chosen from the same rows, and a prior that is too wide covers too often.
        assert!((least..=1.0).contains(&found.share()), "{method:?}: {}", found.share());
        assert!(found.answers.iter().all(|a| a.intervals == Intervals::Posterior));
        assert!(found.width() < weighted.width() + 0.02, "a prior is no loss: {method:?}: {} {}", found.width(), weighted.width());
    }
}

#[test]
fn robust_intervals_of_normal_noise_are_wider_by_what_robustness_costs() {
    let truth = another(&rig().bare, &mut Draw::new(3));
    let runs = if is_long() { 40 } else { 4 };
    let widths = [Method::Wls, Method::Huber, Method::Bisquare].map(|m| coverage(&truth, &sharp(m), runs, [0.05, 0.0]).width());
    for width in &widths[1..] {
        // Tuned to 95 % efficiency at white normal noise, sqrt(1/0.95) = 1.026 times as wide [Holland1977]; behind a filter neighbours are
        // alike, and less so once large ones are cut.
        let ratio = math::exp(width - widths[0]);
        assert!((1.0..1.04).contains(&ratio), "{ratio}");
    }
}

#[test]
fn parameters_at_the_edge_of_what_is_physical_are_named_and_their_intervals_one_sided() {
    let mut truth = another(&rig().bare, &mut Draw::new(3));
    let drive = truth.actuators[1];
    truth.joints[drive].coulomb = 0.0;
    let name = format!("{}.coulomb", truth.joints[drive].name);
    let found = coverage(&truth, &sharp(Method::Sdp), if is_long() { 300 } else { 12 }, [0.05, 0.0]);
    let (mut at_edge, mut inside) = (0, 0);
    for answer in &found.answers {
        let p = answer.parameters.iter().find(|p| p.name == name).expect("friction is a base parameter by itself");
        let is_named = answer.notes.iter().any(|n| matches!(n, Note::AtBound { parameters } if parameters.contains(&name)));
        // The solver comes as near to a bound as its tolerance.
        assert!(if is_named { p.value < 1e-5 } else { p.value > 1e-7 }, "{p:?} {:?}", answer.notes);
        assert!(!is_named || (p.ci95[0] >= -1e-9 && p.ci95[1] > 0.0), "{p:?}");
        at_edge += usize::from(is_named);
        inside += usize::from(p.ci95[0] <= 1e-9 && p.ci95[1] >= 0.0);
    }
    // Half of the estimates without bounds are below zero.
    let n = found.answers.len();
    println!("{at_edge} of {n} at the edge, {inside} hold zero");
    assert!(at_edge > n / 5 && at_edge < n - n / 10 && 10 * inside >= 9 * n - 10, "{at_edge} {inside} of {n}");
    assert!(found.share() > 0.86, "{}", found.share());
}

#[test]
fn the_reduction_drops_what_is_not_determined_and_ends_physical() {
    let description = rig();
    let truth = another(&description.bare, &mut Draw::new(3));
    let [train, test] = [1, 2].map(|seed| made(&truth, &Made { seed, noise: [0.1, 0.0], ..SHORT }));
    let answer = go(&description.robot, &[train], &[test], &settings(Method::Relevant));
    let steps = &answer.steps;
    println!("{steps:#?}");
    let (first, last) = (&steps[0], &steps[steps.len() - 1]);
    assert!(steps.len() > 1 && last.parameters < first.parameters, "{steps:?}");
    assert!(last.is_feasible && last.worst_relative_sd < 0.5);
    assert!(last.heldout < 1.05 * first.heldout, "dropping what is not determined costs nothing: {steps:?}");
    assert_eq!(answer.parameters.len(), last.parameters);
}

#[test]
fn physics_that_a_regression_of_efforts_cannot_have_in_it_is_refused_in_one_line() {
    let description = rig();
    let joint = description.bare.joints[description.bare.actuators[0]].name.clone();
    let recording = made(&description.bare, &SHORT);
    for (effect, numbers) in [
        ("contact", &[("stiffness", 1e3), ("position", 0.1)][..]),
        ("friction_presliding", &[("stiffness", 1e5), ("coulomb", 2.0)]),
        ("saturation", &[("limit", 1.0)]),
        ("friction_thermal", &[("rate", 0.01)]),
    ] {
        let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
        let applied = Applied::try_new(&description.bare, effect, &joint, &numbers).expect("a valid effect");
        let robot = Robot::new(description.bare.clone(), vec![applied]);
        let said = identify(&robot, from_ref(&recording), &[], &settings(Method::Relevant), &mut |_| {}).expect_err(effect).to_string();
        assert!(said.contains(effect) && said.contains(&joint) && !said.contains('\n'), "{said}");
        let mut carrying = description.clone();
        carrying.robot = robot;
        // A diagnosis runs along the recording and has them in what it predicts.
        assert!(pkm_diagnose::predict(&carrying, &recording).is_ok(), "{effect}");
    }
}
