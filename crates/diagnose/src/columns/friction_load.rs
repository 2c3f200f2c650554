//! Dry friction in proportion to the load of the rigid model, never of the measured effort: that would fit itself.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::turning::Turn;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_load")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Velocity
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k: usize| {
            let joint = ctx.model.actuators[k];
            let shape = |(w, widths): (usize, &Vec<Turn>)| {
                let turn = widths[joint];
                let source =
                    local(k, move |m, k| m.segment.v[k].iter().zip(&m.rigid[k]).map(|(v, load)| load.abs() * turn.sign(*v)).collect());
                Shape::free(vec![source]).at(w)
            };
            ctx.widths.iter().enumerate().map(shape).collect()
        };
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        if view.own[0] <= 0.0 {
            Err(format!("friction would shrink with load (mu = {})", number(view.own[0])))
        } else {
            Ok(vec![("mu", view.own[0])])
        }
    }
}
