//! Singularities and workspaces: published numbers of the 4-UPS ankle and the 3UPS+1RPU knee, closed forms of planar linkages, and
//! Jacobians assembled otherwise, by finite differences of positions.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

use core::f64::consts::FRAC_PI_4;

use nalgebra::{DMatrix, Matrix2, Vector2, Vector3};
use pkm_dyn::loops::{Coordinate, Guide, Output, Singularities, Singularity, coordinates, solve_positions};
use pkm_dyn::model::{JointKind, LoopClosure, ModelBuilder};
use pkm_dyn::spatial::Pose;
use pkm_dyn::workspace::{Axis, Cause, Cell, Margins, Scanner, Slice, Undetermined, choose, cones, home};
use pkm_dyn::{Data, InertialParameters, Model, kinematics, math};
use pkm_tests::{Draw, SHAPES, drawn_loops};

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_xyz_rpy([x, y, z], [0.0; 3])
}

/// Adds a leg with universal joint (about x, then y), length along z, and a ball at `ball` on the platform; closed at the home pose.
fn ups_leg(builder: &mut ModelBuilder, name: &str, base: Vector3<f64>) {
    let link = |part: &str| format!("{part}_{name}");
    for part in ["cross", "cylinder", "rod"] {
        builder.link(&link(part), InertialParameters::default());
    }
    builder.moving_joint(&link("u"), JointKind::Revolute, ("base", &link("cross")), at(base.x, base.y, base.z), Vector3::x());
    builder.moving_joint(&link("v"), JointKind::Revolute, (&link("cross"), &link("cylinder")), Pose::identity(), Vector3::y());
    builder.moving_joint(&link("l"), JointKind::Prismatic, (&link("cylinder"), &link("rod")), Pose::identity(), Vector3::z());
}

fn close_leg(model: &mut Model, name: &str, ball: Vector3<f64>, leg: Vector3<f64>) {
    let constrain = [true, true, true, false, false, false];
    let a = model.frame_on(name, "platform", at(ball.x, ball.y, ball.z)).unwrap();
    let b = model.frame_on(name, &format!("rod_{name}"), Pose::identity()).unwrap();
    model.add_loop(LoopClosure { name: name.to_string(), a, b, constrain }).unwrap();
    model.add_actuator(&format!("l_{name}"), 0.0).unwrap();
    let u = leg / leg.norm();
    let part = |part: &str| format!("{part}_{name}");
    model.set_assembly(&part("u"), math::atan2(-u.y, u.z)).unwrap();
    model.set_assembly(&part("v"), math::asin(u.x)).unwrap();
    model.set_assembly(&part("l"), leg.norm()).unwrap();
}

/// The 4-UPS ankle of [McDaid], Table 8.2, with its ankle centre at `ankle`: angles from the x axis (the reading that meets the
/// claimed reach), or from the y axis. The balls stay where they are in the base frame when the ankle is elsewhere.
fn ups4(ankle: Vector3<f64>, turned: bool) -> Model {
    let point = |r: f64, degrees: f64, k: usize, z: f64| {
        let (s, c) = math::sin_cos(degrees.to_radians());
        let (s, c) = if turned { (c, s) } else { (s, c) };
        let (side, front) = ([1.0, -1.0, -1.0, 1.0][k], [1.0, 1.0, -1.0, -1.0][k]);
        Vector3::new(side * r * c, front * r * s, z)
    };
    let base = |k: usize| point(if k < 2 { 0.18 } else { 0.2 }, 45.0, k, 0.0);
    let ball = |k: usize| centre() - ankle + point(if k < 2 { 0.08 } else { 0.09 }, 30.0, k, -0.05);
    let mut builder = ModelBuilder::new("ups4", [0.0, 0.0, -9.81]);
    for link in ["base", "shank", "talus", "platform"] {
        builder.link(link, InertialParameters::default());
    }
    builder.moving_joint("rx", JointKind::Revolute, ("base", "shank"), at(ankle.x, ankle.y, ankle.z), Vector3::x());
    builder.moving_joint("ry", JointKind::Revolute, ("shank", "talus"), Pose::identity(), Vector3::y());
    builder.moving_joint("rz", JointKind::Revolute, ("talus", "platform"), Pose::identity(), Vector3::z());
    (0..4).for_each(|k| ups_leg(&mut builder, &format!("{k}"), base(k)));
    let mut model = builder.build().unwrap();
    (0..4).for_each(|k| close_leg(&mut model, &format!("{k}"), ball(k), ankle + ball(k) - base(k)));
    for j in model.actuators.clone() {
        (model.joints[j].limits.lower, model.joints[j].limits.upper) = (0.2725, 0.3725);
    }
    model
}

fn centre() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, 0.36)
}

struct Bench {
    model: Model,
    home: Vec<f64>,
    output: Output,
}

