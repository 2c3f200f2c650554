//! A part of the transmission that turns with two joints: columns of the sum of both coordinates, felt at both.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, pair};
use crate::explain::number;

/// Shapes with one cause only: which of the law's parameters it is.
const INERTIA: f64 = 0.0;
const COULOMB: f64 = 1.0;
const VISCOUS: f64 = 2.0;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("transmission_coupling")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let n = ctx.model.n_act();
        let joint = |k: usize| &ctx.model.joints[ctx.model.actuators[k]];
        let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| [i, j]));
        pairs
            // The sum of a length and an angle means nothing.
            .filter(|[i, j]| joint(*i).kind == joint(*j).kind)
            .map(|[i, j]| {
                let shapes = shapes(ctx, [i, j]);
                Proposal { other: Some(ctx.model.actuators[j]), scope: vec![i, j], ..Proposal::at_drive(ctx, i, shapes) }
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let names = ["inertia", "coulomb", "viscous"];
        let is = |kind: f64| view.shape.first().is_some_and(|s| (s - kind).abs() < 0.5);
        let out: Vec<(&'static str, f64)> = match view.own {
            [only] if is(INERTIA) => vec![(names[0], *only)],
            [only] if is(COULOMB) => vec![(names[1], *only)],
            [only] => vec![(names[2], *only)],
            all => names.into_iter().zip(all.iter().copied()).collect(),
        };
        match out.iter().find(|(_, v)| *v < 0.0) {
            Some((name, v)) => Err(format!("its {name} would be negative ({})", number(*v))),
            None => Ok(out),
        }
    }
}

/// All three together and each alone, per softness of directions.
fn shapes(ctx: &Context, drives: [usize; 2]) -> Vec<Shape> {
    let mut out = Vec::new();
    let acceleration = || pair(drives, |m, [i, j], t| m.segment.a[i][t] + m.segment.a[j][t]);
    let speed = || pair(drives, |m, [i, j], t| m.segment.v[i][t] + m.segment.v[j][t]);
    out.push(Shape::free(vec![acceleration()]).with(vec![INERTIA]));
    out.push(Shape::free(vec![speed()]).with(vec![VISCOUS]));
    for (w, widths) in ctx.widths.iter().enumerate() {
        let [turn, other] = drives.map(|k| widths[ctx.model.actuators[k]]);
        let turn = turn.wider(other);
        let dry = pair(drives, move |m, [i, j], t| turn.sign(m.segment.v[i][t] + m.segment.v[j][t]));
        out.push(Shape::free(vec![dry]).at(w).with(vec![COULOMB]));
        out.push(Shape::free(vec![Source::Again(0), Source::Again(2 + w), Source::Again(1)]).at(w));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn both_joints_feel_the_sum() {
        let bench = Bench::pair();
        let shapes = bench.shapes(&Effect, 0);
        let m = &bench.motion.segment;
        for (shape, law) in [(0, &m.a), (1, &m.v)] {
            let Source::New(make) = &shapes[shape].sources[0] else { panic!("a new column") };
            let columns = make(&bench.motion);
            assert_eq!(columns.iter().map(|c| c.0).collect::<Vec<_>>(), [0, 1]);
            for (_, column) in columns {
                assert!(column.iter().enumerate().all(|(t, x)| (x - law[0][t] - law[1][t]).abs() < 1e-12));
            }
        }
    }

    #[test]
    fn nothing_of_it_can_be_negative() {
        let bench = Bench::pair();
        assert!(Effect.read(&view(&bench.model, &[1.0, -0.1, 1.0], &[])).is_err());
        assert_eq!(Effect.read(&view(&bench.model, &[2.0], &[VISCOUS])), Ok(vec![("viscous", 2.0)]));
    }
}
