//! A true robot under a controller that knows the nominal one: what it does, and what its sensors would read without noise.
//!
//! Heun's method with a fixed step; bristles, memories of laws and delays advance once per step with their exact solutions.

use nalgebra::{DVector, Vector3};

use crate::laws::{Chain, Encoder, Flex, Friction, Resist, Seen};
use crate::math;
use crate::plant::{Moving, Plant};
use crate::reference::{LEAD, Reference, STEP, Wanted};
use crate::robot::RobotError;

/// A force at a point of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Hand {
    /// Joint whose link it holds.
    pub link: usize,
    /// Where on the link `[m]`.
    pub point: Vector3<f64>,
    /// How it pushes.
    pub push: Push,
}

/// How a hand pushes.
#[derive(Debug, Clone, PartialEq)]
pub enum Push {
    /// A limb: a spring that stiffens, a damper, and a spring in series with a damper beside it.
    Limb {
        /// Stiffness `[N/m]`.
        stiffness: f64,
        /// Damping over stiffness `[s]`.
        damping: f64,
        /// Deflection at which it is twice as stiff `[m]`.
        hardening: f64,
    },
    /// A push along `along` `[N]` that swells and fades between two times `[s]`.
    Between {
        /// Force at its height `[N]`.
        along: Vector3<f64>,
        /// Beginning and end `[s]`.
        times: [f64; 2],
    },
    /// Sines of unrelated frequencies under a slow envelope: it never comes again.
    Restless {
        /// Per direction: amplitude `[N]`, frequency `[Hz]`, phase `[rad]`.
        sines: [Vec<[f64; 3]>; 3],
    },
}

/// A drive felt at another joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Felt {
    /// Joint whose motion is felt.
    pub from: usize,
    /// Joint that feels it.
    pub to: usize,
    /// Inertia `[kg·m²]`, dry friction `[N·m]`, viscous friction `[N·m·s/rad]`.
    pub strength: [f64; 3],
}

/// A resistance at a joint, `size` times a law.
#[derive(Debug, Clone, PartialEq)]
pub struct Resistance {
    /// Joint.
    pub joint: usize,
    /// Another joint whose velocity the law sees.
    pub other: usize,
    /// Law per unit.
    pub law: Resist,
    /// Size, in the unit of the law.
    pub size: f64,
}

/// A true robot.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Its mechanics.
    pub plant: Plant,
    /// Friction per drive.
    pub friction: Vec<Friction>,
    /// Additional resistances.
    pub resistances: Vec<Resistance>,
    /// Transmissions that give way, per drive, with the inertia of the motor `[kg | kg·m²]`.
    pub flex: Vec<Option<(Flex, f64)>>,
    /// From recorded to acting effort, per drive.
    pub chains: Vec<Chain>,
    /// Position sensors, per drive.
    pub encoders: Vec<Encoder>,
    /// Drift of the recorded effort, per drive `[N/s]`.
    pub drift: Vec<f64>,
    /// Hands on links.
    pub hands: Vec<Hand>,
    /// Drives felt elsewhere.
    pub felt: Vec<Felt>,
    /// Stiffness and damping of a base that rocks: joint 0 then.
    pub rock: Option<[f64; 2]>,
    /// Stiffness and damping of the controller, per drive.
    pub gains: Vec<[f64; 2]>,
    /// Integration steps per [`STEP`].
    pub substeps: usize,
}

/// What a run left behind, at the rate of the recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Time `[s]`.
    pub t: Vec<f64>,
    /// Positions as read, per sample and drive `[m | rad]`.
    pub reading: Vec<Vec<f64>>,
    /// Velocities as read.
    pub rate: Vec<Vec<f64>>,
    /// Recorded efforts.
    pub effort: Vec<Vec<f64>>,
    /// Coordinates of all joints of the nominal robot, true values.
    pub truth: Vec<Vec<f64>>,
    /// References: positions, velocities, accelerations.
    pub wanted: Vec<[Vec<f64>; 3]>,
}

