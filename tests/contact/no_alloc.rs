//! Steps of the controllers of contact, counted.

#[path = "controllers.rs"]
mod controllers;

use controllers::{DT, Platform, all};

/// Allocations in two seconds of every controller, by name; the platform and the making of controllers are not counted.
pub(crate) fn contact_allocations(count: impl Fn(&mut dyn FnMut()) -> usize) -> Vec<(&'static str, usize)> {
    let counted = |(name, mut controller): (&'static str, Box<dyn controllers::Running>)| {
        let (mut platform, mut sum) = (Platform::new(), 0);
        for k in 0..200 {
            let mut input = platform.input(DT * f64::from(k));
            if k == 190 {
                input.q_meas[0] = f64::NAN;
            }
            let mut tau = [0.0; 3];
            sum += count(&mut || tau = controller.step(&input).tau);
            platform.step(&tau);
        }
        (name, sum)
    };
    all().into_iter().map(counted).collect()
}
