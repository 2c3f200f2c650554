//! A reading that drifts, of position or of effort: a shift that grows with time since the recording began.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global, local};
use crate::motion::Motion;
use crate::shift;

/// Value of the shape in which it is the effort that is read wrongly.
const EFFORT: f64 = 1.0;

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
        // The reading runs ahead, so the true position stays behind it; a recorded effort has the drift in it as it is.
        let position = |k: usize| Shape::free(vec![global(move |m| shift::of_reading(m, k, &times(m, -1.0)))]).with(vec![0.0]);
        let effort = |k: usize| Shape::free(vec![local(k, |m, _| times(m, 1.0))]).with(vec![EFFORT]);
        let drives = || 0..ctx.model.n_act();
        let positions = drives().map(|k| Proposal::of_all(ctx, k, vec![position(k)]));
        positions.chain(drives().map(|k| Proposal::at_drive(ctx, k, vec![effort(k)]))).collect()
    }

    fn is_of_the_effort_reading(&self, shape: &[f64]) -> bool {
        shape.first().is_some_and(|s| *s >= EFFORT)
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("rate", view.own[0])])
    }
}

/// Time since the recording began at every sample, times `sign`.
fn times(m: &Motion, sign: f64) -> Vec<f64> {
    (0..m.segment.valid.len()).map(|i| sign * m.segment.dt * i as f64).collect()
}
