//! Writes the HTML page of an invented diagnosis to the path given as first argument, and its terminal text to standard output.
//!
//! The numbers are made up; the page is for looking at, nothing is diagnosed here.

extern crate alloc;

use alloc::collections::BTreeMap;

use pkm_diagnose::evidence::{ChainStep, FindingPlot, JointSeries, RegimeCell, Screened};
use pkm_diagnose::verdict::{
    Detectable, EffectAt, Estimate, Finding, Heldout, HeldoutJoint, LookAlike, RecordingUse, SCHEMA, Status, Unexplained, Use,
};
use pkm_diagnose::{Diagnosis, Evidence, Verdict};
use pkm_dyn::math::{cos, exp, sin};
use pkm_report::{Style, html, terminal};

/// Sample period of the invented recordings `[s]`.
const PERIOD: f64 = 2.0e-3;

/// Samples of each of them.
const SAMPLES: u32 = 10_000;

#[expect(clippy::print_stdout, reason = "an example's output is its text")]
fn main() -> std::io::Result<()> {
    let diagnosis = Diagnosis { verdict: verdict(), evidence: evidence(), refined: None };
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(path, html(&diagnosis))?;
    }
    println!("{}", terminal(&diagnosis, Style::Colour));
    Ok(())
}

/// Repeatable noise between -1 and 1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = -2.0;
        for _ in 0..4 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += f64::from(u32::try_from(self.0 >> 40).unwrap_or(0)) / 16_777_216.0;
        }
        sum
    }
}

/// Position and velocity of a joint.
fn motion(joint: u32, t: f64) -> (f64, f64) {
    let phase = 2.1 * f64::from(joint);
    let (w1, w2) = (1.3 + 0.2 * f64::from(joint), 4.1);
    let q = 0.05 * sin(w1 * t + phase) + 0.012 * sin(w2 * t);
    (q, 0.05 * w1 * cos(w1 * t + phase) + 0.012 * w2 * cos(w2 * t))
}

fn stribeck(v: f64) -> f64 {
    (20.4 + 13.2 * exp(-(v / 0.011) * (v / 0.011))) * if v < 0.0 { -1.0 } else { 1.0 }
}

/// A hysteretic contribution: friction state of a pre-sliding element.
fn presliding(z: &mut f64, v: f64) -> f64 {
    *z += PERIOD * v * (1.0 - *z * v.signum() / 0.002);
    *z * 5200.0
}

fn names(all: &[&str]) -> Vec<String> {
    all.iter().map(|s| (*s).to_owned()).collect()
}

fn estimate(value: f64, half: f64, unit: &str) -> Estimate {
    Estimate { value, ci95: [value - half, value + half], unit: unit.to_owned() }
}

fn parameters(all: &[(&str, f64, f64, &str)]) -> BTreeMap<String, Estimate> {
    all.iter().map(|(name, value, half, unit)| ((*name).to_owned(), estimate(*value, *half, unit))).collect()
}

fn friction() -> Finding {
    Finding {
        rank: 1,
        effect: "friction_stribeck".to_owned(),
        place: names(&["q1"]),
        regime: names(&["low_speed", "reversal"]),
        when: "|dq.q1| < 0.02 m/s, 31 % of samples".to_owned(),
        confidence: 0.97,
        p_value: 0.005,
        parameters: parameters(&[
            ("coulomb", 20.43, 0.61, "N"),
            ("stiction", 33.6, 1.15, "N"),
            ("stribeck_velocity", 0.01104, 0.0009, "m/s"),
        ]),
        heldout_rms_before: 0.2312,
        heldout_rms_after: 0.1284,
        says: "The first prismatic joint has dry friction of 20.4 N that rises to 33.6 N below 11 mm/s; the model as given has none.".to_owned(),
        equation: "tau(q1) += (coulomb + (stiction − coulomb)·exp(−(v/stribeck_velocity)²))·sgn(v)".to_owned(),
        look_alikes: vec![
            LookAlike {
                effect: "backlash".to_owned(),
                place: names(&["q1"]),
                why_not: "the spike at a reversal follows the speed, not the travelled distance: it explains 9 % of what Stribeck friction explains"
                    .to_owned(),
                separating_experiment: "reversals at three amplitudes with the same peak speed".to_owned(),
            },
            LookAlike {
                effect: "friction_coulomb".to_owned(),
                place: names(&["q1"]),
                why_not: "leaves a peak of 12.9 N below 20 mm/s on the held-out samples".to_owned(),
                separating_experiment: String::new(),
            },
        ],
        cannot_tell_from: Vec::new(),
        ..Finding::default()
    }
}

