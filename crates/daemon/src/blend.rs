//! Bumpless changes: what is sent leads over, evenly, from what was sent before.

use pkm_hal::MAX_AXES;

/// The difference at the change, and how much of it is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blend {
    offset: [f64; MAX_AXES],
    left: f64,
    length: f64,
}

impl Blend {
    /// Nothing to lead over from.
    pub const NONE: Self = Self { offset: [0.0; MAX_AXES], left: 0.0, length: 0.0 };

    /// A change from efforts `before` to efforts `after` that takes `length` `[s]`.
    #[must_use]
    pub fn new(before: &[f64; MAX_AXES], after: &[f64; MAX_AXES], length: f64) -> Self {
        let length = length.max(0.0);
        Self { offset: core::array::from_fn(|k| before[k] - after[k]), left: length, length }
    }

    /// Whether it goes on.
    #[must_use]
    pub fn is_going(&self) -> bool {
        self.left > 0.0
    }

    /// Efforts `tau` `[N | N·m]` with the rest of the difference, then `dt` `[s]` pass.
    pub fn apply(&mut self, tau: &mut [f64], dt: f64) {
        if !self.is_going() {
            return;
        }
        let share = self.left / self.length;
        for (tau, offset) in tau.iter_mut().zip(&self.offset) {
            *tau += share * offset;
        }
        self.left = (self.left - dt).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_effort_is_the_last_of_before_and_the_rest_falls_evenly() {
        let (mut before, mut after) = ([0.0; MAX_AXES], [0.0; MAX_AXES]);
        (before[0], after[0], before[1]) = (10.0, -2.0, 1.0);
        let mut blend = Blend::new(&before, &after, 0.4);
        let sent: Vec<f64> = (0..6)
            .map(|_| {
                let mut tau = [-2.0, 0.0];
                blend.apply(&mut tau, 0.1);
                tau[0]
            })
            .collect();
        for (got, want) in sent.iter().zip([10.0, 7.0, 4.0, 1.0, -2.0, -2.0]) {
            assert!((got - want).abs() < 1e-12, "{sent:?}");
        }
        assert!(!blend.is_going() && !Blend::NONE.is_going());
    }
}
