//! Rows of equation (2), of Remark 1, and of the weight that is left out.

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::rnea::rnea;
use pkm_dyn::{Data, Model};

use crate::arceo2021::equations::{FRICTION, Plant, polynomial};
use crate::arceo2021::geometry::{FITTED, Geometry, TABLE};
use crate::error::PaperError;
use crate::robot::{closed, closed_at, shipped};
use crate::row::{Gate, Row};
use crate::series::largest_gap;

const INDEPENDENT: &str = "not printed: an independent program, ten decimals, at 100 deg and 0.03 m/s";

/// Rows of dynamics.
pub(super) fn rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = one_state();
    rows.extend(identities()?);
    rows.extend(remark_1()?);
    rows.extend(weight()?);
    Ok(rows)
}

fn one_state() -> Vec<Row> {
    let q = FITTED.inverse_kinematics(100.0_f64.to_radians());
    let v = FITTED.rates(q, 0.03);
    let (m, c, f) = (FITTED.mass_matrix(q), FITTED.coriolis(q, v), polynomial(&FRICTION, v));
    let near = |place: &'static str, what: &str, ours: f64, width: f64, checked: f64| {
        Row::held_against(place, what, ours, None, (Gate::Within(width), checked)).because(INDEPENDENT)
    };
    let entry = |what: &str, ours: f64, checked: f64| near("eq. 2", what, ours, 6e-11, checked);
    let too_many = "printed with an l4 too many; the kinetic energy of section 2.1 has none";
    vec![
        entry("M12, kg·m", m[(0, 1)], 0.799_248_357_2),
        entry("M13, kg·m", m[(0, 2)], -0.169_861_933_1).because(too_many),
        entry("M22, kg·m^2", m[(1, 1)], 1.159_288_920_9),
        entry("M23, kg·m^2", m[(1, 2)], 0.080_054_633_4).because(too_many),
        entry("M33, kg·m^2", m[(2, 2)], 0.029_492_774_1),
        entry("C1, N", c[0], 0.035_997_181_5),
        entry("C2, N·m", c[1], 0.013_290_985_3),
        entry("C3, N·m", c[2], -0.000_437_107_1),
        near("Table 2", "F1, N", f[0], 6e-9, -0.033_884_79),
        near("Table 2", "F2, N·m", f[1], 6e-11, 0.005_947_701_4),
        near("Table 2", "F3, N·m", f[2], 6e-10, 0.005_234_177),
    ]
}

/// `dq_tree/dq_paper`: the tree's last joint turns against the long link, the paper's T2 against the base.
fn tree_per_paper() -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -1.0)
}

/// Mass matrix and velocity forces of the opened chain in the paper's coordinates, from the library's tree.
fn open_chain(model: &Model, g: &Geometry, q: [f64; 3], v: [f64; 3]) -> (Matrix3<f64>, Vector3<f64>) {
    let (mut data, s) = (Data::new(model), tree_per_paper());
    let tree = g.to_model(q);
    let mut effort =
        |v: Vector3<f64>, a: Vector3<f64>| Vector3::from_column_slice(rnea(model, &mut data, &tree, v.as_slice(), a.as_slice()));
    let zero = Vector3::zeros();
    let m = Matrix3::from_columns(&core::array::from_fn::<_, 3, _>(|k| s.transpose() * effort(zero, s.column(k).into_owned())));
    (m, s.transpose() * effort(s * Vector3::from(v), zero))
}