/// State between two steps.
struct State {
    t: f64,
    q: Vec<f64>,
    x: DVector<f64>,
    motor: Vec<[f64; 2]>,
    lag: Vec<[f64; 2]>,
    bristles: Vec<f64>,
    memory: Vec<f64>,
    /// Maxwell branch of each hand: where its damper is.
    slack: Vec<Vector3<f64>>,
    /// Commands of the last steps, newest last, with their times.
    past: Vec<Vec<[f64; 2]>>,
    /// Of the step before: accelerations of all joints, effort that the drives pass on.
    acceleration: DVector<f64>,
    load: Vec<f64>,
    /// Where the hands are at rest.
    rest: Vec<Vector3<f64>>,
}

/// Slopes and what else an evaluation finds.
struct Slopes {
    q: DVector<f64>,
    x: DVector<f64>,
    motor: Vec<[f64; 2]>,
    lag: Vec<[f64; 2]>,
    command: Vec<f64>,
    reading: Vec<[f64; 2]>,
    acceleration: DVector<f64>,
    load: Vec<f64>,
    points: Vec<[Vector3<f64>; 2]>,
}

impl Machine {
    /// Follows a reference and returns every `every`-th step of the recording.
    ///
    /// # Errors
    /// Where a loop opens or the motion runs away.
    pub fn run(&self, reference: &Reference, every: usize) -> Result<Trace, RobotError> {
        let mut state = self.start(reference);
        let dt = STEP / self.substeps as f64;
        let lead = crate::reference::steps(LEAD);
        let last = lead + crate::reference::steps(reference.duration);
        let mut trace = Trace::default();
        let skip = usize::from(self.rock.is_some());
        for i in 0..last {
            for sub in 0..self.substeps {
                let share = sub as f64 / self.substeps as f64;
                let next = (sub + 1) as f64 / self.substeps as f64;
                let wanted = [between(reference, i, share), between(reference, i, next)];
                let first = self.slopes(&mut state, &wanted[0])?;
                if sub == 0 && i >= lead && (i - lead).is_multiple_of(every) {
                    self.sample(&mut trace, &state, &first, (skip, &wanted[0]));
                }
                self.advance(&mut state, &first, &wanted[1], dt)?;
            }
        }
        Ok(trace)
    }

    fn sample(&self, trace: &mut Trace, state: &State, s: &Slopes, (skip, wanted): (usize, &Wanted)) {
        trace.t.push(state.t);
        trace.reading.push(s.reading.iter().map(|r| r[0]).collect());
        trace.rate.push(s.reading.iter().map(|r| r[1]).collect());
        trace.effort.push(s.command.iter().zip(&self.drift).map(|(u, d)| u + d * state.t).collect());
        trace.truth.push(state.q[skip..].to_vec());
        trace.wanted.push([&wanted.q, &wanted.v, &wanted.a].map(|x| x.as_slice().to_vec()));
    }

    fn start(&self, reference: &Reference) -> State {
        let (mut q, mut x) = (reference.start.clone(), reference.start_velocity.as_slice().to_vec());
        let mut middle = reference.middle.clone();
        if self.rock.is_some() {
            [&mut q, &mut middle, &mut x].into_iter().for_each(|all| all.insert(0, 0.0));
        }
        let drives = &self.plant.robot.drives;
        let first = &reference.rows[0];
        let hands = |q: &[f64]| -> Vec<Vector3<f64>> {
            let pose = self.plant.pose(q);
            self.hands.iter().map(|h| pose.at[h.link] + pose.turn[h.link] * h.point).collect()
        };
        // Whose limb it is sits in one place, wherever a recording begins.
        let rest = hands(&middle);
        State {
            t: -LEAD,
            motor: (0..drives.len()).map(|k| [first.q[k], first.v[k]]).collect(),
            lag: (0..drives.len()).map(|k| [first.feedforward[k], 0.0]).collect(),
            bristles: vec![0.0; drives.len()],
            memory: self.resistances.iter().map(|r| r.law.start(q[r.joint])).collect(),
            slack: hands(&q).iter().zip(&rest).map(|(at, rest)| at - rest).collect(),
            past: vec![Vec::new(); drives.len()],
            acceleration: DVector::zeros(q.len()),
            load: first.feedforward.as_slice().to_vec(),
            rest,
            q,
            x: DVector::from_vec(x),
        }
    }

