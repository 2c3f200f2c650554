//! Dry friction along the stroke: direction of motion times a polynomial of the position that has no constant part.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local, stroke};
use crate::explain::number;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

/// Highest power of the position.
const DEGREE: usize = 3;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_position")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k: usize| {
            let [middle, half] = stroke(ctx, k);
            let mut shapes = Vec::new();
            for (w, widths) in ctx.widths.iter().enumerate() {
                let turn = widths[ctx.model.actuators[k]];
                for degree in 1..=DEGREE {
                    let mut sources: Vec<Source> = (1..degree).map(|p| Source::Again(w * DEGREE + p - 1)).collect();
                    sources.push(local(k, move |m, k| {
                        let level = |q: &f64| power((q - middle) / half, degree);
                        m.segment.q[k].iter().zip(&m.segment.v[k]).map(|(q, v)| level(q) * turn.sign(*v)).collect()
                    }));
                    shapes.push(Shape::free(sources).at(w).with(vec![middle, half]));
                }
            }
            shapes
        };
        super::that_travel(ctx).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let [middle, half] = [view.shape[0], view.shape[1]];
        let coulomb = view.model.joints[view.place].coulomb + view.coulomb_change;
        let least = coulomb + lowest(view.own);
        if least < 0.0 {
            return Err(format!("dry friction would be negative in part of the stroke ({})", number(least)));
        }
        let per = |p: usize| view.own.get(p - 1).copied().unwrap_or(0.0) / power(half, p);
        let mut out = vec![("coulomb_slope", per(1)), ("q0", middle)];
        out.extend(
            [("coulomb_quadratic", 2), ("coulomb_cubic", 3)].into_iter().filter(|(_, p)| *p <= view.own.len()).map(|(n, p)| (n, per(p))),
        );
        Ok(out)
    }
}

fn power(x: f64, n: usize) -> f64 {
    (0..n).fold(1.0, |p, _| p * x)
}

/// Least value of the polynomial `own[0]·x + own[1]·x² + …` over the stroke, −1 ≤ x ≤ 1.
fn lowest(own: &[f64]) -> f64 {
    // A cubic moves by less than a thousandth of its size between neighbours.
    (-500..=500).map(|i| f64::from(i) / 500.0).map(|x| own.iter().rev().fold(0.0, |sum, c| (sum + c) * x)).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn columns_are_the_law_at_its_reading() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in bench.shapes(&Effect, 0).into_iter().filter(|s| s.sources.len() == 1) {
            let own = [0.25];
            let mut model = bench.model.clone();
            model.joints[0].coulomb = 1.0;
            let reading = Effect.read(&view(&model, &own, &shape.values)).expect("friction stays positive");
            let values = bench.values("friction_position", &reading);
            let law = |i: usize| bench.effort_beside("friction_position", &values, 1.0, i) / own[0];
            bench.assert_column(&shape.sources[0], law, 0.02);
        }
    }

    #[test]
    fn friction_that_would_push_somewhere_is_none() {
        let bench = Bench::sine(0.2, 1.0);
        let mut model = bench.model.clone();
        model.joints[0].coulomb = 1.0;
        assert!(Effect.read(&view(&model, &[1.2], &[0.0, 0.2])).is_err());
        assert!(Effect.read(&view(&model, &[0.9], &[0.0, 0.2])).is_ok());
    }

    #[test]
    fn the_least_of_a_parabola_is_at_its_vertex() {
        // x² − x has its least value −1/4 at x = 1/2.
        assert!((lowest(&[-1.0, 1.0]) + 0.25).abs() < 1e-5);
    }
}
