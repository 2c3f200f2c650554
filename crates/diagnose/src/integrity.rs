//! Recordings looked at before any model is: time stamps, spikes, jumps, stuck and clipped channels, steps of counters.
//!
//! A lost sample is taken out and said; a fault that runs through the rest of a channel, such as lost counts, makes a recording unusable.

use pkm_dyn::effects::Robot;
use pkm_ident::Recording;
use pkm_ident::degrees::other_positions;
use pkm_ident::grid::GAP_PERIODS;
use pkm_ident::seconds::other_time;

use crate::idle;

/// A step of a channel this many times larger than 95 % of its steps is no motion.
const NO_MOTION: f64 = 20.0;

/// Spikes in more than this share of the samples are a channel that cannot be trusted.
const MANY_SPIKES: f64 = 0.01;

/// A channel that stops dead for so long `[s]`, out of full motion, is stuck.
pub(crate) const STUCK_S: f64 = 0.3;

/// Share of the usual step size before and after a standstill from which on it came out of full motion.
const FULL_MOTION: f64 = 0.3;

/// Share of the samples at its extreme value from which on a channel is called clipped.
const CLIPPED: f64 = 0.01;

/// Deviation of stamps from a steady rate, as a share of the period, from which on it is said.
const JITTER: f64 = 0.05;

/// Largest step of a counter that is not worth a word, as a share of the channel's rms.
const COARSE: f64 = 0.01;

/// What was seen in a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Integrity {
    /// Why it cannot be used; empty when it can.
    pub(crate) reasons: Vec<String>,
    /// What is worth knowing.
    pub(crate) notes: Vec<String>,
    /// Samples to be taken out: column and indices.
    pub(crate) spoiled: Vec<(String, Vec<usize>)>,
}

impl Integrity {
    /// Whether any sample is to be taken out.
    pub(crate) fn is_spoiled(&self) -> bool {
        !self.spoiled.is_empty()
    }

    /// The recording without the samples that are spoiled.
    pub(crate) fn cleaned(&self, r: &Recording) -> Recording {
        let mut out = r.clone();
        for (column, at) in &self.spoiled {
            if let Some(signal) = out.signals.get_mut(column) {
                at.iter().for_each(|&i| signal[i] = f64::NAN);
            }
        }
        out
    }
}

/// Looks at the time stamps and at every driven joint's position and effort.
pub(crate) fn integrity(robot: &Robot, r: &Recording) -> Integrity {
    let mut out = Integrity::default();
    if let Some(i) = (1..r.time.len()).find(|&i| r.time[i] <= r.time[i - 1] || !r.time[i].is_finite()) {
        let (t, before) = (r.time[i], r.time[i - 1]);
        out.reasons.push(format!("{}: time does not increase at sample {i} (t = {t} s after {before} s)", r.name));
        return out;
    }
    if r.time.len() < 8 {
        return out;
    }
    jitter(r, &mut out);
    out.reasons.extend(other_time(robot, r).iter().map(ToString::to_string));
    out.reasons.extend(other_positions(&robot.model, r).iter().map(ToString::to_string));
    for &j in &robot.model.actuators {
        let joint = &robot.model.joints[j];
        let unit = [joint.kind.unit_position(), joint.kind.unit_effort()];
        for (prefix, unit) in ["q", "tau"].into_iter().zip(unit) {
            let column = format!("{prefix}.{}", joint.name);
            let Some(x) = r.signal(&column) else { continue };
            let channel = Channel { recording: r, column: &column, unit, x };
            channel.spikes(&mut out);
            if prefix == "q" {
                channel.stuck(&mut out);
                channel.jumps(&mut out);
            } else {
                channel.clipped(&mut out);
            }
            channel.counts(&mut out);
        }
        never_moves(r, &joint.name, joint.kind.unit_position(), &mut out);
    }
    idle::drives_off(robot, r, &mut out);
    out
}

fn jitter(r: &Recording, out: &mut Integrity) {
    let mut steps: Vec<f64> = r.time.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let period = steps[steps.len() / 2];
    let regular = steps.iter().filter(|s| **s < GAP_PERIODS * period);
    let (n, sum) = regular.fold((0_usize, 0.0), |(n, sum), s| (n + 1, sum + (s - period) * (s - period)));
    let share = pkm_dyn::math::sqrt(sum / n.max(1) as f64) / period;
    if share > JITTER {
        out.notes.push(format!("{}: time stamps jitter by {:.0} % of the period (rms); signals are interpolated", r.name, 100.0 * share));
    }
}