impl Bench {
    fn new(model: Model, output: &str) -> Self {
        let home = home(&model, &mut Data::new(&model)).expect("loops close");
        let output = Output::named(&model, output).expect("an output");
        Self { model, home, output }
    }

    fn singularities(&self, components: &[usize]) -> Singularities {
        Singularities::new(&self.model, &mut Data::new(&self.model), &self.home, self.output.clone(), components, 1.0)
    }

    fn guide(&self, components: &[usize]) -> Guide {
        Guide::new(&self.model, self.output.clone(), components.iter().map(|&k| Coordinate::Output(k)).collect())
    }

    /// Leads the output from home to `values`; the way left is halved again and again, as a singularity there bends it.
    fn led(&self, components: &[usize], values: &[f64]) -> Vec<f64> {
        let (mut data, mut guide) = (Data::new(&self.model), self.guide(components));
        data.q.copy_from_slice(&self.home);
        let mut from = vec![0.0; values.len()];
        guide.values(&self.model, &mut data, &self.home, &mut from);
        for half in (1..=30).map(|k| 1.0 / f64::from(1 << k)).chain([0.0]) {
            let way: Vec<f64> = values.iter().zip(&from).map(|(to, from)| to + (from - to) * half).collect();
            assert!(guide.move_to(&self.model, &mut data, &way), "{values:?} {half}");
        }
        data.q
    }

    fn lead(&self, components: &[usize], values: &[f64]) -> Singularity {
        let q = self.led(components, values);
        self.singularities(components).at(&self.model, &mut Data::new(&self.model), &q)
    }

    fn scanner(&self, components: &[usize], parallel: f64) -> Scanner<'_> {
        let cones = cones(&self.model, &mut Data::new(&self.model), &self.home);
        let margins = Margins { cone: vec![f64::INFINITY; cones.len()], parallel, condition: f64::INFINITY };
        Scanner::new(&self.model, &self.home, self.guide(components), self.singularities(components), (cones, margins))
    }
}

/// Whole degrees around zero.
fn degrees(index: usize, reach: i32) -> Axis {
    Axis { index, values: (-reach..=reach).map(|d| f64::from(d).to_radians()).collect() }
}

/// Reachable whole degrees in both directions from zero.
fn reach(slice: &Slice) -> (usize, usize) {
    let middle = slice.cells.len() / 2;
    let is_free = |c: &&Cell| c.cause == Cause::Reachable;
    let up = slice.cells[middle..].iter().take_while(is_free).count() - 1;
    (up, slice.cells[..=middle].iter().rev().take_while(is_free).count() - 1)
}

#[test]
fn the_ankle_has_the_published_singular_values() {
    let ankle = Bench::new(ups4(centre(), false), "platform");
    let s = ankle.lead(&[3, 4, 5], &[0.0; 3]);
    // Singular values of the legs' Jacobian 0.12047722, 0.05224281, 0.02526894.
    assert!((s.parallel - 0.025_268_94).abs() < 5e-9, "{s:?}");
    assert!((s.serial - 1.0 / 0.120_477_22).abs() < 5e-7 && (s.condition - 0.120_477_22 / 0.025_268_94).abs() < 1e-5, "{s:?}");
    // Lengths at (10, 5, -4) degrees.
    let mut data = Data::new(&ankle.model);
    data.q.copy_from_slice(&ankle.home);
    let pose = [10.0_f64, 5.0, -4.0].map(f64::to_radians);
    assert!(ankle.guide(&[3, 4, 5]).move_to(&ankle.model, &mut data, &pose));
    let lengths: Vec<f64> = ankle.model.actuators.iter().map(|&j| data.q[j]).collect();
    for (length, published) in lengths.iter().zip([0.327_303_83, 0.337_911_91, 0.334_714_2, 0.320_834_71]) {
        assert!((length - published).abs() < 5e-9, "{lengths:?}");
    }
}

#[test]
fn the_ankle_reaches_what_is_published() {
    let ankle = Bench::new(ups4(centre(), false), "platform");
    let mut scanner = ankle.scanner(&[3, 4, 5], 0.0);
    let x = scanner.slice(&degrees(0, 60), None, &[0.0; 3], &mut || ());
    let y = scanner.slice(&degrees(1, 60), None, &[0.0; 3], &mut || ());
    assert_eq!((reach(&x), reach(&y)), ((53, 47), (30, 30)));
    // The legs' strokes end the reach, not the singularities: there is none along X.
    assert!(matches!(x.cells[60 + 54].cause, Cause::Stroke(_)) && matches!(y.cells[60 + 31].cause, Cause::Stroke(_)));
    assert!(x.cells[60 - 47..=60 + 53].iter().all(|c| c.parallel >= 0.025));
    // Towards 30 degrees of Y the rank is being lost.
    let y_at = |d: usize| y.cells[60 + d].parallel;
    assert!((1..=30).all(|d| y_at(d) < y_at(d - 1)) && y_at(30) < 0.2 * y_at(0), "{} {}", y_at(0), y_at(30));
}

