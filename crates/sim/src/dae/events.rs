//! One step of the plant: smooth where it can be, cut where something changes.

use crate::dae::extension::Stop;
use crate::dae::implicit::{Ended, GAUSS, Implicit, RADAU};
use crate::dae::moreau::{Modes, Moreau};
use crate::dae::runge_kutta::RungeKutta;
use crate::dae::system::{State, System};
use crate::error::SimError;

/// Events within one step after which the rest of it is taken without looking for more.
const MAX_EVENTS: usize = 30;

/// Tries to find the time of an event.
const MAX_SEARCHES: usize = 40;

/// An event is found when its room is below this `[m | rad]`, its speed below this `[m/s | rad/s]`.
const FOUND: f64 = 1e-13;

/// Shortest share of a step.
const SHORTEST: f64 = 1e-9;

/// Halvings of a step in which Newton does not converge.
const MAX_HALVINGS: u32 = 8;

/// Speed below which a joint stands `[m/s | rad/s]`: rounding.
const STANDING: f64 = 1e-12;

/// How a stretch without events is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Smooth {
    RungeKutta,
    Radau,
    Gauss,
    Moreau,
}

/// What happens first in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    /// A resisting joint comes to rest.
    Rest(usize),
    /// A stop is struck.
    Strike(usize),
}

/// Integrators and modes of a plant.
#[derive(Debug)]
pub(crate) struct Stepper {
    pub(crate) smooth: Smooth,
    runge_kutta: RungeKutta,
    implicit: Implicit,
    moreau: Moreau,
    pub(crate) stops: Vec<Stop>,
    pub(crate) touches: Vec<bool>,
    rubs: Vec<bool>,
    pub(crate) sticks: Vec<bool>,
    before: State,
    /// What stuck and touched, and where it slid, when the step began.
    kept: ([Vec<bool>; 2], Vec<f64>),
}

impl Stepper {
    pub(crate) fn new(system: &System, state: &State, stops: Vec<Stop>, smooth: Smooth) -> Self {
        let n = system.resisting.len();
        Self {
            smooth,
            runge_kutta: RungeKutta::new(state),
            implicit: Implicit::new(system, state),
            moreau: Moreau::new(system, state, stops.len()),
            touches: vec![false; stops.len()],
            kept: ([vec![true; n], vec![false; stops.len()]], vec![0.0; n]),
            stops,
            rubs: vec![false; n],
            sticks: vec![true; n],
            before: state.clone(),
        }
    }

    /// Which joints stand and which slide whither, from the velocities; which stops are touched.
    pub(crate) fn look(&mut self, system: &mut System, state: &State) {
        for (r, at) in system.resisting.iter().enumerate() {
            let v = state.v[at.joint];
            self.sticks[r] = v.abs() <= STANDING;
            system.directions[r] = 0.0;
        }
        for (touches, stop) in self.touches.iter_mut().zip(&self.stops) {
            *touches = stop.room(&state.q) <= FOUND;
        }
    }

    /// Moves `state` on by `h` `[s]` under the drives' efforts `push`.
    pub(crate) fn step(&mut self, system: &mut System, state: &mut State, push: &[f64], h: f64) -> Result<(), SimError> {
        let mut left = h;
        for _ in 0..MAX_EVENTS {
            self.find_rubbing(system, state);
            self.keep(system, state);
            self.part(system, state, push, left)?;
            let Some(mut event) = self.first_event(system, state) else {
                if let Some(r) = self.left_the_wrong_way(system, state) {
                    // Taken again with the joint at rest: which way it leaves is solved for together with what pushes it meanwhile.
                    self.restore(system, state);
                    self.rest(system, r);
                    continue;
                }
                advance_foreign(system, state, left);
                return Ok(());
            };
            let share = self.search(system, state, push, (left, &mut event))?;
            advance_foreign(system, state, share * left);
            self.happen(system, state, event)?;
            left *= 1.0 - share;
            if left <= SHORTEST * h {
                return Ok(());
            }
        }
        // Events accumulate, as when a ball comes to rest: what is left of the step is taken at once.
        self.find_rubbing(system, state);
        let smooth = core::mem::replace(&mut self.smooth, Smooth::Moreau);
        let ended = self.part(system, state, push, left);
        self.smooth = smooth;
        advance_foreign(system, state, left);
        ended
    }

