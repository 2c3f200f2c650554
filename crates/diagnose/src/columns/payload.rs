//! Extra mass on a link: mass and first moment of one rigid body.

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("payload")
    }

    fn family(&self) -> Family {
        Family::Shift
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.massive.len())
            .map(|l| {
                let link = ctx.massive[l];
                let shape = Shape::free((0..4).map(|c| Source::Rigid(l, c)).collect());
                let scope = (0..ctx.model.n_act()).collect();
                Proposal { place: link, name: ctx.model.links[link].name.clone(), scope, shapes: vec![shape] }
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let mass = view.own[0];
        if mass <= 0.0 {
            return Err(format!("the extra mass would not be positive ({mass:.3} kg)"));
        }
        let com = [view.own[1] / mass, view.own[2] / mass, view.own[3] / mass];
        let (own, central) = view.model.links[view.place].parameters.centre_of_mass();
        // A load sits on or near its link: five times the link's own extent is generous.
        let extent = math::sqrt(own.norm_squared() + central.trace() / view.model.links[view.place].parameters.mass.max(1e-9));
        let far = math::sqrt(com.iter().map(|c| c * c).sum());
        if far > 5.0 * extent.max(0.02) {
            return Err(format!("the mass would sit {far:.2} m from the link's origin, whose extent is {extent:.2} m"));
        }
        Ok(vec![("mass", mass), ("x", com[0]), ("y", com[1]), ("z", com[2])])
    }
}
