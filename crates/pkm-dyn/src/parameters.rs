//! The ten inertial parameters of a body. The only place that knows their order.

use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector3};

use crate::spatial::{Inertia, Pose, skew};

/// Number of inertial parameters of a body.
pub const N_INERTIAL: usize = 10;

/// Names of the ten parameters in the order of [`InertialParameters::to_vector`] (Pinocchio's `toDynamicParameters`).
pub const NAMES: [&str; N_INERTIAL] = ["mass", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz"];

/// Units of the ten parameters, in the same order.
pub const UNITS: [&str; N_INERTIAL] = ["kg", "kg·m", "kg·m", "kg·m", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²"];

/// Position of each of our parameters in Armas' order `[Ixx Ixy Ixz Iyy Iyz Izz mx my mz m]` [Armas, eq. 18].
pub const ARMAS_ORDER: [usize; N_INERTIAL] = [9, 6, 7, 8, 0, 1, 3, 2, 4, 5];

/// Position of each of our parameters in Valera's order `[m mx my mz Ixx Iyy Izz Ixy Ixz Iyz]` [Valera2017, Table 1].
pub const VALERA_ORDER: [usize; N_INERTIAL] = [0, 1, 2, 3, 4, 7, 5, 8, 9, 6];

/// Mass properties of a body about its frame's origin, all linear in the equations of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InertialParameters {
    /// Mass `[kg]`.
    pub mass: f64,
    /// First moment, x `[kg·m]`.
    pub mx: f64,
    /// First moment, y `[kg·m]`.
    pub my: f64,
    /// First moment, z `[kg·m]`.
    pub mz: f64,
    /// Inertia about the origin `[kg·m²]`.
    pub ixx: f64,
    /// Product of inertia `[kg·m²]`.
    pub ixy: f64,
    /// Inertia about the origin `[kg·m²]`.
    pub iyy: f64,
    /// Product of inertia `[kg·m²]`.
    pub ixz: f64,
    /// Product of inertia `[kg·m²]`.
    pub iyz: f64,
    /// Inertia about the origin `[kg·m²]`.
    pub izz: f64,
}

impl InertialParameters {
    /// From mass `[kg]`, centre of mass `[m]` and inertia about it `[kg·m²]`, all in the body's frame.
    #[must_use]
    pub fn from_centre_of_mass(mass: f64, com: Vector3<f64>, central: Matrix3<f64>) -> Self {
        // Steiner: I_o = I_c + m [c]×ᵀ[c]×
        let c = skew(&com);
        Self::from_parts(mass, com * mass, central + c.transpose() * c * mass)
    }

    fn from_parts(mass: f64, h: Vector3<f64>, i: Matrix3<f64>) -> Self {
        Self {
            mass,
            mx: h.x,
            my: h.y,
            mz: h.z,
            ixx: i[(0, 0)],
            ixy: i[(0, 1)],
            iyy: i[(1, 1)],
            ixz: i[(0, 2)],
            iyz: i[(1, 2)],
            izz: i[(2, 2)],
        }
    }

    /// First moment `[kg·m]`.
    #[must_use]
    #[inline]
    pub fn first_moment(&self) -> Vector3<f64> {
        Vector3::new(self.mx, self.my, self.mz)
    }

    /// Inertia about the origin `[kg·m²]`.
    #[must_use]
    #[inline]
    pub fn rotational(&self) -> Matrix3<f64> {
        Matrix3::new(self.ixx, self.ixy, self.ixz, self.ixy, self.iyy, self.iyz, self.ixz, self.iyz, self.izz)
    }

    /// In the order of [`NAMES`].
    #[must_use]
    pub fn to_vector(&self) -> SVector<f64, N_INERTIAL> {
        SVector::from([self.mass, self.mx, self.my, self.mz, self.ixx, self.ixy, self.iyy, self.ixz, self.iyz, self.izz])
    }

    /// From the order of [`NAMES`].
    #[must_use]
    pub fn from_vector(p: &SVector<f64, N_INERTIAL>) -> Self {
        Self { mass: p[0], mx: p[1], my: p[2], mz: p[3], ixx: p[4], ixy: p[5], iyy: p[6], ixz: p[7], iyz: p[8], izz: p[9] }
    }

    /// Whether all ten are zero, as of the bodies between the coordinates of a ball joint: algorithms pass such bodies by.
    #[must_use]
    #[inline]
    pub fn is_massless(&self) -> bool {
        *self == Self::default()
    }

    /// As the algorithms use them.
    #[must_use]
    #[inline]
    pub fn inertia(&self) -> Inertia {
        Inertia { mass: self.mass, first_moment: self.first_moment(), rotational: self.rotational() }
    }

    /// Centre of mass `[m]` and inertia about it `[kg·m²]`; the origin for a massless body.
    #[must_use]
    pub fn centre_of_mass(&self) -> (Vector3<f64>, Matrix3<f64>) {
        if self.mass <= 0.0 {
            return (Vector3::zeros(), self.rotational());
        }
        let com = self.first_moment() / self.mass;
        let c = skew(&com);
        (com, self.rotational() - c.transpose() * c * self.mass)
    }

    /// The same body described in a frame A, where `pose` is the pose of the present frame in A.
    #[must_use]
    pub fn transformed(&self, pose: &Pose) -> Self {
        let (r, t) = (pose.rotation, pose.translation);
        let h = r * self.first_moment();
        // About the new origin: I + m [t]ᵀ[t] + [h]ᵀ[t] + [t]ᵀ[h], with every term linear in the parameters.
        let (sh, st) = (skew(&h), skew(&t));
        let i = r * self.rotational() * r.transpose() + st.transpose() * st * self.mass + sh.transpose() * st + st.transpose() * sh;
        Self::from_parts(self.mass, h + t * self.mass, i)
    }

    /// The matrix `L` with `transformed(pose).to_vector() = L · to_vector()`.
    #[must_use]
    pub fn transform_matrix(pose: &Pose) -> SMatrix<f64, N_INERTIAL, N_INERTIAL> {
        let mut l = SMatrix::<f64, N_INERTIAL, N_INERTIAL>::zeros();
        for k in 0..N_INERTIAL {
            let mut unit = SVector::<f64, N_INERTIAL>::zeros();
            unit[k] = 1.0;
            l.set_column(k, &Self::from_vector(&unit).transformed(pose).to_vector());
        }
        l
    }

    /// Two bodies rigidly joined.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        Self::from_vector(&(self.to_vector() + other.to_vector()))
    }

    /// The 4×4 pseudo-inertia matrix; positive definite exactly when some positive mass density has these parameters.
    #[must_use]
    pub fn pseudo_inertia(&self) -> Matrix4<f64> {
        let i = self.rotational();
        let sigma = Matrix3::identity() * (0.5 * i.trace()) - i;
        let h = self.first_moment();
        let mut p = Matrix4::zeros();
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(&sigma);
        p.fixed_view_mut::<3, 1>(0, 3).copy_from(&h);
        p.fixed_view_mut::<1, 3>(3, 0).copy_from(&h.transpose());
        p[(3, 3)] = self.mass;
        p
    }

    /// The parameters whose pseudo-inertia is `p`; linear in `p`, of which the lower triangle is not read.
    #[must_use]
    pub fn from_pseudo_inertia(p: &Matrix4<f64>) -> Self {
        // The upper left block is ½·tr(I)·1 − I, whose trace is ½·tr(I).
        let trace = p[(0, 0)] + p[(1, 1)] + p[(2, 2)];
        Self {
            mass: p[(3, 3)],
            mx: p[(0, 3)],
            my: p[(1, 3)],
            mz: p[(2, 3)],
            ixx: trace - p[(0, 0)],
            ixy: -p[(0, 1)],
            iyy: trace - p[(1, 1)],
            ixz: -p[(0, 2)],
            iyz: -p[(1, 2)],
            izz: trace - p[(2, 2)],
        }
    }

    /// Whether some non-negative mass density has these parameters, up to `tolerance` relative to the largest entry.
    #[must_use]
    pub fn is_feasible(&self, tolerance: f64) -> bool {
        let p = self.pseudo_inertia();
        p.symmetric_eigenvalues().min() >= -tolerance * p.amax().max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body() -> InertialParameters {
        InertialParameters::from_centre_of_mass(
            2.0,
            Vector3::new(0.1, -0.2, 0.3),
            Matrix3::new(0.5, 0.01, 0.02, 0.01, 0.4, -0.03, 0.02, -0.03, 0.3),
        )
    }

    #[test]
    fn the_three_orders_in_use_agree_on_one_body() {
        let p = body();
        let v = p.to_vector();
        let armas: Vec<f64> = {
            let mut out = vec![0.0; 10];
            for k in 0..10 {
                out[ARMAS_ORDER[k]] = v[k];
            }
            out
        };
        assert_eq!(armas, [p.ixx, p.ixy, p.ixz, p.iyy, p.iyz, p.izz, p.mx, p.my, p.mz, p.mass]);
        let mut valera = vec![0.0; 10];
        for k in 0..10 {
            valera[VALERA_ORDER[k]] = v[k];
        }
        assert_eq!(valera, [p.mass, p.mx, p.my, p.mz, p.ixx, p.iyy, p.izz, p.ixy, p.ixz, p.iyz]);
    }

    #[test]
    fn a_change_of_frame_keeps_the_central_inertia() {
        let x = Pose::from_xyz_rpy([0.3, 0.1, -0.4], [0.2, -0.7, 1.1]);
        let moved = body().transformed(&x);
        let (com, central) = body().centre_of_mass();
        let (com_moved, central_moved) = moved.centre_of_mass();
        assert!((com_moved - x.transform_point(&com)).norm() < 1e-14);
        assert!((central_moved - x.rotation * central * x.rotation.transpose()).norm() < 1e-14);
        assert!((InertialParameters::transform_matrix(&x) * body().to_vector() - moved.to_vector()).norm() < 1e-14);
    }

    #[test]
    fn the_pseudo_inertia_holds_all_ten() {
        let back = InertialParameters::from_pseudo_inertia(&body().pseudo_inertia());
        assert!((back.to_vector() - body().to_vector()).norm() < 1e-15);
    }

    #[test]
    fn feasibility_is_the_triangle_inequality_and_positive_mass() {
        assert!(body().is_feasible(1e-12));
        let mut long = body();
        long.izz += 5.0;
        assert!(!long.is_feasible(1e-12));
        let mut hollow = body();
        hollow.mass = -1.0;
        assert!(!hollow.is_feasible(1e-12));
    }
}
