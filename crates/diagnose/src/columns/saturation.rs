//! Effort clipped below what was commanded: what the recorded effort has beyond a limit does not act.
//!
//! The only column that is made of the recorded effort: no model says what was commanded beyond the limit. It can fit itself only with a
//! coefficient far from one, because what does not act is the whole of the excess; that is the veto.

use pkm_ident::filter::LowPass;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::motion::Motion;

/// Limits to try, as shares of the largest recorded effort, and of the largest effort of the model: behind a limit, integrators and errors
/// can wind a command up to many times what acts.
const SHARES: [f64; 9] = [0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.5];

/// Share of samples that must lie beyond a limit for it to be seen, and share beyond which it would be no limit but a way of life.
const BEYOND: core::ops::Range<f64> = 0.005..0.5;

/// How far from one the coefficient may be: the limit itself is known to the distance of its neighbours only.
const NEAR_ONE: f64 = 0.3;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("saturation")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let mut out = Vec::new();
        for k in 0..ctx.model.n_act() {
            let sizes: Vec<f64> = ctx.motions.iter().flat_map(|m| commanded(m, k)).map(f64::abs).collect();
            let top = sizes.iter().copied().fold(0.0, f64::max);
            let is_reached = |limit: &f64| {
                let share = sizes.iter().filter(|t| *t > limit).count() as f64 / sizes.len().max(1) as f64;
                BEYOND.contains(&share)
            };
            let shape = |limit: f64| {
                let excess = local(k, move |m, k| commanded(m, k).iter().map(|t| t - t.clamp(-limit, limit)).collect());
                Shape::free(vec![excess]).with(vec![limit])
            };
            let acting = ctx.motions.iter().flat_map(|m| &m.nominal[0][k]).fold(0.0_f64, |top, t| top.max(t.abs()));
            // Where both tops are alike, the model's shares would be the recorded one's over again.
            let is_wound_up = top > 1.5 * acting;
            let bases = core::iter::once(top).chain(is_wound_up.then_some(1.05 * acting));
            let shapes: Vec<Shape> = bases.flat_map(|b| SHARES.map(|s| s * b)).filter(is_reached).map(shape).collect();
            if !shapes.is_empty() {
                out.push(Proposal::at_drive(ctx, k, shapes));
            }
        }
        out
    }

    fn read(&self, view: &View) -> Reading {
        if (view.own[0] - 1.0).abs() > NEAR_ONE {
            let share = 100.0 * view.own[0];
            return Err(format!("{share:.0} % of what is commanded beyond {} would be missing, not all of it", number(view.shape[0])));
        }
        Ok(vec![("limit", view.shape[0])])
    }

    fn smallest(&self, _: f64) -> Option<f64> {
        // A limit is seen when it is reached, however little of the effort it takes away.
        None
    }
}

/// The recorded effort without its noise: what is beyond a limit would otherwise be noise as well.
fn commanded(m: &Motion, k: usize) -> Vec<f64> {
    LowPass::new(5.0 * m.segment.band, m.segment.dt).apply(&m.segment.tau[k])
}
