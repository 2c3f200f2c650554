//! How large an effect is: what it does to the efforts as a whole, whatever else could imitate a part of it.
//!
//! A controller feels the whole of a spring, though wrong masses along the same motion would look like most of it. Whether the recordings
//! tell the two apart is another question, and the contest's.

use crate::columns::Family;
use crate::design::ColumnId;
use crate::verdict::Use;
use crate::work::{Candidate, Variant, Work};

/// Size of a candidate in a shape, as a share of the effort of the joint that feels it most, with the fitted coefficients by column.
pub(crate) fn size(work: &Work, candidate: usize, variant: &Variant, coefficient: &dyn Fn(ColumnId) -> f64) -> f64 {
    let c = &work.candidates[candidate];
    // Of a lag or delay the fit holds only what the chain does not have yet.
    let already = match c.effect.family() {
        Family::Chain => {
            let (now, given) = (&work.design.chain[c.scope[0]], &work.design.given_chain[c.scope[0]]);
            if c.effect_name() == "actuator_lag" { now.lag - given.lag } else { now.delay - given.delay }
        }
        _ => 0.0,
    };
    of_columns(work, c, variant, &|id| coefficient(id) + already)
}

/// The same of the columns as they are. Where the shape has an offset of its own, as a spring's rest position, any constant in the others is
/// a matter of where it is taken from, and does not count.
pub(crate) fn of_columns(work: &Work, c: &Candidate, variant: &Variant, coefficient: &dyn Fn(ColumnId) -> f64) -> f64 {
    let is_offset = |id: &ColumnId| c.effect.family() != Family::Standard && work.standard.offset.contains(id);
    let own: Vec<(ColumnId, f64)> =
        variant.columns[..variant.n_own].iter().filter(|id| !is_offset(id)).map(|&id| (id, coefficient(id))).collect();
    let squared = |j: usize| {
        let offset = work.standard.offset.get(j).copied().filter(|id| is_offset(id) && variant.columns.contains(id));
        squared_at(work, j, &own, offset)
    };
    // Where it is felt most: rows of a joint weigh the less the more is left there, and what is left is the effect itself.
    let felt = c.scope.iter().map(|&j| work.of_effort(squared(j), &[j])).fold(0.0, f64::max);
    felt / pkm_dyn::math::sqrt(share_of_time(work, c, variant))
}

/// Share of the recordings in which a shape acts: a push is as large as it is while it lasts.
fn share_of_time(work: &Work, c: &Candidate, variant: &Variant) -> f64 {
    let fitted = work.motions.iter().filter(|m| m.segment.used != Use::Holdout).map(|m| m.segment.duration);
    let (n, total) = fitted.fold((0_usize, 0.0), |(n, sum), d| (n + 1, sum + d));
    let lasts = c.effect.lasts(&variant.values).filter(|l| *l > 0.0 && total > 0.0);
    lasts.map_or(1.0, |l| (l * n as f64 / total).min(1.0))
}

/// Weighted squared length at one joint of a sum of columns, less what the constant `offset` would do as well.
fn squared_at(work: &Work, joint: usize, own: &[(ColumnId, f64)], offset: Option<ColumnId>) -> f64 {
    let (xx, local) = (&work.gram.xx_all[joint], &work.gram.local[joint]);
    let there: Vec<(usize, f64)> = own.iter().filter_map(|(id, c)| local[*id].map(|l| (l, *c))).collect();
    let whole: f64 = there.iter().flat_map(|a| there.iter().map(move |b| (a, b))).map(|((a, x), (b, y))| x * y * xx[(*a, *b)]).sum();
    // What acts at reversals is as large as it is, though these rows weigh less in fits.
    let is_light = work.motions.iter().any(|m| m.turning_weight.get(joint).is_some_and(|w| *w > 0.0));
    let scale = if is_light && whole > 0.0 { work.gram.felt(&work.design, joint, &there) / whole } else { 1.0 };
    let offset = offset.and_then(|id| local[id]);
    let constant = offset.map_or(0.0, |o| {
        let mean: f64 = there.iter().map(|(l, c)| c * xx[(*l, o)]).sum();
        if xx[(o, o)] > 0.0 { mean * mean / xx[(o, o)] } else { 0.0 }
    });
    scale * (whole - constant).max(0.0)
}
