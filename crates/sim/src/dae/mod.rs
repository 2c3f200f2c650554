//! The robot as a differential-algebraic system with every effect of the catalogue: motors behind their gears, links on springs, laws
//! with memories, persons, end stops.
//!
//! Freedoms that effects add become joints of an extended model (`extension.rs`); loops are met by reduction and by projection
//! after every step. Between events a smooth rule integrates with fixed directions of sliding; a step in which a contact changes
//! direction, or a stop is struck, is cut there and handed over to the rule that solves contacts as sets \[Moreau1988\].

mod events;
mod extension;
mod implicit;
mod moreau;
mod person;
mod plant;
mod runge_kutta;
mod start;
mod system;
mod touch;

pub use plant::{ConstrainedOptions, ConstrainedPlant, Integrator};
