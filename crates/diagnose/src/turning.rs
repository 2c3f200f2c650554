//! How dry friction turns over with the direction of motion: a law and a speed per drive, as the recordings show them.
//!
//! A sign that is softer or sharper than the drive's leaves a spike at every reversal, many times the noise of the sensors. And what a delay, a lag
//! or a dead zone does to a drive with friction is at its reversals: whoever leaves these out hardly sees them. Where friction follows speed, a law
//! of it can be fitted, and reversals are rows like others, with the weight that their scatter gives them. Where it follows the distance since the
//! reversal, as bristles do, no law of speed fits, the friction of a turning drive may be anything between its limits, and reversals stay out.

use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use rayon::prelude::*;

use crate::motion::{Motion, soft_sign, top_speed};
use crate::rows::{FineGrid, standstill};
use crate::settings::SOFTNESS;
use crate::verdict::Use;

/// How a direction passes through zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Law {
    /// `v/√(v² + w²)`
    Soft,
    /// `tanh(v/w)`
    Tanh,
    /// `v/w` between −1 and 1.
    Saturated,
}

/// Laws that are fitted, as many as there are softnesses.
const LAWS: [Law; SOFTNESS.len()] = [Law::Soft, Law::Tanh, Law::Saturated];

/// A direction of motion that passes through zero over a width `[m/s | rad/s]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Turn {
    pub(crate) law: Law,
    pub(crate) width: f64,
}

impl Turn {
    pub(crate) fn soft(width: f64) -> Self {
        Self { law: Law::Soft, width }
    }

    /// Direction of a motion of velocity `v`, −1 to 1.
    pub(crate) fn sign(self, v: f64) -> f64 {
        match self.law {
            _ if self.width <= 0.0 => math::sign(v),
            Law::Soft => soft_sign(v, self.width),
            Law::Tanh => math::tanh(v / self.width),
            Law::Saturated => (v / self.width).clamp(-1.0, 1.0),
        }
    }

    /// The wider of two.
    pub(crate) fn wider(self, other: Self) -> Self {
        if other.width > self.width { other } else { self }
    }

    /// The law as an equation says it.
    pub(crate) fn equation(self) -> &'static str {
        match self.law {
            Law::Soft => "s = v/√(v² + w²)",
            Law::Tanh => "s = tanh(v/w)",
            Law::Saturated => "s = v/w between −1 and 1",
        }
    }
}

/// Narrowest width that is tried, as a share of a drive's top speed.
const NARROWEST: f64 = 4e-4;
/// Widest: beyond it friction would be one that fades early, which is physics of its own.
const WIDEST: f64 = 0.02;
/// Ratio of neighbouring widths.
const STEP: f64 = 1.3;
/// Distances over which bristles bend, as shares of what a drive moves in a second at its top speed.
const REACHES: [f64; 6] = [3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2];
/// Share of the squared error of bristles that a law of speed may leave: where neither describes a drive well, both leave about the same.
const CLEARLY: f64 = 0.5;
/// Raw samples that are looked at: more say the same again.
const ENOUGH: usize = 120_000;

/// What the recordings say of one drive.
#[derive(Debug, Clone)]
struct Fitted {
    /// Each law with its best width, the law that leaves least first.
    turns: [Turn; LAWS.len()],
    /// Weight of rows in which the drive turns over; nothing where no law of speed says what its friction does there.
    weight: f64,
}

/// Fits how the drives' friction turns over and puts it into all motions, held-out ones as well; what is fitted comes from the others. Whether that of any
/// drive follows its speed.
pub(crate) fn settle(robot: &Robot, motions: &mut [Motion], band: f64) -> bool {
    let n = robot.model.n_act();
    // What one of several surplus drives does at its reversals is in the rows of all.
    if motions.iter().any(|m| !m.moves.is_empty()) {
        return false;
    }
    let fitted: Vec<&Motion> = motions.iter().filter(|m| m.segment.used != Use::Holdout).collect();
    let top: Vec<f64> = (0..n).map(|k| fitted.iter().map(|m| top_speed(&m.segment.v[k])).fold(0.0, f64::max)).collect();
    let Some(scene) = Scene::new(&fitted, &top, band) else { return false };
    let found: Vec<Option<Fitted>> = (0..n).into_par_iter().map(|k| scene.fit(k, top[k])).collect();
    for m in motions {
        for (k, found) in found.iter().enumerate() {
            let Some(found) = found else { continue };
            let joint = robot.model.actuators[k];
            m.turns.iter_mut().zip(found.turns).for_each(|(turns, turn)| turns[joint] = turn);
            m.turning_weight[k] = found.weight;
        }
    }
    found.iter().flatten().any(|f| f.weight > 0.0)
}

