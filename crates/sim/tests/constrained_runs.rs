//! Whole runs with effects that have states: the controller still follows, the recording shows the effect, and repeats to the bit.

mod fixture;

use fixture::{entry, shipped};
use pkm_dyn::effects::{Applied, Entry, JointState, Law, LinkState, Memory, PlaceKind, Robot, Site, Transmission};
use pkm_ident::Recording;
use pkm_sim::{Scenario, needs_states, run};

static PLAY: Entry = entry("play", PlaceKind::Joint, Law::Transmission(Transmission::Play));
static ELASTIC: Entry = entry("elastic", PlaceKind::Joint, Law::Transmission(Transmission::Spring));
static STRUCTURE: Entry = entry("structure", PlaceKind::Link, Law::Structure);
static DRAG: Entry = entry("drag", PlaceKind::JointPair, Law::PairEffort(drag));
static DAHL: Entry = entry("dahl", PlaceKind::Joint, Law::Memory(Memory { rate: dahl_rate, effort: dahl_effort }));
static GUST: Entry = entry("gust", PlaceKind::Link, Law::Wrench(gust));
static PERSON: Entry = entry("person", PlaceKind::Link, Law::Person);
static CLIPPED: Entry = entry("clipped", PlaceKind::Joint, Law::EffortLimit);
static DEAD: Entry = entry("dead", PlaceKind::Joint, Law::EffortDeadZone);
static WAVY: Entry = entry("wavy", PlaceKind::Joint, Law::PositionPeriodic);
static DRIFTING: Entry = entry("drifting", PlaceKind::Joint, Law::Drift);
static MISSING: Entry = entry("missing", PlaceKind::Joint, Law::CommandShare);

fn drag(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.a + p[1] * s.v + p[2] * s.sign
}

fn dahl_rate(p: &[f64], z: f64, v: f64) -> f64 {
    v - p[0] * z * v.abs() / p[1]
}

fn dahl_effort(p: &[f64], z: f64, _: f64) -> f64 {
    p[0] * z
}

/// A damper along all three directions.
fn gust(p: &[f64], s: &LinkState) -> [f64; 6] {
    [p[0] * s.velocity[0], p[0] * s.velocity[1], p[0] * s.velocity[2], 0.0, 0.0, 0.0]
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = x.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x * x));
    f64::sqrt(sum / n)
}

fn recorded(name: &str, effects: Vec<Applied>) -> Recording {
    let nominal = Robot::new(shipped(name), Vec::new());
    let what: Vec<&str> = effects.iter().map(|e| e.entry.name).collect();
    let truth = Robot::new(nominal.model.clone(), effects);
    let scenario = Scenario {
        duration_s: 3.0,
        rate_hz: 500.0,
        period_s: 4.0,
        encoder_resolution: 0.0,
        encoder_noise: 0.0,
        effort_noise: 0.0,
        ..Scenario::default()
    };
    run(&truth, &nominal, &scenario, &mut |_| {}).unwrap_or_else(|e| panic!("{name} {what:?}: {e}"))
}

/// Effects at drive `k` of a robot, or on its last link.
fn effects(name: &str, k: usize, scale: f64) -> Vec<Applied> {
    let model = shipped(name);
    let j = model.actuators[k];
    let last = model.links.len() - 1;
    let mut pair = Applied::at(&DRAG, j, vec![0.1 * scale, scale, 2.0, 0.0]);
    pair.other = Some(model.actuators[(k + 1) % model.n_act()]);
    let at = |entry: &'static Entry, values: [f64; 4]| Applied { site: Site::Joint, ..Applied::at(entry, j, values.to_vec()) };
    vec![
        at(&PLAY, [2e-3, 0.0, 0.0, 0.0]),
        at(&ELASTIC, [1e4 * scale, 20.0 * scale, 0.0, 0.0]),
        Applied::at(&STRUCTURE, 0, vec![2e6, 4e3, 0.0, 0.0]),
        pair,
        at(&DAHL, [1e4 * scale, 5.0, 0.0, 0.0]),
        Applied::at(&GUST, last, vec![30.0, 0.0, 0.0, 0.0]),
        Applied::at(&PERSON, last, vec![10.0, 0.0, 0.0, 0.0]),
        at(&CLIPPED, [10.0 * scale, 0.0, 0.0, 0.0]),
        at(&DEAD, [2.0, 0.0, 0.0, 0.0]),
        at(&WAVY, [2e-3, 7.0, 0.3, 0.0]),
        at(&DRIFTING, [1e-3, 0.0, 0.0, 0.0]),
        at(&MISSING, [0.1, 0.0, 0.0, 0.0]),
    ]
}

#[test]
fn a_robot_with_any_effect_still_follows_and_its_recording_shows_the_effect() {
    for (name, k, scale) in [("five_bar", 0, 1.0), ("serial_arm", 1, 20.0), ("prs3", 2, 100.0)] {
        let model = shipped(name);
        let well = recorded(name, Vec::new());
        let peak = |j: usize| {
            let tau = well.signal(&format!("tau.{}", model.joints[j].name)).expect("recorded");
            tau.iter().fold(0.0_f64, |top, x| top.max(x.abs()))
        };
        for mut effect in effects(name, k, scale) {
            let what = effect.entry.name;
            if what == "clipped" {
                effect.values[0] = 0.95 * peak(effect.place);
            }
            let sick = recorded(name, vec![effect]);
            let mut shown = 0.0_f64;
            for &j in &model.actuators {
                let joint = &model.joints[j].name;
                let column = |of: &Recording, prefix: &str| of.signal(&format!("{prefix}.{joint}")).expect("recorded").to_vec();
                let (q, reference) = (column(&sick, "q"), column(&sick, "q_ref"));
                let travel = model.joints[j].limits.upper - model.joints[j].limits.lower;
                let error = rms(q.iter().zip(&reference).map(|(q, r)| q - r));
                assert!(error < 0.03 * travel, "{name} {what}: {joint} is off by {error} of {travel}");
                let (a, b) = (column(&sick, "tau"), column(&well, "tau"));
                shown = shown.max(rms(a.iter().zip(&b).map(|(a, b)| a - b)) / rms(b.iter().copied()));
            }
            assert!(shown > 1e-4, "{name} {what}: {shown}");
        }
    }
}

#[test]
fn a_run_with_every_effect_at_once_repeats_to_the_bit() {
    let bits = || -> Vec<u64> {
        let some = effects("five_bar", 1, 1.0).into_iter().filter(|e| e.entry.name != "elastic" && e.entry.name != "clipped").collect();
        recorded("five_bar", some).signals.values().flatten().map(|x| x.to_bits()).collect()
    };
    assert_eq!(bits(), bits());
}

#[test]
fn the_constrained_plant_is_taken_where_an_effect_has_states_only() {
    let states: Vec<&str> = effects("five_bar", 0, 1.0)
        .into_iter()
        .filter(|e| needs_states(&Robot::new(shipped("five_bar"), vec![e.clone()])))
        .map(|e| e.entry.name)
        .collect();
    assert_eq!(states, ["play", "elastic", "structure", "drag", "dahl", "gust", "person"]);
}
