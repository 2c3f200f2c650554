//! Base parameters of the two published parallel robots: ranks, the printed combinations (misprints corrected), the choice of the
//! eliminated set. Ranks and combinations were computed symbolically and numerically by programs that share no code with this workspace.

use faer::Mat;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::parameters::{InertialParameters, N_INERTIAL, NAMES};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, math};
use pkm_ident::columns::{Columns, Quantity};
use pkm_ident::factor::Factor;
use pkm_ident::grouping::{BaseSet, Choice, structural_factor, well_conditioned};
use pkm_sim::{Reference, ReferenceOptions, Sample};
use pkm_tests::Draw;

const TOLERANCE: f64 = 1e-9;

fn shipped(name: &str) -> Robot {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").robot
}

/// The regressor over random states, and its columns.
fn structure(robot: &Robot) -> (Mat<f64>, Columns) {
    let columns = Columns::new(robot);
    let mut draw = Draw::new(1);
    let factor = structural_factor(robot, &columns, 300, &mut || draw.uniform(0.0..1.0)).expect("the robot moves");
    (factor.triangle(), columns)
}

fn inertial(columns: &Columns) -> Vec<usize> {
    (0..columns.links.len() * N_INERTIAL).collect()
}

fn best(triangle: &Mat<f64>, among: &[usize]) -> BaseSet {
    BaseSet::new(triangle, among, TOLERANCE, Choice::BestConditioned).expect("columns that act")
}

#[test]
fn ranks_of_the_3_prs_are_those_of_the_paper() {
    let robot = shipped("prs3");
    let (triangle, columns) = structure(&robot);
    let all = inertial(&columns);
    let set = best(&triangle, &all);
    assert_eq!((set.kept.len() + set.eliminated.len(), set.rank()), (25, 19), "acting and independent");
    assert!(set.gap > 1e8, "{}", set.gap);
    let rotors = (0..columns.len()).filter(|&i| matches!(columns.list[i].quantity, Quantity::Rotor { .. }));
    let set = best(&triangle, &all.iter().copied().chain(rotors).collect::<Vec<_>>());
    assert!(set.rank() == 22 && set.gap > 1e8, "{}: {}", set.rank(), set.gap);
    // Three legs with the same parameters: their columns add up. Then couplers that are symmetric about their length.
    let links = ["slider", "coupler", "platform"];
    let tied = Mat::from_fn(columns.len(), 3 * N_INERTIAL, |i, j| {
        let name = columns.list[i].name.split_once('.').unwrap_or_default();
        let is_same = name.0.trim_end_matches(char::is_numeric) == links[j / N_INERTIAL] && name.1 == NAMES[j % N_INERTIAL];
        f64::from(u8::from(is_same))
    });
    let seen = triangle.subcols(0, columns.len()) * tied;
    let all: Vec<usize> = (0..3 * N_INERTIAL).collect();
    assert_eq!(best(&seen, &all).rank(), 13);
    // In the coupler's frame here z is what the paper calls y.
    let without_my: Vec<usize> = all.into_iter().filter(|&j| j != N_INERTIAL + 3).collect();
    assert_eq!(best(&seen, &without_my).rank(), 12);
}

const L_R: f64 = 0.513_997;
const L_M: f64 = 0.516_003;

/// The paper's platform frame has its x axis from sphere 1 to sphere 2; ours is turned against it by 150 degrees about z.
fn paper_in_ours() -> Pose {
    Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, 150.0_f64.to_radians()])
}

fn platform_column(mx: f64, my: f64, [ixx, ixy, iyy, izz]: [f64; 4]) -> InertialParameters {
    let paper = InertialParameters { mx, my, ixx, ixy, iyy, izz, ..InertialParameters::default() };
    paper.transformed(&paper_in_ours())
}

