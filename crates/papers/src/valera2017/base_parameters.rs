//! Base parameters: how many there are, Table 1, and how the eliminated set decides the condition number.

use nalgebra::{DMatrix, SMatrix};
use pkm_dyn::{Model, math};

use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::{Gate, Line, Plot, Row};
use crate::series::median;
use crate::valera2017::observation::{ACTING, Rank, columns, drawn_motion, drawn_states, normalised, observation, rank};
use crate::valera2017::position::{L_M, L_R};

/// The two printed sets of eliminated parameters.
const SETS: [[&str; 6]; 2] = [["m1", "m2", "m3", "m4", "m5", "m6"], ["m1", "Iyy3", "m3", "mx3", "m5", "m7"]];

/// The independent count of sets of six that can be eliminated has determinants below this one left out.
const DETERMINANT: f64 = 1e-6;

/// Motions over which medians are taken.
const MOTIONS: u64 = 8;

/// Rows of counts: how many parameters act and are independent.
pub(super) fn counts() -> Result<Vec<Row>, PaperError> {
    let model = shipped("prs3")?.bare;
    let w = observation(&model, &drawn_states(200, 1))?;
    let longest = w.column_iter().fold(0.0_f64, |top, c| top.max(c.norm()));
    let acting = (0..70).filter(|&j| w.column(j).norm() > 1e-10 * longest).count();
    let inertial = columns(&w, &ACTING);
    let with_rotors = DMatrix::from_columns(&inertial.column_iter().chain(w.columns(70, 3).column_iter()).collect::<Vec<_>>());
    let mut weightless = model.clone();
    weightless.gravity.fill(0.0);
    let without_gravity = columns(&observation(&weightless, &drawn_states(200, 2))?, &ACTING);
    let alike = legs_alike(&w);
    let my = 3;
    let symmetric = alike.clone().remove_column(my);
    let mut rows = vec![Row::held_against("eq. 4", "inertial parameters that act, of 70", acting as f64, None, (Gate::Within(0.0), 25.0))];
    let mut push = |place: &'static str, what: &str, w: &DMatrix<f64>, (checked, paper): (f64, Option<f64>), why: &str| {
        let Rank { rank, gap, .. } = rank(&normalised(w));
        rows.push(Row::held_against(place, what, rank as f64, paper, (Gate::Within(0.0), checked)).because(why));
        rows.push(Row::new(place, format!("{what}: gap of the singular values"), gap.min(1e30), None, Gate::AtLeast(1e8)));
    };
    push("eq. 7", "independent inertial combinations", &inertial, (19.0, Some(19.0)), "25 less the six of each printed set");
    push("eq. 7", "independent without gravity", &without_gravity, (19.0, None), "");
    push("eq. 7", "independent with rotor inertias", &with_rotors, (22.0, None), "");
    push("Table 1", "independent with legs alike", &alike, (13.0, None), "");
    let redundant = "Table 1 has 14 rows; Izz7 and mx7 belong to the same coupler as Izz2 and mx2 when legs are alike, so 12 are free and 14 \
                     is the number of columns that act";
    push("Table 1", "independent with legs alike and my = 0", &symmetric, (12.0, Some(14.0)), redundant);
    if let Some(row) = rows.iter_mut().find(|row| row.paper == Some(14.0)) {
        *row = row.clone().not_reproducible(redundant);
    }
    Ok(rows)
}

/// Columns of slider and coupler summed over the legs, then those of the platform: m of the slider, m, mx, my, Izz of the coupler.
fn legs_alike(w: &DMatrix<f64>) -> DMatrix<f64> {
    let of = |names: [&str; 5]| columns(w, &names);
    let legs = of(["m1", "m2", "mx2", "my2", "Izz2"]) + of(["m4", "m5", "mx5", "my5", "Izz5"]) + of(["m6", "m7", "mx7", "my7", "Izz7"]);
    let platform = columns(w, &["m3", "mx3", "my3", "mz3", "Ixx3", "Ixy3", "Iyy3", "Ixz3", "Iyz3", "Izz3"]);
    DMatrix::from_columns(&legs.column_iter().chain(platform.column_iter()).collect::<Vec<_>>())
}

fn left_by(eliminated: &[&str]) -> Vec<&'static str> {
    ACTING.into_iter().filter(|name| !eliminated.contains(name)).collect()
}

/// Equation (7): B with `W_b = W_a·B`, one row per kept parameter.
fn combinations(w: &DMatrix<f64>, eliminated: &[&str]) -> Option<DMatrix<f64>> {
    let (w_a, w_b) = (columns(w, &left_by(eliminated)), columns(w, eliminated));
    let qr = w_a.qr();
    qr.r().solve_upper_triangular(&(qr.q().transpose() * w_b))
}

