//! Admittance: a measured force moves the reference as it would move a mass on a spring and a damper, and a position loop follows.
//!
//! `M·x'' + D·x' + K·x = f` in every coordinate of the task, f the environment's force beyond the wanted one, x the deviation from the
//! reference; exact for a force that is constant between two samples.

use crate::controller::{Command, ConfigError, Controller, Input};
use crate::force::explicit::{check_limits, stopped};
use crate::force::pid::usable_dt;
use crate::force::task::TaskMap;

/// Numbers of an [`Admittance`]; one entry per coordinate of the task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdmittanceConfig<const M: usize> {
    /// Mass that the environment feels `[kg | kg·m²]`.
    pub mass: [f64; M],
    /// Damping `[N·s/m | N·m·s/rad]`.
    pub damping: [f64; M],
    /// Stiffness towards the reference `[N/m | N·m/rad]`; 0 lets go.
    pub stiffness: [f64; M],
    /// Largest deviation `[m | rad]`; the mass stops there.
    pub travel: [f64; M],
    /// Largest speed of the deviation `[m/s | rad/s]`.
    pub speed: [f64; M],
    /// Control period `[s]`.
    pub dt: f64,
}

/// One sample of the mass: `[x, v]` and the force that acts from now on to `[x, v]`.
type Step = [[f64; 3]; 2];

/// Admittance around a position controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Admittance<const N: usize, const M: usize, K, C> {
    map: K,
    inner: C,
    config: AdmittanceConfig<M>,
    steps: [Step; M],
}

/// What an [`Admittance`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct AdmittanceState<const N: usize, const M: usize, S, I> {
    map: S,
    inner: I,
    /// Deviation from the reference `[m | rad]`.
    pub x: [f64; M],
    /// Its rate `[m/s | rad/s]`.
    pub v: [f64; M],
    q_offset: [f64; N],
    tau_safe: [f64; N],
    is_faulted: bool,
}

