//! The bench on which effects get their sizes: recordings A and B without anything concealed, with it, and the ruler between the two.

use nalgebra::DVector;

use crate::base::{Base, run};
use crate::case::{Level, Wish};
use crate::machine::Trace;
use crate::menu::{Choice, INSIDE, OUTSIDE, Scene, choose};
use crate::random::Stream;
use crate::reference::{Reference, drive_ratio, efforts};
use crate::residual::{BAND, Residual, basis, residual};
use crate::robot::RobotError;
use crate::ruler::{Healthy, Length, Rows, Ruler};
use crate::sensing::Noise;

/// An effect of size one stands out of healthy floors by this many of their spreads.
pub const Z: f64 = 4.0;

/// An effect of size one is at least this share of the squared floor, where it is largest: smaller ones are not worth a name to anybody, however
/// long the recording.
pub const WORTH: f64 = 0.03;

/// And it makes at least this share of the effort of the drive that feels it most.
pub const FELT: f64 = 0.005;

/// Below this share beside the basis, an effect is one that a refit swallows.
pub const INSIDE_SPAN: f64 = 0.05;

/// Effects that a refit swallows whole, whatever the ruler finds beside it: stick at reversals moves, and that alone can be 5 %.
const SWALLOWED: [&str; 4] = ["friction_viscous", "friction_coulomb", "inertia_error", "payload"];

/// Recordings that sizes are measured on, A and B, however many a diagnosis is given.
pub const MEASURED: usize = 2;

/// Motions of the same design besides that of the case on which the healthy robot shows its floor.
const OTHERS: u64 = 3;

/// What calibrates sizes: healthy residuals and the ruler over them.
pub struct Bench<'a> {
    base: &'a Base,
    references: &'a [Reference],
    noise: &'a Noise,
    healthy: Vec<Residual>,
    /// Root mean square of the healthy robot's effort per drive `[N]`.
    effort: DVector<f64>,
    ruler: Ruler,
}

/// A choice with the size at which it stands out as far as was asked for.
#[derive(Debug)]
pub struct Found {
    /// What, and where.
    pub choice: Choice,
    /// Size, in the unit of the choice.
    pub amount: f64,
    /// Size over the smallest that can be detected.
    pub size: f64,
    /// Share of the effect that a refit cannot take.
    pub share: f64,
    /// Share of the effort that the effect makes.
    pub effort: f64,
}

impl<'a> Bench<'a> {
    /// From the recordings' references and what the healthy robot did along those that sizes are measured on.
    ///
    /// # Errors
    /// Where the robot cannot follow another motion of the same design.
    pub fn new(base: &'a Base, noise: &'a Noise, references: &'a [Reference], silent: &[Trace], wish: &Wish) -> Result<Self, RobotError> {
        let mut stream = Stream::new(wish.seed, wish.number, "ruler");
        let silent = &silent[..MEASURED];
        let own = floor(base, noise, silent, &mut stream)?;
        let mut others = Vec::new();
        for _ in 0..OTHERS {
            let traces = (0..MEASURED).map(|r| Ok(base.followed(r, &mut stream)?.1)).collect::<Result<Vec<_>, RobotError>>()?;
            others.push(floor(base, noise, &traces, &mut stream)?);
        }
        let healthy = silent.iter().map(|t| residual(&base.plant, t, &noise.silent(t), BAND)).collect::<Result<Vec<_>, _>>()?;
        let rows: Vec<&Vec<f64>> = silent.iter().flat_map(|t| &t.effort).collect();
        let square = |k: usize| rows.iter().map(|r| r[k] * r[k]).sum::<f64>() / rows.len().max(1) as f64;
        let effort = DVector::from_fn(base.plant.robot.drives.len(), |k, _| square(k).sqrt().max(1e-12));
        Ok(Self { base, references, noise, healthy, effort, ruler: Ruler::new(&own, &others) })
    }

    /// Weight of a row per free coordinate.
    #[must_use]
    pub fn weights(&self) -> &DVector<f64> {
        &self.ruler.noise
    }

