//! The contract with hardware and time. Knows no dynamics and no controller.
//!
//! A [`Backend`] gives [`StateFrame`]s and takes [`CommandFrame`]s, both of fixed layout and in SI units; a robot, a simulation and a
//! recording look the same through it. Decorators wrap one backend in another: [`Limiter`] bounds what is asked of the drives,
//! [`Watchdog`] admits one commander, notices stale state and expired commands and then applies a [`SafeAction`], [`FaultyHal`] injects
//! faults from a script. A whole HAL is `Watchdog<Limiter<device>, clock>`.
//!
//! Time enters the workspace through [`Clock`] alone, so that a loop can run on a real clock, on a simulated one, or step by step.
//! Nothing in here allocates, blocks, or panics on a number.
//!
//! ```
//! use pkm_hal::backends::Loopback;
//! use pkm_hal::{Backend, CommandFrame, ManualClock, Mode};
//!
//! let clock = ManualClock::new(0);
//! let mut robot = Loopback::new(2, &clock);
//! let mut command = CommandFrame::new(2, Mode::Effort);
//! command.sequence = 1;
//! command.tau[..2].copy_from_slice(&[0.5, -0.5]);
//! robot.write(&command.sealed())?;
//! assert_eq!(robot.read()?.tau[..2], [0.5, -0.5]);
//! # Ok::<(), pkm_hal::HalError>(())
//! ```
#![cfg_attr(not(feature = "std"), no_std)]

pub mod backend;
pub mod backends;
pub mod checksum;
pub mod clock;
#[cfg(feature = "conformance")]
pub mod conformance;
pub mod cycle;
pub mod faulty;
pub mod frame;
pub mod limiter;
pub mod safe_action;
pub mod session;
pub mod units;
pub mod watchdog;

pub use backend::{Backend, HalError};
#[cfg(feature = "std")]
pub use clock::MonotonicClock;
pub use clock::{Clock, ManualClock, epoch_offset_of};
#[cfg(feature = "system-clock")]
pub use clock::{SystemClock, epoch_offset_ns};
pub use cycle::{Cause, CycleRecord, CycleSink, CycleSource, Phase, Transition};
pub use faulty::{Fault, FaultyHal, Injection};
pub use frame::{CommandFrame, MAX_AXES, MAX_SENSORS, Mode, Signal, StateFrame};
pub use limiter::{AxisLimits, Limiter};
pub use safe_action::{Carried, SafeAction, SafeKind};
pub use session::Session;
pub use units::{DacCode, DacScale, EncoderScale, EncoderTicks};
pub use watchdog::{Watchdog, WatchdogLimits};
