//! The effort of the model as given along a segment: rigid bodies, nominal friction, effects that the robot file already has.

use pkm_dyn::effects::{Applied, JointState, Law, LinkState, Memory, Robot, Site, Transmission};
use pkm_dyn::math;

use crate::held::{Held, Spot};
use crate::motion::Motion;
use crate::sharing;
use crate::shift::{self, FrictionOf};
use crate::turning::Turn;

/// A tree joint along a segment.
struct Track<'m> {
    q: &'m [f64],
    v: &'m [f64],
    a: &'m [f64],
    /// Rigid effort, of a drive.
    load: Option<&'m [f64]>,
    /// Temperature above the first sample's, where recorded.
    warmth: &'m [f64],
}

/// Fills in the effort at each drive per softness of directions, as the drive's recorded effort has it, what passes through the
/// transmissions, and what other sensors would read of it.
pub(crate) fn fill(robot: &Robot, motion: &mut Motion) {
    motion.nominal = motion.turns.iter().map(|turns| at_softness(robot, motion, turns)).collect();
    let mut nominal = core::mem::take(&mut motion.nominal);
    nominal.iter_mut().for_each(|efforts| sharing::as_measured(motion, efforts));
    motion.nominal = nominal;
    for k in 0..robot.model.n_act() {
        let (rotor, a) = (motion.rotor[k], &motion.segment.a[k]);
        motion.transmitted[k] = motion.nominal[0][k].iter().zip(a).map(|(t, a)| t - rotor * a).collect();
    }
    give_way(robot, motion);
    if !motion.moves.is_empty() {
        // Recorded efforts are what acts already ([`crate::segment`]).
        return;
    }
    for (k, &j) in robot.model.actuators.iter().enumerate() {
        let chain = |is: fn(&Law) -> bool| robot.chain(j, is);
        let scale: f64 = chain(|law| matches!(law, Law::EffortScale)).product();
        let zone: f64 = chain(|law| matches!(law, Law::EffortDeadZone)).map(|width| 0.5 * width).sum();
        let recorded: f64 = chain(|law| matches!(law, Law::CommandShare)).map(|share| 1.0 - share).product();
        for series in motion.nominal.iter_mut().map(|n| &mut n[k]) {
            let sides = if zone > 0.0 { shift::side(series) } else { Vec::new() };
            for (i, x) in series.iter_mut().enumerate() {
                *x = recorded * (*x / scale + zone * sides.get(i).copied().unwrap_or(0.0));
            }
        }
    }
}

/// Adds what the robot file's transmissions and its mounting give way by, to first order.
fn give_way(robot: &Robot, motion: &mut Motion) {
    let mut added: Vec<(f64, Vec<Vec<f64>>)> = Vec::new();
    for e in &robot.effects {
        let drive = robot.model.actuators.iter().position(|&j| e.is_at_joint(j));
        match (e.entry.law, drive) {
            (Law::Transmission(Transmission::Spring), Some(k)) => {
                added.push((1.0 / e.values[0], shift::of_compliance(motion, k, FrictionOf::Load)));
            }
            (Law::Transmission(Transmission::Play), Some(k)) => added.push((e.values[0], shift::of_play(motion, k, FrictionOf::Load))),
            (Law::Structure, _) if robot.model.links[e.place].body.is_none() => {
                added.push((1.0 / e.values[0], shift::of_mounting(motion)));
            }
            _ => {}
        }
    }
    for (size, column) in added {
        let of_channels = motion.channels.iter_mut().map(|c| &mut c.nominal).zip(&column[robot.model.n_act()..]);
        let of_drives = motion.nominal.iter_mut().flat_map(|n| n.iter_mut().zip(&column));
        for (x, c) in of_drives.chain(of_channels).flat_map(|(x, c)| x.iter_mut().zip(c)) {
            *x += size * c;
        }
    }
}