/// One printed row of Table 1: its number and kept parameter; printed coefficients of M = m1 + m2 and of m3, legs alike; the exact ones.
struct Printed {
    number: usize,
    kept: &'static str,
    printed: [f64; 2],
    exact: [f64; 2],
    why: &'static str,
}

fn table_1() -> [Printed; 14] {
    let (a, b, c) = (0.5 * math::sqrt(3.0) * L_M, 0.5 * L_M, L_M);
    let row = |number, kept, printed, exact, why| Printed { number, kept, printed, exact, why };
    let l2 = L_R * L_R;
    [
        row(1, "Ixx3", [-2.0 * b * b, -b * b], [-2.0 * a * a, -a * a], "printed b^2 is a^2"),
        row(2, "Ixy3", [2.0 * a * b, a * b], [2.0 * a * b, a * b], ""),
        row(3, "Ixz3", [0.0; 2], [0.0; 2], ""),
        row(4, "Iyy3", [a * a - 2.0 * b * b, -b * b], [c * c - 2.0 * b * b, -b * b], "printed + a^2 is + c^2"),
        row(5, "Izz3", [-c * c, -c * c], [-c * c, -c * c], ""),
        row(6, "mx3", [c - 2.0 * b, -b], [c - 2.0 * b, -b], "with b = +l_m/2; the text's cos 120 degrees makes no equilateral triangle"),
        row(7, "my3", [-2.0 * a, -a], [-2.0 * a, -a], ""),
        row(8, "mz3", [0.0; 2], [0.0; 2], ""),
        row(9, "Iyz3", [0.0; 2], [0.0; 2], "row 9 repeats Izz3; the one that is missing is Iyz3"),
        row(10, "Izz2", [-2.0 * l2, 0.0], [-l2, 0.0], "printed 2m1 + 2m2 is m1 + m2"),
        row(11, "mx2", [-l2, 0.0], [-L_R, 0.0], "printed l_r^2 is l_r: a first moment"),
        row(12, "Izz7", [-2.0 * l2, -l2], [2.0 * l2, l2], "printed Izz2 − is Izz7 +; the sign decides feasibility (9)"),
        row(13, "m7", [3.0, 1.0], [3.0, 1.0], ""),
        row(14, "mx7", [-2.0 * L_R, -L_R], [2.0 * L_R, L_R], "printed − is +"),
    ]
}

/// Rows of Table 1: coefficients of M and m3 that set 1 gives.
pub(super) fn combinations_of_set_1() -> Result<Vec<Row>, PaperError> {
    let model = shipped("prs3")?.bare;
    let w = observation(&model, &drawn_states(200, 5))?;
    let other = |reason: &str| PaperError::Other { what: "Table 1", reason: reason.to_string() };
    let b_matrix = combinations(&w, &SETS[0]).ok_or_else(|| other("set 1 leaves a singular set"))?;
    let kept = left_by(&SETS[0]);
    let mut rows = Vec::new();
    for entry in table_1() {
        let i = kept.iter().position(|name| *name == entry.kept).ok_or_else(|| other("a parameter is not kept"))?;
        // M counts once per leg that goes into the parameter: m1 for m1, m4, m6 and m2 for m2, m5; m7 itself is the third coupler.
        let [sliders, couplers] = [b_matrix[(i, 0)] + b_matrix[(i, 3)] + b_matrix[(i, 5)], b_matrix[(i, 1)] + b_matrix[(i, 4)]];
        let of_legs = if entry.kept == "m7" { 0.5 * (sliders + couplers + 1.0) } else { 0.5 * (sliders + couplers) };
        for (name, ours, printed, exact) in
            [("m1 + m2", of_legs, entry.printed[0], entry.exact[0]), ("m3", b_matrix[(i, 2)], entry.printed[1], entry.exact[1])]
        {
            let what = format!("row {}, {}: coefficient of {name}", entry.number, entry.kept);
            rows.push(Row::held_against("Table 1", what, ours, Some(printed), (Gate::Within(1e-9), exact)).because(entry.why));
        }
    }
    Ok(rows)
}

/// Condition numbers of the two printed sets on a motion: columns as they are, columns at length one.
fn conditions(w: &DMatrix<f64>) -> [[f64; 2]; 2] {
    SETS.map(|set| {
        let left = columns(w, &left_by(&set));
        [rank(&left).condition, rank(&normalised(&left)).condition]
    })
}

