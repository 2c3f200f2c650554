//! A wrong zero of a position sensor: the change of the rigid effort along that coordinate.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::shift;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("encoder_offset")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shape = |k: usize| Shape::free(vec![global(move |m| shift::of_reading(m, k, &vec![1.0; m.segment.valid.len()]))]);
        (0..ctx.model.n_act()).map(|k| Proposal::of_all(ctx, k, vec![shape(k)])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("offset", view.own[0])])
    }
}
