//! Scores: verdicts against opened answers, counted with their intervals, as a table and as a picture.

mod asked;
mod curves;
mod judge;
mod named;
mod picture;
mod reason;
mod table;
mod tally;
mod verdict;

pub use judge::{Asked, Marks, Ran, judge};
pub use picture::page;
pub use table::{beside, markdown};
pub use tally::{Count, Tally, tally, wilson};
pub use verdict::{Finding, Invisible, Place, RuledOut, Smallest, Verdict};