    fn find_rubbing(&mut self, system: &mut System, state: &State) {
        for r in 0..system.resisting.len() {
            let at = |sign: f64| system.effort(r, &system.joint_state(r, state, 0.0, sign));
            let (backward, forward) = (at(-1.0), at(1.0));
            self.rubs[r] = forward > backward;
            let v = state.v[system.resisting[r].joint];
            if self.rubs[r] && !self.sticks[r] && system.directions[r] == 0.0 {
                system.directions[r] = pkm_dyn::math::sign(v);
                self.sticks[r] = v == 0.0;
            } else if !self.rubs[r] {
                // Without friction there is nothing to stick to; should it come back, the velocity says what holds.
                system.directions[r] = 0.0;
                self.sticks[r] = v.abs() <= STANDING;
            }
        }
    }

    /// One step without looking for events.
    fn part(&mut self, system: &mut System, state: &mut State, push: &[f64], h: f64) -> Result<(), SimError> {
        let holds = self.rubs.iter().zip(&self.sticks).any(|(rubs, sticks)| *rubs && *sticks) || self.touches.contains(&true);
        let time = state.time;
        let failed = || SimError::Stuck { time };
        let smooth = if holds { Smooth::Moreau } else { self.smooth };
        match smooth {
            Smooth::RungeKutta => self.runge_kutta.step(system, state, push, h).ok_or_else(failed)?,
            Smooth::Radau | Smooth::Gauss => self.implicit_part(system, state, push, h)?,
            Smooth::Moreau => {
                let Self { rubs, sticks, stops, touches, .. } = self;
                let mut modes = Modes { rubs, sticks, stops, touches };
                if self.moreau.step(system, state, push, h, &mut modes).is_none() {
                    return Err(if self.moreau.is_solvable() { failed() } else { SimError::Diverged { time } });
                }
            }
        }
        if state.v.iter().any(|v| !v.is_finite()) {
            return Err(SimError::Diverged { time: state.time });
        }
        Ok(())
    }

    fn implicit_part(&mut self, system: &mut System, state: &mut State, push: &[f64], h: f64) -> Result<(), SimError> {
        let rule = if self.smooth == Smooth::Gauss { &GAUSS } else { &RADAU };
        let mut parts = 1_u32;
        let mut done = 0_u32;
        while done < parts {
            match self.implicit.step(system, state, push, (h / f64::from(parts), rule)) {
                Some(Ended::Done) => done += 1,
                Some(Ended::TooLong) if parts < 1 << MAX_HALVINGS => (parts, done) = (2 * parts, 2 * done),
                _ => return Err(SimError::Stuck { time: state.time }),
            }
        }
        Ok(())
    }

    /// The event that has happened by now, the one that overshot most as a share of its way if there are several.
    fn first_event(&self, system: &System, state: &State) -> Option<Event> {
        let mut first = (f64::INFINITY, None);
        let mut consider = |share: f64, event: Event| {
            if share < first.0 {
                first = (share, Some(event));
            }
        };
        for (r, at) in system.resisting.iter().enumerate() {
            let (before, v) = (self.before.v[at.joint], state.v[at.joint]);
            let slid = system.directions[r];
            if self.rubs[r] && slid != 0.0 && slid * before > STANDING && slid * v < 0.0 {
                consider(before / (before - v), Event::Rest(r));
            }
        }
        for (s, stop) in self.stops.iter().enumerate() {
            let (before, room) = (stop.room(&self.before.q), stop.room(&state.q));
            if !self.touches[s] && room < -FOUND {
                consider((before / (before - room)).max(0.0), Event::Strike(s));
            }
        }
        first.1
    }

    /// A joint that began to slide in one direction where it stood, within rounding, and has gone in the other: its friction would push it, and at no
    /// later reversal would that be seen.
    fn left_the_wrong_way(&self, system: &System, state: &State) -> Option<usize> {
        let is_wrong = |r: usize| {
            let (slid, joint) = (system.directions[r], system.resisting[r].joint);
            self.rubs[r] && slid * self.before.v[joint] <= STANDING && slid * state.v[joint] < -STANDING
        };
        (0..self.rubs.len()).find(|&r| is_wrong(r))
    }