/// A position that never changes while its reference does.
fn never_moves(r: &Recording, joint: &str, unit: &str, out: &mut Integrity) {
    let (Some(q), Some(q_ref)) = (r.signal(&format!("q.{joint}")), r.signal(&format!("q_ref.{joint}"))) else { return };
    let ((low, high), (low_ref, high_ref)) = (range(q), range(q_ref));
    if high - low <= 0.0 && high_ref - low_ref > 0.0 {
        let travel = high_ref - low_ref;
        out.reasons
            .push(format!("{}: q.{joint} never changes while q_ref.{joint} travels {travel:.3} {unit}: the sensor is stuck", r.name));
    }
}

pub(crate) fn range(x: &[f64]) -> (f64, f64) {
    x.iter().filter(|x| x.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)))
}

/// Value that a share of the absolute values stays below; 0 of nothing.
fn quantile(x: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sizes: Vec<f64> = x.filter(|x| x.is_finite()).map(f64::abs).collect();
    sizes.sort_by(f64::total_cmp);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let at = (share * sizes.len() as f64) as usize;
    sizes.get(at.min(sizes.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// One channel of a recording.
struct Channel<'c> {
    recording: &'c Recording,
    column: &'c str,
    unit: &'c str,
    x: &'c [f64],
}

impl Channel<'_> {
    fn steps(&self) -> impl Iterator<Item = f64> + '_ {
        self.x.windows(2).map(|w| w[1] - w[0])
    }

    /// Single samples far from both of their neighbours, on the same side.
    fn spikes(&self, out: &mut Integrity) {
        let away = |w: &[f64]| {
            let (before, after) = (w[1] - w[0], w[1] - w[2]);
            if before * after > 0.0 { before.abs().min(after.abs()) } else { 0.0 }
        };
        let usual = quantile(self.steps(), 0.95);
        let at: Vec<usize> =
            self.x.windows(3).enumerate().filter(|(_, w)| away(w) > NO_MOTION * usual && usual > 0.0).map(|(i, _)| i + 1).collect();
        let Some(&first) = at.first() else { return };
        let (name, column, unit) = (&self.recording.name, self.column, self.unit);
        let (n, all, t, x) = (at.len(), self.x.len(), self.recording.time[first], self.x[first]);
        if n as f64 > MANY_SPIKES * all as f64 {
            out.reasons.push(format!("{name}: {column} has {n} spikes in {all} samples, the first at t = {t} s ({x:.4} {unit})"));
        } else {
            out.notes.push(format!("{name}: {column} has {n} spikes (the first at t = {t} s, {x:.4} {unit}); they are left out"));
            out.spoiled.push((column.to_string(), at));
        }
    }

    /// A step that stays: counts were lost. Where a stuck channel catches up, none were.
    fn jumps(&self, out: &mut Integrity) {
        let usual = quantile(self.steps(), 0.95);
        let x = self.x;
        let was_stuck: Vec<usize> = out.spoiled.iter().filter(|(c, _)| c == self.column).flat_map(|(_, at)| at.clone()).collect();
        let stays = |i: &usize| {
            let step = x[i + 1] - x[*i];
            let before = i.checked_sub(1).map_or(0.0, |b| x[*i] - x[b]);
            let after = x.get(i + 2).map_or(0.0, |next| next - x[i + 1]);
            step.abs() > NO_MOTION * usual && before.abs() < 0.2 * step.abs() && after.abs() < 0.2 * step.abs()
        };
        if let Some(i) = (0..x.len() - 1).find(|i| usual > 0.0 && stays(i) && !was_stuck.contains(i)) {
            let (t, step) = (self.recording.time[i + 1], x[i + 1] - x[i]);
            out.reasons.push(format!(
                "{}: {} jumps by {step:.4} {} at t = {t} s, where 95 % of its steps are below {usual:.2e}",
                self.recording.name, self.column, self.unit
            ));
        }
    }

    /// Whether the position's reference stands as well, to within `usual` steps: a joint that stands where it is told to is not stuck.
    fn is_told_to_stand(&self, (from, to): (usize, usize), usual: f64) -> bool {
        let reference = self.column.strip_prefix("q.").and_then(|joint| self.recording.signal(&format!("q_ref.{joint}")));
        reference.is_some_and(|x| {
            let (low, high) = range(&x[from..to]);
            high - low <= usual
        })
    }

    /// Runs of one and the same value that begin or end in full motion.
    fn stuck(&self, out: &mut Integrity) {
        const LOOK: usize = 5;
        let (x, time) = (self.x, &self.recording.time);
        let usual = quantile(self.steps(), 0.95);
        let mut at: Vec<usize> = Vec::new();
        let mut longest: (f64, f64) = (0.0, 0.0);
        let mut begin = 0;
        for i in 1..=x.len() {
            if i < x.len() && (x[i] - x[begin]).abs() <= 0.0 {
                continue;
            }
            let lasts = time[i - 1] - time[begin];
            let speed = |from: usize, to: usize| if to > from { (x[to] - x[from]).abs() / (to - from) as f64 } else { 0.0 };
            let before = speed(begin.saturating_sub(LOOK), begin);
            // The step out of the standstill makes good what was missed: motion is what comes after it.
            let after = if i + LOOK < x.len() { speed(i, i + LOOK) } else { 0.0 };
            if lasts > STUCK_S && before.max(after) > FULL_MOTION * usual && usual > 0.0 && !self.is_told_to_stand((begin, i), usual) {
                at.extend(begin..i);
                longest = if lasts > longest.0 { (lasts, time[begin]) } else { longest };
            }
            begin = i;
        }
        if !at.is_empty() {
            let share = 100.0 * at.len() as f64 / x.len() as f64;
            let (lasts, t) = longest;
            out.notes.push(format!(
                "{}: {} stands dead still out of full motion for up to {lasts:.2} s (from t = {t:.3} s), {share:.1} % of the samples; they are left out",
                self.recording.name, self.column
            ));
            out.spoiled.push((self.column.to_string(), at));
        }
    }

    /// A plateau at an extreme value.
    fn clipped(&self, out: &mut Integrity) {
        let (low, high) = range(self.x);
        if high <= low {
            return;
        }
        for extreme in [low, high] {
            let is_there = |x: &f64| (x - extreme).abs() <= 1e-12 * extreme.abs();
            let n = self.x.iter().filter(|x| is_there(x)).count();
            let in_rows = self.x.windows(3).filter(|w| w.iter().all(is_there)).count();
            let share = n as f64 / self.x.len() as f64;
            if share > CLIPPED && 2 * in_rows > n {
                let (name, column, unit) = (&self.recording.name, self.column, self.unit);
                out.notes.push(format!(
                    "{name}: {column} stays at exactly {extreme:.4} {unit} for {:.1} % of the samples: it is clipped there",
                    100.0 * share
                ));
            }
        }
    }

    /// Steps of a counter or converter that are coarse against the signal.
    fn counts(&self, out: &mut Integrity) {
        let count = self.steps().filter(|s| s.abs() > 0.0).fold(f64::INFINITY, |least, s| least.min(s.abs()));
        let known = self.x.iter().filter(|x| x.is_finite());
        let (n, sum) = known.clone().fold((0_usize, 0.0), |(n, sum), x| (n + 1, sum + x));
        let mean = sum / n.max(1) as f64;
        let rms = pkm_dyn::math::sqrt(known.map(|x| (x - mean) * (x - mean)).sum::<f64>() / n.max(1) as f64);
        if !(count.is_finite() && count > COARSE * rms) {
            return;
        }
        let is_whole = |s: f64| (s / count - (s / count).round()).abs() < 0.01;
        let whole = self.steps().filter(|s| s.is_finite() && is_whole(*s)).count();
        if whole as f64 > 0.95 * (self.x.len() - 1) as f64 {
            let (name, column, unit) = (&self.recording.name, self.column, self.unit);
            out.notes.push(format!(
                "{name}: {column} comes in steps of {count:.3e} {unit}, {:.0} % of its rms about its mean",
                100.0 * count / rms
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use pkm_dyn::math;

    use super::*;

    /// Two seconds of a sine at 100 Hz, changed at will.
    fn seen(change: impl Fn(usize, f64) -> f64) -> Integrity {
        let time: Vec<f64> = (0..200).map(|i| 0.01 * i as f64).collect();
        let x: Vec<f64> = time.iter().enumerate().map(|(i, t)| change(i, math::sin(6.0 * t))).collect();
        let recording = Recording { name: "A".to_string(), time, ..Recording::default() };
        let mut out = Integrity::default();
        let channel = Channel { recording: &recording, column: "q.a", unit: "rad", x: &x };
        channel.spikes(&mut out);
        channel.stuck(&mut out);
        channel.jumps(&mut out);
        channel.clipped(&mut out);
        channel.counts(&mut out);
        out
    }

    #[test]
    fn a_smooth_channel_gives_no_reason_and_no_note() {
        assert_eq!(seen(|_, x| x), Integrity::default());
    }

    #[test]
    fn a_spike_is_left_out_and_lost_counts_are_a_reason() {
        let spike = seen(|i, x| if i == 50 { x + 3.0 } else { x });
        assert_eq!((spike.reasons.len(), spike.notes.len()), (0, 1), "{spike:?}");
        assert_eq!(spike.spoiled, vec![("q.a".to_string(), vec![50])]);
        let jump = seen(|i, x| if i >= 50 { x + 3.0 } else { x });
        assert!(jump.reasons.len() == 1 && jump.reasons[0].contains("t = 0.5 s"), "{jump:?}");
    }

    #[test]
    fn a_channel_that_freezes_in_full_motion_is_left_out_there() {
        // Frozen from 0.95 s (speed 5.0 rad/s of 6) for half a second.
        let frozen = seen(|i, x| if (95..145).contains(&i) { math::sin(6.0 * 0.95) } else { x });
        assert!(frozen.reasons.is_empty(), "{frozen:?}");
        assert!(frozen.spoiled.iter().any(|(_, at)| *at == (95..145).collect::<Vec<_>>()), "{frozen:?}");
        // The same length of standstill at the crest, where the speed is near zero anyway.
        let resting = seen(|i, _| math::sin((0.06 * i as f64).min(core::f64::consts::FRAC_PI_2)));
        assert!(resting.spoiled.is_empty(), "{resting:?}");
    }

    #[test]
    fn a_joint_that_stands_where_it_is_told_to_is_not_stuck() {
        // Out of full motion into a stop at 0.95 s, for half a second.
        let time: Vec<f64> = (0..200).map(|i| 0.01 * i as f64).collect();
        let x: Vec<f64> = (0..200).map(|i| math::sin(0.06 * f64::from(if (95..145).contains(&i) { 95 } else { i }))).collect();
        let mut recording = Recording { name: "A".to_string(), time, ..Recording::default() };
        let stuck = |recording: &Recording| {
            let mut out = Integrity::default();
            Channel { recording, column: "q.a", unit: "rad", x: &x }.stuck(&mut out);
            out.is_spoiled()
        };
        assert!(stuck(&recording));
        recording.signals.insert("q_ref.a".to_string(), x.clone());
        assert!(!stuck(&recording));
        recording.signals.insert("q_ref.a".to_string(), (0..200).map(|i| math::sin(0.06 * i as f64)).collect());
        assert!(stuck(&recording));
    }

    #[test]
    fn a_plateau_is_called_clipped_and_coarse_counts_are_said() {
        let clipped = seen(|_, x| x.clamp(-2.0, 0.7));
        assert!(clipped.notes.iter().any(|n| n.contains("0.7000")), "{clipped:?}");
        let coarse = seen(|_, x| 0.1 * (x / 0.1).round());
        assert!(coarse.notes.iter().any(|n| n.contains("steps of 1.000e-1")), "{coarse:?}");
    }

    #[test]
    fn time_that_runs_back_is_a_reason() {
        let mut builder = pkm_dyn::model::ModelBuilder::new("none", [0.0; 3]);
        builder.link("base", pkm_dyn::parameters::InertialParameters::default());
        let robot = Robot::new(builder.build().expect("a robot of one link"), Vec::new());
        let recording = Recording { name: "A".to_string(), time: vec![0.0, 0.1, 0.05], ..Recording::default() };
        assert!(integrity(&robot, &recording).reasons[0].contains("sample 2"));
    }
}
