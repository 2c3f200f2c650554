//! The robot at one state of its drives: the columns that the state shows, and the values that bounds are about.

use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::walk_to;
use pkm_dyn::svd::Svd;
use pkm_dyn::{Data, Model, math};

use super::basis::{DriveState, dot};
use super::effects::{Effect, Seen};
use super::limits::{Bounded, Bounds};
use crate::columns::{Columns, Quantity};

/// Width over which the direction of motion passes through zero while a motion is being improved, as a share of the usual speed. A step
/// has no slope that would say where to go.
const SOFTNESS: f64 = 0.05;

/// How the direction of motion passes through zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    /// Within a width.
    Smooth,
    /// At once.
    Sharp,
}

/// Robot, columns and room to compute in.
#[derive(Clone)]
pub(super) struct Mechanism<'r> {
    pub(super) robot: &'r Robot,
    columns: &'r Columns,
    /// Columns that count.
    kept: &'r [usize],
    /// Effects whose columns come after them.
    effects: &'r [Effect],
    theta: Vec<f64>,
    /// Inertial and rotor columns come first.
    n_rigid: usize,
    data: Data,
    /// Of more drives than freedoms the robot with the first of them, as many as there are freedoms: their motion is what is looked for.
    leading: Option<(Model, Data)>,
    tree: Vec<f64>,
    /// Room for the constraints with respect to the dependent joints, and their smallest singular value in the middle of the travel.
    svd: Svd,
    held: f64,
    /// Whether the distance from singularities is looked at.
    pub(super) is_distance_wanted: bool,
    width: Vec<f64>,
    /// All columns of each drive.
    full: Vec<Vec<f64>>,
    effort: Vec<f64>,
    /// Effort of one effect at each drive.
    alone: Vec<f64>,
    /// Columns that count and effects, drive by drive.
    pub(super) rows: Vec<f64>,
    /// Value of each bound of the robot.
    pub(super) values: Vec<f64>,
}

impl<'r> Mechanism<'r> {
    /// `speed` is the usual speed of each drive `[m/s | rad/s]`.
    pub(super) fn new(
        robot: &'r Robot,
        columns: &'r Columns,
        (kept, effects): (&'r [usize], &'r [Effect]),
        bounds: &Bounds,
        speed: &[f64],
    ) -> Self {
        let model = &robot.model;
        let n_rigid = columns.list.iter().take_while(|p| matches!(p.quantity, Quantity::Inertial { .. } | Quantity::Rotor { .. })).count();
        let mut data = Data::new(model);
        data.q.copy_from_slice(&bounds.tree);
        let centre: Vec<f64> = model.actuators.iter().map(|&j| bounds.tree[j]).collect();
        let _closed_before = walk_to(model, &mut data, &centre);
        let leading = leading(model).map(|model| {
            let mut data = Data::new(&model);
            data.q.copy_from_slice(&bounds.tree);
            let _closed_before = walk_to(&model, &mut data, &bounds.centre);
            (model, data)
        });
        let reduction = leading.as_ref().map_or(&data.reduction, |(_, data)| &data.reduction);
        let width = |j: usize| {
            let square: f64 = speed.iter().enumerate().map(|(k, s)| reduction[(j, k)] * s).map(|x| x * x).sum();
            SOFTNESS * math::sqrt(square)
        };
        let width: Vec<f64> = (0..model.nv()).map(width).collect();
        let mut svd = Svd::new(data.loop_jacobian.nrows(), data.dependent.len());
        let held = distance(&mut svd, &data);
        Self {
            robot,
            columns,
            kept,
            effects,
            theta: columns.nominal(),
            n_rigid,
            width,
            data,
            leading,
            tree: bounds.tree.clone(),
            svd,
            held,
            is_distance_wanted: true,
            full: vec![vec![0.0; columns.len()]; model.n_act()],
            effort: vec![0.0; model.n_act()],
            alone: vec![0.0; model.n_act()],
            rows: vec![0.0; model.n_act() * (kept.len() + effects.len())],
            values: vec![0.0; bounds.robot.len()],
        }
    }

    /// Columns in [`Mechanism::rows`] per drive.
    pub(super) fn n_columns(&self) -> usize {
        self.kept.len() + self.effects.len()
    }

    /// Drives that [`Mechanism::rows`] are of: of those in surplus nothing but a row is looked for.
    pub(super) fn n_drives(&self) -> usize {
        self.full.len()
    }

    /// Effects among them.
    pub(super) fn n_effects(&self) -> usize {
        self.effects.len()
    }

    /// Goes from the middle of the travel to drives' positions `q`, so that the branch of the loops is kept; whether it can.
    pub(super) fn go(&mut self, q: &[f64]) -> bool {
        self.data.q.copy_from_slice(&self.tree);
        let Some((model, data)) = &mut self.leading else { return walk_to(&self.robot.model, &mut self.data, q).is_closed };
        data.q.copy_from_slice(&self.tree);
        let is_closed = walk_to(model, data, q).is_closed;
        self.data.q.copy_from_slice(&data.q);
        is_closed
    }