fn at_softness(robot: &Robot, motion: &Motion, turns: &[Turn]) -> Vec<Vec<f64>> {
    let joints: Vec<Vec<f64>> = (0..robot.model.nv()).map(|j| joint_series(robot, motion, j, turns)).collect();
    let mut out = motion.rigid.clone();
    for (k, &j) in robot.model.actuators.iter().enumerate() {
        add(&mut out[k], &joints[j]);
        for (p, passive) in motion.dependent.iter().zip(&motion.passive) {
            out[k].iter_mut().zip(&passive.g[k]).zip(&joints[*p]).for_each(|((sum, g), e)| *sum += g * e);
        }
    }
    for e in robot.effects.iter().filter(|e| e.site == Site::Link) {
        let (Law::Wrench(law), Some(held)) = (e.entry.law, Held::find(&motion.held, e.place, Spot::Origin)) else { continue };
        push(&mut out, held, motion.segment.dt, |s| law(&e.values, s));
    }
    out
}

fn add(sum: &mut [f64], part: &[f64]) {
    sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
}

fn push(out: &mut [Vec<f64>], held: &Held, dt: f64, wrench: impl Fn(&LinkState) -> [f64; 6]) {
    let mut all: [Vec<f64>; 6] = core::array::from_fn(|_| Vec::with_capacity(held.position[0].len()));
    for i in 0..held.position[0].len() {
        let w = wrench(&held.state(i, dt * i as f64));
        all.iter_mut().zip(w).for_each(|(series, w)| series.push(w));
    }
    for (k, out) in out.iter_mut().enumerate() {
        add(out, &held.felt(&all, 0..6, k));
    }
}

fn track<'m>(robot: &Robot, motion: &'m Motion, j: usize) -> Option<Track<'m>> {
    if let Some(k) = robot.model.actuators.iter().position(|&a| a == j) {
        let s = &motion.segment;
        return Some(Track { q: &s.q[k], v: &s.v[k], a: &s.a[k], load: Some(&motion.rigid[k]), warmth: &s.warmth[k] });
    }
    let p = motion.dependent.iter().position(|&d| d == j)?;
    let p = &motion.passive[p];
    Some(Track { q: &p.q, v: &p.v, a: &p.a, load: None, warmth: &[] })
}

/// Everything that acts at the coordinate of one joint.
fn joint_series(robot: &Robot, motion: &Motion, j: usize, turns: &[Turn]) -> Vec<f64> {
    let dt = motion.segment.dt;
    let Some(t) = track(robot, motion, j) else { return vec![0.0; motion.segment.valid.len()] };
    let mut out: Vec<f64> = (0..t.q.len())
        .map(|i| {
            let time = dt * i as f64;
            let state = JointState {
                q: t.q[i],
                v: t.v[i],
                a: t.a[i],
                sign: turns[j].sign(t.v[i]),
                load: t.load.map_or(0.0, |l| l[i]),
                warmth: t.warmth.get(i).copied().unwrap_or(time),
                time,
                ..JointState::default()
            };
            robot.joint_effort(j, &state)
        })
        .collect();
    for e in &robot.effects {
        match e.entry.law {
            Law::Memory(memory) if e.is_at_joint(j) => add(&mut out, &remembered(&memory, &e.values, t.v, dt)),
            Law::Wrench(law) if e.is_at_joint(j) => {
                for (i, sum) in out.iter_mut().enumerate() {
                    let mut s = LinkState { time: dt * i as f64, ..LinkState::default() };
                    (s.position[0], s.displacement[0], s.velocity[0]) = (t.q[i], t.q[i] - t.q[0], t.v[i]);
                    *sum += law(&e.values, &s)[0];
                }
            }
            Law::PairEffort(law) => {
                if let Some(pair) = pair_of(robot, motion, e, j) {
                    add(&mut out, &paired(&pair, dt, turns[e.place].wider(turns[j]), |s| law(&e.values, s)));
                }
            }
            _ => {}
        }
    }
    out
}

/// Both joints of a pair, if `j` is one of them.
fn pair_of<'m>(robot: &Robot, motion: &'m Motion, e: &Applied, j: usize) -> Option<[Track<'m>; 2]> {
    let other = e.other?;
    if e.place != j && other != j {
        return None;
    }
    Some([track(robot, motion, e.place)?, track(robot, motion, other)?])
}

fn paired([x, y]: &[Track; 2], dt: f64, turn: Turn, law: impl Fn(&JointState) -> f64) -> Vec<f64> {
    (0..x.q.len())
        .map(|i| {
            let (time, v) = (dt * i as f64, x.v[i] + y.v[i]);
            let (q, a, sign) = (x.q[i] + y.q[i], x.a[i] + y.a[i], turn.sign(v));
            law(&JointState { q, v, a, sign, warmth: time, time, ..JointState::default() })
        })
        .collect()
}

