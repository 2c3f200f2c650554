//! Composite rigid bodies: the mass matrix of the spanning tree.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::kinematics::forward_kinematics;
use crate::model::Model;

/// Mass matrix of the tree, nv × nv `[kg, kg·m, kg·m²]`, all of it: `data.mass_matrix`. Rotor inertia is on the diagonal.
///
/// `q` `[m | rad]`, nv. In the root's frame composite bodies are sums and no wrench need be moved [Featherstone2008, table 6.2].
pub fn crba<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d DMatrix<f64> {
    forward_kinematics(model, data, q);
    inertias(model, data);
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let composite = data.inertia_w[i];
        if let Some(p) = joint.parent {
            data.inertia_w[p] += composite;
        }
        let momentum = composite.apply(&data.axis_w[i]);
        data.mass_matrix[(i, i)] = data.axis_w[i].dot(&momentum) + joint.armature;
        let mut at = joint.parent;
        while let Some(j) = at {
            let value = data.axis_w[j].dot(&momentum);
            data.mass_matrix[(i, j)] = value;
            data.mass_matrix[(j, i)] = value;
            at = model.joints[j].parent;
        }
    }
    &data.mass_matrix
}

/// Inertia of each body at the root's origin: `data.inertia_w`.
pub(crate) fn inertias(model: &Model, data: &mut Data) {
    for (i, body) in model.bodies.iter().enumerate() {
        data.inertia_w[i] =
            if body.is_massless() { crate::spatial::Inertia::default() } else { body.inertia().transformed(&data.pose_wb[i]) };
    }
}
