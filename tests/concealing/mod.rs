//! Robots and recordings with something concealed in them, for tests of what a verdict claims: simulated plants, and planar arms and slides of
//! which the efforts are written down in closed form.

use core::f64::consts::TAU;

use pkm_diagnose::verdict::{EffectAt, Finding, Verdict};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::math;
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::Recording;
use pkm_sim::Scenario;

use crate::Draw;

/// A robot that comes with the workspace.
///
/// # Panics
/// When there is none of that name.
#[must_use]
pub fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

/// One motion per seed of a plant with `hidden` in it, under the nominal robot's controller; `None` where that cannot move it.
#[must_use]
pub fn motions(nominal: &Description, hidden: &[Applied], seeds: &[u64]) -> Option<Vec<Recording>> {
    let truth = Robot::new(nominal.bare.clone(), [nominal.robot.effects.clone(), hidden.to_vec()].concat());
    let record = |seed: &u64| {
        let scenario = Scenario { seed: *seed, ..Scenario::default() };
        let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).ok()?;
        r.name = format!("motion{seed}");
        Some(r)
    };
    seeds.iter().map(record).collect()
}

/// An effect at a place.
#[must_use]
pub fn at(effect: &str, place: &[&str]) -> EffectAt {
    let place = place.iter().map(|p| (*p).to_string()).collect();
    EffectAt { effect: effect.to_string(), place, separating_experiment: String::new() }
}

/// The finding as an effect at a place.
#[must_use]
pub fn named(f: &Finding) -> EffectAt {
    EffectAt { effect: f.effect.clone(), place: f.place.clone(), separating_experiment: String::new() }
}

/// Whether the two are one name, and have a place in common.
#[must_use]
pub fn is_same(a: &EffectAt, b: &EffectAt) -> bool {
    a.effect == b.effect && a.place.iter().any(|p| b.place.contains(p))
}

/// What a finding may be: itself, and everything that it says it cannot be told from.
#[must_use]
pub fn alias_set(f: &Finding) -> Vec<EffectAt> {
    core::iter::once(named(f)).chain(f.cannot_tell_from.iter().cloned()).collect()
}

/// Findings in one line, with what each cannot be told from.
#[must_use]
pub fn told(v: &Verdict) -> String {
    let one = |e: &EffectAt| format!("{}@{}", e.effect, e.place.join(","));
    let finding = |f: &Finding| {
        let same: Vec<String> = f.cannot_tell_from.iter().map(one).collect();
        format!("{} {:.2} {{{}}}", one(&named(f)), f.confidence, same.join(" "))
    };
    let mut out: Vec<String> = v.findings.iter().map(finding).collect();
    if v.unexplained.present {
        out.push(format!("unexplained at {}", v.unexplained.place.join(",")));
    }
    if out.is_empty() { "nothing missing".to_string() } else { out.join("; ") }
}

/// A coordinate along time: position, velocity, acceleration.
pub type Wave = Vec<[f64; 3]>;

/// Time between samples of closed-form recordings `[s]`.
pub const STEP_S: f64 = 2e-3;

/// A sum of sines, each an amplitude and a frequency `[Hz]`.
#[must_use]
pub fn wave(sines: &[(f64, f64)], phase: f64, n: usize) -> Wave {
    let at = |t: f64| {
        sines.iter().fold([0.0; 3], |[q, v, a], (size, hz)| {
            let (w, u) = (TAU * hz, TAU * hz * t + phase);
            [q + size * math::sin(u), v + size * w * math::cos(u), a - size * w * w * math::sin(u)]
        })
    };
    (0..n).map(|i| at(STEP_S * i as f64)).collect()
}

/// A recording of joints, each a name, its positions and its efforts, with white noise of deviation `noise` on the efforts.
#[must_use]
pub fn recording(name: &str, joints: &[(&str, Vec<f64>, Vec<f64>)], noise: f64, seed: u64) -> Recording {
    let mut draw = Draw::new(seed);
    let n = joints[0].1.len();
    let mut out = Recording { name: name.to_string(), time: (0..n).map(|i| STEP_S * i as f64).collect(), ..Recording::default() };
    for (joint, q, tau) in joints {
        // The sum of twelve uniform numbers less six is normal enough, with unit variance.
        let noisy = tau.iter().map(|t| t + noise * ((0..12).map(|_| draw.uniform(0.0..1.0)).sum::<f64>() - 6.0)).collect();
        out.signals.insert(format!("q.{joint}"), q.clone());
        out.signals.insert(format!("tau.{joint}"), noisy);
    }
    out
}

