//! Contact: forces that are wanted, and motion that yields.
//!
//! Force of the robot on the environment is minus the measured wrench. A positive force error (wanted minus real) moves the robot towards
//! the environment.
#![expect(non_snake_case, reason = "matrices carry the capital letters of the cited equations")]

pub mod actuator;
pub mod admittance;
pub mod curve;
pub mod explicit;
pub mod gains;
pub(crate) mod held;
pub mod hybrid;
pub mod impedance;
pub mod pid;
pub mod task;

pub use actuator::{ActuatorForce, ActuatorForceConfig, ForceLaw};
pub use admittance::{Admittance, AdmittanceConfig};
pub use curve::GainCurve;
pub use explicit::{ExplicitForce, ExplicitForceConfig};
pub use hybrid::{Hybrid, HybridConfig};
pub use impedance::{Impedance, ImpedanceConfig};
pub use pid::{ForcePid, ForcePidConfig};
pub use task::{JointTask, LinearTask, PlatformTask, Task, TaskMap};
