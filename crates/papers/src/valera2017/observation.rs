//! The observation matrix W of equation (4) in the paper's frames and with its numbers of links, over states of a motion.

use nalgebra::{DMatrix, SMatrix};
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, friction_regressor};
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model, math};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::robot::closed;

/// Parameters of a link in the order of the library's regressor, by the paper's letters.
const KINDS: [&str; 10] = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];

/// Links by the paper's numbers, 1 to 7.
const LINKS: [&str; 7] = ["slider1", "coupler1", "platform", "slider2", "coupler2", "slider3", "coupler3"];

/// Drives.
const N: usize = 3;

/// The 25 parameters that act, of 70.
pub(super) const ACTING: [&str; 25] = [
    "m1", "m2", "mx2", "my2", "Izz2", "m3", "mx3", "my3", "mz3", "Ixx3", "Ixy3", "Iyy3", "Ixz3", "Iyz3", "Izz3", "m4", "m5", "mx5", "my5",
    "Izz5", "m6", "m7", "mx7", "my7", "Izz7",
];

/// Column of a parameter by the paper's name, as `Izz2`.
pub(super) fn column(name: &str) -> usize {
    let (kind, number) = name.split_at(name.len() - 1);
    let link: usize = number.parse().unwrap_or(1);
    10 * (link - 1) + KINDS.iter().position(|k| *k == kind).unwrap_or(0)
}

/// Columns by name, in that order.
pub(super) fn columns(w: &DMatrix<f64>, names: &[&str]) -> DMatrix<f64> {
    w.select_columns(names.iter().map(|name| column(name)).collect::<Vec<_>>().iter())
}

/// Positions, velocities and accelerations of the three drives.
pub(super) type State = [[f64; N]; 3];

/// Rows of (4): three per state; columns: ten per link, then the drives' rotors.
pub(super) fn observation(model: &Model, states: &[State]) -> Result<DMatrix<f64>, PaperError> {
    const WHAT: &str = "observation matrix";
    // The paper's frames: x along the coupler and z its hinge; platform x from sphere 1 to sphere 2.
    let turned = |rpy: [f64; 3]| Pose::from_xyz_rpy([0.0; 3], rpy);
    let (coupler, platform) = (turned([-core::f64::consts::FRAC_PI_2, 0.0, 0.0]), turned([0.0, 0.0, 150.0_f64.to_radians()]));
    let mut frames: Vec<(usize, SMatrix<f64, 10, 10>)> = Vec::new();
    for name in LINKS {
        let frame = if name.starts_with("coupler") {
            coupler
        } else if name == "platform" {
            platform
        } else {
            Pose::identity()
        };
        let bad = || PaperError::Robot { name: "prs3", reason: format!("no link {name}") };
        let link = &model.links[model.link_index(name).ok_or_else(bad)?];
        frames.push((link.body.ok_or_else(bad)?, InertialParameters::transform_matrix(&link.pose.compose(&frame))));
    }
    let mut w = DMatrix::zeros(N * states.len(), 10 * LINKS.len() + N);
    let mut data = Data::new(model);
    closed(&assemble(model, &mut data), WHAT)?;
    for (s, [q, v, a]) in states.iter().enumerate() {
        closed(&walk_to(model, &mut data, q), WHAT)?;
        closed(&closed_loop_motion(model, &mut data, q, v, a), WHAT)?;
        actuated_regressor(model, &mut data);
        for (l, (body, change)) in frames.iter().enumerate() {
            w.view_mut((N * s, 10 * l), (N, 10)).copy_from(&(data.regressor.columns(10 * body, 10) * change));
        }
        friction_regressor(model, &mut data);
        for (k, &j) in model.actuators.iter().enumerate() {
            let rotor = data.friction_regressor.column(j).into_owned();
            w.view_mut((N * s, 10 * LINKS.len() + k), (N, 1)).copy_from(&rotor);
        }
    }
    Ok(w)
}

/// States drawn one by one: what any motion could show.
pub(super) fn drawn_states(n: usize, seed: u64) -> Vec<State> {
    let mut chance = Chance::new(seed);
    let mut about = |middle: f64, half: f64| core::array::from_fn(|_| chance.between(middle - half, middle + half));
    (0..n).map(|_| [about(0.15, 0.09), about(0.0, 0.4), about(0.0, 3.0)]).collect()
}

/// A periodic motion of five harmonics about 0.1 m, 0.09 m wide, its coefficients drawn from a seed.
pub(super) fn drawn_motion(period_s: f64, samples: usize, seed: u64) -> Vec<State> {
    const HARMONICS: usize = 5;
    const HALF: f64 = 0.09;
    let mut chance = Chance::new(seed);
    let (mut sine, mut cosine) = ([[0.0; N]; HARMONICS], [[0.0; N]; HARMONICS]);
    for h in 0..HARMONICS {
        sine[h] = core::array::from_fn(|_| chance.normal());
        cosine[h] = core::array::from_fn(|_| chance.normal());
    }
    let w = core::f64::consts::TAU / period_s;
    let mut states: Vec<State> = (0..samples)
        .map(|i| {
            let t = period_s * i as f64 / (samples - 1) as f64;
            let mut state = [[0.0; N]; 3];
            for h in 0..HARMONICS {
                let rate = w * (h + 1) as f64;
                let (s, c) = math::sin_cos(rate * t);
                for k in 0..N {
                    let (a, b) = (sine[h][k], cosine[h][k]);
                    state[0][k] += (a * s - b * c) / rate;
                    state[1][k] += a * c + b * s;
                    state[2][k] += rate * (b * c - a * s);
                }
            }
            state
        })
        .collect();
    let mean: [f64; N] = core::array::from_fn(|k| states.iter().map(|s| s[0][k]).sum::<f64>() / samples as f64);
    let widest = states.iter().flat_map(|s| (0..N).map(move |k| (s[0][k] - mean[k]).abs())).fold(0.0, f64::max);
    for state in &mut states {
        for (k, mean) in mean.iter().enumerate() {
            state[0][k] = 0.1 + (state[0][k] - mean) * HALF / widest;
            state[1][k] *= HALF / widest;
            state[2][k] *= HALF / widest;
        }
    }
    states
}

/// A rank, the gap behind its last singular value, and the condition number of what counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rank {
    pub(super) rank: usize,
    pub(super) gap: f64,
    pub(super) condition: f64,
}

/// Columns at length one; columns of zeros stay zero.
pub(super) fn normalised(w: &DMatrix<f64>) -> DMatrix<f64> {
    let longest = w.column_iter().fold(0.0_f64, |top, c| top.max(c.norm()));
    let mut scaled = w.clone();
    for mut column in scaled.column_iter_mut() {
        let length = column.norm();
        column.scale_mut(if length > 1e-10 * longest { 1.0 / length } else { 0.0 });
    }
    scaled
}

/// Rank of a matrix as it is.
pub(super) fn rank(w: &DMatrix<f64>) -> Rank {
    // The R factor has the singular values of the whole and is small.
    let values = w.clone().qr().r().singular_values();
    let mut sorted: Vec<f64> = values.iter().copied().collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let top = sorted.first().copied().unwrap_or(0.0);
    let rank = sorted.iter().filter(|&&s| s > 1e-9 * top).count();
    let next = sorted.get(rank).copied().unwrap_or(0.0);
    let last = sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0);
    Rank { rank, gap: last / next.max(f64::MIN_POSITIVE), condition: top / last }
}
