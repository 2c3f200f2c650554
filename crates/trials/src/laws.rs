//! The laws that true robots of the trials obey. Few of them have the form a textbook, or a catalogue of effects, would give them.

use core::f64::consts::TAU;

use crate::math::{exp, pow, sin, tanh};

/// How dry friction of a drive is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dry {
    /// Bristles that bend by `reach` before they slip, with the damping `damping` `[N·s/m]`: the model of Lund and Grenoble.
    Bristles {
        /// Deflection at full friction `[m | rad]`.
        reach: f64,
        /// Damping of the bristles `[N·s/m]`.
        damping: f64,
    },
    /// A band of speeds within which friction balances what pushes, in proportion: after Karnopp.
    Band {
        /// Half of the band `[m/s]`.
        speed: f64,
    },
    /// v/(v⁴ + speed⁴)^¼.
    Root {
        /// Speed at which 84 % of the friction acts.
        speed: f64,
    },
}

impl Dry {
    /// Share of the friction that acts at steady speed `v`, with its sign; bristles have long slipped by then.
    #[must_use]
    pub fn direction(self, v: f64) -> f64 {
        match self {
            Self::Bristles { .. } => {
                if v > 0.0 {
                    1.0
                } else if v < 0.0 {
                    -1.0
                } else {
                    0.0
                }
            }
            Self::Band { speed } => (v / speed).clamp(-1.0, 1.0),
            Self::Root { speed } => v / (v * v * v * v + speed * speed * speed * speed).sqrt().sqrt(),
        }
    }
}

/// Friction of one drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// How dry friction is made.
    pub dry: Dry,
    /// Dry friction in motion `[N]`.
    pub coulomb: f64,
    /// Viscous friction `[N·s/m]`.
    pub viscous: f64,
    /// Additional friction at rest `[N]`, speed over which it vanishes `[m/s]`, and its exponent.
    pub peak: [f64; 3],
}

impl Friction {
    /// Dry friction at steady speed `v`, without sign `[N]`.
    fn level(&self, v: f64) -> f64 {
        let [extra, speed, exponent] = self.peak;
        if extra > 0.0 { self.coulomb + extra * exp(-pow((v / speed).abs(), exponent)) } else { self.coulomb }
    }

    /// Force against the motion at speed `v` with the bristles bent by `z` `[N]`.
    #[must_use]
    pub fn force(&self, v: f64, z: f64) -> f64 {
        let level = self.level(v);
        let dry = match self.dry {
            _ if level <= 0.0 => 0.0,
            Dry::Bristles { reach, damping } => self.coulomb / reach * z + damping * (v - v.abs() * z * self.coulomb / (reach * level)),
            steady @ (Dry::Band { .. } | Dry::Root { .. }) => level * steady.direction(v),
        };
        dry + self.viscous * v
    }

    /// Bristles after `dt` at speed `v`: the exact solution for a constant speed.
    #[must_use]
    pub fn bent(&self, z: f64, v: f64, dt: f64) -> f64 {
        let Dry::Bristles { reach, .. } = self.dry else { return 0.0 };
        if self.coulomb <= 0.0 {
            return 0.0;
        }
        let end = reach * self.level(v) / self.coulomb;
        let decay = exp(-v.abs() * dt / end);
        if v.abs() * dt < 1e-9 * end { z + v * dt } else { end * v.signum() + (z - end * v.signum()) * decay }
    }
}

/// What a resistance can see of its joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Time since the recording began `[s]`.
    pub t: f64,
    /// Position `[m | rad]`.
    pub q: f64,
    /// Velocity `[m/s | rad/s]`.
    pub v: f64,
    /// Acceleration, of the step before `[m/s²]`.
    pub a: f64,
    /// Effort that the drive passes on, of the step before `[N]`.
    pub load: f64,
    /// Velocity of another joint `[m/s]`.
    pub other: f64,
}

