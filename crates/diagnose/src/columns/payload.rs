//! Extra mass on a link: one rigid body, as a point or with an extent.

use nalgebra::SVector;
use pkm_dyn::math;
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};

use super::inertia_error::spread;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

/// Value of a shape that stands in for a fuller one. Of its own, a load whose mass no motion shows is no explanation: moments of links that turn about
/// their origins imitate much.
const STAND_IN: &[f64] = &[1.0];

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

    fn stand_in(&self, _: &[f64]) -> Vec<f64> {
        STAND_IN.to_vec()
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
        let (own, central) = view.model.links[view.place].parameters.centre_of_mass();
        let extent = math::sqrt(own.norm_squared() + central.trace() / view.model.links[view.place].parameters.mass.max(1e-9)).max(0.02);
        let moment = math::sqrt(view.own[1..4].iter().map(|h| h * h).sum());
        let mut added = view.own.to_vec();
        if view.shape == STAND_IN && is_out_of_sight(added[0], moment, extent) {
            added[0] = moment / extent;
        }
        let mass = added[0];
        if mass <= 0.0 {
            return Err(format!("the extra mass would not be positive ({mass:.3} kg)"));
        }
        let com = [added[1] / mass, added[2] / mass, added[3] / mass];
        // A load sits on or near its link: five times the link's own extent is generous.
        let far = moment / mass;
        if far > 5.0 * extent {
            return Err(format!("the mass would sit {far:.2} m from the link's origin, whose extent is {extent:.2} m"));
        }
        let mut out = vec![("mass", mass), ("x", com[0]), ("y", com[1]), ("z", com[2])];
        if view.own.len() == N_INERTIAL {
            let added = InertialParameters::from_vector(&SVector::from_column_slice(&added));
            // Generous: its rotational inertia is known far worse than its mass.
            if !added.is_feasible(0.1) {
                return Err(format!("no body has the extra mass properties (mass {mass:.3} kg)"));
            }
            out.push(("inertia", (added.centre_of_mass().1.trace() / 3.0).max(0.0)));
        }
        Ok(out)
    }
}

/// Whether a mass is not in the recordings at all, while its moment is: of a link that turns about its own origin only mass times distance shows. It is then
/// read as the least that fits on the link.
fn is_out_of_sight(mass: f64, moment: f64, extent: f64) -> bool {
    mass.abs() <= 1e-6 * moment / extent
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, view};

    #[test]
    fn a_mass_that_no_motion_shows_is_the_least_that_fits_on_the_link() {
        let model = Bench::sine(0.2, 1.0).model;
        // A link of 2 kg whose central inertia has the trace 0.03 kg·m², about its own origin.
        let extent = math::sqrt(0.015);
        let place = model.massive_links()[0];
        let read = |own: &[f64]| Effect.read(&View { place, ..view(&model, own, STAND_IN) });
        let values: Vec<f64> = read(&[0.0, 0.3, 0.0, -0.4]).expect("a load").into_iter().map(|(_, v)| v).collect();
        let mass = 0.5 / extent;
        assert!((values[0] - mass).abs() < 1e-12 * mass && (values[1] - 0.3 / mass).abs() < 1e-12, "{values:?}");
        assert!((math::hypot(values[1], values[3]) - extent).abs() < 1e-12, "{values:?}");
        // One that is seen is what is seen, or is refused.
        assert_eq!(read(&[1.5, 0.3, 0.0, -0.4]).expect("a load")[0], ("mass", 1.5));
        assert!(read(&[-0.1, 0.3, 0.0, -0.4]).is_err() && read(&[0.01, 0.3, 0.0, -0.4]).is_err());
        assert!(read(&[0.0; 4]).is_err(), "nothing at all is no load");
        let alone = Effect.read(&View { place, ..view(&model, &[0.0, 0.3, 0.0, -0.4], &[]) });
        assert!(alone.is_err_and(|why| why.contains("would not be positive")), "it stands in for a fuller shape only");
    }
}
