//! Kinematics of motoBOTTE by the paper's equations, misprints mended, in the geometry that its printed initial states satisfy.

use pkm_dyn::math;

/// Lengths of Table 1 `[m]`; `L3` is the one that the printed states satisfy, 0.445 in the table.
const L1: f64 = 0.35;
const L2: f64 = 0.125;
const L3: f64 = 0.4646;
const L4: f64 = 0.1014;
const L5: f64 = 0.15;

/// Angles of Table 1 `[rad]`; the first is the one that the printed states satisfy, 138 degrees in the table.
const GAMMA: [f64; 2] = [132.0 * core::f64::consts::PI / 180.0, 2.0952];

/// Position of the piston `[m]` and the two angles `[rad]` for a foot angle `phi` `[rad]` \[Arceo2021, eq. 4, mended\]: l5 in the arcsine for
/// l2, a four-quadrant angle, T1 = phi + gamma2 − π/2 + T2 and d = … − z5.
pub(super) fn inverse_kinematics(phi: f64) -> [f64; 3] {
    let delta = phi + GAMMA[1] - core::f64::consts::FRAC_PI_2;
    let (s, c) = math::sin_cos(delta);
    let (a1, a2) = (L2 * c + L3 * s + L4, L2 * s - L3 * c);
    let (sg, cg) = math::sin_cos(GAMMA[0]);
    let t2 = math::asin(-L5 * cg / math::hypot(a1, a2)) - math::atan2(a1, -a2);
    let t1 = delta + t2;
    let (s1, c1) = math::sin_cos(t1);
    let (z3, z4) = (L3 * c1 - L2 * s1, -L4 * math::sin(t2));
    [-L1 + z3 + z4 - L5 * sg, t1, t2]
}
