//! What cannot be told apart is not told apart: of pairs that are one and the same in the equations, whichever is named lists the other.
//!
//! Efforts are written down in closed form, so that no simulator has a part in it. A second table takes verdicts at their own word: what their
//! matrix says is closer than the alias limit to what was found, findings list as well.

use pkm_diagnose::isolability::ALIAS_COSINE;
use pkm_diagnose::verdict::{EffectAt, Finding, Verdict};
use pkm_diagnose::{Settings, diagnose};
use pkm_dyn::math;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use pkm_tests::concealing::{Arm, Link, Wave, alias_set, at, is_same, motions, named, recording, shipped, slide, told, wave};

const SAMPLES: usize = 6000;

/// Sines of two motions of the first joint, and two of the second.
const SINES: [[[(f64, f64); 2]; 2]; 2] =
    [[[(0.5, 0.3), (0.15, 0.9)], [(0.6, 0.4), (0.2, 1.1)]], [[(0.6, 0.35), (0.1, 1.0)], [(0.5, 0.5), (0.2, 0.8)]]];

fn verdict(robot: &Description, r: &[Recording]) -> Verdict {
    diagnose(robot, &r[..1], &r[1..], &Settings::default(), &mut |_| {}).expect("usable recordings").verdict
}

/// Two motions of an arm whose efforts are `made`, recorded at positions that are `off` the true ones.
fn arms(off: f64, noise: f64, made: impl Fn([f64; 3], [f64; 3]) -> [f64; 2]) -> Vec<Recording> {
    let one = |k: usize| {
        let [a, b] = [0, 1].map(|j| wave(&SINES[k][j], 0.7 * (k + 2 * j) as f64, SAMPLES));
        let efforts: Vec<[f64; 2]> = a.iter().zip(&b).map(|(a, b)| made(*a, *b)).collect();
        let read = |w: &Wave, off: f64| w.iter().map(|w| w[0] - off).collect::<Vec<f64>>();
        let joints =
            [("j1", read(&a, off), efforts.iter().map(|t| t[0]).collect()), ("j2", read(&b, 0.0), efforts.iter().map(|t| t[1]).collect())];
        recording(&format!("motion{k}"), &joints, noise, 7 + k as u64)
    };
    (0..2).map(one).collect()
}

/// Samples by which an effort may lead.
const AHEAD: usize = 6;

/// Two motions of the slide; `made` gets all samples, [`AHEAD`] more than are recorded, and the number of one.
fn slides(noise: f64, made: impl Fn(&Wave, usize) -> f64) -> Vec<Recording> {
    let one = |k: usize| {
        let w = wave(&SINES[k][0], 0.4 * k as f64, SAMPLES + AHEAD);
        let tau = (0..SAMPLES).map(|i| made(&w, i)).collect();
        recording(&format!("motion{k}"), &[("x", w[..SAMPLES].iter().map(|w| w[0]).collect(), tau)], noise, 3 + k as u64)
    };
    (0..2).map(one).collect()
}

/// One concealed thing with all its names, and what was made of it.
struct Case {
    robot: &'static str,
    names: Vec<EffectAt>,
    verdict: Verdict,
}

/// Heavier by a factor: its mass, its rotor, a load on it, or its scale.
fn mass_on_one_axis() -> Case {
    let names = vec![at("inertia_error", &["cx"]), at("payload", &["cx"]), at("rotor_inertia", &["x"]), at("torque_constant", &["x"])];
    Case { robot: "slide", names, verdict: verdict(&slide(), &slides(0.5, |w, i| 13.0 * w[i][2])) }
}

/// The effort leads by 12 ms, at frequencies where the square of the phase is nothing beside noise.
fn late_on_one_axis() -> Case {
    let names = vec![at("time_delay", &["x"]), at("actuator_lag", &["x"])];
    Case { robot: "slide", names, verdict: verdict(&slide(), &slides(0.5, |w, i| 10.0 * w[i + AHEAD][2])) }
}

