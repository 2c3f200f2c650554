//! What several test files share: robots drawn at random from a seed, their energy, a tiny CSV reader, a comparison of tables.

extern crate alloc;

#[path = "controllers/closed_loop.rs"]
pub mod closed_loop;
pub mod concealing;
pub mod fuzzing;

use alloc::collections::BTreeMap;
use core::ops::Range;

use std::path::Path;

use nalgebra::{DVector, Matrix3, Vector3};
use pkm_dyn::loops::{assemble, loop_gap};
use pkm_dyn::model::{Compound, FrameOnBody, JointKind, LoopClosure, ModelBuilder};
use pkm_dyn::spatial::Pose;
use pkm_dyn::{Data, InertialParameters, Model, elimination::Elimination, kinematics, math};

/// Numbers drawn from a seed, the same on every machine (`SplitMix64`).
#[derive(Debug, Clone)]
pub struct Draw(u64);

impl Draw {
    /// A stream of its own for every seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `range`.
    pub fn uniform(&mut self, range: Range<f64>) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        range.start + unit * (range.end - range.start)
    }

    /// One of `n` choices.
    pub fn choice(&mut self, n: usize) -> usize {
        // Below `n`, so the fallback is never taken.
        usize::try_from(self.bits() % n as u64).unwrap_or(0)
    }

    /// `n` uniform numbers.
    pub fn vector(&mut self, n: usize, range: Range<f64>) -> Vec<f64> {
        (0..n).map(|_| self.uniform(range.clone())).collect()
    }

    /// A direction in space.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::from_fn(|_, _| self.uniform(-1.0..1.0));
            if (0.1..1.0).contains(&v.norm()) {
                return v.normalize();
            }
        }
    }

    /// A frame within `reach` `[m]`, turned at will.
    pub fn pose(&mut self, reach: f64) -> Pose {
        let r = -reach..reach;
        let xyz = [self.uniform(r.clone()), self.uniform(r.clone()), self.uniform(r)];
        Pose::from_xyz_rpy(xyz, [self.uniform(-3.0..3.0), self.uniform(-1.5..1.5), self.uniform(-3.0..3.0)])
    }

    /// A body that some mass density has: a box somewhere near the frame.
    pub fn body(&mut self) -> InertialParameters {
        let mass = self.uniform(0.3..3.0);
        let e = Vector3::from_fn(|_, _| self.uniform(0.05..0.5));
        let central = (Matrix3::identity() * e.dot(&e) - Matrix3::from_diagonal(&e.component_mul(&e))) * (mass / 12.0);
        InertialParameters::from_centre_of_mass(mass, Vector3::zeros(), central).transformed(&self.pose(0.3))
    }

    fn kind(&mut self) -> JointKind {
        if self.choice(3) == 0 { JointKind::Prismatic } else { JointKind::Revolute }
    }
}

/// A tree of `n` joints, every joint driven, with rotors: chains and branches, revolute and prismatic joints in all directions.
///
/// # Panics
/// Never: the names are unique.
#[must_use]
pub fn drawn_tree(n: usize, draw: &mut Draw) -> Model {
    let mut model = bare_tree(n, draw);
    for k in 0..n {
        let rotor = draw.uniform(0.0..0.3);
        model.add_actuator(&format!("j{k}"), rotor).expect("joint is there");
    }
    model
}

fn bare_tree(n: usize, draw: &mut Draw) -> Model {
    let gravity = [draw.uniform(-3.0..3.0), draw.uniform(-3.0..3.0), -9.81];
    let mut builder = ModelBuilder::new("drawn", gravity);
    builder.link("base", InertialParameters::default());
    for k in 0..n {
        // Half of the joints lengthen the chain, the others branch off anywhere.
        let parent = if draw.choice(2) == 0 { k } else { draw.choice(k + 1) };
        let parent = if parent == 0 { "base".to_string() } else { format!("l{}", parent - 1) };
        let child = format!("l{k}");
        builder.link(&child, draw.body());
        builder.moving_joint(&format!("j{k}"), draw.kind(), (&parent, &child), draw.pose(0.5), draw.direction());
    }
    builder.build().expect("a drawn tree is a tree")
}