#[test]
fn the_ankle_anywhere_in_a_cube_of_30_mm_reaches_what_is_published() {
    let mut common = [(90, 90); 2];
    for k in 0..27 {
        let shift = |axis: usize| 0.015 * [-1.0, 0.0, 1.0][k / [1, 3, 9][axis] % 3];
        let ankle = Bench::new(ups4(centre() + Vector3::new(shift(0), shift(1), shift(2)), false), "platform");
        let mut scanner = ankle.scanner(&[3, 4, 5], 0.0);
        for (axis, common) in common.iter_mut().enumerate() {
            let (up, down) = reach(&scanner.slice(&degrees(axis, 60), None, &[0.0; 3], &mut || ()));
            *common = (common.0.min(up), common.1.min(down));
        }
    }
    assert_eq!(common, [(41, 37), (25, 25)]);
}

#[test]
fn the_other_reading_of_the_ankle_loses_rank_at_36_degrees() {
    let ankle = Bench::new(ups4(centre(), true), "platform");
    let mut scanner = ankle.scanner(&[3, 4, 5], 0.0);
    let x = scanner.slice(&degrees(0, 45), None, &[0.0; 3], &mut || ());
    let lowest = |cells: &[Cell]| (0..cells.len()).min_by(|&a, &b| cells[a].parallel.total_cmp(&cells[b].parallel)).unwrap();
    assert_eq!((lowest(&x.cells[..45]), lowest(&x.cells[45..])), (45 - 36, 36));
    assert!(x.cells[45 - 36].parallel < 0.05 * x.cells[45].parallel);
    // A margin keeps away from it.
    let mut careful = ankle.scanner(&[3, 4, 5], 0.01);
    let x = careful.slice(&degrees(0, 45), None, &[0.0; 3], &mut || ());
    assert!(reach(&x).0 < 32 && x.cells[45 + 35].cause == Cause::Singular, "{:?}", reach(&x));
}

/// Leg lengths of the 3UPS+1RPU knee at (x, z, pitch, yaw): the paper's closed form, eq. 7.
fn knee_lengths(geometry: &[f64; 11], pose: [f64; 4]) -> [f64; 4] {
    let (base, balls, ds) = knee_points(geometry);
    let [x, z, pitch, yaw] = pose;
    let ((st, ct), (sp, cp)) = (math::sin_cos(pitch), math::sin_cos(yaw));
    let r = nalgebra::Matrix3::new(cp * ct, -sp * ct, st, sp, cp, 0.0, -cp * st, sp * st, ct);
    let leg = |k: usize| (Vector3::new(x, 0.0, z) + r * balls[k] - base[k]).norm();
    [leg(0), leg(1), leg(2), (Vector2::new(x - ds, z)).norm()]
}

fn knee_points(g: &[f64; 11]) -> ([Vector3<f64>; 3], [Vector3<f64>; 3], f64) {
    let [r1, r2, r3, ds, bfd, bfi, m1, m2, m3, bmd, bmi] = *g;
    let polar = |r: f64, degrees: f64, side: f64| {
        let (s, c) = math::sin_cos(degrees.to_radians());
        Vector3::new(r * c, side * r * s, 0.0)
    };
    let base = [Vector3::new(-r1, 0.0, 0.0), polar(r2, bfd, 1.0), polar(r3, bfi, -1.0)];
    (base, [Vector3::new(-m1, 0.0, 0.0), polar(m2, bmd, 1.0), polar(m3, bmi, -1.0)], ds)
}

/// Table 1 of Armas: R1 R2 R3, ds, base angles, Rm1 Rm2 Rm3, platform angles (degrees).
const KNEE_START: [f64; 11] = [0.4, 0.4, 0.4, 0.0, 50.0, 40.0, 0.2, 0.2, 0.2, 40.0, 30.0];
const KNEE_FINAL: [f64; 11] = [0.4, 0.4, 0.4, 0.15, 90.0, 45.0, 0.3, 0.3, 0.3, 50.0, 90.0];