/// Rows of condition numbers, and a plot of all sets.
pub(super) fn condition_numbers(progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let model = shipped("prs3")?.bare;
    let mut rows = Vec::new();
    let over = |period_s: f64| -> Result<Vec<[[f64; 2]; 2]>, PaperError> {
        (0..MOTIONS).map(|seed| Ok(conditions(&observation(&model, &drawn_motion(period_s, 101, seed))?))).collect()
    };
    let found = over(10.0)?;
    let of = |set: usize, scaling: usize| median(&found.iter().map(|c| c[set][scaling]).collect::<Vec<_>>());
    let motion = "the paper's optimal motion is not printed: medians of eight drawn motions of 10 s, columns at length one; an independent \
                  program has 579 and 1774 on others";
    let what = |name: &str| format!("condition number, {name}");
    rows.push(Row::new("section 3", what("set 1, at length one"), of(0, 1), Some(50.0), Gate::Told).not_reproducible(motion));
    rows.push(Row::new("section 3", what("set 2, at length one"), of(1, 1), Some(110.0), Gate::Told).not_reproducible(motion));
    rows.push(Row::new("section 3", what("set 1, in SI units"), of(0, 0), None, Gate::Told));
    rows.push(Row::new("section 3", what("set 2, in SI units"), of(1, 0), None, Gate::Told));
    let ratio = Row::new("section 3", "condition number, set 2 over set 1", of(1, 1) / of(0, 1), Some(110.0 / 50.0), Gate::AtLeast(1.0));
    rows.push(ratio.conclusion_only("set 1 is the better one: what the paper selects it for"));
    progress(0.3);
    let (more, plot) = all_sets(&model, progress)?;
    rows.extend(more);
    Ok((rows, plot))
}

/// Every set of six that can be eliminated, on the best of the drawn motions of 4 s.
fn all_sets(model: &Model, progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let motions: Vec<DMatrix<f64>> =
        (0..MOTIONS).map(|seed| observation(model, &drawn_motion(4.0, 101, seed))).collect::<Result<_, PaperError>>()?;
    let of = |w: &DMatrix<f64>| conditions(w)[0][1];
    let best = motions.into_iter().min_by(|a, b| of(a).total_cmp(&of(b)));
    let w = normalised(&columns(&best.unwrap_or_default(), &ACTING));
    // Null space of the acting columns, orthonormal: six columns.
    let r = w.qr().r();
    let svd = r.clone().svd(false, true);
    let v_t = svd.v_t.unwrap_or_default();
    let mut order: Vec<usize> = (0..25).collect();
    order.sort_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]));
    let null = DMatrix::from_fn(25, 6, |i, j| v_t[(order[j], i)]);
    let mut valid = Vec::new();
    subsets(&mut |six| {
        let square = SMatrix::<f64, 6, 6>::from_fn(|i, j| null[(six[i], j)]);
        if square.determinant().abs() > DETERMINANT {
            valid.push(six.to_vec());
        }
    });
    progress(0.5);
    let mut sorted = Vec::new();
    for (i, six) in valid.iter().enumerate() {
        let kept: Vec<usize> = (0..25).filter(|j| !six.contains(j)).collect();
        sorted.push(rank(&r.select_columns(kept.iter())).condition);
        if i % 50 == 0 {
            progress(0.5 + 0.5 * i as f64 / valid.len() as f64);
        }
    }
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.first().copied().unwrap_or(f64::NAN), sorted.last().copied().unwrap_or(f64::NAN));
    let set_1 = rank(
        &r.select_columns(left_by(&SETS[0]).iter().filter_map(|name| ACTING.iter().position(|a| a == name)).collect::<Vec<_>>().iter()),
    );
    let why = "on one motion of 4 s; an independent program counts 969 sets from 216 to 29 085, set 1 at 234, on another";
    let rows = vec![
        Row::new("section 3", "sets of six that can be eliminated, of 177 100", valid.len() as f64, None, Gate::Told).because(
            "those whose determinant in the null space is above 1e-6; the count depends on that limit and on the motion's scaling",
        ),
        Row::new("section 3", "lowest condition number of all sets", low, None, Gate::Told).because(why),
        Row::new("section 3", "highest over lowest condition number of all sets", high / low, None, Gate::AtLeast(20.0)).because(why),
        Row::new("section 3", "set 1 over the lowest", set_1.condition / low, None, Gate::AtMost(2.0)).because(why),
    ];
    let points = sorted.iter().enumerate().map(|(i, c)| (i as f64, math::log10(*c))).collect();
    let level = math::log10(set_1.condition);
    let plot = Plot {
        title: "Condition numbers of all sets of base parameters".to_string(),
        x_label: "sets of six eliminated parameters, in order".to_string(),
        y_label: "log10 of the condition number".to_string(),
        lines: vec![
            Line { label: "all sets".to_string(), points },
            Line { label: "set 1".to_string(), points: vec![(0.0, level), (sorted.len() as f64, level)] },
        ],
    };
    Ok((rows, plot))
}

/// All ways to choose six of 25.
fn subsets(visit: &mut dyn FnMut(&[usize])) {
    let (n, k) = (25, 6);
    let mut at: Vec<usize> = (0..k).collect();
    loop {
        visit(&at);
        let Some(i) = (0..k).rev().find(|&i| at[i] < n - k + i) else { return };
        at[i] += 1;
        for j in i + 1..k {
            at[j] = at[j - 1] + 1;
        }
    }
}
