//! A slider along a sine, and the laws of the catalogue on it: what columns are compared with.

use pkm_dyn::effects::{JointState, Law, LinkState, Robot, find};
use pkm_dyn::math;
use pkm_dyn::model::{JointKind, Model, ModelBuilder};
use pkm_dyn::parameters::InertialParameters;
use pkm_dyn::spatial::Pose;

use crate::columns::{Columns, Context, Shape, Source, View};
use crate::design::{Chain, Series};
use crate::motion::{Motion, motion, top_speed};
use crate::segment::Segment;
use crate::shelf::Shelf;
use crate::verdict::Use;

pub(crate) struct Bench {
    pub(crate) model: Model,
    pub(crate) motion: Motion,
}

/// Ten seconds at 500 Hz.
const SAMPLES: usize = 5000;
const DT: f64 = 2e-3;

fn sliders(n: usize) -> Model {
    let mut builder = ModelBuilder::new("sliders", [0.0, 0.0, -9.81]);
    builder.link("base", InertialParameters::default());
    let body = InertialParameters::from_centre_of_mass(2.0, nalgebra::Vector3::zeros(), nalgebra::Matrix3::identity() * 0.01);
    for k in 0..n {
        let parent = if k == 0 { "base".to_string() } else { format!("link{}", k - 1) };
        let child = format!("link{k}");
        builder.link(&child, body);
        let axis = if k == 0 { nalgebra::Vector3::x() } else { nalgebra::Vector3::y() };
        builder.moving_joint(&format!("j{k}"), JointKind::Prismatic, (&parent, &child), Pose::identity(), axis);
    }
    let mut model = builder.build().expect("a chain is a tree");
    for k in 0..n {
        model.add_actuator(&format!("j{k}"), 0.0).expect("the joint is there");
    }
    model
}

impl Bench {
    /// One slider along x: `amplitude·sin` at `hz`.
    pub(crate) fn sine(amplitude: f64, hz: f64) -> Self {
        Self::new(&[[amplitude, hz]])
    }

    /// Two sliders in series, across each other.
    pub(crate) fn pair() -> Self {
        Self::new(&[[0.2, 1.0], [0.1, 0.7]])
    }

    fn new(sines: &[[f64; 2]]) -> Self {
        let model = sliders(sines.len());
        let rate = |hz: f64| core::f64::consts::TAU * hz;
        let row = |f: &dyn Fn(f64, f64, f64) -> f64| -> Vec<Vec<f64>> {
            sines.iter().map(|[a, hz]| (0..SAMPLES).map(|i| f(*a, rate(*hz), rate(*hz) * DT * i as f64)).collect()).collect()
        };
        let segment = Segment {
            name: "sine".to_string(),
            samples: SAMPLES,
            duration: DT * SAMPLES as f64,
            used: Use::Both,
            start: 0.0,
            dt: DT,
            q: row(&|a, _, x| a * math::sin(x)),
            v: row(&|a, w, x| a * w * math::cos(x)),
            a: row(&|a, w, x| -a * w * w * math::sin(x)),
            tau: row(&|_, _, _| 0.0),
            warmth: vec![Vec::new(); sines.len()],
            band: 5.0,
            wrenches: Vec::new(),
            channels: Vec::new(),
            extra: alloc::collections::BTreeMap::default(),
            valid: vec![true; SAMPLES],
            gravity: None,
            load: None,
            shelf: Shelf::default(),
        };
        let motion = motion(&Robot::new(model.clone(), Vec::new()), segment).expect("sliders have no loops");
        Self { model, motion }
    }

    /// Shapes of the effect's candidate of that number; none when there is no such candidate.
    pub(crate) fn shapes(&self, effect: &dyn Columns, number: usize) -> Vec<Shape> {
        let (m, n) = (&self.motion, self.model.n_act());
        let top: Vec<f64> = (0..n).map(|k| top_speed(&m.segment.v[k])).collect();
        let range: Vec<[f64; 2]> =
            m.segment.q.iter().map(|q| [q.iter().copied().fold(f64::MAX, f64::min), q.iter().copied().fold(f64::MIN, f64::max)]).collect();
        let travel: Vec<f64> = range.iter().map(|[low, high]| high - low).collect();
        let ctx = Context {
            model: &self.model,
            widths: &m.turns,
            top_speed: &top,
            travel: &travel,
            range: &range,
            motions: core::slice::from_ref(m),
            band: 5.0,
            massive: &self.model.massive_links(),
        };
        effect.propose(&ctx).into_iter().nth(number).map(|p| p.shapes).unwrap_or_default()
    }