fn knee(geometry: &[f64; 11], pose: [f64; 4]) -> Bench {
    let (base, balls, ds) = knee_points(geometry);
    let mut builder = ModelBuilder::new("knee", [0.0, 0.0, -9.81]);
    for link in ["base", "cylinder4", "rod4", "cross4", "platform"] {
        builder.link(link, InertialParameters::default());
    }
    builder.moving_joint("q41", JointKind::Revolute, ("base", "cylinder4"), at(ds, 0.0, 0.0), Vector3::y());
    builder.moving_joint("q42", JointKind::Prismatic, ("cylinder4", "rod4"), Pose::identity(), Vector3::z());
    builder.moving_joint("q43", JointKind::Revolute, ("rod4", "cross4"), Pose::identity(), Vector3::y());
    builder.moving_joint("q44", JointKind::Revolute, ("cross4", "platform"), Pose::identity(), Vector3::z());
    (0..3).for_each(|k| ups_leg(&mut builder, &format!("{k}"), base[k]));
    let mut model = builder.build().unwrap();
    let [x, z, pitch, yaw] = pose;
    let r = Pose::from_xyz_rpy([0.0; 3], [0.0, pitch, 0.0]).compose(&Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, yaw])).rotation;
    for k in 0..3 {
        close_leg(&mut model, &format!("{k}"), balls[k], Vector3::new(x, 0.0, z) + r * balls[k] - base[k]);
    }
    model.add_actuator("q42", 0.0).unwrap();
    let lean = math::atan2(x - ds, z);
    for (joint, value) in [("q41", lean), ("q42", math::hypot(x - ds, z)), ("q43", pitch - lean), ("q44", yaw)] {
        model.set_assembly(joint, value).unwrap();
    }
    Bench::new(model, "platform")
}

#[test]
fn the_knee_is_near_singular_in_its_starting_geometry_and_not_in_its_final_one() {
    let numbers = |geometry: &[f64; 11], z: f64| {
        let s = knee(geometry, [0.0, z, 0.0, 0.0]).lead(&[0, 2, 4, 5], &[0.0, z, 0.0, 0.0]);
        (s.parallel, s.condition)
    };
    for z in [0.2, 0.3, 0.4, 0.5, 0.6, 0.7] {
        // Published: least singular value 0.02, condition 75 to 120; then 0.08 to 0.16.
        let ((start, condition), (end, _)) = (numbers(&KNEE_START, z), numbers(&KNEE_FINAL, z));
        assert!((0.015..0.025).contains(&start) && (75.0..120.0).contains(&condition), "{z}: {start} {condition}");
        assert!((0.075..0.165).contains(&end), "{z}: {end}");
    }
    for (geometry, pose) in [(KNEE_START, [0.03, 0.45, 0.1, -0.2]), (KNEE_FINAL, [-0.04, 0.6, 0.2, -0.1])] {
        // The closed form, differentiated here.
        let h = 1e-6;
        let moved = |k: usize, by: f64| knee_lengths(&geometry, core::array::from_fn(|i| pose[i] + if i == k { by } else { 0.0 }));
        let rows = DMatrix::from_fn(4, 4, |i, k| (moved(k, h)[i] - moved(k, -h)[i]) / (2.0 * h));
        let want = rows.singular_values();
        let got = knee(&geometry, pose).lead(&[0, 2, 4, 5], &pose);
        assert!((got.parallel - want.min()).abs() < 1e-8 && (1.0 / got.serial - want.max()).abs() < 1e-8, "{got:?} {want}");
    }
}

fn shipped(name: &str) -> Model {
    let robot = pkm_robots::find(name).unwrap();
    pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).unwrap().bare
}

/// `dq/dx` of the five-bar by hand: a distal rod is rigid, so its direction `e` sees `e·x' = e·(proximal tip's velocity)`.
fn five_bar_rows(model: &Model, data: &mut Data, q: &[f64]) -> (Matrix2<f64>, f64, [f64; 2]) {
    kinematics::forward_kinematics(model, data, q);
    let elbow = |j: usize| data.pose_wb[j].translation.xy();
    let pin = data.pose_wb[1].transform_point(&Vector3::new(0.35, 0.0, 0.0)).xy();
    let arms = [(0, 1), (2, 3)].map(|(shoulder, e)| {
        let (proximal, distal) = (elbow(e) - elbow(shoulder), (pin - elbow(e)).normalize());
        (distal, distal.dot(&Vector2::new(-proximal.y, proximal.x)))
    });
    let rows = Matrix2::from_rows(&arms.map(|(e, lever)| (e / lever).transpose()));
    (rows, arms[0].0.perp(&arms[1].0), arms.map(|(_, lever)| lever / 0.25))
}

#[test]
fn the_five_bar_has_its_closed_forms_everywhere() {
    let bench = Bench::new(shipped("five_bar"), "pin");
    let (model, mut singularities) = (&bench.model, bench.singularities(&[0, 1]));
    let mut data = Data::new(model);
    let mut seen = (f64::INFINITY, f64::INFINITY);
    for i in -5..=5 {
        for k in -5..=5 {
            data.q.copy_from_slice(&bench.home);
            let drives = [0.12 * f64::from(i), 0.12 * f64::from(k)];
            if !solve_positions(model, &mut data, &drives).is_closed {
                continue;
            }
            let q = data.q.clone();
            let s = singularities.at(model, &mut data, &q);
            let (rows, aligned, elbows) = five_bar_rows(model, &mut data, &q);
            let want = rows.singular_values();
            assert!((s.parallel / want.min() - 1.0).abs() < 1e-8 && (s.serial * want.max() - 1.0).abs() < 1e-8, "{s:?} {want}");
            // Passive coordinates: the pin's two rows with respect to the elbows, so the product of both values is the area.
            assert!((s.passive * s.passive * s.passive_condition - (0.35 * 0.35 * aligned).abs()).abs() < 1e-12);
            seen = (seen.0.min(aligned.abs()), seen.1.min(elbows[0].abs().min(elbows[1].abs())));
        }
    }
    assert!(seen.0 < 0.5 && seen.1 < 0.7, "the poses are of all kinds: {seen:?}");
}