    /// What a choice of that amount adds to the residuals: its length, and the shares of the drives' efforts that it is.
    fn length(&self, choice: &Choice, amount: f64) -> Result<(Length, DVector<f64>), RobotError> {
        let mut column: Vec<Rows> = Vec::new();
        for (r, healthy) in self.healthy.iter().enumerate() {
            let mut machine = self.base.machine.clone();
            choice.put_on(&mut machine, amount, r)?;
            let trace = run(&machine, &self.references[r])?;
            column.push(residual(&self.base.plant, &trace, &self.noise.silent(&trace), BAND)?.minus(healthy));
        }
        Ok((self.ruler.length(&column), self.effort_shares(&column)))
    }

    /// Per drive the root mean square over that of the effort.
    fn effort_shares(&self, column: &[Rows]) -> DVector<f64> {
        let (mut squares, mut count) = (DVector::zeros(self.effort.len()), 0.0);
        for (y, (m, _)) in column.iter().flatten().zip(self.healthy.iter().flat_map(|h| &h.motion)) {
            if let Some(u) = efforts(&drive_ratio(&self.base.plant, m), y) {
                squares += u.component_div(&self.effort).map(|x| x * x);
                count += 1.0;
            }
        }
        squares.map(|s: f64| (s / f64::max(count, 1.0)).sqrt())
    }

    /// Finds the amount at which the effect stands out by `wanted`.
    fn calibrate(&self, choice: Choice, wanted: f64, may_be_inside: bool) -> Result<Option<Found>, RobotError> {
        let mut amount = choice.start;
        let mut known: Option<[f64; 2]> = None;
        let mut outcome: Option<[f64; 4]> = None;
        for _ in 0..6 {
            let Ok((length, shares)) = self.length(&choice, amount) else {
                // Too much for the robot: smaller.
                amount *= 0.3;
                continue;
            };
            let is_inside = length.share < INSIDE_SPAN;
            if is_inside && !may_be_inside {
                return Ok(None);
            }
            let size = size(&length, is_inside, shares.max());
            let effort = shares.norm() / (shares.len() as f64).sqrt();
            outcome = Some([amount, size, length.share, effort]);
            if (size / wanted - 1.0).abs() < 0.1 || size <= 0.0 {
                break;
            }
            // Locally a power of the amount; between a third and three to begin with.
            let power = known.map_or(1.0, |[a, s]| {
                let p = crate::math::ln(size / s) / crate::math::ln(amount / a);
                if p.is_finite() { p.clamp(0.3, 3.0) } else { 1.0 }
            });
            known = Some([amount, size]);
            let next = (amount * crate::math::pow(wanted / size, 1.0 / power)).clamp(amount * 1e-3, amount * 1e3).min(choice.cap);
            if (next / amount - 1.0).abs() < 1e-6 {
                break;
            }
            amount = next;
        }
        // Nothing that is nowhere near what was asked for; a cap may keep it smaller.
        let near = outcome.filter(|[_, size, ..]| *size > 0.2 * wanted && *size < 3.0 * wanted);
        Ok(near.map(|[amount, size, share, effort]| Found { choice, amount, size, share, effort }))
    }

    /// Chooses effects and finds their amounts.
    ///
    /// # Errors
    /// When nothing of the kind can be concealed in the robot.
    pub fn conceal(&self, wish: &Wish, scene: &Scene<'_>, random: &mut Stream) -> Result<Vec<Found>, RobotError> {
        let count = match wish.level {
            Level::L4 => 2,
            level if level.is_healthy() => 0,
            _ => 1,
        };
        let mut out: Vec<Found> = Vec::new();
        for _ in 0..40 {
            if out.len() == count {
                return Ok(out);
            }
            let list: &[&str] = if wish.level == Level::L5 { &OUTSIDE } else { &INSIDE };
            let drawn = *random.choose(list).unwrap_or(&list[0]);
            let asked_for = wish.effect.as_deref().filter(|_| out.is_empty() && wish.level != Level::L5);
            let name = asked_for.unwrap_or(drawn);
            // Two effects must be two, and a base that rocks renumbers what others have been put on.
            let is_taken = out.iter().any(|f| f.choice.effect == name) || (count > 1 && name == "structure_flexibility");
            let is_swallowed = wish.level.is_refitted() && SWALLOWED.contains(&name);
            let Some(choice) = (!is_taken && !is_swallowed).then(|| choose(name, scene, random)).flatten() else { continue };
            out.extend(self.calibrate(choice, wish.size, !wish.level.is_refitted())?);
        }
        let what = wish.effect.as_deref().unwrap_or("nothing");
        let verb = if wish.effect.is_some() { "cannot" } else { "could" };
        Err(RobotError::Unknown(format!("{what} {verb} be concealed in {} at {:?} with size {}", wish.robot, wish.level, wish.size)))
    }
}