    /// The robot's motion at `state`, into `data`; whether the loops close there.
    fn moves(&mut self, state: &DriveState) -> bool {
        let model = &self.robot.model;
        let Some((lead, led)) = &mut self.leading else {
            return closed_loop_motion(model, &mut self.data, &state.q, &state.v, &state.a).is_closed;
        };
        led.q.copy_from_slice(&self.data.q);
        if !closed_loop_motion(lead, led, &state.q, &state.v, &state.a).is_closed {
            return false;
        }
        let whole = of_drives(model, led);
        self.data.q.copy_from_slice(&led.q);
        closed_loop_motion(model, &mut self.data, &whole.q, &whole.v, &whole.a).is_closed
    }

    /// Tree coordinates now.
    pub(super) fn tree(&self) -> &[f64] {
        &self.data.q
    }

    /// Puts the robot at tree coordinates from [`Mechanism::tree`].
    pub(super) fn put(&mut self, tree: &[f64]) {
        self.data.q.copy_from_slice(tree);
    }

    /// Fills rows and values at `state`, from a pose nearby; whether the loops close there.
    pub(super) fn look(&mut self, state: &DriveState, bounds: &Bounds, direction: Direction) -> bool {
        if !self.moves(state) {
            return false;
        }
        let model = &self.robot.model;
        let sign = |(v, w): (&f64, &f64)| match direction {
            Direction::Sharp => math::sign(*v),
            Direction::Smooth => math::tanh(*v / w.max(f64::MIN_POSITIVE)),
        };
        let signs: Vec<f64> = self.data.v.iter().zip(&self.width).map(sign).collect();
        self.full.iter_mut().for_each(|row| row.fill(0.0));
        let full = &mut self.full;
        self.columns.fill(model, &mut self.data, &signs, &mut |k, c, x| full[k][c] = x);
        self.fill_rows(&signs);
        self.fill_values(bounds);
        true
    }

    fn fill_rows(&mut self, signs: &[f64]) {
        let (n, model) = (self.n_columns(), &self.robot.model);
        let load: Vec<f64> = self.full.iter().map(|row| dot(&row[..self.n_rigid], &self.theta)).collect();
        self.columns.kept_effort(model, &self.data, signs, &load, &mut self.effort);
        for (k, row) in self.full.iter().enumerate() {
            self.effort[k] += dot(row, &self.theta);
            for (i, &c) in self.kept.iter().enumerate() {
                self.rows[k * n + i] = row[c];
            }
        }
        let Self { robot, columns, full, theta, effort, effects, kept, data, alone, rows, .. } = self;
        let seen = Seen { robot, columns, full, theta, load: &load, effort, signs };
        for (i, e) in effects.iter().enumerate() {
            e.fill(&seen, data, alone);
            for (k, x) in alone.iter().enumerate() {
                rows[k * n + kept.len() + i] = *x;
            }
        }
    }

    fn fill_values(&mut self, bounds: &Bounds) {
        for (value, bound) in self.values.iter_mut().zip(&bounds.robot) {
            *value = match bound.what {
                Bounded::Position => self.data.q[bound.place],
                Bounded::Velocity => self.data.v[bound.place],
                Bounded::Acceleration => self.data.a[bound.place],
                Bounded::Effort => self.effort[bound.place],
                Bounded::Cone => bounds.cones[bound.place].lean(&self.data),
                Bounded::Singularity if self.is_distance_wanted => distance(&mut self.svd, &self.data) / self.held,
                Bounded::Singularity => 1.0,
            };
        }
    }
}

/// Of more drives than freedoms the robot with as many drives as it has freedoms, the first ones; otherwise none.
pub(super) fn leading(model: &Model) -> Option<Model> {
    let freedoms = Data::new(model).n_ind();
    (freedoms < model.n_act()).then(|| {
        let mut out = model.clone();
        out.actuators.truncate(freedoms);
        out
    })
}

/// The motion of all drives of `model` in the tree's motion in `data`.
pub(super) fn of_drives(model: &Model, data: &Data) -> DriveState {
    let of = |x: &[f64]| model.actuators.iter().map(|&j| x[j]).collect();
    DriveState { q: of(&data.q), v: of(&data.v), a: of(&data.a) }
}

/// Smallest singular value of the constraints with respect to the dependent joints, in SI units: zero where locked drives do not hold the
/// mechanism.
fn distance(svd: &mut Svd, data: &Data) -> f64 {
    svd.factor(|i, j| data.loop_jacobian[(i, data.dependent[j])]);
    svd.values().last().copied().unwrap_or(f64::INFINITY)
}