#[test]
fn combinations_of_the_3_prs_are_the_printed_ones_corrected() {
    // [Valera2017, Table 1], set 1: the masses of sliders 1, 2, 3, couplers 1, 2 and the platform are eliminated.
    // Corrected against the print: row 1 has a², row 4 c², row 9 is Iyz, rows 10 and 11 have l_r²·(m1 + m2) and l_r·(m1 + m2), rows 12
    // and 14 a plus sign; b = +l_m/2.
    let robot = shipped("prs3");
    let (triangle, columns) = structure(&robot);
    let at = |name: &str| columns.index(name).unwrap_or_else(|| panic!("column {name}"));
    let out = ["slider1.mass", "coupler1.mass", "platform.mass", "slider2.mass", "coupler2.mass", "slider3.mass"].map(at);
    let set = BaseSet::new(&triangle, &inertial(&columns), TOLERANCE, Choice::Without(&out)).expect("the set is independent");
    let coefficient = |kept: &str, eliminated: usize| {
        let i = set.kept.iter().position(|&k| k == at(kept)).unwrap_or_else(|| panic!("{kept} is kept"));
        set.grouping[(i, set.eliminated.iter().position(|&e| e == eliminated).expect("eliminated"))]
    };
    let (a, b, c) = (3.0_f64.sqrt() / 2.0 * L_M, L_M / 2.0, L_M);
    let near = |got: f64, want: f64, what: &str| assert!((got - want).abs() < 1e-9, "{what}: {got} instead of {want}");
    // Of the platform's mass, and of the masses of legs 1 and 2 together (the paper's M, the same in both).
    let of_platform = platform_column(-b, -a, [-a * a, a * b, -b * b, -c * c]);
    let of_legs = platform_column(c - 2.0 * b, -2.0 * a, [-2.0 * a * a, 2.0 * a * b, c * c - 2.0 * b * b, -c * c]);
    for (k, name) in NAMES.iter().enumerate().skip(1) {
        let kept = format!("platform.{name}");
        near(coefficient(&kept, out[2]), of_platform.to_vector()[k], &kept);
        near(coefficient(&kept, out[0]) + coefficient(&kept, out[3]), of_legs.to_vector()[k], &kept);
        near(coefficient(&kept, out[1]) + coefficient(&kept, out[4]), of_legs.to_vector()[k], &kept);
    }
    // The hinge axis is y here and z in the paper.
    for (coupler, slider_out, coupler_out) in [("coupler1", out[0], out[1]), ("coupler2", out[3], out[4])] {
        for e in [slider_out, coupler_out] {
            near(coefficient(&format!("{coupler}.iyy"), e), -L_R * L_R, coupler);
            near(coefficient(&format!("{coupler}.mx"), e), -L_R, coupler);
        }
        near(coefficient(&format!("{coupler}.iyy"), out[2]), 0.0, coupler);
    }
    for (e, times) in [(out[2], 1.0), (out[0], 1.0), (out[3], 1.0)] {
        near(coefficient("coupler3.iyy", e), times * L_R * L_R, "coupler3.iyy");
        near(coefficient("coupler3.mx", e), times * L_R, "coupler3.mx");
        near(coefficient("coupler3.mass", e), times, "coupler3.mass");
    }
    near(coefficient("coupler3.mass", out[5]), 1.0, "coupler3.mass");
    near(coefficient("coupler3.mx", out[5]), 0.0, "coupler3.mx");
    for coupler in ["coupler1", "coupler2", "coupler3"] {
        out.iter().for_each(|&e| near(coefficient(&format!("{coupler}.mz"), e), 0.0, coupler));
    }
    let text = set.text(set.kept.iter().position(|&k| k == at("coupler3.mass")).expect("kept"), &columns);
    assert!(text.starts_with("coupler3.mass + ") && text.ends_with("slider3.mass") && text.matches(".mass").count() == 7, "{text}");
}

/// The regressor along a motion, columns as they are at the samples.
fn along(robot: &Robot, columns: &Columns, options: ReferenceOptions, samples: usize) -> Mat<f64> {
    let model = &robot.model;
    let motion = Reference::draw(model, &options).expect("a motion");
    let (mut data, mut s) = (Data::new(model), Sample::default());
    let mut factor = Factor::new(columns.len());
    assert!(assemble(model, &mut data).is_closed);
    for i in 0..samples {
        motion.at(options.period_s * i as f64 / samples as f64, &mut s);
        if i == 0 {
            assert!(walk_to(model, &mut data, &s.q).is_closed);
        }
        assert!(closed_loop_motion(model, &mut data, &s.q, &s.v, &s.a).is_closed);
        let direction: Vec<f64> = data.v.iter().map(|v| math::sign(*v)).collect();
        let mut rows = vec![vec![0.0; columns.len()]; model.n_act()];
        columns.fill(model, &mut data, &direction, &mut |k, c, x| rows[k][c] = x);
        rows.iter().for_each(|row| factor.push(row, 0.0, 0.0));
    }
    factor.triangle()
}