/// A tree of `n` joints of every kind (balls, planes, flying bodies and universal joints among them), with rotors on joints of one
/// coordinate.
///
/// # Panics
/// Never: the names are unique.
#[must_use]
pub fn drawn_mixed_tree(n: usize, draw: &mut Draw) -> Model {
    let mut builder = ModelBuilder::new("mixed", [draw.uniform(-3.0..3.0), draw.uniform(-3.0..3.0), -9.81]);
    builder.link("base", InertialParameters::default());
    for k in 0..n {
        let parent = if draw.choice(2) == 0 { k } else { draw.choice(k + 1) };
        let parent = if parent == 0 { "base".to_string() } else { format!("l{}", parent - 1) };
        let (name, child, placement) = (format!("j{k}"), format!("l{k}"), draw.pose(0.5));
        builder.link(&child, draw.body());
        match draw.choice(6) {
            0 => builder.compound_joint(&name, Compound::Spherical, (&parent, &child), placement),
            1 => builder.compound_joint(&name, Compound::Planar, (&parent, &child), placement),
            2 => builder.compound_joint(&name, Compound::Free, (&parent, &child), placement),
            3 => builder.universal_joint(&name, (&parent, &child), placement, [draw.direction(), draw.direction()]),
            _ => builder.moving_joint(&name, draw.kind(), (&parent, &child), placement, draw.direction()),
        };
    }
    let mut model = builder.build().expect("a drawn tree is a tree");
    for joint in model.joints.iter_mut().filter(|j| j.is_whole()) {
        joint.armature = draw.uniform(0.0..0.3);
    }
    model
}

/// The inertial parameters of all bodies, one under the other.
#[must_use]
pub fn parameters(model: &Model) -> DVector<f64> {
    DVector::from_iterator(10 * model.nv(), model.bodies.iter().flat_map(|b| b.to_vector().iter().copied().collect::<Vec<_>>()))
}

/// Which loop mechanism to draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Two chains in a plane, pinned: `x y`.
    Planar,
    /// The same, with all five motions a pin forbids in space: three rows are redundant.
    PlanarOverdetermined,
    /// Two or three chains in space, their ends held by balls, pins, or any other subset of the six motions.
    Spatial,
}

/// All shapes.
pub const SHAPES: [Shape; 3] = [Shape::Planar, Shape::PlanarOverdetermined, Shape::Spatial];

/// Subsets of the six forbidden motions that real joints have, and the single rows.
const JOINTS: [&[usize]; 9] = [&[0, 1, 2], &[0, 1, 2, 3, 4], &[0, 1, 2, 3, 4, 5], &[0, 1], &[3, 4], &[3], &[4], &[5], &[2, 3, 4, 5]];

/// A closed-loop mechanism that is closed at its assembly and well away from a singularity; drives are the coordinates that the
/// constraints leave free.
///
/// # Panics
/// Never: redrawn until it is sound.
#[must_use]
pub fn drawn_loops(shape: Shape, draw: &mut Draw) -> Model {
    loop {
        let mut model = match shape {
            Shape::Planar => planar(&[0, 1], draw),
            Shape::PlanarOverdetermined => planar(&[0, 1, 2, 3, 4], draw),
            Shape::Spatial => spatial(draw),
        };
        let mut data = Data::new(&model);
        let home = model.assembly.clone();
        loop_gap(&model, &mut data, &home);
        let mut all = Elimination::new(model.n_constraints(), model.nv());
        all.factor(|i, j| data.loop_jacobian[(i, j)]);
        let free = all.free_columns().to_vec();
        if free.is_empty() || all.smallest_pivot_ratio() < 0.05 {
            continue;
        }
        for j in free {
            let name = model.joints[j].name.clone();
            model.add_actuator(&name, draw.uniform(0.0..0.3)).expect("joint is there");
        }
        let mut data = Data::new(&model);
        let closure = assemble(&model, &mut data);
        if closure.is_closed && closure.pivot_ratio > 0.05 {
            return model;
        }
    }
}