/// A resistance at a joint: the effort that the drive must supply in addition, per unit of its size.
#[derive(Debug, Clone, PartialEq)]
pub enum Resist {
    /// Linear in speed.
    Viscous,
    /// Dry, smoothed below `speed`.
    Coulomb {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
    },
    /// Dry, and `viscous` seconds per metre of it viscous, in one direction only.
    OneWay {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
        /// Viscous share `[s/m]`.
        viscous: f64,
        /// +1 or −1.
        way: f64,
    },
    /// v·(v² + v0²)^((p−1)/2): a power of the speed far from rest, smooth at rest.
    Drag {
        /// Speed below which it is linear `[m/s]`.
        v0: f64,
        /// Power p.
        power: f64,
    },
    /// Share of the load, saturating root in place of the absolute value.
    Load {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
        /// Load that is always there `[N]`.
        floor: f64,
    },
    /// Share of the load while driving, and `back` times as much while driven.
    Efficiency {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
        /// Share while driven over share while driving.
        back: f64,
    },
    /// Dry friction that rises along the stroke.
    Along {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
        /// Where it is zero `[m]`.
        at: f64,
    },
    /// Viscous friction that sinks as the joint warms up: −(1 − exp(−t/τ))·v.
    Warming {
        /// Time constant `[s]`.
        time: f64,
    },
    /// Spring that hardens.
    Spring {
        /// Rest `[m]`.
        rest: f64,
        /// Deflection at which it is twice as stiff `[m]`.
        hardening: f64,
    },
    /// Cubic spline through five heights over the stroke, and 5 % of it as a hysteresis.
    Hose {
        /// Lower and upper end of the stroke `[m]`.
        stroke: [f64; 2],
        /// Heights.
        heights: [f64; 5],
    },
    /// Periodic in position, with a second and a third harmonic.
    Ripple {
        /// Order `[1/m]`.
        order: f64,
        /// Phase `[rad]`.
        phase: f64,
        /// Share of the harmonics.
        harmonics: [f64; 2],
    },
    /// Constant.
    Offset,
    /// One-sided, power 3/2 of the depth, with the damping of Hunt and Crossley.
    Contact {
        /// Where it begins `[m]`.
        at: f64,
        /// +1: above, −1: below.
        side: f64,
    },
    /// Outside any catalogue: cube of another joint's velocity.
    CubedOther,
    /// Outside: a sine in time that nothing else runs at.
    FreeSine {
        /// Frequency `[Hz]`.
        hz: f64,
        /// Phase `[rad]`.
        phase: f64,
    },
    /// Outside: a magnetic detent, force to and fro at one place.
    Detent {
        /// Where `[m]`.
        at: f64,
        /// Width `[m]`.
        width: f64,
    },
    /// Outside: creep, a spring in series with a damper: force from a deflection that is slowly forgotten.
    Creep {
        /// Time to forget `[s]`.
        time: f64,
    },
    /// Outside: dry friction in proportion to the acceleration.
    InertialStick {
        /// Speed below which it fades `[m/s]`.
        speed: f64,
    },
    /// Outside: dry friction that comes and goes with the distance travelled to and fro.
    Travel {
        /// Distance per cycle `[m]`.
        pitch: f64,
        /// Speed below which it fades `[m/s]`.
        speed: f64,
    },
}

impl Resist {
    /// Effort per unit of size; `memory` is what the law remembers.
    #[must_use]
    pub fn effort(&self, s: &Seen, memory: f64) -> f64 {
        let soft = |speed: f64| tanh(s.v / speed);
        match *self {
            Self::Viscous => s.v,
            Self::Coulomb { speed } => soft(speed),
            Self::OneWay { speed, viscous, way } => {
                let on = 0.5 * (1.0 + tanh(way * s.v / speed));
                on * (way + viscous * s.v)
            }
            Self::Drag { v0, power } => s.v * pow(s.v * s.v + v0 * v0, 0.5 * (power - 1.0)),
            Self::Load { speed, floor } => (s.load * s.load + floor * floor).sqrt() * soft(speed),
            Self::Efficiency { speed, back } => s.load.abs() * soft(speed) * if s.load * s.v > 0.0 { 1.0 } else { back },
            Self::Along { speed, at } => (s.q - at) * soft(speed),
            Self::Warming { time } => -(1.0 - exp(-s.t.max(0.0) / time)) * s.v,
            Self::Spring { rest, hardening } => {
                let x = s.q - rest;
                x * (1.0 + (x / hardening) * (x / hardening))
            }
            Self::Hose { stroke, ref heights } => spline(heights, (s.q - stroke[0]) / (stroke[1] - stroke[0])) + 0.05 * memory,
            Self::Ripple { order, phase, harmonics } => {
                let x = order * s.q + phase;
                sin(x) + harmonics[0] * sin(2.0 * x + 1.0) + harmonics[1] * sin(3.0 * x + 2.0)
            }
            Self::Offset => 1.0,
            Self::Contact { at, side } => {
                let depth = (side * (s.q - at)).max(0.0);
                side * depth * depth.sqrt() * (1.0 + 0.5 * side * s.v).max(0.0)
            }
            Self::CubedOther => s.other * s.other * s.other,
            Self::FreeSine { hz, phase } => sin(TAU * hz * s.t + phase),
            Self::Detent { at, width } => {
                let x = (s.q - at) / width;
                x * exp(-x * x)
            }
            Self::Creep { .. } => s.q - memory,
            Self::InertialStick { speed } => s.a.abs() * soft(speed),
            Self::Travel { pitch, speed } => sin(TAU * memory / pitch) * soft(speed),
        }
    }

