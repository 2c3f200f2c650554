//! A driver of `CiA 402` drives on `EtherCAT`, the worked example of docs/DRIVERS.md: copy this folder and change what is yours.
//!
//! `main.rs` is the process, `master.rs` all that knows the library ethercrab, `bus.rs` what is believed of a cycle, `image.rs` which bytes
//! mean what. Only `main.rs` opens a network card: the tests run the rest, ethercrab included, on drives that are made of numbers.

pub mod bus;
pub mod image;
pub mod master;
