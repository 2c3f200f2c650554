//! From what a robot did to what a recording says of it: noise, steps of encoders, colour, and what goes wrong in a day's work.

use core::fmt::Write as _;

use crate::machine::Trace;
use crate::random::Stream;
use crate::robot::{Motion, Robot};

/// Noise of one robot's sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Step of the position sensors `[m | rad]`, per drive.
    pub quantum: Vec<f64>,
    /// White noise of efforts, standard deviation `[N]`, per drive.
    pub effort: Vec<f64>,
    /// Coloured noise of efforts (a first-order filter of 1 Hz), standard deviation `[N]`, per drive.
    pub coloured: Vec<f64>,
    /// Whether velocities are recorded.
    pub has_rate: bool,
}

/// A recording, as it will be written.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Time `[s]`.
    pub t: Vec<f64>,
    /// Positions, per sample and drive.
    pub q: Vec<Vec<f64>>,
    /// Velocities; empty when they are not recorded.
    pub v: Vec<Vec<f64>>,
    /// Efforts.
    pub tau: Vec<Vec<f64>>,
    /// References: positions, velocities, accelerations.
    pub wanted: Vec<[Vec<f64>; 3]>,
}

impl Noise {
    /// Typical sensors for a robot whose efforts vary by `spread` `[N]`: encoders of 2 µm or 20 µrad, `share` of the spread as noise.
    #[must_use]
    pub fn typical(robot: &Robot, spread: &[f64], share: f64, has_rate: bool) -> Self {
        let quantum = |k: usize| if robot.joints[robot.drives[k].joint].motion == Motion::Slide { 2e-6 } else { 2e-5 };
        Self {
            quantum: (0..robot.drives.len()).map(quantum).collect(),
            effort: spread.iter().map(|s| share * s).collect(),
            coloured: vec![0.0; spread.len()],
            has_rate,
        }
    }

    /// The same sensors with `factor` times the noise, steps of encoders included.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        let more = |x: &[f64]| x.iter().map(|v| v * factor).collect();
        Self { quantum: more(&self.quantum), effort: more(&self.effort), coloured: more(&self.coloured), has_rate: self.has_rate }
    }

    /// Records a trace.
    #[must_use]
    pub fn record(&self, trace: &Trace, random: &mut Stream) -> Recording {
        let mut colour = vec![0.0; self.quantum.len()];
        let dt = trace.t.get(1).map_or(1e-3, |t| t - trace.t[0]);
        let keep = crate::math::exp(-core::f64::consts::TAU * dt);
        let mut out = self.silent(trace);
        for i in 0..trace.t.len() {
            for (k, &quantum) in self.quantum.iter().enumerate() {
                // A third of a step of jitter, then the step itself.
                let read = trace.reading[i][k] + 0.33 * quantum * random.normal();
                out.q[i][k] = (read / quantum).round() * quantum;
                colour[k] = keep * colour[k] + (1.0 - keep * keep).sqrt() * random.normal();
                out.tau[i][k] += self.effort[k] * random.normal() + self.coloured[k] * colour[k];
                if self.has_rate {
                    out.v[i][k] += quantum * 20.0 * random.normal();
                }
            }
        }
        out
    }

    /// The same recording without noise and steps.
    #[must_use]
    pub fn silent(&self, trace: &Trace) -> Recording {
        let v = if self.has_rate { trace.rate.clone() } else { Vec::new() };
        Recording { t: trace.t.clone(), q: trace.reading.clone(), v, tau: trace.effort.clone(), wanted: trace.wanted.clone() }
    }
}

/// What goes wrong in a recording of a hard but healthy day.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mishap {
    /// Efforts of a few rows are wild.
    Garbage,
    /// Stretches of samples are missing.
    Dropouts,
    /// Rows are missing altogether.
    Gaps,
}

