//! What a motion could show, against closed forms: one slide moved by a sine or two, where shares that survive, smallest sizes and angles
//! are sums over harmonics.

use core::f64::consts::{PI, TAU};

use pkm_diagnose::isolability::Isolability;
use pkm_diagnose::{Belief, Plan, PlanSettings, Settings, plan, recorded_noise};
use pkm_dyn::math;
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::Recording;
use pkm_tests::Draw;

const MASS: f64 = 80.0;
const STEP_S: f64 = 1e-3;
const SAMPLES: usize = 20_000;
const BAND_HZ: f64 = 20.0;
const NOISE: f64 = 3.0;

/// A horizontal slide without friction.
fn slide() -> Description {
    let toml = "name = \"slide\"\nurdf = \"slide.urdf\"\n\n[[actuator]]\njoint = \"x\"\nrotor_inertia = 0.0\n";
    let urdf = format!(
        r#"<robot name="slide"><link name="frame"/><link name="carriage"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="{MASS}"/>
        <inertia ixx="0.4" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.6"/></inertial></link><joint name="x" type="prismatic">
        <parent link="frame"/><child link="carriage"/><origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" effort="1000" velocity="5"/><dynamics damping="0" friction="0"/></joint></robot>"#
    );
    parse(toml, &urdf, ["slide.toml", "slide.urdf"]).expect("a readable robot")
}

/// A motion that is a sum of sines, amplitude `[m]` and frequency `[Hz]`.
fn reference(waves: &[(f64, f64)]) -> Recording {
    let mut out = Recording { name: "waves".to_string(), ..Recording::default() };
    out.time = (0..SAMPLES).map(|i| STEP_S * i as f64).collect();
    let q = out.time.iter().map(|t| waves.iter().map(|(a, f)| a * math::sin(TAU * f * t)).sum()).collect();
    out.signals.insert("q_ref.x".to_string(), q);
    out
}

fn planned(waves: &[(f64, f64)], belief: Belief) -> Plan {
    // Chance alone: no least share of the error or of the effort.
    let decision = Settings { band_hz: Some(BAND_HZ), floor: 0.0, tolerance: 0.0, ..Settings::default() };
    let settings = PlanSettings { noise: [("x".to_string(), NOISE)].into(), belief, decision };
    plan(&slide(), &[reference(waves)], &settings, &mut |_| {}).expect("a motion that can be planned")
}

fn at(iso: &Isolability, effect: &str) -> usize {
    iso.effects.iter().position(|e| e.effect == effect).unwrap_or_else(|| panic!("{effect} is looked for"))
}

fn cosine(plan: &Plan, a: &str, b: &str) -> f64 {
    let iso = &plan.isolability;
    iso.cosines[at(iso, a)][at(iso, b)]
}

fn kappa(plan: &Plan, effect: &str) -> f64 {
    plan.isolability.effects[at(&plan.isolability, effect)].kappa
}

fn smallest(plan: &Plan, effect: &str, parameter: &str) -> f64 {
    let found = plan.minimum_detectable.iter().find(|d| d.effect == effect && d.parameter == parameter);
    found.unwrap_or_else(|| panic!("{effect} has a smallest {parameter}: {:?}", plan.minimum_detectable)).value
}

#[track_caller]
fn assert_close(what: &str, value: f64, truth: f64, share: f64) {
    assert!((value / truth - 1.0).abs() < share, "{what}: {value} instead of {truth}");
}

/// Squared harmonics of a square wave of frequency `f` after the low-pass run both ways, those from `first` on, in units of the fundamental:
/// gain 1/(1 + (n·f/B)⁸) at the n-th, whose amplitude is 1/n.
fn square_wave(f: f64, first: u32) -> f64 {
    (first..400).step_by(2).map(|n| 1.0 / (f64::from(n) * (1.0 + math::powf(f64::from(n) * f / BAND_HZ, 8.0)))).map(|x| x * x).sum()
}

/// Raw samples that count: all but a period of the band at both ends and half of one on both sides of nine borders between blocks.
fn counted() -> f64 {
    SAMPLES as f64 - (2.0 + 9.0) / (BAND_HZ * STEP_S)
}

#[test]
fn along_one_sine_a_spring_is_an_inertia_and_a_delay_is_damping() {
    let p = planned(&[(0.1, 0.5)], Belief::Anchored);
    assert_close("spring and rotor", cosine(&p, "spring", "rotor_inertia"), 1.0, 1e-3);
    assert_close("spring and payload", cosine(&p, "spring", "payload"), 1.0, 1e-3);
    // A delay is not looked for next to reversals, where its column is set to zero; of the fifth of damping that dry friction leaves, that
    // is a little.
    assert_close("delay and damping", cosine(&p, "time_delay", "friction_viscous"), 1.0, 0.03);
    assert!(kappa(&p, "time_delay") < 0.05, "damping hides a delay: {}", kappa(&p, "time_delay"));
    assert!(cosine(&p, "spring", "friction_viscous") < 0.02, "a sine is square to its cosine");
    assert_close("a rotor is square to friction", kappa(&p, "rotor_inertia"), 1.0, 0.01);
}

