//! Output error on the motoBOTTE [Arceo2021, section 2.3]: friction and input gains of a closed mechanism of which only the ankle angle is
//! seen, from sinusoids of varying frequency and amplitude, and what the ratio of the two input gains really is.
//!
//! The plant is the index-reduced DAE `M·q'' + C + F = (b0·u', 0, 0) + Jᵀλ` in the coordinate of its drive, integrated here by the classical
//! Runge-Kutta method; the fit never sees how records were made but through their numbers.

use core::f64::consts::PI;

use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::{Data, Model, math, urdf};
use pkm_ident::minimise::{Bounds, Ending};
use pkm_ident::output_error::{Strategy, Trial, Unknown, output_error};
use pkm_tests::Draw;

/// Period of the records, and of the integration `[s]`: the fastest sinusoid has 50 steps per period.
const DT: f64 = 0.02;

/// Speed over which the plant's dry friction passes through zero `[m/s]`.
const SOFT: f64 = 2e-3;

/// The paper's ankle angle where the model's reads zero: equation (4), corrected, at d = 0.0515 m `[rad]`.
const HOME: f64 = 2.026_134_139_999_74;

fn motobotte() -> Model {
    let robot = pkm_robots::find("motobotte").expect("a shipped robot");
    let mut model = urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("it loads").robot.model;
    for joint in &mut model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    model
}

/// The reduced plant along one record.
struct Plant {
    model: Model,
    data: Data,
    phi: usize,
}

impl Plant {
    fn new() -> Self {
        let model = motobotte();
        let phi = model.joint_index("phi").expect("the ankle");
        Self { data: Data::new(&model), model, phi }
    }

    fn go_to(&mut self, d: f64) {
        assert!(assemble(&self.model, &mut self.data).is_closed && walk_to(&self.model, &mut self.data, &[d]).is_closed);
    }

    /// Projected mass and velocity force at `d` `[m]` and `v` `[m/s]`; `None` where the loop does not close.
    fn reduced(&mut self, d: f64, v: f64) -> Option<(f64, f64)> {
        let mut effort =
            |v: f64, a: f64| inverse_dynamics(&self.model, &mut self.data, &[d], &[v], &[a]).is_closed.then(|| self.data.tau_act[0]);
        let bias = effort(v, 0.0)?;
        Some((effort(v, 1.0)? - bias, bias))
    }

