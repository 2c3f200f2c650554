//! Friction of a passive joint, projected to the drives through the loops.

use pkm_dyn::effects::Site;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::explain::number;
use crate::motion::Passive;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_passive")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let passive = ctx.model.passive();
        let coupled = |j: usize| ctx.model.couplings.iter().any(|c| c.joint == j);
        let mut out = Vec::new();
        for (p, &joint) in passive.iter().enumerate().filter(|(_, j)| !coupled(**j)) {
            let mut shapes = Vec::new();
            for (w, widths) in ctx.widths.iter().enumerate() {
                let turn = widths[joint];
                let dry = || global(move |m| projected(&m.passive[p], |v| turn.sign(v)));
                let damping = || global(move |m| projected(&m.passive[p], |v| v));
                shapes.push(Shape::free(vec![dry(), damping()]).at(w));
                shapes.push(Shape::free(vec![dry()]).at(w).with(vec![0.0]));
                shapes.push(Shape::free(vec![damping()]).at(w).with(vec![1.0]));
            }
            let name = ctx.model.joints[joint].name.clone();
            out.push(Proposal { place: joint, site: Site::Joint, other: None, name, scope: (0..ctx.model.n_act()).collect(), shapes });
        }
        out
    }

    fn read(&self, view: &View) -> Reading {
        let (dry, damping) = match view.shape.first() {
            None => (view.own[0], view.own[1]),
            Some(kind) if *kind < 0.5 => (view.own[0], 0.0),
            Some(_) => (0.0, view.own[0]),
        };
        let joint = &view.model.joints[view.place];
        let (coulomb, viscous) = (joint.coulomb + dry, joint.viscous + damping);
        if coulomb < 0.0 || viscous < 0.0 {
            return Err(format!("friction would be negative (coulomb {}, viscous {})", number(coulomb), number(viscous)));
        }
        Ok(vec![("coulomb", coulomb), ("viscous", viscous)])
    }
}

fn projected(passive: &Passive, law: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let force: Vec<f64> = passive.v.iter().map(|v| law(*v)).collect();
    passive.g.iter().map(|g| g.iter().zip(&force).map(|(g, f)| g * f).collect()).collect()
}
