//! A wrong effort scale at a drive: a share of the rigid effort itself.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local};

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
        let rigid = |k| local(k, |m, k| m.rigid[k].clone());
        // Where the rigid effort hardly varies, a scale and a constant are nearly the same column: it is sought with and without.
        let shapes = |k| vec![Shape::free(vec![rigid(k)]), Shape::free(vec![rigid(k), Source::Offset(k)])];
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn n_own(&self) -> usize {
        1
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
