//! Drag with a power of speed that is not one: one column per power.

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;

/// Powers to try: a concave one, and those of churning oil, of air, and of a pump.
const EXPONENTS: [f64; 4] = [0.5, 1.5, 2.0, 3.0];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_quadratic")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Velocity
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k: usize| {
            let joint = ctx.model.actuators[k];
            let mut shapes = Vec::new();
            for (w, widths) in ctx.widths.iter().enumerate() {
                let turn = widths[joint];
                for exponent in EXPONENTS {
                    let power = move |v: &f64| math::powf(v.abs(), exponent) * turn.sign(*v);
                    let source = local(k, move |m, k| m.segment.v[k].iter().map(power).collect());
                    shapes.push(Shape::free(vec![source]).at(w).with(vec![exponent]));
                }
            }
            shapes
        };
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (drag, exponent) = (view.own[0], view.shape[0]);
        if drag <= 0.0 {
            return Err(format!("drag would push (drag = {} with exponent {exponent})", number(drag)));
        }
        Ok(vec![("drag", drag), ("exponent", exponent)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn columns_are_the_law_at_unit_drag() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in bench.shapes(&Effect, 0) {
            let law = |i: usize| bench.effort("friction_quadratic", &[1.0, shape.values[0]], i);
            bench.assert_column(&shape.sources[0], law, 0.02);
        }
    }

    #[test]
    fn drag_that_pushes_is_none() {
        let bench = Bench::sine(0.2, 1.0);
        assert!(Effect.read(&view(&bench.model, &[-1.0], &[2.0])).is_err());
        assert_eq!(Effect.read(&view(&bench.model, &[3.0], &[2.0])), Ok(vec![("drag", 3.0), ("exponent", 2.0)]));
    }
}
