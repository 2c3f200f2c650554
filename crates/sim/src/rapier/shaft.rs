//! Rotor inertia, and friction that is stable, as one row of the engine per joint.

use super::resistance::Resistance;
use super::world::Row;

/// A joint with rotor inertia, or with something that resists its motion.
///
/// The engine's motors pull a joint towards a velocity in proportion to the difference, implicitly. With inertia over substep for the
/// factor and the rotor's own velocity for the target, that is a rotor on the shaft: what impulse the row takes from the joint goes into
/// the rotor. So momentum is kept even where the engine's sweeps have not converged, whatever the rotor's share of the inertia.
#[derive(Debug, Clone)]
pub(super) struct Shaft {
    pub(super) joint: usize,
    pub(super) fastening: usize,
    /// Rotor inertia `[kg | kg·m²]`.
    pub(super) inertia: f64,
    /// Least inertia that the joint can move, rotor included: that of the bodies on either side as if they were free `[kg | kg·m²]`.
    pub(super) least: f64,
    /// The part of the rotor's that effects add.
    added: f64,
    /// Whether the joint has friction or an effect.
    pub(super) resists: bool,
    /// Velocity of the rotor `[m/s | rad/s]`.
    pub(super) rotor: f64,
    felt: Resistance,
    felt_at: f64,
    row: Row,
}

impl Shaft {
    /// On joint `joint` of the tree with its nominal rotor and what effects add to it `[kg | kg·m²]`; `free` is the inertia of the bodies on
    /// either side.
    pub(super) fn new([joint, fastening]: [usize; 2], [nominal, added, free]: [f64; 3], resists: bool) -> Self {
        let (inertia, row) = (nominal + added, Row { gain: 0.0, target: 0.0 });
        let (least, felt) = (inertia + free, Resistance::default());
        Self { joint, fastening, inertia, least, added, resists, rotor: 0.0, felt, felt_at: 0.0, row }
    }

    /// The row for a push of `kick` `[s]` against resistance `felt` at velocity `v`, whose effort at `v` is applied elsewhere.
    pub(super) fn load(&mut self, felt: Resistance, v: f64, kick: f64) -> Row {
        (self.felt, self.felt_at) = (felt, v);
        let drag = kick * felt.slope;
        let gain = self.inertia + drag;
        let target = if gain > 0.0 { (self.inertia * self.rotor + drag * v) / gain } else { 0.0 };
        self.row = Row { gain, target };
        self.row
    }

    /// Takes the impulse of the row; the mean effort over the push of everything but the rigid model with its nominal rotor.
    pub(super) fn settle(&mut self, impulse: f64, kick: f64) -> f64 {
        if self.row.gain <= 0.0 {
            return self.felt.effort;
        }
        let v = self.row.target + impulse / self.row.gain;
        let gained = v - self.rotor;
        self.rotor = v;
        self.felt.effort + self.felt.slope * (v - self.felt_at) + self.added * gained / kick
    }
}
