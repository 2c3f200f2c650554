//! Kinematics of motoBOTTE by the paper's equations, misprints mended, and what its printed states and tables satisfy.

use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::{Data, Model, math};

use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};
use crate::series::largest_gap;

/// Lengths `[m]` and angles `[rad]` of the mechanism.
#[derive(Debug, Clone, Copy)]
pub(super) struct Geometry {
    l1: f64,
    pub(super) l2: f64,
    pub(super) l3: f64,
    pub(super) l4: f64,
    l5: f64,
    gamma1: f64,
    gamma2: f64,
    /// The shipped robot with these lengths, and the middle of its piston's travel, where its angles read zero `[m]`.
    pub(super) robot: &'static str,
    home: f64,
}

/// Table 1.
pub(super) const TABLE: Geometry = Geometry {
    l1: 0.35,
    l2: 0.125,
    l3: 0.445,
    l4: 0.1014,
    l5: 0.15,
    gamma1: 2.4086,
    gamma2: 2.0952,
    robot: "motobotte_table",
    home: 0.0475,
};

/// What the printed initial states satisfy: l3 = 0.4646 m, gamma1 = 132 degrees.
pub(super) const FITTED: Geometry =
    Geometry { l3: 0.4646, gamma1: 132.0 * core::f64::consts::PI / 180.0, robot: "motobotte", home: 0.0515, ..TABLE };

/// Initial states (d, T1, T2) printed in sections 3 and 5, "consistent with the algebraic constraints".
const PRINTED: [[f64; 3]; 3] = [[0.0906, 0.0369, -1.9944], [0.0841, 0.0543, -2.0822], [0.0107, 0.1574, -2.8105]];

/// How far they are from closing in Table 1's geometry, along x and y `[m]`.
const OPEN: [[f64; 2]; 3] = [[8.4e-3, -11.8e-3], [8.5e-3, -12.1e-3], [8.2e-3, -14.2e-3]];

/// Travel of the piston `[m]`.
pub(super) const TRAVEL: f64 = 0.103;

impl Geometry {
    /// z1 to z4 of section 2.1.
    pub(super) fn z(&self, [_, t1, t2]: [f64; 3]) -> [f64; 4] {
        let ((s1, c1), (s2, c2)) = (math::sin_cos(t1), math::sin_cos(t2));
        [self.l2 * c1 + self.l3 * s1, self.l4 * c2, self.l3 * c1 - self.l2 * s1, -self.l4 * s2]
    }

    /// First two rows of (3).
    fn residual(&self, q: [f64; 3]) -> [f64; 2] {
        let [z1, z2, z3, z4] = self.z(q);
        let (s, c) = math::sin_cos(self.gamma1);
        [q[0] + self.l1 - z3 - z4 + self.l5 * s, z1 + z2 + self.l5 * c]
    }

    /// Third row of (3).
    fn phi(&self, [_, t1, t2]: [f64; 3]) -> f64 {
        t1 - t2 + core::f64::consts::FRAC_PI_2 - self.gamma2
    }

    /// (d, T1, T2) for a foot angle `phi` `[rad]` \[Arceo2021, eq. 4, mended\]: l5 in the arcsine for l2, a four-quadrant angle,
    /// T1 = phi + gamma2 − π/2 + T2 and d = … − z5.
    pub(super) fn inverse_kinematics(&self, phi: f64) -> [f64; 3] {
        let delta = phi + self.gamma2 - core::f64::consts::FRAC_PI_2;
        let (s, c) = math::sin_cos(delta);
        let (a1, a2) = (self.l2 * c + self.l3 * s + self.l4, self.l2 * s - self.l3 * c);
        let (sg, cg) = math::sin_cos(self.gamma1);
        let t2 = math::asin(-self.l5 * cg / math::hypot(a1, a2)) - math::atan2(a1, -a2);
        let q = [0.0, delta + t2, t2];
        let [_, _, z3, z4] = self.z(q);
        [-self.l1 + z3 + z4 - self.l5 * sg, q[1], q[2]]
    }

    /// Equation (10): rates for a speed of the piston `[m/s]`.
    pub(super) fn rates(&self, q: [f64; 3], d_dot: f64) -> [f64; 3] {
        let [z1, z2, z3, z4] = self.z(q);
        let determinant = z1 * z4 - z2 * z3;
        [d_dot, -z4 * d_dot / determinant, z3 * d_dot / determinant]
    }