/// (2) against the library's recursion, in poses where the opened chain need not close.
fn identities() -> Result<Vec<Row>, PaperError> {
    let mut rows = Vec::new();
    for g in [TABLE, FITTED] {
        let mut model = shipped(g.robot)?.bare;
        model.joints.iter_mut().for_each(|joint| joint.armature = 0.0);
        let mut gap = [0.0_f64; 2];
        for q in [[0.03, 0.2, -2.5], [0.09, -0.3, -1.1], [0.0, 1.0, 0.7]] {
            let v = [0.04, -0.6, 0.9];
            let (m, c) = open_chain(&model, &g, q, v);
            gap[0] = gap[0].max(largest_gap(m.as_slice(), g.mass_matrix(q).as_slice()));
            gap[1] = gap[1].max(largest_gap(c.as_slice(), g.coriolis(q, v).as_slice()));
        }
        for (what, gap) in ["mended M", "C as printed"].into_iter().zip(gap) {
            let what = format!("{what} against the library's recursion, {}: largest gap", g.robot);
            rows.push(Row::new("eq. 2", what, gap, None, Gate::AtMost(1e-12)));
        }
    }
    Ok(rows)
}

/// The acceleration of the piston by the three plants, and the one with multipliers by the library.
fn remark_1() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "Remark 1";
    let q = FITTED.inverse_kinematics(100.0_f64.to_radians());
    let (d_dot, u_dot) = (0.03, 5.0);
    let v = FITTED.rates(q, d_dot);
    let of = |plant: Plant| FITTED.accelerations(plant, q, v, u_dot, &FRICTION)[0];
    let row = |what: &str, ours: f64, checked: f64| {
        let row = Row::held_against("Remark 1", what, ours, None, (Gate::Within(6e-11), checked));
        row.because("the loop's forces act on d as well: row 1 alone, and (8), leave them out")
    };
    let mut model = shipped(FITTED.robot)?.bare;
    model.joints.iter_mut().for_each(|joint| joint.armature = 0.0);
    let mut data = Data::new(&model);
    closed_at(&model, &mut data, &[q[0]], WHAT)?;
    let mut effort = |v: f64, a: f64| -> Result<f64, PaperError> {
        closed(&inverse_dynamics(&model, &mut data, &[q[0]], &[v], &[a]), WHAT)?;
        Ok(data.tau_act[0])
    };
    let (bias, mass) = (effort(d_dot, 0.0)?, effort(0.0, 1.0)? - effort(0.0, 0.0)?);
    let friction = Vector3::from(FITTED.rates(q, 1.0)).dot(&polynomial(&FRICTION, v));
    let of_library = (crate::arceo2021::equations::B0 * u_dot - bias - friction) / mass;
    Ok(vec![
        row("acceleration of the piston, row 1 without multipliers, m/s^2", of(Plant::Row), 0.046_747_428_4),
        row("acceleration of the piston, with multipliers, m/s^2", of(Plant::Constrained), 0.030_570_769_1),
        row("acceleration of the piston, what (8) inverts, m/s^2", of(Plant::Inverted), 0.027_903_115_6),
        Row::held_against(
            "Remark 1",
            "acceleration of the piston, the library's closed loop, m/s^2",
            of_library,
            None,
            (Gate::Within(1e-9), 0.030_570_769_1),
        ),
    ])
}

/// Gravity "will be considered as G(q) = 0": along the paper's x it would be this much.
fn weight() -> Result<Vec<Row>, PaperError> {
    const WHAT: &str = "weight of motoBOTTE";
    let mut model = shipped(FITTED.robot)?.bare;
    model.gravity.x = -9.806;
    let mut data = Data::new(&model);
    let mut rows = Vec::new();
    for (degrees, checked) in [(80.0_f64, 71.7387), (110.0, 75.4109), (140.0, 78.5100)] {
        let d = FITTED.inverse_kinematics(degrees.to_radians())[0];
        closed_at(&model, &mut data, &[d], WHAT)?;
        closed(&inverse_dynamics(&model, &mut data, &[d], &[0.0], &[0.0]), WHAT)?;
        let what = format!("weight along the piston at {degrees} deg, N");
        let row = Row::held_against("eq. 2", what, data.tau_act[0], Some(0.0), (Gate::Within(5e-5), checked));
        rows.push(row.not_reproducible(
            "G(q) = 0 is said of the screw and of the driver: weight of 72 to 79 N is a hundred times friction and inertia of the paper's \
             motions, and only a drive that holds itself hides it",
        ));
    }
    Ok(rows)
}
