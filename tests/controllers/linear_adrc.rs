//! Linear ADRC against its transfer functions.

use pkm_ctrl::adrc::{Extended, Feedback};
use pkm_ctrl::{Adrc, AdrcConfig, Controller, Input};

#[test]
fn step_responses_are_those_of_the_transfer_functions_with_right_and_wrong_input_gain() {
    for golden in crate::golden().ladrc {
        let adrc = Adrc::<1>::try_new(AdrcConfig {
            b: [[golden.b0]],
            extended: Extended::Linear { bandwidth: golden.observer },
            feedback: Feedback::Linear { bandwidth: golden.bandwidth },
            reference_acceleration: f64::INFINITY,
            limit: [1e9],
        })
        .expect("good numbers");
        let (mut state, mut q, mut v, t) = (adrc.at_rest(), 0.0, 0.0, golden.dt);
        for (k, want) in golden.y.iter().enumerate() {
            assert!((q - want).abs() < 1e-9, "sample {k}: {q} {want}");
            let a = golden.b * adrc.step(&mut state, &Input { q_ref: [1.0], ..Input::standing([q], t) }).tau[0];
            q += t * v + 0.5 * t * t * a;
            v += t * a;
        }
    }
}