    /// One evaluation of the equations of motion.
    fn slopes(&self, s: &mut State, wanted: &Wanted) -> Result<Slopes, RobotError> {
        let mut q = core::mem::take(&mut s.q);
        let moving = self.plant.moving(&mut q, s.x.as_slice());
        s.q = q;
        let m = moving?;
        let mut tree = DVector::zeros(s.q.len());
        let mut out = Slopes {
            q: m.velocity.clone(),
            x: DVector::zeros(s.x.len()),
            motor: s.motor.clone(),
            lag: s.lag.clone(),
            command: Vec::new(),
            reading: Vec::new(),
            acceleration: DVector::zeros(s.q.len()),
            load: Vec::new(),
            points: Vec::new(),
        };
        for k in 0..self.plant.robot.drives.len() {
            self.drive(k, s, (wanted, &m), &mut out, &mut tree);
        }
        for (i, r) in self.resistances.iter().enumerate() {
            tree[r.joint] -= r.size * r.law.effort(&self.seen(r, s, &m), s.memory[i]);
        }
        for f in &self.felt {
            let v = m.velocity[f.from];
            tree[f.to] -= f.strength[1] * math::tanh(v / 0.02) + f.strength[2] * v;
        }
        if let Some([stiffness, damping]) = self.rock {
            tree[0] -= stiffness * s.q[0] + damping * m.velocity[0];
        }
        let mut force = m.ratio.tr_mul(&tree) - &m.bias;
        for (i, h) in self.hands.iter().enumerate() {
            self.hand(i, h, s, (&m, &mut force), &mut out);
        }
        let mut mass = m.mass.clone();
        for f in &self.felt {
            let (a, b) = (m.ratio.row(f.from), m.ratio.row(f.to));
            mass += (a.transpose() * b + b.transpose() * a) * f.strength[0];
        }
        let solved = mass.cholesky().map(|c| c.solve(&force));
        out.x =
            solved.filter(|a| a.iter().all(|x| x.abs() < 1e6)).ok_or_else(|| RobotError::Unknown("the motion runs away".to_string()))?;
        out.acceleration = &m.ratio * &out.x + &m.ratio_bias;
        Ok(out)
    }

    fn seen(&self, r: &Resistance, s: &State, m: &Moving) -> Seen {
        let drive = self.plant.robot.drives.iter().position(|d| d.joint == r.joint);
        let load = drive.map_or(0.0, |k| s.load[k]);
        Seen { t: s.t, q: s.q[r.joint], v: m.velocity[r.joint], a: s.acceleration[r.joint], load, other: m.velocity[r.other] }
    }

    /// Controller, amplifier, motor and transmission of drive `k`.
    fn drive(&self, k: usize, s: &State, (wanted, m): (&Wanted, &Moving), out: &mut Slopes, tree: &mut DVector<f64>) {
        let joint = self.plant.robot.drives[k].joint;
        let (q, v) = (s.q[joint], m.velocity[joint]);
        let [angle, speed] = if self.flex[k].is_some() { s.motor[k] } else { [q, v] };
        let reading = self.encoders[k].read(angle, speed);
        let [stiffness, damping] = self.gains[k];
        let command = wanted.feedforward[k] + stiffness * (wanted.q[k] - reading[0]) + damping * (wanted.v[k] - reading[1]);
        let chain = &self.chains[k];
        let late = if chain.delay > 0.0 { earlier(&s.past[k], s.t - chain.delay, [s.t, command]) } else { command };
        let passed = chain.passed(late);
        let acting = if chain.lag > 0.0 {
            // 1/(1 + T s + (0.6 T s)²): first-order at low frequency, with a second pole.
            let [y, rate] = s.lag[k];
            let second = 0.36 * chain.lag * chain.lag;
            out.lag[k] = [rate, (passed - y - chain.lag * rate) / second];
            y
        } else {
            passed
        };
        let friction = self.friction[k].force(speed, s.bristles[k]);
        let mut load = acting - friction;
        if let Some((flex, inertia)) = &self.flex[k] {
            let through = flex.force(angle - q, speed - v);
            out.motor[k] = [speed, (load - through) / inertia];
            load = through;
        }
        tree[joint] += load;
        out.command.push(command);
        out.reading.push(reading);
        out.load.push(load - self.plant.rotors[joint] * s.acceleration[joint]);
    }

