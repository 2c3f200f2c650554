//! The paper's equations of motion, misprints mended, and the three plants that it does not keep apart.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::arceo2021::geometry::Geometry;

/// Masses of Table 1 `[kg]`: slider, joint of the links, end of the short link.
pub(super) const MASSES: [f64; 3] = [6.1514, 2.1398, 2.8684];

/// Input gains of Table 2: effort per rate of the voltage `[N·s/V]`, velocity per voltage `[m/(s·V)]`.
pub(super) const B0: f64 = 0.0627;
pub(super) const B1: f64 = 0.007_45;

/// Friction of Table 2: coefficients of the square and of the speed, per coordinate.
pub(super) const FRICTION: [[f64; 2]; 3] = [[56.3869, -2.8211], [-9.3843, -0.6755], [-0.0841, 0.0440]];

/// No friction.
pub(super) const SMOOTH: [[f64; 2]; 3] = [[0.0; 2]; 3];

/// Which equations move the piston.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Plant {
    /// Remark 1: row 1 of (2) with the passive accelerations of (6), no multipliers.
    Row,
    /// The index-reduced differential-algebraic equations with multipliers.
    Constrained,
    /// What (8) inverts: `M11·d'' + C1 + F1 = b0·u'`.
    Inverted,
}

impl Geometry {
    /// M(q) of (2), without the l4 too many of M13 and M23.
    pub(super) fn mass_matrix(&self, q: [f64; 3]) -> Matrix3<f64> {
        let [z1, z2, z3, z4] = self.z(q);
        let [m1, m2, m3] = MASSES;
        let (m12, m13, m23) = ((m2 + m3) * z1, m3 * z2, m3 * (z1 * z2 + z3 * z4));
        let m22 = (m2 + m3) * (self.l2 * self.l2 + self.l3 * self.l3);
        Matrix3::new(m1 + m2 + m3, m12, m13, m12, m22, m23, m13, m23, m3 * self.l4 * self.l4)
    }

    /// C(q, q') of (2), right as printed.
    pub(super) fn coriolis(&self, q: [f64; 3], [_, v1, v2]: [f64; 3]) -> Vector3<f64> {
        let [z1, z2, z3, z4] = self.z(q);
        let [_, m2, m3] = MASSES;
        let turn = m3 * (z1 * z4 - z2 * z3);
        Vector3::new((m2 + m3) * z3 * v1 * v1 + m3 * z4 * v2 * v2, turn * v2 * v2, -turn * v1 * v1)
    }

    /// Right-hand side of (6): what the passive accelerations have to make up for.
    fn drift(&self, q: [f64; 3], [_, v1, v2]: [f64; 3]) -> [f64; 2] {
        let [z1, z2, z3, z4] = self.z(q);
        [z3 * v1 * v1 + z4 * v2 * v2, -z1 * v1 * v1 - z2 * v2 * v2]
    }

    /// Passive accelerations (6) with the piston at `a` `[m/s²]`.
    fn complete(&self, q: [f64; 3], v: [f64; 3], a: f64) -> [f64; 3] {
        let [z1, z2, z3, z4] = self.z(q);
        let [x, y] = self.drift(q, v);
        let determinant = z1 * z4 - z2 * z3;
        let (x, y) = (-x - a, -y);
        [a, (z4 * x - z2 * y) / determinant, (z1 * y - z3 * x) / determinant]
    }

    /// Projected inertia `RᵀMR` `[kg]` and force `Rᵀ(M·R'·d' + C + F)` `[N]`: what the drive feels.
    pub(super) fn projected(&self, q: [f64; 3], d_dot: f64, friction: &[[f64; 2]; 3]) -> [f64; 2] {
        let along = Vector3::from(self.rates(q, 1.0));
        let v = self.rates(q, d_dot);
        let m = self.mass_matrix(q);
        let still = Vector3::from(self.complete(q, v, 0.0));
        [along.dot(&(m * along)), along.dot(&(m * still + self.coriolis(q, v) + polynomial(friction, v)))]
    }

    /// Accelerations of (d, T1, T2) at a rate of the voltage `u_dot` `[V/s]`.
    pub(super) fn accelerations(&self, plant: Plant, q: [f64; 3], v: [f64; 3], u_dot: f64, friction: &[[f64; 2]; 3]) -> [f64; 3] {
        let [z1, z2, z3, z4] = self.z(q);
        let [x, y] = self.drift(q, v);
        let (m, force) = (self.mass_matrix(q), self.coriolis(q, v) + polynomial(friction, v));
        let effort = B0 * u_dot;
        match plant {
            Plant::Inverted => self.complete(q, v, (effort - force[0]) / m[(0, 0)]),
            Plant::Row => {
                let left = Matrix3::new(m[(0, 0)], m[(0, 1)], m[(0, 2)], 1.0, z1, z2, 0.0, z3, z4);
                let found = left.lu().solve(&Vector3::new(effort - force[0], -x, -y));
                found.unwrap_or_else(|| Vector3::repeat(f64::NAN)).into()
            }
            Plant::Constrained => {
                let jacobian = [[1.0, z1, z2], [0.0, z3, z4]];
                let mut left = SMatrix::<f64, 5, 5>::zeros();
                left.fixed_view_mut::<3, 3>(0, 0).copy_from(&m);
                for (row, constraint) in jacobian.iter().enumerate() {
                    for (k, x) in constraint.iter().enumerate() {
                        (left[(3 + row, k)], left[(k, 3 + row)]) = (*x, -*x);
                    }
                }
                let right = SVector::<f64, 5>::from([effort - force[0], -force[1], -force[2], -x, -y]);
                let found = left.lu().solve(&right).unwrap_or_else(|| SVector::repeat(f64::NAN));
                [found[0], found[1], found[2]]
            }
        }
    }
}

/// F(q') of section 2.1.
pub(super) fn polynomial(coefficients: &[[f64; 2]; 3], v: [f64; 3]) -> Vector3<f64> {
    Vector3::from_fn(|k, _| coefficients[k][0] * v[k] * v[k] + coefficients[k][1] * v[k])
}