    /// What the law remembers at the beginning.
    #[must_use]
    pub fn start(&self, q: f64) -> f64 {
        if matches!(self, Self::Creep { .. }) { q } else { 0.0 }
    }

    /// What it remembers after `dt`.
    #[must_use]
    pub fn remembered(&self, memory: f64, s: &Seen, dt: f64) -> f64 {
        match *self {
            Self::Creep { time } => s.q + (memory - s.q) * exp(-dt / time),
            Self::Travel { .. } => memory + s.v.abs() * dt,
            // Follows the sign of the motion within 2 % of the stroke: a hose lags.
            Self::Hose { stroke, .. } => {
                let reach = 0.02 * (stroke[1] - stroke[0]);
                s.v.signum() + (memory - s.v.signum()) * exp(-s.v.abs() * dt / reach)
            }
            _ => memory,
        }
    }
}

/// Uniform cubic spline of Catmull and Rom through `heights` at 0, 1/4 … 1, level outside.
fn spline(heights: &[f64; 5], u: f64) -> f64 {
    let x = (u * 4.0).clamp(0.0, 4.0 - 1e-9);
    let i = (0..4).rev().find(|&i| x >= f64::from(u8::try_from(i).unwrap_or(0))).unwrap_or(0);
    let w = x - i as f64;
    let at = |k: isize| heights[usize::try_from((i as isize + k).clamp(0, 4)).unwrap_or(0)];
    let (p0, p1, p2, p3) = (at(-1), at(0), at(1), at(2));
    p1 + 0.5 * w * (p2 - p0 + w * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + w * (3.0 * (p1 - p2) + p3 - p0)))
}

/// A transmission that gives way: force of the motor on the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flex {
    /// Stiffness `[N/m]`.
    pub stiffness: f64,
    /// Deflection at which it is twice as stiff `[m]`; infinite for a linear one.
    pub hardening: f64,
    /// Damping `[N·s/m]`.
    pub damping: f64,
    /// Play `[m]`.
    pub gap: f64,
}

impl Flex {
    /// Force for the motor ahead of the link by `x`, at the rate `rate`.
    #[must_use]
    pub fn force(&self, x: f64, rate: f64) -> f64 {
        let half = 0.5 * self.gap;
        let deep = if x > half {
            x - half
        } else if x < -half {
            x + half
        } else {
            return 0.0;
        };
        let elastic = self.stiffness * deep * (1.0 + (deep / self.hardening) * (deep / self.hardening));
        let all = elastic + self.damping * rate;
        // A flank pushes, it does not pull.
        if self.gap > 0.0 && all * deep < 0.0 { 0.0 } else { all }
    }
}

/// What lies between the recorded effort and the acting one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chain {
    /// Acting over recorded.
    pub scale: f64,
    /// Time constant of a second-order lag `[s]`; 0: none.
    pub lag: f64,
    /// Delay `[s]`.
    pub delay: f64,
    /// Largest effort `[N]`.
    pub limit: f64,
    /// Efforts below this have no effect `[N]`.
    pub dead: f64,
}

impl Chain {
    /// What is recorded acts.
    pub const IDEAL: Self = Self { scale: 1.0, lag: 0.0, delay: 0.0, limit: f64::INFINITY, dead: 0.0 };

