//! A soft mounting: the ground gives way to the robot's reaction, and its acceleration is felt at every drive.
//!
//! Only the mounting is looked for: there a displacement changes no geometry, so what is felt is exact to first order.

use pkm_dyn::effects::Site;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::shift;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("structure_flexibility")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let root = ctx.model.links.iter().position(|l| l.name == ctx.model.root).unwrap_or(0);
        let shape = Shape::free(vec![global(shift::of_mounting)]);
        vec![Proposal {
            place: root,
            site: Site::Link,
            other: None,
            name: ctx.model.root.clone(),
            scope: (0..ctx.model.n_act()).collect(),
            shapes: vec![shape],
        }]
    }

    fn read(&self, view: &View) -> Reading {
        super::stiffness(view.own[0])
    }

    fn smallest(&self, size: f64) -> Option<f64> {
        Some(1.0 / size)
    }
}
