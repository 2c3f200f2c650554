//! Drives of the profile `CiA 402` (IEC 61800-7-201) in cyclic synchronous torque mode, behind any fieldbus that exchanges process images.
//!
//! The bus itself is a [`Fieldbus`]: `EtherCAT`, `CANopen`, or in tests a table of numbers. What a position counter and a per mille of rated
//! torque mean is a [`DriveScale`] for each drive. docs/DRIVERS.md builds a whole driver on it.

use crate::backend::{Backend, HalError};
use crate::frame::{CommandFrame, MAX_AXES, Mode, StateFrame, first_bits, status};
use crate::units::{EncoderScale, EncoderTicks};

/// What a drive sends every cycle: objects 6041h, 6064h, 606Ch, 6077h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DriveInputs {
    /// Statusword.
    pub status: u16,
    /// Position actual value.
    pub position: EncoderTicks,
    /// Velocity actual value `[ticks/s]`.
    pub velocity: i32,
    /// Torque actual value `[1/1000 of the rated one]`.
    pub torque: i16,
}

/// What a drive is sent every cycle: objects 6040h, 6060h, 6071h.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveOutputs {
    /// Controlword.
    pub control: u16,
    /// Mode of operation: always 10, cyclic synchronous torque.
    pub mode: i8,
    /// Target torque `[1/1000 of the rated one]`.
    pub torque: i16,
}

impl DriveOutputs {
    /// No voltage.
    pub const OFF: Self = Self { control: 0, mode: TORQUE_MODE, torque: 0 };
}

/// Cyclic synchronous torque.
const TORQUE_MODE: i8 = 10;

/// The bus behind the drives.
pub trait Fieldbus {
    /// One cycle: `outputs` go to the drives, `inputs` come from them, one of each per drive. When the inputs were sampled, by the clock of the
    /// loop `[ns]`. It neither waits for a drive that stays away nor allocates.
    ///
    /// # Errors
    /// [`HalError::Gone`] where not every drive took part: what the others sent is not a state of the robot.
    fn exchange(&mut self, outputs: &[DriveOutputs], inputs: &mut [DriveInputs]) -> Result<u64, HalError>;
}

/// What the numbers of a drive mean at its joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveScale {
    /// Its position counter.
    pub encoder: EncoderScale,
    /// Effort at the joint at rated torque `[N | N·m]`; negative where the drive pushes against the axis.
    pub rated_effort: f64,
}

/// States of a drive that its statusword tells apart (IEC 61800-7-201, table of the statusword).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveState {
    /// It starts, or tests itself.
    NotReady,
    /// It may be set up; no voltage.
    SwitchOnDisabled,
    /// High voltage may be switched on.
    ReadyToSwitchOn,
    /// High voltage is on, no torque.
    SwitchedOn,
    /// It follows its target.
    OperationEnabled,
    /// It stops by itself.
    QuickStopActive,
    /// It stops because of a fault.
    FaultReaction,
    /// It has stopped because of a fault.
    Fault,
}

impl DriveState {
    /// What a statusword says.
    #[must_use]
    pub const fn of(status: u16) -> Self {
        match (status & 0x6f, status & 0x4f) {
            (0x21, _) => Self::ReadyToSwitchOn,
            (0x23, _) => Self::SwitchedOn,
            (0x27, _) => Self::OperationEnabled,
            (0x07, _) => Self::QuickStopActive,
            (_, 0x40) => Self::SwitchOnDisabled,
            (_, 0x0f) => Self::FaultReaction,
            (_, 0x08) => Self::Fault,
            _ => Self::NotReady,
        }
    }

    /// The controlword of the next step towards operation, or away from it.
    const fn towards(self, is_wanted: bool) -> u16 {
        if !is_wanted {
            return 0;
        }
        match self {
            Self::SwitchOnDisabled => 0x06,
            Self::ReadyToSwitchOn => 0x07,
            Self::SwitchedOn | Self::OperationEnabled => 0x0f,
            Self::NotReady | Self::QuickStopActive | Self::FaultReaction | Self::Fault => 0,
        }
    }
}

/// Bit of the controlword whose rising edge acknowledges a fault.
const RESET: u16 = 0x80;

/// Cycles for which the bit is held: a bus may be slower than its master.
const RESET_CYCLES: u32 = 5;

/// `N` drives as a device: put a [`crate::Limiter`] and a [`crate::Watchdog`] around it.
///
/// [`Backend::read`] is the cycle of the bus, and a command goes out with the next one, also where cycles before it were lost: what is old by
/// then is not sent. Efforts bring the drives step by step to operation, every
/// other mode takes their voltage away, at which a drive engages its brake where it has one. [`Mode::Arm`] acknowledges faults.
#[derive(Debug)]
pub struct Cia402<F, const N: usize> {
    bus: F,
    scales: [DriveScale; N],
    outputs: [DriveOutputs; N],
    /// What the drives said last.
    inputs: [DriveInputs; N],
    state: StateFrame,
    is_wanted: bool,
    /// Targets `[1/1000 of the rated torque]`, and the efforts that they are `[N | N·m]`.
    targets: [i16; N],
    efforts: [f64; MAX_AXES],
    reset: u32,
}

