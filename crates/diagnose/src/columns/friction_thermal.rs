//! Damping that changes with warmth or running time: velocity times warmth, beside the velocity every model has.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::motion::{Motion, top_speed};
use crate::verdict::Use;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_thermal")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let fitted = || ctx.motions.iter().filter(|m| m.segment.used != Use::Holdout);
        (0..ctx.model.n_act())
            .filter(|&k| fitted().any(|m| repeats_itself(m, k)))
            .map(|k| Proposal::at_drive(ctx, k, vec![Shape::free(vec![local(k, warm_speed)]).with(vec![most_warmth(ctx.motions, k)])]))
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let viscous = view.model.joints[view.place].viscous + view.viscous_change;
        if viscous <= 0.0 {
            return Err(format!("there is no damping that could change ({})", number(viscous)));
        }
        let rate = view.own[0] / viscous;
        if 1.0 + rate * view.shape[0] < 0.0 {
            return Err(format!("damping would become negative (rate = {})", number(rate)));
        }
        Ok(vec![("rate", rate)])
    }
}

/// Warmth as the law has it: temperature above the first sample's, or the time since.
fn warmth(m: &Motion, k: usize) -> impl Iterator<Item = f64> + '_ {
    let recorded = &m.segment.warmth[k];
    (0..m.segment.valid.len()).map(move |i| recorded.get(i).copied().unwrap_or(m.segment.dt * i as f64))
}

fn warm_speed(m: &Motion, k: usize) -> Vec<f64> {
    m.segment.v[k].iter().zip(warmth(m, k)).map(|(v, w)| v * w).collect()
}

fn most_warmth(motions: &[Motion], k: usize) -> f64 {
    motions.iter().map(|m| warmth(m, k).fold(0.0, f64::max)).fold(0.0, f64::max)
}

/// Whether the drive is as fast at the end as at the start: damping that changed can only be seen in the same motion early and late.
fn repeats_itself(m: &Motion, k: usize) -> bool {
    let v = &m.segment.v[k];
    let third = v.len() / 3;
    let [early, late] = [top_speed(&v[..third]), top_speed(&v[v.len() - third..])];
    early.min(late) > 0.5 * early.max(late)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn the_column_is_the_law_at_unit_rate() {
        let mut bench = Bench::sine(0.2, 1.0);
        bench.model.joints[0].viscous = 1.0;
        let shape = bench.shapes(&Effect, 0).swap_remove(0);
        bench.assert_column(&shape.sources[0], |i| bench.effort("friction_thermal", &[1.0], i), 1e-9);
    }

    #[test]
    fn a_recorded_temperature_counts_instead_of_time() {
        let mut bench = Bench::sine(0.2, 1.0);
        let n = bench.motion.segment.valid.len();
        bench.motion.segment.warmth = vec![vec![7.0; n]];
        assert!(warm_speed(&bench.motion, 0).iter().zip(&bench.motion.segment.v[0]).all(|(w, v)| (w - 7.0 * v).abs() < 1e-12));
    }

    #[test]
    fn a_motion_that_dies_away_shows_no_change_of_damping() {
        let mut bench = Bench::sine(0.2, 1.0);
        let n = bench.motion.segment.valid.len();
        bench.motion.segment.v[0].iter_mut().enumerate().for_each(|(i, v)| *v *= 1.0 - 0.9 * i as f64 / n as f64);
        assert!(!repeats_itself(&bench.motion, 0));
    }

    #[test]
    fn damping_cannot_become_negative() {
        let mut bench = Bench::sine(0.2, 1.0);
        bench.model.joints[0].viscous = 2.0;
        assert_eq!(Effect.read(&view(&bench.model, &[-0.1], &[10.0])), Ok(vec![("rate", -0.05)]));
        assert!(Effect.read(&view(&bench.model, &[-0.3], &[10.0])).is_err());
    }
}