fn planar(rows: &[usize], draw: &mut Draw) -> Model {
    let mut builder = ModelBuilder::new("planar", [0.0, -9.81, 0.0]);
    builder.link("base", InertialParameters::default());
    let lengths = [2, 1 + draw.choice(2)];
    for (side, &length) in lengths.iter().enumerate() {
        let mut parent = "base".to_string();
        for k in 0..length {
            let child = format!("l{side}{k}");
            builder.link(&child, draw.body());
            let xyz = [draw.uniform(-0.6..0.6), draw.uniform(-0.6..0.6), 0.0];
            let placement = Pose::from_xyz_rpy(xyz, [0.0, 0.0, draw.uniform(-2.0..2.0)]);
            let axis = |kind| if kind == JointKind::Revolute { Vector3::z() } else { Vector3::x() };
            let kind = if k == 0 { draw.kind() } else { JointKind::Revolute };
            builder.moving_joint(&format!("j{side}{k}"), kind, (&parent, &child), placement, axis(kind));
            parent = child;
        }
    }
    let mut model = builder.build().expect("two chains are a tree");
    model.assembly = draw.vector(model.nv(), -0.5..0.5);
    let frame_a = Pose::from_xyz_rpy([draw.uniform(-0.4..0.4), draw.uniform(-0.4..0.4), 0.0], [0.0; 3]);
    // A pin far turned from its zero: the rotation vector is long, as in a real assembly.
    let turn = Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, draw.uniform(-2.4..2.4)]);
    close(&mut model, "pin", [last(&lengths, 0), last(&lengths, 1)], [frame_a, turn], rows);
    model
}

fn last(lengths: &[usize; 2], side: usize) -> String {
    format!("l{side}{}", lengths[side] - 1)
}

fn spatial(draw: &mut Draw) -> Model {
    let n = 5 + draw.choice(5);
    let mut model = bare_tree(n, draw);
    model.assembly = draw.vector(n, -0.6..0.6);
    let n_loops = 1 + draw.choice(2);
    for k in 0..n_loops {
        let rows = JOINTS[draw.choice(JOINTS.len())];
        // Between two moving links most of the time: to the base, a rotating frame a would go untested.
        let a = draw.choice(n + 1) * draw.choice(8).min(1);
        let link = |i: usize| if i == 0 { "base".to_string() } else { format!("l{}", i - 1) };
        let b = 1 + draw.choice(n);
        if a == b || model.n_constraints() + rows.len() >= n {
            continue;
        }
        // The motions the joint allows are anywhere: a slide for x y z, a turn that keeps forbidden components zero.
        let mut free = Pose::from_xyz_rpy([0, 1, 2].map(|i| if rows.contains(&i) { 0.0 } else { draw.uniform(-0.3..0.3) }), [0.0; 3]);
        let allowed = Vector3::from_fn(|i, _| if rows.contains(&(3 + i)) { 0.0 } else { draw.uniform(-1.2..1.2) });
        free.rotation = nalgebra::Rotation3::new(allowed).into_inner();
        close(&mut model, &format!("loop{k}"), [link(a), link(b)], [draw.pose(0.3), free], rows);
    }
    model
}

/// Closes the tree where it stands at its assembly: frame b is put where `free`, an allowed motion, takes frame a.
fn close(model: &mut Model, name: &str, links: [String; 2], [in_a, free]: [Pose; 2], rows: &[usize]) {
    let mut data = Data::new(model);
    let home = model.assembly.clone();
    kinematics::forward_kinematics(model, &mut data, &home);
    let world = |f: &FrameOnBody| f.body.map_or(f.pose, |b| data.pose_wb[b].compose(&f.pose));
    let a = model.frame_on(name, &links[0], in_a).expect("link is there");
    let on_b = model.frame_on(name, &links[1], Pose::identity()).expect("link is there");
    let in_b = world(&on_b).inverse().compose(&world(&a)).compose(&free);
    let b = FrameOnBody { body: on_b.body, pose: on_b.pose.compose(&in_b) };
    let mut constrain = [false; 6];
    for &k in rows {
        constrain[k] = true;
    }
    model.add_loop(LoopClosure { name: name.to_string(), a, b, constrain }).expect("loop names are unique");
}

/// Kinetic plus potential energy of bodies and rotors at tree coordinates `q` and velocities `v` `[J]`.
#[must_use]
pub fn energy(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) -> f64 {
    kinematics::forward_kinematics(model, data, q);
    kinematics::forward_velocities(model, data, v);
    let mut sum = 0.0;
    for (i, body) in model.bodies.iter().enumerate() {
        let velocity = data.velocity[i];
        sum += 0.5 * velocity.dot(&body.inertia().apply(&velocity)) + 0.5 * model.joints[i].armature * v[i] * v[i];
        let x = &data.pose_wb[i];
        sum -= model.gravity.dot(&(x.rotation * body.first_moment() + x.translation * body.mass));
    }
    sum
}