    fn hand(&self, i: usize, h: &Hand, s: &State, (m, force): (&Moving, &mut DVector<f64>), out: &mut Slopes) {
        let arm = m.pose.turn[h.link] * h.point;
        let at = m.pose.at[h.link] + arm;
        let velocity = m.links[h.link][1] + m.links[h.link][0].cross(&arm);
        let push = match &h.push {
            Push::Limb { stiffness, damping, hardening } => {
                let x = at - s.rest[i];
                let harder = 1.0 + x.norm_squared() / (hardening * hardening);
                -(x * (stiffness * harder) + velocity * (stiffness * damping) + (x - s.slack[i]) * (0.3 * stiffness))
            }
            Push::Between { along, times } => {
                let u = (s.t - times[0]) / (times[1] - times[0]);
                let swell = math::sin(core::f64::consts::PI * u.clamp(0.0, 1.0));
                along * (swell * swell)
            }
            Push::Restless { sines } => {
                Vector3::from_fn(|k, _| sines[k].iter().map(|[a, hz, p]| a * math::sin(core::f64::consts::TAU * hz * s.t + p)).sum::<f64>())
            }
        };
        for k in 0..force.len() {
            let [w, v] = m.partial[h.link][k];
            force[k] += push.dot(&(v + w.cross(&arm)));
        }
        out.points.push([at - s.rest[i], velocity]);
    }

    /// Heun's step from `first`, which was evaluated at `s`.
    fn advance(&self, s: &mut State, first: &Slopes, wanted: &Wanted, dt: f64) -> Result<(), RobotError> {
        let speed = |k: usize, slopes: &Slopes, motor: &[[f64; 2]]| {
            if self.flex[k].is_some() { motor[k][1] } else { slopes.q[self.plant.robot.drives[k].joint] }
        };
        let speeds: Vec<f64> = (0..s.motor.len()).map(|k| speed(k, first, &s.motor)).collect();
        let kept = (s.q.clone(), s.x.clone(), s.motor.clone(), s.lag.clone(), s.bristles.clone());
        for (k, past) in s.past.iter_mut().enumerate().filter(|(k, _)| self.chains[*k].delay > 0.0) {
            past.push([s.t, first.command[k]]);
            let gone = past.iter().position(|p| p[0] > s.t - self.chains[k].delay - 2.0 * STEP).unwrap_or(0);
            past.drain(..gone.saturating_sub(1));
        }
        s.q.iter_mut().zip(first.q.iter()).for_each(|(q, v)| *q += v * dt);
        s.x += &first.x * dt;
        s.motor.iter_mut().zip(&first.motor).for_each(|(m, r)| *m = [m[0] + r[0] * dt, m[1] + r[1] * dt]);
        s.lag
            .iter_mut()
            .zip(&first.lag)
            .zip(&self.chains)
            .filter(|(_, c)| c.lag > 0.0)
            .for_each(|((m, r), _)| *m = [m[0] + r[0] * dt, m[1] + r[1] * dt]);
        s.bristles.iter_mut().enumerate().for_each(|(k, z)| *z = self.friction[k].bent(*z, speeds[k], dt));
        s.acceleration = first.acceleration.clone();
        s.load.clone_from(&first.load);
        s.t += dt;
        let second = self.slopes(s, wanted)?;
        let half = 0.5 * dt;
        let speeds2: Vec<f64> = (0..s.motor.len()).map(|k| speed(k, &second, &s.motor)).collect();
        s.q = kept.0;
        s.q.iter_mut().enumerate().for_each(|(j, q)| *q += half * (first.q[j] + second.q[j]));
        s.x = kept.1 + (&first.x + &second.x) * half;
        for k in 0..s.motor.len() {
            let add = |x: [f64; 2], a: [f64; 2], b: [f64; 2]| [x[0] + half * (a[0] + b[0]), x[1] + half * (a[1] + b[1])];
            if self.flex[k].is_some() {
                s.motor[k] = add(kept.2[k], first.motor[k], second.motor[k]);
            }
            if self.chains[k].lag > 0.0 {
                s.lag[k] = add(kept.3[k], first.lag[k], second.lag[k]);
            }
            s.bristles[k] = self.friction[k].bent(kept.4[k], 0.5 * (speeds[k] + speeds2[k]), dt);
        }
        for (i, r) in self.resistances.iter().enumerate() {
            let seen = Seen { t: s.t, q: s.q[r.joint], v: second.q[r.joint], a: 0.0, load: 0.0, other: 0.0 };
            s.memory[i] = r.law.remembered(s.memory[i], &seen, dt);
        }
        // The damper of a limb gives way within a second.
        for (slack, [at, _]) in s.slack.iter_mut().zip(&second.points) {
            *slack += (at - *slack) * (1.0 - math::exp(-dt));
        }
        Ok(())
    }
}