/// A slide that is not level is pulled along by the same force everywhere.
fn tilted_slide() -> Case {
    let names = vec![at("torque_offset", &["x"]), at("gravity_tilt", &["base"])];
    Case { robot: "slide", names, verdict: verdict(&slide(), &slides(0.5, |w, i| 10.0 * w[i][2] - 10.0 * 9.81 * math::sin(0.08))) }
}

/// The first joint's axis is level: turning the base about it, or the zero of its encoder, is one thing.
fn turned_base() -> Case {
    let nominal = Arm::NOMINAL;
    let names = vec![at("gravity_tilt", &["base"]), at("encoder_offset", &["j1"])];
    Case { robot: "arm", names, verdict: verdict(&nominal.robot(), &arms(0.06, 0.02, |a, b| nominal.efforts(a, b))) }
}

/// Every drive reads a quarter too much, or every link is a quarter heavier.
fn scaled_arm() -> Case {
    let nominal = Arm::NOMINAL;
    let names = vec![at("inertia_error", &["upper", "fore"]), at("torque_constant", &["j1", "j2"])];
    let made = |a, b| nominal.efforts(a, b).map(|t| 1.25 * t);
    Case { robot: "arm", names, verdict: verdict(&nominal.robot(), &arms(0.0, 0.02, made)) }
}

/// A heavier last link: its own, or something on it.
fn loaded_arm() -> Case {
    let mut loaded = Arm::NOMINAL;
    // 0.8 kg at 0.3 m of the last link.
    let (m, c, load, at_x) = (loaded.links[1].mass, loaded.links[1].centre, 0.8, 0.3);
    let centre = (m * c + load * at_x) / (m + load);
    let inertia = loaded.links[1].inertia + m * (c - centre) * (c - centre) + load * (at_x - centre) * (at_x - centre);
    loaded.links[1] = Link { mass: m + load, centre, inertia };
    let names = vec![at("payload", &["fore"]), at("inertia_error", &["fore"])];
    Case { robot: "arm", names, verdict: verdict(&Arm::NOMINAL.robot(), &arms(0.0, 0.02, |a, b| loaded.efforts(a, b))) }
}

/// Losses in proportion to the load, alike in both directions.
fn losses() -> Case {
    let nominal = Arm::NOMINAL;
    let made = |a: [f64; 3], b: [f64; 3]| {
        let [t1, t2] = nominal.efforts(a, b);
        [t1 + 0.2 * t1.abs() * math::sign(a[1]), t2]
    };
    let names = vec![at("friction_load", &["j1"]), at("directional_efficiency", &["j1"])];
    Case { robot: "arm", names, verdict: verdict(&nominal.robot(), &arms(0.0, 0.02, made)) }
}

/// Whether some finding is one of the two and lists the other.
fn lists(v: &Verdict, a: &EffectAt, b: &EffectAt) -> bool {
    let is_one = |f: &Finding| is_same(&named(f), a) || is_same(&named(f), b);
    let has = |f: &Finding, e: &EffectAt| alias_set(f).iter().any(|s| is_same(s, e));
    // Named by a third that is as good, both must stand beside it.
    let of_a_third = |f: &Finding| f.cannot_tell_from.len() > 1;
    v.findings.iter().any(|f| (is_one(f) || of_a_third(f)) && has(f, a) && has(f, b))
}

#[test]
fn what_is_one_in_the_equations_is_one_in_the_alias_set() {
    let cases = [mass_on_one_axis, late_on_one_axis, tilted_slide, turned_base, scaled_arm, loaded_arm, losses].map(|make| make());
    let mut lines = Vec::new();
    let mut split = Vec::new();
    for c in &cases {
        for (i, a) in c.names.iter().enumerate() {
            for b in &c.names[i + 1..] {
                let [x, y] = [a, b].map(|e| format!("{}@{}", e.effect, e.place.join(",")));
                let is_said = lists(&c.verdict, a, b);
                let line = format!("| {} | {x} | {y} | {} | {} |", c.robot, if is_said { "yes" } else { "no" }, told(&c.verdict));
                if !is_said {
                    split.push(line.clone());
                }
                lines.push(line);
            }
        }
    }
    let text = format!("| robot | one | other | said to be one | verdict |\n|---|---|---|---|---|\n{}\n", lines.join("\n"));
    pkm_tests::results_table("alias_pairs", &text);
    assert!(split.is_empty(), "told apart though they are one:\n{}", split.join("\n"));
}

