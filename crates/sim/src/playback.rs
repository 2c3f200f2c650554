//! A motion given by samples, joined by a natural cubic spline: positions, velocities and accelerations are continuous.

use crate::error::SimError;
use crate::reference::Sample;
use crate::trajectory::Trajectory;

/// A motion through given positions; before the first and after the last sample it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Playback {
    time: Vec<f64>,
    /// Positions of each drive.
    q: Vec<Vec<f64>>,
    /// Second derivatives of each drive's spline at the samples; zero at both ends.
    bend: Vec<Vec<f64>>,
}

impl Playback {
    /// The motion through positions `q` `[m | rad]` (one column per drive) at times `time` `[s]`, shifted to begin at time 0.
    ///
    /// # Errors
    /// Fewer than two samples, columns of another length than `time`, times that do not increase, numbers that are not finite.
    pub fn try_new(time: &[f64], q: Vec<Vec<f64>>) -> Result<Self, SimError> {
        let n = time.len();
        let bad = |what, value, limit| Err(SimError::Scenario { what, value, limit });
        if n < 2 {
            return bad("samples of the reference", n as f64, "must be at least 2");
        }
        for pair in time.windows(2) {
            if !(pair[1] - pair[0] > 0.0 && pair[1].is_finite()) {
                return bad("time of the reference", pair[1], "must be finite and increase");
            }
        }
        for column in &q {
            if column.len() != n {
                return bad("samples of the reference", column.len() as f64, "must be as many as times");
            }
            if let Some(&x) = column.iter().find(|x| !x.is_finite()) {
                return bad("position of the reference", x, "must be finite");
            }
        }
        let time: Vec<f64> = time.iter().map(|t| t - time[0]).collect();
        let bend = q.iter().map(|column| bends(&time, column)).collect();
        Ok(Self { time, q, bend })
    }

    /// Time of the last sample, the first being 0 `[s]`.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.time[self.time.len() - 1]
    }
}

impl Trajectory for Playback {
    fn at(&self, t: f64, out: &mut Sample) {
        let n = self.q.len();
        for x in [&mut out.q, &mut out.v, &mut out.a] {
            x.clear();
            x.resize(n, 0.0);
        }
        let is_outside = t < 0.0 || t > self.duration_s();
        let t = t.clamp(0.0, self.duration_s());
        let i = self.time.partition_point(|&x| x <= t).clamp(1, self.time.len() - 1) - 1;
        let h = self.time[i + 1] - self.time[i];
        let (x, y) = ((self.time[i + 1] - t) / h, (t - self.time[i]) / h);
        for k in 0..n {
            let (q0, q1) = (self.q[k][i], self.q[k][i + 1]);
            let (b0, b1) = (self.bend[k][i], self.bend[k][i + 1]);
            out.q[k] = x * q0 + y * q1 + h * h / 6.0 * ((x * x * x - x) * b0 + (y * y * y - y) * b1);
            if !is_outside {
                out.v[k] = (q1 - q0) / h + h / 6.0 * ((3.0 * y * y - 1.0) * b1 - (3.0 * x * x - 1.0) * b0);
                out.a[k] = x * b0 + y * b1;
            }
        }
    }
}

/// Second derivatives of the natural spline: a tridiagonal system, by elimination.
fn bends(time: &[f64], q: &[f64]) -> Vec<f64> {
    let n = time.len();
    let (mut bend, mut upper) = (vec![0.0; n], vec![0.0; n]);
    for i in 1..n - 1 {
        let (before, after) = (time[i] - time[i - 1], time[i + 1] - time[i]);
        let right = 6.0 * ((q[i + 1] - q[i]) / after - (q[i] - q[i - 1]) / before);
        let pivot = 2.0 * (before + after) - before * upper[i - 1];
        upper[i] = after / pivot;
        bend[i] = (right - before * bend[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        bend[i] -= upper[i] * bend[i + 1];
    }
    bend
}
