//! What lies between recorded efforts and those that act, and what of the efforts of surplus drives a row is made of.

use nalgebra::DMatrix;
use pkm_dyn::effects::{Law, Robot};

use crate::filter::{advanced, derivative, lagged};
use crate::motion::Motion;

/// What the drive's electronics make of an effort: scale, lag and delay of the robot file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Electronics {
    scale: f64,
    lag: f64,
    delay: f64,
}

impl Electronics {
    pub(crate) fn of(robot: &Robot, j: usize) -> Self {
        Self {
            scale: robot.chain(j, |law| matches!(law, Law::EffortScale)).product(),
            lag: robot.chain(j, |law| matches!(law, Law::EffortLag)).sum(),
            delay: robot.chain(j, |law| matches!(law, Law::EffortDelay)).sum(),
        }
    }

    /// Nothing between what is recorded and what acts.
    pub(crate) fn none() -> Self {
        Self { scale: 1.0, lag: 0.0, delay: 0.0 }
    }

    /// The effort that acts while `x` is recorded.
    pub(crate) fn acting(&self, x: &[f64], dt: f64) -> Vec<f64> {
        let mut out = if self.delay.abs() > 0.0 { advanced(x, -self.delay, dt) } else { x.to_vec() };
        if self.lag > 0.0 {
            out = lagged(&out, self.lag, dt);
        }
        out.iter_mut().for_each(|x| *x *= self.scale);
        out
    }

    /// What acts is what is recorded.
    pub(crate) fn is_plain(&self) -> bool {
        (self.scale - 1.0).abs() <= 0.0 && self.lag <= 0.0 && self.delay.abs() <= 0.0
    }

    /// The effort as it would be recorded while `x` acts, where that is another.
    pub(crate) fn recorded(&self, x: &[f64], dt: f64) -> Option<Vec<f64>> {
        if self.is_plain() {
            return None;
        }
        let mut x = x.to_vec();
        if self.lag > 0.0 {
            let rate = derivative(&x, dt);
            x.iter_mut().zip(rate).for_each(|(x, r)| *x += self.lag * r);
        }
        if self.delay.abs() > 0.0 {
            x = advanced(&x, self.delay, dt);
        }
        x.iter_mut().for_each(|x| *x /= self.scale);
        Some(x)
    }
}

/// Efforts that act at surplus drives, [drive][sample]: the robot moves by what acts at all of them, so that their electronics cannot be put
/// on the columns drive by drive.
pub(crate) fn acting(robot: &Robot, motion: &Motion) -> Vec<Vec<f64>> {
    let of = |(&j, tau): (&usize, &Vec<f64>)| Electronics::of(robot, j).acting(tau, motion.dt);
    robot.model.actuators.iter().zip(&motion.tau).map(of).collect()
}

/// Takes out of efforts of the drives that move the robot what drives that stand have a part in: there the friction may be anything.
/// `moves` has what moves the robot of each drive's unit effort, as columns, and is used up.
pub(crate) fn without(moves: &mut DMatrix<f64>, stands: &mut dyn Iterator<Item = usize>) {
    for k in stands {
        let own = moves.column(k).into_owned();
        if own[k] > NOTHING {
            moves.ger(-1.0 / own[k], &own, &own, 1.0);
        }
        moves.row_mut(k).fill(0.0);
        moves.column_mut(k).fill(0.0);
    }
}

/// What is left of a unit effort of a drive, squared, below which nothing is.
const NOTHING: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn what_acts_is_what_would_be_recorded_the_other_way_round() {
        let dt = 1e-3;
        let x: Vec<f64> = (0..4000).map(|i| math::sin(3.0 * dt * f64::from(i)) + 0.3 * math::cos(11.0 * dt * f64::from(i))).collect();
        let drive = Electronics { scale: 0.8, lag: 0.02, delay: 0.004 };
        let recorded = drive.recorded(&x, dt).expect("it is not plain");
        let back = drive.acting(&recorded, dt);
        // The lag starts settled, which the motion is not, and its start dies away within some time constants.
        for i in 400..3900 {
            assert!((back[i] - x[i]).abs() < 1e-3, "sample {i}: {} instead of {}", back[i], x[i]);
        }
    }

    #[test]
    fn what_a_standing_drive_has_a_part_in_is_taken_out_and_nothing_else() {
        // Two freedoms of three drives: what moves is all but the direction (1, 1, 1).
        let moves = DMatrix::from_fn(3, 3, |i, j| f64::from(u8::from(i == j)) - 1.0 / 3.0);
        let mut left = moves.clone();
        without(&mut left, &mut core::iter::once(1));
        // Of (x, y, −x − y) with y = 0 there is (1, 0, −1)/√2.
        let want = DMatrix::from_row_slice(3, 3, &[0.5, 0.0, -0.5, 0.0, 0.0, 0.0, -0.5, 0.0, 0.5]);
        assert!((&left - want).amax() < 1e-12, "{left}");
        assert!((&left * &moves - &left).amax() < 1e-12);
        let mut none = moves;
        without(&mut none, &mut [0, 2].into_iter());
        assert!(none.amax() < 1e-9, "two of three stand: nothing is left, {none}");
    }
}