/// Effort of a force with a memory along a motion that starts at rest.
///
/// Each step follows the law linearised in its state exactly: a stiff loop over position would throw an explicit step off.
pub(crate) fn remembered(memory: &Memory, p: &[f64], v: &[f64], dt: f64) -> Vec<f64> {
    let mut z = 0.0;
    v.iter()
        .enumerate()
        .map(|(i, &v_now)| {
            if i > 0 {
                let mean = 0.5 * (v[i - 1] + v_now);
                let rate = (memory.rate)(p, z, mean);
                let step = (rate * dt).abs().max(1e-12);
                let slope = ((memory.rate)(p, z + step, mean) - rate) / step;
                let x = slope * dt;
                z += rate * dt * if x.abs() > 1e-6 { (math::exp(x) - 1.0) / x } else { 1.0 + 0.5 * x };
            }
            (memory.effort)(p, z, v_now)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Bench;

    /// What the robot's files add to the rigid effort of two sliders across each other: [drive][sample].
    fn added(bench: &Bench, effect: &str, place: &str, numbers: &[(&str, f64)]) -> Vec<Vec<f64>> {
        let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| (n.to_string(), *v)).collect();
        let applied = Applied::try_new(&bench.model, effect, place, &numbers).expect("a valid effect");
        let mut motion = bench.motion.clone();
        fill(&Robot::new(bench.model.clone(), vec![applied]), &mut motion);
        let all = motion.nominal;
        all[0].iter().zip(&bench.motion.rigid).map(|(n, r)| n.iter().zip(r).map(|(n, r)| n - r).collect()).collect()
    }

    #[test]
    fn a_part_that_turns_with_two_joints_is_felt_at_both() {
        let bench = Bench::pair();
        let s = &bench.motion.segment;
        for felt in added(&bench, "transmission_coupling", "j0,j1", &[("inertia", 2.0), ("viscous", 3.0)]) {
            for (i, e) in felt.iter().enumerate() {
                let want = 2.0 * (s.a[0][i] + s.a[1][i]) + 3.0 * (s.v[0][i] + s.v[1][i]);
                assert!((e - want).abs() < 1e-9 * (1.0 + want.abs()), "{e} instead of {want}");
            }
        }
    }

    #[test]
    fn a_limb_at_the_end_pulls_each_slider_back_to_the_start() {
        let bench = Bench::pair();
        let s = &bench.motion.segment;
        for (k, felt) in added(&bench, "limb_impedance", "link1", &[("stiffness", 5.0), ("damping", 0.5)]).into_iter().enumerate() {
            for (i, e) in felt.iter().enumerate() {
                let want = 5.0 * (s.q[k][i] - s.q[k][0]) + 0.5 * s.v[k][i];
                assert!((e - want).abs() < 1e-9, "{e} instead of {want}");
            }
        }
    }

    #[test]
    fn an_obstacle_at_a_joint_pushes_on_its_side_only() {
        let bench = Bench::pair();
        let felt = added(&bench, "contact", "j1", &[("stiffness", 100.0), ("position", 0.05)]);
        let q = &bench.motion.segment.q[1];
        assert!(felt[0].iter().all(|e| e.abs() < 1e-12), "the other slider feels nothing");
        assert!(felt[1].iter().zip(q).all(|(e, q)| (e - 100.0 * (q - 0.05).max(0.0)).abs() < 1e-9));
    }

    #[test]
    fn a_dahl_loop_follows_its_closed_form_at_any_stiffness() {
        let Some(Law::Memory(memory)) = pkm_dyn::effects::find("friction_presliding").map(|e| e.law) else { panic!("a law with a memory") };
        for stiffness in [1e3, 1e5, 1e8] {
            let (coulomb, dt, speed) = (4.0, 1e-3, 0.02);
            let v = vec![speed; 500];
            let effort = remembered(&memory, &[stiffness, coulomb], &v, dt);
            for (i, e) in effort.iter().enumerate() {
                let travel = speed * dt * i as f64;
                let want = coulomb * (1.0 - math::exp(-stiffness * travel / coulomb));
                assert!((e - want).abs() < 1e-4 * coulomb, "{e} instead of {want} at {stiffness}");
            }
        }
    }
}
