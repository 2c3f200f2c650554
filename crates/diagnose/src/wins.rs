//! In how many blocks an explanation helps.

use crate::design::ColumnId;
use crate::gram::Gram;

/// A block with less of the columns' squared length than this share of an even one's has nothing of them.
const NOTHING: f64 = 1e-3;

/// Blocks in which columns help. What acts in some of the blocks only, such as a push, can help in no other: of those where it does, the
/// rule of succession says how often it would.
pub(crate) fn wins(gram: &Gram, own: &[ColumnId], won: &dyn Fn(usize) -> bool) -> usize {
    let power = |f: usize| -> f64 {
        let at = |id: ColumnId, j: usize| gram.local[j][id].map_or(0.0, |l| gram.xx[f][j][(l, l)] * gram.scale[id] * gram.scale[id]);
        own.iter().map(|&id| (0..gram.active.len()).map(|j| at(id, j)).sum::<f64>()).sum()
    };
    let powers: Vec<f64> = (0..gram.n_folds).map(power).collect();
    let even = powers.iter().sum::<f64>() / powers.len().max(1) as f64;
    succession(&powers.iter().enumerate().filter(|(_, p)| **p > NOTHING * even).map(|(f, _)| won(f)).collect::<Vec<_>>(), powers.len())
}

/// Wins among `all` blocks as likely as those among the blocks that were played.
fn succession(played: &[bool], all: usize) -> usize {
    let won = played.iter().filter(|w| **w).count();
    if played.len() == all {
        return won;
    }
    let likely = (won + 1) as f64 / (played.len() + 2) as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the number of blocks")]
    let wins = (likely * (all + 2) as f64 - 1.0).clamp(0.0, all as f64) as usize;
    wins
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_in_few_blocks_is_judged_by_these() {
        assert_eq!(succession(&[true; 10], 10), 10);
        assert_eq!(succession(&[true, false, true, false], 4), 2);
        // Both of two: three in four by Laplace, 0.75·(10 + 2) − 1 of ten.
        assert_eq!(succession(&[true, true], 10), 8);
        assert_eq!(succession(&[true, false], 10), 5);
        assert_eq!(succession(&[], 10), 5);
    }
}
