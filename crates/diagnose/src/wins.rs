//! In how many blocks an explanation helps, and how evenly.

use crate::final_fit::student_95;

/// A block with less of what is due than this share of an even one's has nothing of it.
const NOTHING: f64 = 1e-3;

/// What an explanation takes away, told by blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Tally {
    /// Blocks in which it helps. What acts in some of the blocks only, such as a push, can help in no other: of those where it does, the
    /// rule of succession says how often it would.
    pub(crate) wins: usize,
    /// Whether it helps where it is due. What nothing else can imitate of it in a block says how much it should take away there: that it does is above
    /// nothing by Student's t at one in forty. What should help everywhere and does in two blocks alone is not steady, however much it helps there; what
    /// acts in two blocks, and helps in both, is.
    pub(crate) is_steady: bool,
}

/// Counts the blocks in which an explanation takes away squared error: `taken`, and `due` if it is as it was fitted on the others, by block.
pub(crate) fn tally(due: &[f64], taken: &[f64]) -> Tally {
    let even = due.iter().sum::<f64>() / due.len().max(1) as f64;
    let won: Vec<bool> = due.iter().zip(taken).filter(|(d, _)| **d > NOTHING * even).map(|(_, t)| *t > 0.0).collect();
    Tally { wins: succession(&won, due.len()), is_steady: is_steady(due, taken) }
}

/// Whether the slope of a line through nothing, of what is taken away over what is due, is above nothing.
pub(crate) fn is_steady(due: &[f64], taken: &[f64]) -> bool {
    let square: f64 = due.iter().map(|d| d * d).sum();
    if taken.len() < 2 || square <= 0.0 {
        return false;
    }
    let slope = due.iter().zip(taken).map(|(d, t)| d * t).sum::<f64>() / square;
    let off: f64 = due.iter().zip(taken).map(|(d, t)| (t - slope * d) * (t - slope * d)).sum();
    let spread = pkm_dyn::math::sqrt(off / ((taken.len() - 1) as f64 * square));
    slope > student_95(taken.len() - 1) * spread
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
    fn what_helps_where_it_acts_is_steady_and_what_helps_in_one_block_of_all_is_not() {
        let first = |n: usize| (0..20).map(|i| if i < n { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
        let all = first(20);
        assert!(!is_steady(&all, &first(1)) && !is_steady(&all, &first(3)));
        // Of even powers it is the t of a mean: ten of twenty have 0.5 with a standard error of 0.115; Student says 2.093 of these.
        assert!(is_steady(&all, &first(10)) && is_steady(&all, &all));
        // What acts in two blocks and helps in both; in one of them; where it does not act.
        assert!(is_steady(&first(2), &first(2)));
        let mut wrong = first(2);
        wrong[1] = -1.0;
        assert!(!is_steady(&first(2), &wrong) && !is_steady(&wrong.iter().map(|_| 0.0).collect::<Vec<_>>(), &first(2)));
        assert!(!is_steady(&[1.0], &[1.0]) && !is_steady(&all[..5], &[0.0; 5]) && !is_steady(&all[..5], &[-1.0; 5]));
    }

    #[test]
    fn what_is_due_at_both_ends_only_is_steady_whatever_the_middle_does() {
        // Damping that warms up beside a refit that has its mean: nothing in the middle, and there noise loses six blocks of twenty.
        let due: Vec<f64> = (0..20).map(|i| 0.01 * (f64::from(i) - 9.5) * (f64::from(i) - 9.5)).collect();
        let taken: Vec<f64> = due.iter().enumerate().map(|(i, d)| d + if i % 2 == 0 { 0.1 } else { -0.1 }).collect();
        let lost = taken.iter().filter(|t| **t < 0.0).count();
        assert!(lost >= 3 && tally(&due, &taken).is_steady, "{lost}");
        assert_eq!(tally(&due, &taken).wins, 20 - lost);
        // What should help everywhere alike and takes the same away is not.
        assert!(!is_steady(&[0.33; 20], &taken.iter().map(|t| t - 0.25).collect::<Vec<_>>()));
    }

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
