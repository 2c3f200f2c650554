//! Wrong mass properties of a link: all ten scaled, or each on its own within half its size.

use pkm_dyn::parameters::{InertialParameters, N_INERTIAL, NAMES};

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, global};
use crate::shelf::Tape;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("inertia_error")
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
                let theta = ctx.model.links[link].parameters.to_vector();
                let all =
                    || Shape::free(vec![global(move |m| scaled(&m.link_columns[l * N_INERTIAL..(l + 1) * N_INERTIAL], theta.as_slice()))]);
                let sd: Vec<f64> = spread(&ctx.model.links[link].parameters).iter().map(|s| 0.5 * s).collect();
                let free = (0..N_INERTIAL).map(|c| Source::Rigid(l, c)).collect();
                let shapes = vec![
                    all(),
                    all().with_offsets(0..ctx.model.n_act()),
                    Shape { values: Vec::new(), softness: None, sources: free, prior: sd, n_own: N_INERTIAL, limit: None },
                ];
                Proposal::on_link(ctx, link, shapes)
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let old = view.model.links[view.place].parameters.to_vector();
        let mut new = old;
        if view.own.len() == 1 {
            new *= 1.0 + view.own[0];
        } else {
            for (n, d) in new.iter_mut().zip(view.own) {
                *n += d;
            }
        }
        if !InertialParameters::from_vector(&new).is_feasible(1e-3) {
            return Err(format!("the link's new mass properties would be impossible (mass {:.3} kg)", new[0]));
        }
        Ok(NAMES.iter().copied().zip(new.iter().copied()).filter(|(n, v)| *n == "mass" || (v - old[index(n)]).abs() > 0.0).collect())
    }
}

fn index(name: &str) -> usize {
    NAMES.iter().position(|n| *n == name).unwrap_or(0)
}

fn scaled(columns: &[Vec<Tape>], theta: &[f64]) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = columns[0].iter().map(|c| vec![0.0; c.len()]).collect();
    for (column, t) in columns.iter().zip(theta) {
        for (sum, series) in out.iter_mut().zip(column) {
            for (s, x) in sum.iter_mut().zip(series.read()) {
                *s += t * x;
            }
        }
    }
    out
}

/// Size against which an error of each parameter is judged: mass, mass × extent, mass × extent².
pub(crate) fn spread(p: &InertialParameters) -> [f64; N_INERTIAL] {
    let (com, central) = p.centre_of_mass();
    let square = com.norm_squared() + central.trace().max(0.0) / p.mass.max(1e-9);
    let length = pkm_dyn::math::sqrt(square);
    let mut out = [p.mass * square; N_INERTIAL];
    out[0] = p.mass;
    out[1..4].fill(p.mass * length);
    out
}
