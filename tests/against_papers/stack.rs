//! The drives' regressor stacked over many states, and what its singular values say.

use nalgebra::{DMatrix, SMatrix};
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, friction_regressor};
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};
use pkm_tests::Draw;

/// Ten columns per link, in [`pkm_dyn::parameters::NAMES`] order but in frames of the caller's choice, and the motion behind every row.
pub(crate) struct Stack {
    /// Rows: states times drives. Columns: ten per link.
    pub(crate) w: DMatrix<f64>,
    /// One column per drive's rotor inertia.
    pub(crate) rotors: DMatrix<f64>,
    /// One column per joint's viscous friction, passive joints included.
    pub(crate) viscous: DMatrix<f64>,
    /// One column per joint's Coulomb friction.
    pub(crate) coulomb: DMatrix<f64>,
    /// The tree's regressor, rows: states times tree joints.
    pub(crate) tree: DMatrix<f64>,
}

/// How states are drawn.
#[derive(Clone, Copy)]
pub(crate) struct States {
    /// Number.
    pub(crate) n: usize,
    /// Share of the drives' travel to each side of its middle.
    pub(crate) travel: f64,
    /// Largest velocity and acceleration of the drives.
    pub(crate) motion: [f64; 2],
}

/// Stacks the regressors of `links`, each in the frame given as a pose in the link's own frame.
pub(crate) fn stack(model: &Model, links: &[(&str, Pose)], states: States, seed: u64) -> Stack {
    let (n, n_act, nv) = (states.n, model.n_act(), model.nv());
    let mut out = Stack {
        w: DMatrix::zeros(n * n_act, 10 * links.len()),
        rotors: DMatrix::zeros(n * n_act, n_act),
        viscous: DMatrix::zeros(n * n_act, nv),
        coulomb: DMatrix::zeros(n * n_act, nv),
        tree: DMatrix::zeros(n * nv, 10 * links.len()),
    };
    let to_link: Vec<(usize, SMatrix<f64, 10, 10>)> = links.iter().map(|(name, frame)| frame_change(model, name, frame)).collect();
    let (mut draw, mut data) = (Draw::new(seed), Data::new(model));
    assert!(assemble(model, &mut data).is_closed);
    let home = data.q.clone();
    for s in 0..n {
        let limits = model.actuators.iter().map(|&j| model.joints[j].limits);
        let q: Vec<f64> =
            limits.map(|l| 0.5 * (l.lower + l.upper) + 0.5 * states.travel * (l.upper - l.lower) * draw.uniform(-1.0..1.0)).collect();
        let [v, a] = states.motion.map(|size| draw.vector(n_act, -1.0..1.0).iter().map(|x| size * x).collect::<Vec<f64>>());
        data.q.copy_from_slice(&home);
        assert!(walk_to(model, &mut data, &q).is_closed, "{q:?}");
        assert!(closed_loop_motion(model, &mut data, &q, &v, &a).is_closed);
        actuated_regressor(model, &mut data);
        friction_regressor(model, &mut data);
        let columns = |from: usize| data.friction_regressor.columns(from, nv);
        out.viscous.rows_mut(s * n_act, n_act).copy_from(&columns(nv));
        out.coulomb.rows_mut(s * n_act, n_act).copy_from(&columns(2 * nv));
        out.rotors.rows_mut(s * n_act, n_act).copy_from(&columns(0).select_columns(&model.actuators));
        let [q, v, a] = [&data.q, &data.v, &data.a].map(Clone::clone);
        joint_torque_regressor(model, &mut data, &q, &v, &a);
        for (l, (body, change)) in to_link.iter().enumerate() {
            let columns = data.regressor.columns(10 * body, 10) * change;
            out.w.view_mut((s * n_act, 10 * l), (n_act, 10)).copy_from(&columns);
            let columns = data.joint_torque_regressor.columns(10 * body, 10) * change;
            out.tree.view_mut((s * nv, 10 * l), (nv, 10)).copy_from(&columns);
        }
    }
    out
}

fn frame_change(model: &Model, name: &str, frame: &Pose) -> (usize, SMatrix<f64, 10, 10>) {
    let link = &model.links[model.link_index(name).expect("link by name")];
    (link.body.expect("a moving link"), InertialParameters::transform_matrix(&link.pose.compose(frame)))
}

/// A rank, the gap behind its last singular value, and the condition number of what counts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rank {
    pub(crate) rank: usize,
    pub(crate) gap: f64,
    pub(crate) condition: f64,
}

/// Rank of a matrix whose columns are brought to length one; columns of zeros stay zero.
pub(crate) fn rank(w: &DMatrix<f64>) -> Rank {
    let longest = w.column_iter().fold(0.0_f64, |top, c| top.max(c.norm()));
    let mut scaled = w.clone();
    for mut column in scaled.column_iter_mut() {
        let length = column.norm();
        column.scale_mut(if length > 1e-10 * longest { 1.0 / length } else { 0.0 });
    }
    // The R factor has the singular values of the whole and is small.
    let values = scaled.qr().r().singular_values();
    let mut sorted: Vec<f64> = values.iter().copied().collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let rank = sorted.iter().filter(|&&s| s > 1e-9 * sorted[0]).count();
    let next = sorted.get(rank).copied().unwrap_or(0.0);
    Rank { rank, gap: sorted[rank - 1] / next.max(f64::MIN_POSITIVE), condition: sorted[0] / sorted[rank - 1] }
}

/// Columns of `w` that do not vanish.
pub(crate) fn acting(w: &DMatrix<f64>) -> Vec<usize> {
    let longest = w.column_iter().fold(0.0_f64, |top, c| top.max(c.norm()));
    (0..w.ncols()).filter(|&j| w.column(j).norm() > 1e-10 * longest).collect()
}

/// Tables side by side.
pub(crate) fn beside(parts: &[&DMatrix<f64>]) -> DMatrix<f64> {
    let columns: Vec<_> = parts.iter().flat_map(|p| p.column_iter().map(|c| c.into_owned())).collect();
    DMatrix::from_columns(&columns)
}
