//! Composite rigid bodies: the mass matrix of the spanning tree.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::kinematics::root_poses;
use crate::model::Model;

/// Mass matrix of the tree, nv × nv `[kg, kg·m, kg·m²]`, all of it: `data.mass_matrix`. Rotor inertia is on the diagonal.
///
/// `q` `[m | rad]`, nv. In the root's frame composite bodies are sums and no wrench need be moved [Featherstone2008, table 6.2].
pub fn crba<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d DMatrix<f64> {
    root_poses(model, data, q);
    composites(model, data);
    &data.mass_matrix
}

/// The mass matrix for the poses in `data`. Entries of joints on different branches are zero from the start.
pub(crate) fn composites(model: &Model, data: &mut Data) {
    inertias(model, data);
    let nv = model.nv();
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let composite = data.inertia_w[i];
        if let Some(p) = joint.parent {
            data.inertia_w[p] += composite;
        }
        let momentum = composite.apply(&data.axis_w[i]);
        let m = data.mass_matrix.as_mut_slice();
        m[i * nv + i] = data.axis_w[i].dot(&momentum) + joint.armature;
        let mut at = joint.parent;
        while let Some(j) = at {
            let value = data.axis_w[j].dot(&momentum);
            m[j * nv + i] = value;
            m[i * nv + j] = value;
            at = model.joints[j].parent;
        }
    }
}

/// Inertia of each body at the root's origin: `data.inertia_w`.
pub(crate) fn inertias(model: &Model, data: &mut Data) {
    for (i, body) in model.bodies.iter().enumerate() {
        data.inertia_w[i] =
            if body.is_massless() { crate::spatial::Inertia::default() } else { body.inertia().transformed(&data.pose_wb[i]) };
    }
}
