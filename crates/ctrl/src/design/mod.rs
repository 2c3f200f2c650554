//! Analysis of control loops on the desk: allocates, takes its time, and never runs in the loop.
#![expect(non_snake_case, reason = "matrices carry the capital letters of the cited equations")]

pub mod mu;
