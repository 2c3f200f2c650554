//! Golden files as they are read, and the order of their joints.

mod dynamics;
mod loops;

use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use serde::Deserialize;

/// A golden file; `S` is what it holds of each state.
#[derive(Deserialize)]
pub(crate) struct Golden<S> {
    pin: String,
    seed: u64,
    toml: String,
    urdf: String,
    joints: Vec<String>,
    /// Coordinates whose bodies are Pinocchio's, in its order.
    #[serde(default)]
    pub(crate) bodies: Vec<String>,
    #[serde(default)]
    pub(crate) last_link: String,
    pub(crate) states: Vec<S>,
}

/// The robot, and for each of Pinocchio's joints our index: Pinocchio sorts children by name, we keep the file's order.
pub(crate) fn robot<S>(golden: &Golden<S>) -> (Model, Vec<usize>) {
    assert_eq!(golden.pin, "4.1.0", "golden files of one version");
    assert!(golden.seed > 0);
    let model = parse(&golden.toml, &golden.urdf, ["golden.toml", "golden.urdf"]).expect("the golden robot reads").bare;
    let order = indices(&model, &golden.joints);
    (model, order)
}

/// Our index of each coordinate named.
pub(crate) fn indices(model: &Model, names: &[String]) -> Vec<usize> {
    names.iter().map(|name| model.joint_index(name).expect("joint by name")).collect()
}

/// A vector over Pinocchio's joints, in our order.
pub(crate) fn ours(order: &[usize], theirs: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; theirs.len()];
    for (k, &j) in order.iter().enumerate() {
        out[j] = theirs[k];
    }
    out
}

/// A vector over our joints, in Pinocchio's order.
pub(crate) fn theirs(order: &[usize], ours: &[f64]) -> Vec<f64> {
    order.iter().map(|&j| ours[j]).collect()
}
