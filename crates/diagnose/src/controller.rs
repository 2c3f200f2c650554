//! Before anything about the robot: is the recorded command what the stated controller computes from the recorded signals?
//!
//! A wrong gain, a feed-forward that was left out or a logger that scales looks like physics, and is none. The controller is replayed on
//! what it saw; nothing of the robot enters.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_ident::Recording;
use pkm_ident::filter::LowPass;

use crate::final_fit::student_95;
use crate::settings::BLOCKS;

/// The stated controller, replayed on what it saw.
pub trait ControllerTwin {
    /// Commands at the recording's samples by joint name `[N | N·m]`; none where the recording lacks what the controller is fed.
    ///
    /// # Errors
    /// One line: a controller that stops on the recorded signals.
    fn commands(&mut self, recording: &Recording) -> Result<Option<BTreeMap<String, Vec<f64>>>, String>;
}

/// Smallest share worth a name: rates that are no multiples of one another alone change a replayed command by about one percent.
const WORTH: f64 = 0.02;

/// Correlation from which on the recorded command is the computed one but for a factor.
const SAME: f64 = 0.95;

/// How one drive's recorded command compares with the computed one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Replayed {
    pub(crate) drive: usize,
    pub(crate) joint: String,
    /// What is missing of the computed command: recorded = (1 − share)·computed.
    pub(crate) share: f64,
    /// Half the width of its 95 % interval, from blocks.
    pub(crate) half_width: f64,
    /// Correlation of the two.
    pub(crate) correlation: f64,
}

impl Replayed {
    /// Whether the share is far from zero, or the two are no multiples of each other at all.
    pub(crate) fn is_mismatch(&self) -> bool {
        !self.is_scaled() || self.share.abs() > WORTH.max(1.5 * self.half_width)
    }

    /// Whether a factor is all that lies between the two.
    pub(crate) fn is_scaled(&self) -> bool {
        self.correlation >= SAME
    }

    /// An upper bound on the chance of such a share where there is none.
    pub(crate) fn p_value(&self) -> f64 {
        let z = 1.96 * self.share / self.half_width.max(f64::MIN_POSITIVE);
        math::exp(-0.5 * z * z)
    }
}

/// Replays the controller on every recording; drives in their order, and a note where it could not be replayed.
pub(crate) fn replay(robot: &Robot, twin: &mut dyn ControllerTwin, recordings: &[Recording]) -> (Vec<Replayed>, Vec<String>) {
    let mut notes = Vec::new();
    let mut pairs: BTreeMap<usize, Vec<[f64; 3]>> = BTreeMap::new();
    for r in recordings {
        match twin.commands(r) {
            Err(problem) => notes.push(format!("{}: the stated controller cannot be replayed: {problem}", r.name)),
            Ok(None) => notes.push(format!("{}: no references recorded, so the stated controller is not replayed", r.name)),
            Ok(Some(commands)) => {
                for (k, &j) in robot.model.actuators.iter().enumerate() {
                    let name = &robot.model.joints[j].name;
                    if let (Some(x), Some(y)) = (commands.get(name), r.signal(&format!("tau.{name}"))) {
                        pairs.entry(k).or_default().extend(blocks(&r.time, x, y));
                    }
                }
            }
        }
    }
    let name = |k: usize| robot.model.joints[robot.model.actuators[k]].name.clone();
    let out = pairs.into_iter().filter_map(|(k, blocks)| compare(k, name(k), &blocks)).collect();
    (out, notes)
}

/// Sums xx, xy, yy of computed and recorded command per block of one recording, both without what lies above a tenth of the rate.
fn blocks(time: &[f64], x: &[f64], y: &[f64]) -> Vec<[f64; 3]> {
    let n = x.len().min(y.len()).min(time.len());
    if n < 10 * BLOCKS {
        return Vec::new();
    }
    let dt = (time[n - 1] - time[0]) / (n - 1) as f64;
    let filter = LowPass::new(0.1 / dt, dt);
    // A missing sample is bridged by the one before it: it is missing in both.
    let held = |signal: &[f64]| -> Vec<f64> {
        let hold = |last: &mut f64, s: &f64| {
            *last = if s.is_finite() { *s } else { *last };
            Some(*last)
        };
        signal.iter().scan(0.0, hold).collect()
    };
    let is_known: Vec<bool> = x.iter().zip(y).map(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let (x, y) = (filter.apply(&held(&x[..n])), filter.apply(&held(&y[..n])));
    // A controller begins somewhere unknown: the first block is its filters' and integrators'.
    (1..BLOCKS)
        .map(|b| {
            let rows = (b * n / BLOCKS..(b + 1) * n / BLOCKS).filter(|&i| is_known[i]);
            rows.fold([0.0; 3], |s, i| [s[0] + x[i] * x[i], s[1] + x[i] * y[i], s[2] + y[i] * y[i]])
        })
        .collect()
}

fn compare(drive: usize, joint: String, blocks: &[[f64; 3]]) -> Option<Replayed> {
    let all = blocks.iter().fold([0.0; 3], |s, b| [s[0] + b[0], s[1] + b[1], s[2] + b[2]]);
    if all[0] <= 0.0 || all[2] <= 0.0 || blocks.len() < 3 {
        return None;
    }
    let n = blocks.len() as f64;
    let without: Vec<f64> = blocks.iter().map(|b| (all[1] - b[1]) / (all[0] - b[0]).max(f64::MIN_POSITIVE)).collect();
    let mean = without.iter().sum::<f64>() / n;
    let variance = (n - 1.0) / n * without.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
    let half_width = student_95(blocks.len() - 1) * math::sqrt(variance);
    Some(Replayed { drive, joint, share: 1.0 - all[1] / all[0], half_width, correlation: all[1] / math::sqrt(all[0] * all[2]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(f: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..2000).map(|i| f(0.002 * i as f64)).collect()
    }

    #[test]
    fn a_share_that_is_missing_is_measured() {
        let time = series(|t| t);
        let x = series(|t| math::sin(3.0 * t) + 0.3 * math::sin(11.0 * t));
        let y: Vec<f64> = x.iter().map(|x| 0.85 * x).collect();
        let found = compare(0, "a".to_string(), &blocks(&time, &x, &y)).expect("there is something to compare");
        assert!((found.share - 0.15).abs() < 1e-9 && found.correlation > 0.999_999 && found.is_mismatch(), "{found:?}");
        let same = compare(0, "a".to_string(), &blocks(&time, &x, &x)).expect("there is something to compare");
        assert!(!same.is_mismatch(), "{same:?}");
    }

    #[test]
    fn another_law_is_no_factor() {
        let (time, x) = (series(|t| t), series(|t| math::sin(3.0 * t)));
        let y = series(|t| math::cos(7.0 * t));
        let found = compare(0, "a".to_string(), &blocks(&time, &x, &y)).expect("there is something to compare");
        assert!(!found.is_scaled() && found.is_mismatch(), "{found:?}");
    }
}
