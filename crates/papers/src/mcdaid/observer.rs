//! Identities of the decoupling observer, and how far they fail as printed.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use nalgebra::{DMatrix, DVector};
use pkm_ctrl::design::force_loop::DriveTrain;
use pkm_ctrl::design::margin::eigenvalues;
use pkm_ctrl::force::gains::{Decoupling, Forward, decoupling, room};
use pkm_ctrl::force::{Task, TaskMap};

use super::ankle::{jacobian, null_direction, pseudo_inverse};
use super::trial::legs;
use crate::error::PaperError;
use crate::row::{Gate, Row};

/// Orientation of the foot `[deg]`.
const AT: [f64; 3] = [10.0, 5.0, -4.0];

/// `K_f` and `K_v0` of the example.
const SHARE: f64 = 0.8;
const NULL_SHARE: f64 = 0.7;

/// What an identity may miss, in newtons out of tens.
const EXACT: f64 = 1e-10;

/// The legs at [`AT`] with an inertia that is not diagonal, and a load case: efforts of the motors, moments, friction, commanded forces.
struct Case {
    J: DMatrix<f64>,
    pinv: DMatrix<f64>,
    v0: DVector<f64>,
    M: DMatrix<f64>,
    inverse: DMatrix<f64>,
    m_a: f64,
    /// `I + m_a·J·M⁻¹·Jᵀ`, the inverse of D.
    left: DMatrix<f64>,
    D: DMatrix<f64>,
    effort: DVector<f64>,
    moments: DVector<f64>,
    drag: DVector<f64>,
    commanded: DVector<f64>,
}

fn regular(m: Option<DMatrix<f64>>) -> Result<DMatrix<f64>, PaperError> {
    m.ok_or(PaperError::Other { what: "identities of the observer", reason: "a singular matrix".to_string() })
}

impl Case {
    fn new() -> Result<Self, PaperError> {
        let angles = AT.map(f64::to_radians);
        let J = jacobian(angles);
        let M = DMatrix::from_diagonal(&DVector::from_row_slice(&[0.06, 0.03, 0.07])).add_scalar(0.002);
        let m_a = DriveTrain::ANKLE.apparent_mass();
        let inverse = regular(M.clone().try_inverse())?;
        let left = DMatrix::identity(4, 4) + &J * &inverse * J.transpose() * m_a;
        Ok(Self {
            pinv: pseudo_inverse(angles)?,
            v0: null_direction(angles)?,
            D: regular(left.clone().try_inverse())?,
            J,
            M,
            inverse,
            m_a,
            left,
            effort: DVector::from_row_slice(&[48.0, -31.0, 27.5, -44.0]),
            moments: DVector::from_row_slice(&[2.6, -1.7, 2.1]),
            drag: DVector::from_row_slice(&[8.0, -9.5, 4.0, 7.0]),
            commanded: DVector::from_row_slice(&[-42.0, 17.0, 33.0, -8.0]),
        })
    }

    /// `[G, H]` of the library's observer.
    fn observer(&self, power: f64, null_share: f64) -> Result<[DMatrix<f64>; 2], PaperError> {
        let what = "identities of the observer";
        let none = || PaperError::Other { what, reason: "no gain".to_string() };
        let task = legs(AT.map(f64::to_radians))?.at(&mut (), &[0.0; 4]).ok_or_else(none)?;
        let task: Task<4, 3> = task;
        let rows = core::array::from_fn(|i| core::array::from_fn(|j| self.inverse[(i, j)]));
        let numbers = Decoupling { share: SHARE, power, null_share, apparent_mass: self.m_a, forward: Forward::Moving };
        let found = decoupling(&mut room(4), &task, &rows, &numbers).ok_or_else(none)?;
        Ok(found.map(|X| DMatrix::from_fn(4, 4, |i, j| X[i][j])))
    }

    /// Forces of the equations of motion, solved directly: with `more` feedback and `push` from the motors.
    fn direct(&self, more: &DMatrix<f64>, push: &DVector<f64>) -> DVector<f64> {
        let moved = &self.J * &self.inverse * &self.moments * self.m_a;
        (&self.left + more).lu().solve(&(push + moved - &self.drag)).unwrap_or_else(|| DVector::from_element(4, f64::NAN))
    }

    /// (8.5) with the drag's sign as given, against the direct solution `[N]`.
    fn error_of_8_5(&self, sign: f64) -> f64 {
        let I = DMatrix::<f64>::identity(4, 4);
        let equation = &self.D * &self.effort + (I - &self.D) * self.pinv.transpose() * &self.moments - &self.D * &self.drag * sign;
        (self.direct(&DMatrix::zeros(4, 4), &self.effort) - equation).norm()
    }

    /// (8.9) with `1 + sign·K_f`, against the direct solution with the observer `[N]`.
    fn error_of_8_9(&self, sign: f64) -> Result<f64, PaperError> {
        let [G, H] = self.observer(1.0, 0.0)?;
        let I = DMatrix::<f64>::identity(4, 4);
        let moved = (I - &self.D) * self.pinv.transpose() * &self.moments;
        let equation = &self.commanded + moved * (1.0 + sign * SHARE) - &self.D * &self.drag * (1.0 - SHARE);
        Ok((self.direct(&H, &(&G * &self.commanded)) - equation).norm())
    }

    /// What the patient feels of the robot's mass under the feedback H.
    fn felt(&self, H: &DMatrix<f64>) -> DMatrix<f64> {
        let share = (DMatrix::identity(4, 4) + H).lu().solve(&self.J).unwrap_or_else(|| DMatrix::from_element(4, 3, f64::NAN));
        &self.M + self.J.transpose() * share * self.m_a
    }

