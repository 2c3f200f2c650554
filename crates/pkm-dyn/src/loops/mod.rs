//! Loop closure: how far the loops are open, how that changes, and what it makes of the dependent coordinates; the motion of an output,
//! and how near a pose is to a singularity.

mod actuation;
mod gap;
mod guide;
mod independent;
mod output;
mod reduce;
mod singularity;
mod solve;
mod wrench;

pub use actuation::{distribute, distribution, drive_jacobian, drive_reduction, internal_efforts};
pub(crate) use gap::Path;
pub use gap::{loop_drift, loop_gap};
pub use guide::{Coordinate, Guide};
pub(crate) use independent::choose_anew;
pub use independent::{Choice, choose_independent};
pub use output::{Output, coordinates, output_jacobian};
pub(crate) use reduce::{expand, reduce, reduced};
pub use singularity::{Singularities, Singularity};
pub use solve::{Closure, assemble, close_at, mid_pose, mobility, solve_accelerations, solve_positions, solve_velocities, walk_to};
pub(crate) use solve::{add_drift, factor_at};
pub use wrench::{joint_wrenches, loop_wrench};
