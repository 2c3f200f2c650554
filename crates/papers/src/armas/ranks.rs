//! How many parameters the efforts depend on: columns that are zero, chains by themselves, closed loops.

use nalgebra::DMatrix;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL};
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, Model};
use pkm_ident::base::{RANK_TOLERANCE, States, base_parameters};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::refused::refused;
use crate::robot::{closed, shipped};
use crate::row::{Gate, Row};

const WHAT: &str = "ranks";

/// Links in the paper's order, with its numbers.
const LINKS: [(&str, &str); 9] = [
    ("cylinder1", "11"),
    ("rod1", "12"),
    ("cylinder2", "21"),
    ("rod2", "22"),
    ("cylinder3", "31"),
    ("rod3", "32"),
    ("cylinder4", "41"),
    ("rod4", "42"),
    ("platform", "m"),
];

/// The ten, in the library's order and the paper's words.
const KINDS: [&str; N_INERTIAL] = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];

/// Parameters that act on nothing \[Armas, Table 2\].
const NULL: [&str; 16] =
    ["m11", "m21", "m31", "m41", "Ixx41", "Ixy41", "Ixz41", "Iyy41", "Iyz41", "Ixx42", "Ixy42", "Ixz42", "Iyz42", "Izz42", "my42", "mz41"];

/// States behind a rank, and behind the list of columns that are zero.
const STATES: usize = 150;
const CHAIN_STATES: usize = 60;

/// Share of the travel to each side of its middle that states are drawn from, largest velocity and acceleration.
const TRAVEL: f64 = 0.6;
const MOTION: [f64; 2] = [0.4, 3.0];

/// Equation (18) stacked over random states: the legs as chains of their own, the platform with its own four coordinates.
///
/// The platform of the model hangs on leg 4; its four rows are those of q41 to q44, which span the same space as the paper's X, Z, theta,
/// psi. They are kept apart from the rows of leg 4's links, as the paper has them.
fn equation_18(model: &Model) -> Result<DMatrix<f64>, PaperError> {
    let nv = model.nv();
    let on_leg_4: Vec<bool> = model.joints.iter().map(|j| j.name.starts_with("q4")).collect();
    let rows = nv + on_leg_4.iter().filter(|x| **x).count();
    let (legs, mut k1) = (N_INERTIAL * (LINKS.len() - 1), DMatrix::zeros(CHAIN_STATES * rows, N_INERTIAL * LINKS.len()));
    // The hinge of leg 4 is z of the paper's frame 41; frames of the other links are those of the model.
    let turned = Pose::from_xyz_rpy([0.0; 3], [-core::f64::consts::FRAC_PI_2, 0.0, 0.0]);
    let mut links = Vec::new();
    for (name, _) in LINKS {
        let missing = || PaperError::Other { what: WHAT, reason: format!("no link {name:?}") };
        let link = &model.links[model.link_index(name).ok_or_else(missing)?];
        let frame = if name == "cylinder4" { turned } else { Pose::identity() };
        links.push((link.body.ok_or_else(missing)?, InertialParameters::transform_matrix(&link.pose.compose(&frame))));
    }
    let (mut draw, mut data) = (Chance::new(1), Data::new(model));
    closed(&assemble(model, &mut data), WHAT)?;
    let home = data.q.clone();
    for state in 0..CHAIN_STATES {
        let middle = |&j: &usize| {
            let l = model.joints[j].limits;
            0.5 * (l.lower + l.upper) + 0.5 * TRAVEL * (l.upper - l.lower) * draw.signed()
        };
        let q: Vec<f64> = model.actuators.iter().map(middle).collect();
        let [v, a] = MOTION.map(|size| (0..model.n_act()).map(|_| size * draw.signed()).collect::<Vec<f64>>());
        data.q.copy_from_slice(&home);
        closed(&walk_to(model, &mut data, &q), WHAT)?;
        closed(&closed_loop_motion(model, &mut data, &q, &v, &a), WHAT)?;
        let [q, v, a] = [&data.q, &data.v, &data.a].map(Clone::clone);
        joint_torque_regressor(model, &mut data, &q, &v, &a);
        let mut own = state * rows + nv;
        for (j, &is_on_leg_4) in on_leg_4.iter().enumerate() {
            for (l, (body, change)) in links.iter().enumerate() {
                let columns = data.joint_torque_regressor.view((j, N_INERTIAL * body), (1, N_INERTIAL)) * change;
                if l < LINKS.len() - 1 {
                    k1.view_mut((state * rows + j, N_INERTIAL * l), (1, N_INERTIAL)).copy_from(&columns);
                } else if is_on_leg_4 {
                    k1.view_mut((own, legs), (1, N_INERTIAL)).copy_from(&columns);
                    own += 1;
                }
            }
        }
    }
    Ok(k1)
}

