//! Gear losses in the quadrants of load: a share of the rigid model's load where the drive drives, another where it is driven back.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::turning::Turn;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("directional_efficiency")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k: usize| {
            let shape = |(w, widths): (usize, &Vec<Turn>)| {
                let turn = widths[ctx.model.actuators[k]];
                let loss = |drives: bool| {
                    local(k, move |m, k| {
                        let is_in = |v: f64, load: f64| (v * load >= 0.0) == drives;
                        let one = |(v, load): (&f64, &f64)| if is_in(*v, *load) { load.abs() * turn.sign(*v) } else { 0.0 };
                        m.segment.v[k].iter().zip(&m.rigid[k]).map(one).collect()
                    })
                };
                Shape::free(vec![loss(true), loss(false)]).at(w)
            };
            ctx.widths.iter().enumerate().map(shape).collect()
        };
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let [drive, back] = [view.own[0], view.own[1]];
        if drive < 0.0 || back < 0.0 {
            return Err(format!("the gear would add effort (share {} driving, {} driven back)", number(drive), number(back)));
        }
        Ok(vec![("efficiency_drive", 1.0 / (1.0 + drive)), ("efficiency_back", 1.0 - back)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, series, view};

    #[test]
    fn columns_are_the_law_at_its_reading() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in bench.shapes(&Effect, 0) {
            let own = [0.2, 0.3];
            let reading = Effect.read(&view(&bench.model, &own, &[])).expect("losses are losses");
            let values = bench.values("directional_efficiency", &reading);
            let [drive, back] = [0, 1].map(|i| series(&shape.sources[i], &bench.motion));
            for i in (0..drive.len()).filter(|&i| bench.is_clear(i)) {
                let law = bench.effort("directional_efficiency", &values, i);
                assert!((own[0] * drive[i] + own[1] * back[i] - law).abs() <= 0.02 * bench.load_peak(), "{law} at {i}");
            }
        }
    }
}
