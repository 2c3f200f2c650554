//! Dry friction as a set: at rest it takes any value between two levels, in motion one of them.
//!
//! The end-of-step velocity and the friction efforts are solved for together by projected Gauss-Seidel, so a joint that sticks stands
//! exactly still and no `sign(v)` chatters [Moreau1988; Stewart1996].

use nalgebra::{DMatrix, DVector};

/// Sweeps after which a step is accepted as it is: only redundant sticking (more rubbing joints than degrees of freedom) gets there,
/// and there the motion has long converged while the split of the efforts has not.
const MAX_SWEEPS: usize = 200;

/// Share of the largest level by which an effort may still change when the sweeps stop.
const SETTLED: f64 = 1e-12;

/// One joint that resists: its velocity is `row · v_act`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contact {
    /// Row of the reduction: d(joint velocity)/d(velocity of each drive).
    pub(crate) row: DVector<f64>,
    /// Effort in backward motion `[N | N·m]`.
    pub(crate) low: f64,
    /// Effort in forward motion `[N | N·m]`; never below `low`.
    pub(crate) high: f64,
    /// Effort found; kept from step to step as the next start.
    pub(crate) effort: f64,
    /// Velocity at which it takes any effort between the levels `[m/s | rad/s]`: zero, or what an impact sends back.
    pub(crate) rest: f64,
    /// Change of the drives' velocities per unit of its effort in the step.
    gain: DVector<f64>,
}

impl Contact {
    pub(crate) fn new(n_act: usize) -> Self {
        Self { row: DVector::zeros(n_act), low: 0.0, high: 0.0, effort: 0.0, rest: 0.0, gain: DVector::zeros(n_act) }
    }
}

/// Whether velocities and levels are numbers that can be solved with; a stop's highest effort may be infinite.
pub(crate) fn is_solvable(contacts: &[Contact], v: &DVector<f64>) -> bool {
    v.iter().all(|v| v.is_finite()) && contacts.iter().all(|c| !c.low.is_nan() && !c.high.is_nan() && c.low < f64::INFINITY)
}

/// Velocity after a step of `h` `[s]`, from the velocity `v` it would have without contacts and the inverse mass matrix.
///
/// On return `v` and the contacts' efforts satisfy `effort = high` where the joint moves forward, `low` where it moves backward, and
/// lie in between where it stands.
pub(crate) fn solve(contacts: &mut [Contact], inverse_mass: &DMatrix<f64>, h: f64, v: &mut DVector<f64>) {
    let mut scale = 0.0_f64;
    for c in contacts.iter_mut() {
        c.gain.gemv(1.0, inverse_mass, &c.row, 0.0);
        c.gain *= h;
        c.effort = c.effort.max(c.low).min(c.high);
        v.axpy(-c.effort, &c.gain, 1.0);
        // A stop has no highest effort.
        scale = [c.low, c.high].into_iter().filter(|x| x.is_finite()).fold(scale, |top, x| top.max(x.abs()));
    }
    for _ in 0..MAX_SWEEPS {
        let (mut change, mut largest) = (0.0_f64, scale);
        for c in contacts.iter_mut() {
            let response = c.row.dot(&c.gain);
            let is_free = c.low == 0.0 && c.high == 0.0;
            if response <= 0.0 || is_free {
                continue;
            }
            let wanted = (c.effort + (c.row.dot(v) - c.rest) / response).max(c.low).min(c.high);
            let difference = wanted - c.effort;
            v.axpy(-difference, &c.gain, 1.0);
            c.effort = wanted;
            change = change.max(difference.abs());
            largest = largest.max(wanted.abs());
        }
        if change <= SETTLED * largest {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(level: f64) -> Contact {
        Contact { row: DVector::from_element(1, 1.0), low: -level, high: level, ..Contact::new(1) }
    }

    #[test]
    fn a_push_below_the_level_is_taken_up_exactly_and_one_above_is_reduced_by_it() {
        let inverse_mass = DMatrix::from_element(1, 1, 0.5);
        for (push, want) in [(3.0, 0.0), (-4.9, 0.0), (7.0, 0.5 * 1e-3 * 2.0), (-7.0, -0.5 * 1e-3 * 2.0)] {
            let mut v = DVector::from_element(1, 0.5 * 1e-3 * push);
            let mut contacts = [block(5.0)];
            solve(&mut contacts, &inverse_mass, 1e-3, &mut v);
            assert!((v[0] - want).abs() < 1e-18, "push {push}: {}", v[0]);
            assert!((contacts[0].effort - f64::clamp(push, -5.0, 5.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn levels_that_are_no_numbers_are_noticed_and_no_panic() {
        let inverse_mass = DMatrix::from_element(1, 1, 0.5);
        for (level, speed) in [(f64::NAN, 1.0), (5.0, f64::NAN), (5.0, f64::INFINITY), (f64::NEG_INFINITY, 1.0)] {
            let mut v = DVector::from_element(1, speed);
            let mut contacts = [block(level)];
            assert!(!is_solvable(&contacts, &v), "{level} {speed}");
            solve(&mut contacts, &inverse_mass, 1e-3, &mut v);
        }
        let stop = Contact { high: f64::INFINITY, low: 0.0, ..block(0.0) };
        assert!(is_solvable(&[stop, block(5.0)], &DVector::from_element(1, 1.0)));
    }

    #[test]
    fn coupled_joints_one_stuck_one_sliding_are_solved_together() {
        let inverse_mass = DMatrix::from_row_slice(2, 2, &[1.0, -0.6, -0.6, 1.0]);
        let mut contacts = [block(1.0), block(1.0)].map(|c| Contact { low: c.low, high: c.high, ..Contact::new(2) });
        contacts[0].row = DVector::from_vec(vec![1.0, 0.0]);
        contacts[1].row = DVector::from_vec(vec![0.0, 1.0]);
        let mut v = &inverse_mass * DVector::from_vec(vec![3.0, 0.8]);
        solve(&mut contacts, &inverse_mass, 1.0, &mut v);
        // By hand: joint 0 slides forward with effort 1; joint 1 would move by −0.6·2 + 0.8 − f, so it sticks with f = −0.4.
        assert!((contacts[0].effort - 1.0).abs() < 1e-11 && (contacts[1].effort + 0.4).abs() < 1e-10);
        assert!((v[0] - (2.0 - 0.6 * 1.2)).abs() < 1e-10 && v[1].abs() < 1e-11);
    }
}
