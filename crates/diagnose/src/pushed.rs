//! Links that something outside may push: how a wrench on each is felt at the drives, at the knots of a motion.
//!
//! Other than a link that is held all along ([`crate::held`]), any link with mass that moves may be pushed for a while: what is felt of it is
//! smooth along the motion and kept at knots alone.

use pkm_dyn::jacobian::{Reference, frame_jacobian};
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::{Data, Model};

use crate::sensitivity::between_knots;

/// A link along a segment.
#[derive(Debug, Clone)]
pub(crate) struct Pushed {
    pub(crate) link: usize,
    every: usize,
    n: usize,
    /// Effort that each drive is spared per unit of each component of a wrench at the link's origin, force first, in the root's axes:
    /// [component][drive][knot].
    spared: [Vec<Vec<f64>>; 6],
}

impl Pushed {
    /// Every link with mass that moves, those nearer to the root first; `n` samples with a knot at every `every`-th.
    pub(crate) fn all(model: &Model, (n, every): (usize, usize)) -> Vec<Self> {
        let depth = |link: usize| {
            let (mut at, mut depth) = (model.links[link].body, 0_usize);
            while let Some(body) = at {
                (at, depth) = (model.joints[body].parent, depth + 1);
            }
            depth
        };
        let mut links = model.massive_links();
        links.sort_by_key(|&l| depth(l));
        let spared = || core::array::from_fn(|_| vec![Vec::with_capacity(n / every + 1); model.n_act()]);
        links.into_iter().map(|link| Self { link, every, n, spared: spared() }).collect()
    }

    /// Takes the knot at the pose and the drives' reduction in `data`.
    pub(crate) fn take(&mut self, model: &Model, data: &mut Data) {
        let link = &model.links[self.link];
        frame_jacobian(model, data, &FrameOnBody { body: link.body, pose: link.pose }, Reference::LocalWorldAligned);
        for (c, drives) in self.spared.iter_mut().enumerate() {
            let row = data.jacobian.row(c);
            for (k, knots) in drives.iter_mut().enumerate() {
                knots.push(row.iter().zip(data.drive_reduction.column(k).iter()).map(|(j, r)| j * r).sum());
            }
        }
    }

    /// What drive `k` is spared per unit of component `c`, at the knots.
    pub(crate) fn at_knots(&self, c: usize, k: usize) -> &[f64] {
        &self.spared[c][k]
    }

    /// The same at the samples.
    pub(crate) fn at_samples(&self, c: usize, k: usize) -> Vec<f64> {
        between_knots(&self.spared[c][k], self.every, self.n)
    }

    /// Samples from knot to knot.
    pub(crate) fn every(&self) -> usize {
        self.every
    }
}
