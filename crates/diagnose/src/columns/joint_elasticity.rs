//! A soft transmission: the load stays behind the motor in proportion to the effort that passes, and swings on it.

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::shift;
use crate::verdict::Use;

/// Resonances that are tried, as shares of the band, from the first on by this ratio: the width of a peak at a twentieth of critical damping.
/// Two and a half bands up a load follows like one that does not swing.
const FIRST: f64 = 0.6;
const RATIO: f64 = 1.12;
const TRIED: i32 = 13;

/// Stiffness of the shape in which the load does not swing: it may be any.
const STIFF: f64 = 0.0;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("joint_elasticity")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shape = |k, stiffness| Shape::free(vec![global(move |m| shift::of_spring(m, k, stiffness))]).with(vec![stiffness]);
        let all = |k| core::iter::once(STIFF).chain(swinging(ctx, k)).map(|stiffness| shape(k, stiffness)).collect();
        (0..ctx.model.n_act()).map(|k| Proposal::of_all(ctx, k, all(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let read = super::stiffness(view.own[0])?;
        // Where it swings tells the stiffness better than how much: friction of the load damps it.
        Ok(if view.shape[0] > STIFF { vec![("stiffness", view.shape[0])] } else { read })
    }

    fn smallest(&self, size: f64) -> Option<f64> {
        Some(1.0 / size)
    }
}

/// Stiffnesses on which the load of drive `k` swings at the frequencies that are tried; none where it has no inertia.
fn swinging(ctx: &Context, k: usize) -> Vec<f64> {
    let fitted = || ctx.motions.iter().filter(|m| m.segment.used != Use::Holdout);
    let mass = fitted().map(|m| shift::swinging(m, k)).sum::<f64>() / fitted().count().max(1) as f64;
    let rate = |i: i32| core::f64::consts::TAU * FIRST * math::powf(RATIO, f64::from(i)) * ctx.band;
    (0..TRIED).filter(|_| mass > 0.0).map(|i| mass * rate(i) * rate(i)).collect()
}