/// The five-bar led up along its symmetry axis stretches both arms at once: type 1. Led to where the distal rods are one line: type 2.
#[test]
fn the_five_bar_is_singular_where_its_arms_stretch_and_where_its_rods_align() {
    let bench = Bench::new(shipped("five_bar"), "pin");
    let reach = |l: f64| math::sqrt(l * l - 0.15 * 0.15);
    let stretched = bench.lead(&[0, 1], &[0.0, reach(0.6) - 1e-7]);
    assert!(stretched.serial < 1e-3 && stretched.parallel > 0.1 && stretched.passive > 0.01, "{stretched:?}");
    // Elbows 0.7 m apart: each 0.2 m outside its shoulder.
    let height = math::sqrt(0.25 * 0.25 - 0.2 * 0.2);
    let aligned = bench.lead(&[0, 1], &[0.0, height + 1e-6]);
    assert!(aligned.parallel < 5e-4 && aligned.serial > 0.05 && aligned.passive < 1e-4, "{aligned:?}");
    // With drives locked the pin moves across the rods.
    let mut singularities = bench.singularities(&[0, 1]);
    let mut data = Data::new(&bench.model);
    let q = bench.led(&[0, 1], &[0.0, height + 1e-6]);
    let _ = singularities.at(&bench.model, &mut data, &q);
    assert!(singularities.loosest_output()[1].abs() > 0.999_999, "{:?}", singularities.loosest_output());
    let mut motion = vec![0.0; 4];
    singularities.loosest_motion(&mut motion);
    assert!(motion[0].abs() + motion[2].abs() < 1e-300 && (motion[1] + motion[3]).abs() < 1e-3 && motion[1].abs() > 0.7, "{motion:?}");
}

#[test]
fn scans_stop_where_the_five_bar_cannot_go() {
    let mut model = shipped("five_bar");
    model.joints.iter_mut().for_each(|j| j.limits = pkm_dyn::model::Limits::default());
    let bench = Bench::new(model, "pin");
    let axis = |index, from: f64, to: f64| Axis { index, values: (0..31).map(|i| from + (to - from) * f64::from(i) / 30.0).collect() };
    let (x, y) = (axis(0, -0.6, 0.6), axis(1, -0.2, 0.7));
    let slice = bench.scanner(&[0, 1], 0.0).slice(&x, Some(&y), &[0.0; 2], &mut || ());
    for (i, cell) in slice.cells.iter().enumerate() {
        let p = Vector2::new(x.values[i % 31], y.values[i / 31]);
        let distances = [-0.15, 0.15].map(|s| (p - Vector2::new(s, 0.0)).norm());
        let is_in_reach = distances.iter().all(|d| (0.1..=0.6).contains(d));
        if is_in_reach && cell.cause == Cause::Open {
            // Only a place that cannot be come to without folding an arm is left out: below the shoulders' line.
            assert!(p.y < 0.15, "{p}");
        }
        assert!(is_in_reach || cell.cause == Cause::Open, "{p} {cell:?}");
        // Elbows outside, by hand: the turn from the left distal rod to the right one tells the side of the type 2 singularity.
        if cell.cause == Cause::Reachable {
            let elbow = |k: usize| {
                let (s, side) = ([-0.15, 0.15][k], [1.0, -1.0][k]);
                let (d, along) = (distances[k], p - Vector2::new(s, 0.0));
                let a = (0.25 * 0.25 - 0.35 * 0.35 + d * d) / (2.0 * d);
                let h = math::sqrt((0.25 * 0.25 - a * a).max(0.0));
                Vector2::new(s, 0.0) + along * (a / d) + Vector2::new(-along.y, along.x) * (side * h / d)
            };
            let [left, right] = [0, 1].map(|k| p - elbow(k));
            assert!(left.perp(&right) > 0.0, "{p}: beyond the singularity");
        }
    }
    let count = |kind: usize| slice.cells.iter().filter(|c| c.cause.kind() == kind).count();
    assert!(count(Cause::Reachable.kind()) > 150 && count(Cause::Beyond.kind()) > 5 && count(Cause::Open.kind()) > 200, "{}", count(0));
}

