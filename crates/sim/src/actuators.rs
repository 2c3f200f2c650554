//! From the effort a controller asks for to the effort that acts: scale, transport delay, lag, saturation.
//!
//! [`ActuatorChain`] is what the effects of a robot make of a command. What a drive does beyond that has one file each: [`OutputStage`] (steps
//! of a converter, dead zone), [`FirstOrderLag`] (a current loop) and [`ThreeMass`] (belt, screw and force cell are springs).

mod first_order;
mod output_stage;
mod three_mass;

pub use first_order::FirstOrderLag;
pub use output_stage::OutputStage;
pub use three_mass::{ThreeMass, ThreeMassParameters};

use pkm_dyn::effects::{Law, Robot};
use pkm_dyn::math;

use crate::error::SimError;

/// The longest transport delay that is simulated `[s]`: beyond it no loop of this kind is stable.
const MAX_DELAY: f64 = 1.0;

/// Chain of one drive. Commands are held over a control period; the acting effort is exact in the mean over any part of one.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorChain {
    scale: f64,
    delay: f64,
    /// Time constant and output of each first-order lag.
    lags: Vec<(f64, f64)>,
    limit: f64,
    /// Half of the width within which commands do not act.
    dead_zone: f64,
    period: f64,
    /// Scaled commands, newest first.
    commands: Vec<f64>,
    /// How late the recorder sees the effort `[s]`: a delay effect with a negative number.
    recording_delay: f64,
    /// Share of the command that the recorder sees.
    recorded_share: f64,
}

impl ActuatorChain {
    /// The chain that the effects of `robot` make of joint `j`, for a control period `[s]`.
    ///
    /// # Errors
    /// A delay of more than one second in total.
    pub fn try_new(robot: &Robot, j: usize, period: f64) -> Result<Self, SimError> {
        let delays: Vec<f64> = robot.chain(j, |law| matches!(law, Law::EffortDelay)).collect();
        let total: f64 = delays.iter().sum();
        if total.is_nan() || total.abs() > MAX_DELAY {
            return Err(SimError::Scenario { what: "delay", value: total, limit: "must be finite and within 1 s" });
        }
        let delay = total.max(0.0);
        let limit = robot.model.joints[j].limits.effort;
        Ok(Self {
            scale: robot.chain(j, |law| matches!(law, Law::EffortScale)).product(),
            delay,
            lags: robot.chain(j, |law| matches!(law, Law::EffortLag)).filter(|tau| *tau > 0.0).map(|tau| (tau, 0.0)).collect(),
            limit: robot
                .chain(j, |law| matches!(law, Law::EffortLimit))
                .fold(if limit > 0.0 { limit } else { f64::INFINITY }, |least, limit| least.min(limit.max(0.0))),
            dead_zone: robot.chain(j, |law| matches!(law, Law::EffortDeadZone)).map(|width| 0.5 * width.max(0.0)).sum(),
            period,
            commands: vec![0.0; periods(delay / period)],
            recording_delay: (-total).max(0.0),
            recorded_share: robot.chain(j, |law| matches!(law, Law::CommandShare)).map(|missing| 1.0 - missing).product(),
        })
    }

    /// The chain of a perfect drive, for a control period `[s]`: what is commanded acts.
    #[must_use]
    pub fn ideal(period: f64) -> Self {
        Self {
            scale: 1.0,
            delay: 0.0,
            lags: Vec::new(),
            limit: f64::INFINITY,
            dead_zone: 0.0,
            period,
            commands: vec![0.0; periods(0.0)],
            recording_delay: 0.0,
            recorded_share: 1.0,
        }
    }

    /// The same chain with a further transport delay and a current loop of this time constant behind it, both `[s]`; 0 is none.
    ///
    /// # Errors
    /// A time that is negative or none, or a delay of more than one second in total.
    pub fn followed_by(mut self, delay: f64, lag: f64) -> Result<Self, SimError> {
        for (what, value) in [("delay of a drive", delay), ("lag of a current loop", lag)] {
            if !(0.0..=MAX_DELAY).contains(&value) {
                return Err(SimError::Scenario { what, value, limit: "must be 0 to 1 s" });
            }
        }
        self.delay += delay;
        if self.delay > MAX_DELAY {
            return Err(SimError::Scenario { what: "delay", value: self.delay, limit: "must be finite and within 1 s" });
        }
        if lag > 0.0 {
            self.lags.push((lag, 0.0));
        }
        self.commands = vec![0.0; periods(self.delay / self.period)];
        Ok(self)
    }

    /// How late the recorder sees the effort `[s]`.
    #[must_use]
    pub fn recording_delay(&self) -> f64 {
        self.recording_delay
    }

    /// Share of the command that the recorder sees: less than all where the recorded command is not the controller's.
    #[must_use]
    pub fn recorded_share(&self) -> f64 {
        self.recorded_share
    }

