//! Where the model as given is furthest from the recordings: what can be said long before it can be said why.

use pkm_dyn::Model;
use pkm_dyn::math;

use crate::design::{Design, View};
use crate::final_fit::{JointError, errors_on, left_on};
use crate::motion::Motion;
use crate::regimes::{Regime, regimes_on};

/// A regime that holds fewer of the rows than this share is no place to look at first.
const LEAST: f64 = 0.05;

/// The largest mismatch between model and recordings, by the measure of the verdict's own map (errors by joint and regime): known before any
/// explanation is sought.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// Joint of the drive whose error is the largest share of its effort.
    pub joint: String,
    /// Unit of its effort, `N` or `N·m`.
    pub unit: String,
    /// rms of measured effort less that of the model as given over the held-out rows, in `unit`.
    pub rms: f64,
    /// The same over the rms of the measured effort.
    pub share_of_effort: f64,
    /// Its part of the sum of those shares' squares over all drives, 0 to 1.
    pub share_of_error: f64,
    /// Regime of the joint in which the error is largest.
    pub regime: String,
    /// When that is, in numbers.
    pub condition: String,
    /// rms error in that regime, all rows, over the rms of the held-out measured effort.
    pub share_in_regime: f64,
}

impl core::fmt::Display for Located {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let percent = |x: f64| 100.0 * x;
        write!(
            f,
            "largest mismatch at {}: {:.3} {} rms, {:.1} % of its effort, {:.0} % of all drives' squared error; most in {} ({}), {:.1} %",
            self.joint,
            self.rms,
            self.unit,
            percent(self.share_of_effort),
            percent(self.share_of_error),
            self.regime,
            self.condition,
            percent(self.share_in_regime)
        )
    }
}

/// Looks on while a diagnosis runs.
pub trait Watch {
    /// The share that is done, 0 to 1.
    fn progress(&mut self, share: f64);

    /// Where the largest mismatch is, once, before any explanation is sought; `None` where nothing is left to explain.
    fn located(&mut self, first: Option<&Located>) {
        let _ = first;
    }
}

/// Finds the largest mismatch.
pub(crate) fn located(model: &Model, motions: &[Motion], design: &Design) -> Option<Located> {
    let left = left_on(design, 0, &[], View::Judge);
    let share = |e: &JointError| if e.effort > 0.0 { e.error / e.effort } else { 0.0 };
    let errors = errors_on(design, &left);
    let (j, worst) = errors.iter().enumerate().max_by(|a, b| share(a.1).total_cmp(&share(b.1)))?;
    let all: f64 = errors.iter().map(|e| share(e) * share(e)).sum();
    if all <= 0.0 {
        return None;
    }
    let in_regime = |r: &Regime| -> (f64, f64) {
        let (mut sum, mut inside, mut total) = (0.0, 0_usize, 0_usize);
        for (s, rows) in design.rows.iter().enumerate() {
            for i in (0..rows.time.len()).filter(|&i| rows.valid[i]) {
                total += 1;
                if r.mask[s][i] {
                    inside += 1;
                    sum += left[j][s][i] * left[j][s][i];
                }
            }
        }
        (math::sqrt(sum / inside.max(1) as f64) / worst.effort, inside as f64 / total.max(1) as f64)
    };
    let regimes = regimes_on(model, motions, design, j).into_iter().map(|r| (in_regime(&r), r)).filter(|((_, rows), _)| *rows >= LEAST);
    let ((share_in_regime, _), regime) = regimes.max_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
    let joint = &model.joints[model.actuators[j]];
    Some(Located {
        joint: joint.name.clone(),
        unit: joint.kind.unit_effort().to_string(),
        rms: worst.error,
        share_of_effort: share(worst),
        share_of_error: share(worst) * share(worst) / all,
        regime: regime.name.to_string(),
        condition: regime.condition,
        share_in_regime,
    })
}
