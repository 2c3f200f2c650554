//! Friction that differs with direction: what is even in velocity, beside the odd part every model has.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;

/// Shape whose damping differs with direction.
const VISCOUS: f64 = 0.0;
/// Shape whose dry friction differs with direction.
const DRY: f64 = 1.0;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_asymmetric")
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
            let mut shapes = Vec::new();
            for (w, widths) in ctx.widths.iter().enumerate() {
                let turn = widths[joint];
                let speed = || local(k, |m, k| m.segment.v[k].iter().map(|v| v.abs()).collect());
                let dry = local(k, move |m, k| m.segment.v[k].iter().map(|v| turn.sign(*v).abs()).collect());
                // Not both at once: away from standstill the second is a constant, which an offset of the effort already is.
                shapes.push(Shape::free(vec![speed()]).at(w).with(vec![VISCOUS]));
                shapes.push(Shape::free(vec![dry]).at(w).with(vec![DRY]));
            }
            shapes
        };
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let joint = &view.model.joints[view.place];
        let (coulomb, viscous) = (joint.coulomb + view.coulomb_change, joint.viscous + view.viscous_change);
        let (dv, dc) = if view.shape[0] > 0.5 * (VISCOUS + DRY) { (0.0, view.own[0]) } else { (view.own[0], 0.0) };
        if coulomb < dc.abs() || viscous < dv.abs() {
            let least = (coulomb - dc.abs()).min(viscous - dv.abs());
            return Err(format!("friction would push in one direction ({})", number(least)));
        }
        Ok(vec![("coulomb_pos", coulomb + dc), ("coulomb_neg", coulomb - dc), ("viscous_pos", viscous + dv), ("viscous_neg", viscous - dv)])
    }
}