fn payload() -> Finding {
    Finding {
        rank: 2,
        effect: "payload".to_owned(),
        place: names(&["platform"]),
        regime: names(&["all"]),
        when: "always; grows with acceleration, 100 % of samples".to_owned(),
        confidence: 0.91,
        p_value: 0.005,
        parameters: parameters(&[("mass", 1.83, 0.07, "kg")]),
        heldout_rms_before: 0.1284,
        heldout_rms_after: 0.0812,
        says: "The platform carries 1.83 kg more than the model says.".to_owned(),
        equation: "tau += Rᵀ·Y_platform(q, v, a)·mass".to_owned(),
        look_alikes: vec![LookAlike {
            effect: "torque_constant".to_owned(),
            place: names(&["q1", "q2", "q3"]),
            why_not: "would need the same +11 % at all three drives, and leaves the error at standstill".to_owned(),
            separating_experiment: "hold three poses for 5 s each and compare the holding efforts".to_owned(),
        }],
        cannot_tell_from: vec![EffectAt {
            effect: "inertia_error".to_owned(),
            place: names(&["platform"]),
            separating_experiment:
                "tilt the platform by ± 15° at two speeds: a payload off the centre turns it, a heavier platform does not".to_owned(),
        }],
        ..Finding::default()
    }
}

fn hysteresis() -> Finding {
    Finding {
        rank: 3,
        effect: "friction_presliding".to_owned(),
        place: names(&["q3"]),
        regime: names(&["reversal", "standstill"]),
        when: "within 2 mm after a reversal of q3, 12 % of samples".to_owned(),
        confidence: 0.78,
        p_value: 0.02,
        parameters: parameters(&[("stiffness", 5210.0, 430.0, "N/m"), ("coulomb", 10.4, 0.9, "N")]),
        heldout_rms_before: 0.0812,
        heldout_rms_after: 0.0597,
        says: "Joint q3 yields like a spring of 5.2 kN/m for the first 2 mm after a reversal before it slides.".to_owned(),
        equation: "dz/dt = v·(1 − z·sgn(v)/z_max),  tau(q3) += stiffness·z".to_owned(),
        look_alikes: Vec::new(),
        cannot_tell_from: Vec::new(),
        ..Finding::default()
    }
}