/// One link of an [`Arm`].
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// `[kg]`.
    pub mass: f64,
    /// Distance of the centre of mass from the link's joint, along the link `[m]`.
    pub centre: f64,
    /// Inertia about the centre of mass `[kg·m²]`.
    pub inertia: f64,
}

/// Length of an arm's first link `[m]`.
const LENGTH: f64 = 0.4;

const GRAVITY: f64 = 9.81;

/// Two links in a vertical plane, horizontal where both angles are zero; joints `j1` and `j2` about y, links `upper` and `fore`.
#[derive(Debug, Clone, Copy)]
pub struct Arm {
    /// The links.
    pub links: [Link; 2],
}

impl Arm {
    /// The arm of the robot file.
    pub const NOMINAL: Self =
        Self { links: [Link { mass: 4.0, centre: 0.2, inertia: 0.06 }, Link { mass: 2.0, centre: 0.15, inertia: 0.02 }] };

    /// Its robot, without friction.
    ///
    /// # Panics
    /// Never: the texts are complete.
    #[must_use]
    pub fn robot(&self) -> Description {
        let mut urdf = "<robot name=\"arm\"><link name=\"base\"/>".to_string();
        let parts = [("upper", "base", "j1", 0.0), ("fore", "upper", "j2", LENGTH)];
        for (Link { mass, centre, inertia }, (link, parent, joint, x)) in self.links.iter().zip(parts) {
            urdf += &format!(
                r#"<link name="{link}"><inertial><origin xyz="{centre} 0 0" rpy="0 0 0"/><mass value="{mass}"/><inertia ixx="{}" ixy="0" ixz="0"
                iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link><joint name="{joint}" type="revolute"><parent link="{parent}"/>
                <child link="{link}"/><origin xyz="{x} 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/>
                <limit lower="-3" upper="3" effort="500" velocity="20"/><dynamics damping="0" friction="0"/></joint>"#,
                0.1 * inertia
            );
        }
        let drives = ["j1", "j2"].map(|j| format!("\n[[actuator]]\njoint = \"{j}\"\nrotor_inertia = 0.0\n")).concat();
        let toml = format!("name = \"arm\"\nurdf = \"arm.urdf\"\n{drives}");
        parse(&toml, &(urdf + "</robot>"), ["arm.toml", "arm.urdf"]).expect("a readable robot")
    }

    /// Efforts of both joints by Lagrange's equations.
    #[must_use]
    pub fn efforts(&self, [q1, v1, a1]: [f64; 3], [q2, v2, a2]: [f64; 3]) -> [f64; 2] {
        let [u, f] = self.links;
        let (c2, s2) = (math::cos(q2), math::sin(q2));
        let turning = f.inertia + f.mass * f.centre * f.centre;
        let beside = f.mass * LENGTH * f.centre;
        let m11 = u.inertia + u.mass * u.centre * u.centre + f.mass * LENGTH * LENGTH + turning + 2.0 * beside * c2;
        let m12 = turning + beside * c2;
        // About y a positive angle lowers the link.
        let g2 = -f.mass * f.centre * GRAVITY * math::cos(q1 + q2);
        let g1 = g2 - (u.mass * u.centre + f.mass * LENGTH) * GRAVITY * math::cos(q1);
        let h = beside * s2;
        [m11 * a1 + m12 * a2 - h * (2.0 * v1 * v2 + v2 * v2) + g1, m12 * a1 + turning * a2 + h * v1 * v1 + g2]
    }
}

/// One carriage `cx` of 10 kg without friction on a level slide `x`.
///
/// # Panics
/// Never: the texts are complete.
#[must_use]
pub fn slide() -> Description {
    let urdf = r#"<robot name="slide"><link name="base"/><link name="cx"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="10"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link><joint name="x" type="prismatic"><parent link="base"/>
        <child link="cx"/><origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/><limit lower="-5" upper="5" effort="1000" velocity="10"/>
        <dynamics damping="0" friction="0"/></joint></robot>"#;
    let toml = "name = \"slide\"\nurdf = \"slide.urdf\"\n\n[[actuator]]\njoint = \"x\"\nrotor_inertia = 0.0\n";
    parse(toml, urdf, ["slide.toml", "slide.urdf"]).expect("a readable robot")
}