/// The reference between row `i` and the next.
fn between(reference: &Reference, i: usize, share: f64) -> Wanted {
    let a = &reference.rows[i];
    if share <= 0.0 {
        return a.clone();
    }
    let b = &reference.rows[i + 1];
    let mix = |a: &DVector<f64>, b: &DVector<f64>| a * (1.0 - share) + b * share;
    Wanted { q: mix(&a.q, &b.q), v: mix(&a.v, &b.v), a: mix(&a.a, &b.a), feedforward: mix(&a.feedforward, &b.feedforward) }
}

/// Value at time `t` of a series of (time, value), the newest of which is `now`; beyond both ends the nearest line goes on.
fn earlier(past: &[[f64; 2]], t: f64, now: [f64; 2]) -> f64 {
    let mut later = now;
    for &p in past.iter().rev() {
        if p[0] <= t && p[0] < later[0] {
            return p[1] + (later[1] - p[1]) * (t - p[0]) / (later[0] - p[0]);
        }
        if p[0] < later[0] {
            later = p;
        }
    }
    later[1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{Base, HOLDOUT};
    use crate::bench::MEASURED;
    use crate::case::{Level, Wish};
    use crate::random::Stream;

    #[test]
    fn a_limb_rests_at_one_place_wherever_a_recording_begins() {
        let robot = "prs3".to_string();
        let wish = Wish { number: 1, seed: 1, level: Level::L1, robot, size: 2.0, noise: 1.0, recordings: MEASURED, effect: None };
        let mut base = Base::new(&wish).expect("a robot that comes with the project");
        let push = Push::Limb { stiffness: 100.0, damping: 0.1, hardening: 1.0 };
        base.machine.hands.push(Hand { link: base.plant.robot.end(), point: Vector3::zeros(), push });
        let begin = |recording: usize| {
            let reference = base.reference(recording, &mut Stream::new(1, recording as u64, "rest")).expect("a motion that it can follow");
            base.machine.start(&reference)
        };
        let (first, last) = (begin(0), begin(HOLDOUT));
        assert!((first.rest[0] - last.rest[0]).norm() < 1e-9, "{} and {}", first.rest[0], last.rest[0]);
        // They begin elsewhere, and the branch that gives way has done so.
        assert!((first.slack[0] - last.slack[0]).norm() > 1e-3, "{} and {}", first.slack[0], last.slack[0]);
    }

    #[test]
    fn the_past_is_interpolated() {
        let past = [[0.0, 1.0], [0.1, 2.0], [0.2, 4.0]];
        assert!((earlier(&past, 0.15, [0.25, 5.0]) - 3.0).abs() < 1e-12);
        assert!((earlier(&past, 0.225, [0.25, 5.0]) - 4.5).abs() < 1e-12);
        assert!((earlier(&past, -1.0, [0.25, 5.0]) - 1.0).abs() < 1e-12);
        assert!((earlier(&[], 0.0, [0.25, 5.0]) - 5.0).abs() < 1e-12);
    }
}
