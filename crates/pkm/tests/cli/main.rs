//! The command as its users meet it.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

mod bad_input;
mod bags;
mod controllers;
mod doctor;
mod excite;
mod export;
mod fixture;
mod identify;
mod mu;
mod pages;
mod plan;
mod prove;
mod replay;
mod reproduce;
mod settle;
mod simulate;
mod twin;
mod verbs;
mod version;
mod world;