/// Laws with another one in them. That they lie near it is their construction, and what they add is tried by itself: they are no rivals of it.
const WIDER: [(&str, &[&str]); 3] = [
    ("friction_coulomb", &["friction_stribeck", "friction_asymmetric", "friction_quadratic", "friction_position", "friction_presliding"]),
    ("friction_viscous", &["friction_stribeck", "friction_asymmetric", "friction_quadratic"]),
    ("spring", &["cable_force"]),
];

/// Pairs of a finding and what the verdict's matrix puts within the alias limit of it, each with whether the finding says so: in its set, or as
/// a look-alike that is told apart with a reason.
fn own_word(v: &Verdict) -> Vec<(EffectAt, EffectAt, &'static str)> {
    let m = &v.isolability;
    let seen = |i: usize| EffectAt {
        effect: m.effects[i].effect.clone(),
        place: m.effects[i].place.clone(),
        separating_experiment: String::new(),
    };
    let mut out = Vec::new();
    for f in &v.findings {
        let Some(i) = (0..m.effects.len()).find(|&i| m.effects[i].found && is_same(&seen(i), &named(f))) else { continue };
        for j in (0..m.effects.len()).filter(|&j| j != i && !m.effects[j].found && m.cosines[i][j] > ALIAS_COSINE) {
            let other = seen(j);
            if WIDER.iter().any(|(law, wider)| f.effect == *law && wider.contains(&other.effect.as_str())) {
                continue;
            }
            let is_alias = f.cannot_tell_from.iter().any(|e| is_same(e, &other));
            let is_refused = f.look_alikes.iter().any(|l| l.effect == other.effect);
            out.push((
                named(f),
                other,
                if is_alias {
                    "alias"
                } else if is_refused {
                    "refused with a reason"
                } else {
                    "not a word"
                },
            ));
        }
    }
    out
}

/// The table of a robot, and how often a finding answers for what the matrix puts beside it, and how often it does not.
fn matrix_table(robot: &str, effects: &[&str]) -> ([usize; 2], String) {
    let nominal = shipped(robot);
    let mut lines = Vec::new();
    let mut counts = [0_usize; 2];
    for effect in effects {
        let Ok(hidden) = pkm_sim::draw(2, &nominal, Some(effect), &[]) else { continue };
        let Some(r) = motions(&nominal, &hidden, &[21, 22]) else { continue };
        for (f, other, said) in own_word(&verdict(&nominal, &r)) {
            counts[usize::from(said == "not a word")] += 1;
            let [x, y] = [&f, &other].map(|e| format!("{}@{}", e.effect, e.place.join(",")));
            lines.push(format!("| {robot} | {effect} | {x} | {y} | {said} |"));
        }
    }
    let [said, silent] = counts;
    let head = "| robot | concealed | found | within the alias limit of it | said |\n|---|---|---|---|---|\n";
    (counts, format!("{head}{}\n\nanswered for: {said} of {}\n", lines.join("\n"), said + silent))
}

#[test]
fn findings_list_what_the_matrix_of_the_same_verdict_cannot_tell_from_them() {
    let is_long = std::env::var_os("PKM_LONG").is_some();
    let all = pkm_diagnose::looked_for();
    let (robots, effects): (&[&str], &[&str]) =
        if is_long { (&["five_bar", "prs3"], &all) } else { (&["five_bar"], &["friction_load", "payload"]) };
    for robot in robots {
        let ([said, silent], text) = matrix_table(robot, effects);
        pkm_tests::results_table(&format!("alias_matrix_{robot}"), &text);
        // The matrix takes the smallest angle between all that two effects can be: of ten mass properties some combination is often near, and
        // the one that was found need not be it. So not every pair is an alias of the finding.
        assert!(said > 0 && 5 * said >= 4 * (said + silent), "{text}");
    }
}