/// Upper two rows of `exp(A·dt)` for `A = [[0, 1, 0], [-k/m, -d/m, 1/m], [0, 0, 0]]`: a Taylor series of a small share, squared back.
fn exact([mass, damping, stiffness]: [f64; 3], dt: f64) -> Step {
    let product = |a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]| -> [[f64; 3]; 3] {
        core::array::from_fn(|i| core::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    };
    let mut A = [[0.0, dt, 0.0], [-stiffness / mass * dt, -damping / mass * dt, dt / mass], [0.0; 3]];
    let mut halvings = 0_u32;
    while A.iter().flatten().map(|a| a.abs()).fold(0.0, f64::max) > 0.1 && halvings < 1000 {
        A.iter_mut().flatten().for_each(|a| *a *= 0.5);
        halvings += 1;
    }
    let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut E = one;
    for k in (1..=16).rev() {
        E = product(&A, &E);
        for i in 0..3 {
            for j in 0..3 {
                E[i][j] = one[i][j] + E[i][j] / f64::from(k);
            }
        }
    }
    for _ in 0..halvings {
        E = product(&E, &E);
    }
    [E[0], E[1]]
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Admittance<N, M, K, C> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Masses, limits or a period that are not positive, damping or stiffness that is negative, anything that is not finite.
    pub fn try_new(map: K, inner: C, config: AdmittanceConfig<M>) -> Result<Self, ConfigError> {
        for (what, values) in [("mass", &config.mass), ("travel", &config.travel), ("speed", &config.speed)] {
            check_limits(what, values)?;
        }
        check_limits("dt", &[config.dt])?;
        for (what, values) in [("damping", &config.damping), ("stiffness", &config.stiffness)] {
            if let Some(drive) = values.iter().position(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(ConfigError { drive, what, value: values[drive], limit: "must be finite and >= 0" });
            }
        }
        let steps = core::array::from_fn(|k| exact([config.mass[k], config.damping[k], config.stiffness[k]], config.dt));
        if let Some(k) = steps.iter().position(|s: &Step| s.iter().flatten().any(|x| !x.is_finite())) {
            return Err(ConfigError { drive: k, what: "mass", value: config.mass[k], limit: "must not be lost in damping and stiffness" });
        }
        Ok(Self { map, inner, config, steps })
    }

    /// One period of the masses under `force`.
    fn move_on(&self, x: &mut [f64; M], v: &mut [f64; M], force: &[f64; M]) {
        let c = &self.config;
        for k in 0..M {
            let ([xx, xv, xf], [vx, vv, vf]) = (self.steps[k][0], self.steps[k][1]);
            let to = xx * x[k] + xv * v[k] + xf * force[k];
            let speed = (vx * x[k] + vv * v[k] + vf * force[k]).clamp(-c.speed[k], c.speed[k]);
            x[k] = to.clamp(x[k] - c.speed[k] * c.dt, x[k] + c.speed[k] * c.dt).clamp(-c.travel[k], c.travel[k]);
            // At its stop the mass has lost its speed, but may come back.
            v[k] = if x[k].abs() >= c.travel[k] && speed * x[k] > 0.0 { 0.0 } else { speed };
        }
    }
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Controller<N> for Admittance<N, M, K, C> {
    type State = AdmittanceState<N, M, K::State, C::State>;

    fn at_rest(&self) -> Self::State {
        AdmittanceState {
            map: self.map.at_rest(),
            inner: self.inner.at_rest(),
            x: [0.0; M],
            v: [0.0; M],
            q_offset: [0.0; N],
            tau_safe: [0.0; N],
            is_faulted: false,
        }
    }

    /// One period; after an overrun the masses move on by as many periods as went by, at most five.
    ///
    /// On a fault the command is the last finite feed-forward effort, or the inner controller's own safe command. Where the task cannot be
    /// known the deviation stays as it is.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let wrenches = input.wrench_meas.iter().chain(&input.wrench_ref);
        let drives = [&input.q_meas, &input.tau_meas, &input.q_ref, &input.v_ref, &input.tau_ff].into_iter().flatten();
        state.is_faulted |= wrenches.chain(drives).any(|x| !x.is_finite());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        let mut moved = Input { ..*input };
        if let Some(task) = self.map.at(&mut state.map, &input.q_meas) {
            let [measured, wanted] = self.map.forces(input, &task);
            // Forces beyond all bounds cancel to no number: the masses then feel none.
            let force = core::array::from_fn(|k| Some(measured[k] - wanted[k]).filter(|f| f.is_finite()).unwrap_or(0.0));
            let periods = usable_dt(input.dt, self.config.dt) / self.config.dt;
            let mut done = 0.5;
            loop {
                self.move_on(&mut state.x, &mut state.v, &force);
                done += 1.0;
                if done > periods || done > 5.0 {
                    break;
                }
            }
            let (offset, rate) = (task.to_drives(&state.x), task.to_drives(&state.v));
            state.q_offset = offset;
            moved.v_ref.iter_mut().zip(rate).for_each(|(v, rate)| *v += rate);
        }
        for k in 0..N {
            moved.q_ref[k] += state.q_offset[k];
        }
        let mut command = self.inner.step(&mut state.inner, &moved);
        state.is_faulted |= command.health.is_faulted || command.tau.iter().any(|t| !t.is_finite());
        state.tau_safe = if state.is_faulted { command.tau.map(|t| if t.is_finite() { t } else { 0.0 }) } else { input.tau_ff };
        if state.is_faulted {
            command.tau = state.tau_safe;
            command.health.is_faulted = true;
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn one_sample_is_the_closed_form_for_every_kind_of_damping() {
        let (m, k, dt) = (2.0, 200.0, 0.03);
        let w = math::sqrt(k / m);
        // Underdamped, from rest at x = 1: x = e^(−σt)·(cos ωt + σ/ω·sin ωt).
        let sigma = 3.0;
        let wd = math::sqrt(w * w - sigma * sigma);
        let decay = math::exp(-sigma * dt);
        let (s, c) = math::sin_cos(wd * dt);
        let step = exact([m, 2.0 * m * sigma, k], dt);
        assert!((step[0][0] - decay * (c + sigma / wd * s)).abs() < 1e-13);
        assert!((step[0][1] - decay * s / wd).abs() < 1e-13);
        assert!((step[0][2] - (1.0 - decay * (c + sigma / wd * s)) / k).abs() < 1e-14);
        // Critically damped: x = e^(−ωt)·(1 + ωt); overdamped: two exponentials; no spring: v = e^(−dt/m).
        let step = exact([m, 2.0 * m * w, k], dt);
        assert!((step[0][0] - math::exp(-w * dt) * (1.0 + w * dt)).abs() < 1e-13);
        let (p, r) = (5.0, w * w / 5.0);
        let step = exact([m, m * (p + r), k], dt);
        let want = (r * math::exp(-p * dt) - p * math::exp(-r * dt)) / (r - p);
        assert!((step[0][0] - want).abs() < 1e-13);
        let step = exact([m, 5.0, 0.0], dt);
        assert!((step[1][1] - math::exp(-2.5 * dt)).abs() < 1e-13 && (step[1][2] - (1.0 - math::exp(-2.5 * dt)) / 5.0).abs() < 1e-14);
        let step = exact([m, 0.0, 0.0], dt);
        assert!((step[0][2] - dt * dt / (2.0 * m)).abs() < 1e-16);
        // Light and heavily damped: the force's share settles, nothing overflows.
        let step = exact([1e-3, 500.0, 100.0], 0.01);
        assert!(step[1][1].abs() < 1e-6 && (step[0][0] - 0.998).abs() < 1e-4, "{step:?}");
    }
}