/// Crank-rocker with crank a, coupler b, rocker c and ground g, driven at the crank; assembled with the rocker above.
fn four_bar(a: f64, b: f64, c: f64, g: f64, crank: f64, driven: &str) -> Bench {
    let mut builder = ModelBuilder::new("four_bar", [0.0, -9.81, 0.0]);
    for link in ["base", "crank", "coupler", "rocker"] {
        builder.link(link, InertialParameters::default());
    }
    builder.moving_joint("crank", JointKind::Revolute, ("base", "crank"), Pose::identity(), Vector3::z());
    builder.moving_joint("coupler", JointKind::Revolute, ("crank", "coupler"), at(a, 0.0, 0.0), Vector3::z());
    builder.moving_joint("rocker", JointKind::Revolute, ("base", "rocker"), at(g, 0.0, 0.0), Vector3::z());
    let mut model = builder.build().unwrap();
    let frame = |link: &str, x: f64| model.frame_on("pin", link, at(x, 0.0, 0.0)).unwrap();
    let closure = LoopClosure {
        name: "pin".to_string(),
        a: frame("coupler", b),
        b: frame("rocker", c),
        constrain: [true, true, false, false, false, false],
    };
    model.add_loop(closure).unwrap();
    let (s, co) = math::sin_cos(crank);
    let tip = Vector2::new(a * co, a * s);
    let to_ground = Vector2::new(g, 0.0) - tip;
    let d = to_ground.norm();
    let lean = math::acos((b * b + d * d - c * c) / (2.0 * b * d));
    let coupler = math::atan2(to_ground.y, to_ground.x) + lean;
    let (s, co) = math::sin_cos(coupler);
    let pin = tip + Vector2::new(b * co, b * s);
    let rocker = math::atan2(pin.y, pin.x - g);
    for (joint, value) in [("crank", crank), ("coupler", coupler - crank), ("rocker", rocker)] {
        model.set_assembly(joint, value).unwrap();
    }
    model.add_actuator(driven, 0.0).unwrap();
    Bench::new(model, if driven == "crank" { "rocker" } else { "crank" })
}

#[test]
fn the_four_bar_transmits_as_its_closed_form_says_and_has_its_dead_points() {
    let (a, b, c, g) = (0.1, 0.25, 0.2, 0.27);
    for crank in [0.3, 1.2, 2.5, 4.0, 5.5] {
        let bench = four_bar(a, b, c, g, crank, "crank");
        let (coupler, rocker) = (bench.home[0] + bench.home[1], bench.home[2]);
        // rocker's rate per crank's rate: a·sin(crank − coupler) / (c·sin(rocker − coupler)).
        let ratio = a * math::sin(crank - coupler) / (c * math::sin(rocker - coupler));
        let s = bench.singularities(&[5]).at(&bench.model, &mut Data::new(&bench.model), &bench.home);
        assert!((s.serial - ratio.abs()).abs() < 1e-12 && (s.parallel - 1.0 / ratio.abs()).abs() < 1e-9, "{s:?} {ratio}");
    }
    // Crank and coupler in line, drawn out and folded: dead points of the rocker as a drive, type 1 with the crank as a drive.
    for reach in [b + a, b - a] {
        let direction = math::acos((g * g + reach * reach - c * c) / (2.0 * g * reach));
        let crank = if reach > b { direction } else { direction + core::f64::consts::PI };
        let by_crank = four_bar(a, b, c, g, crank, "crank");
        let s = by_crank.singularities(&[5]).at(&by_crank.model, &mut Data::new(&by_crank.model), &by_crank.home);
        assert!(s.serial < 1e-8 && s.passive > 0.01, "{s:?}");
        let by_rocker = four_bar(a, b, c, g, crank, "rocker");
        let mut data = Data::new(&by_rocker.model);
        let s = by_rocker.singularities(&[5]).at(&by_rocker.model, &mut data, &by_rocker.model.assembly);
        assert!(s.parallel < 1e-8 && s.passive < 1e-8 && s.constraint > 0.01, "{s:?}");
    }
}

/// A parallelogram lying flat: all constraints lose a rank there, whatever is driven.
#[test]
fn a_flat_parallelogram_is_a_constraint_singularity() {
    let bench = four_bar(0.1, 0.3, 0.1, 0.3, FRAC_PI_4, "crank");
    let mut singularities = bench.singularities(&[5]);
    let mut data = Data::new(&bench.model);
    let open = singularities.at(&bench.model, &mut data, &bench.home);
    let flat = singularities.at(&bench.model, &mut data, &[0.0; 3]);
    assert!(open.constraint > 0.05 && flat.constraint < 1e-15 && flat.passive < 1e-15, "{open:?} {flat:?}");
    let mut motion = vec![0.0; 3];
    singularities.weakest_constraint(&mut motion);
    loop_rate_is_zero(&bench.model, &mut data, &motion);
}

