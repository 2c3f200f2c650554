//! Loop closure: how far the loops are open, how that changes, and what it makes of the passive coordinates.

mod gap;
mod reduce;
mod solve;

pub use gap::{loop_drift, loop_gap};
pub use reduce::reduction;
pub use solve::{Closure, assemble, mid_pose, mobility, solve_accelerations, solve_positions, solve_velocities, walk_to};