/// The fitted recordings, filtered, with what every drive's effort is compared with.
struct Scene<'m> {
    parts: Vec<Part<'m>>,
    /// Whether each drive turns over within a row's reach: [drive][row].
    turns_over: Vec<Vec<bool>>,
    /// Orthonormal: rigid efforts, accelerations and velocities of all drives.
    base: Basis,
}

/// The beginning of a segment.
struct Part<'m> {
    motion: &'m Motion,
    grid: FineGrid,
    n: usize,
    /// Rows that count.
    rows: Vec<usize>,
}

impl<'m> Part<'m> {
    /// Of a motion at most the first `most` samples.
    fn of(motion: &'m Motion, most: usize, band: f64) -> Self {
        let grid = FineGrid::new(motion.segment.dt, band);
        let n = motion.segment.valid.len().min(most);
        let step = grid.step * grid.thin;
        let rows = (0..n.div_ceil(step)).filter(|r| grid.is_inside(r * step, n) && motion.segment.valid[r * step]).collect();
        Self { motion, grid, n, rows }
    }

    /// Rows of raw series behind the band's filter.
    fn rows(&self, raw: &[&[f64]]) -> Vec<Vec<f64>> {
        let fine = self.grid.fine_each(raw);
        fine.into_iter().map(|x| self.rows.iter().map(|&r| x[r * self.grid.thin]).collect()).collect()
    }

    /// Rows in whose reach a drive turns over.
    fn turning(&self, k: usize, top: &[f64], band: f64) -> Vec<bool> {
        let still = standstill(self.motion, top, band).swap_remove(k);
        let step = self.grid.step * self.grid.thin;
        let near = |i: usize| still[i.saturating_sub(step)..(i + step + 1).min(still.len())].contains(&true);
        self.rows.iter().map(|r| near(r * step)).collect()
    }
}