    /// (8.12) against [`Case::felt`] `[kg·m²]`.
    fn error_of_8_12(&self, felt: &DMatrix<f64>) -> Result<f64, PaperError> {
        let svd = self.J.clone().svd(false, true);
        let V = regular(svd.v_t)?.transpose();
        let S = DMatrix::from_diagonal(&svd.singular_values.map(|s| 1.0 / (s * s)));
        let h = SHARE / (1.0 - SHARE);
        let inner = &V * S * V.transpose() * ((1.0 + h) / self.m_a) + &self.inverse * h;
        Ok((felt - (&self.M + regular(inner.try_inverse())?)).norm())
    }

    /// Gains from commanded forces to forces.
    fn gain(&self, [G, H]: &[DMatrix<f64>; 2]) -> DMatrix<f64> {
        (&self.left + H).lu().solve(G).unwrap_or_else(|| DMatrix::from_element(4, 4, f64::NAN))
    }

    /// The same as printed: `1/(1 − K_v0)` in the feed-forward, the power n of the decoupling in both.
    fn printed_null_gain(&self) -> Result<f64, PaperError> {
        let [mut G, H] = self.observer(1.0, NULL_SHARE)?;
        let (own, printed) = (NULL_SHARE / (1.0 - NULL_SHARE), 1.0 / (1.0 - NULL_SHARE));
        G += &self.v0 * self.v0.transpose() * (printed - own);
        Ok((self.v0.transpose() * self.gain(&[G, H]) * &self.v0)[(0, 0)])
    }

    /// As printed for n = 1/2: `G = D⁻ⁿ/(1 − K_f)`. Smallest gain of a force.
    fn printed_half_gain(&self) -> Result<f64, PaperError> {
        let [_, H] = self.observer(0.5, 0.0)?;
        let G = &H / SHARE;
        Ok(eigenvalues(&self.gain(&[G, H])).iter().map(|p| p.re).fold(f64::INFINITY, f64::min))
    }
}

fn condition(X: &DMatrix<f64>) -> f64 {
    let s = X.singular_values();
    s.max() / s.min()
}

/// Identities that hold, and what the printed ones miss.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let c = Case::new()?;
    let exact = |place, what: &str, error: f64, why: &str| Row::new(place, what, error, None, Gate::AtMost(EXACT)).because(why);
    let wrong = |place, what: &str, error: f64, why: &str| Row::new(place, what, error, None, Gate::AtLeast(1.0)).not_reproducible(why);
    let I3 = DMatrix::<f64>::identity(3, 3);
    let mut rows = vec![
        exact(
            "eq. 8.5",
            "forces against the equations of motion, N",
            c.error_of_8_5(1.0),
            "friction stands with a plus inside the bracket",
        ),
        wrong("eq. 8.5", "the same as printed, N", c.error_of_8_5(-1.0), "printed with the friction of the drives pushing"),
        exact("eq. 8.6", "transpose of J times its pseudo-inverse, less one", (c.J.transpose() * c.pinv.transpose() - I3).norm(), ""),
        exact("eq. 8.7", "D·v0 - v0: the internal force passes", (&c.D * &c.v0 - &c.v0).norm(), ""),
    ];
    let [G, H] = c.observer(1.0, 0.0)?;
    let law = (&G - &c.left / (1.0 - SHARE)).norm() / G.norm() + (&H - &c.left * (SHARE / (1.0 - SHARE))).norm() / H.norm();
    rows.push(exact(
        "eq. 8.8",
        "G and H of the observer, relative",
        law,
        "the equation is missing; this is what the observer's diagram gives",
    ));
    rows.push(exact("eq. 8.9", "forces under the observer, N", c.error_of_8_9(-1.0)?, "disturbances keep 1 - K_f"));
    rows.push(wrong("eq. 8.9", "the same as printed, N", c.error_of_8_9(1.0)?, "printed with 1 + K_f, and without the equals sign"));
    let felt = c.felt(&H);
    rows.push(exact("eq. 8.12", "inertia that is felt, kg·m²", c.error_of_8_12(&felt)?, ""));
    let alone = c.felt(&(DMatrix::identity(4, 4) * (SHARE / (1.0 - SHARE))));
    for (what, X, checked, width) in
        [("without robot", &c.M, 2.28, 0.02), ("with the observer", &felt, 2.26, 0.02), ("with uniform feedback", &alone, 17.6, 0.1)]
    {
        let what = format!("condition number of the inertia that is felt {what}");
        rows.push(Row::held_against("eq. 8.12", what, condition(X), None, (Gate::Within(width), checked)).because("an example: K_f = 0.8"));
    }
    let whole = c.gain(&c.observer(1.0, NULL_SHARE)?) - DMatrix::identity(4, 4);
    let mended = "the null-space term of the feed-forward is K_v0/(1 - K_v0)";
    rows.push(exact("eq. 8.13", "gains of all forces, less one", whole.norm(), mended));
    let row =
        Row::held_against("eq. 8.13", "gain of the internal force as printed", c.printed_null_gain()?, None, (Gate::Within(5e-4), 1.136));
    rows.push(row.not_reproducible("printed 1/(1 - K_v0): the force would not be the commanded one"));
    let half = c.gain(&c.observer(0.5, 0.0)?) - DMatrix::identity(4, 4);
    rows.push(exact("eq. 8.13", "gains of all forces for n = 1/2, less one", half.norm(), "feed-forward D⁻¹ + H"));
    let found = c.printed_half_gain()?;
    let row = Row::held_against("eq. 8.13", "smallest gain of a force for n = 1/2 as printed", found, None, (Gate::Within(5e-4), 0.150));
    rows.push(row.not_reproducible("as printed for n below 1 no force but the internal one is the commanded one"));
    Ok(rows)
}