fn loop_rate_is_zero(model: &Model, data: &mut Data, motion: &[f64]) {
    pkm_dyn::loops::loop_gap(model, data, &vec![0.0; model.nv()]);
    let rate = &data.loop_jacobian * nalgebra::DVector::from_column_slice(motion);
    assert!(rate.norm() < 1e-15 && motion.iter().any(|m| m.abs() > 0.1), "{rate}");
}

/// The motoBOTTE ankle of Arceo 2021 as slider d, arm at T1, foot at T2; eq. 3 is the pin, and its determinant with respect to T1 and
/// T2 is D = z1 z4 - z2 z3. Constants of the set that satisfies all printed equations.
#[test]
fn the_one_drive_ankle_has_the_determinant_of_its_paper_and_no_singularity_on_its_way() {
    let (l1, l2, l3, l4, l5) = (0.35, 0.125, 0.4646, 0.1014, 0.15);
    let (g1, g2) = (132.0_f64.to_radians(), 2.0952);
    let down = -Vector3::z();
    let mut builder = ModelBuilder::new("ankle1", [0.0, -9.81, 0.0]);
    for link in ["base", "slider", "arm", "foot"] {
        builder.link(link, InertialParameters::default());
    }
    builder.moving_joint("d", JointKind::Prismatic, ("base", "slider"), Pose::identity(), Vector3::x());
    builder.moving_joint("T1", JointKind::Revolute, ("slider", "arm"), Pose::identity(), down);
    let pivot = at(-l1 - l5 * math::sin(g1), -l5 * math::cos(g1), 0.0);
    builder.moving_joint("T2", JointKind::Revolute, ("base", "foot"), pivot, down);
    let mut model = builder.build().unwrap();
    let frame = |link: &str, x: f64, y: f64| model.frame_on("pin", link, at(x, y, 0.0)).unwrap();
    let constrain = [true, true, false, false, false, false];
    let closure = LoopClosure { name: "pin".to_string(), a: frame("arm", -l3, l2), b: frame("foot", 0.0, -l4), constrain };
    model.add_loop(closure).unwrap();
    model.add_actuator("d", 0.0).unwrap();
    // The oracle's pose at 100 degrees.
    for (joint, value) in [("d", 0.074_722_629_4), ("T1", 0.075_279_800_5), ("T2", -2.194_453_124_7)] {
        model.set_assembly(joint, value).unwrap();
    }
    let bench = Bench::new(model, "foot");
    let mut singularities = bench.singularities(&[5]);
    let mut data = Data::new(&bench.model);
    let mut smallest = f64::INFINITY;
    for degrees in 60..=150 {
        // Inverse kinematics of the paper, corrected.
        let delta = f64::from(degrees).to_radians() + g2 - core::f64::consts::FRAC_PI_2;
        let ((s, c), a) = (math::sin_cos(delta), l5 * math::cos(g1));
        let (a1, a2) = (l2 * c + l3 * s + l4, l2 * s - l3 * c);
        let t2 = math::asin(-a / math::hypot(a1, a2)) - math::atan2(a1, -a2);
        let t1 = delta + t2;
        let ((s1, c1), (s2, c2)) = (math::sin_cos(t1), math::sin_cos(t2));
        let (z1, z2, z3, z4) = (l2 * c1 + l3 * s1, l4 * c2, l3 * c1 - l2 * s1, -l4 * s2);
        let d = -l1 + z3 + z4 - l5 * math::sin(g1);
        let determinant = z1 * z4 - z2 * z3;
        let at = singularities.at(&bench.model, &mut data, &[d, t1, t2]);
        assert!(data.loop_gap.iter().all(|g| g.abs() < 1e-12), "{:?}", data.loop_gap);
        assert!((at.passive * at.passive * at.passive_condition - determinant.abs()).abs() < 1e-14, "{degrees}: {at:?}");
        // T2' = z3 d' / D.
        assert!((at.serial - (z3 / determinant).abs()).abs() < 1e-9 * at.serial, "{degrees}");
        smallest = smallest.min(at.passive * at.passive * at.passive_condition);
        if degrees == 100 {
            assert!((at.serial - 0.340_292_376_3 / 0.03).abs() < 1e-6, "{at:?}");
        }
    }
    // Printed: D from 0.0127, no singularity from 60 to 150 degrees.
    assert!((smallest - 0.0127).abs() < 5e-5, "{smallest}");
}