impl<F: Fieldbus, const N: usize> Cia402<F, N> {
    /// Drives behind `bus`, without voltage.
    ///
    /// # Errors
    /// No drives or more than [`MAX_AXES`]; a rated effort of zero, or one that is no number.
    pub fn try_new(bus: F, scales: [DriveScale; N]) -> Result<Self, HalError> {
        if N == 0 || N > MAX_AXES {
            return Err(HalError::Config { axis: 0, what: "number of drives", value: N as f64, limit: "1 to 16" });
        }
        let is_bad = |scale: &DriveScale| !scale.rated_effort.is_finite() || scale.rated_effort.abs() < f64::MIN_POSITIVE;
        if let Some(axis) = scales.iter().position(is_bad) {
            let value = scales[axis].rated_effort;
            return Err(HalError::Config { axis, what: "rated effort", value, limit: "must be finite and not 0" });
        }
        let state = StateFrame::new(N, 0);
        let (outputs, inputs) = ([DriveOutputs::OFF; N], [DriveInputs::default(); N]);
        Ok(Self { bus, scales, outputs, inputs, state, is_wanted: false, targets: [0; N], efforts: [0.0; MAX_AXES], reset: 0 })
    }

    /// The bus.
    pub const fn bus_mut(&mut self) -> &mut F {
        &mut self.bus
    }

    /// What goes out with this cycle, by what the last one said.
    fn prepare(&mut self) {
        for (k, output) in self.outputs.iter_mut().enumerate() {
            let state = DriveState::of(self.inputs[k].status);
            let reset = if state == DriveState::Fault && self.reset > 0 { RESET } else { 0 };
            // Torque before operation is enabled would act the moment that it is.
            let torque = if self.is_wanted && state == DriveState::OperationEnabled { self.targets[k] } else { 0 };
            *output = DriveOutputs { control: state.towards(self.is_wanted) | reset, torque, ..DriveOutputs::OFF };
        }
        self.reset = self.reset.saturating_sub(1);
    }
}

/// Per mille of the rated torque that come nearest to an effort, and no more than the number can say.
fn per_mille(effort: f64, scale: &DriveScale) -> i16 {
    let x = 1000.0 * effort / scale.rated_effort;
    let rounded = if x < 0.0 { x - 0.5 } else { x + 0.5 };
    #[expect(clippy::cast_possible_truncation, reason = "a cast to an integer stops at its ends, and takes off the fraction")]
    let nearest = rounded as i16;
    nearest
}

impl<F: Fieldbus, const N: usize> Backend for Cia402<F, N> {
    fn n_axes(&self) -> usize {
        N
    }

    fn n_sensors(&self) -> usize {
        0
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.prepare();
        let mut inputs = self.inputs;
        let stamp_ns = self.bus.exchange(&self.outputs, &mut inputs)?;
        self.inputs = inputs;
        let state = &mut self.state;
        // Every cycle brings a sample, at a time that never falls.
        (state.sequence, state.stamp_ns) = (state.sequence + 1, state.stamp_ns.max(stamp_ns));
        (state.valid_q, state.valid_v, state.valid_tau) = (first_bits(N), first_bits(N), first_bits(N));
        (state.status, state.drive_fault) = (status::POWERED, 0);
        for (k, (input, scale)) in inputs.iter().zip(&self.scales).enumerate() {
            state.q[k] = input.position.position(&scale.encoder);
            state.v[k] = scale.encoder.tick() * f64::from(input.velocity);
            state.tau[k] = 1e-3 * scale.rated_effort * f64::from(input.torque);
            match DriveState::of(input.status) {
                DriveState::OperationEnabled => {}
                DriveState::Fault | DriveState::FaultReaction => (state.status, state.drive_fault) = (0, state.drive_fault | 1 << k),
                _ => state.status = 0,
            }
        }
        Ok(state.sealed())
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(N)?;
        self.is_wanted = mode == Mode::Effort;
        for (k, scale) in self.scales.iter().enumerate() {
            self.targets[k] = if self.is_wanted { per_mille(command.tau[k], scale) } else { 0 };
            self.efforts[k] = 1e-3 * scale.rated_effort * f64::from(self.targets[k]);
        }
        if mode == Mode::Arm {
            self.reset = RESET_CYCLES;
        }
        (self.state.nonce, self.state.command_sequence) = (command.nonce, command.sequence);
        Ok(())
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        Some(&self.efforts)
    }
}
