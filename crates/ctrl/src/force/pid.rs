//! PID of a force error, channel by channel, with limits on the output and its rate and an integral that does not wind up.

use crate::controller::ConfigError;
use crate::filter::low_pass_share;

/// Numbers of a [`ForcePid`]; the output's unit is `[u]`, for instance `[m/s]` or `[N]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForcePidConfig<const M: usize> {
    /// Proportional gain `[u/N]`.
    pub kp: [f64; M],
    /// Integral gain `[u/(N·s)]`.
    pub ki: [f64; M],
    /// Derivative gain `[u·s/N]`.
    pub kd: [f64; M],
    /// Largest output `[u]`.
    pub output_limit: [f64; M],
    /// Largest change of the output per second `[u/s]`.
    pub rate_limit: [f64; M],
    /// Time constant of the derivative's filter `[s]`; 0 is the plain difference.
    pub filter_s: f64,
    /// Control period `[s]`.
    pub dt: f64,
}

/// PID of a force error \[Valera2017, eq. 15\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForcePid<const M: usize> {
    config: ForcePidConfig<M>,
}

/// What a [`ForcePid`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForcePidState<const M: usize> {
    integral: [f64; M],
    error_last: [f64; M],
    slope: [f64; M],
    output: [f64; M],
    has_started: bool,
}

impl<const M: usize> Default for ForcePidState<M> {
    fn default() -> Self {
        let zero = [0.0; M];
        Self { integral: zero, error_last: zero, slope: zero, output: zero, has_started: false }
    }
}

impl<const M: usize> ForcePidState<M> {
    /// Starts anew with an output of `output` `[u]`: the integral is what it takes, so that nothing jumps.
    #[must_use]
    pub fn at_output(output: [f64; M]) -> Self {
        Self { integral: output, output, ..Self::default() }
    }

    /// Forgets channel `k`: its next output starts at zero.
    pub fn rest(&mut self, k: usize) {
        (self.integral[k], self.error_last[k], self.slope[k], self.output[k]) = (0.0, 0.0, 0.0, 0.0);
    }

    /// The last output `[u]`.
    #[must_use]
    pub fn output(&self) -> &[f64; M] {
        &self.output
    }
}

/// A period that is a number and not absurd: `dt`, but at most five periods, and the period where it is none.
pub(crate) fn usable_dt(dt: f64, period: f64) -> f64 {
    if dt > 0.0 { dt.min(5.0 * period) } else { period }
}

