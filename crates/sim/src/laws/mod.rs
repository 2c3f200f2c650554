//! Laws that are not the catalogue's, on purpose: what a robot is made of does not know what a diagnosis looks for.

use core::fmt::Debug;

use pkm_dyn::effects::JointState;

/// A resistance at a joint with any number of states of its own.
pub trait ForeignLaw: Debug + Send {
    /// Joint of the tree it acts at.
    fn joint(&self) -> usize;

    /// Efforts the drive must supply in addition, in backward and in forward motion at velocity `state.v` `[N | N·m]`; equal where the law
    /// is not set-valued at rest.
    fn levels(&self, state: &JointState) -> (f64, f64);

    /// Moves its own states on by `h` `[s]` of the motion `state`.
    fn advance(&mut self, state: &JointState, h: f64);
}