fn verdict() -> Verdict {
    let recording = |path: &str, used, spans: &[[f64; 2]]| RecordingUse {
        path: path.to_owned(),
        samples: 10_000,
        duration_s: 20.0,
        used,
        heldout_spans: spans.to_vec(),
    };
    let size = |effect: &str, place: &str, parameter: &str, value: f64, unit: &str| Detectable {
        effect: effect.to_owned(),
        place: names(&[place]),
        parameter: parameter.to_owned(),
        value,
        unit: unit.to_owned(),
        says: format!("{effect} at {place}: less than {value} {unit} of {parameter} cannot be seen"),
    };
    Verdict {
        schema: SCHEMA.to_owned(),
        status: Status::Ok,
        robot: "3prs <lab & test>".to_owned(),
        recordings: vec![
            recording("runs/excite-a.csv", Use::Both, &[[4.0, 6.0], [13.0, 15.0]]),
            recording("runs/circle-b.csv", Use::Holdout, &[[0.0, 20.0]]),
        ],
        nothing_missing: false,
        heldout: heldout(),
        findings: vec![friction(), payload(), hysteresis()],
        unexplained: Unexplained {
            present: false,
            share_of_residual: 0.021,
            place: names(&["q2"]),
            depends_on: names(&["position of q2", "time"]),
            says: String::new(),
        },
        minimum_detectable: vec![
            size("payload", "platform", "mass", 0.21, "kg"),
            size("friction_coulomb", "q2", "coulomb", 1.7, "N"),
            size("backlash", "q1", "gap", 0.00035, "m"),
            size("gravity_tilt", "base", "roll", 0.0061, "rad"),
            size("torque_ripple", "q2", "amplitude", 2.4, "N"),
            size("time_delay", "q1", "delay", 0.0011, "s"),
            size("joint_elasticity", "q2", "stiffness", 2.1e6, "N/m"),
        ],
        refined_model: "out.robot.toml".to_owned(),
        says: "Three effects are missing from the model: Stribeck friction at q1, 1.83 kg on the platform and pre-sliding at q3; adding them cuts \
               the held-out error from 41 % to 6.0 % of the measured effort, against a noise floor of 4.8 %."
            .to_owned(),
        notes: names(&["runs/excite-a.csv: 0.4 % of the samples are repeated readings and were left out", "q2 never moves faster than 0.11 m/s"]),
        ..Verdict::default()
    }
}

fn heldout() -> Heldout {
    let joint = |name: &str, tau, nominal, refit, last| HeldoutJoint {
        joint: name.to_owned(),
        unit: "N".to_owned(),
        rms_tau: tau,
        rms_nominal: nominal,
        rms_refit: refit,
        rms_final: last,
    };
    Heldout {
        rms_nominal: 0.4123,
        rms_refit: 0.2312,
        rms_final: 0.0597,
        noise_floor: 0.048,
        band_hz: 8.0,
        unit: "fraction of tau rms".to_owned(),
        joints: vec![joint("q1", 61.3, 27.9, 15.2, 3.61), joint("q2", 55.8, 19.6, 9.41, 3.02), joint("q3", 58.1, 24.4, 13.7, 3.77)],
    }
}

fn evidence() -> Evidence {
    let step = |label: &str, heldout_rms| ChainStep { label: label.to_owned(), heldout_rms };
    let screened = |effect: &str, place: &str, gain: f64, wins, why: &str| Screened {
        effect: effect.to_owned(),
        place: names(&[place]),
        gain,
        surprise: 80.0 * gain,
        wins,
        why_not: why.to_owned(),
    };
    Evidence {
        joints: (0..2u32).flat_map(|r| (1..=3u32).map(move |j| series(j, r))).collect(),
        findings: vec![stribeck_plot(), payload_plot(), hysteresis_plot()],
        regimes: regimes(),
        chain: vec![
            step("model as given", 0.4123),
            step("rigid bodies, friction and offsets refitted", 0.2312),
            step("friction_stribeck at q1", 0.1284),
            step("payload at platform", 0.0812),
            step("friction_presliding at q3", 0.0597),
        ],
        ruled_out: vec![
            screened("cable_force", "q2", 0.031, [4, 6], "gain below the null's 95 % limit"),
            screened("backlash", "q1", 0.022, [3, 6], "helps in 3 of 6 folds only; the spike follows speed, not position"),
            screened("torque_ripple", "q1", 0.011, [5, 6], "the period fitted on one half of the stroke does not hold on the other"),
            screened("gravity_tilt", "base", 0.0042, [2, 6], "gain below the null's 95 % limit"),
            screened("time_delay", "q3", -0.0007, [0, 6], "makes the held-out error larger"),
        ],
        null_surprise: [3.6, 4.9],
        null_runs: 199,
        ..Evidence::default()
    }
}

