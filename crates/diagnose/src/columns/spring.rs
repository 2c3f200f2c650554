//! A linear spring at a drive.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local};
use crate::motion::Motion;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("spring")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shape = |k| vec![local(k, |m: &Motion, k| m.segment.q[k].clone()), Source::Offset(k)];
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, vec![Shape::free(shape(k))])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (stiffness, constant) = (view.own[0], view.own[1]);
        if stiffness <= 0.0 {
            return Err(format!("stiffness would be negative ({stiffness:.3e})"));
        }
        Ok(vec![("stiffness", stiffness), ("rest", -constant / stiffness)])
    }
}
