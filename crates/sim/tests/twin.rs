//! Replays: a simulated recording comes back, a concealed mass shows, what cannot be replayed is refused.

mod fixture;

use fixture::{shipped, stated};
use pkm_dyn::effects::Robot;
use pkm_ident::KnownLoad;
use pkm_sim::twin::twin;
use pkm_sim::{ConstrainedOptions, PlantKind, Scenario, SimError, rerun, run};

fn quiet() -> Scenario {
    Scenario { duration_s: 3.0, rate_hz: 1000.0, encoder_resolution: 0.0, encoder_noise: 0.0, effort_noise: 0.0, ..Scenario::default() }
}

#[test]
fn a_simulated_recording_replays_with_an_error_of_rounding_and_a_concealed_mass_shows() {
    let nominal = Robot::new(shipped("five_bar"), Vec::new());
    let link = nominal.model.links.iter().find(|l| l.name == "distal_left").expect("the link is there").name.clone();
    let heavy = Robot::new(nominal.model.clone(), vec![stated(&nominal.model, "payload", &link, &[("mass", 0.8)])]);
    let recorded = |truth: &Robot| run(truth, &nominal, &quiet(), &mut |_| {}).expect("the run succeeds");
    let (well, sick) = (recorded(&nominal), recorded(&heavy));
    for plant in [PlantKind::Reduced, PlantKind::Constrained(ConstrainedOptions::default())] {
        // Between samples nothing of the reference is lost at 1 kHz; the other plant differs by its rule.
        let (position, effort) = if plant == PlantKind::Reduced { (1e-9, 1e-8) } else { (1e-5, 1e-3) };
        let same = twin([&nominal, &nominal], &well, plant).unwrap();
        let other = twin([&nominal, &nominal], &sick, plant).unwrap();
        let explained = twin([&heavy, &nominal], &sick, plant).unwrap();
        for k in 0..2 {
            let share = |of: &pkm_sim::Twin| of.joints[k].effort.map(|e| e.rms / e.measured_rms).unwrap();
            assert!(same.joints[k].position.rms < position && share(&same) < effort, "{:?}", same.joints[k]);
            assert!(share(&explained) < effort, "{:?}", explained.joints[k]);
            let [measured, simulated] = same.joints[k].work.unwrap();
            assert!((measured - simulated).abs() < 1e-3 * measured.abs().max(1.0), "{measured} J {simulated} J");
        }
        let largest = other.joints.iter().filter_map(|j| j.effort).map(|e| e.rms / e.measured_rms).fold(0.0, f64::max);
        assert!(largest > 0.02, "{largest}");
        assert!((same.duration_s - 3.0).abs() < 1e-12 && same.simulated.len() == well.len());
    }
}

#[test]
fn a_rerun_repeats_a_recording_of_any_length_and_with_the_load_it_states() {
    let robot = Robot::new(shipped("five_bar"), Vec::new());
    // Lengths at which the mean rate of 1 kHz is not 1000 Hz to the last bit.
    let rate = |n: usize, dt: f64| (n - 1) as f64 / ((n - 1) as f64 * dt);
    let lengths: Vec<usize> = (40..400).filter(|&n| rate(n, 1e-3) < 1000.0).take(3).chain([50, 101]).collect();
    for n in lengths {
        let mut recorded = run(&robot, &robot, &Scenario { duration_s: (n - 1) as f64 * 1e-3, ..quiet() }, &mut |_| {}).unwrap();
        recorded.time = (0..recorded.len()).map(|k| k as f64 * 1e-3).collect();
        let again = rerun([&robot, &robot], &recorded).unwrap();
        // One control period a sample in both: two would damp the joints by other amounts.
        let (a, b) = (&recorded.signals["q.shoulder_left"], &again.signals["q.shoulder_left"]);
        let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(a.len() == b.len() && apart < 1e-7, "{n} samples: {apart:e}");
    }
    let mut loaded = run(&robot, &robot, &Scenario { duration_s: 0.1, ..quiet() }, &mut |_| {}).unwrap();
    let without = twin([&robot, &robot], &loaded, PlantKind::Reduced).unwrap();
    loaded.meta.load = Some(KnownLoad { link: "distal_left".into(), mass: 2.0, xyz: [0.1, 0.0, 0.0] });
    let with = twin([&robot, &robot], &loaded, PlantKind::Reduced).unwrap();
    assert!(with.joints[0].effort.unwrap().rms > without.joints[0].effort.unwrap().rms + 0.01);
    loaded.meta.load = Some(KnownLoad { link: "tail".into(), mass: 2.0, xyz: [0.0; 3] });
    assert!(matches!(twin([&robot, &robot], &loaded, PlantKind::Reduced), Err(SimError::NoLink { link }) if link == "tail"));
    assert!(rerun([&robot, &robot], &loaded).is_err());
}

#[test]
fn what_cannot_be_replayed_is_refused() {
    let robot = Robot::new(shipped("five_bar"), Vec::new());
    let good = run(&robot, &robot, &Scenario { duration_s: 0.1, ..quiet() }, &mut |_| {}).unwrap();
    let mut blind = good.clone();
    blind.signals.remove("q_ref.shoulder_right");
    let refused = twin([&robot, &robot], &blind, PlantKind::Auto).unwrap_err();
    assert!(matches!(&refused, SimError::NoSignal { signal } if signal == "q_ref.shoulder_right"), "{refused}");
    let mut torn = good.clone();
    if let Some(column) = torn.signals.get_mut("q_ref.shoulder_left") {
        column[5] = f64::NAN;
    }
    assert!(twin([&robot, &robot], &torn, PlantKind::Auto).is_err());
    let mut short = good;
    short.time.truncate(1);
    assert!(twin([&robot, &robot], &short, PlantKind::Auto).is_err());
}
