//! Mass properties that MuJoCo takes: it moves no body without mass, and wants principal inertias that obey the triangle inequality.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::super::ExportError;
use crate::parameters::InertialParameters;

/// What a moving body without mass gets `[kg, kg·m²]`: above MuJoCo's limit of 1e-15, below every rounding that matters.
pub(super) const TINY: f64 = 1e-13;

/// Rounding of principal inertias that is mended, relative to the largest; what is more is no body and is refused.
const MENDED: f64 = 1e-9;

/// Room left in the triangle inequality for MuJoCo's own diagonalisation, relative to the largest principal inertia.
const ROOM: f64 = 1e-12;

/// Mass `[kg]`, centre of mass `[m]` and inertia about it `[kg·m²]` in the body's frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Inertial {
    pub(super) mass: f64,
    pub(super) com: Vector3<f64>,
    pub(super) central: Matrix3<f64>,
}

/// As MuJoCo takes it; at most [`ROOM`] or [`TINY`] beside the parameters. `link` gives the body its name.
pub(super) fn inertial(p: &InertialParameters, link: &str) -> Result<Inertial, ExportError> {
    let (com, central) = p.centre_of_mass();
    let eigen = SymmetricEigen::new(central);
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let [a, b, c] = order.map(|i| eigen.eigenvalues[i]);
    let refused = || ExportError::Inertia { link: link.to_string(), principal: [a, b, c] };
    let floor = (c * ROOM).max(TINY);
    // The smallest grows until all are positive and no one is larger than the others together.
    let raised = a.max(floor).max(c.max(floor) - b.max(floor) + floor);
    if raised - a > MENDED * c + 3.0 * TINY || !central.iter().all(|x| x.is_finite()) {
        return Err(refused());
    }
    let mass = p.mass.max(TINY);
    if raised.total_cmp(&a).is_eq() && b >= floor {
        return Ok(Inertial { mass, com, central });
    }
    let mut principal = eigen.eigenvalues.map(|x| x.max(floor));
    principal[order[0]] = raised;
    let r = eigen.eigenvectors;
    Ok(Inertial { mass, com, central: r * Matrix3::from_diagonal(&principal) * r.transpose() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(principal: [f64; 3]) -> Result<Inertial, ExportError> {
        let central = Matrix3::from_diagonal(&Vector3::from(principal));
        inertial(&InertialParameters::from_centre_of_mass(2.0, Vector3::new(0.1, 0.0, -0.2), central), "arm")
    }

    #[test]
    fn sound_bodies_are_left_alone() {
        let kept = of([0.3, 0.1, 0.25]).unwrap();
        assert!((kept.central - Matrix3::from_diagonal(&Vector3::new(0.3, 0.1, 0.25))).amax() < 1e-16);
        assert!((kept.com - Vector3::new(0.1, 0.0, -0.2)).norm() < 1e-16);
    }

    #[test]
    fn rods_plates_and_nothing_are_mended_by_less_than_a_rounding() {
        for principal in [[0.0, 0.2, 0.2], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3 + 1e-13]] {
            let mended = of(principal).unwrap().central;
            assert!((mended - Matrix3::from_diagonal(&Vector3::from(principal))).amax() < 1e-12, "{principal:?}");
            let mut p: Vec<f64> = mended.symmetric_eigenvalues().iter().copied().collect();
            p.sort_by(f64::total_cmp);
            assert!(p[0] > 1e-15 && p[0] + p[1] - p[2] > 1e-14, "{p:?}");
        }
        let nothing = inertial(&InertialParameters::default(), "arm").unwrap();
        assert_eq!((nothing.mass, nothing.central[(1, 1)]), (TINY, TINY));
    }

    #[test]
    fn what_no_body_has_is_refused_by_name() {
        for principal in [[0.1, 0.1, 0.3], [-0.01, 0.2, 0.2]] {
            let told = of(principal).unwrap_err().to_string();
            assert!(told.contains("\"arm\"") && told.contains("MuJoCo"), "{told}");
        }
    }
}
