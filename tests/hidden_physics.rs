//! What the tool is for: physics concealed in a plant is found from recordings alone.
//!
//! One case = a truth (robot, one concealed effect, sensor noise, seed) and a separate nominal robot. The diagnosing side gets the
//! nominal robot and two recordings of the closed loop, nothing else.

use pkm_diagnose::{Diagnosis, Settings, diagnose};
use pkm_dyn::effects::{Applied, CATALOGUE, Robot};
use pkm_dyn::urdf::{Description, parse};
use pkm_sim::Scenario;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

/// Simulates two motions with the effects concealed and diagnoses them with the nominal robot.
fn trial(nominal: &Description, hidden: &[Applied], seed: u64) -> Diagnosis {
    let truth = Robot::new(nominal.bare.clone(), [nominal.robot.effects.clone(), hidden.to_vec()].concat());
    let record = |seed: u64| {
        let scenario = Scenario { seed, ..Scenario::default() };
        let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
        r.name = format!("motion{seed}");
        r
    };
    let (train, holdout) = (record(10 * seed + 1), record(10 * seed + 2));
    diagnose(nominal, &[train], &[holdout], &Settings::default(), &mut |_| {}).expect("the recordings are usable")
}

/// Whether the effect is named at its place, or stands in an alias set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    First,
    Named,
    Alias,
    Missed,
}

fn outcome(d: &Diagnosis, hidden: &Applied, nominal: &Description) -> Outcome {
    let (effect, place) = (hidden.entry.name, hidden.place_name(&nominal.bare).to_string());
    let is = |name: &str, at: &[String]| name == effect && at.contains(&place);
    let f = &d.verdict.findings;
    if f.first().is_some_and(|f| is(&f.effect, &f.place)) {
        Outcome::First
    } else if f.iter().any(|f| is(&f.effect, &f.place)) {
        Outcome::Named
    } else if f.iter().flat_map(|f| &f.cannot_tell_from).any(|a| is(&a.effect, &a.place)) {
        Outcome::Alias
    } else {
        Outcome::Missed
    }
}

#[test]
fn table() {
    let robot = std::env::var("PKM_ROBOT").unwrap_or_else(|_| "prs3".to_string());
    let nominal = shipped(&robot);
    for seed in 1..=2 {
        for entry in CATALOGUE {
            let Ok(hidden) = pkm_sim::draw(seed, &nominal, Some(entry.name)) else { continue };
            let d = trial(&nominal, &hidden, seed);
            let names: Vec<String> = d.verdict.findings.iter().map(|f| format!("{}@{}", f.effect, f.place.join(","))).collect();
            println!(
                "{seed} {:22} {:8} {:?} found {} | {:.3}->{:.3} | {}",
                entry.name,
                hidden[0].place_name(&nominal.bare),
                outcome(&d, &hidden[0], &nominal),
                names.join(" "),
                d.verdict.heldout.rms_nominal,
                d.verdict.heldout.rms_final,
                d.verdict.unexplained.place.join(",")
            );
        }
        let d = trial(&nominal, &[], seed);
        println!("{seed} healthy {:?} {}", d.verdict.findings.iter().map(|f| f.says.clone()).collect::<Vec<_>>(), d.verdict.says);
    }
}
