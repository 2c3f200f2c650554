//! McDaid, Tsoi and Xie: force control of a 4-UPS ankle robot in the coordinates of its legs \[McDaid\].

pub mod ankle;
mod legs;
mod observer;
mod reach;
mod robustness;
mod schedule;
mod stability;
pub mod trial;
mod trials;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The chapter's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let mut rows = legs::rows()?;
    rows.extend(reach::rows()?);
    rows.extend(observer::rows()?);
    progress(0.02);
    let (more, steps) = stability::rows()?;
    rows.extend(more);
    progress(0.1);
    let (more, mut plots) = schedule::rows()?;
    rows.extend(more);
    progress(0.3);
    let (more, bounds) = robustness::rows(&mut |x| progress(0.3 + 0.5 * x))?;
    rows.extend(more);
    rows.extend(trials::free_motion()?);
    progress(0.9);
    rows.extend(trials::held_moment()?);
    progress(1.0);
    plots.extend([steps, bounds]);
    Ok(Reproduction { rows, plots })
}
