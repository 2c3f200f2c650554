//! A wrong zero of a position sensor: the change of the rigid effort along that coordinate.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};

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
        let all: Vec<usize> = (0..ctx.model.n_act()).collect();
        (0..ctx.model.n_act())
            .map(|k| {
                let shape = Shape::free(vec![global(move |m| m.offset[k].clone())]);
                Proposal { scope: all.clone(), ..Proposal::at_drive(ctx, k, vec![shape]) }
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("offset", view.own[0])])
    }
}
