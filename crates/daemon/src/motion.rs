//! Where the drives are to be: motions that are played, and moves between two poses.

use pkm_hal::MAX_AXES;

/// What is wanted of the drives at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Positions `[m | rad]`.
    pub q: [f64; MAX_AXES],
    /// Velocities `[m/s | rad/s]`.
    pub v: [f64; MAX_AXES],
    /// Accelerations `[m/s² | rad/s²]`.
    pub a: [f64; MAX_AXES],
}

impl Wanted {
    /// Standing at `q` `[m | rad]`.
    #[must_use]
    pub const fn standing(q: [f64; MAX_AXES]) -> Self {
        Self { q, v: [0.0; MAX_AXES], a: [0.0; MAX_AXES] }
    }

    /// Whether all of it is numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.q.iter().chain(&self.v).chain(&self.a).all(|x| x.is_finite())
    }
}

/// A motion that is played. It is called in the loop: it neither waits nor allocates.
pub trait Motion: Send {
    /// Its length `[s]`; none goes on until it is stopped.
    fn duration_s(&self) -> Option<f64>;

    /// What is wanted at time `t` `[s]` of it; entries beyond the robot's axes stay as they are.
    fn at(&mut self, t: f64, wanted: &mut Wanted);
}

/// Standing still for as long as the controller does something of its own: a law of contact, an exercise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Where `[m | rad]`.
    pub q: [f64; MAX_AXES],
}

impl Motion for Stand {
    fn duration_s(&self) -> Option<f64> {
        None
    }

    fn at(&mut self, _: f64, wanted: &mut Wanted) {
        *wanted = Wanted::standing(self.q);
    }
}

/// A straight move between two poses with the least jerk: `10s³ − 15s⁴ + 6s⁵` (Flash and Hogan 1985, of a hand).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    from: [f64; MAX_AXES],
    to: [f64; MAX_AXES],
    duration: f64,
}

impl Move {
    /// From `from` to `to` `[m | rad]`, no drive `k` ever faster than `speed[k]` `[m/s | rad/s]`.
    #[must_use]
    pub fn new(from: [f64; MAX_AXES], to: [f64; MAX_AXES], speed: &[f64; MAX_AXES]) -> Self {
        // The largest speed of the curve is 15/8 of the mean.
        let time = |k: usize| 1.875 * (to[k] - from[k]).abs() / speed[k];
        let duration = (0..MAX_AXES).map(time).filter(|t| t.is_finite()).fold(0.0, f64::max);
        Self { from, to, duration }
    }

    /// Its length `[s]`.
    #[must_use]
    pub const fn duration(&self) -> f64 {
        self.duration
    }

    /// What is wanted at time `t` `[s]` of it.
    #[must_use]
    pub fn at(&self, t: f64) -> Wanted {
        if t >= self.duration {
            return Wanted::standing(self.to);
        }
        let s = (t / self.duration).max(0.0);
        let rate = 1.0 / self.duration;
        let shape = s * s * s * (10.0 + s * (6.0 * s - 15.0));
        let slope = 30.0 * s * s * (1.0 - s) * (1.0 - s) * rate;
        let bend = 60.0 * s * (1.0 + s * (2.0 * s - 3.0)) * rate * rate;
        let along = |k: usize| self.to[k] - self.from[k];
        Wanted {
            q: core::array::from_fn(|k| self.from[k] + along(k) * shape),
            v: core::array::from_fn(|k| along(k) * slope),
            a: core::array::from_fn(|k| along(k) * bend),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_keeps_its_speed_limit_and_its_derivatives_are_its_own() {
        let (mut to, mut speed) = ([0.0; MAX_AXES], [f64::INFINITY; MAX_AXES]);
        (to[0], to[1], speed[0], speed[1]) = (0.3, -0.1, 0.2, 0.5);
        let way = Move::new([0.0; MAX_AXES], to, &speed);
        assert!((way.duration() - 1.875 * 0.3 / 0.2).abs() < 1e-12);
        let h = 1e-5;
        for i in 1..100 {
            let t = way.duration() * f64::from(i) / 100.0;
            let [before, here, after] = [t - h, t, t + h].map(|t| way.at(t));
            for (k, speed) in speed.iter().enumerate().take(2) {
                assert!(((after.q[k] - before.q[k]) / (2.0 * h) - here.v[k]).abs() < 1e-8);
                assert!(((after.v[k] - before.v[k]) / (2.0 * h) - here.a[k]).abs() < 1e-7);
                assert!(here.v[k].abs() <= speed * (1.0 + 1e-12));
            }
        }
        assert!((way.at(way.duration() / 2.0).v[0] - 0.2).abs() < 1e-12);
        assert_eq!(way.at(1e9), Wanted::standing(to));
        assert_eq!(Move::new(to, to, &speed).at(0.0), Wanted::standing(to));
    }
}
