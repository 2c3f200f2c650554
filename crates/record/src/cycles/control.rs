//! One step of a controller: everything it was given, and what it answered.

use alloc::sync::Arc;

use crate::mcap::cdr;

/// One step of a controller, as it is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control<'a> {
    /// Whether the controller was set to rest before it.
    pub is_first: bool,
    /// Whether it is a step of another law than that of the position loop, where a daemon has both.
    pub is_other_law: bool,
    /// Whether the controller reported a fault.
    pub is_faulted: bool,
    /// Time since the last step `[s]`.
    pub dt: f64,
    /// Time from the last measured positions to these, by the stamps of both `[s]`; zero where these are not new.
    pub q_dt: f64,
    /// Measured positions `[m | rad]`.
    pub q_meas: &'a [f64],
    /// Measured efforts `[N | N·m]`.
    pub tau_meas: &'a [f64],
    /// Measured wrench, force first `[N, N·m]`.
    pub wrench_meas: [f64; 6],
    /// Wanted positions `[m | rad]`.
    pub q_ref: &'a [f64],
    /// Wanted velocities `[m/s | rad/s]`.
    pub v_ref: &'a [f64],
    /// Wanted accelerations `[m/s² | rad/s²]`.
    pub a_ref: &'a [f64],
    /// Wanted wrench, force first `[N, N·m]`.
    pub wrench_ref: [f64; 6],
    /// Effort that the model asks for `[N | N·m]`.
    pub tau_ff: &'a [f64],
    /// What the controller answered: efforts `[N | N·m]`, or voltages `[V]`.
    pub command: &'a [f64],
}

/// One step of a controller, with numbers of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlStep {
    /// Time of the sample it answers `[s]`.
    pub t: f64,
    /// Number of the step or period.
    pub number: u64,
    is_first: bool,
    is_other_law: bool,
    is_faulted: bool,
    dt: f64,
    q_dt: f64,
    wrenches: [[f64; 6]; 2],
    /// All lists of one value per drive, one after the other: one allocation per step.
    numbers: Arc<[f64]>,
}

/// Lists of one value per drive.
const LISTS: usize = 7;

impl ControlStep {
    /// The step at `t` `[s]`.
    #[must_use]
    pub fn new(t: f64, number: u64, step: &Control<'_>) -> Self {
        let lists = [step.q_meas, step.tau_meas, step.q_ref, step.v_ref, step.a_ref, step.tau_ff, step.command];
        let n = lists.iter().map(|list| list.len()).max().unwrap_or(0);
        let number_of = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(f64::NAN);
        Self {
            t,
            number,
            is_first: step.is_first,
            is_other_law: step.is_other_law,
            is_faulted: step.is_faulted,
            dt: step.dt,
            q_dt: step.q_dt,
            wrenches: [step.wrench_meas, step.wrench_ref],
            numbers: lists.iter().flat_map(|list| (0..n).map(|i| number_of(list, i))).collect(),
        }
    }

    /// Its parts.
    #[must_use]
    pub fn as_control(&self) -> Control<'_> {
        let n = self.numbers.len() / LISTS;
        let list = |k: usize| self.numbers.get(k * n..(k + 1) * n).unwrap_or_default();
        let [wrench_meas, wrench_ref] = self.wrenches;
        Control {
            is_first: self.is_first,
            is_other_law: self.is_other_law,
            is_faulted: self.is_faulted,
            dt: self.dt,
            q_dt: self.q_dt,
            q_meas: list(0),
            tau_meas: list(1),
            wrench_meas,
            q_ref: list(2),
            v_ref: list(3),
            a_ref: list(4),
            wrench_ref,
            tau_ff: list(5),
            command: list(6),
        }
    }

    /// From a message at `t` `[s]`.
    pub(crate) fn from_message(t: f64, message: &cdr::Control) -> Result<Self, cdr::Fault> {
        let [q_meas, tau_meas, wrench_meas, q_ref, v_ref, a_ref, wrench_ref, tau_ff, command] = &message.lists;
        let n = command.len();
        if [q_meas, tau_meas, q_ref, v_ref, a_ref, tau_ff].iter().any(|list| list.len() != n) {
            return Err("its lists are not of one length");
        }
        let wrench = |list: &Vec<f64>| <[f64; 6]>::try_from(list.as_slice()).map_err(|_| "a wrench has not six components");
        let control = Control {
            is_first: message.flags & 1 != 0,
            is_faulted: message.flags & 2 != 0,
            is_other_law: message.flags & 4 != 0,
            dt: message.dt,
            // Before it was written, controllers took every period's positions as new.
            q_dt: message.q_dt.unwrap_or(message.dt),
            q_meas,
            tau_meas,
            wrench_meas: wrench(wrench_meas)?,
            q_ref,
            v_ref,
            a_ref,
            wrench_ref: wrench(wrench_ref)?,
            tau_ff,
            command,
        };
        Ok(Self::new(t, message.number, &control))
    }
}

/// Writes a step as a message.
pub(crate) fn encode(message: &mut cdr::Writer, stamp_ns: i64, number: u64, step: &Control<'_>) {
    message.start(stamp_ns, "");
    message.u64(number);
    message.u32(u32::from(step.is_first) | u32::from(step.is_faulted) << 1 | u32::from(step.is_other_law) << 2);
    message.f64(step.dt);
    let (wrench_meas, wrench_ref) = (&step.wrench_meas[..], &step.wrench_ref[..]);
    for list in [step.q_meas, step.tau_meas, wrench_meas, step.q_ref, step.v_ref, step.a_ref, wrench_ref, step.tau_ff, step.command] {
        message.f64s(list);
    }
    message.f64(step.q_dt);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_comes_back_to_the_bit() {
        let odd = [f64::MIN_POSITIVE / 3.0, -0.0, 1.0 / 3.0];
        let control = Control {
            is_first: true,
            is_other_law: true,
            is_faulted: false,
            dt: 1e-3,
            q_dt: 3e-3,
            q_meas: &odd,
            tau_meas: &[1.0, 2.0, 3.0],
            wrench_meas: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            q_ref: &[4.0, 5.0, 6.0],
            v_ref: &[7.0, 8.0, 9.0],
            a_ref: &[10.0, 11.0, 12.0],
            wrench_ref: [-1.0; 6],
            tau_ff: &[13.0, 14.0, 15.0],
            command: &[16.0, 17.0, 1e300],
        };
        let mut message = cdr::Writer::default();
        encode(&mut message, 1_500_000_000, 7, &control);
        let back = cdr::control(message.finish()).unwrap();
        assert_eq!((back.header.stamp_ns, back.number), (1_500_000_000, 7));
        let step = ControlStep::from_message(1.5, &back).unwrap();
        assert_eq!(step.as_control(), control);
        assert_eq!(step.as_control().q_meas[1].to_bits(), (-0.0_f64).to_bits());
        // A file of before there were stamps between positions: every one was new.
        let before = message.finish();
        let old = cdr::control(&before[..before.len() - 8]).unwrap();
        assert_eq!(ControlStep::from_message(1.5, &old).unwrap().as_control(), Control { q_dt: 1e-3, ..control });
        assert!(cdr::control(&before[..before.len() - 3]).is_err());
        // A list of another length is no step.
        let short = Control { tau_ff: &[1.0], ..control };
        encode(&mut message, 0, 0, &short);
        let message = cdr::control(message.finish()).unwrap();
        assert_eq!(ControlStep::from_message(0.0, &message), Err("its lists are not of one length"));
    }
}