fn condition(triangle: &Mat<f64>, kept: &[usize]) -> f64 {
    let length = |j: usize| triangle.col(j).norm_l2();
    let scaled = Mat::from_fn(triangle.nrows(), kept.len(), |i, j| triangle[(i, kept[j])] / length(kept[j]));
    let values = scaled.singular_values().expect("numbers");
    values[0] / values[values.len() - 1]
}

/// All ways to choose `k` of `n`.
fn subsets(n: usize, k: usize, visit: &mut dyn FnMut(&[usize])) {
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

#[test]
fn the_search_finds_a_set_nearly_as_good_as_the_best_of_all() {
    let robot = shipped("prs3");
    let (triangle, columns) = structure(&robot);
    let all = inertial(&columns);
    let set = best(&triangle, &all);
    let recorded = along(&robot, &columns, ReferenceOptions { seed: 4, period_s: 4.0, amplitude: 0.6 }, 400);
    // What can be eliminated: six columns that the null space of the 25 acting ones can be solved for.
    let acting: Vec<usize> = set.kept.iter().chain(&set.eliminated).copied().collect();
    let null = Mat::from_fn(25, 6, |i, j| if i < 19 { -set.grouping[(i, j)] } else { f64::from(u8::from(i - 19 == j)) });
    // Of columns at length one, as the count was made.
    let q = Mat::from_fn(25, 6, |i, j| null[(i, j)] * recorded.col(acting[i]).norm_l2()).qr().compute_thin_Q();
    let (mut valid, mut lowest, mut highest) = (0, f64::INFINITY, 0.0_f64);
    subsets(25, 6, &mut |six| {
        let square = Mat::from_fn(6, 6, |i, j| q[(six[i], j)]);
        if square.determinant().abs() > 1e-9 {
            valid += 1;
            let kept: Vec<usize> = (0..25).filter(|i| !six.contains(i)).map(|i| acting[i]).collect();
            let c = condition(&recorded, &kept);
            (lowest, highest) = (lowest.min(c), highest.max(c));
        }
    });
    let found = best(&recorded, &all).condition;
    println!("{valid} sets, condition {lowest:.0} to {highest:.0}, found {found:.0}");
    // Of 177 100 ways. Another program counts 969 in another frame of the platform and with small determinants left out.
    assert!((900..2000).contains(&valid), "{valid}");
    assert!(highest > 20.0 * lowest, "the choice matters");
    assert!(found < 1.1 * lowest, "{found} found, {lowest} possible");
}

#[test]
fn the_3_ups_rpu_has_51_base_parameters_and_56_well_conditioned_columns() {
    let robot = shipped("ups3_rpu1");
    let (triangle, columns) = structure(&robot);
    let of_mass = inertial(&columns);
    assert_eq!(best(&triangle, &of_mass).rank(), 51);
    // Friction of the eleven joints of the legs, as the paper has it: not of the platform's own universal joint.
    let is_of_a_leg = |joint: usize| !["q43", "q44"].contains(&robot.model.joints[joint].name.as_str());
    let friction = (0..columns.len()).filter(|&i| match columns.list[i].quantity {
        Quantity::Viscous { joint } | Quantity::Coulomb { joint } => is_of_a_leg(joint),
        _ => false,
    });
    let both: Vec<usize> = of_mass.iter().copied().chain(friction).collect();
    assert_eq!(best(&triangle, &both).rank(), 73);
    let options = ReferenceOptions { seed: 9, period_s: 20.0, amplitude: 0.8 };
    let recorded = along(&robot, &columns, options, 201);
    let chosen = well_conditioned(&recorded, &both, 300.0);
    let full = best(&recorded, &both);
    println!("{} columns below 300; all {} have {:.0}", chosen.len(), full.rank(), full.condition);
    assert!(chosen.len() >= 56 && condition(&recorded, &chosen) < 300.0, "{}", chosen.len());
    assert!(full.rank() == 73 && full.condition > 3000.0, "all 73 are far from well-conditioned: {}", full.condition);
    assert!((condition(&recorded, &full.kept) / full.condition - 1.0).abs() < 1e-6);
}
