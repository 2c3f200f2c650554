//! A position reading that drifts: a shift that grows with time since the recording began.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::shift;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("sensor_drift")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shape = |k: usize| {
            // The reading runs ahead, so the true position stays behind it.
            Shape::free(vec![global(move |m| {
                let e: Vec<f64> = (0..m.segment.valid.len()).map(|i| -m.segment.dt * i as f64).collect();
                shift::of_reading(m, k, &e)
            })])
        };
        (0..ctx.model.n_act()).map(|k| Proposal::of_all(ctx, k, vec![shape(k)])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("rate", view.own[0])])
    }
}
