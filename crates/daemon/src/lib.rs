//! The loop on the robot's computer.