#[test]
fn two_sines_open_the_angle_between_a_spring_and_an_inertia_as_far_as_their_amplitudes_say() {
    let (a, b) = ((0.1, 0.5), (0.04, 1.5));
    let p = planned(&[a, b], Belief::Anchored);
    let square = |w: (f64, f64), power: f64| math::powf(w.0 * math::powf(TAU * w.1, power), 2.0);
    // q and a have components A and A·ω² along each sine; friction lies in the cosines.
    let truth = (square(a, 1.0) + square(b, 1.0)) / ((square(a, 0.0) + square(b, 0.0)) * (square(a, 2.0) + square(b, 2.0))).sqrt();
    assert!((0.5..0.9).contains(&truth), "{truth}");
    assert_close("spring and rotor", cosine(&p, "spring", "rotor_inertia"), truth, 0.01);
    assert!(
        p.aliases.iter().all(|x| !x.effects.iter().any(|e| e.effect == "spring") || !x.effects.iter().any(|e| e.effect == "rotor_inertia"))
    );
}

#[test]
fn what_damping_leaves_of_dry_friction_is_the_square_waves_harmonics() {
    let p = planned(&[(0.1, 0.5)], Belief::Anchored);
    let truth = square_wave(0.5, 3) / square_wave(0.5, 1);
    assert!((truth - (1.0 - 8.0 / (PI * PI))).abs() < 0.02, "without a filter 1 − 8/π²: {truth}");
    assert_close("share of dry friction", kappa(&p, "friction_coulomb"), truth, 0.03);
    assert_close("share of damping", kappa(&p, "friction_viscous"), truth, 0.03);
}

#[test]
fn the_smallest_sizes_are_three_deviations_of_the_textbook_estimate() {
    let (amplitude, f) = (0.1, 0.5);
    let p = planned(&[(amplitude, f)], Belief::Anchored);
    // Of a coefficient of a column with mean square m², in noise s: s/√(N·m²).
    let three = |mean_square: f64| 3.0 * NOISE / (counted() * mean_square).sqrt();
    let acceleration = amplitude * math::powf(TAU * f, 2.0);
    let mass = three(0.5 * acceleration * acceleration);
    assert_close("payload", smallest(&p, "payload", "mass"), mass, 0.03);
    assert_close("wrong mass", smallest(&p, "inertia_error", "mass"), mass, 0.03);
    assert_close("rotor", smallest(&p, "rotor_inertia", "inertia"), mass, 0.03);
    assert_close("scale", smallest(&p, "torque_constant", "scale"), mass / MASS, 0.03);
    assert_close("spring", smallest(&p, "spring", "stiffness"), three(0.5 * amplitude * amplitude), 0.03);
    let dry = 8.0 / (PI * PI) * square_wave(f, 3);
    assert_close("dry friction", smallest(&p, "friction_coulomb", "coulomb"), three(dry), 0.04);
    assert_close("offset", smallest(&p, "torque_offset", "offset"), three(1.0), 0.03);
    let said = p.minimum_detectable.iter().find(|d| d.effect == "payload").expect("a payload has a size");
    assert!(said.says.starts_with("payload at carriage: less than ") && said.says.ends_with(" kg of mass cannot be seen"), "{}", said.says);
}

#[test]
fn belief_in_the_mass_decides_how_much_of_an_inertia_is_seen() {
    let (amplitude, f) = (0.1, 0.5);
    let [anchored, soft, refit] = [Belief::Anchored, Belief::Soft, Belief::Refit].map(|b| planned(&[(amplitude, f)], b));
    // The mass column is the rotor's; with standard deviation σ = a tenth of the mass, 1/(1 + σ²·Σa²/s²) of the rotor survives. Rows of noise
    // filtered both ways have the variance s²·2·B·dt·∫dx/(1+x⁸)², and there are 20 raw samples to a row.
    let integral = PI / 8.0 / math::sin(PI / 8.0) * (7.0 / 8.0);
    let row = NOISE * NOISE * 2.0 * BAND_HZ * STEP_S * integral;
    let acceleration = amplitude * math::powf(TAU * f, 2.0);
    let information = counted() / 20.0 * 0.5 * acceleration * acceleration / row;
    let truth = 1.0 / (1.0 + math::powf(0.1 * MASS, 2.0) * information);
    // Four digits are told.
    assert!((kappa(&soft, "rotor_inertia") - truth).abs() < 0.05 * truth + 1e-4, "{} instead of {truth}", kappa(&soft, "rotor_inertia"));
    assert!(kappa(&refit, "rotor_inertia") < 1e-6 && kappa(&anchored, "rotor_inertia") > 0.99);
    assert_close("structure does not rest on it", kappa(&refit, "friction_coulomb"), kappa(&anchored, "friction_coulomb"), 0.01);
}

#[test]
fn a_pair_that_is_asked_for_fails_along_one_sine_and_passes_along_two() {
    let one = planned(&[(0.1, 0.5)], Belief::Anchored);
    let asked = one.require("spring", "rotor_inertia").expect("both are looked for");
    assert_eq!(asked.len(), 1);
    assert!(!asked[0].ok);
    let two = planned(&[(0.1, 0.5), (0.04, 1.5)], Belief::Anchored);
    assert!(two.require("spring@x", "rotor_inertia@x").expect("both are looked for")[0].ok);
    assert!(
        two.require("backlash@nowhere", "spring").is_err() && two.require("spring@y", "rotor_inertia").unwrap_err().contains("there is: x")
    );
}

#[test]
fn noise_of_a_recording_comes_out_of_its_second_differences() {
    let mut draw = Draw::new(5);
    let mut r = reference(&[(0.1, 0.5)]);
    let normal = |draw: &mut Draw| (0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0;
    let tau = r.time.iter().map(|t| 80.0 * math::sin(TAU * 0.5 * t) + NOISE * normal(&mut draw)).collect();
    r.signals.insert("tau.x".to_string(), tau);
    assert_close("noise", recorded_noise(&slide().robot, &r).expect("an effort")["x"], NOISE, 0.02);
}
