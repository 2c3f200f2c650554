//! The friction peak at low speed: an exponential bump on the dry friction, of several widths.

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;

/// Widths to try, as shares of the top speed.
const SHARES: [f64; 6] = [0.02, 0.04, 0.08, 0.15, 0.25, 0.4];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_stribeck")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Velocity
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let mut out = Vec::new();
        for k in 0..ctx.model.n_act() {
            let joint = ctx.model.actuators[k];
            let mut shapes = Vec::new();
            for (w, widths) in ctx.widths.iter().enumerate() {
                let turn = widths[joint];
                for share in SHARES {
                    let speed = share * ctx.top_speed[k];
                    // A bump no wider than the smoothing of the direction would be the smoothing's own error.
                    if speed < 2.0 * turn.width {
                        continue;
                    }
                    let source = local(k, move |m, k| {
                        m.segment.v[k].iter().map(|v| turn.sign(*v) * math::exp(-(v / speed) * (v / speed))).collect()
                    });
                    shapes.push(Shape::free(vec![source]).at(w).with(vec![speed]));
                }
            }
            out.push(Proposal::at_drive(ctx, k, shapes));
        }
        out
    }

    fn read(&self, view: &View) -> Reading {
        let coulomb = view.model.joints[view.place].coulomb + view.coulomb_change;
        if view.own[0] <= 0.0 {
            return Err("friction would fall, not rise, towards standstill".to_string());
        }
        if coulomb < 0.0 {
            return Err(format!("dry friction would be negative ({})", number(coulomb)));
        }
        Ok(vec![("coulomb", coulomb), ("stiction", coulomb + view.own[0]), ("stribeck_velocity", view.shape[0])])
    }
}