    fn rest(&mut self, system: &mut System, r: usize) {
        self.sticks[r] = true;
        system.directions[r] = 0.0;
    }

    /// What is left until the event: positive before it, negative after.
    fn measure(&self, system: &System, state: &State, event: Event) -> f64 {
        match event {
            Event::Rest(r) => {
                let joint = system.resisting[r].joint;
                pkm_dyn::math::sign(self.before.v[joint]) * state.v[joint]
            }
            Event::Strike(s) => self.stops[s].room(&state.q),
        }
    }

    /// Steps from before again and again until just this side of the event; the share of the step `h` until then.
    ///
    /// Regula falsi with the Illinois weight. An event found on the way that comes first takes the other's place.
    fn search(&mut self, system: &mut System, state: &mut State, push: &[f64], (h, event): (f64, &mut Event)) -> Result<f64, SimError> {
        let (mut low, mut high) = (0.0, 1.0);
        let mut above = self.measure(system, &self.before, *event).max(0.0);
        let mut below = self.measure(system, state, *event);
        let mut share = 0.0;
        for tries in 0..MAX_SEARCHES {
            share = if above - below > 0.0 { low + (high - low) * above / (above - below) } else { low };
            if tries % 8 == 7 {
                share = 0.5 * (low + high);
            }
            share = share.clamp(0.0, 1.0);
            self.restore(system, state);
            if share > SHORTEST {
                self.part(system, state, push, share * h)?;
            }
            let other = self.first_event(system, state);
            if let Some(other) = other.filter(|other| other != event) {
                (*event, high) = (other, share);
                (low, above) = (0.0, self.measure(system, &self.before, other).max(0.0));
                below = self.measure(system, state, other);
                continue;
            }
            let value = self.measure(system, state, *event);
            if value.abs() <= FOUND || high - low <= SHORTEST {
                break;
            }
            if value > 0.0 {
                (low, above) = (share, value);
                below *= 0.5;
            } else {
                (high, below) = (share, value);
                above *= 0.5;
            }
        }
        Ok(share)
    }

    fn keep(&mut self, system: &System, state: &State) {
        self.before.copy_from(state);
        let ([sticks, touches], directions) = &mut self.kept;
        sticks.copy_from_slice(&self.sticks);
        touches.copy_from_slice(&self.touches);
        directions.copy_from_slice(&system.directions);
    }

    fn restore(&mut self, system: &mut System, state: &mut State) {
        state.copy_from(&self.before);
        let ([sticks, touches], directions) = &self.kept;
        self.sticks.copy_from_slice(sticks);
        self.touches.copy_from_slice(touches);
        system.directions.copy_from_slice(directions);
    }

    fn happen(&mut self, system: &mut System, state: &mut State, event: Event) -> Result<(), SimError> {
        match event {
            Event::Rest(r) => {
                self.rest(system, r);
                Ok(())
            }
            Event::Strike(s) => {
                self.touches[s] = true;
                let Self { rubs, sticks, stops, touches, .. } = self;
                let mut modes = Modes { rubs, sticks, stops, touches };
                self.moreau.strike(system, state, &mut modes).ok_or(SimError::Stuck { time: state.time })?;
                for (touches, stop) in self.touches.iter_mut().zip(&self.stops) {
                    // What bounces is off at once.
                    *touches &= stop.side * stop.difference(&state.v) >= -STANDING;
                }
                self.turn_round(system, state);
                Ok(())
            }
        }
    }

    /// After an impact joints may slide the other way.
    fn turn_round(&mut self, system: &mut System, state: &State) {
        for (r, at) in system.resisting.iter().enumerate() {
            let v = state.v[at.joint];
            self.sticks[r] = v.abs() <= STANDING;
            system.directions[r] = if self.rubs[r] && !self.sticks[r] { pkm_dyn::math::sign(v) } else { 0.0 };
        }
    }
}

fn advance_foreign(system: &mut System, state: &State, h: f64) {
    if h <= 0.0 {
        return;
    }
    for f in 0..system.foreign.len() {
        let found = system.resisting.iter().position(|r| r.has_foreign(f));
        if let Some(r) = found {
            let v = state.v[system.resisting[r].joint];
            let seen = system.joint_state(r, state, v, pkm_dyn::math::sign(v));
            system.foreign[f].advance(&seen, h);
        }
    }
}