impl Recording {
    /// Spoils the recording.
    pub fn spoil(&mut self, mishap: Mishap, random: &mut Stream) {
        let n = self.t.len();
        match mishap {
            Mishap::Garbage => {
                for _ in 0..4 {
                    let (i, k) = (random.index(n), random.index(self.tau[0].len()));
                    let scale = self.tau.iter().map(|r| r[k].abs()).fold(0.0, f64::max);
                    self.tau[i][k] = random.sign() * scale * random.uniform(5.0, 20.0);
                }
            }
            Mishap::Dropouts => {
                for _ in 0..3 {
                    let (from, k) = (random.index(n.saturating_sub(12)), random.index(self.tau[0].len()));
                    (from..(from + 3 + random.index(8)).min(n)).for_each(|i| self.tau[i][k] = f64::NAN);
                }
            }
            Mishap::Gaps => {
                let from = n / 4 + random.index(n / 2);
                let count = 3 + random.index(6);
                let gone = |i: usize| (from..from + count).contains(&i);
                let mut i = 0;
                self.t.retain(|_| {
                    i += 1;
                    !gone(i - 1)
                });
                for rows in [&mut self.q, &mut self.v, &mut self.tau] {
                    let mut i = 0;
                    rows.retain(|_| {
                        i += 1;
                        !gone(i - 1)
                    });
                }
                let mut i = 0;
                self.wanted.retain(|_| {
                    i += 1;
                    !gone(i - 1)
                });
            }
        }
    }

    /// The recording as CSV; `metadata` are lines without the leading `# `.
    #[must_use]
    pub fn csv(&self, robot: &Robot, metadata: &[String]) -> String {
        let mut out = String::new();
        for line in metadata {
            let _ = writeln!(out, "# {line}");
        }
        let names: Vec<&str> = (0..robot.drives.len()).map(|k| robot.drive_name(k)).collect();
        let mut head = vec!["t".to_string()];
        let mut columns = vec!["q", "tau"];
        if !self.v.is_empty() {
            columns.insert(1, "dq");
        }
        columns.extend(["q_ref", "dq_ref", "ddq_ref"]);
        columns.iter().for_each(|c| head.extend(names.iter().map(|n| format!("{c}.{n}"))));
        let _ = writeln!(out, "{}", head.join(","));
        for i in 0..self.t.len() {
            let _ = write!(out, "{:.4}", self.t[i]);
            let mut put = |row: &[f64], digits: usize| {
                for x in row {
                    // An empty field is a missing sample.
                    let _ = if x.is_finite() { write!(out, ",{x:.digits$}") } else { write!(out, ",") };
                }
            };
            put(&self.q[i], 7);
            if !self.v.is_empty() {
                put(&self.v[i], 7);
            }
            put(&self.tau[i], 5);
            self.wanted[i].iter().for_each(|w| put(w, 7));
            out.push('\n');
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(n: usize) -> Trace {
        Trace {
            t: (0..n).map(|i| i as f64 * 4e-3).collect(),
            reading: vec![vec![0.1]; n],
            rate: vec![vec![0.0]; n],
            effort: vec![vec![5.0]; n],
            truth: vec![vec![0.1]; n],
            wanted: vec![[vec![0.1], vec![0.0], vec![0.0]]; n],
        }
    }

    #[test]
    fn noise_has_the_size_it_is_said_to_have() {
        let noise = Noise { quantum: vec![1e-5], effort: vec![2.0], coloured: vec![3.0], has_rate: true };
        let r = noise.record(&trace(40_000), &mut Stream::new(1, 1, "noise"));
        let variance = r.tau.iter().map(|x| (x[0] - 5.0) * (x[0] - 5.0)).sum::<f64>() / 40_000.0;
        assert!((variance.sqrt() / 13.0_f64.sqrt() - 1.0).abs() < 0.1, "{variance}");
        assert!(r.q.iter().all(|x| ((x[0] / 1e-5) - (x[0] / 1e-5).round()).abs() < 1e-6));
    }

    #[test]
    fn mishaps_leave_equal_columns_and_rising_times() {
        let noise = Noise { quantum: vec![1e-5], effort: vec![0.1], coloured: vec![0.0], has_rate: false };
        let robot = Robot::shipped("motobotte").unwrap();
        for mishap in [Mishap::Garbage, Mishap::Dropouts, Mishap::Gaps] {
            let mut random = Stream::new(3, 1, "mishap");
            let mut r = noise.record(&trace(500), &mut random);
            r.spoil(mishap, &mut random);
            assert!(
                r.t.windows(2).all(|w| w[1] > w[0]) && r.t.len() == r.q.len() && r.t.len() == r.tau.len() && r.t.len() == r.wanted.len()
            );
            let csv = r.csv(&robot, &["tau = measured".to_string()]);
            assert_eq!(csv.lines().count(), 2 + r.t.len());
            assert_eq!(csv.lines().nth(1), Some("t,q.d,tau.d,q_ref.d,dq_ref.d,ddq_ref.d"));
        }
    }
}
