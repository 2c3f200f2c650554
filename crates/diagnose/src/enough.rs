//! Whether the band and the gaps leave anything to fit and to judge on.

use crate::design::Design;

/// Rows per drive below which neither a fit nor an error means anything: a joint alone has three ordinary parameters.
const LEAST: usize = 5;

/// Why too little is left; `None` when there is enough.
pub(crate) fn reasons(design: &Design, band: f64) -> Option<Vec<String>> {
    let judged = design.rows.iter().map(|r| (0..r.time.len()).filter(|&i| r.valid[i] && r.fold[i].is_none()).count()).sum::<usize>();
    let to_judge = too_few("to judge on", judged * design.n_joints, design.n_joints, band);
    let out: Vec<String> = too_few_to_fit(design, band).into_iter().chain(to_judge).collect();
    if out.is_empty() { None } else { Some(out) }
}

/// The same of the rows that are fitted alone.
pub(crate) fn too_few_to_fit(design: &Design, band: f64) -> Option<String> {
    let mut fitted = 0;
    for rows in &design.rows {
        for i in (0..rows.time.len()).filter(|&i| rows.valid[i] && rows.fold[i].is_some()) {
            fitted += rows.moving.iter().filter(|m| m[i]).count();
        }
    }
    too_few("to fit on", fitted, design.n_joints, band)
}

fn too_few(what: &str, n: usize, joints: usize, band: f64) -> Option<String> {
    let least = LEAST * joints;
    (n < least).then(|| {
        format!("the band of {band:.3} Hz leaves {n} rows {what} (at least {least} are needed): raise the band, or record for longer")
    })
}
