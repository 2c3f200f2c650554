//! Where references may lie: anywhere, or in a box of a task's coordinates away from singularities.

use crate::controller::ConfigError;
use crate::fault::Limit;
use crate::force::task::TaskMap;

/// Which references the robot may be asked to follow.
pub trait Workspace<const N: usize> {
    /// Whether it refuses no reference at all.
    const IS_EVERYWHERE: bool = false;

    /// Room of the geometry.
    type State;

    /// The state before the first step. The one place that may allocate.
    fn at_rest(&self) -> Self::State;

    /// How far positions `q` of the drives are outside, and outside what; none inside.
    fn outside(&self, state: &mut Self::State, q: &[f64; N]) -> Option<(Limit, f64)>;
}

/// Every reference may be followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Anywhere;

impl<const N: usize> Workspace<N> for Anywhere {
    type State = ();

    const IS_EVERYWHERE: bool = true;

    fn at_rest(&self) -> Self::State {}

    fn outside(&self, (): &mut (), _: &[f64; N]) -> Option<(Limit, f64)> {
        None
    }
}

/// A box in the coordinates of a task, away from singularities.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskBox<const M: usize, K> {
    map: K,
    lower: [f64; M],
    upper: [f64; M],
    margin: f64,
}

impl<const M: usize, K> TaskBox<M, K> {
    /// Coordinates of `map` within `lower` and `upper` `[m | rad]`, where the task's margin is at least `margin`.
    ///
    /// # Errors
    /// Ranges that are empty, a margin that is negative, anything that is not finite.
    pub fn try_new(map: K, lower: [f64; M], upper: [f64; M], margin: f64) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        for k in 0..M {
            if let Some((what, value)) = [("lower", lower[k]), ("upper", upper[k])].into_iter().find(|(_, x)| !x.is_finite()) {
                return bad(k, what, value, "must be finite");
            }
            if upper[k] <= lower[k] {
                return bad(k, "upper - lower", upper[k] - lower[k], "must be > 0");
            }
        }
        ConfigError::unless_non_negative("margin", &[margin])?;
        Ok(Self { map, lower, upper, margin })
    }
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>> Workspace<N> for TaskBox<M, K> {
    type State = K::State;

    fn at_rest(&self) -> Self::State {
        self.map.at_rest()
    }

    fn outside(&self, state: &mut Self::State, q: &[f64; N]) -> Option<(Limit, f64)> {
        let Some(task) = self.map.at(state, q) else { return Some((Limit::Workspace, f64::INFINITY)) };
        let beyond = |k: usize| (task.x[k] - self.upper[k]).max(self.lower[k] - task.x[k]);
        let most = (0..M).map(beyond).fold(f64::NEG_INFINITY, f64::max);
        if most > 0.0 {
            return Some((Limit::Workspace, most));
        }
        (task.margin < self.margin).then_some((Limit::Singularity, self.margin - task.margin))
    }
}
