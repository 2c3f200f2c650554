//! How efforts at the drives change when positions, speeds, lengths or the ground are not what the model takes them for.
//!
//! Everything here is smooth along a motion, so it is computed at knots and interpolated: a position of a drive that is wrong by `e(t)`
//! changes the effort by `offset·e + rate·de/dt + mass·d²e/dt²` to first order.

use pkm_dyn::effects::{Applied, Law, Site, find};
use pkm_dyn::inverse_dynamics::{closed_loop_motion, rigid_effort};
use pkm_dyn::model::Model;
use pkm_dyn::{Data, loops};

use crate::channels::{Kind, by_drive, value};
use crate::segment::every;

/// Step of the finite differences `[m | rad]`: small against any geometry, large against Newton's tolerance.
const STEP: f64 = 1e-5;

/// Knots per period of the band: cubic interpolation between them is then good to parts in a thousand at the band's edge.
const KNOTS: f64 = 16.0;

/// A table of series, one per pair of causes and drives: [cause][drive][knot].
pub(crate) type Table = Vec<Vec<Vec<f64>>>;

/// A place whose length may be wrong: what it is, its number there, and its name.
pub(crate) type Length = (Site, usize, String);

/// Sensitivities along a segment, kept at its knots.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sensitivity {
    /// Samples from knot to knot, and samples.
    knots: (usize, usize),
    /// Change of the rigid effort per unit of position offset of each drive: [offset drive][drive][knot].
    pub(crate) offset: Table,
    /// The same per unit of speed.
    pub(crate) rate: Table,
    /// The same per unit of acceleration, rotors included.
    pub(crate) mass: Table,
    /// Change of the rigid effort per metre of each length: [3·place + axis][drive][knot].
    pub(crate) length: Table,
}

impl Sensitivity {
    /// A series of one of the tables at the samples.
    pub(crate) fn at_samples(&self, knots: &[f64]) -> Vec<f64> {
        between_knots(knots, self.knots.0, self.knots.1)
    }
}

/// Links and loops whose frames may sit elsewhere than the model has them, links first.
pub(crate) fn lengths(model: &Model) -> Vec<Length> {
    let place = |name: &String| Applied::try_new(model, "geometry_error", name, &[]).ok().map(|a| (a.site, a.place, name.clone()));
    model.links.iter().map(|l| &l.name).chain(model.loops.iter().map(|l| &l.name)).filter_map(place).collect()
}

/// Whether sensitivities to lengths are taken as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lengths {
    /// They are.
    Taken,
    /// They are not: nothing is made of them.
    Left,
}

/// Takes sensitivities at knots and makes series of them.
pub(crate) struct Knots {
    every: usize,
    n_samples: usize,
    /// The model with each length a step longer: [3·place + axis].
    longer: Vec<Model>,
    /// Lengths that cannot change with the loops closed.
    is_rigid: Vec<bool>,
    at: Sensitivity,
    channels: Vec<Kind>,
    /// Of each channel, per drive and per length: [channel][drive or length][knot].
    of_channels: Vec<[Vec<Vec<f64>>; 2]>,
}

/// The motion of the drives at a sample, and the rigid effort it takes.
#[derive(Clone, Copy)]
pub(crate) struct Here<'h> {
    pub(crate) q: &'h [f64],
    pub(crate) v: &'h [f64],
    pub(crate) a: &'h [f64],
    pub(crate) effort: &'h [f64],
    /// What surplus drives do to each other there; empty where there are none.
    pub(crate) internal: &'h [f64],
}

/// Rigid effort at the motion in `data`, beside efforts of surplus drives that moved nothing at another pose: here they may.
fn effort_beside(model: &Model, data: &mut Data, internal: &[f64]) {
    rigid_effort(model, data);
    if internal.is_empty() {
        return;
    }
    loops::drive_jacobian(model, data);
    for (k, tau) in data.tau_ind.iter_mut().enumerate() {
        *tau -= data.drive_jacobian.column(k).iter().zip(internal).map(|(b, x)| b * x).sum::<f64>();
    }
    loops::distribute(model, data);
}

impl Knots {
    /// For a segment of `n_samples` at period `dt` `[s]`, in a band `[Hz]`, with some channels besides the drives.
    pub(crate) fn new(model: &Model, (channels, wanted): (Vec<Kind>, Lengths), (n_samples, dt): (usize, f64), band: f64) -> Self {
        let every = every(dt, KNOTS * band).min((n_samples / 8).max(1));
        let mut longer = Vec::new();
        if let (Lengths::Taken, Some(Law::Geometry(apply))) = (wanted, find("geometry_error").map(|e| e.law)) {
            for (site, place, _) in lengths(model) {
                for axis in 0..3 {
                    let mut shift = [0.0; 3];
                    shift[axis] = STEP;
                    let mut changed = model.clone();
                    apply(&mut changed, (site, place), &shift);
                    longer.push(changed);
                }
            }
        }
        let n = model.n_act();
        let table = |causes: usize| vec![vec![Vec::new(); n]; causes];
        let at = Sensitivity { knots: (every, n_samples), offset: table(n), rate: table(n), mass: table(n), length: table(longer.len()) };
        let of_channels = channels.iter().map(|_| [vec![Vec::new(); n], vec![Vec::new(); longer.len()]]).collect();
        Self { every, n_samples, is_rigid: vec![false; longer.len()], longer, at, channels, of_channels }
    }