/// Names of the columns that are zero, and the rank of the others with the gap behind it.
fn chain(k1: &DMatrix<f64>) -> (Vec<String>, usize, f64) {
    let longest = k1.column_iter().fold(0.0_f64, |top, c| top.max(c.norm()));
    let (mut null, mut acting) = (Vec::new(), Vec::new());
    for (c, column) in k1.column_iter().enumerate() {
        if column.norm() > 1e-10 * longest {
            acting.push(column / column.norm());
        } else {
            null.push(format!("{}{}", KINDS[c % N_INERTIAL], LINKS[c / N_INERTIAL].1));
        }
    }
    // The R factor has the singular values of the whole and is small.
    let mut values: Vec<f64> = DMatrix::from_columns(&acting).qr().r().singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    let rank = values.iter().filter(|&&s| s > RANK_TOLERANCE * values[0]).count();
    let gap = values.get(rank).map_or(f64::INFINITY, |next| values[rank - 1] / next.max(f64::MIN_POSITIVE));
    (null, rank, gap)
}

/// Columns that are zero, then ranks.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let whole = |place, what: &str, ours: usize, paper: Option<f64>, checked: f64| {
        Row::held_against(place, what, ours as f64, paper, (Gate::Within(0.0), checked))
    };
    let mut model = shipped("ups3_rpu1")?.bare;
    let (null, open, gap) = chain(&equation_18(&model)?);
    let listed = null.iter().filter(|name| NULL.contains(&name.as_str())).count();
    let frames = "where z of frame 41 and y of frame 42 are the hinge of leg 4";
    let mut rows = vec![
        whole("Table 2", "columns that are zero", null.len(), Some(16.0), 16.0).because(frames),
        whole("Table 2", "of these, in the printed list", listed, Some(16.0), 16.0).because(frames),
        whole("eq. 18", "rank of the chains by themselves", open, None, 55.0)
            .because("3 times 13 of the outer legs, 6 of leg 4, 10 of the platform"),
        Row::new("eq. 18", "gap of the singular values behind it", gap, None, Gate::AtLeast(1e6)),
    ];
    let structural = "by structure, three masses of rods and one of leg 4 move to the platform: 55 - 4. The printed 34 is how many a motion \
                      shows well, with a tolerance that is not stated";
    let count = |model: &Model, kind, seed| {
        let mut draw = Chance::new(seed);
        base_parameters(model, kind, STATES, &mut || draw.unit()).map_err(refused(WHAT))
    };
    let moving = count(&model, States::Moving, 1)?;
    rows.push(whole("section 3.1", "base parameters of the links", moving.inertial, Some(34.0), 51.0).not_reproducible(structural));
    rows.push(Row::new("section 3.1", "gap of the singular values behind them", moving.gap, None, Gate::AtLeast(1e6)));
    rows.push(
        whole(
            "section 3.1",
            "the same in the starting geometry",
            count(&shipped("ups3_rpu1_start")?.bare, States::Moving, 1)?.inertial,
            Some(34.0),
            51.0,
        )
        .not_reproducible(structural),
    );
    rows.push(whole("section 3.1", "base parameters at rest", count(&model, States::AtRest, 2)?.inertial, None, 15.0));
    model.gravity.fill(0.0);
    rows.push(whole("section 3.1", "base parameters without weight", count(&model, States::Moving, 3)?.inertial, None, 40.0));
    Ok(rows)
}