    /// What acts of a command before delay and lags: its scale, less the dead zone.
    fn acting(&self, command: f64) -> f64 {
        let beyond = (command.abs() - self.dead_zone).max(0.0);
        self.scale * if command < 0.0 { -beyond } else { beyond }
    }

    /// Brings the chain to rest at a command that has been held for ever `[N | N·m]`.
    pub fn settle(&mut self, command: f64) {
        let acting = self.acting(command);
        self.commands.fill(acting);
        for lag in &mut self.lags {
            lag.1 = acting;
        }
    }

    /// Takes the command of the period that begins now `[N | N·m]`.
    pub fn push(&mut self, command: f64) {
        self.commands.rotate_right(1);
        self.commands[0] = self.acting(command);
    }

    /// Mean acting effort from `offset` after the period's begin over `h`, both `[s]`; parts must follow one another without gap.
    pub fn mean_over(&mut self, offset: f64, h: f64) -> f64 {
        let mut effort = self.delayed(offset - self.delay, h);
        for (tau, y) in &mut self.lags {
            // Exact for an input constant over the part: y runs to the input exponentially.
            let decay = math::exp(-h / *tau);
            let gap = *y - effort;
            *y = effort + gap * decay;
            effort += gap * (*tau / h) * (1.0 - decay);
        }
        effort.clamp(-self.limit, self.limit)
    }

    /// Mean of the held commands from `from` (relative to the period's begin) over `h` ≤ one period.
    fn delayed(&self, from: f64, h: f64) -> f64 {
        let index = (from / self.period).floor();
        let share = (((index + 1.0) * self.period - from) / h).clamp(0.0, 1.0);
        share * self.command(index) + (1.0 - share) * self.command(index + 1.0)
    }

    /// Scaled command of a period counted from the present one (0), the past being negative.
    fn command(&self, period: f64) -> f64 {
        let age = whole((-period).max(0.0)).min(self.commands.len() - 1);
        self.commands[age]
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_DELAY over a control period, never negative")]
fn whole(x: f64) -> usize {
    x as usize
}

/// Room for the present command and all that a delay of `delay` periods reaches back to.
fn periods(delay: f64) -> usize {
    whole(delay.ceil()) + 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(delay: f64, lags: &[f64]) -> ActuatorChain {
        let lags = lags.iter().map(|&tau| (tau, 0.0)).collect();
        let commands = vec![0.0; periods(delay / 1e-3)];
        ActuatorChain {
            scale: 1.0,
            delay,
            lags,
            limit: 1e9,
            dead_zone: 0.0,
            period: 1e-3,
            commands,
            recording_delay: 0.0,
            recorded_share: 1.0,
        }
    }

    #[test]
    fn a_delay_of_two_and_a_half_periods_shifts_a_step_by_that_much() {
        let mut chain = chain(2.5e-3, &[]);
        let mut out = Vec::new();
        for _ in 0..4 {
            chain.push(1.0);
            out.extend([chain.mean_over(0.0, 0.5e-3), chain.mean_over(0.5e-3, 0.5e-3)]);
        }
        for (k, y) in out.iter().enumerate() {
            let want = if k < 5 { 0.0 } else { 1.0 };
            assert!((y - want).abs() < 1e-9, "part {k}: {y}");
        }
    }

    #[test]
    fn no_delay_passes_the_present_command() {
        let mut chain = chain(0.0, &[]);
        for u in [1.0, -3.0, 2.0] {
            chain.push(u);
            assert!((chain.mean_over(0.0, 0.5e-3) - u).abs() < 1e-12 && (chain.mean_over(0.5e-3, 0.5e-3) - u).abs() < 1e-12);
        }
    }

    #[test]
    fn a_dead_zone_swallows_half_its_width_of_either_sign() {
        let mut chain = ActuatorChain { dead_zone: 0.5, scale: 2.0, limit: 3.0, ..chain(0.0, &[]) };
        for (command, acts) in [(0.4, 0.0), (-0.5, 0.0), (1.5, 2.0), (-1.5, -2.0), (4.0, 3.0)] {
            chain.push(command);
            assert!((chain.mean_over(0.0, 1e-3) - acts).abs() < 1e-15, "{command}");
        }
    }

    #[test]
    fn a_lag_follows_its_exponential_in_the_mean() {
        let mut chain = chain(0.0, &[5e-3]);
        let mut sum = 0.0;
        for _ in 0..10 {
            chain.push(1.0);
            sum += chain.mean_over(0.0, 0.5e-3) + chain.mean_over(0.5e-3, 0.5e-3);
        }
        let (t, tau) = (10e-3, 5e-3);
        let want = t - tau * (1.0 - math::exp(-t / tau));
        assert!((sum * 0.5e-3 - want).abs() < 1e-15, "{sum}");
    }
}