impl<const M: usize> ForcePid<M> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Gains that are negative, limits or a period that are not positive, anything that is not finite; limits of the
    /// rate may be infinite.
    pub fn try_new(config: ForcePidConfig<M>) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        for k in 0..M {
            for (what, value) in [("kp", config.kp[k]), ("ki", config.ki[k]), ("kd", config.kd[k])] {
                if !(value.is_finite() && value >= 0.0) {
                    return bad(k, what, value, "must be finite and >= 0");
                }
            }
            let (output, rate) = (config.output_limit[k], config.rate_limit[k]);
            if !(output.is_finite() && output > 0.0) {
                return bad(k, "output_limit", output, "must be finite and > 0");
            }
            if rate.is_nan() || rate <= 0.0 {
                return bad(k, "rate_limit", rate, "must be > 0");
            }
        }
        if !(config.dt.is_finite() && config.dt > 0.0) {
            return bad(0, "dt", config.dt, "must be finite and > 0");
        }
        if !(config.filter_s.is_finite() && config.filter_s >= 0.0) {
            return bad(0, "filter_s", config.filter_s, "must be finite and >= 0");
        }
        Ok(Self { config })
    }

    /// The numbers.
    #[must_use]
    pub fn config(&self) -> &ForcePidConfig<M> {
        &self.config
    }

    /// Advances by `dt` `[s]` with the force error `error` `[N | N·m]` and returns the output `[u]`, and whether a limit acted.
    ///
    /// Where a limit holds the output back, the integral grows no further in that direction.
    pub fn step(&self, state: &mut ForcePidState<M>, error: &[f64; M], dt: f64) -> ([f64; M], bool) {
        let (c, dt) = (&self.config, usable_dt(dt, self.config.dt));
        let share = low_pass_share(c.filter_s, dt);
        let mut is_limited = false;
        for (k, &error) in error.iter().enumerate() {
            let difference = if state.has_started { (error - state.error_last[k]) / dt } else { 0.0 };
            let slope = state.slope[k] + share * (difference - state.slope[k]);
            // A jump beyond all bounds has no slope; remembered, it would be one for ever.
            if slope.is_finite() {
                state.slope[k] = slope;
            }
            let grown = state.integral[k] + c.ki[k] * error * dt;
            let direct = c.kp[k] * error + c.kd[k] * state.slope[k];
            let last = state.output[k];
            // Errors beyond all bounds overflow: the output then stays where it is.
            let within = |raw: f64| {
                let raw = if raw.is_nan() { last } else { raw.clamp(-c.output_limit[k], c.output_limit[k]) };
                raw.clamp(last - c.rate_limit[k] * dt, last + c.rate_limit[k] * dt)
            };
            let raw = direct + grown;
            let excess = raw - within(raw);
            is_limited |= excess.abs() > 0.0;
            if excess * error <= 0.0 && !grown.is_nan() {
                state.integral[k] = grown.clamp(-c.output_limit[k], c.output_limit[k]);
            }
            state.output[k] = within(direct + state.integral[k]);
        }
        state.error_last = *error;
        state.has_started = true;
        (state.output, is_limited)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALM: ForcePidConfig<1> =
        ForcePidConfig { kp: [0.5], ki: [2.0], kd: [0.0], output_limit: [1.0], rate_limit: [f64::INFINITY], filter_s: 0.0, dt: 0.01 };

    #[test]
    fn the_three_terms_are_what_the_equation_says() {
        let pid = ForcePid::try_new(ForcePidConfig { kd: [0.03], output_limit: [1e9], ..CALM }).unwrap();
        let mut state = ForcePidState::default();
        // Error 3·t: proportional 1.5·t, integral of the sampled ramp, derivative 0.09.
        for k in 0..100 {
            let t = 0.01 * f64::from(k);
            let (output, _) = pid.step(&mut state, &[3.0 * t], 0.01);
            let integral = 2.0 * 3.0 * 0.01 * 0.01 * f64::from(k) * f64::from(k + 1) / 2.0;
            let derivative = if k == 0 { 0.0 } else { 0.09 };
            assert!((output[0] - (1.5 * t + integral + derivative)).abs() < 1e-12, "{k}");
        }
    }

    #[test]
    fn output_and_rate_stay_inside_and_the_integral_does_not_wind_up() {
        let pid = ForcePid::try_new(ForcePidConfig { rate_limit: [5.0], ..CALM }).unwrap();
        let mut state = ForcePidState::default();
        let mut last = 0.0;
        for _ in 0..1000 {
            let (output, _) = pid.step(&mut state, &[10.0], 0.01);
            assert!(output[0] <= 1.0 && output[0] - last <= 0.05 + 1e-15);
            last = output[0];
        }
        assert!((last - 1.0).abs() < 1e-15);
        // Ten seconds of full error are forgotten as soon as the error changes sign: the output leaves the limit at once.
        let (output, _) = pid.step(&mut state, &[-0.1], 0.01);
        assert!(output[0] < 1.0, "{output:?}");
        for _ in 0..60 {
            let _ = pid.step(&mut state, &[-1.0], 0.01);
        }
        assert!(state.output()[0] < -0.5, "{state:?}");
    }

    #[test]
    fn a_start_at_an_output_does_not_jump_and_absurd_periods_are_bounded() {
        let pid = ForcePid::try_new(CALM).unwrap();
        let mut state = ForcePidState::at_output([0.4]);
        assert!((pid.step(&mut state, &[0.0], 0.01).0[0] - 0.4).abs() < 1e-15);
        let mut long = ForcePidState::default();
        for dt in [f64::NAN, -1.0, 0.0] {
            let _ = pid.step(&mut long, &[0.1], dt);
        }
        assert!((long.integral[0] - 3.0 * 2.0 * 0.1 * 0.01).abs() < 1e-15);
        let _ = pid.step(&mut long, &[0.1], f64::INFINITY);
        assert!((long.integral[0] - 8.0 * 2.0 * 0.1 * 0.01).abs() < 1e-15);
    }

    #[test]
    fn one_absurd_sample_does_not_make_it_deaf() {
        let pid = ForcePid::try_new(ForcePidConfig { kd: [0.03], filter_s: 0.02, ..CALM }).unwrap();
        let mut state = ForcePidState::default();
        for error in [0.1, 1e308, -1e308, 0.1, 0.1] {
            assert!(pid.step(&mut state, &[error], 0.01).0[0].abs() <= 1.0);
        }
        for _ in 0..3000 {
            let _ = pid.step(&mut state, &[-0.2], 0.01);
        }
        assert!(state.slope[0].is_finite() && (state.output()[0] + 1.0).abs() < 0.01, "{state:?}");
        for _ in 0..3000 {
            let _ = pid.step(&mut state, &[0.2], 0.01);
        }
        assert!((state.output()[0] - 1.0).abs() < 0.01, "{state:?}");
    }

    #[test]
    fn the_filter_of_the_slope_takes_a_long_period_as_many_short_ones() {
        let pid =
            ForcePid::try_new(ForcePidConfig { kp: [0.0], ki: [0.0], kd: [1.0], output_limit: [1e9], filter_s: 0.02, ..CALM }).unwrap();
        let (mut once, mut often) = (ForcePidState::default(), ForcePidState::default());
        let _ = (pid.step(&mut once, &[0.0], 0.01), pid.step(&mut often, &[0.0], 0.01));
        let _ = pid.step(&mut once, &[4.0], 0.04);
        for k in 1..=4 {
            let _ = pid.step(&mut often, &[f64::from(k)], 0.01);
        }
        assert!((once.output()[0] - often.output()[0]).abs() < 1e-12, "{once:?} {often:?}");
    }

    #[test]
    fn unusable_numbers_are_refused() {
        for bad in [
            ForcePidConfig { kp: [-1.0], ..CALM },
            ForcePidConfig { ki: [f64::NAN], ..CALM },
            ForcePidConfig { output_limit: [0.0], ..CALM },
            ForcePidConfig { output_limit: [f64::INFINITY], ..CALM },
            ForcePidConfig { rate_limit: [f64::NAN], ..CALM },
            ForcePidConfig { dt: 0.0, ..CALM },
            ForcePidConfig { filter_s: -1.0, ..CALM },
        ] {
            assert!(ForcePid::try_new(bad).is_err(), "{bad:?}");
        }
    }
}
