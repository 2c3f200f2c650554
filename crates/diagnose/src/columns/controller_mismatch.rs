//! A recorded command that the stated controller has not computed: found by replaying it before anything else (`controller.rs`). No column
//! is proposed: in the effort alone, a command that lacks a share is a wrong effort scale.

use super::{Axis, Columns, Context, Family, Proposal, Reading, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("controller_mismatch")
    }

    fn family(&self) -> Family {
        Family::Shift
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, _: &Context) -> Vec<Proposal> {
        Vec::new()
    }

    fn read(&self, _: &View) -> Reading {
        Err("a replayed controller says it, not a fit".to_string())
    }
}
