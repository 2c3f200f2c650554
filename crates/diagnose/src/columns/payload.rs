//! Extra mass on a link: one rigid body, as a point or with an extent.

use nalgebra::SVector;
use pkm_dyn::math;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};

use super::inertia_error::spread;

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

    fn is_refittable(&self) -> bool {
        true
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.massive.len())
            .map(|l| {
                let link = ctx.massive[l];
                // As a point, or with an extent of its own.
                let point = Shape::free((0..4).map(|c| Source::Rigid(l, c)).collect());
                let sources = (0..N_INERTIAL).map(|c| Source::Rigid(l, c)).collect();
                let prior = spread(&ctx.model.links[link].parameters).to_vec();
                let body = Shape { values: Vec::new(), softness: None, sources, prior, n_own: N_INERTIAL, limit: None };
                Proposal::on_link(ctx, link, vec![point, body])
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
        let mut out = vec![("mass", mass), ("x", com[0]), ("y", com[1]), ("z", com[2])];
        if view.own.len() == N_INERTIAL {
            let added = InertialParameters::from_vector(&SVector::from_column_slice(view.own));
            // Generous: its rotational inertia is known far worse than its mass.
            if !added.is_feasible(0.1) {
                return Err(format!("no body has the extra mass properties (mass {mass:.3} kg)"));
            }
            out.push(("inertia", (added.centre_of_mass().1.trace() / 3.0).max(0.0)));
        }
        Ok(out)
    }
}
