//! Velocity from an incremental encoder: pulses per period, or the time between pulses.

use pkm_dyn::math;

/// How velocity is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VelocitySensing {
    /// The true velocity: a tachometer without faults.
    Exact,
    /// Not at all.
    None,
    /// Ticks passed in a period, over the period: its noise is that of rounding, whatever the speed.
    PulseCounting,
    /// Whole ticks passed between two edges, over the time between them \[Ohmae1982\]: fine at speed, late at creep.
    PulseTiming {
        /// Width of a tick of the timer that stamps edges `[s]`; 0 is exact.
        timer: f64,
    },
}

/// The velocity sensor of one axis.
#[derive(Debug, Clone)]
pub struct VelocitySensor {
    sensing: VelocitySensing,
    /// Width of a tick of the encoder `[m | rad]`.
    tick: f64,
    /// Tick below the position followed last.
    cell: Option<f64>,
    /// Edge of the last sample that had one: its position in ticks and when it came.
    reference: Option<(f64, f64)>,
    /// Newest edge.
    edge: Option<(f64, f64)>,
    shown: f64,
    /// Reading of the last sample.
    reading: Option<f64>,
}

impl VelocitySensor {
    /// A sensor on an encoder of tick width `tick` `[m | rad]`; without a width the velocity is exact.
    #[must_use]
    pub fn new(sensing: VelocitySensing, tick: f64) -> Self {
        let sensing = if tick > 0.0 || sensing == VelocitySensing::None { sensing } else { VelocitySensing::Exact };
        Self { sensing, tick, cell: None, reference: None, edge: None, shown: 0.0, reading: None }
    }

