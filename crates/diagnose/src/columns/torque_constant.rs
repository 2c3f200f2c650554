//! A wrong effort scale at a drive: a share of the model's own effort.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("torque_constant")
    }

    fn family(&self) -> Family {
        Family::Shift
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        // The model's whole effort, nominal friction included: that is what the drive scales.
        let whole = |k| Shape::free(vec![local(k, |m, k| m.nominal[0][k].clone())]);
        let shapes = |k| vec![whole(k), whole(k).with_offsets(core::iter::once(k))];
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        // recorded = acting / scale, so a recorded effort too large by a share x means scale = 1/(1 + x).
        let share = view.own[0];
        if share <= -0.9 {
            Err(format!("the effort scale would be {:.2}", 1.0 / (1.0 + share)))
        } else {
            Ok(vec![("scale", 1.0 / (1.0 + share))])
        }
    }
}
