//! What a guarded controller reports: which limits acted at which drive, and the fault that stopped it.

/// A limit that can act without stopping the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// A position reference was held inside its range, or an effort was changed to stop before its end.
    Position,
    /// An effort was reduced because its drive is too fast.
    Velocity,
    /// An effort was clipped.
    Effort,
    /// An effort was not let change so fast.
    EffortRate,
    /// The environment pushes so hard that the robot yields.
    Wrench,
    /// A reference outside the workspace was not followed.
    Workspace,
    /// A reference too near a singularity was not followed, or the task was lost: its loops do not close, or the drives do not hold it.
    Singularity,
}

impl Limit {
    /// Every limit, in the order of their bits.
    pub const ALL: [Self; 7] =
        [Self::Position, Self::Velocity, Self::Effort, Self::EffortRate, Self::Wrench, Self::Workspace, Self::Singularity];
}

/// Which limits acted where; drives (or components) from the 32nd on share the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Acted([u32; Limit::ALL.len()]);

impl Acted {
    /// Notes that `limit` acted at `place`: a drive, or a component of the wrench or the task.
    pub fn note(&mut self, limit: Limit, place: usize) {
        self.0[limit as usize] |= 1 << place.min(31);
    }

    /// Whether `limit` acted at `place`.
    #[must_use]
    pub fn at(&self, limit: Limit, place: usize) -> bool {
        self.0[limit as usize] & (1 << place.min(31)) != 0
    }

    /// Whether `limit` acted anywhere.
    #[must_use]
    pub fn any(&self, limit: Limit) -> bool {
        self.0[limit as usize] != 0
    }

    /// Whether nothing acted.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0 == Self::default().0
    }

    /// Everything that acted, with its place.
    pub fn iter(&self) -> impl Iterator<Item = (Limit, usize)> + '_ {
        Limit::ALL.into_iter().flat_map(move |limit| (0..32).filter(move |&place| self.at(limit, place)).map(move |place| (limit, place)))
    }

    /// What acted here or there.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.0.iter_mut().zip(other.0).for_each(|(mine, more)| *mine |= more);
        self
    }
}

/// Why a controller stopped; the number behind a name never changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FaultCode {
    /// A measured position is no number.
    PositionNotFinite = 1,
    /// A measured effort is no number.
    EffortNotFinite = 2,
    /// A component of the measured wrench is no number.
    WrenchNotFinite = 3,
    /// A reference or the model's effort is no number.
    ReferenceNotFinite = 4,
    /// The time since the last step is no time, or longer than allowed `[s]`.
    Late = 5,
    /// The same measurement to the last bit for longer than allowed: steps in a row.
    Frozen = 6,
    /// The environment pushes harder than allowed `[N | N·m]`.
    Wrench = 7,
    /// A drive stands outside its range by more than the tolerance `[m | rad]`.
    Position = 8,
    /// A drive is faster than can be allowed `[m/s | rad/s]`.
    Velocity = 9,
    /// The guarded controller reported a fault of its own.
    Controller = 10,
    /// The guarded controller answered with an effort that is no number.
    CommandNotFinite = 11,
    /// Loops of the model do not close at the measured positions: the gap that is left `[m | rad]`.
    LoopGap = 12,
    /// Coordinates of surplus drives contradict the others `[m | rad]`.
    Misfit = 13,
    /// A number that the controller's law needs is none.
    InputNotFinite = 14,
    /// The time since the last step is no positive number `[s]`.
    Period = 15,
}

/// The first fault of a controller; later ones do not replace it.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("fault {code:?} at {drive}: {value} (limit {limit})")]
pub struct Fault {
    /// What happened.
    pub code: FaultCode,
    /// Which drive, or which component of the wrench, from zero; zero for what concerns the whole.
    pub drive: usize,
    /// The value that was not allowed, in the unit of its code.
    pub value: f64,
    /// What would have been, in the same unit; zero where nothing would.
    pub limit: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_noted_is_told() {
        let mut acted = Acted::default();
        assert!(acted.is_empty());
        acted.note(Limit::Velocity, 2);
        acted.note(Limit::Singularity, 40);
        assert!(acted.at(Limit::Velocity, 2) && !acted.at(Limit::Velocity, 1) && acted.any(Limit::Singularity));
        assert!(acted.iter().eq([(Limit::Velocity, 2), (Limit::Singularity, 31)]));
        let mut other = Acted::default();
        other.note(Limit::Effort, 0);
        assert_eq!(acted.and(other).iter().count(), 3);
        assert!(Limit::ALL.into_iter().enumerate().all(|(k, limit)| limit as usize == k));
    }
}
