//! A base that is not level: two columns, shared by all joints.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("gravity_tilt")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let root = ctx.model.links.iter().position(|l| l.name == ctx.model.root).unwrap_or(0);
        let shape = Shape::free(vec![global(|m| m.tilt(0)), global(|m| m.tilt(1))]);
        vec![Proposal::on_link(ctx, root, vec![shape])]
    }

    fn read(&self, view: &View) -> Reading {
        if view.own.iter().any(|x| x.abs() > 0.5) {
            return Err(format!("the base would lean by {:.2} and {:.2} rad", view.own[0], view.own[1]));
        }
        Ok(vec![("roll", view.own[0]), ("pitch", view.own[1])])
    }
}
