//! A position error that repeats with position: a shift by sine and cosine of a few orders over the travel, its speed and acceleration
//! included.

use core::f64::consts::TAU;

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::explain::number;
use crate::shift;

/// Periods over the travel. Less than one is an offset and a wrong scale; many more are ripple of the effort, for all that is left of
/// the shift there is its acceleration.
const CYCLES: [f64; 8] = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("encoder_eccentricity")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act())
            .filter(|&k| ctx.travel[k] > 0.0)
            .map(|k| {
                let shape = |cycles: f64| {
                    let order = cycles * TAU / ctx.travel[k];
                    let wave = |f: fn(f64) -> f64| {
                        global(move |m| {
                            let e: Vec<f64> = m.segment.q[k].iter().map(|q| f(order * q)).collect();
                            shift::of_reading(m, k, &e)
                        })
                    };
                    Shape::free(vec![wave(math::sin), wave(math::cos)]).with(vec![order])
                };
                Proposal::of_all(ctx, k, CYCLES.into_iter().map(shape).collect())
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (s, c) = (view.own[0], view.own[1]);
        let (amplitude, order) = (math::hypot(s, c), view.shape[0]);
        if amplitude * order > 0.5 {
            return Err(format!(
                "the reading would run {} ahead and behind at order {}: no position sensor does",
                number(amplitude),
                number(order)
            ));
        }
        Ok(vec![("amplitude", amplitude), ("order", order), ("phase", math::atan2(c, s))])
    }
}
