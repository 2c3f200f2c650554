//! Why an experiment cannot be done.

use pkm_ctrl::ConfigError;
use pkm_sim::SimError;

/// Why an experiment cannot be done: a mistake in this crate or below it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PaperError {
    /// A shipped robot that does not load.
    #[error("robot {name}: {reason}")]
    Robot {
        /// Its name.
        name: &'static str,
        /// What its loader says.
        reason: String,
    },
    /// Loops that do not close.
    #[error("{what}: loops do not close, gap {gap:e}")]
    Open {
        /// In which experiment.
        what: &'static str,
        /// Largest gap `[m | rad]`.
        gap: f64,
    },
    /// A controller that cannot be built.
    #[error("controller: {0}")]
    Controller(#[from] ConfigError),
    /// A simulation that cannot start or go on.
    #[error(transparent)]
    Simulation(#[from] SimError),
    /// Anything else, said by the library that found it.
    #[error("{what}: {reason}")]
    Other {
        /// In which experiment.
        what: &'static str,
        /// What the library says.
        reason: String,
    },
}