    /// Ankle angles, from the model's zero, while `force` (of time and speed) acts on the piston from rest at `d0`.
    fn ankle(&mut self, d0: f64, n: usize, force: &dyn Fn(f64, f64) -> f64) -> Option<Vec<f64>> {
        self.go_to(d0);
        let (mut d, mut v) = (d0, 0.0);
        let mut out = Vec::with_capacity(n);
        for i in 0..n {
            let t = DT * i as f64;
            let mut rate = |d: f64, v: f64, t: f64| {
                if !(-0.002..0.106).contains(&d) {
                    return None;
                }
                let (mass, bias) = self.reduced(d, v)?;
                Some((v, (force(t, v) - bias) / mass))
            };
            let k1 = rate(d, v, t)?;
            let phi = self.data.q[self.phi];
            out.push(phi);
            let mut rate = |d: f64, v: f64, t: f64| {
                let (mass, bias) = self.reduced(d, v)?;
                Some((v, (force(t, v) - bias) / mass))
            };
            let k2 = rate(d + 0.5 * DT * k1.0, v + 0.5 * DT * k1.1, t + 0.5 * DT)?;
            let k3 = rate(d + 0.5 * DT * k2.0, v + 0.5 * DT * k2.1, t + 0.5 * DT)?;
            let k4 = rate(d + DT * k3.0, v + DT * k3.1, t + DT)?;
            d += DT / 6.0 * (k1.0 + 2.0 * k2.0 + 2.0 * k3.0 + k4.0);
            v += DT / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1);
        }
        Some(out)
    }

    /// Ankle angles at given piston positions.
    fn ankle_at(&mut self, d: &[f64]) -> Option<Vec<f64>> {
        self.go_to(d[0]);
        d.iter()
            .map(|&d| inverse_dynamics(&self.model, &mut self.data, &[d], &[0.0], &[0.0]).is_closed.then(|| self.data.q[self.phi]))
            .collect()
    }

    /// Piston position at an ankle angle of the paper `[deg]`; by halving.
    fn piston(&mut self, phi_deg: f64) -> f64 {
        let wanted = phi_deg.to_radians() - HOME;
        let (mut low, mut high) = (0.0, 0.103);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            let there = self.ankle_at(&[0.0515, middle]).expect("inside the travel")[1];
            // The ankle angle falls with the piston.
            if there > wanted { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// A voltage `a·sin(2πft)`.
#[derive(Clone, Copy)]
struct Sine {
    amplitude: f64,
    frequency: f64,
    start: f64,
}

impl Sine {
    /// Its rate `[V/s]`: what acts on the piston.
    fn rate(&self, t: f64) -> f64 {
        let w = 2.0 * PI * self.frequency;
        self.amplitude * w * math::cos(w * t)
    }
}

/// Pistons stay below 0.06 m: further up the projected mass doubles, and nothing holds an open-loop motion back.
/// Eight records for the fit and two others, as in the paper's figures 3 and 4: amplitudes `[V]`, frequencies `[Hz]`, start of the piston `[m]`.
const SINES: [Sine; 10] = [
    Sine { amplitude: 2.0, frequency: 0.25, start: 0.03 },
    Sine { amplitude: 3.0, frequency: 0.4, start: 0.03 },
    Sine { amplitude: 6.0, frequency: 0.6, start: 0.025 },
    Sine { amplitude: 3.0, frequency: 0.5, start: 0.03 },
    Sine { amplitude: 7.0, frequency: 0.8, start: 0.025 },
    Sine { amplitude: 2.0, frequency: 0.3, start: 0.035 },
    Sine { amplitude: 7.0, frequency: 1.0, start: 0.03 },
    Sine { amplitude: 4.0, frequency: 0.7, start: 0.035 },
    Sine { amplitude: 2.5, frequency: 0.35, start: 0.03 },
    Sine { amplitude: 7.0, frequency: 0.9, start: 0.028 },
];

const SAMPLES: usize = 200;

/// One period of the sine that compares the input gains.
const PERIOD: usize = 50;

/// Input gain b0 `[N·s/V]`, viscous `[N·s/m]` and dry friction `[N]` of the piston.
const TRUTH: [f64; 3] = [0.0627, 1.5, 0.03];

fn friction(x: &[f64], v: f64) -> f64 {
    x[1] * v + x[2] * math::tanh(v / SOFT)
}

fn unknown(name: &str, unit: &'static str, start: f64, scale: f64, lower: f64) -> Unknown {
    Unknown { name: name.to_string(), unit, start, scale, bounds: Bounds { lower, upper: 100.0 } }
}

fn normal(draw: &mut Draw) -> f64 {
    (0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0
}

#[test]
fn friction_and_input_gain_come_back_from_eight_sinusoids_and_foretell_others() {
    let mut plant = Plant::new();
    let mut draw = Draw::new(4);
    // An encoder of 4000 counts per turn on the ankle, as noise.
    let sd = 2.0 * PI / 4000.0 / 12.0_f64.sqrt();
    let mut record = |s: &Sine| {
        let phi = plant.ankle(s.start, SAMPLES, &|t, v| TRUTH[0] * s.rate(t) - friction(&TRUTH, v)).expect("inside the travel");
        let name = format!("{} V, {} Hz", s.amplitude, s.frequency);
        Trial { name, outputs: vec![phi.iter().map(|p| p + sd * normal(&mut draw)).collect()] }
    };
    let trials: Vec<Trial> = SINES.iter().map(&mut record).collect();
    let mut simulate = |x: &[f64], i: usize| {
        let s = SINES[i];
        plant.ankle(s.start, SAMPLES, &|t, v| x[0] * s.rate(t) - friction(x, v)).map(|phi| vec![phi])
    };
    let unknowns =
        [unknown("b0", "N·s/V", 0.05, 0.005, 0.01), unknown("viscous", "N·s/m", 0.5, 0.5, 0.0), unknown("coulomb", "N", 0.01, 0.01, 0.0)];
    let out = output_error(&unknowns, &trials[..8], &trials[8..], &mut simulate, Strategy::Squares).expect("it can be simulated");
    assert_eq!(out.ending, Ending::Settled);
    // White noise of standard deviation s about the true motion: covariance s²·(JᵀJ)⁻¹, with J by differences of the simulation here.
    let along = |x: &[f64], plant: &mut Plant| -> Vec<f64> {
        let one = |s: &Sine| plant.ankle(s.start, SAMPLES, &|t, v| x[0] * s.rate(t) - friction(x, v)).expect("inside the travel");
        SINES[..8].iter().flat_map(one).collect()
    };
    let mut plant = Plant::new();
    let column = |k: usize, plant: &mut Plant| {
        let [high, low] = [1.0, -1.0].map(|side| {
            let mut x = TRUTH;
            x[k] *= 1.0 + 1e-3 * side;
            along(&x, plant)
        });
        high.iter().zip(low).map(|(h, l)| (h - l) / (2e-3 * TRUTH[k])).collect::<Vec<f64>>()
    };
    let j: Vec<Vec<f64>> = (0..3).map(|k| column(k, &mut plant)).collect();
    let gram = nalgebra::Matrix3::from_fn(|a, b| j[a].iter().zip(&j[b]).map(|(x, y)| x * y).sum::<f64>());
    let covariance = gram.try_inverse().expect("three parameters that are told apart") * (sd * sd);
    for (k, (f, want)) in out.found.iter().zip(TRUTH).enumerate() {
        assert!((f.value / want - 1.0).abs() < 0.05, "{f:?}, true {want}");
        let (half, wanted) = (0.5 * (f.ci95[1] - f.ci95[0]), 1.96 * covariance[(k, k)].sqrt());
        println!(
            "{}: off {:.2} standard deviations, half width {:.3} of the closed form",
            f.name,
            1.96 * (f.value - want) / wanted,
            half / wanted
        );
        // Some of the residual's correlations are taken for colour by chance: a width is known to a tenth or two.
        assert!((half / wanted - 1.0).abs() < 0.25, "{f:?}: half width {half}, closed form {wanted}");
        // One in a thousand of normal errors is further off.
        assert!((f.value - want).abs() < 3.3 / 1.96 * wanted, "{f:?}, true {want}, standard deviation {}", wanted / 1.96);
    }
    assert!(out.fitted.iter().chain(&out.validated).all(|m| m.nrmse[0] < 0.02), "{:?} {:?}", out.fitted, out.validated);
    assert!(out.confounded.is_empty() && out.condition < 100.0);
}

// The drive of the robot is a velocity loop: d' = b1·u, whatever moves. Fitted to its records, the model whose force is b0·u' finds
// b0 = b1·(mass that the piston feels there): the printed ratio b0/b1 = 8.416 kg is the projected mass at 110 degrees, and not the sum of
// the masses, 11.16 kg, that the paper's control law divides by.
#[test]
fn the_ratio_of_the_input_gains_is_the_projected_mass() {
    let mut plant = Plant::new();
    let b1 = 0.00745;
    for (degrees, projected, tolerance) in [(80.0, 12.1, 0.02), (92.7, 9.7, 0.02), (110.0, 8.416, 0.01), (140.0, 7.95, 0.02)] {
        let middle = plant.piston(degrees);
        plant.go_to(middle);
        let (mass, _) = plant.reduced(middle, 0.0).expect("inside the travel");
        let sine = Sine { amplitude: 0.05, frequency: 1.0, start: middle };
        // Small and short: the mass grows along the stroke, and its growth pushes the piston on.
        // A sine from rest moves to one side only: it starts half a stroke below.
        let stroke = b1 * sine.amplitude / (2.0 * PI * sine.frequency);
        let start = middle - stroke;
        let w = 2.0 * PI * sine.frequency;
        let along = |gain: f64| -> Vec<f64> {
            (0..PERIOD).map(|i| start + gain * sine.amplitude / w * (1.0 - math::cos(w * DT * i as f64))).collect()
        };
        let trial = Trial { name: format!("{degrees} deg"), outputs: vec![plant.ankle_at(&along(b1)).expect("inside the travel")] };
        let mut force = |x: &[f64], _: usize| plant.ankle(start, PERIOD, &|t, _| x[0] * sine.rate(t)).map(|phi| vec![phi]);
        let b0 =
            output_error(&[unknown("b0", "N·s/V", 0.05, 0.01, 1e-4)], core::slice::from_ref(&trial), &[], &mut force, Strategy::Squares)
                .expect("a fit");
        let mut speed = |x: &[f64], _: usize| plant.ankle_at(&along(x[0])).map(|phi| vec![phi]);
        let b1_found =
            output_error(&[unknown("b1", "m/(s·V)", 0.005, 0.001, 1e-5)], &[trial], &[], &mut speed, Strategy::Squares).expect("a fit");
        let ratio = b0.found[0].value / b1_found.found[0].value;
        println!(
            "{degrees} deg: b0 {:.5}, b1 {:.6}, ratio {ratio:.3} kg, projected {mass:.3} kg, stated {projected}",
            b0.found[0].value, b1_found.found[0].value
        );
        assert!((b1_found.found[0].value / b1 - 1.0).abs() < 1e-6, "{:?}", b1_found.found);
        assert!((mass / projected - 1.0).abs() < 0.01, "{degrees}: {mass}");
        assert!((ratio / projected - 1.0).abs() < tolerance, "{degrees}: {ratio} {projected}");
    }
}