impl<'m> Scene<'m> {
    /// None where there is too little to see.
    fn new(fitted: &[&'m Motion], top: &[f64], band: f64) -> Option<Self> {
        let share = ENOUGH / fitted.len().max(1);
        let parts: Vec<Part<'m>> = fitted.iter().map(|motion| Part::of(motion, share, band)).collect();
        let n = top.len();
        let turns_over = (0..n).map(|k| parts.iter().flat_map(|p| p.turning(k, top, band)).collect()).collect();
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); 3 * n];
        for p in &parts {
            let s = &p.motion.segment;
            let raw = p.motion.rigid.iter().chain(&s.a).chain(&s.v).map(|x| &x[..p.n]).collect::<Vec<_>>();
            columns.iter_mut().zip(p.rows(&raw)).for_each(|(all, x)| all.extend(x));
        }
        let rows = columns.first()?.len();
        if rows < 20 * columns.len() {
            return None;
        }
        columns.push(vec![1.0; rows]);
        let mut base = Basis::default();
        columns.into_iter().for_each(|x| base.add(x));
        Some(Self { parts, turns_over, base })
    }

    /// Series of a drive behind the filter, all parts one after another.
    fn filtered(&self, make: &dyn Fn(&Motion, usize) -> Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let mut out: Vec<Vec<f64>> = Vec::new();
        for p in &self.parts {
            let raw = make(p.motion, p.n);
            let rows = p.rows(&raw.iter().map(Vec::as_slice).collect::<Vec<_>>());
            out.resize(rows.len(), Vec::new());
            out.iter_mut().zip(rows).for_each(|(all, x)| all.extend(x));
        }
        out
    }

    /// The drive's own basis: positions besides, and how its effort would come late, for a delay must not pass for a wide turn.
    fn own(&self, k: usize) -> Basis {
        let mut own = self.base.clone();
        let late = |m: &Motion, n: usize| {
            let q = &m.segment.q[k][..n];
            vec![q.to_vec(), q.iter().map(|q| q * q).collect(), pkm_ident::filter::derivative(&m.segment.tau[k][..n], m.segment.dt)]
        };
        self.filtered(&late).into_iter().for_each(|x| own.add(x));
        own
    }

    fn fit(&self, k: usize, top: f64) -> Option<Fitted> {
        if top <= 0.0 || !self.turns_over[k].contains(&true) {
            return None;
        }
        let own = self.own(k);
        let y = own.strip(self.filtered(&|m, n| vec![m.segment.tau[k][..n].to_vec()]).swap_remove(0));
        let widths: Vec<f64> =
            core::iter::successors(Some(NARROWEST * top), |w| Some(w * STEP)).take_while(|w| *w <= WIDEST * top).collect();
        let laws = LAWS.iter().map(|&law| self.narrowed(k, law, (&own, &y), &widths)).collect::<Option<Vec<_>>>()?;
        let mut best: Vec<(f64, Turn, Vec<f64>)> =
            laws.into_iter().zip(LAWS).map(|((error, width, left), law)| (error, Turn { law, width }, left)).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        let turns = core::array::from_fn(|i| best[i].1);
        let (error, _, left) = &best[0];
        let bent = self.filtered(&|m, n| REACHES.iter().map(|r| bristles(&m.segment.v[k][..n], r * top, m.segment.dt)).collect());
        let (bristles, ..) = least(&own, &y, bent)?;
        let weight = if *error <= CLEARLY * bristles { self.weight(k, left) } else { 0.0 };
        tracing::debug!(drive = k, ?turns, weight, law = error, bristles, "how friction turns over");
        Some(Fitted { turns, weight })
    }

    /// Smallest squared error of a law over its widths, the width, and what is left then.
    fn narrowed(&self, k: usize, law: Law, (own, y): (&Basis, &[f64]), widths: &[f64]) -> Option<(f64, f64, Vec<f64>)> {
        let mut best: Option<(f64, f64, Vec<f64>)> = None;
        let mut tried = widths.to_vec();
        let mut ratio = STEP;
        for _ in 0..3 {
            let sign = |width: f64, v: &[f64]| v.iter().map(|v| Turn { law, width }.sign(*v)).collect();
            let signs = self.filtered(&|m, n| tried.iter().map(|width| sign(*width, &m.segment.v[k][..n])).collect());
            let (error, at, left) = least(own, y, signs)?;
            if best.as_ref().is_none_or(|(e, ..)| error < *e) {
                best = Some((error, tried[at], left));
            }
            let width = best.as_ref()?.1;
            // Thirds of a step on both sides, then thirds of these.
            let third = math::powf(ratio, 1.0 / 3.0);
            tried = [-2.0, -1.0, 1.0, 2.0].map(|i| width * math::powf(third, i)).to_vec();
            ratio = third;
        }
        best
    }

    /// Scatter where the drive moves over that where it turns over, at most one.
    fn weight(&self, k: usize, left: &[f64]) -> f64 {
        let rms = |turning: bool| {
            let at = left.iter().zip(&self.turns_over[k]).filter(|(_, t)| **t == turning);
            let (sum, n) = at.fold((0.0, 0_usize), |(sum, n), (x, _)| (sum + x * x, n + 1));
            math::sqrt(sum / n.max(1) as f64)
        };
        let (moving, turning) = (rms(false), rms(true));
        if moving > 0.0 && turning > 0.0 { (moving / turning).min(1.0) } else { 0.0 }
    }
}

