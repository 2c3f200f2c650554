//! A person: what no repetition brings back has no column. It is found in what is left, by comparing periods (`repeatable.rs`).

use super::{Axis, Columns, Context, Family, Proposal, Reading, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("active_limb")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, _: &Context) -> Vec<Proposal> {
        Vec::new()
    }

    fn read(&self, _: &View) -> Reading {
        Err("the scatter of periods says it, not a fit".to_string())
    }
}