    /// Parameters of an effect in the catalogue's order, from a reading.
    pub(crate) fn values(&self, effect: &str, reading: &[(&'static str, f64)]) -> Vec<f64> {
        let entry = find(effect).expect("an effect of the catalogue");
        let value = |name: &str| reading.iter().find(|(n, _)| *n == name).map(|(_, v)| *v);
        entry.parameters.iter().map(|p| value(p.name).or(p.default).expect("every parameter is read or has a default")).collect()
    }

    /// The catalogue's law at sample `i` of the first slider.
    pub(crate) fn effort(&self, effect: &str, values: &[f64], i: usize) -> f64 {
        self.effort_beside(effect, values, 0.0, i)
    }

    /// The same beside nominal dry friction.
    pub(crate) fn effort_beside(&self, effect: &str, values: &[f64], coulomb: f64, i: usize) -> f64 {
        let Some(Law::JointEffort(law)) = find(effect).map(|e| e.law) else { panic!("{effect} is no effort of a joint") };
        let (s, time) = (&self.motion.segment, DT * i as f64);
        let viscous = self.model.joints[0].viscous;
        let [q, v, a] = [s.q[0][i], s.v[0][i], s.a[0][i]];
        let load = self.motion.rigid[0][i];
        law(values, &JointState { q, v, a, sign: math::sign(v), load, viscous, coulomb, warmth: time, time })
    }

    /// The catalogue's wrench law at the joint of the first slider.
    pub(crate) fn push_at_joint(&self, effect: &str, values: &[f64], i: usize) -> f64 {
        let Some(Law::Wrench(law)) = find(effect).map(|e| e.law) else { panic!("{effect} is no wrench") };
        let s = &self.motion.segment;
        let mut state = LinkState { time: DT * i as f64, ..LinkState::default() };
        (state.position[0], state.displacement[0], state.velocity[0]) = (s.q[0][i], s.q[0][i] - s.q[0][0], s.v[0][i]);
        law(values, &state)[0]
    }

    /// Largest rigid effort.
    pub(crate) fn load_peak(&self) -> f64 {
        self.motion.rigid[0].iter().fold(0.0, |top, x| top.max(x.abs()))
    }

    /// Whether the first slider is fast enough for the direction of motion to be out of its smoothing.
    pub(crate) fn is_clear(&self, i: usize) -> bool {
        let v = &self.motion.segment.v[0];
        v[i].abs() > 0.2 * top_speed(v)
    }

    /// The column is the law wherever the direction of motion is out of its smoothing, within a share of its peak.
    pub(crate) fn assert_column(&self, source: &Source, law: impl Fn(usize) -> f64, share: f64) {
        let column = series(source, &self.motion);
        let peak = column.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        assert!(peak > 0.0, "the column is zero");
        for i in (0..column.len()).filter(|&i| self.is_clear(i)) {
            assert!((column[i] - law(i)).abs() <= share * peak, "{} instead of {} at sample {i}", column[i], law(i));
        }
    }
}

/// All series of a new column.
pub(crate) fn all_series(source: &Source, motion: &Motion) -> Series {
    let Source::New(make) = source else { panic!("a new column") };
    make(motion)
}

/// The series of a new column that acts on one drive.
pub(crate) fn series(source: &Source, motion: &Motion) -> Vec<f64> {
    all_series(source, motion).swap_remove(0).1
}

/// A fit at the first joint.
pub(crate) fn view<'v>(model: &'v Model, own: &'v [f64], shape: &'v [f64]) -> View<'v> {
    View { model, own, shape, place: 0, coulomb_change: 0.0, viscous_change: 0.0, chain: Chain::default() }
}
