//! A wrong effort scale at a drive: a share of the model's own effort.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};

/// Torque constants, gears and amplifiers are mistaken for each other's neighbours, not for others several times their size.
const IMPLAUSIBLE: f64 = 5.0;

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
        let scale = 1.0 / (1.0 + share);
        // A drive that recorded next to nothing of the model's effort is not scaled: the model's effort is not there.
        if !(1.0 / IMPLAUSIBLE..IMPLAUSIBLE).contains(&scale) {
            Err(format!("the effort scale would be {scale:.2}, and no constant is wrong by more than {IMPLAUSIBLE}"))
        } else {
            Ok(vec![("scale", 1.0 / (1.0 + share))])
        }
    }
}
