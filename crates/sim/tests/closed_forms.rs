//! A pendulum and a slider, whose equations fit on a line, against the plant and against whole recorded runs.

use core::f64::consts::PI;

use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_ident::Recording;
use pkm_sim::{Plant, ReducedPlant, Scenario, Shape, Shaped, run_along};

/// 1.5 kg at 0.4 m from a horizontal pin, 0.02 kg·m² about its own centre; it hangs down at 0.
const PENDULUM: &str = r#"<robot name="pendulum"><link name="base"/>
  <link name="bob"><inertial><origin xyz="0 0 -0.4"/><mass value="1.5"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="q" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="20"/><dynamics damping="0" friction="0"/></joint>
</robot>"#;

const INERTIA: f64 = 0.02 + 1.5 * 0.4 * 0.4;
const WEIGHT: f64 = 1.5 * 9.81 * 0.4;

/// 2 kg on a rail that rises by 30°.
const SLIDER: &str = r#"<robot name="slider"><link name="base"/>
  <link name="block"><inertial><mass value="2.0"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="q" type="prismatic"><parent link="base"/><child link="block"/><origin rpy="0 -0.5235987755982988 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" effort="100" velocity="5"/><dynamics damping="0" friction="0"/></joint>
</robot>"#;

fn model(name: &str, urdf: &str) -> Model {
    let toml = format!("name = \"{name}\"\nurdf = \"{name}.urdf\"\n[[actuator]]\njoint = \"q\"\n");
    parse(&toml, urdf, ["robot.toml", "robot.urdf"]).expect("the robot loads").bare
}

/// A noise-free run with minimum-jerk moves of half the travel, one every second.
fn recorded(truth: &Robot, nominal: &Robot) -> Recording {
    let scenario = Scenario {
        duration_s: 8.0,
        rate_hz: 1000.0,
        encoder_resolution: 0.0,
        encoder_noise: 0.0,
        effort_noise: 0.0,
        ..Scenario::default()
    };
    let motion = Shaped::draw(&nominal.model, Shape::MinimumJerk { period_s: 1.0 }, 8.0, 0.5, 2).expect("the run succeeds");
    run_along([truth, nominal], &scenario, &motion, &mut |_| {}).expect("the run succeeds")
}

/// Position, velocity, acceleration and effort at every inner sample, by central differences.
fn rows(recording: &Recording) -> Vec<[f64; 4]> {
    let (q, tau) = (recording.signal("q.q").expect("recorded"), recording.signal("tau.q").expect("recorded"));
    let h = recording.time[1] - recording.time[0];
    let row = |i: usize| [q[i], (q[i + 1] - q[i - 1]) / (2.0 * h), (q[i + 1] - 2.0 * q[i] + q[i - 1]) / (h * h), tau[i]];
    (1..q.len() - 1).map(row).collect()
}

#[test]
fn a_pendulum_swings_with_the_period_of_the_elliptic_integral() {
    let robot = Robot::new(model("pendulum", PENDULUM), Vec::new());
    for start in [0.1, 1.0, 2.0] {
        let mut plant = ReducedPlant::try_new(robot.clone(), &[start]).unwrap();
        let (h, mut crossings) = (5e-4, Vec::new());
        for step in 0..40_000 {
            let before = plant.position()[0];
            plant.step(&[0.0], h).unwrap();
            let now = plant.position()[0];
            if before < 0.0 && now >= 0.0 {
                crossings.push(h * (f64::from(step) + before / (before - now)));
            }
        }
        let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
        // T = 2π/ω₀ / agm(1, cos(θ₀/2)); to leading order the leapfrog errs by (ω₀·h)²/24 = 1e-7 here.
        let (mut a, mut g) = (1.0_f64, pkm_dyn::math::cos(0.5 * start));
        for _ in 0..6 {
            (a, g) = (0.5 * (a + g), f64::sqrt(a * g));
        }
        let want = 2.0 * PI * f64::sqrt(INERTIA / WEIGHT) / a;
        assert!((period / want - 1.0).abs() < 1e-6, "from {start} rad: {period} s, not {want} s");
    }
}

#[test]
fn the_recorded_effort_of_a_pendulum_is_that_of_its_equation() {
    let robot = Robot::new(model("pendulum", PENDULUM), Vec::new());
    let recording = recorded(&robot, &robot);
    let mut largest = (0.0_f64, 0.0_f64);
    for [q, _, a, tau] in rows(&recording) {
        let want = INERTIA * a + WEIGHT * pkm_dyn::math::sin(q);
        largest = (largest.0.max(want.abs()), largest.1.max((tau - want).abs()));
    }
    assert!(largest.0 > 5.0 && largest.1 < 1e-4 * largest.0, "{:e} N·m of {:e} N·m", largest.1, largest.0);
}

#[test]
fn a_slider_with_concealed_dry_friction_needs_just_that_more_and_sticks_where_less_is_asked() {
    let nominal = Robot::new(model("slider", SLIDER), Vec::new());
    let effect = Applied::try_new(&nominal.model, "friction_coulomb", "q", &[("coulomb".to_string(), 5.0)]).unwrap();
    let truth = Robot::new(nominal.model.clone(), vec![effect]);
    let recording = recorded(&truth, &nominal);
    let weight = 2.0 * 9.81 * 0.5;
    let (mut forward, mut backward, mut standing) = (0, 0, 0);
    for [_, v, a, tau] in rows(&recording) {
        let beyond = tau - 2.0 * a - weight;
        // Within a few samples of a reversal the differences straddle the jump.
        if v.abs() > 0.01 && v.abs() > 5e-3 * a.abs() {
            assert!((beyond - 5.0 * v.signum()).abs() < 2e-3, "v = {v}: {beyond} N beyond the rigid body");
            if v > 0.0 { forward += 1 } else { backward += 1 }
        } else if v == 0.0 && a == 0.0 {
            assert!(beyond.abs() < 5.0 + 1e-9, "stands under {beyond} N");
            standing += 1;
        }
    }
    assert!(forward > 500 && backward > 500 && standing > 500, "{forward} forward, {backward} backward, {standing} standing");
}
