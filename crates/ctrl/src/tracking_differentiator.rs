//! Tracking differentiator: a step of the reference becomes the fastest motion of a limited acceleration \[Arceo2021, Fig. 6\].

use pkm_dyn::math;

/// Time-optimal acceleration of a double integrator sampled at `h` `[s]`, `|fhan| ≤ r` \[Han2009\].
///
/// `x1` and `x2` are the distance from the goal and its rate. The bang-bang law it replaces chatters when sampled; this one brings both to zero in
/// finitely many samples and stays. `r` and `h` must be positive.
#[must_use]
pub fn fhan(x1: f64, x2: f64, r: f64, h: f64) -> f64 {
    let d = r * h * h;
    let a0 = h * x2;
    let y = x1 + a0;
    let a1 = math::sqrt(d * (d + 8.0 * y.abs()));
    let a2 = a0 + math::sign(y) * (a1 - d) / 2.0;
    let sy = (math::sign(y + d) - math::sign(y - d)) / 2.0;
    let a = (a0 + y - a2) * sy + a2;
    let sa = (math::sign(a + d) - math::sign(a - d)) / 2.0;
    -r * (a / d - math::sign(a)) * sa - r * math::sign(a)
}

/// Power law that is straight within `delta` of zero: high gain for small errors without chatter \[Arceo2021, Fig. 6; Han2009\].
#[must_use]
pub fn fal(e: f64, alpha: f64, delta: f64) -> f64 {
    if e.abs() <= delta { e / math::powf(delta, 1.0 - alpha) } else { math::powf(e.abs(), alpha) * math::sign(e) }
}

/// A smoothed reference and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrackingDifferentiator {
    /// Smoothed reference `[m | rad]`.
    pub x: f64,
    /// Its rate `[m/s | rad/s]`.
    pub rate: f64,
}

impl TrackingDifferentiator {
    /// Moves on by `dt` `[s]` towards `goal` with at most the acceleration `r` `[m/s² | rad/s²]`; the acceleration taken.
    ///
    /// `h` `[s]` is `dt` for the fastest motion, several of them to smooth a noisy goal as well.
    pub fn step(&mut self, goal: f64, r: f64, h: f64, dt: f64) -> f64 {
        let a = fhan(self.x - goal, self.rate, r, h);
        self.x += dt * self.rate;
        self.rate += dt * a;
        a
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fhan_and_fal_have_the_published_values() {
        let near = |got: f64, want: f64| assert!((got - want).abs() < 1e-9, "{got} {want}");
        near(fhan(0.1, 0.0, 0.38843, 0.005_835_5), -0.38843);
        // Near the goal it is linear, −(x1 + 2·h·x2)/h²; the published value belongs to an h of more digits than are printed.
        let (x1, x2, h) = (1e-6, 1e-5, 0.005_835_5);
        near(fhan(x1, x2, 0.38843, h), -(x1 + 2.0 * h * x2) / (h * h));
        assert!((fhan(x1, x2, 0.38843, h) + 0.032_793_278_5).abs() < 1e-7);
        near(fal(0.002, 0.5, 0.01), 0.02);
        near(fal(0.5, 0.25, 0.01), 0.840_896_415_3);
        near(fal(-0.5, 0.25, 0.01), -0.840_896_415_3);
    }

    #[test]
    fn a_step_is_reached_in_the_shortest_time_without_overshoot_and_held_still() {
        let (r, h) = (2.0, 1e-3);
        let mut reference = TrackingDifferentiator::default();
        let (mut top, mut reached) = (0.0_f64, 0);
        for k in 1..3000 {
            let a = reference.step(0.5, r, h, h);
            assert!(a.abs() <= r * (1.0 + 1e-12), "{a}");
            top = top.max(reference.x);
            if reached == 0 && (reference.x - 0.5).abs() < 1e-6 {
                reached = k;
            }
        }
        // Half the way at +r, half at −r: 2·sqrt(0.5/2) = 1 s.
        assert!((1000..1015).contains(&reached), "{reached}");
        assert!(top < 0.5 + 1e-6 && reference.rate.abs() < 1e-9, "{top} {reference:?}");
    }
}