    /// The memoryless part: scale, dead zone, soft limit.
    #[must_use]
    pub fn passed(&self, u: f64) -> f64 {
        let u = self.scale * u;
        let u = if self.dead > 0.0 { u.signum() * (u.abs() - self.dead).max(0.0) } else { u };
        if self.limit.is_finite() {
            // Round the corner over 4 % of the limit: amplifiers do.
            let width = 0.02 * self.limit;
            let over = (u.abs() - self.limit) / width;
            let beyond = if over > 30.0 { over } else { crate::math::ln(1.0 + exp(over)) };
            u.signum() * (u.abs() - width * beyond)
        } else {
            u
        }
    }
}

/// A position sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// True position minus reading `[m | rad]`.
    pub offset: f64,
    /// Amplitude of an error that is periodic in position `[m | rad]`.
    pub amplitude: f64,
    /// Its order `[1/m]`.
    pub order: f64,
    /// Its phase `[rad]`.
    pub phase: f64,
}

impl Encoder {
    /// What is read is true.
    pub const IDEAL: Self = Self { offset: 0.0, amplitude: 0.0, order: 1.0, phase: 0.0 };

    /// Position and velocity as read; 15 % of the periodic error is a second harmonic.
    #[must_use]
    pub fn read(&self, q: f64, v: f64) -> [f64; 2] {
        if self.amplitude <= 0.0 {
            return [q - self.offset, v];
        }
        let x = self.order * q + self.phase;
        let error = self.amplitude * (sin(x) + 0.15 * sin(2.0 * x + 0.7));
        let slope = self.amplitude * self.order * (crate::math::cos(x) + 0.3 * crate::math::cos(2.0 * x + 0.7));
        [q - self.offset - error, v * (1.0 - slope)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bristles_slip_at_the_steady_friction_and_spring_at_rest() {
        let f = Friction { dry: Dry::Bristles { reach: 1e-4, damping: 0.0 }, coulomb: 10.0, viscous: 3.0, peak: [5.0, 0.01, 2.0] };
        let mut z = 0.0;
        for _ in 0..1000 {
            z = f.bent(z, 0.2, 1e-3);
        }
        // Far above the Stribeck speed: Coulomb and viscous friction are left.
        assert!((f.force(0.2, z) - (10.0 + 3.0 * 0.2)).abs() < 1e-9);
        // A tenth of the reach from rest: a spring of 10 N/1e-4 m.
        assert!((f.force(0.0, 1e-5) - 1.0).abs() < 1e-12);
        let mut z = 0.0;
        for _ in 0..200_000 {
            z = f.bent(z, 1e-4, 1e-3);
        }
        assert!((f.force(1e-4, z) - 15.0).abs() < 0.01, "creeping: {}", f.force(1e-4, z));
    }

    #[test]
    fn a_spline_meets_its_heights() {
        let h = [1.0, -2.0, 0.5, 3.0, 2.0];
        for (i, y) in h.iter().enumerate() {
            assert!((spline(&h, i as f64 / 4.0) - y).abs() < 1e-7);
        }
    }

    #[test]
    fn play_passes_nothing_on_and_flanks_push_only() {
        let flex = Flex { stiffness: 100.0, hardening: f64::INFINITY, damping: 1.0, gap: 0.2 };
        assert!(flex.force(0.09, 5.0).abs() < 1e-15 && (flex.force(0.2, 0.0) - 10.0).abs() < 1e-12);
        assert!(flex.force(0.11, -50.0).abs() < 1e-15);
    }

    #[test]
    fn amplifiers_pass_small_efforts_and_hold_back_large_ones() {
        let chain = Chain { limit: 10.0, ..Chain::IDEAL };
        assert!(
            (chain.passed(5.0) - 5.0).abs() < 1e-9 && (chain.passed(50.0) - 10.0).abs() < 1e-9 && (chain.passed(-50.0) + 10.0).abs() < 1e-9
        );
        assert!((Chain { dead: 1.0, ..Chain::IDEAL }.passed(-3.0) + 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_reading_and_its_rate_belong_together() {
        let e = Encoder { offset: 0.1, amplitude: 0.01, order: 7.0, phase: 0.4 };
        let h = 1e-6;
        let slope = (e.read(0.3 + h, 0.0)[0] - e.read(0.3 - h, 0.0)[0]) / (2.0 * h);
        assert!((slope - e.read(0.3, 1.0)[1]).abs() < 1e-8);
    }
}