    /// Foot angle `[rad]` with the piston at `d` `[m]`, by halving on the branch from 60 to 150 degrees, where d falls with phi.
    pub(super) fn phi_at(&self, d: f64) -> f64 {
        let (mut low, mut high) = (60.0_f64.to_radians(), 150.0_f64.to_radians());
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if self.inverse_kinematics(middle)[0] > d {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Tree coordinates (d, T1, phi) of the library's model at the paper's q.
    pub(super) fn to_model(self, q: [f64; 3]) -> [f64; 3] {
        let home = self.inverse_kinematics(self.phi_at(self.home));
        let (t1, t2) = (q[1] - home[1], q[2] - home[2]);
        [q[0], t1, t1 - t2]
    }

    /// The paper's (d, T1, T2) of the library's model in the pose that `data` holds: its T1 and phi read zero at home, and T2 is measured
    /// from the base.
    fn of_model(&self, model: &Model, data: &Data) -> [f64; 3] {
        let home = self.inverse_kinematics(self.phi_at(self.home));
        let at = |name: &str| model.joint_index(name).map_or(f64::NAN, |j| data.q[j]);
        [at("d"), home[1] + at("T1"), home[2] + at("T1") - at("phi")]
    }
}

/// Rows of kinematics.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = printed_states();
    rows.extend(travel());
    rows.extend(one_pose()?);
    Ok(rows)
}

fn printed_states() -> Vec<Row> {
    let mut rows = Vec::new();
    for ((k, q), open) in (1..).zip(PRINTED).zip(OPEN) {
        for (axis, (ours, checked)) in ["x", "y"].into_iter().zip(TABLE.residual(q).into_iter().zip(open)) {
            let what = format!("printed state {k} in Table 1's geometry: gap along {axis}, m");
            let row = Row::held_against("eq. 3", what, ours, Some(0.0), (Gate::Within(5e-5), checked));
            rows.push(row.not_reproducible("said to satisfy (3); open by 8 to 14 mm with l3 and gamma1 of Table 1"));
        }
        let gap = FITTED.residual(q).into_iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        let row = Row::new(
            "eq. 3",
            format!("printed state {k} with l3 = 0.4646 m, gamma1 = 132 deg: gap, m"),
            gap,
            Some(0.0),
            Gate::Within(1e-4),
        );
        rows.push(row.because("two lengths fit six equations within four digits; 132 is 270 − 138, sine and cosine exchanged"));
    }
    // What the three states are said to be: the start of section 3, of gait, of the isokinetic exercise.
    let angles = [1.5069, 1.6123, 7.0 * core::f64::consts::PI / 9.0];
    for ((k, q), angle) in (1..).zip(PRINTED).zip(angles) {
        rows.push(Row::held_against(
            "eq. 3",
            format!("foot angle of printed state {k}, rad"),
            TABLE.phi(q),
            Some(angle),
            (Gate::Within(3e-4), angle),
        ));
    }
    if let Some(row) = rows.iter_mut().rev().nth(2) {
        (row.paper, row.why) = (None, "not printed: an independent program".to_string());
    }
    rows
}

fn travel() -> Vec<Row> {
    let limits = "\"d from 0 to 0.103 m\"; the angles are those of an independent program";
    let mut rows: Vec<Row> = [(0.0, 145.96), (TRAVEL, 71.89)]
        .into_iter()
        .map(|(d, checked)| {
            let what = format!("foot angle with the piston at {d} m, deg");
            Row::held_against("section 2", what, FITTED.phi_at(d).to_degrees(), None, (Gate::Within(6e-3), checked)).because(limits)
        })
        .collect();
    let start = 140.0_f64.to_radians();
    let table = Row::held_against(
        "eq. 12",
        "piston where the isokinetic exercise starts, Table 1's geometry, m",
        TABLE.inverse_kinematics(start)[0],
        Some(PRINTED[2][0]),
        (Gate::Within(5e-5), -0.8e-3),
    );
    rows.push(table.not_reproducible("outside the travel"));
    rows.push(Row::new(
        "eq. 12",
        "piston where the isokinetic exercise starts, fitted geometry, m",
        FITTED.inverse_kinematics(start)[0],
        Some(PRINTED[2][0]),
        Gate::Within(1e-4),
    ));
    for (degrees, checked) in [(80.0_f64, -0.0503), (110.0, -0.0847), (140.0, -0.1029)] {
        let q = FITTED.inverse_kinematics(degrees.to_radians());
        let [_, v1, v2] = FITTED.rates(q, 1.0);
        let what = format!("piston per foot angle at {degrees} deg, m/rad");
        rows.push(Row::held_against("eq. 5", what, 1.0 / (v1 - v2), None, (Gate::Within(5e-5), checked)).because("not printed"));
    }
    rows
}

/// (4) and (10) at 100 degrees, against numbers of an independent program and against the library's loops.
fn one_pose() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "kinematics of motoBOTTE";
    let q = FITTED.inverse_kinematics(100.0_f64.to_radians());
    let rates = FITTED.rates(q, 0.03);
    let independent = "not printed: an independent program, ten decimals";
    let row = |place: &'static str, what: &str, ours: f64, checked: f64| {
        let what = format!("{what} at 100 deg");
        Row::held_against(place, what, ours, None, (Gate::Within(6e-11), checked)).because(independent)
    };
    let mut rows = vec![
        row("eq. 4", "d, m,", q[0], 0.074_722_629_4),
        row("eq. 4", "T1, rad,", q[1], 0.075_279_800_5),
        row("eq. 4", "T2, rad,", q[2], -2.194_453_124_7),
        row("eq. 10", "rate of T1 for 0.03 m/s, rad/s,", rates[1], -0.061_711_708_2),
        row("eq. 10", "rate of T2 for 0.03 m/s, rad/s,", rates[2], 0.340_292_376_3),
    ];
    for g in [TABLE, FITTED] {
        let model = shipped(g.robot)?.bare;
        let mut data = Data::new(&model);
        let mut gap = 0.0_f64;
        for degrees in [75.0, 80.0, 95.0, 110.0, 125.0, 138.0_f64] {
            let q = g.inverse_kinematics(degrees.to_radians());
            closed_at(&model, &mut data, &[q[0]], WHAT)?;
            gap = gap.max(largest_gap(&g.of_model(&model, &data), &q));
            closed(&closed_loop_motion(&model, &mut data, &[q[0]], &[0.03], &[0.0]), WHAT)?;
            let at = |name: &str| model.joint_index(name).map_or(f64::NAN, |j| data.v[j]);
            gap = gap.max(largest_gap(&[0.03, at("T1"), at("T1") - at("phi")], &g.rates(q, 0.03)));
        }
        let what = format!("mended equations against the library's loops, {}: largest gap, m, rad or per second", g.robot);
        let row = Row::new("eq. 4, 10", what, gap, None, Gate::AtMost(1e-10));
        rows.push(row.because("(4) prints l2 for l5, arctan for a four-quadrant angle, − pi for − pi/2, + z5 for − z5"));
    }
    Ok(rows)
}