    /// Samples from knot to knot.
    pub(crate) fn every(&self) -> usize {
        self.every
    }

    /// Whether sample `i` is a knot.
    pub(crate) fn is_knot(&self, i: usize) -> bool {
        i.is_multiple_of(self.every)
    }

    /// Takes all sensitivities at a knot; `data` is left at the pose it came with. What does not close is returned.
    pub(crate) fn take(&mut self, model: &Model, data: &mut Data, here: &Here) -> Result<(), loops::Closure> {
        let home = data.q.clone();
        let n = here.q.len();
        let read = |model: &Model, data: &Data| self.channels.iter().map(|c| value(model, data, *c, here.q)).collect::<Vec<f64>>();
        let readings = read(model, data);
        for (kind, of) in self.channels.iter().zip(&mut self.of_channels) {
            of[0].iter_mut().zip(by_drive(model, data, *kind)).for_each(|(series, x)| series.push(x));
        }
        for j in 0..n {
            for (kind, step) in [(0, STEP), (1, STEP), (2, 1.0)] {
                let mut moved = [here.q.to_vec(), here.v.to_vec(), here.a.to_vec()];
                moved[kind][j] += step;
                let closure = closed_loop_motion(model, data, &moved[0], &moved[1], &moved[2]);
                if !closure.is_closed {
                    return Err(closure);
                }
                effort_beside(model, data, here.internal);
                let Sensitivity { offset, rate, mass, .. } = &mut self.at;
                let table = match kind {
                    0 => offset,
                    1 => rate,
                    _ => mass,
                };
                for (k, series) in table[j].iter_mut().enumerate() {
                    series.push((data.tau_act[k] - here.effort[k]) / step);
                }
                data.q.copy_from_slice(&home);
            }
        }
        for (c, changed) in self.longer.iter().enumerate() {
            if !self.is_rigid[c] {
                self.is_rigid[c] = !closed_loop_motion(changed, data, here.q, here.v, here.a).is_closed;
                effort_beside(changed, data, here.internal);
            }
            for k in 0..n {
                let change = if self.is_rigid[c] { 0.0 } else { (data.tau_act[k] - here.effort[k]) / STEP };
                self.at.length[c][k].push(change);
            }
            for ((of, now), before) in self.of_channels.iter_mut().zip(read(changed, data)).zip(&readings) {
                of[1][c].push(if self.is_rigid[c] { 0.0 } else { (now - before) / STEP });
            }
            data.q.copy_from_slice(&home);
        }
        Ok(())
    }

    /// What was taken, of channels at the samples. A length that could not change at some knot is a length that cannot change.
    pub(crate) fn finish(mut self) -> (Sensitivity, Vec<[Vec<Vec<f64>>; 2]>) {
        for (column, _) in self.at.length.iter_mut().zip(&self.is_rigid).filter(|(_, is_rigid)| **is_rigid) {
            column.iter_mut().for_each(|x| x.fill(0.0));
        }
        for of in &mut self.of_channels {
            of[1].iter_mut().zip(&self.is_rigid).filter(|(_, is_rigid)| **is_rigid).for_each(|(x, _)| x.fill(0.0));
            for series in of.iter_mut().flatten() {
                *series = between_knots(series, self.every, self.n_samples);
            }
        }
        (self.at, self.of_channels)
    }
}

/// Cubic (Lagrange) interpolation from every `every`-th of `n` samples to all; extrapolated from the last four knots at the end.
pub(crate) fn between_knots(x: &[f64], every: usize, n: usize) -> Vec<f64> {
    if every == 1 || x.len() < 4 {
        return (0..n).map(|i| x.get(i / every).or(x.last()).copied().unwrap_or(0.0)).collect();
    }
    (0..n)
        .map(|i| {
            let first = (i / every).saturating_sub(1).min(x.len() - 4);
            let u = i as f64 / every as f64 - first as f64;
            let w = [
                -(u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0,
                u * (u - 2.0) * (u - 3.0) / 2.0,
                -u * (u - 1.0) * (u - 3.0) / 2.0,
                u * (u - 1.0) * (u - 2.0) / 6.0,
            ];
            (0..4).map(|k| w[k] * x[first + k]).sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_passes_between_knots_exactly() {
        let f = |i: usize| {
            let t = i as f64;
            0.1 - 2.0 * t + 0.03 * t * t - 1e-4 * t * t * t
        };
        let knots: Vec<f64> = (0..9).map(|k| f(7 * k)).collect();
        for (i, x) in between_knots(&knots, 7, 60).into_iter().enumerate() {
            assert!((x - f(i)).abs() < 1e-9, "sample {i}: {x}");
        }
    }
}
