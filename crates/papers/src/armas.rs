//! Armas et al.: the 3UPS+1RPU, its base parameters, its exciting motion, its reduced model \[Armas\].

mod efforts;
pub mod geometry;
mod identification;
mod motions;
mod ranks;
mod truncation;

use pkm_ident::columns::Columns;

use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::Reproduction;
use truncation::{Candidates, KEPT, Order, triangle};

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let mut rows = geometry::rows()?;
    rows.extend(efforts::rows()?);
    rows.extend(ranks::rows()?);
    progress(0.05);
    let robot = identification::truth(shipped("ups3_rpu1")?.bare);
    rows.extend(motions::rows(&robot.model)?);
    let (identify, verify) = (motions::identify(), motions::verify());
    let columns = Columns::new(&robot);
    let candidates = Candidates::of(&robot, &columns);
    let order = Order::new(&triangle(&robot, &columns, &identify, motions::IDENTIFY_S)?, &candidates);
    let elsewhere = Order::new(&triangle(&robot, &columns, &verify, motions::VERIFY_S)?, &candidates);
    rows.extend(truncation::rows(&order, &elsewhere));
    let mut plots = vec![truncation::plot(&order, &elsewhere)];
    progress(0.1);
    let train = identification::recorded(&robot, &identify, motions::IDENTIFY_S, &mut |x| progress(0.1 + 0.5 * x))?;
    let test = identification::recorded(&robot, &verify, motions::VERIFY_S, &mut |x| progress(0.6 + 0.3 * x))?;
    let (reduced, all) = (order.first(KEPT), order.first(candidates.inertial.len()));
    let smooth: Vec<usize> = reduced.iter().copied().filter(|c| candidates.inertial.contains(c)).collect();
    let sets = identification::Sets { reduced, smooth: &smooth, all };
    let (more, forces) = identification::rows(&robot, [&train, &test], &sets)?;
    rows.extend(more);
    plots.extend(forces);
    progress(1.0);
    Ok(Reproduction { rows, plots })
}
