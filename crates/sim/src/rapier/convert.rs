//! The engine's vectors and poses, and ours. The only file that knows glam.

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::spatial::Pose;
use rapier3d_f64::math as engine;

/// A vector, for the engine.
pub(super) fn vector_to(v: &Vector3<f64>) -> engine::Vector {
    engine::Vector::new(v.x, v.y, v.z)
}

/// A vector of the engine's.
pub(super) fn vector_from(v: engine::Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// A rotation matrix as the engine's quaternion.
pub(super) fn rotation_to(r: &Matrix3<f64>) -> engine::Rotation {
    let column = |k: usize| vector_to(&r.column(k).into_owned());
    engine::Rotation::from_mat3(&engine::Matrix::from_cols(column(0), column(1), column(2))).normalize()
}

/// A pose, for the engine.
pub(super) fn pose_to(x: &Pose) -> engine::Pose {
    engine::Pose::from_parts(vector_to(&x.translation), rotation_to(&x.rotation))
}

/// A pose of the engine's.
pub(super) fn pose_from(x: &engine::Pose) -> Pose {
    let column = |axis: engine::Vector| vector_from(x.rotation * axis);
    let rotation = Matrix3::from_columns(&[column(engine::Vector::X), column(engine::Vector::Y), column(engine::Vector::Z)]);
    Pose { rotation, translation: vector_from(x.translation) }
}
