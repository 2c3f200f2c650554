//! What one coordinate of the task does during a phase.

use pkm_dyn::math;

/// A constant and a sine that starts at zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Middle.
    pub mean: f64,
    /// Amplitude.
    pub amplitude: f64,
    /// Angular frequency `[rad/s]`.
    pub w: f64,
}

impl Wave {
    /// The same all the time.
    #[must_use]
    pub const fn constant(mean: f64) -> Self {
        Self { mean, amplitude: 0.0, w: 0.0 }
    }

    /// Value and rate at `t` `[s]`.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 2] {
        let (s, c) = math::sin_cos(self.w * t);
        [self.mean + self.amplitude * s, self.amplitude * self.w * c]
    }

    fn is_finite(&self) -> bool {
        [self.mean, self.amplitude, self.w].iter().all(|x| x.is_finite())
    }
}

/// The load that the patient works against \[Valera2017, active-resistive exercises\]: `f = load − stiffness·(x − centre) − damping·x'`,
/// the robot's force on the patient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    /// Constant part, a weight `[N | N·m]`.
    pub load: f64,
    /// Elastic part `[N/m | N·m/rad]`.
    pub stiffness: f64,
    /// Where the elastic part is zero `[m | rad]`.
    pub centre: f64,
    /// Viscous part `[N·s/m | N·m·s/rad]`.
    pub damping: f64,
}

/// Help along a path, as much as is needed \[Emken2005\]: a spring beyond a tolerated error, and a part that is learned from the error and
/// forgotten while there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assistance {
    /// The path `[m | rad]`, reached within the phase's ramp.
    pub path: Wave,
    /// Error that is left to the patient `[m | rad]`.
    pub tolerance: f64,
    /// Help per error beyond it `[N/m | N·m/rad]`.
    pub stiffness: f64,
    /// Growth of the learned part per error beyond it `[N/(m·s) | N·m/(rad·s)]`.
    pub learning: f64,
    /// Time constant of forgetting `[s]`.
    pub forgetting_s: f64,
    /// Damping of the motion `[N·s/m | N·m·s/rad]`.
    pub damping: f64,
    /// Most help `[N | N·m]`.
    pub most: f64,
}

/// What one coordinate of the task does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Channel {
    /// Goes to the wave's mean with least jerk within the ramp, then along the wave `[m | rad]`.
    Position(Wave),
    /// Presses on the environment with the wave `[N | N·m]`.
    Force(Wave),
    /// Resists the patient.
    Resist(Resistance),
    /// Helps the patient.
    Assist(Assistance),
}

impl Channel {
    /// Whether the coordinate follows a force rather than a path.
    #[must_use]
    pub fn follows_force(&self) -> bool {
        !matches!(self, Self::Position(_))
    }

    /// The first number that is none or out of range, by name.
    pub(crate) fn offence(&self) -> Option<(&'static str, f64)> {
        let negative = |what: &'static str, x: f64| (!(x.is_finite() && x >= 0.0)).then_some((what, x));
        match self {
            Self::Position(wave) | Self::Force(wave) => (!wave.is_finite()).then_some(("wave", wave.mean)),
            Self::Resist(r) => {
                let free = [("load", r.load), ("centre", r.centre)].into_iter().find(|(_, x)| !x.is_finite());
                free.or_else(|| negative("stiffness", r.stiffness)).or_else(|| negative("damping", r.damping))
            }
            Self::Assist(a) => {
                let rest = [
                    ("tolerance", a.tolerance),
                    ("stiffness", a.stiffness),
                    ("learning", a.learning),
                    ("damping", a.damping),
                    ("most", a.most),
                ];
                let path = (!a.path.is_finite()).then_some(("path", a.path.mean));
                let rest = path.or_else(|| rest.into_iter().find_map(|(what, x)| negative(what, x)));
                rest.or_else(|| (!(a.forgetting_s.is_finite() && a.forgetting_s > 0.0)).then_some(("forgetting_s", a.forgetting_s)))
            }
        }
    }
}

/// A move of least jerk from a state of motion to a place at rest: the polynomial of degree five.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    start: f64,
    speed: f64,
    goal: f64,
    duration: f64,
}

impl Path {
    /// From `start` at `speed` to rest at `goal` within `duration` `[s]`; at the goal at once when that is zero.
    #[must_use]
    pub fn new(start: f64, speed: f64, goal: f64, duration: f64) -> Self {
        Self { start, speed, goal, duration }
    }

    /// Position and velocity `t` `[s]` after the start.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 2] {
        if t >= self.duration {
            return [self.goal, 0.0];
        }
        let (d, s) = (self.duration, (t / self.duration).max(0.0));
        let (gone, slope) = (self.goal - self.start, self.speed * d);
        let (c3, c4, c5) = (10.0 * gone - 6.0 * slope, -15.0 * gone + 8.0 * slope, 6.0 * gone - 3.0 * slope);
        let x = self.start + s * (slope + s * s * (c3 + s * (c4 + s * c5)));
        let v = (slope + s * s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5))) / d;
        [x, v]
    }
}

/// From 0 to 1 within `duration`, with flat ends.
#[must_use]
pub(crate) fn fade(t: f64, duration: f64) -> f64 {
    Path::new(0.0, 0.0, 1.0, duration).at(t)[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_begins_as_it_is_told_and_ends_at_rest() {
        let path = Path::new(0.2, -0.3, 1.0, 2.0);
        let close = |found: [f64; 2], want: [f64; 2], tol: f64| assert!((0..2).all(|k| (found[k] - want[k]).abs() < tol), "{found:?}");
        close(path.at(0.0), [0.2, -0.3], 1e-15);
        close(path.at(2.0 - 1e-9), [1.0, 0.0], 1e-12);
        close(path.at(7.0), [1.0, 0.0], 1e-15);
        for k in 1..40 {
            let t = 0.05 * f64::from(k);
            let slope = (path.at(t + 1e-6)[0] - path.at(t - 1e-6)[0]) / 2e-6;
            assert!((slope - path.at(t)[1]).abs() < 1e-6, "{t}");
        }
        // From rest it is the curve of least jerk: half-way in the middle, 15/8 of the mean speed there.
        close(Path::new(0.0, 0.0, 0.144, 6.0).at(3.0), [0.072, 0.144 / 6.0 * 1.875], 1e-15);
        close(Path::new(0.0, 1.0, 3.0, 0.0).at(0.0), [3.0, 0.0], 1e-15);
    }
}
