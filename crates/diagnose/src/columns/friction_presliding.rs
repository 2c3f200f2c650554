//! Friction that gives before it slides: a loop over position at every reversal, built at the raw rate.

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::motion::Motion;
use crate::settings::BLOCKS;
use crate::verdict::Use;

/// How far the joint gives before it slides, coulomb over stiffness, to try: shares of the travel, a third apart. Where the first fits best,
/// the joint yields less than these recordings can tell from dry friction that comes at once.
const SHARES: [f64; 9] = [0.00225, 0.003, 0.004, 0.0053, 0.0071, 0.0095, 0.0127, 0.0169, 0.0225];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_presliding")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shape = |k: usize, share: f64| {
            let give = share * ctx.travel[k];
            let source = local(k, move |m, k| dahl(&m.segment.q[k], give));
            let shape = Shape::free(vec![source]).with(vec![give]);
            if share > SHARES[0] { shape } else { shape.into_limit("friction that comes at once") }
        };
        let fitted = || ctx.motions.iter().filter(|m| m.segment.used != Use::Holdout);
        super::that_travel(ctx)
            // Every block must hold a reversal on average, or none could be predicted from the others.
            .filter(|&k| fitted().map(|m| reversals(m, k, SHARES[0] * ctx.travel[k])).sum::<usize>() >= BLOCKS)
            .map(|k| Proposal::at_drive(ctx, k, SHARES.iter().map(|s| shape(k, *s)).collect()))
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (coulomb, give) = (view.own[0], view.shape[0]);
        if coulomb <= 0.0 {
            return Err(format!("friction before sliding would push (coulomb = {})", number(coulomb)));
        }
        if view.model.joints[view.place].coulomb + view.coulomb_change < 0.0 {
            return Err("it would take away more dry friction than there is".to_string());
        }
        Ok(vec![("stiffness", coulomb / give), ("coulomb", coulomb)])
    }
}

/// Dahl's friction as a share of its level, −1 to 1, from rest: exact for any step, since it depends on the way and not on time.
fn dahl(q: &[f64], give: f64) -> Vec<f64> {
    let mut f = 0.0;
    let mut last = q.first().copied().unwrap_or(0.0);
    q.iter()
        .map(|&q| {
            let way = q - last;
            last = q;
            let end = if way > 0.0 { 1.0 } else { -1.0 };
            f = end - (end - f) * math::exp(-way.abs() / give);
            f
        })
        .collect()
}

/// Turns of the motion that are longer than `least`.
fn reversals(m: &Motion, k: usize, least: f64) -> usize {
    let (mut turns, mut extreme, mut up) = (0, m.segment.q[k].first().copied().unwrap_or(0.0), None);
    for &q in &m.segment.q[k] {
        match up {
            None if (q - extreme).abs() > least => (up, extreme) = (Some(q > extreme), q),
            Some(rises) if (q > extreme) == rises => extreme = q,
            Some(rises) if (q - extreme).abs() > least => {
                (turns, extreme, up) = (turns + 1, q, Some(!rises));
            }
            _ => {}
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn the_loop_is_dahl_s_closed_form_in_both_directions() {
        // Out by 5, back by 5, each in steps of 1/100: f = 1 − e^(−x) out, then −1 + (1 + f)·e^(−(5 − x)) back.
        let out = (0..=500).map(|i| f64::from(i) / 100.0);
        let back = (0..500).rev().map(|i| f64::from(i) / 100.0);
        let q: Vec<f64> = out.chain(back).collect();
        let f = dahl(&q, 1.0);
        let top = 1.0 - math::exp(-5.0);
        for (i, (q, f)) in q.iter().zip(&f).enumerate() {
            let want = if i <= 500 { 1.0 - math::exp(-q) } else { (1.0 + top) * math::exp(q - 5.0) - 1.0 };
            assert!((f - want).abs() < 1e-12, "{f} instead of {want} at {i}");
        }
    }

    #[test]
    fn it_does_not_depend_on_the_speed_or_on_the_step() {
        let fine: Vec<f64> = (0..=1000).map(|i| math::sin(f64::from(i) * 0.01)).collect();
        let held: Vec<f64> = fine.iter().flat_map(|q| [*q, *q]).collect();
        let (once, twice) = (dahl(&fine, 0.1), dahl(&held, 0.1));
        assert!(once.iter().enumerate().all(|(i, f)| (f - twice[2 * i]).abs() < 1e-12));
    }

    #[test]
    fn it_is_looked_for_where_the_motion_turns_often() {
        // Ten seconds at 1 Hz turn 20 times; at 0.2 Hz four times.
        let places = |hz: f64| Bench::sine(0.2, hz).shapes(&Effect, 0).len();
        assert_eq!([places(1.0), places(0.2)], [SHARES.len(), 0]);
        assert_eq!(reversals(&Bench::sine(0.2, 1.0).motion, 0, 0.01), 20);
    }

    #[test]
    fn a_reading_gives_way_by_what_was_tried() {
        let bench = Bench::sine(0.2, 1.0);
        assert_eq!(Effect.read(&view(&bench.model, &[3.0], &[0.5])), Ok(vec![("stiffness", 6.0), ("coulomb", 3.0)]));
        assert!(Effect.read(&view(&bench.model, &[-3.0], &[0.5])).is_err());
    }
}