fn series(joint: u32, recording: u32) -> JointSeries {
    let mut noise = Noise(u64::from(joint * 17 + recording));
    let mut s = JointSeries {
        joint: format!("q{joint}"),
        unit: "N".to_owned(),
        recording: ["runs/excite-a.csv", "runs/circle-b.csv"][usize::from(recording > 0)].to_owned(),
        heldout_spans: if recording == 0 { vec![[4.0, 6.0], [13.0, 15.0]] } else { vec![[0.0, 20.0]] },
        rms_nominal: [27.9, 19.6, 24.4][usize::try_from(joint - 1).unwrap_or(0)],
        rms_refined: [3.61, 3.02, 3.77][usize::try_from(joint - 1).unwrap_or(0)],
        ..JointSeries::default()
    };
    for k in 0..SAMPLES {
        let t = f64::from(k) * PERIOD;
        let (q, v) = motion(joint + 3 * recording, t);
        let rigid = 45.0 + 620.0 * q - 14.0 * sin(3.0 * t);
        let truth = rigid * 1.16 + stribeck(v) * if joint == 1 { 1.0 } else { 0.55 };
        s.time.push(t);
        s.measured.push(truth + 3.0 * noise.next());
        s.nominal.push(rigid);
        s.refined.push(truth + 0.8 * sin(7.0 * t));
    }
    s
}

/// Shared part of the three pictures: every tenth sample, two held-out blocks.
fn plot(rank: usize, labels: [&str; 2], mut sample: impl FnMut(f64, f64, f64, &mut Noise) -> [f64; 3]) -> FindingPlot {
    let mut noise = Noise(7 + u64::try_from(rank).unwrap_or(0));
    let mut p = FindingPlot { rank, x_label: labels[0].to_owned(), y_label: labels[1].to_owned(), ..FindingPlot::default() };
    for k in 0..SAMPLES {
        let t = f64::from(k) * PERIOD;
        let (q, v) = motion(1, t);
        let [x, y, model] = sample(t, q, v, &mut noise);
        if k % 10 == 0 {
            p.x.push(x);
            p.y.push(y);
            p.model.push(model);
            p.is_heldout.push((4.0..6.0).contains(&t) || (13.0..15.0).contains(&t));
        }
    }
    p
}

fn stribeck_plot() -> FindingPlot {
    plot(1, ["velocity of q1 [m/s]", "effort left at q1 [N]"], |_, _, v, noise| [v, stribeck(v) + 3.4 * noise.next(), stribeck(v)])
}

fn payload_plot() -> FindingPlot {
    plot(2, ["vertical acceleration of platform [m/s²]", "effort left at q2 [N]"], |t, q, _, noise| {
        let a = 9.81 + 2.4 * sin(4.1 * t) - 11.0 * q;
        [a, 0.61 * a + 0.9 * noise.next(), 0.61 * a]
    })
}

fn hysteresis_plot() -> FindingPlot {
    let mut z = 0.0;
    plot(3, ["position of q3 [m]", "effort left at q3 [N]"], move |_, q, v, noise| {
        let f = presliding(&mut z, v);
        [q, f + 1.6 * noise.next(), f]
    })
}

fn regimes() -> Vec<RegimeCell> {
    let rows = [
        ("low_speed", 0.31, [0.62, 0.33, 0.48], [0.071, 0.062, 0.081]),
        ("reversal", 0.12, [0.74, 0.38, 0.66], [0.083, 0.066, 0.102]),
        ("high_speed", 0.22, [0.29, 0.26, 0.31], [0.055, 0.049, 0.058]),
        ("high_load", 0.25, [0.41, 0.37, 0.35], [0.057, 0.052, 0.061]),
        ("standstill", 0.04, [0.51, 0.22, 0.41], [0.064, 0.051, 0.072]),
        ("all", 1.0, [0.46, 0.35, 0.42], [0.059, 0.054, 0.065]),
    ];
    let joints = ["q1", "q2", "q3"];
    rows.iter()
        .flat_map(|(regime, share, before, after)| {
            joints.iter().zip(before.iter().zip(after)).map(move |(joint, (b, a))| RegimeCell {
                joint: (*joint).to_owned(),
                regime: (*regime).to_owned(),
                share: *share,
                before: *b,
                after: *a,
            })
        })
        .collect()
}
