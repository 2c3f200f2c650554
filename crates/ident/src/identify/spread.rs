//! How far the estimates can be trusted, each method by its own equations.

use faer::Mat;

use crate::answer::{Estimated, IdentifyError, Intervals};
use crate::estimate::Method;
use crate::estimate::feasible::Tangent;
use crate::estimate::robust::Loss;
use crate::grouping::BaseSet;
use crate::observation::Rows;
use crate::statistics::{Residual, Sandwich, Say, critical_95, residual_series};

use super::{Fit, Found, Work};

/// A base parameter of which the active bounds leave less than this share of its variance does not move with them.
const HELD: f64 = 1e-9;

/// What of a method, beside rows and residuals, its spread depends on.
#[derive(Clone)]
pub(super) enum Spread {
    /// The weights of the drives alone.
    Weighted,
    /// Every row counts alike, whatever the drive.
    Ordinary,
    /// Rows that lose their say.
    Cut(Loss),
    /// Square of every kept column that is noise.
    Total(Vec<f64>),
    /// Precision that every kept column is drawn to the nominal robot with, and how much wider than that the recordings find the nominal
    /// robot off.
    Drawn(Vec<f64>, f64),
    /// Bounds and prior of the physical estimate, and the weighted estimate without them.
    Physical(Box<Tangent>, Vec<f64>),
}

impl Spread {
    /// What intervals from it are about.
    pub(super) fn intervals(&self) -> Intervals {
        match self {
            Self::Weighted | Self::Ordinary | Self::Cut(_) => Intervals::Sampling,
            Self::Total(_) => Intervals::FirstOrder,
            Self::Drawn(..) | Self::Physical(..) => Intervals::Posterior,
        }
    }
}

impl Work<'_, '_, '_> {
    /// Sandwich of the fit and the residuals that its intervals are about; `residuals` are those of the rows.
    pub(super) fn sandwich(&self, set: &BaseSet, fit: &Fit, residuals: &[Residual], freedom: f64) -> Result<Sandwich, IdentifyError> {
        let kept = &set.kept;
        let found = match &fit.spread {
            // The spread of an estimate by instruments is that of the instruments, which have no noise of their own.
            _ if self.instruments.is_some() => Sandwich::of(&self.foretold(&self.foretold)?, kept, &fit.noise, residuals)?,
            Spread::Weighted | Spread::Drawn(..) | Spread::Physical(..) => Sandwich::of(self.observation, kept, &fit.noise, residuals)?,
            Spread::Total(noise) => Sandwich::of(self.observation, kept, &fit.noise, residuals)?.less(noise),
            Spread::Ordinary => {
                let says: Vec<Option<Say>> = self.usable.iter().map(|usable| usable.then_some(Say { bend: 1.0, pull: 1.0 })).collect();
                Sandwich::with(self.observation, kept, &says, residuals)?
            }
            Spread::Cut(loss) => {
                let series = residual_series(self.observation, Rows::Fitted, &fit.direct)?;
                let (cut, bend) = loss.cut(&series, &fit.noise, freedom);
                let left: Vec<Residual> =
                    cut.iter().map(|s| Residual::of(s, freedom).shared(self.observation.drives_per_freedom())).collect();
                let say = |(k, noise): (usize, &f64)| {
                    Say::weighted(*noise).filter(|_| self.usable[k]).map(|s| Say { bend: bend[k] * s.bend, ..s })
                };
                let says: Vec<Option<Say>> = fit.noise.iter().enumerate().map(say).collect();
                Sandwich::with(self.observation, kept, &says, &left)?
            }
        };
        Ok(found)
    }

    /// Base parameters with intervals, and their covariance.
    pub(super) fn parameters(&self, found: Option<&Found>, fit: &Fit, residuals: &[Residual]) -> (Vec<Estimated>, Mat<f64>) {
        let Some(Found { set, sandwich, places, .. }) = found else { return (Vec::new(), Mat::zeros(0, 0)) };
        let n = places.len();
        let unknown = || Mat::from_fn(n, n, |_, _| f64::MAX);
        let plain = || sandwich.covariance(places).unwrap_or_else(unknown);
        let mut covariance = match &fit.spread {
            Spread::Drawn(precision, slack) => {
                let precision = Mat::from_fn(n, n, |i, j| if i == j { precision[i] } else { 0.0 });
                sandwich.drawn(&Mat::identity(n, n), &precision, *slack).unwrap_or_else(unknown)
            }
            Spread::Physical(tangent, _) => {
                sandwich.drawn(&set.combinations(&tangent.map), &tangent.precision, 1.0).unwrap_or_else(unknown)
            }
            _ => plain(),
        };
        let (nominal, value) = (set.project(&self.columns().nominal()), set.project(&fit.direct));
        let used = |(k, r): (usize, &Residual)| if self.usable[k] { r.bandwidth() } else { 0.0 };
        let critical = critical_95(residuals.iter().enumerate().map(used).fold(0.0, f64::max));
        let held = self.held(set, fit, &plain, &covariance);
        // What is held by a bound is not known exactly for that.
        held.iter().for_each(|&(at, _, sd)| covariance[(at, at)] = sd * sd);
        let each = |(at, &i): (usize, &usize)| {
            let sd = covariance[(at, at)].max(0.0).sqrt();
            let mut ci95 = [value[i] - critical * sd, value[i] + critical * sd];
            let mut relative_sd = sd / value[i].abs().max(f64::MIN_POSITIVE);
            if let Some(&(_, middle, sd)) = held.iter().find(|(place, ..)| *place == at) {
                // As far as the estimate without bounds goes to either side, but not beyond the bound of a parameter by itself.
                let lower = if set.is_alone(i) { self.columns().list[set.kept[i]].lower } else { f64::NEG_INFINITY };
                ci95 = [(middle - critical * sd).min(value[i]).max(lower.min(value[i])), (middle + critical * sd).max(value[i])];
                relative_sd = sd / value[i].abs().max(f64::MIN_POSITIVE);
            }
            Estimated {
                name: set.text(i, self.columns()),
                unit: self.columns().list[set.kept[i]].unit,
                nominal: nominal[i],
                value: value[i],
                ci95,
                relative_sd: relative_sd.min(f64::MAX),
            }
        };
        (places.iter().enumerate().map(each).collect(), covariance)
    }

    /// Base parameters that the active bounds hold: place, value of the estimate without bounds, and its standard deviation.
    fn held(&self, set: &BaseSet, fit: &Fit, plain: &dyn Fn() -> Mat<f64>, covariance: &Mat<f64>) -> Vec<(usize, f64, f64)> {
        let Spread::Physical(tangent, unbounded) = &fit.spread else { return Vec::new() };
        if self.settings.method != Method::Sdp || tangent.at_bound.is_empty() {
            return Vec::new();
        }
        let (plain, middle) = (plain(), set.project(unbounded));
        let is_held = |i: &usize| covariance[(*i, *i)] <= HELD * plain[(*i, *i)];
        (0..covariance.nrows()).filter(is_held).map(|i| (i, middle[i], plain[(i, i)].max(0.0).sqrt())).collect()
    }
}
