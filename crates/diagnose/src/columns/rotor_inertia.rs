//! Inertia of a motor at its joint.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("rotor_inertia")
    }

    fn family(&self) -> Family {
        Family::Shift
    }

    fn is_refittable(&self) -> bool {
        true
    }

    fn axis(&self) -> Axis {
        Axis::Acceleration
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act())
            .map(|k| Proposal::at_drive(ctx, k, vec![Shape::free(vec![local(k, |m, k| m.segment.a[k].clone())])]))
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let total = view.model.joints[view.place].armature + view.own[0];
        if total < 0.0 { Err(format!("rotor inertia would be negative ({})", number(total))) } else { Ok(vec![("inertia", total)]) }
    }
}