/// Smallest squared error with one of several columns, which it is, and what is left then.
fn least(own: &Basis, y: &[f64], columns: Vec<Vec<f64>>) -> Option<(f64, usize, Vec<f64>)> {
    let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let each = columns.into_iter().enumerate().filter_map(|(i, x)| {
        let x = own.strip(x);
        let length = square(&x);
        if length <= 0.0 {
            return None;
        }
        let size = x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>() / length;
        let left: Vec<f64> = x.iter().zip(y).map(|(x, y)| y - size * x).collect();
        Some((square(&left), i, left))
    });
    each.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Bend of bristles that yield over a distance `reach` `[m | rad]`, −1 to 1 (Dahl).
fn bristles(v: &[f64], reach: f64, dt: f64) -> Vec<f64> {
    let mut bend = 0.0;
    v.iter()
        .map(|v| {
            let side = math::sign(*v);
            bend = side + (bend - side) * math::exp(-v.abs() * dt / reach);
            bend
        })
        .collect()
}

/// Orthonormal columns.
#[derive(Debug, Clone, Default)]
struct Basis {
    columns: Vec<Vec<f64>>,
}

impl Basis {
    /// Adds what the others do not have of a column.
    fn add(&mut self, x: Vec<f64>) {
        let length = |x: &[f64]| math::sqrt(x.iter().map(|x| x * x).sum::<f64>());
        let before = length(&x);
        let mut x = self.strip(x);
        let after = length(&x);
        if after > 1e-6 * before {
            x.iter_mut().for_each(|x| *x /= after);
            self.columns.push(x);
        }
    }

    /// What is left of a column beside these.
    fn strip(&self, mut x: Vec<f64>) -> Vec<f64> {
        // Twice: what rounding leaves the first time.
        for column in self.columns.iter().chain(&self.columns) {
            let along: f64 = column.iter().zip(&x).map(|(c, x)| c * x).sum();
            x.iter_mut().zip(column).for_each(|(x, c)| *x -= along * c);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use pkm_dyn::effects::Robot;

    use super::*;
    use crate::testing::Bench;

    const COULOMB: f64 = 3.0;

    /// A slider with dry friction, told by speed and sampling period, under effort that acts `late` seconds after it is recorded.
    fn settled(friction: &dyn Fn(&[f64], f64) -> Vec<f64>, late: f64) -> (Motion, f64) {
        let bench = Bench::sine(0.2, 0.4);
        let mut motion = bench.motion;
        let dt = motion.segment.dt;
        // A second sine, so that no reversal is as fast as another.
        for (i, ((q, v), a)) in motion.segment.q[0].iter_mut().zip(&mut motion.segment.v[0]).zip(&mut motion.segment.a[0]).enumerate() {
            let (rate, phase) = (core::f64::consts::TAU * 0.9, core::f64::consts::TAU * 0.9 * dt * i as f64 + 1.0);
            *q += 0.06 * math::sin(phase);
            *v += 0.06 * rate * math::cos(phase);
            *a -= 0.06 * rate * rate * math::sin(phase);
        }
        motion.rigid[0] = motion.segment.a[0].iter().map(|a| 2.0 * a).collect();
        let acts: Vec<f64> =
            motion.rigid[0].iter().zip(friction(&motion.segment.v[0], dt)).map(|(rigid, dry)| rigid + COULOMB * dry).collect();
        let mut noise = 1_u64;
        let mut draw = || {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (noise >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
        };
        motion.segment.tau[0] = pkm_ident::filter::advanced(&acts, late, dt).iter().map(|x| x + 0.05 * draw()).collect();
        let top = top_speed(&motion.segment.v[0]);
        let mut all = [motion];
        settle(&Robot::new(bench.model, Vec::new()), &mut all, 5.0);
        let [motion] = all;
        (motion, top)
    }

    #[test]
    fn a_law_of_speed_is_found_with_its_width_delayed_or_not() {
        for law in LAWS {
            for late in [0.0, 2e-3] {
                // Half a percent of the top speed.
                let turn = Turn { law, width: 0.0036 };
                let (motion, _) = settled(&|v, _| v.iter().map(|v| turn.sign(*v)).collect(), late);
                let found = motion.turns.iter().map(|turns| turns[0]).find(|t| t.law == law).expect("every law is tried");
                let width = found.width;
                assert!((width / turn.width - 1.0).abs() < 0.1, "{law:?}, {late} s late: {width}");
                assert!(motion.turning_weight[0] > 0.3, "{law:?}, {late} s late: {}", motion.turning_weight[0]);
            }
        }
    }

    #[test]
    fn bristles_are_told_from_laws_of_speed() {
        let (motion, top) = settled(&|v, dt| bristles(v, 2e-4, dt), 0.0);
        assert!(motion.turning_weight[0] <= 0.0 && top > 0.4, "{}", motion.turning_weight[0]);
    }

    #[test]
    fn every_law_is_odd_and_ends_at_one() {
        for law in LAWS {
            let turn = Turn { law, width: 0.01 };
            for v in [0.002, 0.01, 0.03] {
                assert!((turn.sign(v) + turn.sign(-v)).abs() < 1e-15 && turn.sign(v) > 0.0);
            }
            assert!((turn.sign(1.0) - 1.0).abs() < 1e-3 && turn.sign(0.0).abs() < 1e-15, "{law:?}");
        }
    }
}
