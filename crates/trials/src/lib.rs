//! The blind proof: recordings of robots in which physics is concealed, sealed answers, and scores of what a diagnosis made of them.
//!
//! The other side of `pkm-diagnose`, and a stranger to it: plants ([`plant`]), laws ([`laws`]), integrator ([`machine`]), random
//! streams and the ruler of sizes ([`ruler`]) are written for the trials alone. A case ([`case`]) is made, its answer is sealed
//! ([`seal`]), a diagnosis runs on the public files as a process of its own, the seals are opened and the verdicts scored ([`score`]).
//! docs/PROOF.md says how to rerun it and how to hand in cases of one's own.
//!
//! Not in here: the running of a diagnosis (the verb `pkm prove`), and anything of the mechanics, the engine or the simulator.

extern crate alloc;

pub mod base;
pub mod bench;
pub mod case;
pub mod laws;
pub mod machine;
pub mod math;
pub mod menu;
pub mod plant;
pub mod random;
pub mod real;
pub mod reference;
pub mod refit;
pub mod residual;
pub mod robot;
pub mod ruler;
pub mod score;
pub mod seal;
pub mod sensing;
