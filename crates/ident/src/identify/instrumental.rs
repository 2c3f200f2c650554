//! The estimator that needs a simulation: instruments from the motion that the estimate itself foretells, anew in every step.

use crate::Recording;
use crate::answer::{IdentifyError, Instruments, Simulate};
use crate::error::InputError;
use crate::estimate::instrumental::{Stacked, exogeneity, instrumental, stacked};
use crate::estimate::weighted::scatter;
use crate::factor::Factors;
use crate::grouping::BaseSet;
use crate::motion::Use;
use crate::note::Note;
use crate::observation::{Observation, RowOptions, Rows};
use crate::refine::with_parameters;
use crate::statistics::{Residual, residual_series};

use super::{Fit, Work};

/// Simulations of all recordings, at most.
const STEPS: usize = 10;

/// Settled when no row's prediction moves by more than this share of the noise, root mean square.
const SETTLED: f64 = 1e-2;

impl Work<'_, '_, '_> {
    /// Recordings with the positions that `theta` foretells, as an observation in the same band.
    pub(super) fn foretold(&self, recordings: &[Recording]) -> Result<Observation<'_>, InputError> {
        let kinds = self.observation.motions().iter().map(|m| m.used).filter(|u| *u != Use::Holdout);
        let pairs: Vec<(&Recording, Use)> = recordings.iter().zip(kinds).collect();
        let rows = RowOptions { band_hz: Some(self.observation.band()), ..*self.observation.options() };
        Observation::try_new(self.observation.robot(), &pairs, rows)
    }

    fn simulated(&self, simulate: &mut Simulate<'_>, theta: &[f64]) -> Result<Vec<Recording>, String> {
        let robot = with_parameters(self.observation.robot(), self.columns(), theta);
        let mut out = Vec::new();
        for like in self.recordings {
            let mut said = simulate(&robot, like)?;
            if said.time.len() != like.time.len() {
                return Err(format!("{} samples instead of {}", said.time.len(), like.time.len()));
            }
            said.time.clone_from(&like.time);
            said.meta = like.meta.clone();
            out.push(said);
        }
        Ok(out)
    }

    /// Instrumental variables from the weighted estimate `start` on; that estimate where the simulation fails.
    pub(super) fn instrumented(&mut self, set: &BaseSet, free: &[usize], fit: Fit) -> Result<Fit, IdentifyError> {
        let Some(simulate) = self.simulate.take() else { return Err(IdentifyError::NoSimulation) };
        let found = self.iterate(set, free, fit, simulate);
        self.simulate = Some(simulate);
        found
    }

    fn iterate(&mut self, set: &BaseSet, free: &[usize], mut fit: Fit, simulate: &mut Simulate<'_>) -> Result<Fit, IdentifyError> {
        let fixed = self.fixed(free);
        let factors = self.factors.less(&fixed);
        let start = fit.clone();
        let mut last: Option<Stacked> = None;
        let mut iterations = 0;
        let mut is_settled = false;
        while iterations < STEPS && !is_settled {
            let notes = self.notes.len();
            let physical = self.physical(&factors, free, Fit { theta: fixed.clone(), ..fit.clone() });
            self.notes.truncate(notes);
            let said = self.simulated(simulate, &physical.theta);
            let rows = said.and_then(|said| {
                let rows = self.foretold(&said).and_then(|z| stacked(self.observation, &z, &set.kept, &fixed, &fit.noise));
                rows.map(|rows| (said, rows)).map_err(|e| e.to_string())
            });
            let (said, rows) = match rows {
                Ok(found) => found,
                Err(reason) => {
                    return Ok(self.without_instruments(start, iterations, reason));
                }
            };
            let Some(values) = instrumental(&rows) else {
                let reason = "they do not determine the parameters".to_string();
                return Ok(self.without_instruments(start, iterations, reason));
            };
            let mut next = scatter(&values, &set.kept, self.columns().len());
            next.iter_mut().zip(&fixed).for_each(|(x, f)| *x += f);
            is_settled = self.change(&factors, &fit, &next) < SETTLED;
            fit.direct = next;
            self.foretold = said;
            last = Some(rows);
            iterations += 1;
        }
        if let Some(rows) = last {
            self.judge(&rows, set, &mut fit, (iterations, is_settled))?;
        }
        Ok(fit)
    }

    /// The weighted estimate again, with the reason; what earlier simulations foretold is forgotten.
    fn without_instruments(&mut self, start: Fit, iterations: usize, reason: String) -> Fit {
        self.foretold = Vec::new();
        self.notes.push(Note::NoInstruments { iterations, reason });
        start
    }

    /// Root mean square change of the predictions, in units of the drives' noise.
    fn change(&self, factors: &Factors, fit: &Fit, next: &[f64]) -> f64 {
        let triangle = super::triangle_of(factors, &fit.noise);
        let step: Vec<f64> = next.iter().zip(&fit.direct).map(|(a, b)| a - b).collect();
        let p = step.len();
        let moved: f64 = (0..p).map(|i| (i..p).map(|c| triangle[(i, c)] * step[c]).sum::<f64>()).map(|x| x * x).sum();
        (moved / self.row_count().max(1) as f64).sqrt()
    }

    /// Tests the columns, takes the noise anew, and says what came of it.
    fn judge(
        &mut self,
        rows: &Stacked,
        set: &BaseSet,
        fit: &mut Fit,
        (iterations, is_settled): (usize, bool),
    ) -> Result<(), IdentifyError> {
        let series = residual_series(self.observation, Rows::Fitted, &fit.direct)?;
        let mut colour = 1.0;
        for (k, s) in series.iter().enumerate().filter(|(k, _)| self.usable[*k]) {
            let r = Residual::of(s, 1.0);
            fit.noise[k] = r.deviation.max(f64::MIN_POSITIVE);
            colour = f64::max(colour, r.colour());
        }
        let test = exogeneity(rows, colour);
        let weakest = self.columns().list[set.kept[test.weakest.min(set.kept.len() - 1)]].name.clone();
        if test.relevance < crate::estimate::instrumental::WEAK {
            let limit = crate::estimate::instrumental::WEAK;
            self.notes.push(Note::WeakInstruments { parameter: weakest.clone(), explained: test.relevance, limit });
        }
        if !is_settled {
            self.notes.push(Note::NotSettled { iterations });
        }
        self.instruments = Some(Instruments { iterations, is_settled, weakest, colour, test });
        Ok(())
    }
}
