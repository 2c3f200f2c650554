//! Valera et al. 2017: the velocity observer against the difference of positions on the 3-PRS robot, with friction and inertia that the
//! controller has wrong. The paper gives 7.29 % (0.016 m/s) and 1.98 % (0.004 m/s).

use pkm_papers::valera2017::velocity::{Figures, Loop, QUANTISED, TABLE_2, figures, with_difference, with_observer};

fn both(setting: &Loop, bandwidth: f64) -> [Figures; 2] {
    let difference = with_difference(setting).expect("neither faults nor saturates");
    let observed = with_observer(bandwidth, setting).expect("neither faults nor saturates");
    [figures(&difference), figures(&observed)]
}

// DIFFERENCE The paper's lags (16.8 and 4.9 degrees) and its gain in position (2.0 to 0.93 mm) belong to a filter it does not state and
// to friction it does not give; the ratio of the velocity errors, 3.7 there, is what a simulation of its equations reproduces.
#[test]
fn the_observer_is_three_times_quieter_than_the_difference_and_lags_a_third_as_much() {
    let [difference, observed] = both(&TABLE_2, 15.0);
    assert!(difference.velocity_share / observed.velocity_share >= 3.0, "{difference:?} {observed:?}");
    assert!(difference.velocity_lag.abs() / observed.velocity_lag.abs() >= 3.0, "{difference:?} {observed:?}");
    assert!(observed.increment < difference.increment, "{difference:?} {observed:?}");
    assert!(observed.position[1] <= 1.2 * difference.position[1], "{difference:?} {observed:?}");
    // Sizes of an independent simulation (numpy, other random numbers): 6.11 % and 1.49 %.
    assert!((0.05..0.075).contains(&difference.velocity_share), "{difference:?}");
    assert!((0.011..0.02).contains(&observed.velocity_share), "{observed:?}");
    // An observer three times as fast is no longer quieter: the gates can fail.
    let fast = figures(&with_observer(60.0, &TABLE_2).expect("neither faults nor saturates"));
    assert!(difference.velocity_share / fast.velocity_share < 1.5, "{difference:?} {fast:?}");
}

#[test]
fn quantisation_alone_does_not_explain_the_published_error_of_the_difference() {
    let [difference, observed] = both(&QUANTISED, 60.0);
    // An independent simulation (numpy) has 0.93 % and 0.60 %; the paper 7.29 % and 1.98 %.
    assert!((0.008..0.011).contains(&difference.velocity_share), "{difference:?}");
    assert!((0.005..0.007).contains(&observed.velocity_share), "{observed:?}");
}