/// A CSV recording as columns by name; lines that start with `#` are comments, empty fields are NaN.
///
/// # Panics
/// When the file cannot be read or a field is no number.
#[must_use]
pub fn read_csv(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let text = std::fs::read_to_string(path).expect("a readable recording");
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns = vec![Vec::new(); names.len()];
    for line in lines {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.push(if field.is_empty() { f64::NAN } else { field.parse().expect("a number") });
        }
    }
    names.into_iter().map(str::to_string).zip(columns).collect()
}

/// Largest difference of two tables over the largest entry of the second (at least `floor`).
///
/// # Panics
/// With tables of different lengths.
#[must_use]
pub fn relative_error(got: &[f64], want: &[f64], floor: f64) -> f64 {
    assert_eq!(got.len(), want.len(), "tables of one size");
    let scale = want.iter().fold(floor, |top, x| top.max(x.abs()));
    // `max` would drop a NaN.
    got.iter().zip(want).fold(0.0, |worst, (g, w)| if (g - w).abs() <= worst { worst } else { (g - w).abs() }) / scale
}

/// Nine-point central difference of `f` at zero with step `h`: the error falls with the eighth power of `h`.
pub fn derivative(h: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let weights = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let mut sum = 0.0;
    for (k, w) in weights.iter().enumerate() {
        let x = h * (k + 1) as f64;
        sum += w * (f(x) - f(-x));
    }
    sum / h
}

/// As [`derivative`], of a vector.
pub fn derivative_of_vector(h: f64, n: usize, mut f: impl FnMut(f64) -> Vec<f64>) -> Vec<f64> {
    let mut out = vec![0.0; n];
    let weights = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    for (k, w) in weights.iter().enumerate() {
        let x = h * (k + 1) as f64;
        for ((o, plus), minus) in out.iter_mut().zip(f(x)).zip(f(-x)) {
            *o += w * (plus - minus) / h;
        }
    }
    out
}

/// A smooth motion of the drives around a centre: position, velocity, acceleration at time `t` `[s]`.
#[derive(Debug, Clone)]
pub struct Motion {
    centre: Vec<f64>,
    amplitude: Vec<f64>,
    rate: Vec<f64>,
}

impl Motion {
    /// Sines of different rates about the assembly, starting there at `t = 0`.
    pub fn about_assembly(model: &Model, amplitude: f64, draw: &mut Draw) -> Self {
        Self {
            centre: model.actuators.iter().map(|&j| model.assembly[j]).collect(),
            amplitude: (0..model.n_act()).map(|_| amplitude * draw.uniform(0.3..1.0)).collect(),
            rate: draw.vector(model.n_act(), 1.0..3.0),
        }
    }

    /// Position, velocity and acceleration of every drive.
    #[must_use]
    pub fn at(&self, t: f64) -> [Vec<f64>; 3] {
        let row = |f: &dyn Fn(usize) -> f64| (0..self.centre.len()).map(f).collect::<Vec<f64>>();
        let (c, a, r) = (&self.centre, &self.amplitude, &self.rate);
        [
            row(&|k| c[k] + a[k] * math::sin(r[k] * t)),
            row(&|k| a[k] * r[k] * math::cos(r[k] * t)),
            row(&|k| -a[k] * r[k] * r[k] * math::sin(r[k] * t)),
        ]
    }
}

/// Writes a table of the long tier to `PKM_RESULTS/<name>.md` with the commit it was run on; prints it where no folder is given.
///
/// # Panics
/// When the folder cannot be written to.
#[expect(clippy::print_stdout, reason = "a test's table that cannot be written must not pass for one that was")]
pub fn results_table(name: &str, table: &str) {
    let commit = std::env::var("PKM_COMMIT").unwrap_or_else(|_| "not stated".to_string());
    let text = format!("# {name}\n\nCommit: {commit}\n\n{table}");
    match std::env::var_os("PKM_RESULTS") {
        Some(folder) => std::fs::write(Path::new(&folder).join(format!("{name}.md")), text).expect("a results folder that can be written"),
        None => println!("{text}"),
    }
}

/// Name and text of every example file of the documentation in `folder`, by name.
///
/// # Panics
/// When the folder is not there or a file cannot be read.
#[must_use]
pub fn examples(folder: &str) -> Vec<(String, String)> {
    let at = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/examples").join(folder);
    let mut out = Vec::new();
    for entry in std::fs::read_dir(at).expect("the examples") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        out.push((format!("docs/examples/{folder}/{name}"), std::fs::read_to_string(&path).expect("a text")));
    }
    out.sort();
    out
}