/// All numbers against nalgebra's decomposition of Jacobians got by moving the mechanism: drives a little, passive joints by Newton.
#[test]
fn drawn_mechanisms_have_the_singular_values_of_their_finite_differences() {
    let mut counted = 0;
    for (seed, shape) in (0..12).flat_map(|seed| SHAPES.map(|shape| (seed, shape))) {
        let mut draw = Draw::new(700 + seed);
        let model = drawn_loops(shape, &mut draw);
        let last = model.links.iter().rfind(|l| l.body.is_some()).unwrap().name.clone();
        let bench = Bench::new(model, &last);
        let (model, n) = (&bench.model, bench.model.n_act());
        let components: Vec<usize> = (0..6).collect();
        let mut data = Data::new(model);
        let drives: Vec<f64> = model.actuators.iter().map(|&j| bench.home[j]).collect();
        let mut pose = |by: f64, k: usize| {
            data.q.copy_from_slice(&bench.home);
            let mut moved = drives.clone();
            moved[k] += by;
            assert!(solve_positions(model, &mut data, &moved).is_closed);
            coordinates(&bench.output.pose(&data))
        };
        let h = 1e-5;
        let differences = DMatrix::from_fn(6, n, |i, k| {
            let unit = if model.joints[model.actuators[k]].kind == JointKind::Prismatic { 0.7 } else { 1.0 };
            let change = pose(h, k)[i] - pose(-h, k)[i];
            change / (2.0 * h) * unit / if i < 3 { 0.7 } else { 1.0 }
        });
        let mut want = differences.singular_values().as_slice().to_vec();
        want.sort_by(|a, b| b.total_cmp(a));
        let mut singularities = Singularities::new(model, &mut Data::new(model), &bench.home, bench.output.clone(), &components, 0.7);
        let s = singularities.at(model, &mut Data::new(model), &bench.home);
        let smallest = want[n.min(6) - 1];
        assert!((1.0 / s.parallel - want[0]).abs() < 1e-6 * (1.0 + want[0]), "{shape:?} {seed}: {s:?} {want:?}");
        assert!((s.serial - smallest).abs() < 1e-6 * (1.0 + want[0]), "{shape:?} {seed}: {s:?} {want:?}");
        counted += usize::from(smallest > 1e-3);
    }
    assert!(counted > 5, "{counted}");
}

#[test]
fn independent_coordinates_are_chosen_and_parasitic_ones_left() {
    let chosen = |name: &str, wanted: &[usize]| {
        let model = shipped(name);
        let output = Output::evident(&model).expect("one link stands out").name;
        let bench = Bench::new(model, &output);
        let all: Vec<usize> = (0..6).collect();
        let mut singularities = bench.singularities(&all);
        let _ = singularities.at(&bench.model, &mut Data::new(&bench.model), &bench.home);
        let as_output = |k: &[usize]| k.iter().map(|&k| Coordinate::Output(k)).collect::<Vec<_>>();
        choose(&singularities, &as_output(wanted), &as_output(&all), 1.0)
    };
    let outputs = |k: &[usize]| k.iter().map(|&k| Coordinate::Output(k)).collect::<Vec<_>>();
    assert_eq!(chosen("prs3", &[]).unwrap(), outputs(&[2, 3, 4]));
    assert_eq!(chosen("ups3_rpu1", &[]).unwrap(), outputs(&[0, 2, 4, 5]));
    assert_eq!(chosen("ups3_rpu1", &[4, 0]).unwrap(), outputs(&[4, 0, 2, 5]));
    assert_eq!(chosen("five_bar", &[]).unwrap(), outputs(&[0, 1]));
    // Its wrist is straight at home.
    assert_eq!(chosen("serial_arm", &[]), Err(Undetermined::TooFew { found: 5, freedoms: 6 }));
    assert!(chosen("ups3_rpu1", &[1]).is_err(), "y is held by the middle leg");
    assert!(chosen("five_bar", &[0, 1, 5]).is_err());
}

#[test]
fn a_cone_is_the_angle_between_leg_and_platform() {
    let ankle = Bench::new(ups4(centre(), false), "platform");
    let mut data = Data::new(&ankle.model);
    let all = cones(&ankle.model, &mut data, &ankle.home);
    // A ball and a universal joint for each leg; the ankle itself has no leg.
    assert_eq!(all.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["0", "1", "2", "3", "u_0", "u_1", "u_2", "u_3"]);
    let direction = |data: &Data, k: usize| {
        let rod = ankle.model.loops[k].b.body.unwrap();
        data.pose_wb[rod].rotation * Vector3::z()
    };
    let before: Vec<Vector3<f64>> = (0..4).map(|k| direction(&data, k)).collect();
    data.q.copy_from_slice(&ankle.home);
    assert!(ankle.guide(&[3, 4, 5]).move_to(&ankle.model, &mut data, &[0.4, 0.1, -0.2]));
    let q = data.q.clone();
    kinematics::forward_kinematics(&ankle.model, &mut data, &q);
    let platform = ankle.output.pose(&data).rotation;
    for k in 0..4 {
        let in_platform = platform.transpose() * direction(&data, k);
        assert!((all[k].lean(&data) - in_platform.angle(&before[k])).abs() < 1e-7);
        assert!((all[4 + k].lean(&data) - direction(&data, k).angle(&before[k])).abs() < 1e-7);
        assert!(all[k].lean(&data) > 0.2);
    }
}