    /// Whether it measures anything.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.sensing != VelocitySensing::None
    }

    /// Follows a motion from (`from` at time `t`) to (`to`, `h` later), taken as even: between its ends edges pass.
    pub fn follow(&mut self, [from, to]: [f64; 2], t: f64, h: f64) {
        let VelocitySensing::PulseTiming { timer } = self.sensing else { return };
        let (begin, end) = (from / self.tick, to / self.tick);
        let before = self.cell.unwrap_or_else(|| begin.floor());
        let after = end.floor();
        self.cell = Some(after);
        if (after - before).abs() < 0.5 {
            return;
        }
        // Upwards the last edge passed is the lower end of the present cell, downwards its upper end.
        let edge = if after > before { after } else { after + 1.0 };
        let span = end - begin;
        let share = if span.abs() > 0.0 { ((edge - begin) / span).clamp(0.0, 1.0) } else { 1.0 };
        let exact = t + share * h;
        let stamp = if timer > 0.0 { (exact / timer).floor() * timer } else { exact };
        self.edge = Some((edge, stamp));
    }

    /// The velocity of the sample at time `t` `[m/s | rad/s]`, `period` after the last one: `v` is the true velocity, `reading` the
    /// encoder's position.
    pub fn sample(&mut self, t: f64, period: f64, v: f64, reading: f64) -> f64 {
        match self.sensing {
            VelocitySensing::Exact => v,
            VelocitySensing::None => 0.0,
            VelocitySensing::PulseCounting => {
                let before = self.reading.replace(reading).unwrap_or(reading);
                // Both are whole numbers of ticks: the difference is made whole again.
                math::round((reading - before) / self.tick) * self.tick / period
            }
            VelocitySensing::PulseTiming { .. } => self.timed(t),
        }
    }

    fn timed(&mut self, t: f64) -> f64 {
        match (self.reference, self.edge) {
            (Some((p0, t0)), Some((p1, t1))) if t1 > t0 => {
                self.shown = (p1 - p0) * self.tick / (t1 - t0);
                self.reference = self.edge;
            }
            // No edge since: it cannot be faster than one tick in the time that passed.
            (Some((_, t0)), _) if t > t0 => {
                let most = self.tick / (t - t0);
                self.shown = self.shown.clamp(-most, most);
            }
            _ => self.reference = self.edge,
        }
        self.shown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: f64 = 1e-4;
    const T: f64 = 1e-3;

    /// Velocities sampled every millisecond along an even motion at `v` from `q0`.
    fn even(sensing: VelocitySensing, v: f64, q0: f64, n: u32) -> Vec<f64> {
        let mut sensor = VelocitySensor::new(sensing, TICK);
        let mut out = Vec::new();
        for k in 0..n {
            let (t, h) = (T * f64::from(k), 0.5 * T);
            let q = |t: f64| q0 + v * t;
            sensor.follow([q(t), q(t + h)], t, h);
            sensor.follow([q(t + h), q(t + T)], t + h, h);
            let reading = math::round(q(t + T) / TICK) * TICK;
            out.push(sensor.sample(t + T, T, v, reading));
        }
        out
    }

    #[test]
    fn counting_at_an_even_speed_shows_the_two_neighbouring_whole_counts_with_the_right_mean_and_variance() {
        // 2.37 ticks a period: 2 or 3 counted, 3 in a share of 0.37 of the periods.
        let v = 2.37 * TICK / T;
        let shown = even(VelocitySensing::PulseCounting, v, 0.0, 10_001);
        let counts: Vec<f64> = shown[1..].iter().map(|v| v * T / TICK).collect();
        assert!(counts.iter().all(|c| (c - 2.0).abs() < 1e-9 || (c - 3.0).abs() < 1e-9));
        let n = counts.len() as f64;
        let mean = counts.iter().sum::<f64>() / n;
        let variance = counts.iter().map(|c| (c - mean) * (c - mean)).sum::<f64>() / n;
        assert!((mean - 2.37).abs() < 1.0 / n + 1e-12 && (variance - 0.37 * 0.63).abs() < 1e-3, "{mean} {variance}");
    }

    #[test]
    fn timing_at_an_even_speed_is_exact_and_with_a_timer_off_by_its_tick() {
        for v in [2.37 * TICK / T, -2.37 * TICK / T, 0.3 * TICK / T] {
            for (timer, bound) in [(0.0, 1e-9), (1e-6, 1.01e-6 / T)] {
                let shown = even(VelocitySensing::PulseTiming { timer }, v, 0.000_03, 200);
                // After two edges; an edge comes at least every second period times the share.
                for shown in &shown[8..] {
                    // Between edges `t1 − t0 ≥ 1 tick of travel` and ≥ 1 period less one edge.
                    let relative = (shown / v - 1.0).abs();
                    assert!(relative < bound * 4.0, "{v}: {shown}");
                }
            }
        }
    }

    #[test]
    fn timing_after_a_stop_falls_as_one_tick_over_the_time_since_the_last_edge() {
        let mut sensor = VelocitySensor::new(VelocitySensing::PulseTiming { timer: 0.0 }, TICK);
        // 1.05 ticks in the first two periods, edges at 0.5 and 1.5 of them; then it stands.
        let v = TICK / T;
        sensor.follow([0.5 * TICK, 1.5 * TICK], 0.0, T);
        assert!(sensor.sample(T, T, v, 0.0).abs() < 1e-12);
        sensor.follow([1.5 * TICK, 2.5 * TICK], T, T);
        assert!((sensor.sample(2.0 * T, T, v, 0.0) - v).abs() < 1e-9 * v);
        for k in 2..50 {
            sensor.follow([2.5 * TICK, 2.5 * TICK], T * f64::from(k), T);
            let shown = sensor.sample(T * f64::from(k + 1), T, 0.0, 0.0);
            let want = TICK / (T * (f64::from(k + 1) - 1.5));
            assert!((shown - want).abs() < 1e-9 * want, "{k}: {shown}, not {want}");
        }
    }

    #[test]
    fn a_tremble_about_one_edge_has_no_velocity() {
        let mut sensor = VelocitySensor::new(VelocitySensing::PulseTiming { timer: 0.0 }, TICK);
        for k in 0..100 {
            let x = if k % 2 == 0 { [0.9 * TICK, 1.1 * TICK] } else { [1.1 * TICK, 0.9 * TICK] };
            sensor.follow(x, T * f64::from(k), T);
            assert!(sensor.sample(T * f64::from(k + 1), T, 0.0, 0.0).abs() < 1e-9);
        }
    }
}