/// Size of an effect over the smallest that should get a name: one that stands out of the floor, is a share of it, and is felt.
fn size(length: &Length, is_inside: bool, felt: f64) -> f64 {
    let (stands_out, kind) = if is_inside { (length.all, 0) } else { (length.beside, 1) };
    (stands_out / Z).min(length.over_floor[kind] / WORTH.sqrt()).min(felt / FELT)
}

/// What the nominal robot leaves of recordings of the healthy one, and what a refit can use.
fn floor(base: &Base, noise: &Noise, traces: &[Trace], stream: &mut Stream) -> Result<Healthy, RobotError> {
    let mut out = Healthy { left: Vec::new(), basis: Vec::new() };
    for trace in traces {
        let recording = noise.record(trace, stream);
        out.left.push(residual(&base.plant, trace, &recording, BAND)?.rows);
        out.basis.push(basis(&base.plant, trace, &recording, BAND)?);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::tanh;
    use crate::plant::Plant;
    use crate::reference::Path;
    use crate::robot::Robot;

    /// The pendulum's drive along a path, 250 samples per second, with `more` times its dry friction beside its rigid effort.
    fn recorded(plant: &Plant, more: f64) -> Result<Trace, RobotError> {
        let mut random = Stream::new(1, 1, "path");
        let path = Path::random(&[0.0515], &[0.03], (4.0, 5), &mut random);
        let mut trace = Trace::default();
        let mut q = plant.home.clone();
        for i in 0..2000 {
            let t = f64::from(i) * 4e-3;
            let [x, v, a] = path.at(t);
            q[plant.free[0]] = x[0];
            let m = plant.moving(&mut q, v.as_slice())?;
            let joint = plant.robot.drives[0].joint;
            let friction = more * plant.robot.joints[joint].coulomb * tanh(m.velocity[joint] / (0.003 * plant.robot.joints[joint].speed));
            let force = &m.mass * &a + &m.bias + DVector::from_element(1, friction * m.ratio[(joint, 0)]);
            let effort = efforts(&drive_ratio(plant, &m), &force).ok_or_else(|| RobotError::Unknown(String::new()))?;
            trace.t.push(t);
            trace.reading.push(vec![q[joint]]);
            trace.rate.push(vec![m.velocity[joint]]);
            trace.effort.push(vec![effort[0]]);
            trace.truth.push(q.clone());
            trace.wanted.push([vec![q[joint]], vec![m.velocity[joint]], vec![0.0]]);
        }
        Ok(trace)
    }

    #[test]
    fn an_effect_is_as_large_as_the_least_of_its_three_measures() {
        let length = |beside: f64, ratio: f64| Length { all: 2.0 * beside, beside, over_floor: [2.0 * ratio, ratio], share: 0.5 };
        // Eight spreads are size two, the square root of 3 % of the floor is size one, half a percent of the effort is.
        assert!((size(&length(8.0, 1.0), false, 0.1) - 2.0).abs() < 1e-12);
        assert!((size(&length(8.0, 1.0), true, 0.1) - 4.0).abs() < 1e-12);
        assert!((size(&length(80.0, 0.03_f64.sqrt()), false, 0.1) - 1.0).abs() < 1e-12);
        assert!((size(&length(80.0, 1.0), false, 0.001) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_friction_that_only_grew_is_taken_by_the_refit_whole() {
        let plant = Plant::new(Robot::shipped("motobotte").unwrap()).unwrap();
        let noise = Noise::typical(&plant.robot, &[1.0], 0.0, false);
        let of = |more: f64| {
            let trace = recorded(&plant, more).unwrap();
            let recording = noise.silent(&trace);
            (residual(&plant, &trace, &recording, BAND).unwrap(), basis(&plant, &trace, &recording, BAND).unwrap())
        };
        let ((once, columns), (thrice, _)) = (of(1.0), of(3.0));
        let column = vec![thrice.minus(&once)];
        let healthy = Healthy { left: column.clone(), basis: vec![columns] };
        // The sign is sharp at reversals; filtered on one side only, a tenth of it and more would be left there.
        let share = Ruler::new(&healthy, &[]).length(&column).share;
        assert!(share < 0.02, "{share}");
    }
}
